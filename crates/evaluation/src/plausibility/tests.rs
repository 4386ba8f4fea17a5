//! Each test of a trace on a golden trace with one error.

use std::f64::consts::PI;
use std::path::Path;

use trace::{Instant, Recorded, Trace, TruthInstant};
use whisker::frames::{Point, Pose, Twist};
use whisker::sensor::Face;

use super::*;

fn golden(name: &str) -> Trace {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    Trace::read(&folder.join(format!("{name}.csv"))).unwrap()
}

/// Golden trace of a pin under a rotating base, with every instant changed.
fn changed(mut change: impl FnMut(&mut Instant)) -> Trace {
    let mut trace = golden("golden_pin");
    trace.recording.instants.iter_mut().for_each(&mut change);
    trace
}

/// The same without twist and truth, as a recording of a robot.
fn recorded(mut change: impl FnMut(&mut Instant)) -> Trace {
    let mut trace = changed(|instant| {
        change(instant);
        (instant.twist, instant.rotation_z_rad) = (None, None);
    });
    trace.truth.instants.iter_mut().for_each(|truth| *truth = TruthInstant::default());
    trace
}

fn looks(trace: &Trace) -> Vec<String> {
    Subject::new(trace, None).findings().into_iter().map(|finding| finding.looks_like).collect()
}

fn in_millimetres(instant: &mut Instant) {
    let origin = instant.base.origin();
    instant.base = Pose::new(1e3 * origin.x(), 1e3 * origin.y(), instant.base.yaw_rad());
}

fn with_yaw(instant: &mut Instant, change: impl Fn(f64) -> f64) {
    let origin = instant.base.origin();
    instant.base = Pose::new(origin.x(), origin.y(), change(instant.base.yaw_rad()));
}

#[test]
fn verif_golden_traces_are_plausible() {
    for name in ["golden_pin", "golden_circle"] {
        assert_eq!(Subject::new(&golden(name), None).findings(), [], "{name}");
    }
    assert_eq!(looks(&recorded(|_| {})), [""; 0]);
}

#[test]
fn verif_noise_of_a_free_whisker_has_no_face() {
    let mut row = 0;
    let mut trace = recorded(|instant| {
        row += 1;
        instant.moment_z_n_m = if row % 3 == 0 { -1e-7 } else { 1e-7 };
    });
    trace.sidecar.recorded = Some(Recorded {
        clock: "recorded".into(),
        characteristic: [1.0, 0.0, 0.0],
        range_n_m: None,
        residual_counts: 0.0,
        rest_counts: 0.0,
        noise_sd_n_m: 1e-7,
        touch_counts: 0.0,
        object_class: None,
    });
    assert_eq!(looks(&trace), [""; 0]);
}

#[test]
fn robust_poses_in_millimetres() {
    assert_eq!(looks(&changed(in_millimetres)), ["poses look like millimetres"]);
    assert_eq!(looks(&recorded(in_millimetres)), ["poses look like millimetres"]);
}

#[test]
fn robust_poses_and_contacts_in_millimetres() {
    let mut trace = recorded(in_millimetres);
    for (truth, known) in trace.truth.instants.iter_mut().zip(golden("golden_pin").truth.instants) {
        truth.contact = known.contact.map(|contact| Point::new(1e3 * contact.x(), 1e3 * contact.y()));
    }
    assert!(looks(&trace).contains(&"poses and true contacts look like millimetres".into()), "{:?}", looks(&trace));
}

#[test]
fn robust_yaw_in_degrees() {
    let degrees = |instant: &mut Instant| with_yaw(instant, |yaw_rad| 180.0 / PI * yaw_rad);
    assert_eq!(looks(&changed(degrees)), ["yaw looks like degrees"]);
    assert_eq!(looks(&recorded(degrees)), ["yaw looks like degrees"]);
    let constant = |instant: &mut Instant| with_yaw(instant, |_| 90.0);
    assert_eq!(looks(&recorded(constant)), ["yaw looks like degrees"]);
}

#[test]
fn robust_yaw_of_the_wrong_sign_or_wrapped() {
    let looks_of = looks(&changed(|instant| with_yaw(instant, |yaw_rad| -yaw_rad)));
    assert!(looks_of[0].contains("the sign of yaw"), "{looks_of:?}");
    let wrapped = |instant: &mut Instant| {
        with_yaw(instant, |yaw_rad| if yaw_rad > 0.01 { yaw_rad - 2.0 * PI } else { yaw_rad });
    };
    let looks_of = looks(&recorded(wrapped));
    assert_eq!(looks_of, ["yaw looks wrapped at a half turn"]);
}

#[test]
fn robust_moment_a_thousand_times_too_large() {
    let large = |instant: &mut Instant| instant.moment_z_n_m *= 1e3;
    assert_eq!(looks(&changed(large)), [moment::THOUSAND_TIMES_LOOK]);
    assert_eq!(looks(&recorded(large)), [moment::THOUSAND_TIMES_LOOK]);
}

