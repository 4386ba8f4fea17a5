//! The calibrated domain, in coordinates along and away from the undeflected whisker.

use serde::{Deserialize, Serialize};

use super::AlongAway;

/// Largest number of nodes along the whisker; fewer if the calibration is sparse.
const MOST_NODES: usize = 32;

/// Smallest number of samples from which the extremes at a node are taken: one sample of a line that crosses the
/// whisker obliquely does not show its extent.
const LEAST_SAMPLES: usize = 5;

/// Number of nodes that a gap between two lines of a calibration may span.
const GAP: usize = 2;

/// Part of the calibrated extent, along the whisker and away from it, by which a domain is widened.
const WIDENING: f64 = 0.15;

/// Number of nodes of a widened domain: enough that it contains the domain, whose nodes lie elsewhere.
const WIDENED_NODES: usize = 4 * MOST_NODES;

/// Smallest part of the first calibrated arc length to which a domain is widened towards the root.
const LEAST_ROOT_SHARE: f64 = 0.5;

/// Calibrated range of the distance from the undeflected whisker, as a function of arc length, linear between nodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "Nodes", into = "Nodes")]
pub struct Domain {
    nodes: Nodes,
    /// First and last calibrated arc length.
    arc_range_m: (f64, f64),
    /// Number of intervals between nodes per length.
    intervals_per_m: f64,
    /// Smallest and largest distance at the start of each interval, and their increases over it.
    intervals: Vec<[f64; 4]>,
}

/// Values at the nodes, as they are stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nodes {
    /// Evenly spaced nodes along the undeflected whisker.
    arc_m: Vec<f64>,
    /// Smallest calibrated distance at each node, at most 0: the undeflected whisker itself reads zero.
    lower_m: Vec<f64>,
    /// Largest calibrated distance at each node.
    upper_m: Vec<f64>,
}

impl From<Nodes> for Domain {
    fn from(nodes: Nodes) -> Self {
        let end = |arc_m: Option<&f64>| arc_m.copied().unwrap_or(f64::NAN);
        let arc_range_m = (end(nodes.arc_m.first()), end(nodes.arc_m.last()));
        let pairs = nodes.lower_m.windows(2).zip(nodes.upper_m.windows(2));
        let intervals = pairs.map(|(lower, upper)| [lower[0], upper[0], lower[1] - lower[0], upper[1] - upper[0]]);
        let count = nodes.arc_m.len().saturating_sub(1) as f64;
        let intervals_per_m = count / (arc_range_m.1 - arc_range_m.0);
        Self { intervals: intervals.collect(), intervals_per_m, arc_range_m, nodes }
    }
}

impl From<Domain> for Nodes {
    fn from(domain: Domain) -> Self {
        domain.nodes
    }
}

/// Position within the calibrated domain, each share from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shares {
    /// Share of the way from the first calibrated arc length to the last.
    pub along: f64,
    /// Share of the way from the smallest calibrated distance at that arc length to the largest.
    pub away: f64,
}

impl Domain {
    /// Domain from evenly spaced arc lengths, and the smallest, at most 0, and the largest calibrated distance at each. The values
    /// are not checked; see [`Self::is_valid`].
    pub fn new(arc_m: Vec<f64>, lower_m: Vec<f64>, upper_m: Vec<f64>) -> Self {
        Nodes { arc_m, lower_m, upper_m }.into()
    }

    /// Evenly spaced arc lengths, and the largest calibrated distance at each.
    pub fn upper_nodes(&self) -> impl Iterator<Item = (f64, f64)> {
        self.nodes.arc_m.iter().copied().zip(self.nodes.upper_m.iter().copied())
    }

