//! Miscalibration: readings and poses of a trace whose sensor, whisker and mounting deviate from their calibration.
//!
//! The truth of a trace stays that of the actual whisker. The readings are those that this whisker would give if its
//! sensor and its wire deviated from the calibration; the poses are those of the calibrated Base, which a robot
//! computes from the mounting as it is calibrated, late by the latency. Estimates are evaluated in World, with the base
//! at its nominal pose, that of the calibrated Base.
//!
//! | deviation | reading or pose |
//! | --- | --- |
//! | stiffness `s` | `M` times `m((1 + s) E) / m(E)`, where `m(E)` is the moment of the elastica with Young's modulus `E` through the true contact |
//! | gain `g`, offset `o`, drift `d` | `(1 + g) M + (o + d t) R`, with the largest calibrated reading `R` of the face |
//! | mount | pose of the actual Base, preceded by the pose of the calibrated Base in it |
//! | latency `l` | pose at `t - l`, interpolated linearly between the instants; before the first instant that of the first |

use anyhow::Context;
use trace::{Instant, Miscalibration, Recording, Trace, Truth};
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Pose, Twist, World};

/// Whether poses differ from those of the actual Base.
pub fn displaces(miscalibration: &Miscalibration) -> bool {
    let Miscalibration { mount_rad, mount_x_m, mount_y_m, latency_s, .. } = *miscalibration;
    [mount_rad, mount_x_m, mount_y_m, latency_s].iter().any(|deviation| *deviation != 0.0)
}

/// The recording with the poses of the calibrated Base, late by the latency.
pub fn displaced(miscalibration: &Miscalibration, recording: &Recording) -> Recording {
    let Miscalibration { mount_rad, mount_x_m, mount_y_m, latency_s, .. } = *miscalibration;
    let mount = Pose::<Base, Base>::new(mount_x_m, mount_y_m, mount_rad);
    let nominal = |instant: &Instant| {
        let late = at(recording, instant.t_s - latency_s);
        Instant { base: mount.then(&late.base), twist: late.twist.map(|twist| carried(&twist, &mount)), ..*instant }
    };
    Recording { instants: recording.instants.iter().map(nominal).collect() }
}

/// Pose and twist at a time, interpolated linearly; those of the first or last instant beyond the recording.
fn at(recording: &Recording, t_s: f64) -> Instant {
    let instants = &recording.instants;
    let after = instants.partition_point(|instant| instant.t_s < t_s);
    let (Some(next), Some(last)) = (instants.get(after), after.checked_sub(1).map(|before| &instants[before])) else {
        return instants[after.min(instants.len() - 1)];
    };
    let share = (t_s - last.t_s) / (next.t_s - last.t_s);
    let between = |of: fn(&Instant) -> f64| of(last) + share * (of(next) - of(last));
    let base: Pose<Base, World> = Pose::new(
        between(|instant| instant.base.origin().x()),
        between(|instant| instant.base.origin().y()),
        between(|instant| instant.base.yaw_rad()),
    );
    let twist = last.twist.zip(next.twist).map(|(last, next)| Twist {
        vx_m_s: last.vx_m_s + share * (next.vx_m_s - last.vx_m_s),
        vy_m_s: last.vy_m_s + share * (next.vy_m_s - last.vy_m_s),
        wz_rad_s: last.wz_rad_s + share * (next.wz_rad_s - last.wz_rad_s),
    });
    Instant { base, twist, ..*last }
}

/// Twist of a frame fixed to the base at the pose `mount`, written in that frame: `R^T (v + w x p)`.
fn carried(twist: &Twist, mount: &Pose<Base, Base>) -> Twist {
    let at = mount.origin();
    let (vx, vy) = (twist.vx_m_s - twist.wz_rad_s * at.y(), twist.vy_m_s + twist.wz_rad_s * at.x());
    let (sin, cos) = mount.yaw_rad().sin_cos();
    Twist { vx_m_s: cos * vx + sin * vy, vy_m_s: cos * vy - sin * vx, wz_rad_s: twist.wz_rad_s }
}