#[test]
fn robust_moment_of_the_wrong_unit_against_the_true_contact() {
    for (scale, look) in [(1e-3, "the moment looks 1000 times too small"), (1e3, moment::THOUSAND_TIMES_LOOK)] {
        let trace = changed(|instant| {
            instant.moment_z_n_m *= scale;
            instant.rotation_z_rad = None;
        });
        assert_eq!(looks(&trace), [look]);
    }
}

#[test]
fn robust_moment_that_is_wrong_by_a_constant_factor_is_no_error_of_the_poses() {
    for scale in [-31.0, 31.0] {
        let trace = changed(|instant| {
            instant.moment_z_n_m *= scale;
            instant.rotation_z_rad = None;
        });
        let looks_of = looks(&trace);
        assert!(looks_of.contains(&"unit, scale or sign of the moment is another one".into()), "{looks_of:?}");
        assert!(looks_of.iter().all(|look| !look.contains("yaw")), "{looks_of:?}");
    }
}

#[test]
fn robust_moment_of_the_wrong_sign() {
    let trace = recorded(|instant| instant.moment_z_n_m *= -1.0);
    assert_eq!(looks(&trace), ["the sign of the moment is wrong, or the face is the other one"]);
    let mut other = golden("golden_pin");
    other.sidecar.face = if other.sidecar.face == Face::Left { Face::Right } else { Face::Left };
    assert_eq!(looks(&other), ["the sign of the moment is wrong, or the face is the other one"]);
}

#[test]
fn robust_times_of_another_rate() {
    let fast = |instant: &mut Instant| {
        instant.t_s *= 0.5;
        if let Some(Twist { vx_m_s, vy_m_s, wz_rad_s }) = &mut instant.twist {
            [vx_m_s, vy_m_s, wz_rad_s].into_iter().for_each(|component| *component *= 2.0);
        }
    };
    assert_eq!(looks(&changed(fast)), ["rate_hz 250 but times step 2.0000 ms (500.0000 Hz)"]);
    assert_eq!(looks(&recorded(|instant| instant.t_s *= 1e3)), ["times look like milliseconds"]);
}

#[test]
fn robust_twist_in_world_or_of_another_unit() {
    let quarter = |instant: &mut Instant| {
        let origin = instant.base.origin();
        instant.base = Pose::new(-origin.y(), origin.x(), instant.base.yaw_rad() + 0.5 * PI);
    };
    let turned = changed(|instant| {
        quarter(instant);
        let twist = instant.twist.as_mut().unwrap();
        (twist.vx_m_s, twist.vy_m_s) = (-twist.vy_m_s, twist.vx_m_s);
    });
    assert!(
        looks(&turned).contains(&"the twist looks expressed in World, expected in Base".into()),
        "{:?}",
        looks(&turned)
    );
    let twist = changed(|instant| instant.twist.as_mut().unwrap().wz_rad_s *= 180.0 / PI);
    assert_eq!(looks(&twist), ["base_wz_rad_s looks like degrees per second"]);
}

#[test]
fn robust_jumps_of_position_and_moment() {
    let mut trace = recorded(|_| {});
    for instant in &mut trace.recording.instants[200..] {
        let origin = instant.base.origin();
        instant.base = Pose::new(origin.x() + 0.3, origin.y(), instant.base.yaw_rad());
    }
    assert!(looks(&trace)[0].contains("the position jumps"), "{:?}", looks(&trace));
    let mut trace = golden("golden_pin");
    trace.recording.instants[120].moment_z_n_m = 1.0;
    let findings = Subject::new(&trace, None).findings();
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert!(findings[0].to_string().contains("1e0 N m in line 122"), "{}", findings[0]);
}

#[test]
fn verif_equal_readings_of_a_touched_whisker_that_moves_are_found() {
    let mut trace = recorded(|_| {});
    assert_eq!(looks(&trace), [""; 0]);
    let subject = Subject::new(&trace, None);
    let first = subject.loaded(0.5).next().unwrap();
    let held_n_m = trace.recording.instants[first].moment_z_n_m;
    trace.recording.instants[first..].iter_mut().for_each(|instant| instant.moment_z_n_m = held_n_m);
    let found = looks(&trace);
    assert!(found.iter().any(|look| look.contains("the sensor or its driver stopped")), "{found:?}");
    // Where the whisker rests, readings may be equal, whatever the errors of its poses.
    let resting = trace.recording.instants[first].base;
    for (row, instant) in trace.recording.instants[first..].iter_mut().enumerate() {
        let error_m = if row % 2 == 0 { 0.1e-3 } else { -0.1e-3 };
        instant.base = Pose::new(resting.origin().x() + error_m, resting.origin().y(), resting.yaw_rad());
    }
    let found = Subject::new(&trace, None).findings();
    assert!(found.iter().all(|finding| !finding.found.contains("equal readings")), "{found:?}");
}
