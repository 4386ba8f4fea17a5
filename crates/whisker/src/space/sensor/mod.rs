//! Sensor models in space: the expected bending moments of a contact.
//!
//! The reading consists of the bending moments at the root about y and z of Base. A calibration presses a pin against the
//! whisker along lines in several directions; a [`SpatialModel`] is a formula fitted to these contacts, and a
//! [`CalibratedSpace`] that formula with its [`SpatialDomain`], outside which there is no prediction, and its error.
//!
//! To add a model: one file beside `polynomial.rs`, and one row in [`SPATIAL_MODELS`].

mod coordinates;
mod correlation;
mod domain;
mod error;
mod fit;
pub mod gaussian_process;
mod geometry;
mod mounting;
mod neighbours;
mod polynomial;
mod rod;
mod screening;
mod spline;
mod table;
mod tabulated;
#[cfg(test)]
mod testing;

use std::fmt::Debug;
use std::sync::{Arc, OnceLock};

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde_json::Value;

use crate::frames::Base;
use crate::rod::{Rod, Suspension};
use crate::sensor::{ModelError, Shares};
use crate::space::frames::{Point, Pose};
use crate::{Invalid, Whisker};

pub use coordinates::{Across, Around, Axis};
pub use correlation::Correlation;
pub use domain::SpatialDomain;
pub use error::SpatialErrorMap;
pub(crate) use error::exponential;
pub use fit::{SpatialFit, SpatialFitData, fit};
pub use geometry::{Directions, Geometry};
pub use mounting::{FittedTouch, KnownContact, Mounting, MountingFit};
pub use screening::{Screening, screen};

/// Names of the readings, in order, as in the columns of a trace in space.
pub const READINGS: [&str; 2] = ["moment_y_n_m", "moment_z_n_m"];

/// A whisker with its properties out of its plane.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialWhisker {
    /// The whisker in its plane.
    pub whisker: Whisker,
    /// Springs at the root.
    pub suspension: Suspension,
    /// Poisson ratio of the wire.
    pub poisson_ratio: f64,
}

impl SpatialWhisker {
    /// Mechanics of the whisker.
    ///
    /// # Errors
    /// [`Invalid`] if a parameter is out of its range.
    pub fn rod(&self) -> Result<Rod, Invalid> {
        Rod::new(&self.whisker, self.suspension, self.poisson_ratio)
    }
}

/// One calibration sample: a known contact and its readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialSample {
    /// Contact on the centre line.
    pub contact: Point<Base>,
    /// Bending moments about y and z of Base as the sensor read them (N m), 2x1.
    pub reading_n_m: Vector2<f64>,
    /// Bending moments that held-out predictions are compared with: free of noise, if known (N m), 2x1.
    pub reference_n_m: Vector2<f64>,
    /// Number of readings of which this is the mean.
    pub count: f64,
}

/// Prediction of a model for a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialPrediction {
    /// Expected bending moments about y and z of Base (N m), 2x1.
    pub reading_n_m: Vector2<f64>,
    /// Their derivatives by the contact in Base, 2x3, in N m per m.
    pub gradient_n: Matrix2x3<f64>,
}

impl SpatialPrediction {
    /// Prediction for a contact given by its coordinates about the undeflected whisker, from the readings (N m), 2x1, and their
    /// derivatives with respect to these coordinates (N), 2x3.
    fn around(axis: &Axis, at: Around, (reading_n_m, slopes): (Vector2<f64>, Matrix2x3<f64>)) -> Self {
        // Singular only at the whisker's centre of curvature, where the coordinates are not defined.
        let inverse = at.contact_with_jacobian(axis).1.try_inverse().unwrap_or_default();
        Self { reading_n_m, gradient_n: slopes * inverse }
    }
}

/// Checks that a stored model has this number of finite coefficients for each moment.
fn check_coefficients(coefficients_n_m: &[Vec<f64>; 2], expected: usize) -> Result<(), ModelError> {
    for coefficients in coefficients_n_m {
        if coefficients.len() != expected || !coefficients.iter().all(|c| c.is_finite()) {
            let found = coefficients.len();
            return Err(ModelError::Data(format!(
                "`coefficients_n_m`: found {found} numbers, expected {expected} finite ones for each moment"
            )));
        }
    }
    Ok(())
}

/// A formula from contact to readings. It is defined everywhere; [`CalibratedSpace`] restricts it to the calibrated domain.
pub trait SpatialModel: Debug + Send + Sync {
    /// Name in the registry.
    fn kind(&self) -> &'static str;

    /// Unique name within a calibration: the kind, and the settings that distinguish it.
    fn label(&self) -> String {
        self.kind().into()
    }

    /// Expected readings and their derivatives.
    fn predict(&self, contact: Point<Base>) -> SpatialPrediction;

