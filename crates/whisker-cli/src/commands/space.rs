//! Fit and evaluation of traces in space, for the commands `fit` and `evaluate`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::Value;
use testbed::dataset::Dataset;
use testbed::space::evaluate::{SpatialEvaluateSettings, SpatialSummaryRow};
use testbed::space::evaluate_into;
use testbed::space::fit::{SpatialFitSettings, SpatialFitted, fit};

use super::progress::Progress;
use super::{print, table};

/// Fits the calibration traces and prints a table of the models.
pub(super) fn fit_in_space(dataset: &Dataset, settings: &SpatialFitSettings, out: &Path) -> anyhow::Result<ExitCode> {
    let fitted = fit(dataset, settings, out, &Progress::of("fitting"))?;
    for reason in fitted.iter().flat_map(|whisker| &whisker.left_out) {
        eprintln!("left out: {reason}");
    }
    let mut rows = Vec::new();
    for SpatialFitted { calibration, .. } in &fitted {
        for model in &calibration.models {
            let percent = |reading: f64| format!("{:.4} %", 100.0 * reading / calibration.largest_reading_n_m);
            let is_chosen = model.label == calibration.chosen;
            rows.push(vec![
                calibration.whisker.name.clone(),
                model.label.clone(),
                percent(model.heldout_rms_n_m),
                percent(model.heldout_worst_n_m),
                if is_chosen { "chosen".into() } else { String::new() },
            ]);
        }
    }
    print(&table::render(&["whisker", "model", "held-out RMS", "held-out worst", "choice"], &rows, 2))?;
    for whisker in &fitted {
        let state = if whisker.is_new { "" } else { " (up to date)" };
        print(&format!("{}{state}\n", whisker.path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Options of an evaluation in space.
pub(super) struct Evaluation {
    pub(super) estimators: Option<Vec<String>>,
    pub(super) config: BTreeMap<String, Value>,
    pub(super) noise: f64,
    pub(super) seeds: u64,
    pub(super) calibrations: Option<PathBuf>,
    /// Whether to replace a finished run with other settings.
    pub(super) force: bool,
}

/// Evaluates the trials, writes the tables into `folder` and prints the summary.
pub(super) fn evaluate_in_space(dataset: &Dataset, evaluation: Evaluation, folder: &Path) -> anyhow::Result<ExitCode> {
    let Evaluation { estimators, config, noise, seeds, calibrations, force } = evaluation;
    let settings = SpatialEvaluateSettings { estimators, config, noise, seeds: (1..=seeds).collect(), calibrations };
    let progress = Progress::of("evaluating");
    let written = evaluate_into(folder, dataset, &settings, force, &progress)?;
    drop(progress);
    let state = if written.step_us.is_some() { "" } else { " (up to date)" };
    print(&format!("{}{}{state}\n", summary_table(&written.summary), folder.display()))?;
    for (estimator, step_us) in written.step_us.into_iter().flatten() {
        match step_us {
            Some(step_us) => eprintln!("{estimator}: {step_us:.0} us per step"),
            None => eprintln!("{estimator}: no estimate"),
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Table of the summary, errors in millimetres and degrees.
fn summary_table(summary: &[SpatialSummaryRow]) -> String {
    let header = [
        "group",
        "whisker",
        "estimator",
        "trials",
        "answered",
        "RMSE, mm",
        "out of plane, mm",
        "bound, mm",
        "bound of a rod, mm",
        "NEES",
        "its 95 % interval",
        "in 95 %",
        "normal, deg",
        "direction, deg",
        "its bound, deg",
    ];
    let degrees = |angle_rad: Option<f64>| table::number(angle_rad.map(f64::to_degrees));
    let row = |row: &SpatialSummaryRow| {
        vec![
            row.group.clone(),
            row.whisker.clone(),
            row.estimator.clone(),
            row.trials.to_string(),
            table::percent(Some(row.answered)),
            table::millimetres(row.rmse_m),
            table::millimetres(row.out_of_plane_m),
            table::millimetres(row.bound_m),
            table::millimetres(row.rod_bound_m),
            table::number(row.nees),
            format!("{:.2} to {:.2}", row.nees_low, row.nees_high),
            table::percent(row.coverage),
            degrees(row.normal_rad),
            degrees(row.direction_rad),
            degrees(row.direction_bound_rad),
        ]
    };
    table::render(&header, &summary.iter().map(row).collect::<Vec<_>>(), 3)
}
