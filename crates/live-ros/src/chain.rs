//! Motion of a whisker's base from transforms or joint angles, in space or projected onto a plane.

use live::{Clock, Deviation, Motion, Place, Sampled};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use trace::SpatialPose;
use whisker::frames::{Base, Pose, World};

use crate::arm::Arm;
use crate::frames::{FrameTransform, Frames};

/// Plane of the planar estimators: through the first used pose of a base, parallel to the x and y axes of the fixed frame turned by
/// `rotation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Orientation of the plane's axes in the fixed frame.
    pub rotation: UnitQuaternion<f64>,
    /// Largest angle between the z axis of the base and the normal of the plane (rad).
    pub tilt_rad: f64,
    /// Largest distance of the base from the plane (m).
    pub height_m: f64,
}

/// Source of the poses.
#[derive(Clone, Debug)]
pub(crate) enum Source {
    /// `/tf` and `/tf_static`.
    Frames(Frames),
    /// Angles of joints.
    Arm(Arm),
}

/// Measurement of the motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured(pub(crate) Part);

/// Content of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Part {
    /// Transform of a frame.
    Transform(FrameTransform),
    /// Name and position of a joint, in rad or m.
    Joint(std::sync::Arc<str>, f64),
}

/// Pose of a base as an estimator takes it.
pub(crate) trait Projection: Send {
    /// Pose of the base.
    type Base;

    /// Place of a base with this pose in the fixed frame.
    fn place(&self, pose: &Isometry3<f64>) -> Place<Self::Base>;

    /// Called for each used reading. `pose` is evaluated only if the projection requires it; by default it is ignored.
    fn used(&mut self, _pose: impl FnOnce() -> Option<Isometry3<f64>>) {}

    /// Restarts after a jump of a clock.
    fn restart(&mut self) {}
}

/// Poses in space, as they are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InSpace;

impl Projection for InSpace {
    type Base = SpatialPose;

    fn place(&self, pose: &Isometry3<f64>) -> Place<SpatialPose> {
        Place::At(SpatialPose { position: pose.translation.vector, rotation: pose.rotation })
    }
}

/// Poses projected onto a plane if they deviate from it by at most the tolerance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OnPlane {
    plane: Plane,
    /// Height of the first used pose of a clock above the origin of the fixed frame, along the normal of the plane.
    height_m: Option<f64>,
    /// Whether this is the height of the present clock, not of the one before a jump.
    is_current: bool,
}

impl OnPlane {
    pub(crate) fn new(plane: Plane) -> Self {
        Self { plane, height_m: None, is_current: false }
    }

    /// Height of the plane above the origin of the fixed frame, along its normal: that of the first used pose. After a jump of a
    /// clock, it is kept until the next used pose. `None` before the first one.
    pub(crate) fn height_m(&self) -> Option<f64> {
        self.height_m
    }

    /// A pose with the axes of the plane.
    fn turned(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let is_fixed = self.plane.rotation == UnitQuaternion::identity();
        if is_fixed { *pose } else { self.plane.rotation.inverse() * pose }
    }
}

impl Projection for OnPlane {
    type Base = Pose<Base, World>;

    fn place(&self, pose: &Isometry3<f64>) -> Place {
        let pose = self.turned(pose);
        let (up, ahead) = (pose.rotation * Vector3::z(), pose.rotation * Vector3::x());
        let height_m = self.height_m.filter(|_| self.is_current);
        let above_m = height_m.map_or(0.0, |height_m| pose.translation.z - height_m);
        let deviation = Deviation { tilt_rad: up.x.hypot(up.y).atan2(up.z), height_m: above_m };
        if deviation.tilt_rad > self.plane.tilt_rad || above_m.abs() > self.plane.height_m {
            return Place::OffPlane(deviation);
        }
        Place::At(Pose::new(pose.translation.x, pose.translation.y, ahead.y.atan2(ahead.x)))
    }

