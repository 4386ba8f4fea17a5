//! `whisker check`: validation of files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use evaluation::plausibility::{Subject, spatial_findings};
use evaluation::remarks::named;
use files::read_json;
use rayon::prelude::*;
use recorded::benchmark::{FaceScore, MapScore, PinSummary, SettingsUsed, SweepScore};
use recorded::pins::PinScore;
use serde_json::Value;
use testbed::dataset::{Dataset, calibrations};
use testbed::front_end::FRONT_ENDS;
use testbed::results::files::{self as plane, Rows, RunFile, certain_files, run_file};
use testbed::results::{RUN_FILES, ResultsKind, Run, read_rows};
use testbed::space::files::{self as space, SPATIAL_RUN_FILES};
use testbed::space::run::SpatialRun;
use trace::{
    ArrayRecording, Breach, CalibrationFile, Certificate, Outline, SensorFile, SpatialCalibrationFile,
    SpatialCertificate, SpatialTrace, Suite, Trace, is_spatial, is_trace_table,
};

use super::{print, python};
use crate::claims::MeasuredClaim;

/// Validate files of the project: traces, outlines, calibrations, scenes, suites, runs, tables of `whisker recordings`
///
/// Of a run, the tables in its subfolders are read too, and named only if they are damaged.
///
/// A trace is also tested for errors of unit, sign, frame and rate: twist against poses, rate_hz against times, face
/// and size of the moment against whisker, calibration and true contact. A suite is compared with its traces in
/// datasets/<suite>, if they have been simulated.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Files, or folders of traces
    #[arg(required = true)]
    paths: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let mut failed = false;
    for path in expanded(&arguments.paths)? {
        match check(&path) {
            Ok(what) => print(&format!("{}: {what}\n", path.display()))?,
            Err(error) => {
                failed = true;
                eprintln!("error: {error:#}");
            }
        }
        for error in damaged_tables(&path)? {
            failed = true;
            eprintln!("error: {error:#}");
        }
    }
    Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The given files, and the CSV and JSON files of given folders, except for tables of other programs. A trace and its sidecar count
/// once.
fn expanded(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path)? {
            let file = entry?.path();
            let is_json = file.extension().is_some_and(|extension| extension == "json");
            let is_csv = file.extension().is_some_and(|extension| extension == "csv");
            if (is_csv && is_own_table(&file)) || (is_json && !file.with_extension("csv").is_file()) {
                inside.push(file);
            }
        }
        inside.extend(missing_description(path));
        if inside.is_empty() {
            bail!("{}: no CSV or JSON files", path.display());
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

/// Path of the description of a run whose folder has the files of its trials but not the description, so that its absence is
/// reported.
fn missing_description(folder: &Path) -> Option<PathBuf> {
    let kinds = [(plane::RUN, plane::TRIALS, plane::ESTIMATES), (space::RUN, space::TRIALS, space::ESTIMATES)];
    let lacks_it = |(description, trials, estimates): &(RunFile, RunFile, RunFile)| {
        let of_estimates = estimates.name.split_once('/').map_or(estimates.name, |(folder, _)| folder);
        !description.path(folder).exists() && trials.path(folder).is_file() && folder.join(of_estimates).is_dir()
    };
    kinds.into_iter().find(lacks_it).map(|(description, ..)| description.path(folder))
}

/// Whether a CSV file in a folder has a sidecar, or is a trace without one or another table of the formats. A file that cannot be
/// read counts, so that it is reported.
fn is_own_table(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_extension("json").is_file()
        || PARTS.iter().any(|ending| name.ends_with(ending))
        || is_trace_table(path).unwrap_or(true)
        || !matches!(check_table(path), Ok(None))
}

fn check(path: &Path) -> anyhow::Result<String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if let Some(found) = check_table(path)? {
        return Ok(found);
    }
    if [plane::RUN.name, space::RUN.name].contains(&&*name) && !path.exists() {
        bail!(
            "{}: no such file, expected the description of the run; restore it, or move the folder away and evaluate again",
            path.display()
        );
    }
    if name == space::RUN.name {
        let run: SpatialRun = read_json(path)?;
        let extent = check_run_files(path, &run.files(), space::TRIALS)?;
        return Ok(format!("run in space `{}` of {} estimators{extent}", run.name, run.estimators.len()));
    }
    if name == ResultsKind::Recordings.file() {
        let settings: SettingsUsed = read_json(path)?;
        return Ok(format!("settings of `whisker recordings` on {} calibrations", settings.kernels.len()));
    }
    for ending in PARTS {
        if name.ends_with(ending) {
            return check_part(path, ending);
        }
    }
    if name.ends_with(".csv") {
        return check_trace(path);
    }
    let value: Value = read_json(path)?;
    match value.get("kind").and_then(Value::as_str) {
        Some("trace") => check_trace(path),
        Some("recording") => check_recording(path),
        Some("calibration") if is_spatial(path)? => check_spatial_calibration(path),
        Some("calibration") => check_calibration(path),
        Some("run") => {
            let run = Run::read(path)?;
            let expected = certain_files(&run, path.parent().unwrap_or(Path::new("")));
            let extent = check_run_files(path, &expected, plane::TRIALS)?;
            Ok(format!("run `{}` of {} estimators{extent}", run.name, run.estimators.len()))
        }
        Some(other) => {
            bail!("{}: kind: found `{other}`, expected that of {FILES}", path.display())
        }
        None => check_without_kind(path, &value),
    }
}

