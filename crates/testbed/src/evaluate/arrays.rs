//! Recordings of several whiskers in a batch: their traces as trials, and one map of each.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use files::write_atomically;
use rayon::prelude::*;
use trace::{ArrayRecording, Sidecar, Trace};
use whisker::estimators::BaseNoise;

use super::contours::vertex_rows;
use super::{EvaluateSettings, check_distinct};
use crate::encoders::Encoders;
use crate::map::{FoundObject, MapConfig, MapScore, SceneMap, Truths, View, score_map};
use crate::metrics::Trial;
use crate::replay::Replay;
use crate::results::{GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, RunMounted, RunRecording, csv_bytes};

/// A trial that is one whisker of a recording.
#[derive(Clone)]
pub(super) struct Mounted {
    array: Arc<ArrayRecording>,
    /// Place of the whisker in it.
    whisker: usize,
    /// What is known of the trace as it was recorded, under its own name.
    sidecar: Arc<Sidecar>,
    encoders: Encoders,
    base_noise: BaseNoise,
}

/// What one whisker yields for one estimator.
pub(super) struct Sighting {
    mounted: Mounted,
    group: String,
    estimator: String,
    noise: f64,
    seed: u64,
    view: View,
}

/// Reads the recordings that traces belong to, each once, by their paths.
#[derive(Default)]
pub(super) struct Arrays(BTreeMap<PathBuf, Arc<ArrayRecording>>);

impl Arrays {
    /// A trace as trials: as it is or, where it belongs to a recording, once under each of some encoders, renamed and in a group of its own where they are not perfect.
    pub(super) fn trials(
        &mut self,
        folder: &Path,
        trace: &Trace,
        encoders: &[Encoders],
    ) -> anyhow::Result<Vec<(Sidecar, Option<Mounted>)>> {
        let Some(name) = &trace.sidecar.recording else { return Ok(vec![(trace.sidecar.clone(), None)]) };
        let path = folder.join(format!("{name}.json"));
        let array = match self.0.get(&path) {
            Some(array) => array.clone(),
            None => {
                let array = Arc::new(ArrayRecording::read(&path)?);
                self.0.insert(path, array.clone());
                array
            }
        };
        let whisker = array.check(&folder.join(format!("{}.csv", trace.sidecar.name)), trace)?;
        let mount = &array.sidecar.whiskers[whisker].mount;
        let recorded = Arc::new(trace.sidecar.clone());
        let perfect = [Encoders::default()];
        let encoders = if encoders.is_empty() { &perfect } else { encoders };
        let under = |encoders: &Encoders| {
            let mut sidecar = trace.sidecar.clone();
            sidecar.name = under(&sidecar.name, encoders);
            if !encoders.are_perfect() {
                sidecar.group = format!("{}, encoders {}", sidecar.group, encoders.label().replace('_', " "));
            }
            let (array, recorded, encoders) = (array.clone(), recorded.clone(), *encoders);
            let base_noise = encoders.base_noise(&array, mount);
            (sidecar, Some(Mounted { array, whisker, sidecar: recorded, encoders, base_noise }))
        };
        Ok(encoders.iter().map(under).collect())
    }

    /// Checks that there is an arm where encoders are asked for, and that each recording has a name of its own.
    pub(super) fn check(&self, encoders: &[Encoders]) -> anyhow::Result<()> {
        check_distinct("recording", self.0.values().map(|array| array.sidecar.name.clone()))?;
        if !encoders.is_empty() && self.0.is_empty() {
            bail!("encoders: found no recording of an arm among the traces, expected at least one");
        }
        Ok(())
    }
}

/// A name under some encoders.
fn under(name: &str, encoders: &Encoders) -> String {
    if encoders.are_perfect() { name.into() } else { format!("{name}_{}", encoders.label()) }
}

impl Mounted {
    /// Place of the whisker in the recording.
    pub(super) fn whisker(&self) -> usize {
        self.whisker
    }

    /// Name of the recording, as it is replayed.
    pub(super) fn recording(&self) -> String {
        under(&self.array.sidecar.name, &self.encoders)
    }

    /// What is known of the trace as it was recorded.
    pub(super) fn sidecar(&self) -> &Sidecar {
        &self.sidecar
    }

    /// How well the robot knows the whisker's base.
    pub(super) fn base_noise(&self) -> BaseNoise {
        self.base_noise
    }

