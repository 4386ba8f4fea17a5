//! Contacts of a real sensor that cannot be fitted.

use super::{Across, Axis, SpatialSample, gaussian_process};
use crate::Whisker;

/// Numbers of contacts of a real sensor that are not fitted, and direction of the coordinates of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Screening {
    /// Direction of the coordinates: the whisker may be deflected by more than its radius of curvature.
    pub across: Across,
    /// Number of contacts whose coordinates are not unique in this direction either.
    pub ambiguous: usize,
    /// Number of contacts whose readings contradict those of all others, for example because the pin slipped off or the wire
    /// jumped to another equilibrium.
    pub contradicted: usize,
}

/// Removes the contacts of a real sensor that cannot be fitted, and the lines without any other.
pub fn screen(whisker: &Whisker, lines: &mut Vec<Vec<SpatialSample>>) -> Screening {
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

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::space::sensor::Around;

    /// Lines of contacts in all directions, with the readings of a smooth map.
    fn lines(whisker: &Whisker) -> Vec<Vec<SpatialSample>> {
        let axis = Axis::new(whisker, Across::Normal);
        let line = |i: i32| {
            let (along_m, azimuth) = (0.032 + 0.006 * f64::from(i / 8), std::f64::consts::TAU * f64::from(i % 8) / 8.0);
            let sample = |step: i32| {
                let away_m = 0.4 * along_m.powi(2) * f64::from(step);
                let contact = Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()).contact(&axis);
                let reading_n_m = Vector2::new(-azimuth.sin(), azimuth.cos()) * (away_m / along_m.powi(2) * 0.01);
                SpatialSample { contact, reading_n_m, reference_n_m: reading_n_m, count: 1.0 }
            };
            (0..6).map(sample).collect()
        };
        (0..40).map(line).collect()
    }

    #[test]
    fn robust_contacts_whose_readings_contradict_all_others_are_left_out() {
        let whisker = Whisker::straight();
        let whole = lines(&whisker);
        let mut damaged = whole.clone();
        damaged[17][5].reading_n_m = Vector2::zeros();
        let found = screen(&whisker, &mut damaged);
        assert_eq!((found.ambiguous, found.contradicted), (0, 1));
        let kept: Vec<usize> = damaged.iter().map(Vec::len).collect();
        let expected: Vec<usize> = (0..40).map(|line| if line == 17 { 5 } else { 6 }).collect();
        assert_eq!(kept, expected);
        assert_eq!(damaged[17], whole[17][..5]);
        let mut few = whole[..10].to_vec();
        assert_eq!(screen(&whisker, &mut few).contradicted, 0);
    }
}
