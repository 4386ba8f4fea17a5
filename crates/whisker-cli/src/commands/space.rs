//! Traces in space, for the commands `fit`, `evaluate` and `replay`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::bail;
use evaluation::participant::Program;
use evaluation::plausibility::{contradicted_rate, contradicted_rate_in_space};
use evaluation::space::evaluate::SpatialEvaluateSettings;
use evaluation::space::evaluate_into;
use evaluation::space::fit::{SpatialFitSettings, SpatialFitted, fit};
use files::{check_replaces_own, write_atomically};
use nalgebra::Vector2;
use serde_json::Value;
use testbed::dataset::{Dataset, calibrations};
use testbed::front_end::{FrontEndConfig, SpatialFrontEnd};
use testbed::results::csv_bytes;
use testbed::space::replay::{calibrated, knowledge, read_calibration, replay, samples};
use testbed::space::rows::{SpatialSummaryRow, SpatialTimesRow};
use testbed::space::{SpatialEstimateRow, largest_reading_n_m, spatial_estimate_row};
use trace::{Sidecar, SpatialCalibrationFile, SpatialSidecar, SpatialTrace, Trace, is_spatial};
use whisker::ReadingGate;
use whisker::events::TouchConfig;
use whisker::space::estimators::{Knowledge, Sample, TouchDetector};

use super::output::{begins_with, reserve};
use super::played::{InSpace, beside};
use super::progress::Progress;
use super::remarks::{NO_SENSOR, conclusion, few_estimates, note_noise, note_rate};
use super::{print, table};

/// Largest held-out error of a sensor model, relative to the largest reading, that a correct calibration has.
const MOST_HELDOUT: f64 = 0.05;