    /// The region covered by samples: around each node the extremes of the nearest samples, with as many nodes as have
    /// `LEAST_SAMPLES` each, or one if there are too few. A calibration proceeds along lines, and gaps between them
    /// count as calibrated. `None` if the samples do not spread along the whisker.
    pub fn covering(samples: &[AlongAway]) -> Option<Self> {
        let low = samples.iter().map(|sample| sample.along_m).fold(f64::INFINITY, f64::min);
        let high = samples.iter().map(|sample| sample.along_m).fold(f64::NEG_INFINITY, f64::max);
        let finest =
            |least| (2..=MOST_NODES).rev().find_map(|nodes| Self::with_nodes(samples, low, high, nodes, least));
        (high > low).then(|| finest(LEAST_SAMPLES).or_else(|| finest(1)))?
    }

    fn with_nodes(samples: &[AlongAway], low: f64, high: f64, nodes: usize, least: usize) -> Option<Self> {
        let pitch = (high - low) / (nodes - 1) as f64;
        let mut lower_m = vec![0.0; nodes];
        let mut upper_m = vec![f64::NEG_INFINITY; nodes];
        let mut counts = vec![0; nodes];
        for &AlongAway { along_m, away_m } in samples {
            let node = ((along_m - low) / pitch).round() as usize;
            counts[node] += 1;
            lower_m[node] = away_m.min(lower_m[node]);
            upper_m[node] = away_m.max(upper_m[node]);
        }
        let arc_m = (0..nodes).map(|node| low + node as f64 * pitch).collect();
        counts.iter().all(|&count| count >= least).then(|| Self::new(arc_m, lower_m, closed_line(&upper_m)))
    }

    /// The region in which a model that [extrapolates](super::SensorModel::extrapolates) is evaluated: this one, widened
    /// along the whisker, up to its tip, and away from it. Nearer to the root the distances shrink in proportion to the
    /// arc length.
    pub(crate) fn widened(&self, length_m: f64) -> Self {
        let (low, high) = self.arc_range_m();
        let margin_m = WIDENING * (high - low);
        let first = (low - margin_m).max(LEAST_ROOT_SHARE * low);
        let last = (high + margin_m).min(length_m).max(high);
        let nodes = WIDENED_NODES - 1;
        let arc_m: Vec<f64> = (0..=nodes).map(|i| first + (last - first) * i as f64 / nodes as f64).collect();
        let range = |&arc_m: &f64| {
            let (lower, upper) = self.away_range_m(arc_m);
            let margin_m = WIDENING * (upper - lower);
            let share = if arc_m < low { arc_m / low } else { 1.0 };
            (share * (lower - margin_m), share * (upper + margin_m))
        };
        let (lower_m, upper_m) = arc_m.iter().map(range).unzip();
        Self::new(arc_m, lower_m, upper_m)
    }

    /// Whether the lists describe a region beside a whisker of this length.
    pub fn is_valid(&self, length_m: f64) -> bool {
        let Nodes { arc_m, lower_m, upper_m } = &self.nodes;
        if arc_m.len() < 2 || lower_m.len() != arc_m.len() || upper_m.len() != arc_m.len() {
            return false;
        }
        are_even_nodes(arc_m, length_m)
            && lower_m.iter().zip(upper_m).all(|(&lower, &upper)| lower <= 0.0 && lower <= upper)
            && upper_m.iter().all(|&upper| upper <= length_m)
    }

    /// First and last calibrated arc length.
    pub fn arc_range_m(&self) -> (f64, f64) {
        self.arc_range_m
    }

    /// Calibrated range of the distance at an arc length within [`Self::arc_range_m`].
    #[inline]
    pub fn away_range_m(&self, arc_m: f64) -> (f64, f64) {
        let (node, part) = node_below((arc_m - self.arc_range_m.0) * self.intervals_per_m, self.intervals.len() + 1);
        let [lower_m, upper_m, lower_step_m, upper_step_m] = self.intervals[node];
        (lower_m + part * lower_step_m, upper_m + part * upper_step_m)
    }