/// Largest number of missing files that an error names.
const MOST_NAMED: usize = 20;

/// Checks that the folder of a run's description has the expected files of the run. A folder without any file of single trials,
/// neither their table nor files in folders of the run, is an excerpt, as in `results/reference`, and need not have the other
/// tables. Returns what is to be added to the printed description of the run.
///
/// # Errors
/// If files are missing.
fn check_run_files(description: &Path, expected: &[String], trials: RunFile) -> anyhow::Result<&'static str> {
    let (there, missing): (Vec<&String>, Vec<&String>) =
        expected.iter().partition(|name| description.with_file_name(name).is_file());
    if missing.is_empty() {
        return Ok("");
    }
    if !there.iter().any(|name| **name == trials.name || name.contains('/')) {
        return Ok(", an excerpt without its trials");
    }
    bail!(
        "{}: found a run without {}, expected all files of the run; run the same `whisker evaluate` again",
        description.display(),
        named(&missing, MOST_NAMED)
    )
}

/// Errors of the tables in the subfolders of a run, if the path is that of its description. They may be thousands, one for each
/// trace and estimator, so that those without errors are not listed.
///
/// # Errors
/// If a folder cannot be read.
fn damaged_tables(description: &Path) -> anyhow::Result<Vec<anyhow::Error>> {
    let registries = [(plane::RUN, RUN_FILES), (space::RUN, SPATIAL_RUN_FILES)];
    let of_this = registries.into_iter().find(|(run, _)| description.file_name().is_some_and(|name| name == run.name));
    let Some((_, registry)) = of_this else { return Ok(Vec::new()) };
    let folders: BTreeSet<&str> =
        registry.iter().filter_map(|file| Some(file.name.split_once('/')?.0).filter(|_| file.rows.is_some())).collect();
    let mut tables: Vec<(PathBuf, Rows)> = Vec::new();
    for name in folders {
        let folder = description.with_file_name(name);
        if !folder.is_dir() {
            continue;
        }
        for entry in std::fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
            let path = entry.with_context(|| folder.display().to_string())?.path();
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            let in_run = format!("{name}/{file}");
            let rows = registry.iter().filter(|file| file.is_at(&in_run)).find_map(|file| file.rows);
            tables.extend(rows.map(|rows| (path, rows)));
        }
    }
    tables.sort_by(|(one, _), (other, _)| one.cmp(other));
    Ok(tables.par_iter().filter_map(|(path, rows)| rows.counted(path).err()).collect())
}

