//! Priors of the first contact.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;
use testbed::seeds::derived_seed;
use trace::{Sidecar, Trace};
use whisker::estimators::ContactPrior;
use whisker::frames::Point;

/// Priors of the first contact with which each trial is run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Starts {
    /// The first contact lies along the undeflected whisker.
    #[default]
    Undeflected,
    /// That prior, and six more trials with a prior 4 to 5 mm off the true contact, in groups of their own.
    Wrong,
}

/// Number of directions, evenly spread, in which wrong priors lie off the true contact.
const DIRECTIONS: u16 = 6;

/// Least distance of a wrong prior from the true contact.
const NEAREST_M: f64 = 4e-3;
/// Largest distance of a wrong prior from the true contact.
const FARTHEST_M: f64 = 5e-3;

/// Standard deviation of a wrong prior along each axis: the root mean square of its error.
const SD_M: f64 = 3.2e-3;

/// The trial with each wrong prior, renamed and in a group of its own. Empty if the true first contact is unknown.
pub(super) fn wrong(trace: &Trace) -> Vec<(Sidecar, ContactPrior)> {
    let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
    let first = instants.filter_map(|(known, truth)| Some(known.base.inverse().apply(truth.contact?))).next();
    let Some(first) = first else { return Vec::new() };
    (0..DIRECTIONS)
        .map(|i| {
            let degrees = 360 / DIRECTIONS * i;
            let mut sidecar = trace.sidecar.clone();
            sidecar.name = format!("{}_told_{degrees:03}", sidecar.name);
            sidecar.group = format!("{}, wrong prior", sidecar.group);
            let mut rng = Pcg64::seed_from_u64(derived_seed(0, &["wrong start", &sidecar.name]));
            let radius_m = rng.random_range(NEAREST_M..FARTHEST_M);
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let contact = Point::new(first.x() + radius_m * cos, first.y() + radius_m * sin);
            (sidecar, ContactPrior { contact, sd_m: SD_M })
        })
        .collect()
}
