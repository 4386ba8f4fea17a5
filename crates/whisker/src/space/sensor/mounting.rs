//! Deviation of a sensor's mounting from that of its calibration, learnt from touches at known places.
//!
//! A remounted sensor has another position and orientation, which displaces all its contacts. Touches at known places determine
//! both: their readings are those of contacts that are displaced by a small rigid motion in the Base of the calibration. The motion
//! is fitted by generalised least squares (Gauss-Newton) with the covariance of the sensor model's errors, which are correlated
//! along the path of a contact.

use nalgebra::{
    DMatrix, DVector, Matrix2, Matrix2x6, Matrix3, Matrix3x6, Matrix6, Rotation3, Vector2, Vector3, Vector6,
};
use serde::{Deserialize, Serialize};

use super::{CalibratedSpace, exponential};
use crate::frames::Base;
use crate::space::frames::{Point, Pose};

/// Standard deviation of the drift of the rest reading, an offset that is constant during a touch, relative to the largest reading
/// of the calibration.
const REST_SD: f64 = 2e-3;

/// Smallest standard deviation of the noise, relative to the largest reading of the calibration.
const LEAST_NOISE: f64 = 1e-4;

/// Largest number of contacts used per touch; longer touches are thinned evenly.
const MOST_CONTACTS: usize = 40;

/// Squared normalised residual (two degrees of freedom) beyond which a contact is left out.
const OUTLIER: f64 = 25.0;

/// Number of Gauss-Newton iterations.
const ITERATIONS: usize = 12;

/// A known contact and the reading there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownContact {
    /// The contact in Base.
    pub contact: Point<Base>,
    /// Bending moments about y and z of Base relative to rest (N m), 2x1.
    pub reading_n_m: Vector2<f64>,
}

/// Deviation of the present mounting from that of the calibration: a contact at `c` in Base has the readings that the calibrated
/// sensor has for a contact at `R c + t`, with the rotation `R` and the translation `t`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mounting {
    /// Translation (m), 3x1.
    pub shift_m: Vector3<f64>,
    /// Rotation vector (rad), 3x1.
    pub turn_rad: Vector3<f64>,
    /// Covariance of both (m2, m rad, rad2), 6x6.
    pub covariance: Matrix6<f64>,
}

/// A mounting that was learnt from touches, and how well it explains each of them.
#[derive(Clone, Debug, PartialEq)]
pub struct MountingFit {
    /// The mounting.
    pub mounting: Mounting,
    /// One entry per touch, in their order.
    pub touches: Vec<FittedTouch>,
}

/// A touch at a known place, from which a mounting was learnt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedTouch {
    /// Number of contacts that were compared: those up to the largest reading, at most 40, evenly spaced.
    pub contacts: usize,
    /// Number of these that are in the calibrated domain and agree with the mounting.
    pub used: usize,
    /// Root mean square residual of the readings of the used contacts (N m), each moment: with the nominal mounting, of those that
    /// are then in the calibrated domain, and with the one that was learnt. `None` if there are none.
    pub residuals_n_m: Option<[f64; 2]>,
    /// Root mean square of the residuals of all contacts in the calibrated domain with the mounting that follows from the other
    /// touches, normalised by their joint covariance, which includes that of this mounting. 1 is expected. `None` if there are no
    /// other touches, if they determine no mounting, or if no contact is in the domain.
    pub disagreement: Option<f64>,
}

impl Mounting {
    /// Smallest number of contacts that determine a mounting.
    pub const LEAST_CONTACTS: usize = 6;

    /// Standard deviation, expected of a remounted sensor, of the translation along each axis (m).
    pub const SHIFT_SD_M: f64 = 1e-3;

    /// The same of the rotation about each axis (rad).
    pub const TURN_SD_RAD: f64 = 0.03;

