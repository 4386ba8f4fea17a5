//! Motion of the base: poses and twist.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation2, Vector2};
use trace::Instant;
use whisker::frames::Twist;

use super::{Finding, Subject, quantile};

/// Largest relative deviation of the twist from the finite differences, root mean square, and the deviations below
/// which it is not compared: rounding and vibration.
pub(super) const TOLERANCE: f64 = 0.2;
pub(super) const LEAST_SPEED_M_S: f64 = 1e-3;
pub(super) const LEAST_RATE_RAD_S: f64 = 0.01;

/// Degrees per radian.
const DEGREES: f64 = 180.0 / PI;

const DEGREES_LOOK: &str = "yaw looks like degrees";
const MILLIMETRES_LOOK: &str = "poses look like millimetres";

/// Share of the steps that a bound on speeds may neglect.
const MOST_OF: f64 = 0.95;

/// Largest speed of the base, in lengths of the whisker per second, and largest yaw rate.
const MOST_LENGTHS_PER_S: f64 = 50.0;
const MOST_RATE_RAD_S: f64 = 10.0;

/// Largest travel of the base during one touch, in lengths of the whisker.
const MOST_TRAVEL: f64 = 50.0;

/// Largest step of the position, in lengths of the whisker, if others are much shorter.
const MOST_STEP: f64 = 1.0;
const SHORT_STEP: f64 = 0.05;

/// Longest time between consecutive rows without a missing one, in intervals of the rate.
const MOST_INTERVALS: f64 = 1.5;

/// Share of the largest moment above which the whisker counts as touching.
pub(super) const TOUCHING: f64 = 0.05;

/// Mean velocity in World and yaw rate between two rows with known twist.
struct Step {
    velocity_m_s: Vector2<f64>,
    rate_rad_s: f64,
    /// Yaw halfway.
    yaw_rad: f64,
    /// Mean of the twists.
    twist: Twist,
}

impl Step {
    fn between(pair: &[Instant]) -> Option<Self> {
        let (from, to) = (&pair[0], &pair[1]);
        let (first, second) = (from.twist?, to.twist?);
        let dt_s = to.t_s - from.t_s;
        Some(Self {
            velocity_m_s: (to.base.origin().vector() - from.base.origin().vector()) / dt_s,
            rate_rad_s: (to.base.yaw_rad() - from.base.yaw_rad()) / dt_s,
            yaw_rad: 0.5 * (from.base.yaw_rad() + to.base.yaw_rad()),
            twist: Twist {
                vx_m_s: 0.5 * (first.vx_m_s + second.vx_m_s),
                vy_m_s: 0.5 * (first.vy_m_s + second.vy_m_s),
                wz_rad_s: 0.5 * (first.wz_rad_s + second.wz_rad_s),
            },
        })
    }

    /// Linear part of the twist.
    fn linear_m_s(&self) -> Vector2<f64> {
        Vector2::new(self.twist.vx_m_s, self.twist.vy_m_s)
    }

    /// Velocity by the poses in a frame turned by this share of the yaw: 1 for Base, 0 for World.
    fn turned_m_s(&self, share: f64) -> Vector2<f64> {
        Rotation2::new(-share * self.yaw_rad) * self.velocity_m_s
    }
}

/// Root mean square.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
}

/// Compares the twist with the finite differences of the poses.
pub(super) fn twist(subject: &Subject<'_>) -> Vec<Finding> {
    let steps: Vec<Step> = subject.instants().windows(2).filter_map(Step::between).collect();
    let mut findings = Vec::new();
    findings.extend(angular(&steps));
    findings.extend(linear(&steps));
    findings
}

