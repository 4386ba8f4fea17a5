//! The calibrated domain in space: how far from the undeflected whisker contacts were calibrated, by arc length and direction.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{Across, Around, Axis};
use crate::Whisker;
use crate::sensor::Shares;
use crate::sensor::domain::{are_even_nodes, closed, node_below};

/// Number of directions about the whisker.
const DIRECTIONS: usize = 16;

/// Largest number of nodes along the whisker; fewer if the calibration is sparse.
const MOST_NODES: usize = 16;

/// Smallest share of the directions with contacts that each node along the whisker has contacts in.
const LEAST_SHARE: f64 = 0.75;

/// Smallest arc length of a tabulated function, relative to the largest.
const LEAST_TABULATED: f64 = 0.02;

/// Smallest distance, relative to the largest of the calibration, of a contact whose direction counts.
const DIRECTED: f64 = 0.05;

/// Calibrated distance from the undeflected whisker, linear between nodes along the whisker and directions about it.
///
/// Lines of contacts at several directions enclose the region; gaps between neighbouring lines count as calibrated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialDomain {
    /// Evenly spaced nodes along the undeflected whisker.
    pub arc_m: Vec<f64>,
    /// Number of evenly spaced directions, the first to the left, the next ones upwards.
    pub directions: usize,
    /// Largest calibrated distance at each node and direction, those of one node in sequence. 0 where there are no contacts.
    pub away_m: Vec<f64>,
    /// Direction in which the coordinates displace contacts.
    #[serde(default, skip_serializing_if = "Across::is_normal")]
    pub across: Across,
}

impl SpatialDomain {
    /// Axis of the coordinates about a whisker.
    pub fn axis(&self, whisker: &Whisker) -> Axis {
        Axis::new(whisker, self.across)
    }

    /// The region covered by samples, whose coordinates displace contacts in the direction of `across`. `None` if they do not
    /// spread along the whisker and in more than one plane.
    pub fn covering(samples: &[Around], across: Across) -> Option<Self> {
        let low = samples.iter().map(|sample| sample.along_m).fold(f64::INFINITY, f64::min);
        let high = samples.iter().map(|sample| sample.along_m).fold(f64::NEG_INFINITY, f64::max);
        let most_m = samples.iter().map(|sample| sample.away_m()).fold(0.0, f64::max);
        let directed: Vec<Around> =
            samples.iter().copied().filter(|sample| sample.away_m() > DIRECTED * most_m).collect();
        // The range of the directions without their signs: contacts in one plane, on either side, have none.
        let (first, other) = directed.split_first()?;
        let crossed = |sample: &Around| first.displacement().perp(&sample.displacement()).abs();
        let least = |sample: &Around| DIRECTED * first.away_m() * sample.away_m();
        let is_spatial = other.iter().any(|sample| crossed(sample) > least(sample));
        let finest = |least| {
            (2..=MOST_NODES).rev().find_map(|nodes| Self::with_nodes(&directed, (low, high), across, nodes, least))
        };
        (is_spatial && high > low).then(|| finest(LEAST_SHARE).or_else(|| finest(0.0)))?
    }

    /// The region with this number of nodes along the whisker, if each of them has samples in the share `least` of the directions.
    fn with_nodes(
        samples: &[Around],
        (low, high): (f64, f64),
        across: Across,
        nodes: usize,
        least: f64,
    ) -> Option<Self> {
        let pitch = (high - low) / (nodes - 1) as f64;
        let mut away_m = vec![0.0_f64; nodes * DIRECTIONS];
        for sample in samples {
            let node = (((sample.along_m - low) / pitch).round() as usize).min(nodes - 1);
            let turns = sample.azimuth_rad() / TAU * DIRECTIONS as f64;
            let direction = (turns.round() as isize).rem_euclid(DIRECTIONS as isize) as usize;
            let known = &mut away_m[node * DIRECTIONS + direction];
            *known = known.max(sample.away_m());
        }
        let is_reached = |direction: usize| (0..nodes).any(|node| away_m[node * DIRECTIONS + direction] > 0.0);
        let reached = (0..DIRECTIONS).filter(|&direction| is_reached(direction)).count() as f64;
        let of_node =
            |node: usize| away_m[node * DIRECTIONS..][..DIRECTIONS].iter().filter(|away_m| **away_m > 0.0).count();
        if (0..nodes).any(|node| of_node(node) as f64 <= least * reached - f64::EPSILON || of_node(node) == 0) {
            return None;
        }
        let around = closed(&away_m, |cell, step| {
            let direction = (cell % DIRECTIONS) as isize + step;
            Some(cell - cell % DIRECTIONS + direction.rem_euclid(DIRECTIONS as isize) as usize)
        });
        let away_m = closed(&around, |cell, step| {
            let node = (cell / DIRECTIONS) as isize + step;
            (0..nodes as isize).contains(&node).then(|| node as usize * DIRECTIONS + cell % DIRECTIONS)
        });
        let arc_m = (0..nodes).map(|node| low + node as f64 * pitch).collect();
        Some(Self { arc_m, directions: DIRECTIONS, away_m, across })
    }

    /// Whether the lists describe a region around a whisker of this length.
    pub fn is_valid(&self, length_m: f64) -> bool {
        let nodes = self.arc_m.len();
        if nodes < 2 || self.directions < 4 || Some(self.away_m.len()) != nodes.checked_mul(self.directions) {
            return false;
        }
        are_even_nodes(&self.arc_m, length_m)
            && self.away_m.iter().all(|away_m| (0.0..=length_m).contains(away_m))
            && self.away_m.iter().any(|away_m| *away_m > 0.0)
    }

