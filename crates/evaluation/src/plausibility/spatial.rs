//! Plausibility of a trace in space.

use nalgebra::{UnitQuaternion, Vector3};
use trace::{SpatialInstant, SpatialTrace};

use super::motion::{LEAST_RATE_RAD_S, LEAST_SPEED_M_S, TOLERANCE};
use super::{Finding, median};

/// Relative tolerance of the time step.
const RATE: f64 = 0.02;

/// Largest deviation of the moment from stiffness times rotation, relative to the largest moment.
const ROTATION: f64 = 0.01;

/// Largest median deviation of the moment from that of the true contact force about the root, relative to it. Inertia
/// and damping cause 0.02 at the usual speeds.
const EQUILIBRIUM: f64 = 0.1;

/// A row of the registry of tests.
pub struct SpatialTest {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    find: fn(&SpatialTrace) -> Option<Finding>,
}

#[rustfmt::skip]
/// The registry of tests of traces in space.
pub const SPATIAL_TESTS: &[SpatialTest] = &[
    SpatialTest { name: "rate", about: "rate_hz against the times", find: rate },
    SpatialTest { name: "velocity", about: "velocity against finite differences of the positions", find: velocity },
    SpatialTest { name: "angular velocity", about: "angular velocity against finite differences of the quaternions", find: angular },
    SpatialTest { name: "rotation", about: "moment against the rotation of the root and its springs", find: rotation },
    SpatialTest { name: "equilibrium", about: "moment against that of the true contact force about the root", find: equilibrium },
];

/// Findings of all tests of a trace in space.
pub fn spatial_findings(trace: &SpatialTrace) -> Vec<Finding> {
    SPATIAL_TESTS.iter().filter_map(|test| (test.find)(trace)).collect()
}

fn rate(trace: &SpatialTrace) -> Option<Finding> {
    let instants = &trace.recording.instants;
    let mut steps_s: Vec<f64> = instants.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let step_s = median(&mut steps_s)?;
    let rate_hz = trace.sidecar.rate_hz;
    // Times are written in microseconds.
    ((step_s * rate_hz - 1.0).abs() > RATE + 1e-6 * rate_hz).then(|| Finding {
        place: "rate_hz",
        found: format!("{rate_hz} with times that step {step_s:.6} s"),
        expected: format!("steps of {:.6} s", 1.0 / rate_hz),
        looks_like: "rate_hz or the unit of the times is wrong".into(),
    })
}

fn velocity(trace: &SpatialTrace) -> Option<Finding> {
    compared(trace, LEAST_SPEED_M_S, |from, to, dt_s| {
        let middle = from.base.rotation.slerp(&to.base.rotation, 0.5);
        let stated = 0.5 * (from.twist?.linear + to.twist?.linear);
        Some((stated, middle.inverse() * (to.base.position - from.base.position) / dt_s))
    })
    .map(|deviation| Finding {
        place: "base_vx_m_s, base_vy_m_s, base_vz_m_s",
        found: format!("a deviation of {:.0} % from the positions", 100.0 * deviation),
        expected: format!("at most {:.0} %", 100.0 * TOLERANCE),
        looks_like: "the velocity is in another unit, or not in the frame Base".into(),
    })
}

fn angular(trace: &SpatialTrace) -> Option<Finding> {
    compared(trace, LEAST_RATE_RAD_S, |from, to, dt_s| {
        let stated = 0.5 * (from.twist?.angular + to.twist?.angular);
        let turned: UnitQuaternion<f64> = from.base.rotation.rotation_to(&to.base.rotation);
        Some((stated, from.base.rotation.inverse() * turned.scaled_axis() / dt_s))
    })
    .map(|deviation| Finding {
        place: "base_wx_rad_s, base_wy_rad_s, base_wz_rad_s",
        found: format!("a deviation of {:.0} % from the quaternions", 100.0 * deviation),
        expected: format!("at most {:.0} %", 100.0 * TOLERANCE),
        looks_like: "the angular velocity is in another unit or frame, or the quaternions are inverted or not in the order w, x, y, z"
            .into(),
    })
}

/// RMS deviation of stated vectors from computed ones between consecutive rows, relative to the computed ones, if it is
/// too large. `None` also if no rows state them, or the computed ones are small.
fn compared(
    trace: &SpatialTrace,
    least: f64,
    vectors: impl Fn(&SpatialInstant, &SpatialInstant, f64) -> Option<(Vector3<f64>, Vector3<f64>)>,
) -> Option<f64> {
    let (mut apart, mut size, mut count) = (0.0, 0.0, 0.0);
    for pair in trace.recording.instants.windows(2) {
        let Some((stated, computed)) = vectors(&pair[0], &pair[1], pair[1].t_s - pair[0].t_s) else { continue };
        apart += (stated - computed).norm_squared();
        size += computed.norm_squared().max(stated.norm_squared());
        count += 1.0;
    }
    let is_moving = size > count * least * least;
    (is_moving && apart > TOLERANCE * TOLERANCE * size).then(|| (apart / size).sqrt())
}

