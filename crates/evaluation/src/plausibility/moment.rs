//! Size and sign of the moment.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector2;
use trace::{SpatialInstant, SpatialTrace};
use whisker::Whisker;
use whisker::sensor::Face;

use super::{Finding, Subject};
use crate::glitches;

/// Factor between N m and N mm.
const MILLI: f64 = 1e3;

/// Largest deviation of the moment from root stiffness x rotation, relative to the largest moment.
const ROTATION_TOLERANCE: f64 = 0.05;

/// Ratio of a moment to the largest possible one below which it is not in another unit.
const SLIGHT: f64 = 10.0;

/// Largest rotation of the root that a contact can cause, and largest strain of a super-elastic wire.
const MOST_ROTATION_RAD: f64 = FRAC_PI_2;
const MOST_STRAIN: f64 = 0.1;

/// Share of the largest moment above which the sign of a row shows the face, and share of these rows of which more must have the
/// same sign: a released whisker rings.
const SIGNED: f64 = 0.2;
const MOST: f64 = 0.5;

pub(super) const THOUSAND_TIMES_LOOK: &str = "the moment looks 1000 times too large (N mm instead of N m?)";

/// Bending moments about y and z (N m), 2x1.
pub(super) fn bending(instant: &SpatialInstant) -> Vector2<f64> {
    Vector2::new(instant.moment_y_n_m, instant.moment_z_n_m)
}

/// Largest bending moment of a trace without single outliers.
pub(super) fn largest_bending(trace: &SpatialTrace) -> f64 {
    let size = |instant: &SpatialInstant| instant.moment_y_n_m.hypot(instant.moment_z_n_m);
    glitches::largest(&trace.recording.instants.iter().map(size).collect::<Vec<_>>())
}

/// Finds single readings far above all others.
pub(super) fn glitches(subject: &Subject<'_>) -> Vec<Finding> {
    let (instants, most_n_m) = (subject.instants(), glitches::most(subject.largest_n_m));
    let glitches = glitches::rows(&subject.trace.moments_n_m());
    let Some(first) = glitches.first() else { return Vec::new() };
    let more = if glitches.len() > 1 { format!(", the first of {}", glitches.len()) } else { String::new() };
    vec![Finding {
        place: "moment_z_n_m",
        found: format!("{:e} N m in line {}{more}", instants[*first].moment_z_n_m, first + 2),
        expected: format!("at most {most_n_m:.2e} N m, by the other readings"),
        looks_like: "a glitch of the sensor; estimators gate a reading above ten times the largest calibrated one"
            .into(),
    }]
}

/// Compares the moment with the rotation of the root times its stiffness.
pub(super) fn rotation(subject: &Subject<'_>) -> Vec<Finding> {
    let stiffness = subject.trace.sidecar.whisker.root_stiffness_n_m_rad;
    let pairs: Vec<(f64, f64)> = subject
        .loaded(0.0)
        .map(|row| &subject.instants()[row])
        .filter_map(|instant| Some((instant.moment_z_n_m, stiffness * instant.rotation_z_rad?)))
        .collect();
    let largest_n_m = pairs.iter().map(|(_, expected_n_m)| expected_n_m.abs()).fold(0.0, f64::max);
    let deviation = |scale: f64| {
        let deviations = pairs.iter().map(|(found_n_m, expected_n_m)| (scale * found_n_m - expected_n_m).abs());
        deviations.fold(0.0, f64::max)
    };
    let fits = |scale: f64| deviation(scale) <= ROTATION_TOLERANCE * largest_n_m;
    if fits(1.0) {
        return Vec::new();
    }
    let hypotheses = [
        (1.0 / MILLI, THOUSAND_TIMES_LOOK),
        (MILLI, "the moment looks 1000 times too small"),
        (-1.0, "the sign of the moment is wrong"),
        (180.0 / std::f64::consts::PI, "rotation_z_rad looks like degrees"),
    ];
    let looks_like = hypotheses.iter().find(|(scale, _)| fits(*scale)).map(|(_, look)| *look);
    vec![Finding {
        place: "moment_z_n_m",
        found: format!("up to {:.3e} N m", subject.largest_n_m),
        expected: format!("root stiffness x rotation_z_rad, up to {largest_n_m:.3e} N m"),
        looks_like: looks_like.unwrap_or("moment and rotation do not belong together").into(),
    }]
}