    /// Position of a contact within the region, from 0 to 1 in each direction. Positions outside are moved to the
    /// border.
    pub fn shares(&self, at: AlongAway) -> Shares {
        self.shares_and_containment(at).0
    }

    /// As [`Self::shares`], with the answer of [`Self::contains`].
    #[inline]
    pub(crate) fn shares_and_containment(&self, at: AlongAway) -> (Shares, bool) {
        let AlongAway { along_m, away_m } = at;
        let (low, high) = self.arc_range_m();
        let (lower, upper) = self.away_range_m(along_m);
        let along = ((along_m - low) / (high - low)).clamp(0.0, 1.0);
        let away = if upper > lower { ((away_m - lower) / (upper - lower)).clamp(0.0, 1.0) } else { 0.0 };
        let contained = low <= along_m && along_m <= high && lower <= away_m && away_m <= upper;
        (Shares { along, away }, contained)
    }

    /// Whether a contact with these coordinates was calibrated.
    #[inline]
    pub fn contains(&self, at: AlongAway) -> bool {
        self.shares_and_containment(at).1
    }

    /// The nearest coordinates within the region: first along, then away.
    #[inline]
    pub fn clamp(&self, at: AlongAway) -> AlongAway {
        let (low, high) = self.arc_range_m();
        let along_m = at.along_m.clamp(low, high);
        let (lower, upper) = self.away_range_m(along_m);
        AlongAway { along_m, away_m: at.away_m.clamp(lower, upper) }
    }
}

/// Fills gaps of up to [`GAP`] nodes along one axis, whose neighbours `beside` gives by their node and number of steps:
/// each value is raised to the lower of the maxima within that distance on either side (a morphological closing).
pub(crate) fn closed(values: &[f64], beside: impl Fn(usize, isize) -> Option<usize>) -> Vec<f64> {
    let highest = |node: usize, sign: isize| {
        let neighbours = (1..=GAP as isize).filter_map(|step| beside(node, sign * step));
        neighbours.map(|node| values[node]).fold(f64::NEG_INFINITY, f64::max)
    };
    (0..values.len()).map(|node| values[node].max(highest(node, -1).min(highest(node, 1)))).collect()
}

/// [`closed`] along a line of nodes.
fn closed_line(values: &[f64]) -> Vec<f64> {
    closed(values, |node, steps| node.checked_add_signed(steps).filter(|beside| *beside < values.len()))
}

/// Whether nodes, at least two, are evenly spaced along a whisker of this length.
pub(crate) fn are_even_nodes(arc_m: &[f64], length_m: f64) -> bool {
    let (low, high) = (arc_m[0], arc_m[arc_m.len() - 1]);
    let pitch = (high - low) / (arc_m.len() - 1) as f64;
    let is_even = |pair: &[f64]| (pair[1] - pair[0] - pitch).abs() < 1e-6 * pitch;
    low >= 0.0 && high > low && high <= length_m * (1.0 + 1e-9) && arc_m.windows(2).all(is_even)
}

