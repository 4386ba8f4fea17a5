//! Coefficient of friction, for estimators that state one: evaluated at the last estimate of the contact.

use whisker::estimators::FrictionCoefficient;

use super::{Metric, Scored, Summary};
use crate::statistics::NORMAL_95;

/// Error of the coefficient of friction.
pub const ERROR: Metric = Metric {
    name: "friction_error",
    about: "error of the coefficient of friction at the end; contacts with friction only",
    summary: Summary::Median,
    measure: |scored| {
        let (true_coefficient, stated) = (true_coefficient(scored)?, last(scored)?);
        Some((stated.coefficient - true_coefficient).abs())
    },
};

/// Coverage of the coefficient's interval.
pub const COVERED: Metric = Metric {
    name: "friction_covered_95",
    about: "1 if the final 95 % interval of the coefficient of friction contains the true one; contacts with friction \
        for which a coefficient is stated at the end; over trials, the fraction",
    summary: Summary::Mean,
    measure: |scored| Some(f64::from(covers(last(scored)?, true_coefficient(scored)?))),
};

/// Whether the 95 % interval contains the true coefficient.
fn covers(stated: FrictionCoefficient, true_coefficient: f64) -> bool {
    (stated.coefficient - true_coefficient).abs() <= NORMAL_95 * stated.sd
}

/// Coefficient that the last estimate during contact states.
fn last(scored: &Scored<'_>) -> Option<FrictionCoefficient> {
    scored.contacts.iter().rev().find_map(|contact| scored.estimates[contact.row])?.friction
}

/// True coefficient. `None` for contacts without friction.
fn true_coefficient(scored: &Scored<'_>) -> Option<f64> {
    scored.trial.trace.sidecar.scene["friction"].as_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_an_interval_has_two_standard_deviations_on_either_side() {
        let stated = FrictionCoefficient { coefficient: 0.3, sd: 0.05 };
        assert!(covers(stated, 0.39) && covers(stated, 0.21) && !covers(stated, 0.41) && !covers(stated, 0.19));
    }
}
