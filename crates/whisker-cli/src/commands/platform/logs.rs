//! Arguments that name logs of presses.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use platform::calibration::logs::{Gathered, Source, gather};
use platform::calibration::regression::{REGRESSIONS, RegressionRow, regression};
use platform::calibration::{HoldOut, Settings};

use crate::commands::diagnose;
use crate::commands::progress::Progress;

/// Duration of a cross-validation without a progress bar.
const UNSHOWN: Duration = Duration::from_secs(2);

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
    /// Unit of cross-validation: the presses at one place, one press, or all presses of a log
    #[arg(long, default_value = "place", value_parser = hold_out)]
    pub(super) hold_out: HoldOut,
}

impl LogArguments {
    /// The logs themselves, those that manifests name included.
    fn sources(&self) -> anyhow::Result<Vec<Source>> {
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
        Ok(sources)
    }

    /// Files that are read: manifests, logs and their sidecars.
    pub(super) fn files(&self) -> anyhow::Result<Vec<PathBuf>> {
        let of_logs = self.sources()?.into_iter().flat_map(|log| [log.path.with_extension("json"), log.path]);
        Ok(self.logs.iter().cloned().chain(of_logs).collect())
    }

    /// Presses of all logs; notes on the logs go to stderr.
    pub(super) fn gather(&self, row: &RegressionRow) -> anyhow::Result<Gathered> {
        let sources = self.sources()?;
        if !(f64::MIN_POSITIVE..=f64::MAX).contains(&self.table_rate_hz) {
            bail!("--table-rate-hz: found {}, expected a rate above zero", self.table_rate_hz);
        }
        let settings = Settings { cutoff_hz: self.cutoff_hz, ..Settings::default() };
        let gathered = gather(&sources, &settings, row, self.table_rate_hz)?;
        for note in &gathered.notes {
            diagnose(note);
        }
        Ok(gathered)
    }
}

/// Progress bar of cross-validations. It appears after some seconds.
pub(super) struct Validating {
    begun: Instant,
    bar: Option<Progress>,
}

impl Validating {
    pub(super) fn new() -> Self {
        Self { begun: Instant::now(), bar: None }
    }

    /// Shows the number of fits done and of all fits of a regression.
    pub(super) fn show(&mut self, done: usize, all: usize) {
        if self.bar.is_none() && self.begun.elapsed() > UNSHOWN {
            self.bar = Some(Progress::of("cross-validation"));
        }
        if let Some(bar) = &self.bar {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        }
    }

    /// Removes the bar, before other output.
    pub(super) fn clear(&mut self) {
        self.bar = None;
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
    let expected = "expected MM=FILE with a distance above zero and a log, for example 105=log.csv";
    let (distance, file) = text.split_once('=').ok_or(expected)?;
    match distance.parse::<f64>() {
        Ok(mm) if mm > 0.0 && mm.is_finite() && !file.is_empty() => {
            Ok(Source { path: Path::new(file).into(), distance_m: Some(1e-3 * mm) })
        }
        _ => Err(expected.into()),
    }
}

fn hold_out(text: &str) -> Result<HoldOut, String> {
    match text {
        "place" => Ok(HoldOut::Place),
        "press" => Ok(HoldOut::Press),
        "log" => Ok(HoldOut::Log),
        _ => Err("expected place, press or log".into()),
    }
}