fn check_spatial_calibration(path: &Path) -> anyhow::Result<String> {
    let calibration = SpatialCalibrationFile::read(path)?;
    let calibrated = calibration.calibrated(path, None)?;
    let share = 100.0 * calibrated.heldout_rms_n_m / calibrated.largest_reading_n_m;
    let (whisker, label) = (&calibration.whisker.name, &calibrated.label);
    let through = match (&calibration.front_end, &calibration.sensor) {
        (Some(front_end), _) => format!("; through `{}`", front_end.name),
        (None, Some(_)) => "; with the sensor of its recordings".into(),
        (None, None) => String::new(),
    };
    Ok(format!(
        "calibration in space of `{whisker}`: {label}, held-out RMS {share:.3} % of the largest reading{through}"
    ))
}

fn check_calibration(path: &Path) -> anyhow::Result<String> {
    let calibration = CalibrationFile::read(path)?;
    let faces: Vec<String> = calibration
        .faces
        .iter()
        .filter_map(|face| {
            let model = face.model(None)?;
            let share = 100.0 * model.heldout_rms_n_m / face.largest_reading_n_m;
            let (face, label) = (face.face.name(), &model.label);
            Some(format!("{face} ({label}, held-out RMS {share:.3} % of the largest reading)"))
        })
        .collect();
    let labels: Vec<_> = calibration.sensors().map(SensorFile::label).collect();
    let sensors = match &calibration.front_end {
        Some(front_end) => format!("; through `{}`, sensors {}", front_end.name, labels.join(", ")),
        None if labels.is_empty() => String::new(),
        None => format!("; sensor {} of recordings", labels.join(", ")),
    };
    Ok(format!("calibration of `{}`: {}{sensors}", calibration.whisker.name, faces.join(", ")))
}

/// Checks a suite or a scene, which state no kind.
fn check_without_kind(path: &Path, value: &Value) -> anyhow::Result<String> {
    if value.get("scenes").is_some() {
        let suite = Suite::read(path)?;
        let runs = suite.runs(path)?.len();
        Dataset::check_simulated(path)?;
        check_scene(path)?;
        return Ok(format!("suite `{}` of {runs} runs of scenes", suite.name));
    }
    if value.get("random").is_some() {
        let suite = Suite::read(path)?;
        let sets = suite.random.map_or(0, |random| random.sets);
        Dataset::check_simulated(path)?;
        check_scene(path)?;
        return Ok(format!("random suite `{}` of {sets} sets", suite.name));
    }
    if value.get("whisker").is_some() {
        check_scene(path)?;
        return Ok("scene".into());
    }
    bail!("{}: found none of the keys kind, scenes, random and whisker, expected those of {FILES}", path.display())
}

/// JSON files that can be checked: by their kind, then by their keys.
const FILES: &str = "a trace, recording, calibration or run, or a suite or scene, which states no kind";

/// A table that is no file of a run.
struct Table {
    /// Whole name, or end of the name.
    end: &'static str,
    rows: Rows,
}

/// A table with the columns of a row type.
macro_rules! table {
    ($end:literal, $row:ident, $label:literal, $may_be_empty:literal) => {
        Table {
            end: $end,
            rows: Rows {
                of: stringify!($row),
                label: $label,
                count: |path| Ok(read_rows::<$row>(path)?.len()),
                may_be_empty: $may_be_empty,
            },
        }
    };
}

/// Ends of the names of further tables of a recording of several whiskers.
const PARTS: [&str; 2] = [".joints.csv", ".objects.csv"];

const OTHER_TABLES: [Table; 2] = [
    Table {
        end: ".contour.csv",
        rows: Rows {
            of: "Outline",
            label: "outline",
            count: |path| Ok(Outline::read(path)?.vertices().len()),
            may_be_empty: false,
        },
    },
    table!("claims.csv", MeasuredClaim, "claims", false),
];

/// Tables of `whisker recordings`. A clone may hold no trials with pins and no sweeps.
const RECORDED_TABLES: [Table; 6] = [
    table!("space_maps.csv", MapScore, "sensor models of recordings", false),
    table!("space_pins.csv", PinScore, "pins of recordings", true),
    table!("space_pins_summary.csv", PinSummary, "summary of the pins of recordings", true),
    table!("space_sweeps.csv", SweepScore, "sweeps of recordings", true),
    table!("space_sweeps_paper.csv", SweepScore, "sweeps of recordings by the published filter", true),
    table!("space_faces.csv", FaceScore, "faces of the objects of recordings", true),
];

