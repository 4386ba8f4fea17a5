//! Table of the files of a run. FORMAT.md's list, the report's downloads, `whisker check` and the up-to-date test are
//! derived from it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use trace::Outline;
use whisker::events::DETECTORS;

use super::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, FailureRow,
    GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, QuantityRow, ResidualRow, Run, SummaryHead, SurfaceRow,
    TransferRow, TrialHead, TurnRow, VertexRow, read_rows, read_scores,
};

/// Command that writes a file of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writer {
    /// `whisker evaluate`.
    Evaluate,
    /// `whisker report`.
    Report,
    /// `whisker report --animations`.
    Animations,
}

impl Writer {
    /// The command.
    pub fn command(self) -> &'static str {
        match self {
            Self::Evaluate => "whisker evaluate",
            Self::Report => "whisker report",
            Self::Animations => "whisker report --animations",
        }
    }
}

/// Instances of a file in one run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Per {
    /// One file.
    Run,
    /// One per trace.
    Trace,
    /// One per trace with a known outline of its object.
    OutlinedTrace,
    /// One per trace and estimator.
    TraceAndEstimator,
    /// One per trace and contact detector.
    TraceAndDetector,
    /// One per recording of several whiskers and object.
    RecordingAndObject,
    /// One per recording of several whiskers and estimator.
    RecordingAndEstimator,
    /// One per solid, named after the traces over it, and estimator.
    SolidAndEstimator,
    /// One per calibrated face of a whisker.
    Face,
    /// One per sensor, if the front end writes such a table.
    Sensor,
}

/// Rows of a table.
#[derive(Clone, Copy, Debug)]
pub struct Rows {
    /// Row type, as FORMAT.md states it.
    pub of: &'static str,
    /// Short name of the table.
    pub label: &'static str,
    /// Parses a file and returns the number of its rows.
    pub count: fn(&Path) -> anyhow::Result<usize>,
    /// Whether a table without rows is valid.
    pub may_be_empty: bool,
}

impl Rows {
    /// Parses a file and returns the number of its rows.
    ///
    /// # Errors
    /// If it cannot be read or is damaged, or has no rows and needs some.
    pub fn counted(&self, path: &Path) -> anyhow::Result<usize> {
        let count = (self.count)(path)?;
        ensure!(count > 0 || self.may_be_empty, "{}: found no rows, expected at least one", path.display());
        Ok(count)
    }
}

/// One row of the table of a run's files.
#[derive(Clone, Copy, Debug)]
pub struct RunFile {
    /// Path in the run's folder, with placeholders such as `<trace>`.
    pub name: &'static str,
    /// Instances in one run.
    pub per: Per,
    /// Command that writes it.
    pub writer: Writer,
    /// Rows of a table. `None` for other files.
    pub rows: Option<Rows>,
    /// Description in one line.
    pub about: &'static str,
}

/// Names from which those of a run's files are composed.
#[derive(Clone, Copy, Debug)]
pub struct RunNames<'a> {
    /// Contents of `run.json`.
    pub run: &'a Run,
    /// Traces with a known outline of their object.
    pub outlined: &'a [String],
    /// File names of the tables that the front end writes about its sensors.
    pub sensor_tables: &'a BTreeSet<String>,
}

/// A table with the columns of a row type: with at least one row, unless it is one `or_none`.
macro_rules! table {
    ($row:ident, $label:literal) => {
        table!($row, $label, false)
    };
    ($row:ident, $label:literal, or_none) => {
        table!($row, $label, true)
    };
    ($row:ident, $label:literal, $may_be_empty:literal) => {
        Some(Rows {
            of: concat!("`", stringify!($row), "`"),
            label: $label,
            count: |path| Ok(read_rows::<$row>(path)?.len()),
            may_be_empty: $may_be_empty,
        })
    };
}