    /// The first used pose determines the height of the plane.
    fn used(&mut self, pose: impl FnOnce() -> Option<Isometry3<f64>>) {
        if !self.is_current
            && let Some(pose) = pose()
        {
            (self.height_m, self.is_current) = (Some(self.turned(&pose).translation.z), true);
        }
    }

    fn restart(&mut self) {
        self.is_current = false;
    }
}

/// Chain of frames or of joints from the fixed frame to the base of a whisker.
#[derive(Clone, Debug)]
pub(crate) struct Chain<P> {
    source: Source,
    projection: P,
}

impl<P> Chain<P> {
    pub(crate) fn new(source: Source, projection: P) -> Self {
        Self { source, projection }
    }

    /// The projection of its poses.
    pub(crate) fn projection(&self) -> &P {
        &self.projection
    }
}

impl Source {
    /// Pose of the base in the fixed frame.
    fn at(&self, t_s: f64, gap_s: f64) -> Sampled<Isometry3<f64>> {
        match self {
            Self::Frames(frames) => frames.at(t_s, gap_s),
            Self::Arm(arm) => arm.at(t_s, gap_s),
        }
    }
}

impl<P: Projection> Motion for Chain<P> {
    type Measured = Measured;
    type Base = P::Base;

    /// Joints that do not belong to the chain are not checked.
    fn is_finite(&self, Measured(part): &Measured) -> bool {
        match part {
            Part::Transform(FrameTransform { pose, .. }) => {
                pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|value| value.is_finite())
            }
            Part::Joint(name, position) => {
                let is_used = matches!(&self.source, Source::Arm(arm) if arm.samples(name).is_some());
                position.is_finite() || !is_used
            }
        }
    }

    fn clock(&mut self, Measured(part): &Measured) -> Option<&mut Clock> {
        match (&mut self.source, part) {
            (Source::Frames(frames), Part::Transform(transform)) => {
                frames.samples(transform).map(|samples| &mut samples.clock)
            }
            (Source::Arm(arm), Part::Joint(name, _)) => arm.samples_mut(name).map(|samples| &mut samples.clock),
            _ => None,
        }
    }

    fn is_before_all(&self, t_s: f64, Measured(part): &Measured) -> bool {
        match (&self.source, part) {
            (Source::Frames(frames), Part::Transform(transform)) => frames.is_before_all(t_s, transform),
            (Source::Arm(arm), Part::Joint(name, _)) => {
                arm.samples(name).is_some_and(|samples| samples.is_before_all(t_s))
            }
            _ => false,
        }
    }

    fn insert(&mut self, t_s: f64, Measured(part): Measured) -> bool {
        match (&mut self.source, part) {
            (Source::Frames(frames), Part::Transform(transform)) => frames.insert(t_s, &transform),
            (Source::Arm(arm), Part::Joint(name, position)) => {
                arm.samples_mut(&name).is_none_or(|samples| samples.insert(t_s, position))
            }
            _ => true,
        }
    }

    fn at(&self, t_s: f64, gap_s: f64) -> Place<P::Base> {
        match self.source.at(t_s, gap_s) {
            Sampled::At(pose) => self.projection.place(&pose),
            Sampled::Pending => Place::Pending,
            Sampled::Unknown(lack) => Place::Unknown(lack),
        }
    }

    fn newest_s(&self) -> Option<f64> {
        match &self.source {
            Source::Frames(frames) => frames.newest_s(),
            Source::Arm(arm) => arm.newest_s(),
        }
    }

    fn settle(&mut self, t_s: f64, is_used: bool) {
        if is_used {
            self.projection.used(|| match self.source.at(t_s, f64::INFINITY) {
                Sampled::At(pose) => Some(pose),
                Sampled::Pending | Sampled::Unknown(_) => None,
            });
        }
        match &mut self.source {
            Source::Frames(frames) => frames.settle(t_s),
            Source::Arm(arm) => arm.settle(t_s),
        }
    }

    fn restart(&mut self) {
        self.projection.restart();
        match &mut self.source {
            Source::Frames(frames) => frames.restart(),
            Source::Arm(arm) => arm.restart(),
        }
    }
}
