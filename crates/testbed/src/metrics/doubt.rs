//! The signal that an estimator's models contradict the readings ([`whisker::estimators::Estimate::model_doubtful`]).

use nalgebra::Vector2;
use trace::YieldingTruth;

use super::{Metric, Scored, Summary};
use crate::statistics::{CHI2_2_95, mean};

/// Error above which an estimate can be misleading (m).
const WRONG_M: f64 = 0.3e-3;

/// Share of the estimates with the signal.
pub const DOUBTED: Metric = Metric {
    name: "doubted",
    about: "fraction of the estimates at which the readings contradict the models that the estimator averages",
    summary: Summary::Mean,
    measure: |scored| doubted(signals(scored)),
};

/// Time until the signal.
pub const DOUBT_TIME: Metric = Metric {
    name: "doubt_time_s",
    about: "time from the touch, or from the instant at which the object has been displaced by 0.3 mm, until the readings contradict the \
        models that the estimator averages; mean over the trials in which they do",
    summary: Summary::Mean,
    measure: |scored| doubt_after_s(signals(scored), displaced_s(scored).unwrap_or(0.0)),
};

/// Number of alarms.
pub const ALARMS: Metric = Metric {
    name: "doubt_alarms",
    about: "number of times at which the signal that the readings contradict the models is raised",
    summary: Summary::Mean,
    measure: |scored| {
        let mut was_doubtful = false;
        let raised = signals(scored)
            .filter(|(_, is_doubtful)| !std::mem::replace(&mut was_doubtful, *is_doubtful) && *is_doubtful);
        scored.contacts.first().map(|_| raised.count() as f64)
    },
};

/// Time in which there may be an alarm.
pub const CONTACT_TIME: Metric = Metric {
    name: "doubt_contact_s",
    about: "duration of the contact with an estimate by averaged models",
    summary: Summary::Mean,
    measure: |scored| Some(signals(scored).count() as f64 / scored.trial.trace.sidecar.rate_hz),
};

/// Share of misleading estimates, on objects that give way.
pub const MISLEADING: Metric = Metric {
    name: "misleading",
    about: "objects that give way: fraction of the estimates with an error above 0.3 mm whose 95 % ellipse does not contain the true \
        contact, and at which the readings do not contradict the models",
    summary: Summary::Mean,
    measure: |scored| {
        if !scored.trial.trace.sidecar.is_yielding() {
            return None;
        }
        mean(scored.contacts.iter().filter_map(|contact| {
            let estimate = scored.estimates[contact.row].as_ref()?;
            let is_wrong = contact.error_m? > WRONG_M && contact.nees? > CHI2_2_95;
            Some(f64::from(is_wrong && !estimate.model_doubtful))
        }))
    },
};

/// Time since the touch at which the displacement of an object that gives way first exceeds [`WRONG_M`]; until then, an estimate
/// that assumes a fixed object can be accurate. `None` if it never does.
fn displaced_s(scored: &Scored<'_>) -> Option<f64> {
    let truths = &scored.trial.trace.truth.instants;
    let is_displaced = |given: &YieldingTruth| Vector2::from(given.moved_m).norm() > WRONG_M;
    let first = scored.contacts.iter().find(|contact| truths[contact.row].yielding.as_ref().is_some_and(is_displaced));
    first.map(|contact| contact.t_contact_s)
}

/// Times since the touch of the estimates by averaged models, and whether they are in doubt.
fn signals(scored: &Scored<'_>) -> impl Iterator<Item = (f64, bool)> {
    scored.contacts.iter().filter_map(|contact| {
        let estimate = scored.estimates[contact.row].as_ref()?;
        estimate.models.map(|_| (contact.t_contact_s, estimate.model_doubtful))
    })
}

/// Share of the signals that are raised; each is a time since the touch, and whether it is.
pub(crate) fn doubted(signals: impl Iterator<Item = (f64, bool)>) -> Option<f64> {
    mean(signals.map(|(_, is_doubtful)| f64::from(is_doubtful)))
}

/// Time since the touch of the first signal that is raised.
pub(crate) fn doubt_time_s(mut signals: impl Iterator<Item = (f64, bool)>) -> Option<f64> {
    signals.find(|(_, is_doubtful)| *is_doubtful).map(|(t_contact_s, _)| t_contact_s)
}

/// Time from an instant until the signal is raised. Zero if it is raised then.
fn doubt_after_s(signals: impl Iterator<Item = (f64, bool)>, since_s: f64) -> Option<f64> {
    doubt_time_s(signals.filter(|(t_contact_s, _)| *t_contact_s >= since_s)).map(|t_contact_s| t_contact_s - since_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_time_counts_from_the_displacement() {
        let signals = [(0.0, false), (1.0, true), (2.0, true), (3.0, false), (4.0, true)];
        let found = [0.0, 1.0, 1.5, 2.5, 4.5].map(|since_s| doubt_after_s(signals.into_iter(), since_s));
        assert_eq!(found, [Some(1.0), Some(0.0), Some(0.5), Some(1.5), None]);
    }
}