    /// The trace as the robot knows it under a seed: its base by what the encoders show.
    pub(super) fn known<'a>(&self, trace: &'a Trace, seed: u64) -> Cow<'a, Trace> {
        if self.encoders.are_perfect() {
            return Cow::Borrowed(trace);
        }
        let mount = &self.array.sidecar.whiskers[self.whisker].mount;
        let recording = self.encoders.measured(&self.array, mount, &trace.recording, seed);
        Cow::Owned(Trace { recording, sidecar: trace.sidecar.clone(), truth: trace.truth.clone() })
    }

    /// What this whisker yields for one estimator.
    pub(super) fn sighting(
        &self,
        (trial, replay): (&Trial<'_>, &Replay),
        (estimator, noise, seed): (&str, f64, u64),
        config: &MapConfig,
    ) -> anyhow::Result<Sighting> {
        Ok(Sighting {
            view: View::new(trial, replay, self.whisker, config)?,
            mounted: self.clone(),
            group: trial.trace.sidecar.group.clone(),
            estimator: estimator.into(),
            noise,
            seed,
        })
    }
}

/// The recordings of a batch, as `run.json` has them.
pub(super) fn recordings<'a>(
    trials: impl Iterator<Item = (&'a Sidecar, &'a Mounted)>,
    config: MapConfig,
) -> Vec<RunRecording> {
    let mut recordings: Vec<RunRecording> = Vec::new();
    for (of_trace, mounted) in trials {
        let name = mounted.recording();
        let sidecar = &mounted.array.sidecar;
        let whisker = &sidecar.whiskers[mounted.whisker];
        let (of_whisker, array) = (whisker.name.clone(), whisker.array.clone());
        let entry = RunMounted { name: of_whisker, array, trace: of_trace.name.clone() };
        match recordings.iter_mut().find(|recording| recording.name == name) {
            Some(recording) => recording.whiskers.push(entry),
            None => recordings.push(RunRecording {
                name,
                group: of_trace.group.clone(),
                encoders: mounted.encoders,
                map: config,
                objects: sidecar.objects.iter().map(|object| object.name.clone()).collect(),
                whiskers: vec![entry],
            }),
        }
    }
    recordings
}

/// Hashes of what the recordings of a batch hold beside the traces.
pub(super) fn inputs<'a>(mounted: impl Iterator<Item = &'a Mounted>) -> anyhow::Result<Vec<String>> {
    let arrays: BTreeMap<&str, &Mounted> =
        mounted.map(|mounted| (mounted.array.sidecar.name.as_str(), mounted)).collect();
    arrays.values().map(|mounted| Ok(serde_json::to_string(&mounted.array.sidecar)?)).collect()
}

/// The files about maps in a run.
pub(super) fn files(recordings: &[RunRecording], estimators: &[String]) -> Vec<String> {
    let mut files = Vec::new();
    for recording in recordings {
        let name = &recording.name;
        files.extend(recording.objects.iter().map(|object| format!("outlines/{name}.{object}.csv")));
        for estimator in estimators {
            files.extend(TABLES.map(|table| format!("maps/{name}.{estimator}.{table}.csv")));
        }
    }
    files
}

/// Tables of each map.
const TABLES: [&str; 3] = ["points", "outlines", "grid"];

/// What is recorded of maps.
pub(super) type MapRows = (Vec<MapRow>, Vec<MapObjectRow>);

/// Makes the maps of what the whiskers of a recording saw, one a noise level, seed and estimator, and judges them by what they truly did. Those of the first noise level and seed are written into
/// the folder of a run.
///
/// # Errors
/// If a file cannot be written.
pub(super) fn maps(
    folder: &Path,
    sightings: &[Sighting],
    truths: &Truths,
    settings: &EvaluateSettings,
) -> anyhow::Result<MapRows> {
    let mut scenes: Vec<Vec<&Sighting>> = Vec::new();
    let mut places = BTreeMap::new();
    for sighting in sightings {
        let key = (sighting.mounted.recording(), sighting.noise.to_bits(), sighting.seed, &sighting.estimator);
        let place = *places.entry(key).or_insert_with(|| {
            scenes.push(Vec::new());
            scenes.len() - 1
        });
        scenes[place].push(sighting);
    }
    let rows: Vec<(MapRow, Vec<MapObjectRow>)> = scenes
        .par_iter()
        .map(|scene| {
            let views: Vec<&View> = scene.iter().map(|sighting| &sighting.view).collect();
            let map = SceneMap::new(&views, &settings.map);
            let first = scene[0];
            if first.noise == settings.noise[0] && first.seed == settings.seeds[0] {
                write_map(folder, first, &map, &views)?;
            }
            let judged = score_map(&map, &views, truths, &first.mounted.array);
            Ok((map_row(first, &map, &views, &judged), object_rows(first, &map, &judged)))
        })
        .collect::<anyhow::Result<_>>()?;
    let (maps, objects): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    Ok((maps, objects.concat()))
}

