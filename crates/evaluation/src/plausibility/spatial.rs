//! Plausibility of a trace in space.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use trace::{Role, SpatialInstant, SpatialTrace, SpatialTruthInstant};

use super::frozen;
use super::moment::{bending, largest_bending, withstood};
use super::motion::{LEAST_RATE_RAD_S, LEAST_SPEED_M_S, TOLERANCE, TOUCHING, Travel, travelled};
use super::time::contradicted_rate_in_space;
use super::{Finding, median};
use crate::glitches;

/// Largest deviation of the moment from stiffness times rotation, relative to the largest moment.
const ROTATION: f64 = 0.01;

/// Largest median deviation of the moment from that of the true contact force about the root, relative to it. Inertia
/// and damping cause 0.02 at the usual speeds.
const EQUILIBRIUM: f64 = 0.1;

/// Largest median distance of the known contacts from the origin of Base, in lengths of the whisker.
const MOST_REACH: f64 = 1.05;

/// Largest deviation of the bending moment from that of the rod through the known contact, RMS relative to the moment. Response,
/// whisker and mounting of real sensors are known to about half of it.
const MECHANICS: f64 = 0.3;

/// Share of the largest moment above which rows are compared with the rod, and their largest number, evenly spread.
const LOADED: f64 = 0.1;
const MOST_ROWS: usize = 60;

/// Number of intervals of the undeflected whisker with whose points the direction of a contact is compared.
const POINTS: usize = 20;

/// A row of the registry of tests.
pub struct SpatialTest {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Whether the test is run only if the others find nothing: it responds to errors of every kind and does not identify the
    /// cause.
    is_last: bool,
    find: fn(&SpatialTrace) -> Option<Finding>,
}

#[rustfmt::skip]
/// The registry of tests of traces in space.
pub const SPATIAL_TESTS: &[SpatialTest] = &[
    SpatialTest { name: "rate", about: "rate_hz against the times", is_last: false, find: contradicted_rate_in_space },
    SpatialTest { name: "velocity", about: "velocity against finite differences of the positions", is_last: false, find: velocity },
    SpatialTest { name: "angular velocity", about: "angular velocity against finite differences of the quaternions", is_last: false, find: angular },
    SpatialTest { name: "travel", about: "speed of the base, jumps of its position and its travel in one touch", is_last: false, find: travel },
    SpatialTest { name: "reach", about: "distance and direction of the known contacts from the root against the whisker", is_last: false, find: reach },
    SpatialTest { name: "frozen", about: "equal readings while the touched whisker moves", is_last: false, find: frozen::readings_in_space },
    SpatialTest { name: "strength", about: "bending moment against the largest deflection that the whisker withstands", is_last: false, find: strength },
    SpatialTest { name: "rotation", about: "moment against the rotation of the root and its springs", is_last: false, find: rotation },
    SpatialTest { name: "equilibrium", about: "moment against that of the true contact force about the root", is_last: false, find: equilibrium },
    SpatialTest { name: "mechanics", about: "bending moment against that of the rod through the known contact", is_last: true, find: mechanics },
];