fn angular(steps: &[Step]) -> Option<Finding> {
    let deviation = |scale: f64| rms(steps.iter().map(|step| scale * step.rate_rad_s - step.twist.wz_rad_s));
    let (by_twist, by_poses) =
        (rms(steps.iter().map(|step| step.twist.wz_rad_s)), rms(steps.iter().map(|step| step.rate_rad_s)));
    if deviation(1.0) <= TOLERANCE * by_twist || by_twist.max(by_poses) < LEAST_RATE_RAD_S {
        return None;
    }
    let hypotheses = [
        (1.0 / DEGREES, DEGREES_LOOK),
        (DEGREES, "base_wz_rad_s looks like degrees per second"),
        (-1.0, "the sign of yaw or of base_wz_rad_s is wrong"),
    ];
    let fits = |scale: f64| deviation(scale) <= TOLERANCE * by_twist;
    let looks_like = hypotheses.iter().find(|(scale, _)| fits(*scale)).map(|(_, look)| *look);
    Some(Finding {
        place: "base_wz_rad_s",
        found: format!("{by_twist:.4} rad/s RMS"),
        expected: format!("{by_poses:.4} rad/s RMS, by the finite differences of base_yaw_rad"),
        looks_like: looks_like.unwrap_or("times, yaw and yaw rate do not belong together").into(),
    })
}

fn linear(steps: &[Step]) -> Option<Finding> {
    let deviation = |scale: f64, share: f64| {
        rms(steps.iter().map(|step| (scale * step.turned_m_s(share) - step.linear_m_s()).norm()))
    };
    let (by_twist, by_poses) = (
        rms(steps.iter().map(|step| step.linear_m_s().norm())),
        rms(steps.iter().map(|step| step.velocity_m_s.norm())),
    );
    if deviation(1.0, 1.0) <= TOLERANCE * by_twist || by_twist.max(by_poses) < LEAST_SPEED_M_S {
        return None;
    }
    let hypotheses = [
        (1e-3, 1.0, MILLIMETRES_LOOK),
        (1e3, 1.0, "the twist looks like millimetres per second"),
        (1.0, 1.0 / DEGREES, DEGREES_LOOK),
        (1.0, 0.0, "the twist looks expressed in World, expected in Base"),
        (1.0, -1.0, "the sign of yaw is wrong"),
        (-1.0, 1.0, "the sign of the positions or of the twist is wrong"),
    ];
    // A small yaw in degrees and a twist in World deviate little from each other.
    let of = |(scale, share, _): &(f64, f64, &str)| deviation(*scale, *share);
    let best = hypotheses.iter().min_by(|a, b| of(a).total_cmp(&of(b))).filter(|best| of(best) <= TOLERANCE * by_twist);
    let looks_like = best.map(|(.., look)| *look);
    Some(Finding {
        place: "base_vx_m_s, base_vy_m_s",
        found: format!("{by_twist:.4} m/s RMS"),
        expected: format!("{by_poses:.4} m/s RMS in the same direction, by the finite differences of the poses"),
        looks_like: looks_like.unwrap_or("times, poses and twist do not belong together").into(),
    })
}

/// Bounds the yaw and its rate, and finds wrapped angles.
pub(super) fn yaw(subject: &Subject<'_>) -> Vec<Finding> {
    const CLOSE: f64 = 0.1;
    let instants = subject.instants();
    let mut findings = Vec::new();
    let change = |pair: &[Instant]| pair[1].base.yaw_rad() - pair[0].base.yaw_rad();
    let mut rates: Vec<f64> =
        instants.windows(2).map(|pair| change(pair).abs() / (pair[1].t_s - pair[0].t_s)).collect();
    let first_rad = instants.first().map_or(0.0, |instant| instant.base.yaw_rad());
    let rate_rad_s = quantile(&mut rates, MOST_OF).unwrap_or_default();
    if first_rad.abs() > TAU || rate_rad_s > MOST_RATE_RAD_S {
        findings.push(Finding {
            place: "base_yaw_rad",
            found: format!("{first_rad:.3} rad in the first row, and rates up to {rate_rad_s:.3} rad/s"),
            expected: format!("at most {TAU:.3} rad in the first row, and {MOST_RATE_RAD_S} rad/s"),
            looks_like: DEGREES_LOOK.into(),
        });
    }
    if let Some(row) = instants.windows(2).position(|pair| (change(pair).abs() / TAU - 1.0).abs() < CLOSE) {
        findings.push(Finding {
            place: "base_yaw_rad",
            found: format!("a step of {:.3} rad in line {}", change(&instants[row..row + 2]), row + 3),
            expected: "a continuous angle".into(),
            looks_like: "yaw looks wrapped at a half turn".into(),
        });
    }
    findings
}

