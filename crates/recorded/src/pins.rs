//! Pins: held-out lines of a calibration, and trials of other days with the mounting learnt at a known place.

use std::ops::Range;

use filters::quantile::CHI2_3_95;
use nalgebra::{Matrix3, Matrix3x6, Rotation3, SMatrix, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use whisker::space::sensor::gaussian_process::{Place, Predictor};

use crate::calibration::Calibrated;
use crate::fixed::{Estimate, FixedPoint, Reading, Settings};
use crate::paper::PaperUkf;

/// Contact threshold, as a share of the largest reading of the calibration.
pub const TOUCH: f64 = 0.02;

/// Distance of a wrong start from the true contact (m).
const WRONG_M: f64 = 5e-3;

/// Scores of an estimator on one pin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PinScore {
    /// Group of the pins.
    pub group: String,
    /// Name of the trial or line.
    pub name: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of scored rows: those after the first third of the contact with an estimate within the calibrated domain.
    pub rows: usize,
    /// Number of rows after the first third of the contact.
    pub all_rows: usize,
    /// Mean error (m).
    pub mean_m: f64,
    /// Largest error (m).
    pub worst_m: f64,
    /// Mean normalised squared error per degree of freedom.
    pub nees: f64,
    /// Share of the rows whose 95 % ellipsoid contains the contact.
    pub coverage: f64,
    /// Mean standard deviation: square root of the trace of the covariance (m).
    pub sd_m: f64,
}

/// Position of the sensor on another day relative to its calibration, and the drift of its rest reading.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mounting {
    /// Translation (m).
    pub shift_m: Vector3<f64>,
    /// Rotation vector (rad).
    pub turn_rad: Vector3<f64>,
    /// Offset of the readings (counts).
    pub offset_counts: Vector2<f64>,
}

impl Mounting {
    /// A reading whose pose and counts are those of the calibration.
    pub fn corrected(&self, reading: &Reading) -> Reading {
        // A contact `c` in the nominal frame has the coordinates `T c + t` in that of the calibration.
        let turn = Rotation3::new(self.turn_rad);
        let rotation = reading.rotation * turn.inverse();
        Reading {
            rotation,
            origin_m: reading.origin_m - rotation * self.shift_m,
            counts: reading.counts - self.offset_counts,
        }
    }

    /// Estimates a mounting from the readings of a touch at a known place: generalised least squares with the joint covariance
    /// of their errors, as for the contact itself.
    pub fn learnt(predictor: &Predictor<'_>, touch: &[Reading], place_m: &Vector3<f64>) -> Self {
        const ITERATIONS: usize = 8;
        const READINGS: usize = 30;
        let prior: SVector<f64, 8> = SVector::from([1e-3, 1e-3, 1e-3, 0.03, 0.03, 0.03, 10.0, 10.0]);
        let mut x = SVector::<f64, 8>::zeros();
        let used: Vec<usize> = {
            let count = touch.len() - 1;
            let used = count.min(READINGS);
            (1..=used).map(|i| (i * count).div_ceil(used)).collect()
        };
        for _ in 0..ITERATIONS {
            let mounting = Self::of(&x);
            let at: Vec<Place> = used
                .iter()
                .map(|&i| {
                    let contact_m = mounting.corrected(&touch[i]).to_sensor(place_m);
                    Place { contact_m, load: touch[i].counts.norm() / predictor.process.largest_reading }
                })
                .collect();
            let kept: Vec<usize> = (0..at.len())
                .filter(|&i| predictor.distance_m(&at[i].contact_m) < Settings::default().reach_m)
                .collect();
            let near: Vec<_> = kept.iter().map(|&i| at[i]).collect();
            let (mut normal, mut gradient) =
                (SMatrix::<f64, 8, 8>::from_diagonal(&prior.map(|sd| 1.0 / (sd * sd))), SVector::<f64, 8>::zeros());
            gradient -= x.component_div(&prior.component_mul(&prior));
            for channel in 0..2 {
                let Some(factor) = predictor.covariance(channel, &near).cholesky() else { return Self::default() };
                let mut jacobian = nalgebra::DMatrix::zeros(near.len(), 8);
                let mut residual = nalgebra::DVector::zeros(near.len());
                for (row, (&i, place)) in kept.iter().zip(&near).enumerate() {
                    let nominal = touch[used[i]].to_sensor(place_m);
                    let (expected, slopes) = predictor.predict(&place.contact_m);
                    let by_turn: Matrix3<f64> = -nominal.cross_matrix();
                    let by_mounting =
                        Matrix3x6::from_fn(
                            |r, c| if c < 3 { f64::from(u8::from(r == c)) } else { by_turn[(r, c - 3)] },
                        );
                    let slope = slopes.row(channel) * by_mounting;
                    for column in 0..6 {
                        jacobian[(row, column)] = slope[column];
                    }
                    jacobian[(row, 6 + channel)] = 1.0;
                    residual[row] =
                        touch[used[i]].counts[channel] - mounting.offset_counts[channel] - expected[channel];
                }
                let solved = factor.solve(&jacobian);
                normal += (jacobian.transpose() * &solved).fixed_view::<8, 8>(0, 0);
                gradient += (solved.transpose() * &residual).fixed_rows::<8>(0);
            }
            let Some(factor) = normal.cholesky() else { return Self::default() };
            x += factor.solve(&gradient);
        }
        Self::of(&x)
    }

