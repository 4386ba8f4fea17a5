//! Sensor models: from a contact to the reading it is expected to give.
//!
//! A calibration presses a pin against one [`Face`] of the whisker at known places. A [`SensorModel`] is a formula fitted to
//! these samples; a [`CalibratedFace`] is that formula together with the [`Domain`] that was really calibrated. Outside it the answer is
//! "no prediction": a formula that is good inside can be anything outside.
//!
//! To add a model: one file beside `polynomial.rs`, and one row in [`MODELS`].

mod domain;
mod elastica;
mod error_map;
mod fit;
mod mechanics;
mod polar;
mod polynomial;
mod regression;
mod spline;
mod table;
mod turn;

use std::fmt::Debug;
use std::sync::{Arc, OnceLock};

use nalgebra::{Matrix2, Vector2};
use serde_json::Value;

use crate::frames::{Base, Point};
use crate::{RestShape, Whisker};

pub use crate::face::Face;
pub use domain::Domain;
pub use error_map::ErrorMap;
pub use fit::{Fit, Material, fit};
pub(crate) use turn::Turn;

/// One calibration sample: a known contact and its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Contact on the centre line.
    pub contact: Point<Base>,
    /// Reading.
    pub reading_n_m: f64,
}

/// What a model expects of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Expected reading.
    pub reading_n_m: f64,
    /// Its gradient with respect to the contact in Base, in N m per m.
    pub gradient_n: Vector2<f64>,
}

/// Why a model could not be fitted or loaded.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// No model of this name.
    #[error("unknown sensor model `{found}`, expected one of: {known}")]
    Unknown {
        /// The name.
        found: String,
        /// Names in the registry.
        known: String,
    },
    /// The settings or the stored model do not parse.
    #[error("sensor model `{kind}`: {reason}")]
    Settings {
        /// Name of the model.
        kind: &'static str,
        /// What the parser says.
        reason: serde_json::Error,
    },
    /// The data do not determine the model.
    #[error("{0}")]
    Data(String),
}

/// A formula from contact to reading. It answers everywhere; that it is asked only where it was calibrated is the duty of
/// [`CalibratedFace`].
pub trait SensorModel: Debug + Send + Sync {
    /// Name in the registry.
    fn kind(&self) -> &'static str;

    /// Name that tells it from the others of a calibration: the kind, and what of its settings sets it apart.
    fn label(&self) -> String {
        self.kind().into()
    }

    /// Expected reading of a contact.
    fn reading_n_m(&self, contact: Point<Base>) -> f64;

    /// Writes the expected readings of many contacts, given by their coordinates in Base; one by one unless given.
    fn readings_n_m(&self, x_m: &[f64], y_m: &[f64], readings_n_m: &mut [f64]) {
        for ((reading_n_m, &x_m), &y_m) in readings_n_m.iter_mut().zip(x_m).zip(y_m) {
            *reading_n_m = self.reading_n_m(Point::new(x_m, y_m));
        }
    }

    /// Everything needed to load it again.
    fn to_json(&self) -> Value;

    /// One line for people.
    fn about(&self) -> String;

    /// Expected reading and gradient; by central differences over 2 micrometres unless given.
    fn predict(&self, contact: Point<Base>) -> Prediction {
        const STEP_M: f64 = 1e-6;
        let slope = |step: Vector2<f64>| {
            (self.reading_n_m(contact.shifted(step)) - self.reading_n_m(contact.shifted(-step))) / (2.0 * STEP_M)
        };
        Prediction {
            reading_n_m: self.reading_n_m(contact),
            gradient_n: Vector2::new(slope(Vector2::x() * STEP_M), slope(Vector2::y() * STEP_M)),
        }
    }

    /// Angle in Base of the deflected whisker's tangent at the contact, where the model knows mechanics.
    fn tangent_rad(&self, _contact: Point<Base>) -> Option<f64> {
        None
    }
}

/// The part of the plane beside a whisker that a calibration covers.
#[derive(Clone, Copy, Debug)]
pub struct Region<'a> {
    /// The whisker.
    pub whisker: &'a Whisker,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// What is calibrated there.
    pub domain: &'a Domain,
}

