//! Messages that commands in the plane and in space share.

use std::process::ExitCode;

use evaluation::plausibility::Finding;
use evaluation::remarks::on_rate;
use testbed::results::FailureRow;

use super::FINISHED_WITH_FAILURES;

/// Start of the message that states why a calibration of recordings has no sensor.
pub(super) const NO_SENSOR: &str = "the calibration has no sensor and cannot convert counts";

/// Prints a note if the noise of `--noise` was not added to the readings of a whisker.
pub(super) fn note_noise(stated: Option<f64>, added: f64, whisker: &str) {
    if let Some(stated) = stated.filter(|stated| *stated != added) {
        eprintln!(
            "note: whisker `{whisker}`: --noise {stated} was not added, since the readings of recordings contain noise"
        );
    }
}

/// Prints a note if the sampling rate of a trace contradicts its times.
pub(super) fn note_rate(trace: &str, rate: Option<&Finding>) {
    rate.iter().for_each(|finding| eprintln!("note: {}", on_rate(trace, finding)));
}

/// A remark if fewer than half of the rows in contact have an estimate.
pub(super) fn few_estimates(touching: u64, estimates: u64, calibration: &str) -> Option<String> {
    (2 * estimates < touching).then(|| {
        format!(
            "few estimates: {estimates} for {touching} rows in contact; the other contacts lie at the tip or outside the calibrated \
             domain of {calibration}, or their readings contradict it"
        )
    })
}

/// Prints failures to stderr. Returns the exit code.
pub(super) fn conclusion(failures: &[FailureRow]) -> ExitCode {
    for failure in failures {
        let estimator = failure.estimator.as_ref().map_or_else(String::new, |name| format!("{name} on "));
        let FailureRow { trace, noise, seed, reason, .. } = failure;
        eprintln!("failed: {estimator}{trace} at noise {noise}, seed {seed}: {reason}");
    }
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_few_estimates_of_the_rows_in_contact_are_remarked() {
        assert_eq!(few_estimates(100, 50, "whisker.json"), None);
        assert_eq!(few_estimates(0, 0, "whisker.json"), None);
        let remark = few_estimates(100, 49, "whisker.json").unwrap();
        assert!(
            remark.starts_with("few estimates: 49 for 100 rows in contact") && remark.contains("whisker.json"),
            "{remark}"
        );
    }
}