    fn of(x: &SVector<f64, 8>) -> Self {
        Self {
            shift_m: x.fixed_rows::<3>(0).into_owned(),
            turn_rad: x.fixed_rows::<3>(3).into_owned(),
            offset_counts: x.fixed_rows::<2>(6).into_owned(),
        }
    }
}

/// Rows of the first touch, and before them the last row without contact. A touch with which the recording begins is left out,
/// since it has no such row. `None` if there is no other.
pub(crate) fn touch_rows(norms: impl IntoIterator<Item = f64>, least: f64) -> Option<Range<usize>> {
    let touches: Vec<bool> = norms.into_iter().map(|norm| norm > least).collect();
    let next = |from: usize, touch: bool| (from..touches.len()).find(|&row| touches[row] == touch);
    let first = next(next(0, false)?, true)?;
    Some(first - 1..next(first, false).unwrap_or(touches.len()))
}

/// Readings of a pin in World, whose origin is the pin; the first is the last one before the touch. `None` if the pin never
/// touches, or for less than three readings.
pub fn touch(rows: &[importers::Labelled], least_counts: f64) -> Option<Vec<Reading>> {
    readings(rows, touch_rows(rows.iter().map(|row| row.counts.norm()), least_counts)?)
}

/// Readings of a line of a calibration, as those of a pin by [`touch`]. A line may begin in contact, because the pin is set down at
/// its first place: the reading there then stands for the one before the touch, of which the estimators use only the pose.
pub fn line_touch(rows: &[importers::Labelled], least_counts: f64) -> Option<Vec<Reading>> {
    let free = std::iter::once(0.0);
    let touch = touch_rows(free.chain(rows.iter().map(|row| row.counts.norm())), least_counts)?;
    readings(rows, touch.start.saturating_sub(1)..touch.end - 1)
}

fn readings(rows: &[importers::Labelled], touch: Range<usize>) -> Option<Vec<Reading>> {
    let reading = |row: &importers::Labelled| Reading {
        rotation: Rotation3::identity(),
        origin_m: -row.contact_m,
        counts: row.counts,
    };
    (touch.len() > 3).then(|| rows[touch].iter().map(reading).collect())
}

/// Which estimator is scored.
#[derive(Clone, Copy, Debug)]
pub enum Method<'a> {
    /// [`FixedPoint`].
    Fixed(&'a Predictor<'a>, Settings),
    /// [`PaperUkf`], with a start 5 mm wrong in a direction drawn from the seed.
    Paper(&'a Predictor<'a>, u64),
}

/// Replays the readings of a pin at the origin of World.
pub fn replay(method: Method<'_>, readings: &[Reading]) -> Vec<Option<Estimate>> {
    match method {
        Method::Fixed(predictor, settings) => {
            let mut estimator = FixedPoint::new(predictor, settings, readings[0]);
            readings[1..].iter().map(|reading| estimator.step(*reading)).collect()
        }
        Method::Paper(predictor, seed) => {
            let mut estimator = PaperUkf::new(predictor, readings[0], wrong(seed));
            readings[1..].iter().map(|reading| estimator.step(*reading)).collect()
        }
    }
}