    /// The mounting that explains touches at known places, each with its contacts in order of time. `noise_sd_n_m` is the standard
    /// deviation of the measurement noise of each moment. `None` if fewer than [`Self::LEAST_CONTACTS`] contacts in the calibrated
    /// domain agree with one mounting, or if a covariance is singular. A mounting of `calibrated` is ignored.
    pub fn learnt(
        calibrated: &CalibratedSpace,
        touches: &[Vec<KnownContact>],
        noise_sd_n_m: f64,
    ) -> Option<MountingFit> {
        let data = Touches {
            calibrated: &CalibratedSpace { mounting: None, ..calibrated.clone() },
            // Without noise, the readings of repeated contacts would have a singular covariance.
            noise_sd_n_m: noise_sd_n_m.max(LEAST_NOISE * calibrated.largest_reading_n_m),
            touches: touches.iter().map(|touch| thinned(touch)).collect(),
        };
        let mounting = data.mounting(None)?;
        let touches = (0..touches.len()).map(|touch| data.explained(&mounting, touch)).collect();
        Some(MountingFit { mounting, touches })
    }

    /// The nominal mounting, with the covariance of the deviations that are expected of a remounted sensor.
    fn prior() -> Self {
        let variances =
            Vector6::from_fn(|axis, _| if axis < 3 { Self::SHIFT_SD_M.powi(2) } else { Self::TURN_SD_RAD.powi(2) });
        Self { shift_m: Vector3::zeros(), turn_rad: Vector3::zeros(), covariance: Matrix6::from_diagonal(&variances) }
    }

    /// The largest of the deviations along and about the axes, over the standard deviations that are expected of a remounted
    /// sensor.
    pub fn size(&self) -> f64 {
        self.vector().component_div(&Self::prior().covariance.diagonal().map(f64::sqrt)).amax()
    }

    fn vector(&self) -> Vector6<f64> {
        let (t, r) = (self.shift_m, self.turn_rad);
        Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z)
    }

    /// Pose of Base in the Base of the calibration.
    pub fn pose(&self) -> Pose<Base, Base> {
        Pose::new(self.shift_m, Rotation3::new(self.turn_rad))
    }

    /// Whether the numbers are finite, and the covariance symmetric and positive definite.
    pub fn is_valid(&self) -> bool {
        let is_finite = self.vector().iter().chain(&self.covariance).all(|value| value.is_finite());
        is_finite && self.covariance == self.covariance.transpose() && self.covariance.cholesky().is_some()
    }

    /// Covariance (m2), 3x3, of a contact in the Base of the calibration due to the uncertainty of the mounting.
    pub fn contact_covariance_m2(&self, contact: &Point<Base>) -> Matrix3<f64> {
        let by_mounting = by_motion(contact.vector() - self.shift_m);
        by_mounting * self.covariance * by_mounting.transpose()
    }

    /// Covariance (rad2), 3x3, of a unit direction in the Base of the calibration due to the uncertainty of the rotation.
    pub fn direction_covariance(&self, direction: &Vector3<f64>) -> Matrix3<f64> {
        let by_turn = direction.cross_matrix();
        by_turn * self.covariance.fixed_view::<3, 3>(3, 3) * by_turn.transpose()
    }
}

/// Touches at known places with a sensor.
struct Touches<'a> {
    calibrated: &'a CalibratedSpace,
    noise_sd_n_m: f64,
    touches: Vec<Vec<KnownContact>>,
}

