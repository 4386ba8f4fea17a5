//! `whisker check`: whether a file is what it claims to be.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use files::read_json;
use serde::de::DeserializeOwned;
use serde_json::Value;
use testbed::results::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, FailureRow,
    GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, ResidualRow, Run, SummaryHead, SurfaceRow, TransferRow,
    TrialHead, TurnRow, VertexRow, read_rows, read_scores,
};
use trace::{ArrayRecording, CalibrationFile, Certificate, Outline, SensorFile, Suite, Trace};

use super::{print, python};
use crate::claims::MeasuredClaim;

/// Validate files of the project: traces, outlines, calibrations, scenes, suites, runs
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
    }
    Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The files themselves, and for a folder its CSV and JSON files; a trace and its sidecar count once.
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
            if is_csv || (is_json && !file.with_extension("csv").is_file()) {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            bail!("{}: no CSV or JSON files", path.display());
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

fn check(path: &Path) -> anyhow::Result<String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if let Some(table) = TABLES.iter().find(|table| table.mark.is_of(path)) {
        return Ok(format!("{} with {} rows", table.about, (table.rows)(path)?));
    }
    for ending in [".joints.csv", ".objects.csv"] {
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
        Some("calibration") => {
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
            let sensors = calibration.front_end.map_or_else(String::new, |front_end| {
                let sensors: Vec<_> = front_end.sensors.iter().map(SensorFile::label).collect();
                format!("; through `{}`, sensors {}", front_end.name, sensors.join(", "))
            });
            Ok(format!("calibration of `{}`: {}{sensors}", calibration.whisker.name, faces.join(", ")))
        }
        Some("run") => {
            let run = Run::read(path)?;
            Ok(format!("run `{}` of {} estimators", run.name, run.estimators.len()))
        }
        Some(other) => {
            bail!("{}: kind: found `{other}`, expected trace, recording, calibration or run", path.display())
        }
        None if value.get("scenes").is_some() => {
            let suite = Suite::read(path)?;
            let runs = suite.names(path)?.len();
            check_scene(path)?;
            Ok(format!("suite `{}` of {runs} runs of scenes", suite.name))
        }
        None => {
            check_scene(path)?;
            Ok("scene".into())
        }
    }
}

