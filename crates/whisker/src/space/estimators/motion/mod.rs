//! Models of the contact's motion in space while the base moves: one file and one variant of [`MotionSettings`] per model.
//!
//! The state begins with the contact's coordinates `(s, u, v)`; a model may append properties of the object.

mod cone;
mod fitted;
mod line;
mod patch;
mod resting;
mod rolling;
mod sphere;
mod spine;
mod stuck;
mod swing;

use filters::{Gaussian, Process};
use nalgebra::{Matrix3, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::fit::{self, Fitter};
use super::follower::Tracker;
use super::side::Side;
use super::{Direction, Estimate, Knowledge, Radius, Sample};
use crate::settings::{SettingsError, within};
use cone::Cone;
use line::Line;
use rolling::Axes;
pub(super) use rolling::Place;

use patch::Patch;
use sphere::Sphere;
use stuck::Stuck;

pub(super) use fitted::Fitted;
pub(super) use resting::Resting;
pub(super) use rolling::{Object, Shape, TILT, TILT_S, moved};
pub(super) use swing::{Swing, SwingTilt};

/// A model of the contact's motion with a state of `N` entries.
pub(super) trait Motion<const N: usize>: Copy + Send + Sync + 'static {
    /// Process of one step.
    type Step<'a>: Process<N>;

    /// The initial beliefs from one about the contact's coordinates, each narrow enough for a filter that linearises.
    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<N>>;

    /// The process of the step to a sample, with the second moment of the base's recent acceleration (m2/s4).
    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Self::Step<'a>;

    /// Replaces a state by an equal one whose entries can be averaged with those of another, for example an angle of a direction
    /// without sign by the nearest equal one. By default every state is represented once.
    fn align(&self, _x: &mut SVector<f64, N>, _with: &SVector<f64, N>) {}

    /// The same for a belief. By default the covariance remains.
    fn align_belief(&self, belief: &mut Gaussian<N>, with: &SVector<f64, N>) {
        self.align(&mut belief.mean, with);
    }

    /// Adds to the estimate what the model states about the object.
    fn describe(&self, _side: &Side, _belief: &Gaussian<N>, _estimate: &mut Estimate) {}
}

/// Settings of a method that tracks contacts under any model of motion.
pub(super) trait AnyMotion {
    /// Begins to track a contact under a model.
    fn begin_with<Model: Motion<N>, const N: usize>(&self, model: Model, knowledge: &Knowledge) -> Box<dyn Tracker>;
}

/// The registry of motion models, with their settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum MotionSettings {
    /// The contact rests in the world.
    Resting(Resting),
    /// The contact slides along a straight rod or edge at rest.
    Line(Line),
    /// The contact slides over a cone at rest.
    Cone(Cone),
    /// The contact slides over a sphere at rest.
    Sphere(Sphere),
    /// The contact slides over a surface of two principal curvatures at rest.
    Patch(Patch),
}

impl MotionSettings {
    pub(super) fn resting() -> Self {
        Self::Resting(Resting::default())
    }

    pub(super) fn line() -> Self {
        Self::Line(Line::default())
    }

    pub(super) fn cylinder() -> Self {
        Self::Line(Line { radius: RadiusPrior::ANY, ..Line::default() })
    }

    pub(super) fn fitted_cylinder() -> Self {
        Self::Line(Line { radius: RadiusPrior::ANY_FITTED, ..Line::default() })
    }

    pub(super) fn cone() -> Self {
        Self::Cone(Cone::default())
    }

    pub(super) fn patch() -> Self {
        Self::Patch(Patch::default())
    }

    pub(super) fn sphere() -> Self {
        Self::Sphere(Sphere::default())
    }

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        match self {
            Self::Resting(model) => model.validate(),
            Self::Line(model) => model.validate(),
            Self::Cone(model) => model.validate(),
            Self::Sphere(model) => model.validate(),
            Self::Patch(model) => model.validate(),
        }
    }

    /// Begins to track a contact under this model.
    pub(super) fn begin(self, method: &impl AnyMotion, knowledge: &Knowledge) -> Box<dyn Tracker> {
        match self {
            Self::Resting(model) => method.begin_with(model, knowledge),
            Self::Line(model) => method.begin_with(model, knowledge),
            Self::Cone(model) => method.begin_with(model, knowledge),
            Self::Sphere(model) => method.begin_with(model, knowledge),
            Self::Patch(model) => method.begin_with(model, knowledge),
        }
    }

    /// Begins to fit an object to a touch under this model.
    pub(super) fn fit(self, config: &fit::Config, knowledge: &Knowledge) -> Box<dyn Tracker> {
        match self {
            Self::Resting(model) => Box::new(Fitter::<Stuck, 4>::new(config, Stuck(model), knowledge)),
            Self::Line(model) => Box::new(Fitter::<Line, 6>::new(config, model, knowledge)),
            Self::Cone(model) => Box::new(Fitter::<Cone, 7>::new(config, model, knowledge)),
            Self::Sphere(model) => Box::new(Fitter::<Sphere, 5>::new(config, model, knowledge)),
            Self::Patch(model) => Box::new(Fitter::<Patch, 7>::new(config, model, knowledge)),
        }
    }
}