/// Bounds the speed of the base, the steps of its position and its travel during one touch.
pub(super) fn travel(subject: &Subject<'_>) -> Vec<Finding> {
    let threshold_n_m = TOUCHING * subject.largest_n_m;
    let pressing = |instant: &Instant| {
        let moment_n_m = instant.moment_z_n_m;
        if moment_n_m.abs() > threshold_n_m { moment_n_m.signum() } else { 0.0 }
    };
    let travel = |pair: &[Instant]| {
        let (before, now) = (pressing(&pair[0]), pressing(&pair[1]));
        Travel {
            time_s: pair[1].t_s - pair[0].t_s,
            step_m: pair[1].base.origin().distance(&pair[0].base.origin()),
            touches: now != 0.0 && now == before,
        }
    };
    let sidecar = &subject.trace.sidecar;
    let travels: Vec<Travel> = subject.instants().windows(2).map(travel).collect();
    travelled("base_x_m, base_y_m", &travels, sidecar.whisker.length_m, sidecar.rate_hz).into_iter().collect()
}

/// Motion of the base between two rows.
pub(super) struct Travel {
    pub(super) time_s: f64,
    pub(super) step_m: f64,
    /// Whether the whisker touches in both rows, without a release between them.
    pub(super) touches: bool,
}

/// Bounds the motion of the base between consecutive rows, whose position stands at `place`.
pub(super) fn travelled(place: &'static str, travels: &[Travel], length_m: f64, rate_hz: f64) -> Option<Finding> {
    let mut speeds: Vec<f64> =
        travels.iter().map(|travel| travel.step_m / travel.time_s).filter(|speed_m_s| *speed_m_s > 0.0).collect();
    let speed_m_s = quantile(&mut speeds, MOST_OF).unwrap_or_default();
    let travel_m = longest_touch_m(travels);
    let most_m_s = MOST_LENGTHS_PER_S * length_m;
    if speed_m_s > most_m_s || travel_m > MOST_TRAVEL * length_m {
        return Some(Finding {
            place,
            found: format!("speeds up to {speed_m_s:.3} m/s, and {travel_m:.3} m of travel in one touch"),
            expected: format!(
                "at most {most_m_s:.1} m/s and {:.1} m for a whisker of {length_m} m",
                MOST_TRAVEL * length_m
            ),
            looks_like: MILLIMETRES_LOOK.into(),
        });
    }
    let mut steps_m: Vec<f64> = travels.iter().map(|travel| travel.step_m).collect();
    let usual_m = quantile(&mut steps_m, MOST_OF).unwrap_or_default();
    // The base may move far while rows are missing.
    let longest_s = MOST_INTERVALS / rate_hz;
    let is_far = |travel: &Travel| travel.step_m > MOST_STEP * length_m && travel.time_s < longest_s;
    let far = travels.iter().position(is_far).filter(|_| usual_m < SHORT_STEP * length_m);
    far.map(|row| Finding {
        place,
        found: format!("a step of {:.4} m in line {}", travels[row].step_m, row + 3),
        expected: format!("at most {:.4} m, since 95 % of the steps are below {usual_m:.2e} m", MOST_STEP * length_m),
        looks_like: "the position jumps: rows are lost, or two recordings were joined".into(),
    })
}

/// Longest travel of the base during one touch.
fn longest_touch_m(travels: &[Travel]) -> f64 {
    let mut longest_m: f64 = 0.0;
    let mut travel_m = 0.0;
    for travel in travels {
        travel_m = if travel.touches { travel_m + travel.step_m } else { 0.0 };
        longest_m = longest_m.max(travel_m);
    }
    longest_m
}
