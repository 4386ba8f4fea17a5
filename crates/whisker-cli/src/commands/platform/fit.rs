//! `whisker platform fit`: a calibration from recorded logs.

use std::path::PathBuf;
use std::process::ExitCode;

use files::{check_replaces_own, is_of_kind};
use platform::calibration::regression::{REGRESSIONS, RegressionRow, by_places};
use platform::calibration::{Calibration, Error, KIND, LabelledPress};
use testbed::provenance::watermark;

use super::super::output::reserve;
use super::super::{print, table::millimetres};
use super::logs::{LogArguments, Validating, row};

/// Fit a regression of the radial contact distance to recorded presses
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    logs: LogArguments,
    /// File to write the calibration to
    #[arg(long)]
    out: PathBuf,
    /// Regression; `whisker list` names them [default: the one with the smallest error at held-out inner places]
    #[arg(long)]
    regression: Option<String>,
    /// Probability with which the prediction interval contains the truth
    #[arg(long, default_value_t = 0.95)]
    coverage: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let stated = arguments.regression.as_deref().map(row).transpose()?;
    let _lock = reserve(&arguments.out, &arguments.logs.files()?)?;
    check_replaces_own(&arguments.out, "a calibration of the platform", |path| is_of_kind(path, KIND))?;
    // All regressions that can be chosen share one detection of presses.
    let gathered = arguments.logs.gather(stated.unwrap_or(&REGRESSIONS[0]))?;
    let mut validating = Validating::new();
    let (row, mut text) = match stated {
        Some(row) => (row, String::new()),
        None => chosen(&gathered.presses, &mut validating)?,
    };
    let inputs = [serde_json::to_string(&gathered.presses)?, serde_json::to_string(&gathered.chain)?, row.name.into()];
    let mark = watermark(inputs.iter().map(String::as_str));
    let hold_out = arguments.logs.hold_out;
    let mut progress = |done, all| validating.show(done, all);
    let calibration = Calibration::fit_with(
        row,
        gathered.presses,
        gathered.chain,
        hold_out,
        arguments.coverage,
        mark,
        &mut progress,
    )?;
    validating.clear();
    calibration.write(&arguments.out)?;
    let scores = calibration.scores();
    let [rmse, median, worst] = [scores.rmse_m, scores.median_m, scores.worst_m].map(|error| millimetres(Some(error)));
    text.push_str(&format!(
        "{} presses, held out: RMSE {rmse}, median {median}, worst {worst} mm\n",
        calibration.presses().len()
    ));
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

/// The regression with the smallest error at held-out inner places, and a line with the errors of all.
fn chosen(presses: &[LabelledPress], validating: &mut Validating) -> anyhow::Result<(&'static RegressionRow, String)> {
    let candidates = by_places(presses, &mut |done, all| validating.show(done, all));
    validating.clear();
    let listed = candidates.iter().filter_map(|candidate| {
        let rmse_m = candidate.rmse_m.as_ref().ok()?;
        Some(format!("{} {}", candidate.row.name, millimetres(Some(*rmse_m))))
    });
    let listed = listed.collect::<Vec<_>>().join(", ");
    match candidates.into_iter().next() {
        Some(best) if best.rmse_m.is_ok() => {
            Ok((best.row, format!("{}: smallest RMSE at held-out inner places: {listed} mm\n", best.row.name)))
        }
        Some(best) => Err(best.rmse_m.err().unwrap_or(Error::Undetermined(best.row.name)).into()),
        None => unreachable!("the registry has live regressions"),
    }
}