impl Touches<'_> {
    /// The mounting that explains all touches but `without`. `None` as by [`Mounting::learnt`].
    fn mounting(&self, without: Option<usize>) -> Option<Mounting> {
        let mut found = Mounting::prior();
        let weights = found.covariance.diagonal().map(|variance| 1.0 / variance);
        for _ in 0..ITERATIONS {
            let mut normal = Matrix6::from_diagonal(&weights);
            let mut gradient = -found.vector().component_mul(&weights);
            let mut used = 0;
            for (_, touch) in self.touches.iter().enumerate().filter(|(i, _)| Some(*i) != without) {
                let rows = self.rows(&found, touch);
                used += rows.len();
                let covariance = self.joint(&rows);
                let (jacobian, residual) = stacked(&rows);
                let factor = covariance.cholesky()?;
                let solved = factor.solve(&jacobian);
                normal += (jacobian.transpose() * &solved).fixed_view::<6, 6>(0, 0);
                gradient += (solved.transpose() * residual).fixed_rows::<6>(0);
            }
            if used < Mounting::LEAST_CONTACTS {
                return None;
            }
            let factor = normal.cholesky()?;
            let next = found.vector() + factor.solve(&gradient);
            found = Mounting {
                shift_m: next.fixed_rows::<3>(0).into_owned(),
                turn_rad: next.fixed_rows::<3>(3).into_owned(),
                covariance: symmetric(&factor.inverse()),
            };
        }
        Some(found)
    }

    /// How well a mounting explains a touch.
    fn explained(&self, mounting: &Mounting, touch: usize) -> FittedTouch {
        let contacts = &self.touches[touch];
        let (nominal, rows) = (Mounting::prior(), self.rows(mounting, contacts));
        let before: Vec<Row> = rows.iter().filter_map(|row| self.row(&nominal, &row.known)).collect();
        let residual_n_m = |rows: &[Row]| {
            let squares = rows.iter().map(|row| row.residual_n_m.norm_squared()).sum::<f64>();
            (!rows.is_empty()).then(|| (squares / (2 * rows.len()) as f64).sqrt())
        };
        let residuals_n_m = residual_n_m(&before).zip(residual_n_m(&rows)).map(|(before, after)| [before, after]);
        let disagreement = self.mounting(Some(touch)).and_then(|by_others| self.disagreement(&by_others, contacts));
        FittedTouch { contacts: contacts.len(), used: rows.len(), residuals_n_m, disagreement }
    }

    /// [`FittedTouch::disagreement`] of a touch, given the mounting by the others. `None` if no contact is in the calibrated
    /// domain.
    fn disagreement(&self, by_others: &Mounting, touch: &[KnownContact]) -> Option<f64> {
        let rows: Vec<Row> = touch.iter().filter_map(|known| self.row(by_others, known)).collect();
        if rows.is_empty() {
            return None;
        }
        let (jacobian, residual) = stacked(&rows);
        let covariance = self.joint(&rows) + &jacobian * by_others.covariance * jacobian.transpose();
        let square = residual.dot(&covariance.cholesky()?.solve(&residual));
        Some((square / residual.len() as f64).sqrt())
    }

    /// Residual of a contact, with its derivatives by shift and turn. `None` outside the calibrated domain.
    fn row(&self, mounting: &Mounting, known: &KnownContact) -> Option<Row> {
        let contact = mounting.pose().apply(known.contact);
        let predicted = self.calibrated.predict(contact)?;
        let residual_n_m = known.reading_n_m - predicted.reading_n_m;
        let model_n2_m2 = self.calibrated.model_covariance_n2_m2(self.calibrated.around(contact));
        let factor = model_n2_m2.cholesky()?.l();
        let slopes = predicted.gradient_n * by_motion(contact.vector() - mounting.shift_m);
        Some(Row { known: *known, contact, residual_n_m, slopes, factor })
    }

    /// The residuals of the contacts of a touch within the calibrated domain, without those that are too large even for the prior
    /// standard deviations of the mounting.
    fn rows(&self, mounting: &Mounting, touch: &[KnownContact]) -> Vec<Row> {
        let prior = Mounting::prior().covariance;
        let agrees = |row: &Row| {
            let single = row.factor * row.factor.transpose()
                + Matrix2::identity() * (self.rest_n2_m2() + self.noise_sd_n_m.powi(2))
                + row.slopes * prior * row.slopes.transpose();
            let square = single.cholesky().map(|factor| row.residual_n_m.dot(&factor.solve(&row.residual_n_m)));
            square.is_some_and(|square| square <= OUTLIER)
        };
        touch.iter().filter_map(|known| self.row(mounting, known)).filter(agrees).collect()
    }

    /// Variance of the drift of the rest reading, of each moment (N2 m2).
    fn rest_n2_m2(&self) -> f64 {
        (REST_SD * self.calibrated.largest_reading_n_m).powi(2)
    }

    /// Joint covariance of the readings of one touch (N2 m2), 2n x 2n for n contacts.
    fn joint(&self, rows: &[Row]) -> DMatrix<f64> {
        let mut covariance = DMatrix::zeros(2 * rows.len(), 2 * rows.len());
        for (i, one) in rows.iter().enumerate() {
            for (j, other) in rows.iter().enumerate() {
                let shared = match self.calibrated.error.correlation_m {
                    Some(length_m) => exponential(one.contact.distance(&other.contact), length_m),
                    None => f64::from(u8::from(i == j)),
                };
                let mut block = one.factor * other.factor.transpose() * shared;
                for axis in 0..2 {
                    block[(axis, axis)] += self.rest_n2_m2() + if i == j { self.noise_sd_n_m.powi(2) } else { 0.0 };
                }
                covariance.fixed_view_mut::<2, 2>(2 * i, 2 * j).copy_from(&block);
            }
        }
        covariance
    }
}