/// Fits the calibration traces and prints a table of the models.
pub(super) fn fit_in_space(
    dataset: &Dataset,
    settings: &SpatialFitSettings,
    stated_noise: Option<f64>,
    out: &Path,
) -> anyhow::Result<ExitCode> {
    let fitted = fit(dataset, settings, out, &Progress::of("fitting"))?;
    for reason in fitted.iter().flat_map(|whisker| &whisker.left_out) {
        eprintln!("left out: {reason}");
    }
    for reason in fitted.iter().flat_map(|whisker| &whisker.no_sensor) {
        eprintln!("{NO_SENSOR}: {reason}");
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
    for SpatialFitted { calibration, .. } in &fitted {
        note_noise(stated_noise, calibration.noise_fraction, &calibration.whisker.name);
        print_remarks(calibration);
    }
    for whisker in &fitted {
        let state = if whisker.is_new { "" } else { " (up to date)" };
        print(&format!("{}{state}\n", whisker.path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints which directions are not calibrated, and whether the held-out error is implausible.
fn print_remarks(calibration: &SpatialCalibrationFile) {
    let (domain, whisker) = (&calibration.domain, &calibration.whisker.name);
    let (calibrated, all) = (domain.calibrated_directions(), domain.directions);
    if calibrated < all {
        eprintln!(
            "note: whisker `{whisker}`: contacts in {calibrated} of {all} directions about the whisker; the others are not calibrated"
        );
    }
    let Some(model) = calibration.model(None) else { return };
    let share = model.heldout_rms_n_m / calibration.largest_reading_n_m;
    if share > MOST_HELDOUT {
        let [percent, most_percent] = [share, MOST_HELDOUT].map(|share| 100.0 * share);
        eprintln!(
            "warning: whisker `{whisker}`: found a held-out RMS of {percent:.0} % of the largest reading, expected at most \
             {most_percent:.0} %: the contacts, the poses or the parameters of the whisker may be wrong; run `whisker check`"
        );
    }
}

/// A trace in space as the input of an estimator.
pub(super) struct Prepared {
    pub(super) trace: SpatialTrace,
    pub(super) knowledge: Arc<Knowledge>,
    /// Readings with noise.
    pub(super) readings_n_m: Vec<Vector2<f64>>,
}

impl Prepared {
    /// A trace with the noise of the options and the calibration in this file.
    ///
    /// # Errors
    /// If the calibration cannot be read, or is one of another whisker or through another front end, or if the front end models a
    /// sensor and the trace is a recording of a real one.
    pub(super) fn new(trace: SpatialTrace, options: &InSpace, calibration: &Path) -> anyhow::Result<Self> {
        let noise = ReplayNoise::of(&trace.sidecar, &options.front_end)?;
        let file = read_calibration(calibration)?;
        Self::with_noise(trace, options, &noise, (calibration, &file))
    }

    fn with_noise(
        trace: SpatialTrace,
        options: &InSpace,
        noise: &ReplayNoise,
        (path, file): (&Path, &SpatialCalibrationFile),
    ) -> anyhow::Result<Self> {
        let added_sd_n_m = options.noise.unwrap_or(noise.default) * largest_reading_n_m([&trace]);
        let calibrated = calibrated(path, file, &trace.sidecar)?;
        let sensor = options.front_end.sensor(path, file)?;
        let readings_n_m = options.front_end.bending_n_m(&trace, added_sd_n_m, options.seed, sensor)?;
        let noise_sd_n_m = added_sd_n_m.hypot(noise.own_sd_n_m);
        let knowledge = knowledge(&calibrated, noise_sd_n_m, sensor, trace.sidecar.rate_hz);
        Ok(Self { trace, knowledge, readings_n_m })
    }
}

/// Noise of a trace in space.
struct ReplayNoise {
    /// Default noise to add, as a fraction of the trace's largest reading.
    default: f64,
    /// Standard deviation of the noise that the readings contain (N m).
    own_sd_n_m: f64,
}

impl ReplayNoise {
    /// That of a trace, which may be a recording.
    ///
    /// # Errors
    /// If it is a recording of a real sensor and the front end models one.
    fn of(sidecar: &SpatialSidecar, front_end: &SpatialFrontEnd) -> anyhow::Result<Self> {
        front_end.check_trace(sidecar)?;
        Ok(Self { default: front_end.default_noise(sidecar), own_sd_n_m: sidecar.own_noise_sd_n_m() })
    }

    /// That of a planar trace.
    ///
    /// # Errors
    /// As [`Self::of`].
    fn of_planar(planar: &Sidecar, front_end: &SpatialFrontEnd) -> anyhow::Result<Self> {
        let is_recorded = planar.recorded.is_some();
        if is_recorded && front_end.is_noisy() {
            bail!(
                "{}: found a recording of a real sensor, expected a simulated trace for the front end `{}`",
                planar.name,
                front_end.row.name
            );
        }
        let default = if is_recorded { 0.0 } else { front_end.row.noise };
        Ok(Self { default, own_sd_n_m: planar.own_noise_sd_n_m() })
    }
}

/// Default path of the calibration of a trace's whisker through a front end.
pub(super) fn calibration_of(trace: &Path, whisker: &str, front_end: &SpatialFrontEnd) -> PathBuf {
    calibrations(beside(trace), front_end.row.name).join(format!("{whisker}.json"))
}

/// Replays a trace through an estimator and writes the estimates, to stdout without `out`.
pub(super) fn replay_in_space(
    trace: &Path,
    options: &InSpace,
    calibration: Option<&Path>,
    out: Option<&Path>,
) -> anyhow::Result<ExitCode> {
    // A planar trace is given with a calibration in space, by `--space`.
    let (read, noise, lifted_by, rate) = match calibration {
        Some(calibration) if !is_spatial(trace)? => {
            let file = read_calibration(calibration)?;
            let SpatialCalibrationFile { whisker, suspension, poisson_ratio, .. } = &file;
            let mut planar = Trace::read(trace)?;
            // The number of segments is one of the simulated chain, which in space has fewer; it is no property of the wire.
            planar.sidecar.whisker.segments = whisker.segments;
            let noise = ReplayNoise::of_planar(&planar.sidecar, &options.front_end)?;
            let rate = contradicted_rate(&planar);
            (SpatialTrace::lifted(&planar, *suspension, *poisson_ratio), noise, Some(file), rate)
        }
        _ => {
            let read = SpatialTrace::read(trace)?;
            let noise = ReplayNoise::of(&read.sidecar, &options.front_end)?;
            let rate = contradicted_rate_in_space(&read);
            (read, noise, None, rate)
        }
    };
    let default = || calibration_of(trace, &read.sidecar.whisker.name, &options.front_end);
    let calibration = calibration.map_or_else(default, Path::to_path_buf);
    let inputs = ["csv", "json"].map(|extension| trace.with_extension(extension)).into_iter();
    let _lock = match out {
        Some(out) => {
            let lock = reserve(out, &inputs.chain([calibration.clone()]).collect::<Vec<_>>())?;
            let header = csv_bytes::<SpatialEstimateRow>(&[])?;
            check_replaces_own(out, "a table of estimates in space", |path| begins_with(path, &header))?;
            Some(lock)
        }
        None => None,
    };
    let file = lifted_by.map_or_else(|| read_calibration(&calibration), Ok)?;
    let Prepared { trace: read, knowledge, readings_n_m } =
        Prepared::with_noise(read, options, &noise, (&calibration, &file))?;
    let InSpace { row, config, .. } = options;
    let samples = samples(&read, &readings_n_m);
    let replayed = replay(row, config, &knowledge, &samples)?;
    let instants = read.recording.instants.iter().zip(&read.truth.instants);
    let rows: Vec<SpatialEstimateRow> = instants
        .zip(readings_n_m.iter().zip(&replayed.estimates))
        .map(|((now, truth), (reading, estimate))| {
            spatial_estimate_row(now, truth, &knowledge.calibrated, *reading, estimate.as_ref())
        })
        .collect();
    match out {
        Some(out) => write_atomically(out, &csv_bytes(&rows)?)?,
        None => print(&String::from_utf8(csv_bytes(&rows)?)?)?,
    }
    let gate = ReadingGate::new(knowledge.calibrated.largest_reading_n_m);
    let gated = readings_n_m.iter().filter(|reading_n_m| !gate.admits_both(reading_n_m)).count();
    if gated > 0 {
        let most_n_m = gate.most_n_m();
        eprintln!("gated: {gated} of {} readings, beyond the largest plausible one, {most_n_m:.2e} N m", rows.len());
    }
    let estimates = replayed.estimates.iter().flatten().count() as u64;
    let mut detector = TouchDetector::new(TouchConfig::default(), &knowledge);
    let touches = |sample: &&Sample| detector.step(sample).is_some_and(|(_, touches)| touches);
    let touching = samples.iter().filter(touches).count() as u64;
    if estimates == 0 {
        eprintln!(
            "no estimates: no touch was detected in {} rows, or its contact lies outside the calibration",
            rows.len()
        );
    } else if let Some(remark) = few_estimates(touching, estimates, &calibration.display().to_string()) {
        eprintln!("{remark}");
    }
    note_rate(&read.sidecar.name, rate.as_ref());
    Ok(ExitCode::SUCCESS)
}

/// Options of an evaluation in space.
pub(super) struct Evaluation {
    pub(super) estimators: Option<Vec<String>>,
    pub(super) config: BTreeMap<String, Value>,
    pub(super) noise: f64,
    pub(super) seeds: u64,
    pub(super) front_end: FrontEndConfig,
    pub(super) calibrations: Option<PathBuf>,
    pub(super) programs: Vec<Program>,
    /// Whether to replace a finished run with other settings.
    pub(super) force: bool,
}

/// Evaluates the trials, writes the tables into `folder` and prints the summary.
pub(super) fn evaluate_in_space(dataset: &Dataset, evaluation: Evaluation, folder: &Path) -> anyhow::Result<ExitCode> {
    let Evaluation { estimators, config, noise, seeds, front_end, calibrations, programs, force } = evaluation;
    let seeds = (1..=seeds).collect();
    let settings = SpatialEvaluateSettings { estimators, config, noise, seeds, front_end, calibrations, programs };
    let progress = Progress::of("evaluating");
    let written = evaluate_into(folder, dataset, &settings, force, &progress)?;
    drop(progress);
    let state = if written.is_new { "" } else { " (up to date)" };
    print(&format!("{}{}{state}\n", summary_table(&written.summary), folder.display()))?;
    if !written.mounted.is_empty() {
        let names = written.mounted.join(", ");
        eprintln!("note: the mounting was learnt from trials that are also scored: {names}");
    }
    if !written.unscored.is_empty() {
        let names = written.unscored.join(", ");
        eprintln!(
            "note: not scored, since no known contact lies in the calibrated domain a second after a touch or later: {names}"
        );
    }
    written.remarks.lines().iter().for_each(|remark| eprintln!("note: {remark}"));
    for SpatialTimesRow { estimator, mean_us, p99_us, .. } in written.times.iter().filter(|_| written.is_new) {
        match mean_us.zip(*p99_us) {
            Some((mean_us, p99_us)) => {
                eprintln!("{estimator}: {mean_us:.0} us per step, 99th percentile {p99_us:.0} us")
            }
            None => eprintln!("{estimator}: no estimate"),
        }
    }
    Ok(conclusion(&written.failures))
}

/// Table of the summary, errors in millimetres and degrees, with the NEES by which the verdict is found. Quantities that no set has
/// are left out.
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
        "bound of an unknown object, mm",
        "NEES",
        "in 95 %",
        "in 95 %, first second",
        "surface, mm",
        "normal, deg",
        "direction, deg",
        "its bound, deg",
        "radius error, %",
        "radius in 95 %",
        "edge, mm",
        "corner, mm",
        "doubted",
        "verdict",
    ];
    let degrees = |angle_rad: Option<f64>| table::number(angle_rad.map(f64::to_degrees));
    let row = |row: &SpatialSummaryRow| {
        vec![
            row.group.clone(),
            row.whisker.clone(),
            row.estimator.clone(),
            row.trials.to_string(),
            table::percent(row.answered),
            table::millimetres(row.rmse_m),
            table::millimetres(row.out_of_plane_m),
            table::millimetres(row.bound_m),
            table::millimetres(row.object_bound_m),
            table::number(row.nees_mean),
            table::percent(row.coverage),
            table::percent(row.early_coverage),
            table::millimetres(row.surface_m),
            degrees(row.normal_rad),
            degrees(row.direction_rad),
            degrees(row.direction_bound_rad),
            table::number(row.radius_error.map(|error| 100.0 * error)),
            table::percent(row.radius_coverage),
            table::millimetres(row.edge_m),
            table::millimetres(row.corner_m),
            table::percent(row.doubted),
            row.verdict.clone().unwrap_or_default(),
        ]
    };
    let mut rows: Vec<Vec<String>> = summary.iter().map(row).collect();
    let is_known = |column: &usize| rows.is_empty() || rows.iter().any(|row| row[*column] != table::UNKNOWN);
    let known: Vec<usize> = (0..header.len()).filter(is_known).collect();
    let header: Vec<&str> = known.iter().map(|&column| header[column]).collect();
    rows = rows.into_iter().map(|row| known.iter().map(|&column| row[column].clone()).collect()).collect();
    table::render(&header, &rows, 3)
}

#[cfg(test)]
mod tests {
    use trace::Recorded;

    use super::*;

    #[test]
    fn verif_no_noise_is_added_to_recorded_readings() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.json");
        let mut sidecar = Sidecar::read(&golden).unwrap();
        let front_end = |name: &str| {
            SpatialFrontEnd::new(&FrontEndConfig { name: name.into(), ..FrontEndConfig::default() }).unwrap()
        };
        let white = front_end("white");
        let of = |sidecar: &Sidecar| {
            let ReplayNoise { default, own_sd_n_m } = ReplayNoise::of_planar(sidecar, &white).unwrap();
            (default, own_sd_n_m)
        };
        assert_eq!(of(&sidecar), (white.row.noise, 0.0));
        sidecar.recorded = Some(Recorded {
            clock: "none".into(),
            characteristic: [1.0, 0.0, 0.0],
            range_n_m: None,
            residual_counts: 1.0,
            rest_counts: 0.0,
            noise_sd_n_m: 1e-7,
            touch_counts: 1.0,
            object_class: None,
        });
        assert_eq!(of(&sidecar), (0.0, 1e-7));
        let text = ReplayNoise::of_planar(&sidecar, &front_end("hall")).err().expect("a recording").to_string();
        assert!(text.contains("found a recording of a real sensor, expected a simulated trace"), "{text}");
    }
}