/// Findings of all tests of a trace in space.
pub fn spatial_findings(trace: &SpatialTrace) -> Vec<Finding> {
    let findings = |is_last: bool| -> Vec<Finding> {
        SPATIAL_TESTS.iter().filter(|test| test.is_last == is_last).filter_map(|test| (test.find)(trace)).collect()
    };
    let found = findings(false);
    if found.is_empty() { findings(true) } else { found }
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

/// Bounds the speed of the base, the steps of its position and its travel during one touch.
fn travel(trace: &SpatialTrace) -> Option<Finding> {
    let threshold_n_m = TOUCHING * largest_bending(trace);
    let travel = |pair: &[SpatialInstant]| {
        let (before, now) = (bending(&pair[0]), bending(&pair[1]));
        let pressing = before.norm().min(now.norm()) > threshold_n_m;
        Travel {
            time_s: pair[1].t_s - pair[0].t_s,
            step_m: (pair[1].base.position - pair[0].base.position).norm(),
            touches: pressing && before.dot(&now) > 0.0,
        }
    };
    let travels: Vec<Travel> = trace.recording.instants.windows(2).map(travel).collect();
    travelled("base_x_m, base_y_m, base_z_m", &travels, trace.sidecar.whisker.length_m, trace.sidecar.rate_hz)
}

/// Compares the known contacts, seen from the root, with the length and the direction of the whisker.
fn reach(trace: &SpatialTrace) -> Option<Finding> {
    let known = trace.recording.instants.iter().zip(&trace.truth.instants).filter_map(|(instant, truth)| {
        let from_root = truth.contact_m()? - instant.base.position;
        Some(instant.base.rotation.inverse() * from_root)
    });
    let contacts: Vec<Vector3<f64>> = known.collect();
    let mut distances: Vec<f64> = contacts.iter().map(Vector3::norm).collect();
    let distance_m = median(&mut distances)?;
    let whisker = &trace.sidecar.whisker;
    if distance_m > MOST_REACH * whisker.length_m {
        return Some(Finding {
            place: "truth_contact_x_m, truth_contact_y_m, truth_contact_z_m",
            found: format!("contacts {:.3} mm from the origin of Base (median)", 1e3 * distance_m),
            expected: format!(
                "at most the whisker's length of {:.3} mm and {:.0} %",
                1e3 * whisker.length_m,
                100.0 * (MOST_REACH - 1.0)
            ),
            looks_like: "the contacts or the poses are in another unit or frame".into(),
        });
    }
    let rest = whisker.rest_shape();
    let point = |i: usize| rest.point(whisker.length_m * i as f64 / POINTS as f64).vector().push(0.0);
    let points: Vec<Vector3<f64>> = (1..=POINTS).map(point).collect();
    let is_behind = |contact: &&Vector3<f64>| points.iter().all(|point| point.dot(contact) < 0.0);
    let behind = contacts.iter().filter(is_behind).count();
    (2 * behind > contacts.len()).then(|| Finding {
        place: "base_qw, base_qx, base_qy, base_qz",
        found: format!("{behind} of {} known contacts behind the root, seen in Base", contacts.len()),
        expected: "contacts at most a right angle away from the undeflected whisker".into(),
        looks_like: "the quaternions are inverted or not in the order w, x, y, z, or the contacts or the poses are in another frame"
            .into(),
    })
}

/// Compares the bending moment with the rotation of the root and the strain of the wire that it causes.
fn strength(trace: &SpatialTrace) -> Option<Finding> {
    let suspension = trace.sidecar.suspension;
    let stiffness_n_m_rad = suspension.yaw_n_m_rad.max(suspension.pitch_n_m_rad);
    withstood("moment_y_n_m, moment_z_n_m", largest_bending(trace), &trace.sidecar.whisker, stiffness_n_m_rad)
}

/// Compares the components of the moment along the axes of the springs, which the earlier angles of the series have
/// turned, with stiffness times angle.
fn rotation(trace: &SpatialTrace) -> Option<Finding> {
    let stiffness = trace.sidecar.suspension;
    let largest_n_m = largest_moment(trace);
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
    let largest_n_m = largest_moment(trace);
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

/// Compares the bending moments with those of the rod through the known contacts. In a trial of a real sensor they also differ if
/// it was mounted anew since its calibration.
fn mechanics(trace: &SpatialTrace) -> Option<Finding> {
    if trace.sidecar.recorded.is_some() && trace.sidecar.role != Role::Calibration {
        return None;
    }
    let rod = trace.sidecar.rod().ok()?;
    let least_n_m = LOADED * largest_bending(trace);
    let is_split = |truth: &SpatialTruthInstant| truth.contact.is_some_and(|contact| contact.split);
    let known: Vec<(Vector2<f64>, Vector3<f64>)> = (trace.recording.instants.iter().zip(&trace.truth.instants))
        .filter(|(instant, truth)| bending(instant).norm() > least_n_m && !is_split(truth))
        .filter_map(|(instant, truth)| {
            let from_root = truth.contact_m()? - instant.base.position;
            Some((bending(instant), instant.base.rotation.inverse() * from_root))
        })
        .collect();
    let stride = known.len().div_ceil(MOST_ROWS).max(1);
    let (mut apart, mut size) = (0.0, 0.0);
    let (mut compared, mut unreached) = (0, 0);
    for (moment_n_m, contact) in known.iter().step_by(stride) {
        compared += 1;
        let Ok(expected) = rod.at_point(*contact) else {
            unreached += 1;
            continue;
        };
        apart += (moment_n_m - expected.deflection.moment_n_m.yz()).norm_squared();
        size += moment_n_m.norm_squared();
    }
    if 2 * unreached > compared {
        return Some(Finding {
            place: "truth_contact_x_m, truth_contact_y_m, truth_contact_z_m",
            found: format!("{unreached} of {compared} known contacts that the whisker does not reach"),
            expected: "contacts within reach of the bent whisker".into(),
            looks_like:
                "the contacts or the poses are in another frame or unit, or the parameters of the whisker are wrong"
                    .into(),
        });
    }
    (apart > MECHANICS * MECHANICS * size).then(|| Finding {
        place: "moment_y_n_m, moment_z_n_m",
        found: format!("moments that differ by {:.0} % (RMS) from those at the known contacts", 100.0 * (apart / size).sqrt()),
        expected: format!("at most {:.0} % from those of the whisker's mechanics", 100.0 * MECHANICS),
        looks_like: "the contacts or the poses are in another frame or unit, the parameters of the whisker are wrong, the whisker is \
                     turned about its axis, or the reading at rest is wrong"
            .into(),
    })
}

/// Largest moment of a trace, with torsion, without single outliers.
fn largest_moment(trace: &SpatialTrace) -> f64 {
    let size = |instant: &SpatialInstant| {
        Vector3::new(instant.moment_x_n_m.unwrap_or(0.0), instant.moment_y_n_m, instant.moment_z_n_m).norm()
    };
    glitches::largest(&trace.recording.instants.iter().map(size).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;
    use std::path::Path;

    use trace::SpatialTruthInstant;

    use super::super::moment::THOUSAND_TIMES_LOOK;
    use super::*;

    fn golden() -> SpatialTrace {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space.csv");
        SpatialTrace::read(&path).unwrap()
    }

    /// Findings of the golden trace with a change of every row, as a recording: without twist, rotation of the root and force.
    fn of_recording(mut change: impl FnMut(&mut SpatialInstant, &mut SpatialTruthInstant)) -> Vec<String> {
        let mut trace = golden();
        for (instant, truth) in trace.recording.instants.iter_mut().zip(&mut trace.truth.instants) {
            *instant = SpatialInstant::measured(
                instant.t_s,
                instant.base,
                [instant.moment_y_n_m, instant.moment_z_n_m].into(),
            );
            truth.place = truth.contact_m();
            truth.contact = None;
            change(instant, truth);
        }
        spatial_findings(&trace).iter().map(ToString::to_string).collect()
    }

    /// Findings of the golden trace with a change of every row.
    fn found(mut change: impl FnMut(&mut SpatialInstant)) -> Vec<&'static str> {
        let mut trace = golden();
        trace.recording.instants.iter_mut().for_each(&mut change);
        spatial_findings(&trace).into_iter().map(|finding| finding.place).collect()
    }

    #[test]
    fn verif_equal_readings_in_space_are_found_while_the_base_moves() {
        let held = golden();
        let largest_n_m = largest_bending(&held);
        let first = held.recording.instants.iter().position(|now| bending(now).norm() > 0.5 * largest_n_m).unwrap();
        let held = held.recording.instants[first];
        let mut row = 0;
        let places = found(|instant| {
            row += 1;
            if (first + 1..first + 250).contains(&row) {
                (instant.moment_y_n_m, instant.moment_z_n_m) = (held.moment_y_n_m, held.moment_z_n_m);
            }
        });
        assert!(places.contains(&"moment_y_n_m, moment_z_n_m"), "{places:?}");
    }

    #[test]
    fn verif_the_golden_trace_is_plausible() {
        assert_eq!(found(|_| ()), Vec::<&str>::new());
    }

    #[test]
    fn verif_a_recording_is_plausible() {
        assert_eq!(of_recording(|_, _| ()), Vec::<String>::new());
    }

    /// The one finding of a recording, which contains these words.
    fn assert_finds(words: &[&str], change: impl FnMut(&mut SpatialInstant, &mut SpatialTruthInstant)) {
        let findings = of_recording(change);
        let [finding] = findings.as_slice() else { panic!("{findings:?}") };
        assert!(words.iter().all(|word| finding.contains(word)), "{finding}");
    }

    #[test]
    fn robust_moments_of_a_recording_in_newton_millimetres() {
        assert_finds(&["moment_y_n_m, moment_z_n_m: found up to", THOUSAND_TIMES_LOOK], |instant, _| {
            instant.moment_y_n_m *= 1e3;
            instant.moment_z_n_m *= 1e3;
        });
    }

    #[test]
    fn robust_contacts_of_a_recording_in_millimetres_or_in_another_frame() {
        let words =
            ["truth_contact_x_m", "from the origin of Base", "expected at most the whisker's length", "another unit"];
        assert_finds(&words, |_, truth| truth.place = truth.place.map(|place| 1e3 * place));
        assert_finds(&words, |_, truth| truth.place = truth.place.map(|place| place + Vector3::new(0.0, 0.0, 0.2)));
    }

    #[test]
    fn robust_positions_of_a_recording_in_millimetres() {
        let findings = of_recording(|instant, truth| {
            // The golden trace moves little.
            instant.base.position *= 1e3;
            truth.place = truth.place.map(|place| 1e3 * place);
        });
        assert!(findings.iter().any(|finding| finding.contains("poses look like millimetres")), "{findings:?}");
        assert!(findings.iter().any(|finding| finding.contains("from the origin of Base")), "{findings:?}");
    }

    #[test]
    fn robust_a_position_of_a_recording_that_jumps() {
        assert_finds(&["base_x_m, base_y_m, base_z_m", "the position jumps"], |instant, truth| {
            let jump = Vector3::new(0.0, 0.0, if instant.t_s > 0.5 { 0.3 } else { 0.0 });
            instant.base.position += jump;
            truth.place = truth.place.map(|place| place + jump);
        });
    }

    #[test]
    fn robust_inverted_quaternions_of_a_recording() {
        // A sensor that is mounted at a right angle: inverted, it points the other way.
        let mounted = UnitQuaternion::from_euler_angles(0.0, 0.0, FRAC_PI_2);
        let turned = |instant: &mut SpatialInstant, truth: &mut SpatialTruthInstant| {
            instant.base.position = mounted * instant.base.position;
            instant.base.rotation = mounted * instant.base.rotation;
            truth.place = truth.place.map(|place| mounted * place);
        };
        assert_eq!(of_recording(turned), Vec::<String>::new());
        assert_finds(&["base_qw, base_qx", "behind the root", "the quaternions are inverted"], |instant, truth| {
            turned(instant, truth);
            instant.base.rotation = instant.base.rotation.inverse();
        });
    }

    #[test]
    fn robust_a_whisker_that_is_turned_about_its_axis() {
        let quarter = UnitQuaternion::from_euler_angles(FRAC_PI_2, 0.0, 0.0);
        let words = ["found moments that differ by", "expected at most 30 %", "turned about its axis"];
        assert_finds(&words, |instant, _| instant.base.rotation *= quarter);
    }

    #[test]
    fn robust_a_moment_slightly_above_the_largest_possible_one_is_in_no_other_unit() {
        let largest_n_m = largest_bending(&golden());
        let stiffness = golden().sidecar.suspension.yaw_n_m_rad;
        let scale = 1.2 * FRAC_PI_2 * stiffness / largest_n_m;
        assert_finds(&["found up to", "the stiffness, the diameter or the length"], |instant, _| {
            instant.moment_y_n_m *= scale;
            instant.moment_z_n_m *= scale;
        });
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