/// Parses a table that generator, fit or evaluation writes. `None` if the path is not that of one.
fn check_table(path: &Path) -> anyhow::Result<Option<String>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let other = || OTHER_TABLES.iter().find(|table| name.ends_with(table.end)).map(|table| table.rows);
    let recorded = || RECORDED_TABLES.iter().find(|table| name == table.end).map(|table| table.rows);
    let of_run = |registry| run_file(registry, path).and_then(|file| file.rows);
    // Runs in space have a table of the same name as one of the recordings.
    let is_recorded = path.parent().is_some_and(|folder| ResultsKind::Recordings.is_in(folder));
    let known = other().or_else(|| recorded().filter(|_| is_recorded));
    let known = known.or_else(|| of_run(SPATIAL_RUN_FILES)).or_else(|| of_run(RUN_FILES)).or_else(recorded);
    let Some(rows) = known else { return Ok(None) };
    Ok(Some(format!("{} with {} rows", rows.label, rows.counted(path)?)))
}

/// Checks a recording of several whiskers with all its files.
fn check_recording(path: &Path) -> anyhow::Result<String> {
    let array = ArrayRecording::read(path)?;
    for whisker in &array.sidecar.whiskers {
        let path = path.with_file_name(format!("{}.csv", whisker.trace));
        array.check(&path, &Trace::read(&path)?)?;
    }
    let (whiskers, objects) = (array.sidecar.whiskers.len(), array.sidecar.objects.len());
    let last = array.joints.last().map_or(0.0, |joints| joints.t_s);
    let moved_mm = 1e3 * array.moved_m.iter().copied().fold(0.0, f64::max);
    let name = &array.sidecar.name;
    Ok(format!(
        "recording `{name}` of {whiskers} whiskers among {objects} objects, {last:.2} s, displaced by {moved_mm:.4} mm at most"
    ))
}

/// Checks the recording to which a table of joints or objects belongs: the table cannot be checked by itself.
fn check_part(path: &Path, ending: &str) -> anyhow::Result<String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let recording = path.with_file_name(format!("{}.json", name.trim_end_matches(ending)));
    ArrayRecording::read(&recording)?;
    Ok(format!("part of {}", recording.display()))
}

fn check_trace(path: &Path) -> anyhow::Result<String> {
    if is_spatial(path)? {
        return check_spatial_trace(path);
    }
    let trace = Trace::read(path)?;
    let sidecar = &trace.sidecar;
    let folder = path.parent().unwrap_or(Path::new("."));
    trace.outline(folder)?;
    let beside = calibrations(folder, FRONT_ENDS[0].name).join(format!("{}.json", sidecar.whisker.name));
    let calibration = if beside.is_file() { Some(CalibrationFile::read(&beside)?) } else { None };
    let findings = Subject::new(&trace, calibration.as_ref()).findings();
    refuse(&path.with_extension("csv"), findings.iter().map(ToString::to_string))?;
    let last = trace.recording.instants.last().map_or(0.0, |instant| instant.t_s);
    let truth = touching(trace.truth.instants.iter().map(|truth| truth.touching));
    let certificate = match &sidecar.certificate {
        None => String::new(),
        Some(certificate) => format!(", {}", certified(path, certificate)?),
    };
    Ok(format!("trace `{}`, {} rows, {last:.2} s, {truth}{certificate}", sidecar.name, sidecar.rows))
}

fn check_spatial_trace(path: &Path) -> anyhow::Result<String> {
    let trace = SpatialTrace::read(path)?;
    refuse(&path.with_extension("csv"), spatial_findings(&trace).iter().map(ToString::to_string))?;
    let sidecar = &trace.sidecar;
    let last = trace.recording.instants.last().map_or(0.0, |instant| instant.t_s);
    let truth = touching(trace.truth.instants.iter().map(|truth| truth.touching));
    let certificate = match &sidecar.certificate {
        None => String::new(),
        Some(certificate) => format!(", {}", certified_in_space(path, certificate)?),
    };
    Ok(format!("trace in space `{}`, {} rows, {last:.2} s, {truth}{certificate}", sidecar.name, sidecar.rows))
}

