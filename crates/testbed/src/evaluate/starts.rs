//! What the estimators are contact_prior of the first touch.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;
use trace::{Sidecar, Trace};
use whisker::estimators::ContactPrior;
use whisker::frames::Point;

use crate::seeds::derived_seed;

/// With which knowledge of the first touch each trial is run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Starts {
    /// None but that it lies along the undeflected whisker.
    #[default]
    Honest,
    /// That, and then six times more, contact_prior a place 4 to 5 mm off the true one: groups of their own.
    Wrong,
}

/// Wrong starts lie in so many directions, evenly spread.
const DIRECTIONS: u16 = 6;

/// How far off they lie.
const NEAREST_M: f64 = 4e-3;
const FARTHEST_M: f64 = 5e-3;

/// Standard deviation that goes with such a claim: along each axis, the root mean square of what it is off.
const SD_M: f64 = 3.2e-3;

/// The trial under each wrong start: renamed, in a group of its own. None where the true first contact is not known.
pub(super) fn wrong(trace: &Trace) -> Vec<(Sidecar, ContactPrior)> {
    let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
    let first = instants.filter_map(|(known, truth)| Some(known.base.inverse().apply(truth.contact?))).next();
    let Some(first) = first else { return Vec::new() };
    (0..DIRECTIONS)
        .map(|i| {
            let degrees = 360 / DIRECTIONS * i;
            let mut sidecar = trace.sidecar.clone();
            sidecar.name = format!("{}_told_{degrees:03}", sidecar.name);
            sidecar.group = format!("{}, contact_prior wrongly", sidecar.group);
            let mut rng = Pcg64::seed_from_u64(derived_seed(0, &["wrong start", &sidecar.name]));
            let radius_m = rng.random_range(NEAREST_M..FARTHEST_M);
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let contact = Point::new(first.x() + radius_m * cos, first.y() + radius_m * sin);
            (sidecar, ContactPrior { contact, sd_m: SD_M })
        })
        .collect()
}
