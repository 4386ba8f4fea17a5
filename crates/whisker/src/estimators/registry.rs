//! The registry of estimators.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    Knowledge, Method, SettingsError, batch, drifting, euler_bernoulli, extended, gaussian, imm, installed, iterated,
    model_averaging, outline, paper, particle, pushed, rubbing, smoother, unscented,
};
use crate::settings::to_json;

/// Class of an estimation method: the samples that an estimate may depend on, and its part in a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MethodClass {
    /// Gives an estimate at each sample from the samples so far.
    Recursive,
    /// Recursive, configured as in the publication that it comes from.
    Published,
    /// Gives its estimates when a contact has ended, from all its samples.
    Hindsight,
    /// Recursive, the reference that filters are compared with.
    Baseline,
}

/// A row of the registry of estimators.
pub struct EstimatorRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Class of the method.
    pub class: MethodClass,
    /// Label of the sensor model that the method requires. `None` if it uses that selected by the calibration.
    pub sensor_model: Option<&'static str>,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Builds the method from its settings and the prior information.
    pub build: Build,
}

/// Builds a method from its settings and the prior information.
pub type Build = fn(&Value, &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError>;

/// The registry of estimators. Static, as those of sensor models and detectors: users of a constant would each compile the methods
/// again.
pub static ESTIMATORS: &[EstimatorRow] = &[
    EstimatorRow {
        name: "recommended",
        about: "Bayesian average of `ukf` (thin object), `round` and `sliding` (constant radius), `outline` (any \
            convex outline), `rubbing` (friction), `drifting` (moving object) and `installed` (inexact calibration); or \
            `pushed`, once it is evident that the object is pushed along",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<model_averaging::Config>,
        build: model_averaging::build_recursive,
    },
    EstimatorRow {
        name: "sliding",
        about: "`ekf` for round objects of any size, with estimated radius; converges more slowly on a pin",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: || to_json(&gaussian::Config::<extended::Extended>::sliding()),
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "round",
        about: "`ekf` for an object of constant radius, from a thin object to a plane",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: || to_json(&gaussian::Config::<extended::Extended>::round()),
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "installed",
        about: "`round` for a sensor whose gain and mounting may differ from the calibrated ones",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: || to_json(&installed::Config::recursive()),
        build: installed::build_recursive,
    },
    EstimatorRow {
        name: "rubbing",
        about: "`round` for a contact with Coulomb friction, with estimated coefficient",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<rubbing::Config>,
        build: rubbing::build,
    },
    EstimatorRow {
        name: "drifting",
        about: "`round` for an object that moves uniformly, by millimetres per second",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<drifting::Config>,
        build: drifting::build,
    },
    EstimatorRow {
        name: "pushed",
        about: "`round` for an object that stands freely on a table and is pushed along; the contact does not jump",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<pushed::Config>,
        build: pushed::build,
    },
    EstimatorRow {
        name: "ekf",
        about: "extended Kalman filter for the contact with a thin object, from several hypotheses",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<extended::Extended>>,
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "iekf",
        about: "iterated extended Kalman filter (Bell and Cathey 1993)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<iterated::Iterated>>,
        build: gaussian::build::<iterated::Iterated>,
    },
    EstimatorRow {
        name: "ukf",
        about: "unscented Kalman filter (Julier and Uhlmann 2004)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<unscented::Unscented>>,
        build: gaussian::build::<unscented::Unscented>,
    },
    EstimatorRow {
        name: "particle",
        about: "particle filter whose proposal depends on the reading",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<particle::Config>,
        build: particle::build,
    },
    EstimatorRow {
        name: "imm",
        about: "interacting multiple models: static, sliding or lost (Blom and Bar-Shalom 1988)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<imm::Config>,
        build: imm::build,
    },
    EstimatorRow {
        name: "smoother",
        about: "fixed-interval smoother after the iterated filter (Rauch, Tung and Striebel 1965)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<smoother::Config>,
        build: smoother::build,
    },
    EstimatorRow {
        name: "batch",
        about: "most probable trajectory given the whole contact, by Gauss-Newton (Bell 1994)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<batch::Config>,
        build: batch::build,
    },
    EstimatorRow {
        name: "smoother-sliding",
        about: "`smoother` for round objects of any size",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&smoother::Config::sliding()),
        build: smoother::build,
    },
    EstimatorRow {
        name: "batch-sliding",
        about: "`batch` for round objects of any size",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&batch::Config::sliding()),
        build: batch::build,
    },
    EstimatorRow {
        name: "smoother-installed",
        about: "`smoother` for an object of constant radius and a sensor whose gain and mounting may differ from the calibrated ones",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&installed::Config::hindsight()),
        build: installed::build_hindsight,
    },
    EstimatorRow {
        name: "batch-recommended",
        about: "Bayesian average of `batch` (thin objects), `batch-sliding` (round ones) and `outline-batch` (others); its \
            covariance also allows for an inexact calibration (`smoother-installed`)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&model_averaging::Config::hindsight()),
        build: model_averaging::build_hindsight,
    },
    EstimatorRow {
        name: "outline",
        about: "the object's convex outline as the state, kept from one stroke to the next",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<outline::Config>,
        build: outline::build_recursive,
    },
    EstimatorRow {
        name: "outline-batch",
        about: "the object's convex outline given the whole contact, by robust Gauss-Newton",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<outline::Config>,
        build: outline::build_hindsight,
    },
    EstimatorRow {
        name: "euler-bernoulli",
        about: "slip along an analytic cantilever on the compliant root (Solomon and Hartmann 2010)",
        class: MethodClass::Baseline,
        sensor_model: None,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_analytic,
    },
    EstimatorRow {
        name: "euler-bernoulli-calibrated",
        about: "`euler-bernoulli` with moment and slope from the calibrated map (as in Lin et al. 2022)",
        class: MethodClass::Baseline,
        sensor_model: None,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_calibrated,
    },
    EstimatorRow {
        name: "paper-ekf",
        about: "extended Kalman filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::Config<extended::Extended>>,
        build: paper::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "paper-ukf",
        about: "unscented Kalman filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::Config<unscented::Unscented>>,
        build: paper::build::<unscented::Unscented>,
    },
    EstimatorRow {
        name: "paper-particle",
        about: "particle filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::ParticleConfig>,
        build: paper::build_particle,
    },
];

/// The registry's row of this name.
pub fn estimator(name: &str) -> Option<&'static EstimatorRow> {
    ESTIMATORS.iter().find(|row| row.name == name)
}

fn defaults<Config: Default + Serialize>() -> Value {
    to_json(&Config::default())
}