/// A table with the columns of a head, then the metrics.
macro_rules! scores {
    ($head:ident, $label:literal) => {
        Some(Rows {
            of: concat!("`", stringify!($head), "`, then the metrics"),
            label: $label,
            count: |path| Ok(read_scores::<$head>(path)?.len()),
            may_be_empty: false,
        })
    };
}

/// An outline as in a dataset.
const OUTLINE_ROWS: Option<Rows> = Some(Rows {
    of: "an outline as in a dataset",
    label: "true outline",
    count: |path| Ok(Outline::read(path)?.vertices().len()),
    may_be_empty: false,
});

/// Declares the files by name and lists them in a registry.
macro_rules! run_files {
    ($(#[$doc:meta])* $registry:ident; $($constant:ident = $name:literal, $per:ident, $writer:ident, $rows:expr, $about:literal;)+) => {
        $(#[doc = concat!("`", $name, "`: ", $about, ".")]
        pub const $constant: RunFile =
            RunFile { name: $name, per: Per::$per, writer: Writer::$writer, rows: $rows, about: $about };)+

        $(#[$doc])*
        pub const $registry: &[RunFile] = &[$($constant),+];
    };
}

pub(crate) use {run_files, table};

run_files! {
    /// The registry of the files of a run in the plane.
    RUN_FILES;
    RUN = "run.json", Run, Evaluate, None,
        "watermark, noise levels with their unit, seeds, front end with its settings and the calibration of its sensors, settings of the touch detection, estimators with their \
         settings (for a program its command and the hashes of its files), sets of trials, calibrations, whiskers";
    TRIALS = "trials.csv", Run, Evaluate, scores!(TrialHead, "trials"),
        "one row per trace, estimator, noise level and seed";
    SUMMARY = "summary.csv", Run, Evaluate, scores!(SummaryHead, "summary"),
        "one row per group, whisker, estimator and noise level";
    FAILURES = "failures.csv", Run, Evaluate, table!(FailureRow, "failed trials", or_none),
        "one row per trial that could not be scored, or on which the named estimator failed, with the reason";
    ERROR_OVER_TIME = "error_over_time.csv", Run, Evaluate, table!(ErrorBandRow, "errors over time", or_none),
        "distribution of the contact error over the trials of a set, in bins of 20 ms since the touch";
    CONSISTENCY = "consistency.csv", Run, Evaluate, table!(ConsistencyRow, "consistency over time", or_none),
        "average NEES and NIS with their 95 % intervals, error and posterior Cramér–Rao bound over the trials of a set, in bins of 0.1 s since the touch";
    CONTOURS = "contours.csv", Run, Evaluate, table!(ContourScoreRow, "scores of outlines", or_none),
        "one row per group, whisker, estimator and noise level, for objects other than pins: outline found against the true one";
    CONTOUR_TRIALS = "contour_trials.csv", Run, Evaluate, table!(ContourTrialRow, "trials of outlines", or_none),
        "one row per trace, estimator, noise level and seed: outline found against the true one, and the circle through the outline of a round object";
    QUANTITIES = "quantities.csv", Run, Evaluate, table!(QuantityRow, "quantities beside the contact", or_none),
        "one row per trace, estimator, noise level, seed and quantity that the estimator states at the end beside the contact: deviation of the sensor, velocity of the object";
    TRACE_CONTOUR = "contours/<trace>.<estimator>.csv", TraceAndEstimator, Evaluate, table!(VertexRow, "outline found", or_none),
        "outline found, counter-clockwise, with its covariance, at the first noise level and seed";
    ESTIMATES = "estimates/<trace>.<estimator>.csv", TraceAndEstimator, Evaluate, table!(EstimateRow, "estimates"),
        "one row per instant, at the first noise level and seed";
    BOUND = "bounds/<trace>.csv", Trace, Evaluate, table!(BoundRow, "bound", or_none),
        "one row per instant of contact: posterior Cramér–Rao bound at the first noise level; no rows without noise or truth";
    EVENTS = "events/<trace>.<detector>.csv", TraceAndDetector, Evaluate, table!(EventRow, "contact events"),
        "one row per instant, at the first noise level and seed: state of each contact detector";
    OUTLINE = "outlines/<trace>.csv", OutlinedTrace, Evaluate, OUTLINE_ROWS,
        "true outline of the object";
    OBJECT_OUTLINE = "outlines/<recording>.<object>.csv", RecordingAndObject, Evaluate, OUTLINE_ROWS,
        "true outline of each object of a recording of several whiskers";
    MAPS = "maps.csv", Run, Evaluate, table!(MapRow, "maps", or_none),
        "one row per recording of several whiskers, estimator, noise level and seed: contact points of the map against the true outlines, number of objects found";
    MAP_OBJECTS = "map_objects.csv", Run, Evaluate, table!(MapObjectRow, "objects of maps", or_none),
        "one row per object found in such a map, against the true one";
    MAP_POINTS = "maps/<recording>.<estimator>.points.csv", RecordingAndEstimator, Evaluate, table!(MapPointRow, "contact points of a map", or_none),
        "contact points of all whiskers, at the first noise level and seed";
    MAP_OUTLINES = "maps/<recording>.<estimator>.outlines.csv", RecordingAndEstimator, Evaluate, table!(MapVertexRow, "outlines of a map", or_none),
        "outlines of the objects found, at the first noise level and seed";
    MAP_GRID = "maps/<recording>.<estimator>.grid.csv", RecordingAndEstimator, Evaluate, table!(GridRow, "occupancy grid", or_none),
        "observed cells of the occupancy grid, at the first noise level and seed";
    SURFACE = "models/<whisker>_<face>.surface.csv", Face, Evaluate, table!(SurfaceRow, "sensor model"),
        "sensor model on a grid over its calibrated domain, copied from the calibration";
    RESIDUALS = "models/<whisker>_<face>.residuals.csv", Face, Evaluate, table!(ResidualRow, "residuals"),
        "held-out residuals, copied from the calibration";
    TURN = "sensors/<array>.<sensor>.turn.csv", Sensor, Evaluate, table!(TurnRow, "turned sensor"),
        "counts of a resting sensor that is turned by half a circle and back, with and without the common mode; only with a front end that has sensors";
    TRANSFER = "sensors/<array>.<sensor>.transfer.csv", Sensor, Evaluate, table!(TransferRow, "counts over rotations"),
        "counts over the rotation of the root, without noise, with and without amplifiers; only with a front end that has sensors";
    FIGURES = "figures/", Run, Report, None, "figures as SVG and PNG";
    PAGE = "index.html", Run, Report, None, "report page";
    ANIMATIONS = "animations/", Run, Animations, None, "animations of the sweeps, copied from the dataset";
}

impl RunFile {
    /// Whether the run has one such file directly in its folder.
    pub fn is_single(&self) -> bool {
        self.per == Per::Run && !self.name.contains('/')
    }

    /// Path of the file of which a run has one.
    pub fn path(&self, folder: &Path) -> PathBuf {
        self.path_of(folder, &[])
    }

    /// Path of one instance, with its placeholders replaced in their order.
    pub fn path_of(&self, folder: &Path, values: &[&str]) -> PathBuf {
        folder.join(self.name_of(values))
    }

    /// Name of one instance without its folder, with its placeholders replaced in their order.
    pub fn file_name_of(&self, values: &[&str]) -> String {
        let name = self.name_of(values);
        name.rsplit_once('/').map_or(name.clone(), |(_, file)| file.into())
    }

    /// Path of one instance in the run's folder, with its placeholders replaced in their order.
    pub fn name_of(&self, values: &[&str]) -> String {
        let mut name = String::new();
        let mut rest = self.name;
        for value in values {
            let (before, after) = rest.split_once('<').expect("as many values as placeholders");
            name += before;
            name += value;
            rest = after.split_once('>').expect("a placeholder ends").1;
        }
        assert!(!rest.contains('<'), "{}: found {} values, expected one per placeholder", self.name, values.len());
        name + rest
    }

    /// Paths of all instances in the folder of a run.
    pub fn instances(&self, names: &RunNames<'_>) -> Vec<String> {
        let run = names.run;
        let traces = || run.sets.iter().flat_map(|set| &set.traces);
        let each_estimator = |first: &String| {
            let of_estimator = |row: &super::RunEstimator| self.name_of(&[first, &row.name]);
            run.estimators.iter().map(of_estimator).collect::<Vec<_>>()
        };
        match self.per {
            Per::Run => vec![self.name.into()],
            Per::Trace => traces().map(|trace| self.name_of(&[trace])).collect(),
            Per::OutlinedTrace => names.outlined.iter().map(|trace| self.name_of(&[trace])).collect(),
            Per::TraceAndEstimator => traces().flat_map(each_estimator).collect(),
            Per::TraceAndDetector => {
                traces().flat_map(|trace| DETECTORS.iter().map(move |row| self.name_of(&[trace, row.name]))).collect()
            }
            Per::RecordingAndObject => run
                .recordings
                .iter()
                .flat_map(|recording| recording.objects.iter().map(|object| self.name_of(&[&recording.name, object])))
                .collect(),
            Per::RecordingAndEstimator => {
                run.recordings.iter().flat_map(|recording| each_estimator(&recording.name)).collect()
            }
            // Runs in the plane have none.
            Per::SolidAndEstimator => Vec::new(),
            Per::Face => run.calibrations.iter().map(|face| self.name_of(&[&face.whisker, &face.face])).collect(),
            Per::Sensor => {
                let sensors = run.front_end.sensors.iter();
                let tables = sensors.map(|sensor| [&*sensor.array, &*sensor.name]);
                let is_written = |values: &[&str; 2]| names.sensor_tables.contains(&self.file_name_of(values));
                tables.filter(is_written).map(|values| self.name_of(&values)).collect()
            }
        }
    }

    /// Whether a path in the folder of a run, with slashes, is that of an instance.
    pub fn is_at(&self, path: &str) -> bool {
        match self.name.strip_suffix('/') {
            Some(folder) => {
                let inside = path.strip_prefix(folder).and_then(|rest| rest.strip_prefix('/'));
                inside.is_some_and(|name| PICTURES.iter().any(|end| name.ends_with(end)))
            }
            None => fits(self.name, path),
        }
    }

    /// Whether instances may lie in a folder of a run or below it, given with a slash at its end.
    pub fn may_be_in(&self, folder: &str) -> bool {
        self.name.starts_with(folder) || (self.name.ends_with('/') && folder.starts_with(self.name))
    }

    /// Rank of the match between this file and a path, of which perhaps only the file name is given: 0 by its whole
    /// name, 1 by the end of its name, 2 by its folder. `None` if it is another file.
    fn identified_by(&self, path: &Path) -> Option<u8> {
        let found = path.file_name()?.to_str()?;
        let (folder, name) = self.name.rsplit_once('/').unwrap_or(("", self.name));
        let (is_this, precision) = match name.rsplit_once('>') {
            None => (!name.is_empty() && found == name, 0),
            Some((_, ".csv")) => {
                (found.ends_with(".csv") && path.parent().is_some_and(|parent| parent.ends_with(folder)), 2)
            }
            Some((_, end)) => (found.ends_with(end), 1),
        };
        is_this.then_some(precision)
    }
}

/// Ends of the names of the files in folders that a run has as a whole.
const PICTURES: [&str; 3] = [".svg", ".png", ".webp"];

/// Whether a path is a pattern with a name in place of each placeholder.
fn fits(pattern: &str, path: &str) -> bool {
    let Some((before, rest)) = pattern.split_once('<') else { return pattern == path };
    let (_, after) = rest.split_once('>').expect("a placeholder ends");
    let Some(rest) = path.strip_prefix(before) else { return false };
    let ends = rest.char_indices().take_while(|(_, letter)| *letter != '/').map(|(at, letter)| at + letter.len_utf8());
    ends.into_iter().any(|end| fits(after, &rest[end..]))
}

/// File of a registry at a path, by its name and folder.
pub fn run_file(registry: &'static [RunFile], path: &Path) -> Option<&'static RunFile> {
    let identified = registry.iter().filter_map(|file| Some((file.identified_by(path)?, file)));
    identified.min_by_key(|(precision, _)| *precision).map(|(_, file)| file)
}

/// Paths in the folder of a run in the plane of all files that `whisker evaluate` writes.
pub fn evaluated_files(names: &RunNames<'_>) -> Vec<String> {
    RUN_FILES.iter().filter(|file| file.writer == Writer::Evaluate).flat_map(|file| file.instances(names)).collect()
}

/// Paths in the folder of a run in the plane of the files that the run must have, as far as `run.json` and the table of failures
/// state. Trials with failures may lack some of their files; if the table of failures cannot be read, those of all trials are left
/// out. So are outlines and tables of sensors, which `run.json` does not state.
pub fn certain_files(run: &Run, folder: &Path) -> Vec<String> {
    let mut run = run.clone();
    let failed: Option<BTreeSet<String>> = read_rows::<FailureRow>(&FAILURES.path(folder))
        .ok()
        .map(|failures| failures.into_iter().map(|failure| failure.trace).collect());
    let is_whole = |trace: &String| failed.as_ref().is_some_and(|failed| !failed.contains(trace));
    run.sets.iter_mut().for_each(|set| set.traces.retain(is_whole));
    run.recordings.retain(|recording| recording.whiskers.iter().all(|whisker| is_whole(&whisker.trace)));
    evaluated_files(&RunNames { run: &run, outlined: &[], sensor_tables: &BTreeSet::new() })
}

/// The list of a run's files in FORMAT.md, as a Markdown table.
pub fn markdown() -> String {
    let mut text = String::from("| file | written by | contents |\n| --- | --- | --- |\n");
    for file in RUN_FILES {
        let rows = file.rows.map_or_else(String::new, |rows| format!(" ({})", rows.of));
        text += &format!("| `{}` | `{}` | {}{rows} |\n", file.name, file.writer.command(), file.about);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_every_file_is_identified_by_its_own_path() {
        for file in RUN_FILES.iter().filter(|file| file.rows.is_some()) {
            let values = ["one", "two"];
            let path = PathBuf::from("results/run").join(file.name_of(&values[..file.name.matches('<').count()]));
            let found = run_file(RUN_FILES, &path).expect("it is in the table");
            // Two files share a folder of outlines.
            assert!(found.name == file.name || file.name == OBJECT_OUTLINE.name, "{}: found {}", file.name, found.name);
        }
        assert!(run_file(RUN_FILES, Path::new("datasets/standard/pin.csv")).is_none());
    }

    #[test]
    fn verif_files_of_a_run_are_told_from_others_in_its_folder() {
        let is_own = |path: &str| RUN_FILES.iter().any(|file| file.is_at(path));
        for file in RUN_FILES.iter().filter(|file| !file.name.ends_with('/')) {
            assert!(is_own(&file.name_of(&["a.b", "two"][..file.name.matches('<').count()])), "{}", file.name);
        }
        assert!(is_own("figures/consistency.svg") && is_own("figures/all/consistency_1.png"));
        let others =
            ["notes.txt", "figures/notes.txt", "estimates/notes.csv", "estimates/a/b.c.csv", "x/trials.csv", "maps"];
        assert!(others.into_iter().all(|other| !is_own(other)));
    }
}