/// What a table is known by.
enum Mark {
    /// The whole name.
    Name(&'static str),
    /// The end of the name.
    End(&'static str),
    /// The folder that it lies in.
    Folder(&'static str),
}

impl Mark {
    fn is_of(&self, path: &Path) -> bool {
        match self {
            Self::Name(name) => path.file_name().is_some_and(|found| found == *name),
            Self::End(end) => path.file_name().is_some_and(|found| found.to_string_lossy().ends_with(end)),
            Self::Folder(folder) => {
                path.extension().is_some_and(|extension| extension == "csv")
                    && path.parent().is_some_and(|found| found.ends_with(folder))
            }
        }
    }
}

/// A table that generator, fit or evaluation writes.
struct Table {
    mark: Mark,
    about: &'static str,
    /// Parses it and counts its rows.
    rows: fn(&Path) -> anyhow::Result<usize>,
}

const TABLES: &[Table] = &[
    Table { mark: Mark::End(".contour.csv"), about: "outline", rows: count_vertices },
    Table { mark: Mark::Name("trials.csv"), about: "trials", rows: count_scores::<TrialHead> },
    Table { mark: Mark::Name("summary.csv"), about: "summary", rows: count_scores::<SummaryHead> },
    Table { mark: Mark::Name("error_over_time.csv"), about: "errors over time", rows: count::<ErrorBandRow> },
    Table { mark: Mark::Name("consistency.csv"), about: "consistency over time", rows: count::<ConsistencyRow> },
    Table { mark: Mark::Name("contours.csv"), about: "scores of outlines", rows: count::<ContourScoreRow> },
    Table { mark: Mark::Name("contour_trials.csv"), about: "trials of outlines", rows: count::<ContourTrialRow> },
    Table { mark: Mark::Name("failures.csv"), about: "failed trials", rows: count::<FailureRow> },
    Table { mark: Mark::Name("claims.csv"), about: "claims", rows: count::<MeasuredClaim> },
    Table { mark: Mark::Name("maps.csv"), about: "maps", rows: count::<MapRow> },
    Table { mark: Mark::Name("map_objects.csv"), about: "objects of maps", rows: count::<MapObjectRow> },
    Table { mark: Mark::End(".points.csv"), about: "contact points of a map", rows: count::<MapPointRow> },
    Table { mark: Mark::End(".outlines.csv"), about: "outlines of a map", rows: count::<MapVertexRow> },
    Table { mark: Mark::End(".grid.csv"), about: "occupancy grid", rows: count::<GridRow> },
    Table { mark: Mark::End(".surface.csv"), about: "sensor model", rows: count::<SurfaceRow> },
    Table { mark: Mark::End(".residuals.csv"), about: "residuals", rows: count::<ResidualRow> },
    Table { mark: Mark::End(".turn.csv"), about: "turned sensor", rows: count::<TurnRow> },
    Table { mark: Mark::End(".transfer.csv"), about: "counts over rotations", rows: count::<TransferRow> },
    Table { mark: Mark::Folder("estimates"), about: "estimates", rows: count::<EstimateRow> },
    Table { mark: Mark::Folder("events"), about: "contact events", rows: count::<EventRow> },
    Table { mark: Mark::Folder("bounds"), about: "bound", rows: count::<BoundRow> },
    Table { mark: Mark::Folder("contours"), about: "outline found", rows: count::<VertexRow> },
    Table { mark: Mark::Folder("outlines"), about: "true outline", rows: count_vertices },
];

fn count_vertices(path: &Path) -> anyhow::Result<usize> {
    Ok(Outline::read(path)?.vertices().len())
}

fn count<Row: DeserializeOwned>(path: &Path) -> anyhow::Result<usize> {
    Ok(read_rows::<Row>(path)?.len())
}

fn count_scores<Head: DeserializeOwned>(path: &Path) -> anyhow::Result<usize> {
    Ok(read_scores::<Head>(path)?.len())
}

/// A recording of several whiskers with all that belongs to it.
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

/// The recording to which a table of joints or objects belongs: it cannot be judged by itself.
fn check_part(path: &Path, ending: &str) -> anyhow::Result<String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let recording = path.with_file_name(format!("{}.json", name.trim_end_matches(ending)));
    ArrayRecording::read(&recording)?;
    Ok(format!("part of {}", recording.display()))
}

fn check_trace(path: &Path) -> anyhow::Result<String> {
    let trace = Trace::read(path)?;
    let sidecar = &trace.sidecar;
    trace.outline(path.parent().unwrap_or(Path::new(".")))?;
    let last = trace.recording.instants.last().map_or(0.0, |instant| instant.t_s);
    let known = trace.truth.instants.iter().filter_map(|truth| truth.touching);
    let (mut touching, mut free) = (0, 0);
    known.for_each(|is_touching| *(if is_touching { &mut touching } else { &mut free }) += 1);
    let truth = match touching + free {
        0 => "truth unknown".into(),
        known => format!("touching {:.0} %", 100.0 * f64::from(touching) / f64::from(known)),
    };
    let certificate = match &sidecar.certificate {
        None => String::new(),
        Some(certificate) => format!(", {}", certified(path, certificate)?),
    };
    Ok(format!("trace `{}`, {} rows, {last:.2} s, {truth}{certificate}", sidecar.name, sidecar.rows))
}

/// What the certificate says, in a line; an error where a figure lies above its bound.
fn certified(path: &Path, certificate: &Certificate) -> anyhow::Result<String> {
    let breaches: Vec<String> = certificate
        .breaches()
        .iter()
        .map(|breach| {
            format!("certificate.{}: found {:e}, expected at most {:e}", breach.key, breach.found, breach.bound)
        })
        .collect();
    if !breaches.is_empty() {
        bail!("{}: {}", path.with_extension("json").display(), breaches.join("; "));
    }
    let apart: String = [("tip", certificate.tip), ("split", certificate.split)]
        .into_iter()
        .filter(|(_, rows)| *rows > 0)
        .map(|(what, rows)| format!(" ({rows} rows {what})"))
        .collect();
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

/// Shapes and motions are known to the generator alone, so it judges scenes.
fn check_scene(path: &Path) -> anyhow::Result<()> {
    let output = python::generator(["check".as_ref(), path.as_os_str()])?.output()?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    bail!("{}", text.trim().trim_start_matches("error: "));
}