fn write_map(folder: &Path, first: &Sighting, map: &SceneMap, views: &[&View]) -> anyhow::Result<()> {
    let sidecar = &first.mounted.array.sidecar;
    let recording = first.mounted.recording();
    for (object, outline) in sidecar.objects.iter().zip(&first.mounted.array.outlines) {
        let path = folder.join("outlines").join(format!("{recording}.{}.csv", object.name));
        write_atomically(&path, outline.to_csv().as_bytes())?;
    }
    let numbered = map.objects.iter().zip(1..).flat_map(|(object, number)| {
        object.points.iter().map(move |(whisker, seen)| ((*whisker, seen.point.row), number))
    });
    let numbers: BTreeMap<(usize, usize), usize> = numbered.collect();
    let points: Vec<MapPointRow> = views
        .iter()
        .flat_map(|view| view.points.iter().map(move |seen| (view.whisker, seen)))
        .map(|(whisker, seen)| MapPointRow {
            t_s: seen.t_s,
            whisker: sidecar.whiskers[whisker].name.clone(),
            array: sidecar.whiskers[whisker].array.clone(),
            object: numbers.get(&(whisker, seen.point.row)).copied(),
            x_m: seen.point.at.x,
            y_m: seen.point.at.y,
            normal_rad: seen.point.normal_rad(),
            cov_xx_m2: seen.point.covariance_m2.map(|covariance| covariance.m11),
            cov_xy_m2: seen.point.covariance_m2.map(|covariance| covariance.m12),
            cov_yy_m2: seen.point.covariance_m2.map(|covariance| covariance.m22),
        })
        .collect();
    let vertices = map.objects.iter().enumerate().flat_map(|(place, object)| {
        let rows = vertex_rows(Some(&object.contour));
        rows.into_iter().map(move |vertex| MapVertexRow::new(place + 1, vertex))
    });
    let vertices: Vec<MapVertexRow> = vertices.collect();
    let grid: Vec<GridRow> = map
        .grid
        .cells()
        .map(|(at, cell)| GridRow {
            x_m: at.x(),
            y_m: at.y(),
            swept: cell.swept,
            touched: cell.touched,
            occupied: cell.occupied(),
        })
        .collect();
    let tables = [csv_bytes(&points)?, csv_bytes(&vertices)?, csv_bytes(&grid)?];
    for (table, bytes) in TABLES.iter().zip(tables) {
        let path = folder.join("maps").join(format!("{recording}.{}.{table}.csv", first.estimator));
        write_atomically(&path, &bytes)?;
    }
    Ok(())
}

fn map_row(first: &Sighting, map: &SceneMap, views: &[&View], judged: &MapScore) -> MapRow {
    MapRow {
        recording: first.mounted.recording(),
        group: first.group.clone(),
        estimator: first.estimator.clone(),
        noise: first.noise,
        seed: first.seed,
        whiskers: views.len(),
        points: judged.points,
        points_share: judged.share,
        points_mean_m: judged.mean_m,
        points_p95_m: judged.p95_m,
        objects_touched: judged.touched,
        objects_found: map.objects.len(),
        objects_split: judged.split,
        objects_merged: judged.merged,
    }
}

fn object_rows(first: &Sighting, map: &SceneMap, judged: &MapScore) -> Vec<MapObjectRow> {
    let array = &first.mounted.array;
    let row = |(place, found): (usize, &FoundObject)| {
        let truth = judged.objects.get(place);
        let circle = found.circle;
        let whiskers: BTreeSet<usize> = found.points.iter().map(|(whisker, _)| *whisker).collect();
        MapObjectRow {
            recording: first.mounted.recording(),
            estimator: first.estimator.clone(),
            noise: first.noise,
            seed: first.seed,
            object: place + 1,
            whiskers: whiskers.len(),
            points: found.points.len(),
            matched: truth.map(|truth| array.sidecar.objects[truth.object].name.clone()),
            moved_m: truth.map(|truth| array.moved_m[truth.object]),
            points_mean_m: truth.map(|truth| truth.mean_m),
            points_p95_m: truth.map(|truth| truth.p95_m),
            outline_mean_m: truth.map(|truth| truth.contour.mean_m),
            outline_p95_m: truth.map(|truth| truth.contour.p95_m),
            outline_hausdorff_m: truth.and_then(|truth| truth.contour.hausdorff_m),
            band_coverage: truth.and_then(|truth| truth.contour.band_coverage),
            center_x_m: circle.map(|circle| circle.center.x()),
            center_y_m: circle.map(|circle| circle.center.y()),
            radius_m: circle.map(|circle| circle.radius_m),
            radius_low_m: circle.map(|circle| circle.low_m),
            radius_high_m: circle.and_then(|circle| circle.high_m),
            residual_rms_m: circle.map(|circle| circle.residual_rms_m),
            radius_error_m: circle.zip(truth.and_then(|truth| truth.radius_m)).map(|(circle, m)| circle.radius_m - m),
            center_error_m: truth.and_then(|truth| truth.center_error_m),
        }
    };
    map.objects.iter().enumerate().map(row).collect()
}