/// Compares the moment with the rotation of the root and the strain of the wire that it causes.
pub(super) fn strength(subject: &Subject<'_>) -> Vec<Finding> {
    let whisker = &subject.trace.sidecar.whisker;
    let found = withstood("moment_z_n_m", subject.largest_n_m, whisker, whisker.root_stiffness_n_m_rad);
    found.into_iter().collect()
}

/// Compares the largest bending moment, stated at `place`, with that which a whisker on a spring of this stiffness withstands.
pub(super) fn withstood(
    place: &'static str,
    largest_n_m: f64,
    whisker: &Whisker,
    stiffness_n_m_rad: f64,
) -> Option<Finding> {
    let by_rotation_n_m = MOST_ROTATION_RAD * stiffness_n_m_rad;
    let by_strain_n_m = 2.0 * MOST_STRAIN * whisker.bending_stiffness_n_m2(0.0) / whisker.root_diameter_m;
    let most_n_m = by_rotation_n_m.min(by_strain_n_m);
    if largest_n_m <= most_n_m {
        return None;
    }
    let excess = largest_n_m / most_n_m;
    let looks_like = if excess < SLIGHT {
        "the stiffness, the diameter or the length of the whisker, or the frame of the contacts or poses, is wrong"
            .into()
    } else if excess <= MILLI {
        THOUSAND_TIMES_LOOK.into()
    } else {
        format!("the moment looks {excess:.0e} times too large")
    };
    Some(Finding {
        place,
        found: format!("up to {largest_n_m:.3e} N m"),
        expected: format!(
            "at most {most_n_m:.3e} N m: more turns the root by a right angle ({by_rotation_n_m:.3e} N m) or strains \
            the wire by {:.0} % ({by_strain_n_m:.3e} N m)",
            100.0 * MOST_STRAIN
        ),
        looks_like,
    })
}

/// Compares the moment with the largest calibrated reading.
pub(super) fn calibrated(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(calibration) = subject.calibration else { return Vec::new() };
    let gate = calibration.gate();
    if gate.admits(subject.largest_n_m) {
        return Vec::new();
    }
    let looks_like = if gate.admits(subject.largest_n_m / MILLI) {
        THOUSAND_TIMES_LOOK
    } else {
        "trace and calibration have different units"
    };
    vec![Finding {
        place: "moment_z_n_m",
        found: format!("up to {:.3e} N m", subject.largest_n_m),
        expected: format!("at most {:.3e} N m, ten times the largest calibrated reading", gate.most_n_m()),
        looks_like: looks_like.into(),
    }]
}

/// Face to which the sign of the moment belongs in most of the loaded rows, and their share. `None` without such rows.
pub(super) fn touching_face(subject: &Subject<'_>) -> Option<(Face, f64)> {
    let (mut rows, mut right) = (0, 0);
    for row in subject.loaded(SIGNED) {
        rows += 1;
        right += usize::from(Face::of_reading(subject.instants()[row].moment_z_n_m) == Face::Right);
    }
    let of_faces = [(Face::Left, rows - right), (Face::Right, right)];
    of_faces.into_iter().map(|(face, of_face)| (face, of_face as f64 / rows as f64)).find(|(_, share)| *share > MOST)
}

/// Compares the sign of the moment with the face.
pub(super) fn face(subject: &Subject<'_>) -> Vec<Finding> {
    let face = subject.trace.sidecar.face;
    let Some((_, share)) = touching_face(subject).filter(|(touching, _)| *touching != face) else { return Vec::new() };
    let (opposite, expected) = if face.away_sign() > 0.0 { ("negative", "positive") } else { ("positive", "negative") };
    vec![Finding {
        place: "face",
        found: format!("`{}` with a {opposite} moment in {:.0} % of the loaded rows", face.name(), 100.0 * share),
        expected: format!("a {expected} moment"),
        looks_like: "the sign of the moment is wrong, or the face is the other one".into(),
    }]
}