    /// Expected readings of a contact given by its coordinates about the undeflected whisker, and their derivatives by these.
    /// By default from [`Self::predict`].
    fn predict_around(&self, axis: &Axis, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        let (contact, jacobian) = at.contact_with_jacobian(axis);
        let SpatialPrediction { reading_n_m, gradient_n } = self.predict(contact);
        (reading_n_m, gradient_n * jacobian)
    }

    /// Standard deviations of the bending moments about y and z of Base about the expected ones (N m), 2x1, as predicted by the
    /// model for a contact within the calibrated domain. They include errors that differ from reading to reading as those of the
    /// calibration do, but not the measurement noise of other recordings; both moments are independent. By default 0:
    /// [`SpatialErrorMap`] then contains the whole error.
    fn sd_n_m(&self, _: Around) -> Vector2<f64> {
        Vector2::zeros()
    }

    /// The stored model, which the registry's `load` restores.
    fn to_json(&self) -> Value;
}

/// The part of space around a whisker that a calibration covers.
#[derive(Clone, Copy, Debug)]
pub struct SpatialRegion<'a> {
    /// The whisker.
    pub whisker: &'a SpatialWhisker,
    /// The calibrated domain.
    pub domain: &'a SpatialDomain,
}

/// Readings at the contacts of a line (its index), predicted by a model fitted without the lines of the given indices.
pub type Without = Box<dyn Fn(usize, &[usize]) -> Result<Vec<Vector2<f64>>, ModelError>>;

/// Result of a fit.
pub struct FittedSpatialModel {
    /// The model.
    pub model: Box<dyn SpatialModel>,
    /// Predictions on held-out lines.
    pub without: Without,
    /// Correlations of the errors at pairs of contacts of one touch, as predicted by the model. `None` if the model predicts none;
    /// those of the errors on held-out lines are then used.
    pub correlations: Option<Vec<Correlation>>,
}

