//! Sensor models: the expected reading of a contact.
//!
//! A calibration presses a pin against one [`Face`] of the whisker at known positions. A [`SensorModel`] is a formula
//! fitted to these samples; a [`CalibratedFace`] is that formula together with the calibrated domain, its [`Domain`].
//! Outside the domain a regression can be arbitrarily wrong, and is not evaluated. A model of the mechanics
//! ([`SensorModel::extrapolates`]) is evaluated in a wider region, [`CalibratedFace::modelled`].
//!
//! To add a model: one file beside `polynomial.rs`, and one row in [`MODELS`].

mod along_away;
pub(crate) mod domain;
mod elastica;
pub(crate) mod error_map;
mod fit;
mod lean;
mod mechanics;
pub(crate) mod physical;
mod pin_friction;
mod polar;
mod polynomial;
pub(crate) mod regression;
mod scales;
pub(crate) mod spline;
mod table;
mod turn;

use std::fmt::Debug;
use std::sync::{Arc, OnceLock};

use nalgebra::{Matrix2, Vector2};
use serde_json::Value;

use crate::frames::{Base, Point};
use crate::settings::SettingsError;
use crate::{RestShape, Whisker};

pub use crate::face::Face;
pub use along_away::AlongAway;
pub use domain::{Domain, Shares};
pub use error_map::ErrorMap;
pub(crate) use fit::least_error_n2_m2;
pub use fit::{Fit, FitData, fit};
pub(crate) use lean::{Lean, Leaning};
pub use pin_friction::{PinFriction, WithoutFriction, without_friction};
pub(crate) use turn::Turn;

/// One calibration sample: a known contact and its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Contact on the centre line.
    pub contact: Point<Base>,
    /// Reading.
    pub reading_n_m: f64,
}

/// Prediction of a model for a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Expected reading.
    pub reading_n_m: f64,
    /// Its gradient with respect to the contact in Base, in N m per m.
    pub gradient_n: Vector2<f64>,
}

/// Error of fitting or loading a model.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// No model has this name.
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
        /// Error of the parser.
        reason: SettingsError,
    },
    /// The data do not determine the model.
    #[error("{0}")]
    Data(String),
}

/// A formula from contact to reading. It is defined everywhere; [`CalibratedFace`] restricts it to the calibrated
/// region.
pub trait SensorModel: Debug + Send + Sync {
    /// Name in the registry.
    fn kind(&self) -> &'static str;

    /// Unique name within a calibration: the kind, and the settings that distinguish it.
    fn label(&self) -> String {
        self.kind().into()
    }

    /// Expected reading of a contact.
    fn reading_n_m(&self, contact: Point<Base>) -> f64;

    /// The stored model, which the registry's `load` restores.
    fn to_json(&self) -> Value;

    /// One-line description.
    fn about(&self) -> String;

    /// Expected reading and gradient. By default central differences over 2 micrometres.
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

    /// Whether the formula is that of the whisker's mechanics, which holds beyond the calibrated domain too.
    fn extrapolates(&self) -> bool {
        false
    }

    /// Angle in Base (rad) of the deflected whisker's tangent at the contact. `None` for models without mechanics.
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
    /// The calibrated domain.
    pub domain: &'a Domain,
}

