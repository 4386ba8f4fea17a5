//! Kinds of streams, in the plane and in space, with their types of readings, poses and estimates.

use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use testbed::replay::Steps;
use testbed::space::replay::SpatialSteps;
use trace::{Instant, SpatialPose, wrapped_rad};
use whisker::ReadingGate;
use whisker::estimators::{self, OutlinePoint};
use whisker::frames::{Base, Point, Pose, World};
use whisker::space;

/// An estimator of one whisker with its readings and poses.
pub trait Kind: Send {
    /// Reading at one instant (N m).
    type Reading: Copy + Debug + PartialEq + Send;
    /// Pose of the base.
    type Base: Copy + Debug + PartialEq + Send;
    /// Estimate of the contact.
    type Estimate: Copy + Debug + PartialEq + Send;

    /// Whether all values of a reading are finite.
    fn is_finite(reading_n_m: &Self::Reading) -> bool;

    /// Whether the estimator uses a reading, which is at most the largest plausible one.
    fn admits(&self, reading_n_m: &Self::Reading) -> bool;

    /// Takes the next instant, and appends the estimates that are final.
    fn push(
        &mut self,
        t_s: f64,
        base: &Self::Base,
        reading_n_m: Self::Reading,
        estimates: &mut Vec<Option<Self::Estimate>>,
    );

    /// Appends the estimates that are still held, at the end of the stream.
    fn end(&mut self, estimates: &mut Vec<Option<Self::Estimate>>);

    /// Takes over the rest reading of `earlier`, the estimator before the restart.
    fn keep_rest_reading(&mut self, earlier: &Self);

    /// Whether estimates of the present contact are held, because they may be revised.
    fn is_following(&self) -> bool;

    /// Whether the whisker touched at the last instant.
    fn touches(&self) -> bool;

    /// Bending moments of a reading about y and z of Base (N m), 2x1.
    fn moments_n_m(reading_n_m: &Self::Reading) -> Vector2<f64>;

    /// Point of the x axis of Base at this distance from its origin, in World (m).
    fn point_m(base: &Self::Base, along_m: f64) -> Vector3<f64>;

    /// Way between two poses of the base.
    fn way(from: &Self::Base, to: &Self::Base) -> Way;
}

/// Way between two poses of a base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Distance of the origins.
    pub distance_m: f64,
    /// Smallest angle of a rotation from one to the other.
    pub angle_rad: f64,
}

/// Estimator in the plane, whose reading is the bending moment at the root (N m).
pub struct Planar {
    gate: ReadingGate,
    /// Whether the estimates of a contact are revised at its end.
    looks_back: bool,
    estimator: estimators::Estimator,
    steps: Steps,
}

impl Planar {
    pub(crate) fn new(estimator: estimators::Estimator, gate: ReadingGate, looks_back: bool) -> Self {
        Self { gate, looks_back, estimator, steps: Steps::default() }
    }

    /// Outline of the object that is touched, or was touched last.
    pub(crate) fn outline(&self) -> Option<Vec<OutlinePoint>> {
        self.estimator.outline().map(|outline| outline.points)
    }
}

impl Kind for Planar {
    type Reading = f64;
    type Base = Pose<Base, World>;
    type Estimate = estimators::Estimate;

    fn is_finite(reading_n_m: &f64) -> bool {
        reading_n_m.is_finite()
    }

    fn admits(&self, reading_n_m: &f64) -> bool {
        self.gate.admits(*reading_n_m)
    }

    fn push(
        &mut self,
        t_s: f64,
        base: &Pose<Base, World>,
        reading_n_m: f64,
        estimates: &mut Vec<Option<estimators::Estimate>>,
    ) {
        let now = Instant { t_s, base: *base, twist: None, moment_z_n_m: reading_n_m, rotation_z_rad: None };
        self.estimator.push(&self.steps.sample(&now, reading_n_m), estimates);
    }

    fn end(&mut self, estimates: &mut Vec<Option<estimators::Estimate>>) {
        self.estimator.end(estimates);
    }

    fn keep_rest_reading(&mut self, earlier: &Self) {
        self.estimator.keep_rest_reading(&earlier.estimator);
    }

    fn is_following(&self) -> bool {
        self.looks_back && self.estimator.is_following()
    }

    fn touches(&self) -> bool {
        self.estimator.signals().touched.is_some()
    }

    fn moments_n_m(reading_n_m: &f64) -> Vector2<f64> {
        Vector2::new(0.0, *reading_n_m)
    }

    fn point_m(base: &Pose<Base, World>, along_m: f64) -> Vector3<f64> {
        base.apply(Point::new(along_m, 0.0)).vector().push(0.0)
    }

    fn way(from: &Pose<Base, World>, to: &Pose<Base, World>) -> Way {
        let angle_rad = wrapped_rad(to.yaw_rad() - from.yaw_rad()).abs();
        Way { distance_m: from.origin().distance(&to.origin()), angle_rad }
    }
}

/// Estimator in space, whose readings are the bending moments at the root about y and z of Base (N m), 2x1.
pub struct Spatial {
    gate: ReadingGate,
    estimator: space::estimators::Estimator,
    steps: SpatialSteps,
}

impl Spatial {
    pub(crate) fn new(estimator: space::estimators::Estimator, knowledge: &Arc<space::estimators::Knowledge>) -> Self {
        let gate = ReadingGate::new(knowledge.calibrated.largest_reading_n_m);
        Self { gate, estimator, steps: SpatialSteps::default() }
    }
}

impl Kind for Spatial {
    type Reading = Vector2<f64>;
    type Base = SpatialPose;
    type Estimate = space::estimators::Estimate;

    fn is_finite(reading_n_m: &Vector2<f64>) -> bool {
        reading_n_m.iter().all(|moment_n_m| moment_n_m.is_finite())
    }

    fn admits(&self, reading_n_m: &Vector2<f64>) -> bool {
        self.gate.admits_both(reading_n_m)
    }

    fn push(
        &mut self,
        t_s: f64,
        base: &SpatialPose,
        reading_n_m: Vector2<f64>,
        estimates: &mut Vec<Option<space::estimators::Estimate>>,
    ) {
        self.estimator.push(&self.steps.sample(t_s, base, reading_n_m), estimates);
    }

    fn end(&mut self, estimates: &mut Vec<Option<space::estimators::Estimate>>) {
        self.estimator.end(estimates);
    }

    fn keep_rest_reading(&mut self, earlier: &Self) {
        self.estimator.keep_rest_reading(&earlier.estimator);
    }

    fn is_following(&self) -> bool {
        self.estimator.is_following()
    }

    fn touches(&self) -> bool {
        self.estimator.touches()
    }

    fn moments_n_m(reading_n_m: &Vector2<f64>) -> Vector2<f64> {
        *reading_n_m
    }

    fn point_m(base: &SpatialPose, along_m: f64) -> Vector3<f64> {
        base.position + base.rotation * (Vector3::x() * along_m)
    }

    fn way(from: &SpatialPose, to: &SpatialPose) -> Way {
        let distance_m = (to.position - from.position).norm();
        Way { distance_m, angle_rad: from.rotation.angle_to(&to.rotation) }
    }
}