/// Fits a model with settings to the lines of a calibration.
pub type FitLines = fn(&SpatialRegion<'_>, &[Vec<SpatialSample>], &Value) -> Result<FittedSpatialModel, ModelError>;

/// Result of loading a model.
pub type SpatialLoaded = Result<Box<dyn SpatialModel>, ModelError>;

/// A row of the registry of sensor models in space.
pub struct SpatialModelRow {
    /// Name.
    pub kind: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Settings that a calibration compares to select the best model, given whether the sensor is a real one
    /// ([`SpatialFitData::real_sensor`]). Empty if the model does not suit such a sensor.
    pub candidates: fn(bool) -> Vec<Value>,
    /// Fits the model to the lines of a calibration.
    pub fit: FitLines,
    /// Loads a model stored by [`SpatialModel::to_json`].
    pub load: fn(&SpatialRegion<'_>, &Value) -> SpatialLoaded,
}

/// The registry of sensor models in space.
pub static SPATIAL_MODELS: &[SpatialModelRow] = &[
    SpatialModelRow {
        kind: polynomial::KIND,
        about: "trivariate polynomial of any total degree in the contact's coordinates (Lin et al. 2024, degree 5)",
        defaults: polynomial::defaults,
        candidates: polynomial::candidates,
        fit: polynomial::fit,
        load: polynomial::load,
    },
    SpatialModelRow {
        kind: rod::KIND,
        about: "Kirchhoff rod whose stiffnesses, pre-curvature, gains, offsets and mounting are fitted",
        defaults: rod::defaults,
        candidates: rod::candidates,
        fit: rod::fit,
        load: rod::load,
    },
    SpatialModelRow {
        kind: spline::KIND,
        about: "penalised tensor-product spline in the contact's coordinates about the whisker",
        defaults: spline::defaults,
        candidates: spline::candidates,
        fit: spline::fit,
        load: spline::load,
    },
    SpatialModelRow {
        kind: gaussian_process::KIND,
        about: "Gaussian process with an error for each line, due to friction and hysteresis of real sensors",
        defaults: gaussian_process::defaults,
        candidates: gaussian_process::candidates,
        fit: gaussian_process::fit,
        load: gaussian_process::load,
    },
];

/// The registry's row of this name.
///
/// # Errors
/// [`ModelError::Unknown`] lists the known names.
pub fn spatial_model(kind: &str) -> Result<&'static SpatialModelRow, ModelError> {
    SPATIAL_MODELS.iter().find(|row| row.kind == kind).ok_or_else(|| ModelError::Unknown {
        found: kind.into(),
        known: SPATIAL_MODELS.iter().map(|row| row.kind).collect::<Vec<_>>().join(", "),
    })
}

/// A sensor model in space and the region for which it was calibrated.
#[derive(Clone, Debug)]
pub struct CalibratedSpace {
    /// The whisker.
    pub whisker: SpatialWhisker,
    /// Axis of the coordinates about the whisker.
    pub axis: Axis,
    /// The calibrated domain.
    pub domain: SpatialDomain,
    /// Name of the formula within the calibration.
    pub label: String,
    /// The formula.
    pub model: Arc<dyn SpatialModel>,
    /// Error of the formula over the region, in addition to [`SpatialModel::sd_n_m`].
    pub error: SpatialErrorMap,
    /// Root mean square residual of a moment on held-out lines.
    pub heldout_rms_n_m: f64,
    /// Largest residual of a moment on held-out lines.
    pub heldout_worst_n_m: f64,
    /// Largest bending moment of the calibration.
    pub largest_reading_n_m: f64,
    /// Whether the sensor is a real one: friction may hold contacts in place, and the mounting may deviate from that of the
    /// calibration. Simulated traces in space have neither friction nor such deviations.
    pub real_sensor: bool,
    /// Deviation of the present mounting from that of the calibration. `None` if it has not been learnt.
    pub mounting: Option<Mounting>,
    /// Directions at the contacts, computed on first use.
    pub geometry: OnceGeometry,
}

/// Geometry of the contacts with a whisker, tabulated on first use and shared by all estimators.
#[derive(Clone, Debug, Default)]
pub struct OnceGeometry(Arc<OnceLock<Option<Geometry>>>);

impl CalibratedSpace {
    /// The whisker as a sensor reads it whose offset, constant within a recording, has this standard deviation in every direction:
    /// the offset adds to the error of the model.
    pub fn read_by(&self, offset_sd_n_m: f64) -> Self {
        Self { error: self.error.with_offset(offset_sd_n_m), ..self.clone() }
    }

    /// Pose of Base in the Base of the calibration, in which axis, domain, formula and geometry are given.
    pub fn pose(&self) -> Pose<Base, Base> {
        self.mounting.map_or_else(Pose::identity, |mounting| mounting.pose())
    }

    /// Contact in the Base of the calibration, given the contact in the present Base.
    fn as_calibrated(&self, contact: Point<Base>) -> Point<Base> {
        self.mounting.map_or(contact, |mounting| mounting.pose().apply(contact))
    }

    /// Coordinates of a contact about the undeflected whisker.
    pub fn around(&self, contact: Point<Base>) -> Around {
        Around::of(&self.axis, self.as_calibrated(contact))
    }

    /// Point of the object's surface at a contact on the centre line, given the unit normal of the surface out of the object.
    pub fn surface(&self, contact: Point<Base>, normal: Vector3<f64>) -> Point<Base> {
        let arc_m = self.around(contact).along_m.clamp(0.0, self.whisker.whisker.length_m);
        contact.shifted(normal * (-0.5 * self.whisker.whisker.diameter_m(arc_m)))
    }

    /// Expected readings and their derivatives. `None` outside the calibrated domain.
    pub fn predict(&self, contact: Point<Base>) -> Option<SpatialPrediction> {
        self.domain.contains(self.around(contact)).then(|| self.extrapolate(contact))
    }

    /// The same, also outside the calibrated domain.
    pub fn extrapolate(&self, contact: Point<Base>) -> SpatialPrediction {
        let mut found = self.model.predict(self.as_calibrated(contact));
        if let Some(mounting) = &self.mounting {
            found.gradient_n *= mounting.pose().rotation();
        }
        found
    }

    /// Covariance of the true readings about the expected ones (N2 m2), 2x2, without the measurement noise of other recordings. It
    /// includes the noise of the calibration as far as the model predicts it ([`SpatialModel::sd_n_m`]). Outside the calibrated
    /// domain, that at its border.
    pub fn model_covariance_n2_m2(&self, at: Around) -> Matrix2<f64> {
        let (held, shares) = self.domain.held(at);
        self.held_covariance_n2_m2(held, shares)
    }

    /// The same for a contact within the calibrated domain, given its position in it.
    pub(crate) fn held_covariance_n2_m2(&self, held: Around, shares: Shares) -> Matrix2<f64> {
        let sd_n_m = self.model.sd_n_m(held);
        self.error.covariance_at(held, shares) + Matrix2::from_diagonal(&sd_n_m.component_mul(&sd_n_m))
    }

    /// Unit normal of the touched surface in Base, by the mechanics of the whisker. Without them, the direction in which the
    /// contact is displaced; upwards where it is not.
    pub fn normal(&self, at: Around) -> Vector3<f64> {
        let normal = self.calibrated_normal(at);
        self.mounting.map_or(normal, |mounting| mounting.pose().inverse().turn_vector(normal))
    }

    fn calibrated_normal(&self, at: Around) -> Vector3<f64> {
        if let Some(geometry) = self.geometry() {
            return geometry.at(self.domain.clamp(at)).normal;
        }
        let foot = Around::new(at.along_m, 0.0, 0.0).contact(&self.axis);
        let displaced_m = at.contact(&self.axis).vector() - foot.vector();
        displaced_m.try_normalize(0.0).unwrap_or_else(Vector3::z)
    }

    /// Directions of surface normal and wire at the contacts. `None` if the nominal whisker has no equilibrium even near its
    /// undeflected shape.
    pub fn geometry(&self) -> Option<&Geometry> {
        self.geometry.0.get_or_init(|| Geometry::new(&self.whisker, &self.domain)).as_ref()
    }
}