/// Prior of the radius of object and wire together: log-uniform, as a sum of equal Gaussians of the logarithm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RadiusPrior {
    /// Smallest radius.
    pub(super) least_m: f64,
    /// Largest radius.
    pub(super) most_m: f64,
    /// Number of Gaussians.
    pub(super) parts: usize,
}

impl RadiusPrior {
    /// Thin rods and edges.
    pub(super) const THIN: Self = Self { least_m: 0.1e-3, most_m: 1.5e-3, parts: 1 };
    /// From a thin rod to nearly a plane.
    pub(super) const ANY: Self = Self { least_m: 0.3e-3, most_m: 0.2, parts: 4 };
    /// The same for a fit, which does not need narrow hypotheses.
    pub(super) const ANY_FITTED: Self = Self { parts: 1, ..Self::ANY };

    fn validate(&self) -> Result<(), SettingsError> {
        within("radius.least_m", self.least_m, 1e-6..=10.0)?;
        within("radius.most_m", self.most_m, self.least_m..=10.0)?;
        within("radius.parts", self.parts as f64, 1.0..=100.0)
    }

    /// Mean and standard deviation of the logarithm.
    fn logarithm(&self) -> (f64, f64) {
        let range = (self.most_m / self.least_m).ln();
        (self.least_m.ln() + 0.5 * range, range / 12_f64.sqrt())
    }

    /// Mean and standard deviation of the logarithm of each part.
    fn logarithms(&self) -> impl Iterator<Item = (f64, f64)> {
        let (low, range) = (self.least_m.ln(), (self.most_m / self.least_m).ln());
        let stretch = range / self.parts as f64;
        (0..self.parts).map(move |i| (low + (i as f64 + 0.5) * stretch, 0.5 * stretch))
    }
}

/// A belief about the contact's coordinates followed by independent entries, given by mean and standard deviation.
fn extended<const N: usize, const E: usize>(place: &Gaussian<3>, entries: [(f64, f64); E]) -> Gaussian<N> {
    let (mut mean, mut covariance) = (SVector::<f64, N>::zeros(), SMatrix::<f64, N, N>::zeros());
    mean.fixed_rows_mut::<3>(0).copy_from(&place.mean);
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&place.covariance);
    for (i, (value, sd)) in entries.into_iter().enumerate() {
        mean[3 + i] = value;
        covariance[(3 + i, 3 + i)] = sd * sd;
    }
    Gaussian::new(mean, covariance)
}

/// States the tilted normal of a belief, whose entries begin with the contact's coordinates and the tilt, and its covariance.
fn describe_normal<const N: usize>(place: &Place, belief: &Gaussian<N>, estimate: &mut Estimate) {
    let tilt_rad = belief.mean[TILT];
    let Axes { normal, across, .. } = place.axes(tilt_rad);
    let mut slopes = SMatrix::<f64, 3, 4>::zeros();
    slopes.fixed_columns_mut::<3>(0).copy_from(&place.normal_slopes(tilt_rad));
    slopes.set_column(TILT, &across);
    estimate.normal = normal;
    estimate.normal_covariance = slopes * belief.covariance.fixed_view::<4, 4>(0, 0) * slopes.transpose();
}

/// States the direction of the straight line of an object through the contact, whose angle from the wire has this index.
fn describe_direction<const N: usize>(place: &Place, belief: &Gaussian<N>, index: usize, estimate: &mut Estimate) {
    let Axes { tangent, across, .. } = place.axes(belief.mean[TILT]);
    let (sin, cos) = belief.mean[index].sin_cos();
    let sd_rad = belief.covariance[(index, index)].max(0.0).sqrt();
    estimate.direction = Some(Direction { along: tangent * cos + across * sin, sd_rad });
}

/// Relative standard deviation of a radius for errors of the model that no number of readings reduces. Chosen on spheres that are
/// not part of the suite: where a stroke determines a radius well, the fitted one deviates from it by some percent.
const RADIUS_SD: f64 = 0.02;

/// States the radius of an object from the logarithm of that of object and wire together.
fn describe_radius<const N: usize>(side: &Side, belief: &Gaussian<N>, index: usize, estimate: &mut Estimate) {
    let wire_m = 0.5 * side.calibrated.whisker.whisker.diameter_m(belief.mean[0]);
    let together_m = belief.mean[index].exp();
    let sd_m = together_m * belief.covariance[(index, index)].max(0.0).sqrt().hypot(RADIUS_SD);
    estimate.radius = Some(Radius { radius_m: (together_m - wire_m).max(0.0), sd_m });
}

/// Checks the random walk of the contact: without process noise a covariance can lose its last digits.
fn check_wander(wander_m_sqrt_s: f64) -> Result<(), SettingsError> {
    within("wander_m_sqrt_s", wander_m_sqrt_s, 1e-9..=0.1)
}
