//! Whether an estimator is as sure as it may be: its stated covariances against its errors. How the averages over trials are judged stands in
//! [`crate::consistency`].

use super::{Contact, Metric, Scored, Summary};
use crate::statistics::mean;

/// The squared distance, in standard deviations, within which a two-dimensional Gaussian has 95 % of its probability.
pub const CHI2_95: f64 = 5.991_464_547_107_979;

/// Normalised estimation error squared.
pub const NEES: Metric = Metric {
    name: "nees",
    about: "normalised contact error squared, mean over the contact: 2 if the stated covariances are right, more if too small",
    summary: Summary::Mean,
    measure: |scored| mean(errors_squared(scored)),
};

/// Normalised innovation squared.
pub const NIS: Metric = Metric {
    name: "nis",
    about: "normalised innovation squared, mean over the contact: 1 if the expected spread of the readings is right, more if too small",
    summary: Summary::Mean,
    measure: |scored| mean(scored.contacts.iter().filter_map(|contact| contact.nis)),
};

/// Share of the stated 95 % ellipses that hold the truth.
pub const COVERAGE: Metric = Metric {
    name: "coverage_95",
    about: "share of the stated 95 % ellipses that hold the true contact",
    summary: Summary::Mean,
    measure: |scored| mean(errors_squared(scored).map(|nees| f64::from(nees <= CHI2_95))),
};

fn errors_squared(scored: &Scored<'_>) -> impl Iterator<Item = f64> {
    scored.contacts.iter().filter_map(|contact: &Contact| contact.nees)
}
