//! `whisker platform fit`: a calibration from recorded logs.

use std::path::PathBuf;
use std::process::ExitCode;

use platform::calibration::Calibration;
use testbed::provenance::watermark;

use super::super::{print, table::millimetres};
use super::logs::{LogArguments, row};

/// Fit a regression of the radial contact distance to recorded presses
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    logs: LogArguments,
    /// File to write the calibration to
    #[arg(long)]
    out: PathBuf,
    /// Regression; `whisker list` names them
    #[arg(long, default_value = "robust")]
    regression: String,
    /// Probability with which the prediction interval contains the truth
    #[arg(long, default_value_t = 0.9)]
    coverage: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let row = row(&arguments.regression)?;
    let gathered = arguments.logs.gather(row)?;
    let inputs = [serde_json::to_string(&gathered.presses)?, serde_json::to_string(&gathered.chain)?, row.name.into()];
    let mark = watermark(inputs.iter().map(String::as_str));
    let hold_out = arguments.logs.hold_out;
    let calibration = Calibration::fit(row, gathered.presses, gathered.chain, hold_out, arguments.coverage, mark)?;
    calibration.write(&arguments.out)?;
    let scores = calibration.scores();
    let [rmse, median, worst] = [scores.rmse_m, scores.median_m, scores.worst_m].map(|error| millimetres(Some(error)));
    let mut text =
        format!("{} presses, held out: RMSE {rmse}, median {median}, worst {worst} mm\n", calibration.presses().len());
    for &number in &scores.suspicious {
        let press = &calibration.presses()[number - 1];
        let at = press.onset_s.map_or(String::new(), |onset_s| format!(" at {onset_s:.3} s"));
        let distance = millimetres(Some(press.distance_m));
        text.push_str(&format!("press {number} of {}{at}: labelled {distance} mm, suspicious\n", press.log));
    }
    text.push_str(&format!("{}\n", arguments.out.display()));
    print(&text)?;
    Ok(ExitCode::SUCCESS)
}