/// Refuses a file for these reasons, if there are any.
fn refuse(file: &Path, reasons: impl Iterator<Item = String>) -> anyhow::Result<()> {
    let reasons: Vec<String> = reasons.collect();
    if !reasons.is_empty() {
        bail!("{}: {}", file.display(), reasons.join("; "));
    }
    Ok(())
}

/// Share of the rows in contact, as text. If the truth of some rows is unknown, as in recordings, the numbers of rows.
fn touching(rows: impl Iterator<Item = Option<bool>>) -> String {
    let (mut touching, mut free, mut unknown) = (0, 0, 0);
    rows.for_each(|row| match row {
        Some(true) => touching += 1,
        Some(false) => free += 1,
        None => unknown += 1,
    });
    match (touching + free, unknown) {
        (0, _) => "truth unknown".into(),
        (known, 0) => format!("touching {:.0} %", 100.0 * f64::from(touching) / f64::from(known)),
        _ => format!("touching in {touching} rows, free in {free}, unknown in {unknown}"),
    }
}

/// The certificate of a trace in space in one line.
///
/// # Errors
/// If a figure exceeds its bound.
fn certified_in_space(path: &Path, certificate: &SpatialCertificate) -> anyhow::Result<String> {
    refuse_breaches(path, &certificate.breaches())?;
    let apart = apart(certificate.tip, certificate.split);
    let (Some(moment_rms), Some(surface_rms_m), Some(normal_rms_rad)) =
        (certificate.moment_rms, certificate.surface_rms_m, certificate.normal_rms_rad)
    else {
        return Ok(format!("not certified: no quasi-static contact{apart}"));
    };
    Ok(format!(
        "from theory at {} instants: moment {:.3} % RMS, surface contact {:.4} mm RMS, normal {:.4} degrees RMS{apart}",
        certificate.sampled,
        100.0 * moment_rms,
        1e3 * surface_rms_m,
        normal_rms_rad.to_degrees()
    ))
}

/// Refuses a certificate with figures that exceed their bounds.
fn refuse_breaches(path: &Path, breaches: &[Breach]) -> anyhow::Result<()> {
    let breach = |breach: &Breach| {
        format!("certificate.{}: found {:e}, expected at most {:e}", breach.key, breach.found, breach.bound)
    };
    refuse(&path.with_extension("json"), breaches.iter().map(breach))
}

/// Numbers of rows at the tip and at separate points, if there are any.
fn apart(tip: usize, split: usize) -> String {
    let rows = [("tip", tip), ("split", split)].into_iter().filter(|(_, rows)| *rows > 0);
    rows.map(|(what, rows)| format!(" ({rows} rows {what})")).collect()
}

/// The certificate in one line.
///
/// # Errors
/// If a figure exceeds its bound.
fn certified(path: &Path, certificate: &Certificate) -> anyhow::Result<String> {
    refuse_breaches(path, &certificate.breaches())?;
    let apart = apart(certificate.tip, certificate.split);
    let (Some(moment_rms), Some(surface_rms_m), Some(surface_worst_m)) =
        (certificate.moment_rms, certificate.surface_rms_m, certificate.surface_worst_m)
    else {
        return Ok(format!("not certified: no quasi-static contact{apart}"));
    };
    Ok(format!(
        "from theory at {} instants: moment {:.3} % RMS, surface contact {:.4} mm RMS, {:.4} mm worst{apart}",
        certificate.sampled,
        100.0 * moment_rms,
        1e3 * surface_rms_m,
        1e3 * surface_worst_m
    ))
}

/// Checks a scene with the generator, which alone defines shapes and motions.
fn check_scene(path: &Path) -> anyhow::Result<()> {
    let output = python::generator(["check".as_ref(), path.as_os_str()])?.output()?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    bail!("{}", text.trim().trim_start_matches("error: "));
}
