//! Consistency of an estimator on one trial: errors and innovations relative to their stated covariances.
//! [`crate::consistency`] tests the averages over trials.

use whisker::frames::{Base, Point};

use super::{Contact, MOST_MISSING, Metric, Scored, Summary};
use crate::statistics::{CHI2_2_95, effective_samples, mean, rms};

/// Expectation of the NEES if the stated covariances are correct.
const EXPECTED_NEES: f64 = 2.0;

/// Normalised estimation error squared.
pub const NEES: Metric = Metric {
    name: "nees",
    about: "normalised contact error squared, mean over the contact; 2 if the stated covariances are correct, larger \
        if they are too small",
    summary: Summary::Mean,
    measure: |scored| mean(errors_squared(scored)),
};

/// Independent samples of the NEES.
pub const NEES_SAMPLES: Metric = Metric {
    name: "nees_samples",
    about: "number of independent samples of the normalised contact error squared, by its autocorrelation over the contact",
    summary: Summary::Mean,
    measure: |scored| effective_samples(&errors_squared(scored).collect::<Vec<_>>(), EXPECTED_NEES),
};

/// Normalised innovation squared.
pub const NIS: Metric = Metric {
    name: "nis",
    about: "normalised innovation squared, mean over the contact; 1 if the stated innovation variances are correct, \
        larger if they are too small",
    summary: Summary::Mean,
    measure: |scored| mean(scored.contacts.iter().filter_map(|contact| contact.nis)),
};

/// Coverage of the stated 95 % ellipses.
pub const COVERAGE: Metric = Metric {
    name: "coverage_95",
    about: "fraction of the stated 95 % ellipses that contain the true contact",
    summary: Summary::Mean,
    measure: |scored| mean(errors_squared(scored).map(|nees| f64::from(nees <= CHI2_2_95))),
};

/// Stated error.
pub const STATED_RMSE: Metric = Metric {
    name: "stated_rmse_m",
    about: "RMS contact error after the first two seconds of contact that the stated covariances predict",
    summary: Summary::Median,
    measure: |scored| {
        let variance_m2 = |contact: &Contact| Some(scored.estimates[contact.row].as_ref()?.covariance_m2?.trace());
        mean(scored.steady().iter().filter_map(variance_m2)).map(f64::sqrt)
    },
};

/// Ratio of the residuals of the readings at the estimated contacts to those at the true ones.
pub const RESIDUAL_RATIO: Metric = Metric {
    name: "residual_ratio",
    about: "RMS residual of the readings at the estimated contacts over that at the true contacts, both predicted by the given \
        calibration, after the first two seconds of contact and within the calibrated domain; at most 1 if a method that fits one \
        object to all readings explains them at least as well as the true object does (estimates of filters follow the noise)",
    summary: Summary::Median,
    measure: |scored| {
        let (face, readings_n_m) = (scored.trial.face()?, scored.trial.readings_n_m);
        let residuals_n_m = |contact: &Contact| {
            let expected_n_m = |at: Point<Base>| Some(face.predict(at)?.reading_n_m);
            let found_n_m = expected_n_m(scored.estimates[contact.row].as_ref()?.contact)?;
            let true_n_m = expected_n_m(scored.trial.true_contact(contact.row)?)?;
            Some((readings_n_m[contact.row] - found_n_m, readings_n_m[contact.row] - true_n_m))
        };
        let calibrated: Vec<&Contact> = scored.steady().iter().filter(|contact| contact.is_calibrated).collect();
        let known: Vec<(f64, f64)> = calibrated.iter().filter_map(|contact| residuals_n_m(contact)).collect();
        if (calibrated.len() - known.len()) as f64 > MOST_MISSING * calibrated.len() as f64 {
            return None;
        }
        let (found_n_m, true_n_m): (Vec<f64>, Vec<f64>) = known.into_iter().unzip();
        Some(rms(&found_n_m)? / rms(&true_n_m)?)
    },
};

fn errors_squared(scored: &Scored<'_>) -> impl Iterator<Item = f64> {
    scored.contacts.iter().filter_map(|contact: &Contact| contact.nees)
}