/// A row of the registry of sensor models.
pub struct ModelRow {
    /// Name.
    pub kind: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Settings that a calibration tries where it is to find the best model by itself.
    pub candidates: fn() -> Vec<Value>,
    /// Fits the model to samples of one face.
    pub fit: fn(&Region<'_>, &[Sample], &Value) -> Result<Learnt, ModelError>,
    /// Loads what [`SensorModel::to_json`] wrote.
    pub load: fn(&Region<'_>, &Value) -> Made,
}

/// What a fit yields.
pub struct Learnt {
    /// The model.
    pub model: Box<dyn SensorModel>,
    /// Variance of its reading at a contact that is left by the noise and the number of the samples, in N2 m2. What the formula
    /// itself cannot follow is not in it: held-out data show that.
    pub variance_n2_m2: Box<dyn Fn(Point<Base>) -> f64 + Send>,
}

/// A model that was loaded.
pub type Made = Result<Box<dyn SensorModel>, ModelError>;

/// The registry of sensor models.
pub const MODELS: &[ModelRow] = &[
    ModelRow {
        kind: polynomial::KIND,
        about: "bivariate polynomial of any total degree in the contact's coordinates (Lin et al. 2022, degree 5)",
        defaults: polynomial::defaults,
        candidates: polynomial::candidates,
        fit: polynomial::fit,
        load: polynomial::load,
    },
    ModelRow {
        kind: spline::KIND,
        about: "smooth map without mechanics: penalised tensor-product spline, smoothed by generalised cross-validation",
        defaults: spline::defaults,
        candidates: spline::candidates,
        fit: spline::fit,
        load: spline::load,
    },
    ModelRow {
        kind: elastica::KIND,
        about: "exact quasi-static whisker whose stiffnesses, pre-curvature, gain, offset and mounting are fitted",
        defaults: elastica::defaults,
        candidates: elastica::candidates,
        fit: elastica::fit,
        load: elastica::load,
    },
];

/// The registry's row of this name.
///
/// # Errors
/// [`ModelError::Unknown`] lists the known names.
pub fn model(kind: &str) -> Result<&'static ModelRow, ModelError> {
    MODELS.iter().find(|row| row.kind == kind).ok_or_else(|| ModelError::Unknown {
        found: kind.into(),
        known: MODELS.iter().map(|row| row.kind).collect::<Vec<_>>().join(", "),
    })
}

/// A sensor model of one face and the region for which it was calibrated.
#[derive(Debug)]
pub struct CalibratedFace {
    /// The face.
    pub face: Face,
    /// The undeflected whisker, to which the domain refers.
    pub rest: RestShape,
    /// The calibrated region.
    pub domain: Domain,
    /// Name of the formula among those of the calibration.
    pub label: String,
    /// The formula.
    pub model: Arc<dyn SensorModel>,
    /// The formula's own error over the region.
    pub error: ErrorMap,
    /// Root mean square residual on data that the fit did not see.
    pub heldout_rms_n_m: f64,
    /// The largest such residual, absolute.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading of the calibration.
    pub largest_reading_n_m: f64,
    /// How far the calibration's contacts lay from the middle of its pin: the radius of pin and wire together, and nothing where the
    /// contacts are themselves the pin's middle, as on a rig that knows no better.
    pub pin_radius_m: f64,
    /// How the whisker turns at a contact, once that was asked for.
    pub turn: OnceTurn,
}

/// The turn of a whisker at its contacts, which is fitted when it is first asked for and then the same for all estimators.
#[derive(Clone, Debug, Default)]
pub struct OnceTurn(Arc<OnceLock<Turn>>);

impl CalibratedFace {
    /// How the whisker, which is the calibrated one, turns at a contact.
    pub(crate) fn turn(&self, whisker: &Whisker) -> &Turn {
        self.turn.0.get_or_init(|| Turn::fitted(self, whisker))
    }

