//! Division of the work of a batch into items.
//!
//! An item is some seeds of one scene at one noise level. One thread starts it; threads without an item may help. The
//! results of a finished item are stored and reused by the next evaluation of the same inputs. The division depends on
//! the settings alone, so it is the same for every process and any number of threads.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Number of replays of an item by one estimator: few, so that little is lost with an interrupted item, but enough to
/// justify one read of the scene.
const REPLAYS: usize = 10;

/// A unit of work.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// Index of its scene in the plan.
    pub(super) scene: usize,
    /// Index of its noise level in the settings.
    pub(super) level: usize,
    /// Indices of its seeds in the settings.
    pub(super) seeds: Range<usize>,
}

/// All items of a batch.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Indices of the trials of each scene: the whiskers of a recording, or one trace.
    pub(super) scenes: Vec<Vec<usize>>,
    /// The items, scene by scene, level by level, in the order of the seeds.
    pub(super) items: Vec<Item>,
}

impl Plan {
    /// Divides the work on trials, given by the names of their scenes.
    pub(super) fn new(scene_of_trials: impl Iterator<Item = String>, levels: usize, seeds: usize) -> Self {
        let mut scenes: Vec<Vec<usize>> = Vec::new();
        let mut places = BTreeMap::new();
        for (trial, name) in scene_of_trials.enumerate() {
            let scene = *places.entry(name).or_insert(scenes.len());
            if scene == scenes.len() {
                scenes.push(Vec::new());
            }
            scenes[scene].push(trial);
        }
        let mut items = Vec::new();
        for (scene, members) in scenes.iter().enumerate() {
            let size = (REPLAYS / members.len()).max(1);
            for level in 0..levels {
                let starts = (0..seeds).step_by(size);
                items.extend(starts.map(|first| Item { scene, level, seeds: first..(first + size).min(seeds) }));
            }
        }
        Self { scenes, items }
    }

    /// Number of trials of an item, each counted once for every seed.
    pub(super) fn trials_of(&self, item: &Item) -> usize {
        self.scenes[item.scene].len() * item.seeds.len()
    }

    /// Items, each with the index of a trial in its scene, in the order of results: by trials, noise levels and seeds.
    pub(super) fn in_order(&self) -> Vec<(usize, usize)> {
        let mut trials: Vec<(usize, usize, usize)> = Vec::new();
        for (scene, members) in self.scenes.iter().enumerate() {
            trials.extend(members.iter().enumerate().map(|(member, &trial)| (trial, scene, member)));
        }
        trials.sort_unstable();
        let first_of = |scene| self.items.partition_point(|item| item.scene < scene);
        let of_trial = |(_, scene, member)| (first_of(scene)..first_of(scene + 1)).map(move |item| (item, member));
        trials.into_iter().flat_map(of_trial).collect()
    }
}

/// A share of the items, for one of several processes or machines with a common file system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    number: usize,
    of: usize,
}

impl Share {
    /// Whether an item belongs to the share.
    pub(super) fn has(self, item: usize) -> bool {
        item % self.of == self.number - 1
    }
}

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err("expected a share as number/shares, for example 3/16".into()),
        }
    }
}

impl fmt::Display for Share {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}/{}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        Plan::new(["pin", "arm", "disc", "arm"].into_iter().map(Into::into), 2, 23)
    }

    #[test]
    fn verif_every_trial_level_and_seed_is_in_one_item() {
        let plan = plan();
        assert_eq!(plan.scenes, [vec![0], vec![1, 3], vec![2]]);
        assert_eq!(plan.items.iter().map(|item| plan.trials_of(item)).sum::<usize>(), 4 * 2 * 23);
        for scene in 0..3 {
            for level in 0..2 {
                let of_both = plan.items.iter().filter(|item| item.scene == scene && item.level == level);
                let seeds: Vec<usize> = of_both.flat_map(|item| item.seeds.clone()).collect();
                assert_eq!(seeds, (0..23).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn verif_results_are_in_the_order_of_trials_levels_and_seeds() {
        let plan = plan();
        let order = plan.in_order().into_iter().map(|(item, member)| {
            let item = &plan.items[item];
            (plan.scenes[item.scene][member], item.level, item.seeds.start)
        });
        let order: Vec<_> = order.collect();
        assert!(
            order.is_sorted() && order.len() == plan.items.len() + plan.items.iter().filter(|i| i.scene == 1).count()
        );
    }

    #[test]
    fn verif_shares_are_disjoint_and_complete() {
        let shares: Vec<Share> = (1..=3).map(|number| format!("{number}/3").parse().unwrap()).collect();
        for item in 0..100 {
            assert_eq!(shares.iter().filter(|share| share.has(item)).count(), 1);
        }
        for wrong in ["0/3", "4/3", "1", "a/b", "1/0", "-1/2", ""] {
            assert!(wrong.parse::<Share>().is_err(), "{wrong}");
        }
    }
}