/// Compares the components of the moment along the axes of the springs, which the earlier angles of the series have
/// turned, with stiffness times angle.
fn rotation(trace: &SpatialTrace) -> Option<Finding> {
    let stiffness = trace.sidecar.suspension;
    let largest_n_m = largest(trace);
    let mut worst = 0.0_f64;
    for instant in &trace.recording.instants {
        let (Some(angles), Some(torsion)) = (instant.rotation, instant.moment_x_n_m) else { continue };
        let moment = Vector3::new(torsion, instant.moment_y_n_m, instant.moment_z_n_m);
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angles.x);
        let pitch = yaw * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angles.y);
        let apart = Vector3::new(
            moment.z - stiffness.yaw_n_m_rad * angles.x,
            moment.dot(&(yaw * Vector3::y())) - stiffness.pitch_n_m_rad * angles.y,
            moment.dot(&(pitch * Vector3::x())) - stiffness.twist_n_m_rad * angles.z,
        );
        worst = worst.max(apart.norm());
    }
    (worst > ROTATION * largest_n_m).then(|| Finding {
        place: "moment_x_n_m, moment_y_n_m, moment_z_n_m",
        found: format!("{worst:.3e} N m away from stiffness times rotation"),
        expected: format!("at most {:.0} % of the largest moment, {largest_n_m:.3e} N m", 100.0 * ROTATION),
        looks_like: "moments or rotations are in another unit or order, or the suspension is another one".into(),
    })
}

fn equilibrium(trace: &SpatialTrace) -> Option<Finding> {
    let largest_n_m = largest(trace);
    let mut deviations: Vec<f64> = trace
        .recording
        .instants
        .iter()
        .zip(&trace.truth.instants)
        .filter_map(|(known, truth)| {
            let contact = truth.contact.filter(|contact| !contact.split)?;
            let about_root = (contact.contact - known.base.position).cross(&contact.force);
            let expected = known.base.rotation.inverse() * about_root;
            let torsion = known.moment_x_n_m.unwrap_or(expected.x);
            let moment = Vector3::new(torsion, known.moment_y_n_m, known.moment_z_n_m);
            (moment.norm() > 0.1 * largest_n_m).then(|| (moment - expected).norm() / expected.norm().max(moment.norm()))
        })
        .collect();
    let deviation = median(&mut deviations)?;
    (deviation > EQUILIBRIUM).then(|| Finding {
        place: "truth_force_x_n, truth_force_y_n, truth_force_z_n",
        found: format!("a moment about the root that deviates by {:.0} % (median)", 100.0 * deviation),
        expected: format!("at most {:.0} % from the reading", 100.0 * EQUILIBRIUM),
        looks_like: "force, lever or moment is in another unit or frame, or has the other sign".into(),
    })
}

/// Largest moment of a trace.
fn largest(trace: &SpatialTrace) -> f64 {
    let size = |instant: &SpatialInstant| {
        Vector3::new(instant.moment_x_n_m.unwrap_or(0.0), instant.moment_y_n_m, instant.moment_z_n_m).norm()
    };
    trace.recording.instants.iter().map(size).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Findings of the golden trace with a change of every row.
    fn found(mut change: impl FnMut(&mut SpatialInstant)) -> Vec<&'static str> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space.csv");
        let mut trace = SpatialTrace::read(&path).unwrap();
        trace.recording.instants.iter_mut().for_each(&mut change);
        spatial_findings(&trace).into_iter().map(|finding| finding.place).collect()
    }

    #[test]
    fn verif_the_golden_trace_is_plausible() {
        assert_eq!(found(|_| ()), Vec::<&str>::new());
    }

    #[test]
    fn robust_every_error_is_found() {
        let places = |change: fn(&mut SpatialInstant)| found(change).join(" ");
        assert!(places(|instant| instant.t_s *= 1e3).contains("rate_hz"));
        assert!(places(|instant| instant.base.position *= 1e3).contains("base_vx"));
        assert!(places(|instant| instant.moment_y_n_m *= 1e3).contains("moment_x"));
        assert!(places(|instant| instant.moment_z_n_m = -instant.moment_z_n_m).contains("truth_force"));
        let turned = |instant: &mut SpatialInstant| {
            instant.base.rotation =
                UnitQuaternion::from_euler_angles(0.0, 0.0, 0.5 * instant.t_s) * instant.base.rotation;
        };
        assert!(found(turned).join(" ").contains("base_wx"));
    }
}
