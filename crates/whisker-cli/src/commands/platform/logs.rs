//! Arguments that name logs of presses.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use platform::calibration::logs::{Gathered, Source, gather};
use platform::calibration::regression::{REGRESSIONS, RegressionRow, regression};
use platform::calibration::{HoldOut, Settings};

/// Logs and the detection of presses in them
#[derive(clap::Args)]
pub(super) struct LogArguments {
    /// Logs of samples with a sidecar, tables of presses, or manifests (.json) that name logs
    logs: Vec<PathBuf>,
    /// Log whose presses all have the radial distance MM (mm) from the root, for example 105=FILE
    #[arg(long, value_name = "MM=FILE", value_parser = labelled)]
    label: Vec<Source>,
    /// Cut-off frequency of the low-pass in Hz
    #[arg(long, default_value_t = Settings::default().cutoff_hz)]
    cutoff_hz: f64,
    /// Sampling rate in Hz of a table whose slopes are in counts per sample
    #[arg(long, default_value_t = 888.0)]
    table_rate_hz: f64,
    /// Unit of cross-validation: one press, or all presses of a log
    #[arg(long, default_value = "press", value_parser = hold_out)]
    pub(super) hold_out: HoldOut,
}

impl LogArguments {
    /// Presses of all logs; notes on the logs go to stderr.
    pub(super) fn gather(&self, row: &RegressionRow) -> anyhow::Result<Gathered> {
        let mut sources = self.label.clone();
        for path in &self.logs {
            if path.extension().is_some_and(|extension| extension == "json") {
                sources.extend(Source::of_manifest(path)?);
            } else {
                sources.push(Source { path: path.clone(), distance_m: None });
            }
        }
        if sources.is_empty() {
            bail!("found no logs, expected at least one, or --label MM=FILE");
        }
        if !(f64::MIN_POSITIVE..=f64::MAX).contains(&self.table_rate_hz) {
            bail!("--table-rate-hz: found {}, expected a rate above zero", self.table_rate_hz);
        }
        let settings = Settings { cutoff_hz: self.cutoff_hz, ..Settings::default() };
        let gathered = gather(&sources, &settings, row, self.table_rate_hz)?;
        for note in &gathered.notes {
            eprintln!("{note}");
        }
        Ok(gathered)
    }
}

/// Row of the registry with this name.
pub(super) fn row(name: &str) -> anyhow::Result<&'static RegressionRow> {
    regression(name).with_context(|| {
        let known: Vec<_> = REGRESSIONS.iter().map(|row| row.name).collect();
        format!("unknown regression `{name}`, expected one of: {}", known.join(", "))
    })
}

fn labelled(text: &str) -> Result<Source, String> {
    let expected = "expected MM=FILE with a distance above zero, for example 105=log.csv";
    let (distance, file) = text.split_once('=').ok_or(expected)?;
    match distance.parse::<f64>() {
        Ok(mm) if mm > 0.0 && mm.is_finite() => {
            Ok(Source { path: Path::new(file).into(), distance_m: Some(1e-3 * mm) })
        }
        _ => Err(expected.into()),
    }
}

fn hold_out(text: &str) -> Result<HoldOut, String> {
    match text {
        "press" => Ok(HoldOut::Press),
        "log" => Ok(HoldOut::Log),
        _ => Err("expected press or log".into()),
    }
}
