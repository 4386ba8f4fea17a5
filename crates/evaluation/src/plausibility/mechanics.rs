//! Moment of the elastica through the true contact.

use std::f64::consts::PI;

use trace::{Instant, TruthInstant};
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};

use super::moment::THOUSAND_TIMES_LOOK;
use super::{Finding, Subject, median};

/// Share of the largest moment above which rows are compared, and their largest number, evenly spread.
const LOADED: f64 = 0.2;
const MOST_ROWS: usize = 40;

/// Ratio of moment and elastica that agrees: stiffness and calibration of a real whisker are known less exactly than
/// those of a simulated one.
const MOST_RATIO: f64 = 5.0;

/// Largest ratio of a row's ratio to the median one of rows whose ratio is constant: poses and contacts are then right.
const CONSTANT: f64 = 1.5;

/// Share of the compared rows that must agree.
const AGREEING: f64 = 0.5;

/// Wrong unit or sign, with the factors of the quantities that correct it.
struct Hypothesis {
    positions: f64,
    yaw: f64,
    contacts: f64,
    moment: f64,
    looks_like: &'static str,
}

const AS_IS: Hypothesis = Hypothesis { positions: 1.0, yaw: 1.0, contacts: 1.0, moment: 1.0, looks_like: "" };

const HYPOTHESES: [Hypothesis; 8] = [
    Hypothesis { positions: 1e-3, looks_like: "poses look like millimetres", ..AS_IS },
    Hypothesis { yaw: PI / 180.0, looks_like: "yaw looks like degrees", ..AS_IS },
    Hypothesis { moment: 1e-3, looks_like: THOUSAND_TIMES_LOOK, ..AS_IS },
    Hypothesis { moment: 1e3, looks_like: "the moment looks 1000 times too small", ..AS_IS },
    Hypothesis {
        moment: -1.0,
        looks_like: "the sign of the moment is wrong, or the true contacts lie elsewhere",
        ..AS_IS
    },
    Hypothesis { contacts: 1e-3, looks_like: "the true contacts look like millimetres", ..AS_IS },
    Hypothesis {
        positions: 1e-3,
        contacts: 1e-3,
        looks_like: "poses and true contacts look like millimetres",
        ..AS_IS
    },
    Hypothesis { yaw: -1.0, looks_like: "the sign of yaw is wrong", ..AS_IS },
];

/// Compares the moment with that of the elastica through the true contact.
pub(super) fn elastica(subject: &Subject<'_>) -> Vec<Finding> {
    let Ok(elastica) = Elastica::new(&subject.trace.sidecar.whisker) else { return Vec::new() };
    let known: Vec<(&Instant, Point<World>)> = subject
        .loaded(LOADED)
        .filter_map(|row| Some((&subject.instants()[row], on_the_side(&subject.trace.truth.instants[row])?)))
        .collect();
    let stride = known.len().div_ceil(MOST_ROWS).max(1);
    let rows: Vec<_> = known.into_iter().step_by(stride).collect();
    let ratios = |hypothesis: &Hypothesis| -> Vec<f64> {
        rows.iter().filter_map(|(instant, contact)| ratio(&elastica, instant, *contact, hypothesis)).collect()
    };
    let agrees = |ratios: &[f64]| {
        let agreeing = ratios.iter().filter(|ratio| (1.0 / MOST_RATIO..=MOST_RATIO).contains(*ratio)).count();
        agreeing as f64 >= AGREEING * rows.len() as f64
    };
    let mut found = ratios(&AS_IS);
    if agrees(&found) {
        return Vec::new();
    }
    let reached = found.len();
    let middle = median(&mut found);
    let is_near = |ratio: &&f64| middle.is_some_and(|middle| (1.0 / CONSTANT..=CONSTANT).contains(&(*ratio / middle)));
    let is_constant = found.iter().filter(is_near).count() as f64 >= AGREEING * rows.len() as f64;
    let explains = |it: &&Hypothesis| (it.moment != 1.0 || !is_constant) && agrees(&ratios(it));
    let looks_like = HYPOTHESES.iter().find(explains).map(|it| it.looks_like);
    let otherwise = if is_constant {
        "unit, scale or sign of the moment is another one"
    } else {
        "frame of the poses, frame of the contacts or whisker is another one"
    };
    let found = match middle {
        Some(ratio) if 2 * reached >= rows.len() => format!("{ratio:.3e} times the moment of the elastica"),
        _ => format!("{reached} of {} true contacts within reach of the whisker", rows.len()),
    };
    vec![Finding {
        place: "truth_contact_x_m, truth_contact_y_m",
        found,
        expected: format!("a moment within a factor of {MOST_RATIO} of the elastica through the true contact"),
        looks_like: looks_like.unwrap_or(otherwise).into(),
    }]
}

/// True contact in one place on the side of the whisker.
fn on_the_side(truth: &TruthInstant) -> Option<Point<World>> {
    truth.contact.filter(|_| truth.tip != Some(true) && truth.split != Some(true))
}

/// Ratio of the moment to that of the elastica. `None` if the contact is out of the whisker's reach.
fn ratio(elastica: &Elastica, instant: &Instant, contact: Point<World>, hypothesis: &Hypothesis) -> Option<f64> {
    let Hypothesis { positions, yaw, contacts, moment, .. } = hypothesis;
    let origin = instant.base.origin();
    let base: Pose<Base, World> =
        Pose::new(positions * origin.x(), positions * origin.y(), yaw * instant.base.yaw_rad());
    let contact = base.inverse().apply(Point::new(contacts * contact.x(), contacts * contact.y()));
    let expected_n_m = elastica.at_point(contact).ok()?.deflection.moment_n_m;
    let ratio = moment * instant.moment_z_n_m / expected_n_m;
    ratio.is_finite().then_some(ratio)
}