    /// Coordinates of a contact along and away from the undeflected whisker: arc length of the nearest point, and distance from it,
    /// positive away from the object.
    pub fn along_and_away(&self, contact: Point<Base>) -> (f64, f64) {
        let foot = self.rest.foot(contact);
        (foot.arc_m, foot.left_m * self.face.away_sign())
    }

    /// The contact with these coordinates.
    pub fn contact_at(&self, arc_m: f64, away_m: f64) -> Point<Base> {
        self.rest.beside(arc_m, away_m * self.face.away_sign())
    }

    /// Derivative of [`Self::contact_at`]: its columns are where the contact goes along and away. They are orthogonal; the
    /// first is shorter than one on the inside of a curved whisker and longer outside.
    pub fn contact_jacobian(&self, arc_m: f64, away_m: f64) -> Matrix2<f64> {
        self.contact_with_jacobian(arc_m, away_m).1
    }

    /// The contact and that derivative.
    pub fn contact_with_jacobian(&self, arc_m: f64, away_m: f64) -> (Point<Base>, Matrix2<f64>) {
        let sign = self.face.away_sign();
        let (contact, tangent) = self.rest.beside_with_tangent(arc_m, away_m * sign);
        let stretch = 1.0 - self.rest.curvature_per_m(arc_m) * away_m * sign;
        (contact, Matrix2::from_columns(&[tangent * stretch, Vector2::new(-tangent.y, tangent.x) * sign]))
    }

    /// Expected reading and gradient, or nothing outside the calibrated region.
    pub fn predict(&self, contact: Point<Base>) -> Option<Prediction> {
        let (arc_m, away_m) = self.along_and_away(contact);
        self.domain.contains(arc_m, away_m).then(|| self.model.predict(contact))
    }

    /// The same face, read by a sensor that is itself off by something that stays through a recording: an offset and a share of the reading, both known by their standard
    /// deviations. That comes back at the same place as the formula's own error does, and is added to it.
    pub fn read_by(&self, offset_sd_n_m: f64, gain_sd: f64) -> Self {
        let (first_m, last_m) = self.domain.arc_range_m();
        let variance_n2_m2 = |along: f64, away: f64| {
            let arc_m = first_m + along * (last_m - first_m);
            let (lower_m, upper_m) = self.domain.away_range_m(arc_m);
            let reading_n_m = self.model.reading_n_m(self.contact_at(arc_m, lower_m + away * (upper_m - lower_m)));
            offset_sd_n_m.powi(2) + (gain_sd * reading_n_m).powi(2)
        };
        Self {
            error: self.error.beside(variance_n2_m2),
            rest: self.rest.clone(),
            domain: self.domain.clone(),
            label: self.label.clone(),
            model: self.model.clone(),
            turn: self.turn.clone(),
            ..*self
        }
    }

    /// Variance by which the true reading scatters around the expected one, measurement noise apart: the model's own error, as
    /// held-out data and the number of samples show it. An estimator adds it to the variance of the measurement noise. It is an error
    /// that comes back at the same place, not one that averages out.
    pub fn model_variance_n2_m2(&self, contact: Point<Base>) -> f64 {
        let (arc_m, away_m) = self.along_and_away(contact);
        self.model_variance_at_n2_m2(arc_m, away_m)
    }

    /// The same of the contact with these coordinates.
    pub fn model_variance_at_n2_m2(&self, arc_m: f64, away_m: f64) -> f64 {
        let (along, away) = self.domain.shares(arc_m, away_m);
        self.error.variance_n2_m2(along, away)
    }

    /// The contact itself where it is calibrated, else a near one at the border of the calibrated region.
    pub fn nearest_calibrated(&self, contact: Point<Base>) -> Point<Base> {
        self.nearest_calibrated_at(contact, self.along_and_away(contact))
    }

    /// The same where its place along and away is known.
    pub(crate) fn nearest_calibrated_at(&self, contact: Point<Base>, (arc_m, away_m): (f64, f64)) -> Point<Base> {
        if self.domain.contains(arc_m, away_m) {
            return contact;
        }
        let (arc_m, away_m) = self.domain.clamp(arc_m, away_m);
        self.contact_at(arc_m, away_m)
    }
}