/// Residual of a contact, its derivatives with respect to the mounting, and the Cholesky factor of the model error's covariance.
struct Row {
    known: KnownContact,
    /// The contact in the Base of the calibration.
    contact: Point<Base>,
    residual_n_m: Vector2<f64>,
    slopes: Matrix2x6<f64>,
    factor: Matrix2<f64>,
}

/// Derivatives, 3x6, of `p = R c + t` with respect to translation and rotation vector, given `R c` (m): `dp = dt + dw x R c`.
fn by_motion(turned_m: Vector3<f64>) -> Matrix3x6<f64> {
    let mut slopes = Matrix3x6::zeros();
    slopes.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
    slopes.fixed_columns_mut::<3>(3).copy_from(&-turned_m.cross_matrix());
    slopes
}

/// Derivatives and residuals of all contacts of a touch, two rows each, 2n x 6 and 2n.
fn stacked(rows: &[Row]) -> (DMatrix<f64>, DVector<f64>) {
    let jacobian = DMatrix::from_fn(2 * rows.len(), 6, |i, j| rows[i / 2].slopes[(i % 2, j)]);
    let residual = DVector::from_fn(2 * rows.len(), |i, _| rows[i / 2].residual_n_m[i % 2]);
    (jacobian, residual)
}

/// Symmetric part of a matrix, to remove rounding errors.
fn symmetric(matrix: &Matrix6<f64>) -> Matrix6<f64> {
    (matrix + matrix.transpose()) * 0.5
}

/// At most [`MOST_CONTACTS`] contacts, evenly spaced, up to the largest reading. After it the whisker may slip off the pin, so that
/// the contact is no longer at the known place.
fn thinned(touch: &[KnownContact]) -> Vec<KnownContact> {
    let sizes = touch.iter().map(|known| known.reading_n_m.norm()).enumerate();
    let last = sizes.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i + 1);
    let touch = &touch[..last];
    let count = touch.len().min(MOST_CONTACTS);
    (0..count).map(|i| touch[i * touch.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_derivatives_by_a_small_motion_equal_differences() {
        let mounting = Mounting {
            shift_m: Vector3::new(1e-3, -2e-3, 0.5e-3),
            turn_rad: Vector3::new(0.02, -0.01, 0.03),
            covariance: Matrix6::identity(),
        };
        let contact = Point::new(0.04, -0.01, 0.005);
        let moved = mounting.pose().apply(contact);
        let slopes = by_motion(moved.vector() - mounting.shift_m);
        for axis in 0..3 {
            let step = Vector3::from_fn(|i, _| if i == axis { 1e-6 } else { 0.0 });
            let turned = Rotation3::new(step) * Rotation3::new(mounting.turn_rad);
            let found = (turned * contact.vector() + mounting.shift_m - moved.vector()) / 1e-6;
            assert!((found - slopes.column(3 + axis)).norm() < 1e-6, "{axis}");
            assert_eq!(slopes.column(axis), step / 1e-6);
        }
        let covariance = mounting.contact_covariance_m2(&moved);
        assert!((covariance - slopes * slopes.transpose()).norm() < 1e-12);
    }

    #[test]
    fn verif_contacts_after_the_largest_reading_are_left_out_and_the_others_thinned() {
        let touch: Vec<KnownContact> = (0..120)
            .map(|i| KnownContact {
                contact: Point::new(0.04, 1e-4 * f64::from(i), 0.0),
                reading_n_m: Vector2::new(0.0, f64::from(if i < 100 { i } else { 0 })),
            })
            .collect();
        let used = thinned(&touch);
        assert_eq!(used.len(), MOST_CONTACTS);
        assert!(used.iter().all(|known| known.reading_n_m.y < 100.0 && known.contact.vector().y < 1e-2));
    }
}