/// Ratio of the moment with the deviating stiffness to that with the calibrated one at each instant of a trace; 1 while
/// the whisker is free, and that of the last solved instant where the elastica through the contact does not exist, as
/// at the tip. `None` without a deviation of the stiffness.
///
/// # Errors
/// If the whisker is not valid with the deviating stiffness.
pub fn stiffness_ratios(miscalibration: &Miscalibration, trace: &Trace) -> anyhow::Result<Option<Vec<f64>>> {
    if miscalibration.stiffness == 0.0 {
        return Ok(None);
    }
    let calibrated = &trace.sidecar.whisker;
    let youngs_modulus_pa = calibrated.youngs_modulus_pa * (1.0 + miscalibration.stiffness);
    let actual = Whisker { youngs_modulus_pa, ..calibrated.clone() };
    let elastica = |whisker| Elastica::new(whisker).context("miscalibration: stiffness");
    Ok(Some(ratios([&elastica(calibrated)?, &elastica(&actual)?], &trace.recording, &trace.truth)))
}

fn ratios([calibrated, actual]: [&Elastica; 2], recording: &Recording, truth: &Truth) -> Vec<f64> {
    let mut last = 1.0;
    let ratio = |(known, truth): (&Instant, &trace::TruthInstant)| {
        let Some(contact) = truth.contact else { return 1.0 };
        let point = known.base.inverse().apply(contact);
        let moment_n_m = |elastica: &Elastica| elastica.at_point(point).ok().map(|at| at.deflection.moment_n_m);
        if let (Some(calibrated), Some(actual)) = (moment_n_m(calibrated), moment_n_m(actual))
            && calibrated != 0.0
        {
            last = actual / calibrated;
        }
        last
    };
    recording.instants.iter().zip(&truth.instants).map(ratio).collect()
}