/// A row of the registry of sensor models.
pub struct ModelRow {
    /// Name.
    pub kind: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Settings that a calibration compares to select the best model.
    pub candidates: fn() -> Vec<Value>,
    /// Fits the model to samples of one face.
    pub fit: fn(&Region<'_>, &[Sample], &Value) -> Result<FittedModel, ModelError>,
    /// Loads a model stored by [`SensorModel::to_json`].
    pub load: fn(&Region<'_>, &Value) -> Loaded,
}

/// Result of a fit.
pub struct FittedModel {
    /// The model.
    pub model: Box<dyn SensorModel>,
    /// Variance of its reading at a contact due to the noise and the number of samples (N2 m2). The misfit of the
    /// formula is not included: it is estimated on held-out data.
    pub variance_n2_m2: Box<dyn Fn(Point<Base>) -> f64 + Send>,
}

/// Result of loading a model.
pub type Loaded = Result<Box<dyn SensorModel>, ModelError>;

/// The registry of sensor models.
pub static MODELS: &[ModelRow] = &[
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
    /// The undeflected whisker, on which the domain is based.
    pub rest: RestShape,
    /// The calibrated domain.
    pub domain: Domain,
    /// The region in which the formula is evaluated: the calibrated domain, or a wider one if the formula extrapolates.
    /// Beyond it readings are extrapolated linearly.
    pub modelled: Domain,
    /// Name of the formula within the calibration.
    pub label: String,
    /// The formula.
    pub model: Arc<dyn SensorModel>,
    /// Error of the formula over the region.
    pub error: ErrorMap,
    /// Root mean square residual on held-out data.
    pub heldout_rms_n_m: f64,
    /// Largest absolute residual on held-out data.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading of the calibration.
    pub largest_reading_n_m: f64,
    /// Distance of the calibration's contacts from the centre of its pin: the radius of pin and wire together. Zero if
    /// the recorded contacts are the pin's centre.
    pub pin_radius_m: f64,
    /// Rotation of the whisker at its contacts, and the effect of friction on them, computed on first use.
    pub turn: OnceTurn,
}

/// Rotation of a whisker at its contacts, and the effect of friction on them, each fitted on first use and shared by all
/// estimators.
#[derive(Clone, Debug, Default)]
pub struct OnceTurn {
    turn: Arc<OnceLock<Turn>>,
    lean: Arc<OnceLock<Lean>>,
}

/// The region in which a model of a whisker of this length is evaluated; see [`CalibratedFace::modelled`].
pub fn modelled(model: &dyn SensorModel, domain: &Domain, length_m: f64) -> Domain {
    if model.extrapolates() { domain.widened(length_m) } else { domain.clone() }
}

impl CalibratedFace {
    /// Rotation of the calibrated whisker at its contacts.
    pub(crate) fn turn(&self, whisker: &Whisker) -> &Turn {
        self.turn.turn.get_or_init(|| Turn::fitted(self, whisker))
    }

    /// Effect of friction on the contacts of the calibrated whisker.
    pub(crate) fn lean(&self, whisker: &Whisker) -> &Lean {
        self.turn.lean.get_or_init(|| Lean::fitted(self, whisker))
    }

    /// Coordinates of a contact along and away from the undeflected whisker.
    pub fn along_and_away(&self, contact: Point<Base>) -> AlongAway {
        let foot = self.rest.foot(contact);
        AlongAway::new(foot.arc_m, foot.left_m * self.face.away_sign())
    }

    /// The contact with these coordinates.
    pub fn contact_at(&self, at: AlongAway) -> Point<Base> {
        self.rest.beside(at.along_m, at.away_m * self.face.away_sign())
    }

    /// Derivative of [`Self::contact_at`], 2x2; its columns are the derivatives along and away. They are orthogonal;
    /// the first is shorter than one on the inside of a curved whisker and longer outside.
    pub fn contact_jacobian(&self, at: AlongAway) -> Matrix2<f64> {
        self.contact_with_jacobian(at).1
    }

    /// The contact and its derivative.
    pub fn contact_with_jacobian(&self, at: AlongAway) -> (Point<Base>, Matrix2<f64>) {
        let AlongAway { along_m, away_m } = at;
        let sign = self.face.away_sign();
        let (contact, tangent) = self.rest.beside_with_tangent(along_m, away_m * sign);
        let stretch = 1.0 - self.rest.curvature_per_m(along_m) * away_m * sign;
        (contact, Matrix2::from_columns(&[tangent * stretch, Vector2::new(-tangent.y, tangent.x) * sign]))
    }

    /// Expected reading and gradient. `None` outside the calibrated domain.
    pub fn predict(&self, contact: Point<Base>) -> Option<Prediction> {
        self.domain.contains(self.along_and_away(contact)).then(|| self.model.predict(contact))
    }

    /// The same face read by a sensor with an error that is constant over a recording: an offset and a relative gain
    /// error, given by their standard deviations. Like the formula's error it recurs at the same position, and is added
    /// to it.
    pub fn read_by(&self, offset_sd_n_m: f64, gain_sd: f64) -> Self {
        let (first_m, last_m) = self.domain.arc_range_m();
        let variance_n2_m2 = |Shares { along, away }| {
            let along_m = first_m + along * (last_m - first_m);
            let (lower_m, upper_m) = self.domain.away_range_m(along_m);
            let at = AlongAway::new(along_m, lower_m + away * (upper_m - lower_m));
            let reading_n_m = self.model.reading_n_m(self.contact_at(at));
            offset_sd_n_m.powi(2) + (gain_sd * reading_n_m).powi(2)
        };
        Self {
            error: self.error.beside(variance_n2_m2),
            rest: self.rest.clone(),
            domain: self.domain.clone(),
            modelled: self.modelled.clone(),
            label: self.label.clone(),
            model: self.model.clone(),
            turn: self.turn.clone(),
            ..*self
        }
    }

    /// Variance of the true reading about the expected one, without measurement noise: the model's error, from held-out
    /// data and the number of samples. An estimator adds it to the variance of the measurement noise. The error recurs
    /// at the same position and does not average out.
    pub fn model_variance_n2_m2(&self, contact: Point<Base>) -> f64 {
        self.model_variance_at_n2_m2(self.along_and_away(contact))
    }

    /// As [`Self::model_variance_n2_m2`], for a contact with these coordinates.
    pub fn model_variance_at_n2_m2(&self, at: AlongAway) -> f64 {
        self.error.variance_n2_m2(self.domain.shares(at))
    }

    /// The contact itself if it is calibrated, else a near one at the border of the calibrated domain.
    pub fn nearest_calibrated(&self, contact: Point<Base>) -> Point<Base> {
        self.nearest_calibrated_at(contact, self.along_and_away(contact))
    }

    /// As [`Self::nearest_calibrated`], with the known coordinates of the contact.
    pub(crate) fn nearest_calibrated_at(&self, contact: Point<Base>, at: AlongAway) -> Point<Base> {
        if self.domain.contains(at) {
            return contact;
        }
        self.contact_at(self.domain.clamp(at))
    }
}