/// A point 5 mm from the origin, in one of the directions of a spiral over the sphere.
pub(crate) fn wrong(seed: u64) -> Vector3<f64> {
    const GOLDEN_RAD: f64 = 2.399_963_229_728_653;
    const TURNS: u64 = 37;
    let height = 2.0 * ((seed % TURNS) as f64 + 0.5) / TURNS as f64 - 1.0;
    let (sin, cos) = (GOLDEN_RAD * seed as f64).sin_cos();
    Vector3::new((1.0 - height * height).sqrt() * cos, (1.0 - height * height).sqrt() * sin, height) * WRONG_M
}

/// Scores the estimates of a pin at the origin of World.
pub fn score(group: &str, name: &str, estimator: &str, estimates: &[Option<Estimate>]) -> Option<PinScore> {
    let late = &estimates[estimates.len() / 3..];
    let scored: Vec<&Estimate> = late.iter().flatten().filter(|estimate| estimate.is_calibrated).collect();
    let count = scored.len() as f64;
    if scored.is_empty() {
        return None;
    }
    let errors: Vec<f64> = scored.iter().map(|estimate| estimate.contact_m.norm()).collect();
    let nees = |estimate: &&Estimate| {
        let factor = estimate.covariance_m2.cholesky()?;
        Some(estimate.contact_m.dot(&factor.solve(&estimate.contact_m)))
    };
    let squares: Vec<f64> = scored.iter().filter_map(nees).collect();
    Some(PinScore {
        group: group.into(),
        name: name.into(),
        estimator: estimator.into(),
        rows: scored.len(),
        all_rows: late.len(),
        mean_m: errors.iter().sum::<f64>() / count,
        worst_m: errors.iter().copied().fold(0.0, f64::max),
        nees: squares.iter().sum::<f64>() / (3.0 * count),
        coverage: squares.iter().filter(|square| **square <= CHI2_3_95).count() as f64 / count,
        sd_m: scored.iter().map(|estimate| estimate.covariance_m2.trace().sqrt()).sum::<f64>() / count,
    })
}

/// A line of a calibration as a pin trial: its readings above rest.
pub fn line(calibrated: &Calibrated, line: usize) -> Vec<importers::Labelled> {
    let of_line = calibrated.process.samples.iter().filter(|sample| sample.line == line);
    of_line.map(|sample| importers::Labelled { contact_m: sample.contact_m, counts: sample.reading }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_a_touch_begins_with_a_row_without_contact() {
        for (norms, expected) in [
            (&[0.0, 1.0, 3.0, 4.0, 5.0, 2.0, 9.0][..], Some(1..5)),
            (&[0.0, 3.0, 4.0], Some(0..3)),
            // The recording begins in contact.
            (&[3.0, 4.0, 1.0, 2.0, 5.0, 6.0, 1.0], Some(3..6)),
            (&[3.0, 4.0, 1.0], None),
            (&[3.0, 4.0], None),
            (&[1.0, 2.0], None),
            (&[], None),
        ] {
            assert_eq!(touch_rows(norms.iter().copied(), 2.0), expected, "{norms:?}");
        }
        let row = |counts: f64| importers::Labelled { contact_m: Vector3::zeros(), counts: Vector2::new(counts, 0.0) };
        let counts = |read: fn(&[importers::Labelled], f64) -> Option<Vec<Reading>>, rows: &[f64]| {
            let rows: Vec<_> = rows.iter().copied().map(row).collect();
            Some(read(&rows, 2.0)?.iter().map(|reading| reading.counts.x).collect::<Vec<_>>())
        };
        let in_contact = [9.0, 8.0, 7.0, 6.0, 1.0, 3.0, 4.0, 5.0];
        assert_eq!(counts(touch, &in_contact), Some(vec![1.0, 3.0, 4.0, 5.0]));
        assert_eq!(counts(line_touch, &in_contact), Some(vec![9.0, 8.0, 7.0, 6.0]));
        for read in [touch, line_touch] {
            assert_eq!(counts(read, &[0.0, 1.0, 3.0, 4.0, 5.0, 2.0]), Some(vec![1.0, 3.0, 4.0, 5.0]));
            assert_eq!(counts(read, &[1.0, 3.0, 4.0, 1.0]), None);
        }
    }
}