    /// First and last calibrated arc length.
    pub fn arc_range_m(&self) -> (f64, f64) {
        (self.arc_m[0], self.arc_m[self.arc_m.len() - 1])
    }

    /// First and last arc length of functions that are tabulated over the region, whose nodes have equal ratios.
    pub(crate) fn tabulated_range_m(&self) -> (f64, f64) {
        let (low_m, high_m) = self.arc_range_m();
        (low_m.max(LEAST_TABULATED * high_m), high_m)
    }

    /// Largest calibrated distance at the arc length and in the direction of a contact.
    pub fn most_away_m(&self, at: Around) -> f64 {
        let (low_m, high_m) = self.arc_range_m();
        let count = self.arc_m.len();
        let (node, part) = node_below((at.along_m - low_m) / (high_m - low_m) * (count - 1) as f64, count);
        let turns = (at.azimuth_rad() / TAU).rem_euclid(1.0) * self.directions as f64;
        let direction = turns as usize % self.directions;
        let turn = turns.fract();
        let at_node = |node: usize| {
            let value = |direction: usize| self.away_m[node * self.directions + direction % self.directions];
            value(direction) + turn * (value(direction + 1) - value(direction))
        };
        at_node(node) + part * (at_node(node + 1) - at_node(node))
    }

    /// Number of [`Self::directions`] with contacts at some node along the whisker.
    pub fn calibrated_directions(&self) -> usize {
        let has_contacts = |direction: &usize| {
            self.away_m.iter().skip(*direction).step_by(self.directions).any(|away_m| *away_m > 0.0)
        };
        (0..self.directions).filter(has_contacts).count()
    }

    /// Largest calibrated distance at a node along the whisker, in any direction.
    pub(crate) fn most_at_node_m(&self, node: usize) -> f64 {
        self.away_m[node * self.directions..][..self.directions].iter().copied().fold(0.0, f64::max)
    }

    /// Whether a contact with these coordinates was calibrated.
    pub fn contains(&self, at: Around) -> bool {
        let (low, high) = self.arc_range_m();
        low <= at.along_m && at.along_m <= high && at.away_m() <= self.most_away_m(at)
    }

    /// The nearest coordinates within the region: first along, then towards the undeflected whisker.
    pub fn clamp(&self, at: Around) -> Around {
        self.held(at).0
    }

    /// The nearest coordinates within the region as in [`Self::clamp`], and their position in it: along, and away by the share of
    /// the largest distance.
    pub(crate) fn held(&self, at: Around) -> (Around, Shares) {
        let (low, high) = self.arc_range_m();
        let held = Around { along_m: at.along_m.clamp(low, high), ..at };
        let (away_m, most_m) = (held.away_m(), self.most_away_m(held));
        let away = if most_m > 0.0 { (away_m / most_m).min(1.0) } else { 0.0 };
        let shares = Shares { along: (held.along_m - low) / (high - low), away };
        if away_m <= most_m {
            return (held, shares);
        }
        // Slightly within, so that rounding does not put it outside.
        let share = most_m / away_m * (1.0 - 1e-12);
        (Around { left_m: share * held.left_m, up_m: share * held.up_m, ..held }, shares)
    }

    /// Position of a contact within the region, away by the share of the largest distance. Positions outside are moved to the
    /// border.
    pub fn shares(&self, at: Around) -> Shares {
        self.held(at).1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight lines at each of four arc lengths, each 2 mm long.
    fn lines() -> Vec<Around> {
        let mut samples = Vec::new();
        for node in 0..4 {
            for turn in 0..8 {
                for step in 0..=20 {
                    let (azimuth, away_m) = (TAU * f64::from(turn) / 8.0, 1e-4 * f64::from(step));
                    let along_m = 0.03 + 0.01 * f64::from(node);
                    samples.push(Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()));
                }
            }
        }
        samples
    }

    #[test]
    fn verif_lines_in_all_directions_enclose_a_region() {
        let samples = lines();
        let domain = SpatialDomain::covering(&samples, Across::Normal).unwrap();
        assert!(domain.is_valid(0.08));
        let inwards = |at: &Around| Around::new(at.along_m, 0.999 * at.left_m, 0.999 * at.up_m);
        assert!(samples.iter().all(|sample| domain.contains(inwards(sample))));
        // Between two lines, on either axis.
        assert!(domain.contains(Around::new(0.035, 1.7e-3, 0.7e-3)));
        let outside = [Around::new(0.029, 1e-3, 0.0), Around::new(0.061, 1e-3, 0.0), Around::new(0.045, 0.0, -2.1e-3)];
        for at in outside {
            assert!(!domain.contains(at) && domain.contains(domain.clamp(at)), "{at:?}");
        }
    }

    #[test]
    fn robust_contacts_in_one_plane_give_no_region() {
        let planar: Vec<Around> = lines().into_iter().filter(|at| at.up_m.abs() < 1e-9).collect();
        assert!(planar.len() > 100 && SpatialDomain::covering(&planar, Across::Normal).is_none());
    }

    #[test]
    fn verif_directions_without_contacts_are_not_calibrated() {
        let half: Vec<Around> = lines().into_iter().filter(|at| at.left_m > -1e-9).collect();
        let domain = SpatialDomain::covering(&half, Across::Normal).unwrap();
        assert!(domain.contains(Around::new(0.045, 1e-3, 1e-3)));
        assert!(!domain.contains(Around::new(0.045, -1e-3, 0.0)));
        assert!((domain.directions / 2..domain.directions).contains(&domain.calibrated_directions()), "{domain:?}");
        let all = SpatialDomain::covering(&lines(), Across::Normal).unwrap();
        assert_eq!(all.calibrated_directions(), all.directions);
    }
}