/// Applies stiffness, gain, offset and drift to the readings of a trace. `ratios` are those of [`stiffness_ratios`], and
/// `largest_n_m` is the largest calibrated reading of the face.
pub fn disturb(
    miscalibration: &Miscalibration,
    ratios: Option<&[f64]>,
    largest_n_m: f64,
    recording: &Recording,
    readings_n_m: &mut [f64],
) {
    for ((ratio, instant), reading_n_m) in ratios.into_iter().flatten().zip(&recording.instants).zip(&mut *readings_n_m)
    {
        *reading_n_m += (ratio - 1.0) * instant.moment_z_n_m;
    }
    let Miscalibration { gain, offset, drift_per_s, .. } = *miscalibration;
    let start_s = recording.instants.first().map_or(0.0, |first| first.t_s);
    for (instant, reading_n_m) in recording.instants.iter().zip(readings_n_m) {
        *reading_n_m = (1.0 + gain) * *reading_n_m + (offset + drift_per_s * (instant.t_s - start_s)) * largest_n_m;
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use whisker::elastica::Load;
    use whisker::frames::Point;

    use super::*;

    fn golden() -> Trace {
        Trace::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv")).unwrap()
    }

    #[test]
    fn verif_gain_offset_and_drift_act_on_readings() {
        let Trace { recording, .. } = golden();
        let miscalibration =
            Miscalibration { gain: 0.02, offset: -0.01, drift_per_s: 0.004, ..Miscalibration::default() };
        let exact: Vec<f64> = recording.instants.iter().map(|instant| instant.moment_z_n_m).collect();
        let mut readings_n_m = exact.clone();
        disturb(&miscalibration, None, 3e-5, &recording, &mut readings_n_m);
        for ((instant, exact), reading) in recording.instants.iter().zip(&exact).zip(&readings_n_m) {
            let expected = 1.02 * exact + (0.004 * instant.t_s - 0.01) * 3e-5;
            assert!((reading - expected).abs() < 1e-18, "{reading} {expected}");
        }
        assert!(!displaces(&miscalibration));
    }

    /// A point given in the calibrated Base lies at its place in the actual Base, seen from World; the twist of the
    /// displaced Base is the derivative of its pose.
    #[test]
    fn verif_a_wrong_mount_displaces_the_base() {
        let Trace { recording, .. } = golden();
        let miscalibration =
            Miscalibration { mount_rad: 0.02, mount_x_m: 1e-3, mount_y_m: -2e-3, ..Miscalibration::default() };
        let nominal = displaced(&miscalibration, &recording);
        let in_actual = Point::<Base>::new(1e-3 + 0.05 * 0.02_f64.cos(), -2e-3 + 0.05 * 0.02_f64.sin());
        for (actual, nominal) in recording.instants.iter().zip(&nominal.instants) {
            let seen = nominal.base.apply(Point::new(0.05, 0.0));
            assert!(seen.distance(&actual.base.apply(in_actual)) < 1e-15);
            assert_eq!((nominal.t_s, nominal.moment_z_n_m), (actual.t_s, actual.moment_z_n_m));
        }
        for pair in nominal.instants.windows(2) {
            let dt_s = pair[1].t_s - pair[0].t_s;
            let mean = at(&nominal, 0.5 * (pair[0].t_s + pair[1].t_s)).twist.unwrap();
            let moved = pair[0].base.then(&pair[1].base.inverse());
            let predicted = mean.motion(dt_s);
            assert!(moved.origin().distance(&predicted.origin()) < 2e-6 * dt_s / 4e-3);
        }
    }

    #[test]
    fn verif_latency_delays_the_poses() {
        let Trace { recording, .. } = golden();
        let late = |latency_s| displaced(&Miscalibration { latency_s, ..Miscalibration::default() }, &recording);
        let (by_two, by_half) = (late(0.008), late(0.002));
        for row in 2..recording.instants.len() {
            let exact = recording.instants[row - 2].base;
            assert!(by_two.instants[row].base.origin().distance(&exact.origin()) < 1e-12);
            let [before, now] = [row - 1, row].map(|row| recording.instants[row].base.origin().vector());
            assert!((by_half.instants[row].base.origin().vector() - 0.5 * (before + now)).norm() < 1e-12);
        }
        assert_eq!(by_two.instants[0].base, recording.instants[0].base, "before the start the pose is the first");
    }

    /// With a root much stiffer than the wire the reading is proportional to Young's modulus; with a root much softer
    /// than the wire, which then turns as a rigid body, it does not depend on it.
    #[test]
    fn val_stiffness_ratios_match_small_deflections() {
        let trace = golden();
        let miscalibration = Miscalibration { stiffness: 0.05, ..Miscalibration::default() };
        let stiff_ratio = |root_stiffness_n_m_rad| {
            let whisker = Whisker { root_stiffness_n_m_rad, ..trace.sidecar.whisker.clone() };
            let elastica = Elastica::new(&whisker).unwrap();
            let load = Load {
                arc_m: 0.05,
                along_n: 0.0,
                left_n: -1e-4 * root_stiffness_n_m_rad.min(1e-3) / 1e-3,
                couple_n_m: 0.0,
            };
            let contact = elastica.deflect(load).unwrap().point;
            let sidecar = trace::Sidecar { whisker, ..trace.sidecar.clone() };
            let mut one = Trace { sidecar, ..trace.clone() };
            one.truth.instants[0].contact = Some(one.recording.instants[0].base.apply(contact));
            stiffness_ratios(&miscalibration, &one).unwrap().unwrap()[0]
        };
        assert!((stiff_ratio(1.0) - 1.05).abs() < 1e-4, "{}", stiff_ratio(1.0));
        assert!((stiff_ratio(1e-8) - 1.0).abs() < 1e-4, "{}", stiff_ratio(1e-8));
        // The small deflection d of root and cantilever at the arc length a is M (a / k + a^2 / (3 EI)).
        let wire = 0.05 / (3.0 * trace.sidecar.whisker.bending_stiffness_n_m2(0.0));
        let root = 1.0 / 0.17e-3;
        let of_preset = (root + wire) / (root + wire / 1.05);
        assert!((stiff_ratio(0.17e-3) - of_preset).abs() < 1e-4, "{} {of_preset}", stiff_ratio(0.17e-3));
        assert_eq!(stiffness_ratios(&Miscalibration::default(), &trace).unwrap(), None);
        let ratios = stiffness_ratios(&miscalibration, &trace).unwrap().unwrap();
        assert_eq!(ratios[0], 1.0, "the whisker is free at the start");
    }

    #[test]
    fn verif_labels_name_the_deviations() {
        let miscalibration = Miscalibration { gain: 0.01, mount_y_m: -3e-4, ..Miscalibration::default() };
        assert_eq!(miscalibration.label(), "gain_1e-2_mount_y_m_-3e-4");
        assert!(Miscalibration::default().is_none() && Miscalibration::default().label().is_empty());
        let wrong = Miscalibration { latency_s: f64::NAN, ..miscalibration };
        assert_eq!(wrong.out_of_range().map(|(name, _, most)| (name, most)), Some(("latency_s", 1.0)));
    }
}
