//! Labelled presses of several logs, and the chain that detected them.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use files::{FORMAT, read_json};
use serde::{Deserialize, Serialize};

use super::table::{self, is_header};
use super::{Labels, LogReader, MARK, expected_distance};
use crate::Sample;
use crate::calibration::cross_validation::SAME_PLACE_M;
use crate::calibration::regression::{Fit, RegressionRow};
use crate::calibration::{Chain, Error, Features, LabelledPress, Presses, Settings, learn, published};

const MANIFEST_KIND: &str = "platform_logs";

/// Note on a file whose last line has no line end.
const CUT_OFF: &str = "skipped the incomplete last line";

/// A log, and its distance if it has only one.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The file.
    pub path: PathBuf,
    /// Distance of all presses in it (m). `None`: the distances are in its sidecar, or in the table itself.
    pub distance_m: Option<f64>,
}

/// Presses of several logs.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// Labelled presses.
    pub presses: Vec<LabelledPress>,
    /// Chain that detected them. `None` if all are from tables.
    pub chain: Option<Chain>,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

/// Error of gathering logs.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// Error of a file.
    #[error(transparent)]
    File(#[from] files::Error),
    /// The recordings do not determine a chain.
    #[error(transparent)]
    Recordings(#[from] Error),
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: u32,
    kind: String,
    logs: Vec<ManifestLog>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ManifestLog {
    file: PathBuf,
    distance_m: Option<f64>,
}

impl Source {
    /// Logs that a manifest names, with paths relative to it.
    ///
    /// # Errors
    /// If the manifest is invalid; the error names the key.
    pub fn of_manifest(path: &Path) -> Result<Vec<Self>, files::Error> {
        let manifest: Manifest = read_json(path)?;
        if manifest.format != FORMAT {
            return Err(files::Error::value(path, "format", manifest.format, FORMAT));
        }
        if manifest.kind != MANIFEST_KIND {
            return Err(files::Error::value(path, "kind", &manifest.kind, MANIFEST_KIND));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let source = |(i, log): (usize, ManifestLog)| match log.distance_m.and_then(expected_distance) {
            Some(expected) => {
                let found = log.distance_m.unwrap_or_default();
                Err(files::Error::value(path, format!("logs.{i}.distance_m"), found, expected))
            }
            None => Ok(Self { path: folder.join(log.file), distance_m: log.distance_m }),
        };
        manifest.logs.into_iter().enumerate().map(source).collect()
    }
}

struct Recording {
    name: String,
    samples: Vec<Sample>,
    labels: Labels,
}

/// Reads logs, estimates the chain from those with samples, and detects their presses: by the published pipeline for
/// the published regression. `table_rate_hz` converts the slopes of a table from counts/sample to counts/s.
///
/// # Errors
/// If a file is invalid or the recordings do not determine a chain.
pub fn gather(
    sources: &[Source],
    settings: &Settings,
    row: &RegressionRow,
    table_rate_hz: f64,
) -> Result<Gathered, GatherError> {
    let mut gathered = Gathered { presses: Vec::new(), chain: None, notes: Vec::new() };
    let mut recordings: Vec<Recording> = Vec::new();
    let mut tables: Vec<(String, String)> = Vec::new();
    for source in sources {
        let name = source.path.display().to_string();
        if let Some(text) = table_text(&source.path)? {
            check_new(&source.path, tables.iter().find(|(_, table)| *table == text).map(|(name, _)| name))?;
            if let Some(distance_m) = source.distance_m {
                let found = format!("{:.1} mm for the whole table", 1e3 * distance_m);
                let expected = "no label: a table states the distance of each press";
                return Err(files::Error::value(&source.path, "label", found, expected).into());
            }
            let table = table::read(&source.path, &text, table_rate_hz)?;
            if table.is_cut_off {
                gathered.notes.push(format!("{name}: {CUT_OFF}"));
            }
            if !table.unlabelled.is_empty() {
                gathered.notes.push(format!("{name}: skipped lines without a distance: {:?}", table.unlabelled));
            }
            gathered.presses.extend(table.presses);
            tables.push((name, text));
            continue;
        }
        let mut reader = LogReader::open(&source.path)?;
        let samples = reader.by_ref().collect::<Result<Vec<_>, _>>()?;
        if reader.cut_off() {
            gathered.notes.push(format!("{name}: {CUT_OFF}"));
        }
        check_new(&source.path, recordings.iter().find(|log| log.samples == samples).map(|log| &log.name))?;
        let labels = match source.distance_m {
            Some(distance_m) => {
                if let Some(expected) = expected_distance(distance_m) {
                    return Err(files::Error::value(&source.path, "label", format!("{distance_m} m"), expected).into());
                }
                check_label(&source.path, distance_m)?;
                Labels::whole(distance_m)
            }
            None => labels_of_sidecar(&source.path)?,
        };
        recordings.push(Recording { name, samples, labels });
    }
    if recordings.is_empty() {
        return Ok(gathered);
    }
    let named: Vec<(&str, &[Sample])> =
        recordings.iter().map(|log| (log.name.as_str(), log.samples.as_slice())).collect();
    let chain = learn(&named, settings)?;
    for recording in &recordings {
        let found = match row.fit {
            Fit::Live(_) => live_presses(&recording.samples, &chain)?,
            Fit::Leaking(_) => published_presses(&recording.samples, &chain)?,
        };
        let count = found.len();
        let labelled = found.into_iter().filter_map(|(onset_s, features)| {
            let distance_m = recording.labels.distance_m(onset_s)?;
            Some(LabelledPress { log: recording.name.clone(), onset_s: Some(onset_s), features, distance_m })
        });
        let before = gathered.presses.len();
        gathered.presses.extend(labelled);
        let labelled = gathered.presses.len() - before;
        gathered.notes.push(format!("{}: {count} presses, {labelled} of them labelled", recording.name));
    }
    gathered.chain = Some(chain);
    Ok(gathered)
}

fn live_presses(samples: &[Sample], chain: &Chain) -> Result<Vec<(f64, Features)>, Error> {
    let presses = Presses::new(chain)?.of(samples);
    Ok(presses.into_iter().map(|press| (press.onset_s, press.features)).collect())
}

fn published_presses(samples: &[Sample], chain: &Chain) -> Result<Vec<(f64, Features)>, Error> {
    let episodes = published::episodes(samples, chain.main_axis, chain.rate_hz)?;
    let features = |episode: &published::Episode| Features::of_slope(-episode.slope_counts_per_sample * chain.rate_hz);
    Ok(episodes.iter().map(|episode| (episode.onset_s, features(episode))).collect())
}

/// Checks that a log was not given before: of a press that is present twice, only one copy would be held out.
fn check_new(path: &Path, same: Option<&String>) -> Result<(), files::Error> {
    let Some(same) = same else { return Ok(()) };
    Err(files::Error::value(path, "log", format!("the same content as {same}"), "each log once"))
}

/// Labels in the sidecar of a log.
fn labels_of_sidecar(path: &Path) -> Result<Labels, files::Error> {
    let sidecar = path.with_extension("json");
    if sidecar.exists() {
        return Labels::read(&sidecar);
    }
    let expected = format!("{}; write it, or give `--label MM=FILE`", sidecar.display());
    Err(files::Error::value(path, "label", "no sidecar with the distances", expected))
}

/// Checks that the sidecar of a log, if it has one, states no other distance than the label.
fn check_label(path: &Path, distance_m: f64) -> Result<(), files::Error> {
    let sidecar = path.with_extension("json");
    let Some(stated) = Labels::of_sidecar(&sidecar)?.and_then(|labels| labels.range_m()) else { return Ok(()) };
    if stated.iter().all(|stated_m| (stated_m - distance_m).abs() <= SAME_PLACE_M) {
        return Ok(());
    }
    let [least, most] = stated.map(|stated_m| 1e3 * stated_m);
    let found = format!("{:.1} mm, and {least:.1} to {most:.1} mm in {}", 1e3 * distance_m, sidecar.display());
    let expected = "distances from one of the two: leave out the label, or rename the sidecar";
    Err(files::Error::value(path, "label", found, expected))
}

/// Text of a table of presses, without a byte order mark. `None` if the file is no such table.
fn table_text(path: &Path) -> Result<Option<String>, files::Error> {
    let io = |reason| files::Error::Io { path: path.into(), reason };
    let mut start = Vec::new();
    fs::File::open(path).map_err(io)?.take(1024).read_to_end(&mut start).map_err(io)?;
    let first = String::from_utf8_lossy(&start);
    let is_table = first.trim_start_matches(MARK).lines().next().is_some_and(is_header);
    let text = is_table.then(|| fs::read_to_string(path)).transpose().map_err(io)?;
    Ok(text.map(|text| text.trim_start_matches(MARK).into()))
}
