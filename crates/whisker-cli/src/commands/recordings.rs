//! `whisker recordings`: the benchmark on recordings of real sensors in space.

use std::path::PathBuf;
use std::process::ExitCode;
use std::slice;

use recorded::benchmark::{FaceScore, MapScore, PAPER, PinSummary, SweepScore, run as evaluate};
use testbed::results::ResultsKind;

use super::output::reserve_folder;
use super::{FINISHED_WITH_FAILURES, print, table};

/// Evaluate sensor models and estimators in space on recordings of HaoLiRobo/WhiskerSensing
///
/// Sensor models are fitted to the labelled contacts of the calibrations and compared on held-out lines. Contacts are estimated
/// on held-out lines and trials with pins, and on sweeps over objects with published meshes (docs/REAL.md).
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Clone of the repository
    folder: PathBuf,
    /// Folder for the tables
    #[arg(long, default_value = "results/recordings")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let _lock = reserve_folder(&arguments.out, slice::from_ref(&arguments.folder))?;
    ResultsKind::Recordings.check_may_replace(&arguments.out)?;
    let found = evaluate(&arguments.folder, &arguments.out, &|name| eprintln!("{name}"))?;
    let map = |row: &MapScore| {
        let percent = |share: f64| format!("{:.2} %", 100.0 * share);
        let counts = vec![row.samples.to_string(), row.outliers.to_string()];
        let errors = vec![percent(row.heldout_rms), percent(row.heldout_worst), table::number(Some(row.nees))];
        [vec![row.calibration.clone(), row.model.clone()], counts, errors].concat()
    };
    let header = ["calibration", "model", "samples", "outliers", "held-out RMS", "worst", "NEES"];
    print(&table::render(&header, &found.maps.iter().map(map).collect::<Vec<_>>(), 2))?;
    let pins = |row: &PinSummary| {
        let head =
            vec![row.group.clone(), row.estimator.clone(), row.pins.to_string(), table::percent(Some(row.answered))];
        let errors = [row.mean_m, row.median_m, row.worst_m].map(|error_m| table::millimetres(Some(error_m)));
        [head, errors.into(), vec![table::number(Some(row.nees)), table::percent(Some(row.coverage))]].concat()
    };
    let header = ["pins", "estimator", "pins", "answered", "mean, mm", "median, mm", "worst, mm", "NEES", "in 95 %"];
    print(&format!("\n{}", table::render(&header, &found.summary().iter().map(pins).collect::<Vec<_>>(), 2)))?;
    let sweep = |row: &SweepScore| {
        let lengths = [row.extent_m, row.mean_m, row.p95_m, row.vertex_mean_m, row.shifted_mean_m, row.shift_m];
        let head = vec![row.name.clone(), table::percent(Some(row.answered)), table::percent(row.reach)];
        [head, lengths.map(table::millimetres).into()].concat()
    };
    let header = "sweep, answered, reach, extent mm, mean mm, 95 % mm, vertex mm, mean shifted mm, shift mm";
    for (estimator, sweeps) in [("batch", &found.sweeps), (PAPER, &found.paper_sweeps)] {
        let header: Vec<&str> = header.split(", ").collect();
        let rows: Vec<Vec<String>> = sweeps.iter().map(sweep).collect();
        print(&format!("\n{estimator}\n{}", table::render(&header, &rows, 1)))?;
    }
    let face = |row: &FaceScore| {
        let normal = format!("{:.2} {:.2} {:.2}", row.normal_x, row.normal_y, row.normal_z);
        let lengths = [row.offset_m, row.mean_m, row.p95_m].map(|length_m| table::millimetres(Some(length_m)));
        [vec![row.name.clone(), normal, row.contacts.to_string()], lengths.into()].concat()
    };
    let header = ["sweep", "normal of the face", "contacts", "offset mm", "mean mm", "95 % mm"];
    print(&format!("\n{}", table::render(&header, &found.faces.iter().map(face).collect::<Vec<_>>(), 2)))?;
    print(&format!("{}\n", arguments.out.display()))?;
    found.failures.iter().for_each(|failure| eprintln!("error: {failure}"));
    Ok(if found.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}
