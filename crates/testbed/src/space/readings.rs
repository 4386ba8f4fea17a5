//! Readings of a trace in space.

use std::f64::consts::PI;

use nalgebra::{Rotation3, UnitQuaternion, Vector2, Vector3};
use trace::{SpatialPose, SpatialTrace};
use whisker::frames::{Base, World};
use whisker::space::frames::Pose;

/// Bending moments about y and z of Base at each row (N m), without measurement noise.
pub fn readings_n_m(trace: &SpatialTrace) -> Vec<Vector2<f64>> {
    trace.recording.instants.iter().map(|now| Vector2::new(now.moment_y_n_m, now.moment_z_n_m)).collect()
}

/// Largest bending moment of some traces.
pub fn largest_reading_n_m<'a>(traces: impl IntoIterator<Item = &'a SpatialTrace>) -> f64 {
    let readings = traces.into_iter().flat_map(readings_n_m);
    readings.map(|reading_n_m| reading_n_m.norm()).fold(0.0, f64::max)
}

/// Pose of the base in World.
pub fn to_world(pose: &SpatialPose) -> Pose<Base, World> {
    Pose::new(pose.position, Rotation3::from(pose.rotation))
}

/// Shortest rotation that turns the x axis to a unit vector, 3x1. The one to the opposite direction is not unique; that about z is
/// chosen.
pub fn turned_to(direction: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::x(), direction)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI))
}

/// Pose of World in the frame of the base.
pub fn to_base(pose: &SpatialPose) -> Pose<World, Base> {
    to_world(pose).inverse()
}
