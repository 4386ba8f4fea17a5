//! Contacts of a real sensor that cannot be fitted.

use super::{Across, Axis, SpatialSample, gaussian_process};
use crate::Whisker;

/// Contacts of a real sensor that are not fitted, and the direction of the coordinates of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Screening {
    /// Direction of the coordinates: the whisker may be deflected by more than its radius of curvature.
    pub across: Across,
    /// Number of contacts whose coordinates are not unique even so.
    pub ambiguous: usize,
    /// Number of contacts whose readings contradict those of all others: the pin slipped off, or the wire jumped to another
    /// equilibrium.
    pub contradicted: usize,
}

/// Leaves out the contacts of a real sensor that cannot be fitted.
pub fn screened(whisker: &Whisker, lines: &mut Vec<Vec<SpatialSample>>) -> Screening {
    let count = |lines: &[Vec<SpatialSample>]| lines.iter().map(Vec::len).sum::<usize>();
    let all = count(lines);
    let contacts: Vec<_> = lines.iter().flatten().map(|sample| sample.contact).collect();
    let across = Across::of(whisker, &contacts);
    let axis = Axis::new(whisker, across);
    lines.iter_mut().for_each(|line| line.retain(|sample| axis.is_unique(sample.contact)));
    let unique = count(lines);
    let outliers = gaussian_process::contradicted(lines);
    let mut indices = 0..unique;
    let mut is_kept = |_: &SpatialSample| indices.next().is_some_and(|i| outliers.binary_search(&i).is_err());
    lines.iter_mut().for_each(|line| line.retain(&mut is_kept));
    lines.retain(|line| !line.is_empty());
    Screening { across, ambiguous: all - unique, contradicted: outliers.len() }
}