/// Node below a position among `count` nodes at 0, 1, 2 and so on, moved into their range, and the part of the way to the next.
#[inline]
pub(crate) fn node_below(position: f64, count: usize) -> (usize, f64) {
    let position = position.clamp(0.0, (count - 1) as f64);
    // The conversion to 32 bits takes one instruction, that to an unsigned number of 64 bits several.
    let node = (position as u32 as usize).min(count - 2);
    (node, position - node as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_covers_its_samples_only() {
        let at = AlongAway::new;
        let samples: Vec<AlongAway> = (0..=60)
            .flat_map(|i| (0..=20).map(move |j| at(0.02 + 1e-3 * f64::from(i), 2e-2 * f64::from(j) / 20.0)))
            .collect();
        let domain = Domain::covering(&samples).unwrap();
        assert!(domain.is_valid(0.08));
        assert!(samples.iter().all(|&sample| domain.contains(sample)));
        assert!([at(0.05, 0.021), at(0.019, 0.01), at(0.081, 0.01)].iter().all(|&outside| !domain.contains(outside)));
        assert_eq!(domain.clamp(at(0.1, -1.0)), at(0.08, 0.0));
    }

    #[test]
    fn verif_gaps_between_lines_are_closed_and_slopes_unchanged() {
        assert_eq!(closed_line(&[1.0, 2.0, 0.5, 3.0, 1.0, 1.0, 2.5, 0.0]), [1.0, 2.0, 2.0, 3.0, 2.5, 2.5, 2.5, 0.0]);
    }

    #[test]
    fn verif_a_widened_domain_contains_the_domain_and_ends_at_the_tip() {
        let arc_m: Vec<f64> = (0..9).map(|i| 0.02 + 7e-3 * f64::from(i)).collect();
        let upper_m = arc_m.iter().map(|arc_m| 0.4 * arc_m).collect();
        let domain = Domain::new(arc_m.clone(), vec![0.0; arc_m.len()], upper_m);
        let widened = domain.widened(0.08);
        assert!(widened.arc_range_m().0 < 0.015 && (widened.arc_range_m().1 - 0.08).abs() < 1e-12, "{widened:?}");
        for arc_m in [0.02, 0.05, 0.076] {
            let (lower_m, upper_m) = widened.away_range_m(arc_m);
            assert!(lower_m < 0.0 && upper_m > domain.away_range_m(arc_m).1, "{arc_m}: {lower_m} {upper_m}");
        }
        // As does that of a domain of few nodes with another shape, part of which was only touched from the other side.
        let flat = Domain::new(vec![0.02, 0.048, 0.076], vec![-1.1e-4; 3], vec![8e-3, 8e-3, -1e-4]);
        let around = flat.widened(0.08);
        for (i, &arc_m) in flat.nodes.arc_m.iter().enumerate() {
            let (lower_m, upper_m) = around.away_range_m(arc_m);
            assert!(
                lower_m < flat.nodes.lower_m[i] && upper_m > flat.nodes.upper_m[i] - 1e-4 * upper_m.abs(),
                "{arc_m}: {upper_m}"
            );
        }
        assert!(around.nodes.lower_m.iter().zip(&around.nodes.upper_m).all(|(lower_m, upper_m)| lower_m <= upper_m));
        // The slope to which the whisker may be pressed does not increase towards the root.
        let (first_m, largest_m) = widened.upper_nodes().next().unwrap();
        assert!(largest_m < 0.4 * 1.16 * first_m, "{widened:?}");
    }

    #[test]
    fn robust_sparse_samples_get_fewer_nodes() {
        let domain = Domain::covering(
            &[(0.02, 0.0), (0.05, 0.01), (0.08, 0.002)].map(|(along_m, away_m)| AlongAway::new(along_m, away_m)),
        )
        .unwrap();
        assert_eq!(domain.nodes.arc_m.len(), 3);
        assert!(Domain::covering(&[AlongAway::new(0.02, 0.0)]).is_none());
    }

    #[test]
    fn robust_stored_domains_have_exactly_the_lists_of_the_nodes() {
        let domain = Domain::new(vec![0.02, 0.05], vec![0.0, -1e-3], vec![4e-3, 8e-3]);
        let text = r#"{"arc_m":[0.02,0.05],"lower_m":[0.0,-0.001],"upper_m":[0.004,0.008]}"#;
        assert_eq!(serde_json::to_string(&domain).unwrap(), text);
        assert_eq!(serde_json::from_str::<Domain>(text).unwrap(), domain);
        assert!(serde_json::from_str::<Domain>(&text.replace("arc_m", "arc")).is_err());
        let empty = serde_json::from_str::<Domain>(r#"{"arc_m":[],"lower_m":[],"upper_m":[]}"#).unwrap();
        assert!(!empty.is_valid(0.08));
    }
}
