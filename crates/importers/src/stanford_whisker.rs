//! Recordings of HaoLiRobo/WhiskerSensing: a whisker on a Hall sensor and a three-axis stage, without a clock.
//!
//! Source: Li, Wang, Lin et al., "Navigation and 3D surface reconstruction from passive whisker sensing", arXiv
//! 2406.06038, 2024; MIT licence. Layout:
//!
//! ```text
//! DIR/data/all_datasets/calibration/<sensor>_calib_<date>[_try<n>].csv   a pin on the stage is moved through a grid and read at each point
//! DIR/data/all_datasets/test/tip_test_<date>[_try<n>]/
//!     <sensor>_test_<date>[_trial<n>].csv                                pin trial: the pin moves, the sensor rests
//!     <object>tip_test_scan_object_<date>_trial<n>.csv                   object sweep: the sensor on the stage moves over a fixed object
//!     tip_test_<object>_<date>_trial<n>.csv                              the same
//! DIR/data/3d_data/<fixture>.stl                                         the objects
//! ```
//!
//! Each file is a table `,px,py,pz,sx,sy,sz`: stage position in mm and the three axes of the Hall sensor in counts, one
//! row per stage step. The first row is far from contact. A test belongs to the calibration of its sensor with the same
//! `_try<n>`.
//!
//! The planar part is imported: `px`, `py` and `sy`. The plane is that of the whisker, at the height of the sensor's
//! reference; known contacts farther from it than [`PLANE_M`] are dropped. `docs/REAL.md` specifies frames, time and
//! units.

pub(crate) mod space;

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

use files::read_table;
use files::table::{cell_error, number, reader};
use files::{Digest, Error, FORMAT, sha256};
use trace::{
    Contour, FARTHEST_M, Instant, ObjectClass, Outline, Recorded, Recording, Role, Sidecar, Trace, Truth, TruthInstant,
};
use whisker::Whisker;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;

use crate::mesh::section;
use crate::provenance::generator;
use crate::registration::{Mounted, Pressed, Registration, pieces, register};
use crate::{Imported, MOST_COUNTS, Progress};

pub(crate) const NAME: &str = "stanford-whisker";

const FOLDER: &str = "data/all_datasets";
const COLUMNS: [&str; 7] = ["", "px", "py", "pz", "sx", "sy", "sz"];

/// Index of the first column of the stage's position.
const STAGE: usize = 1;

/// Index of the first column of the sensor.
const SENSOR: usize = 4;

/// Axes of the sensor that bend with the whisker out of its plane and in it.
const OUT_OF_PLANE: usize = 0;
const IN_PLANE: usize = 1;

const M_PER_MM: f64 = 1e-3;

/// Largest distance of a planar contact from the plane.
const PLANE_M: f64 = 0.5e-3;

/// Nominal row rate of recordings without a clock, approximately that of a stage that stops at each row.
const NOMINAL_RATE_HZ: f64 = 10.0;

/// Contact threshold as a fraction of the largest reading of the calibration, above drift and residual friction.
const TOUCH_SHARE: f64 = 0.02;

/// Number of traces into which a calibration is split, line by line, so that whole lines can be held out.
const CALIBRATION_TRACES: usize = 8;

/// Origin of the object frame on the stage, x and y: the hole that the rig's authors located with a standoff, minus the
/// offset of the standoff from the sensor.
const OBJECTS_MM: [f64; 2] = [70.1297 - 9.703, 92.3684 - 5.5];

/// Height of the origin of the object frame on the stage.
const OBJECTS_Z_MM: f64 = 47.022_115_12;

const MESHES: &str = "data/3d_data";

/// Published mesh and class of an object, by a word of its name.
const FIXTURES: [Fixture; 3] = [
    Fixture { word: "cylinder", mesh: "ConeFixture.stl", class: ObjectClass::Round },
    Fixture { word: "square", mesh: "SquareFixture.stl", class: ObjectClass::Other },
    Fixture { word: "surface", mesh: "FlatFixture.stl", class: ObjectClass::Other },
];

/// Offset of the meshes in the object frame, with negated height.
const MESHES_MM: [f64; 3] = [0.5, 12.5, -0.5];

/// A kind of object of the sweeps.
struct Fixture {
    /// Part of the names of such objects.
    word: &'static str,
    /// File name of the published mesh.
    mesh: &'static str,
    class: ObjectClass,
}

impl Fixture {
    /// The kind of the object with this name.
    fn named(object: &str) -> Option<&'static Self> {
        FIXTURES.iter().find(|fixture| object.contains(fixture.word))
    }
}

/// Sensor of the rig.
struct Sensor {
    /// Prefix of its calibration files.
    calibration: &'static str,
    /// Prefix of its pin trials.
    pin_trial: &'static str,
    /// Stage position of the whisker base's origin, as given by the authors.
    reference_mm: [f64; 3],
    /// Straight length and curvature of the wire in its drawing: initial guess of the registration.
    straight_m: f64,
    curvature_per_m: f64,
}

const SENSORS: [Sensor; 3] = [
    Sensor {
        calibration: "curved_calib_",
        pin_trial: "curved_test_",
        reference_mm: [63.479219625, 98.55717525, 16.1023935],
        straight_m: 0.005,
        curvature_per_m: -50.0,
    },
    Sensor {
        calibration: "sensor1_tip_calib_",
        pin_trial: "tip_test_",
        reference_mm: [64.30451325, 98.0687005, 16.1023935],
        straight_m: 0.03,
        curvature_per_m: -50.0,
    },
    Sensor {
        calibration: "straight_calib_",
        pin_trial: "straight_test_",
        reference_mm: [83.57682675, 95.12641312, 34.03387275],
        straight_m: 0.03,
        curvature_per_m: 0.0,
    },
];

/// Sensor used in object sweeps.
const SWEEPING: &Sensor = &SENSORS[1];

impl Sensor {
    /// Wire in its drawing, in the rig's frame with the reference as its origin: along -y, with the root slightly
    /// inside the suspension.
    fn drawing(&self, name: String) -> Mounted {
        let whisker = Whisker {
            name,
            curvature: pieces(self.straight_m, 0.05, self.curvature_per_m),
            damping_s: 0.0,
            ..Whisker::stanford()
        };
        Mounted { whisker, base: Pose::new(0.0, 0.006, -1.8) }
    }
}

/// Imports a clone of the repository.
///
/// # Errors
/// [`Error`] if a folder of the layout is missing or a calibration is damaged. Damaged tests are listed in `failures`.
pub(crate) fn import(folder: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    let data = folder.join(FOLDER);
    let calibrations = tables(&data.join("calibration"))?;
    let mut tests = Vec::new();
    for session in folders(&data.join("test"))? {
        tests.extend(tables(&session)?.into_iter().map(|path| (session.clone(), path)));
    }
    let (mut done, all) = (0, (calibrations.len() + tests.len()) as u64);
    let mut advance = || {
        progress(done, all);
        done += 1;
    };
    let mut calibrated: BTreeMap<PathBuf, Calibrated> = BTreeMap::new();
    let mut imported = Imported::default();
    for path in calibrations {
        advance();
        let sensor = match calibrated_sensor(&path) {
            Ok(sensor) => sensor,
            Err(error) => {
                imported.failures.push(error);
                continue;
            }
        };
        let calibration = Calibrated::read(sensor, &path)?;
        imported.traces.extend(calibration.traces());
        calibrated.insert(path, calibration);
    }
    for (session, path) in tests {
        advance();
        match import_test(folder, &session, &path, &calibrated) {
            Ok((trace, outline)) => {
                imported.outlines.extend(outline);
                imported.traces.push(trace);
            }
            Err(error) => imported.failures.push(error),
        }
    }
    Ok(imported)
}

/// Imports a test, with the outline of its object if a mesh is published.
fn import_test(
    folder: &Path,
    session: &Path,
    path: &Path,
    calibrated: &BTreeMap<PathBuf, Calibrated>,
) -> Result<(Trace, Option<(String, Outline)>), Error> {
    let test = Test::of(path)?;
    let (sensor, session_name) = (test.sensor(), stem(session));
    let fits = |known: &&Calibrated| {
        known.sensor.calibration == sensor.calibration && attempt(&stem(&known.table.path)) == attempt(&session_name)
    };
    let calibration = calibrated.values().find(fits).ok_or_else(|| {
        let expected = format!("`{}<date>{}.csv`", sensor.calibration, attempt(&session_name));
        Error::value(path, "calibration", "none", format!("{expected} in {FOLDER}/calibration"))
    })?;
    let table = Table::read_planar(path)?;
    let mut trace = calibration.test(&session_name, &table, &test);
    let Test::Sweep(object) = &test else { return Ok((trace, None)) };
    let Some(outline) = fixture(folder, object, table.rows[0].stage_m[2])? else { return Ok((trace, None)) };
    let file = format!("{}.contour.csv", trace.sidecar.name);
    // The outline is exact: the object was made from the mesh.
    trace.sidecar.contour = Some(Contour { file: file.clone(), sha256: sha256(outline.to_csv()), chord_error_m: 0.0 });
    Ok((trace, Some((file, outline))))
}

/// Outline of an object in its frame, at the height of the sensor's plane for a stage at `stage_z_m`. `None` if there
/// is no mesh of it.
fn fixture(folder: &Path, object: &str, stage_z_m: f64) -> Result<Option<Outline>, Error> {
    let Some(fixture) = Fixture::named(object) else { return Ok(None) };
    let path = folder.join(MESHES).join(fixture.mesh);
    if !path.is_file() {
        return Ok(None);
    }
    let [x_mm, y_mm, z_mm] = MESHES_MM;
    // Contact heights are measured downwards from the frame's origin; mesh heights are negated and shifted.
    let height_mm = stage_z_m / M_PER_MM - OBJECTS_Z_MM + z_mm;
    let outer = section(&path, height_mm)?;
    let place = |[x, y]: [f64; 2]| Point::new((x + x_mm) * M_PER_MM, (y + y_mm) * M_PER_MM);
    Ok(Outline::new(outer.into_iter().map(place).collect()))
}

/// Kind of a test, by its file name.
enum Test {
    /// A pin moves against the resting sensor.
    Pin(&'static Sensor),
    /// The sensor moves over an object.
    Sweep(String),
}

/// The sensor of a calibration, by the name of its file.
fn calibrated_sensor(path: &Path) -> Result<&'static Sensor, Error> {
    let stem = stem(path);
    SENSORS.iter().find(|sensor| stem.starts_with(sensor.calibration)).ok_or_else(|| {
        let known = SENSORS.map(|sensor| sensor.calibration).join(", ");
        Error::value(path, "file name", &stem, format!("one that begins with {known}"))
    })
}

impl Test {
    /// The test that the name of a file states.
    fn of(path: &Path) -> Result<Self, Error> {
        const EXPECTED: &str = "`<sensor>_test_<date>` or `<object>tip_test_scan_object_<date>`";
        Self::named(&stem(path)).ok_or_else(|| Error::value(path, "file name", stem(path), EXPECTED))
    }

    fn named(stem: &str) -> Option<Self> {
        const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
        let date = MONTHS.iter().filter_map(|month| stem.find(&format!("{month}_"))).min()?;
        let what = &stem[..date];
        if let Some(sensor) = SENSORS.iter().find(|sensor| sensor.pin_trial == what) {
            return Some(Self::Pin(sensor));
        }
        let object = what.replace("tip_test", "").replace("scan_object", "");
        let object = object.trim_matches('_');
        (what.contains("tip_test") && !object.is_empty()).then(|| Self::Sweep(object.into()))
    }

    fn sensor(&self) -> &'static Sensor {
        match self {
            Self::Pin(sensor) => sensor,
            Self::Sweep(_) => SWEEPING,
        }
    }
}

/// Suffix `_try<n>`, or an empty string.
fn attempt(stem: &str) -> &str {
    stem.rfind("_try").map_or("", |start| &stem[start..])
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn listed(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).map_err(|_| {
        Error::value(folder, "folder", "none", format!("a clone of the repository, with {FOLDER} in it"))
    })?;
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.map_err(Error::io(folder))?.path());
    }
    paths.sort();
    Ok(paths)
}

fn tables(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    Ok(listed(folder)?.into_iter().filter(|path| path.extension().is_some_and(|it| it == "csv")).collect())
}

fn folders(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    Ok(listed(folder)?.into_iter().filter(|path| path.is_dir()).collect())
}

/// Row of a file.
#[derive(Clone, Copy)]
struct Row {
    /// Stage position.
    stage_m: [f64; 3],
    /// In-plane channel of the sensor.
    counts: f64,
    /// All axes of the sensor, of which `counts` is the second.
    channels: [f64; 3],
}

/// Largest position of a stage (mm): a tenth of that of a trace, which the registration of the wire shifts.
const FARTHEST_MM: f64 = 0.1 * FARTHEST_M / M_PER_MM;

/// Contents of a file.
struct Table {
    path: PathBuf,
    rows: Vec<Row>,
    sha256: String,
}

impl Table {
    fn read(path: &Path) -> Result<Self, Error> {
        let bytes = read_table(path)?;
        let mut rows = Vec::new();
        for row in reader(path, &bytes, &COLUMNS)? {
            let (line, record) = row?;
            let cell = |i| number(path, line, &record, &COLUMNS, i);
            let stage = |i| match cell(i)? {
                place_mm if place_mm.abs() <= FARTHEST_MM => Ok(place_mm * M_PER_MM),
                _ => {
                    let expected = format!("a stage position of a magnitude of at most {FARTHEST_MM} mm");
                    Err(cell_error(path, line, &record, &COLUMNS, i, &expected))
                }
            };
            let stage_m = [stage(STAGE)?, stage(STAGE + 1)?, stage(STAGE + 2)?];
            let counts = |i| match cell(i)? {
                counts if counts.abs() <= MOST_COUNTS => Ok(counts),
                _ => {
                    let expected = format!("a magnitude of at most {MOST_COUNTS} counts");
                    Err(cell_error(path, line, &record, &COLUMNS, i, &expected))
                }
            };
            let channels = [counts(SENSOR)?, counts(SENSOR + 1)?, counts(SENSOR + 2)?];
            rows.push(Row { stage_m, counts: channels[IN_PLANE], channels });
        }
        if rows.is_empty() {
            return Err(Error::Table {
                path: path.into(),
                line: 2,
                place: "row".into(),
                found: "the end of the file".into(),
                expected: "at least one row".into(),
            });
        }
        Ok(Self { path: path.into(), rows, sha256: sha256(&bytes) })
    }

    /// Reads a file whose planar part is imported.
    fn read_planar(path: &Path) -> Result<Self, Error> {
        let table = Self::read(path)?;
        table.check_channel(IN_PLANE, "varying readings of the bending channel in the whisker's plane")?;
        Ok(table)
    }

    /// Checks that a channel does not have the same reading in all rows, as that of a sensor that has failed.
    fn check_channel(&self, axis: usize, expected: &str) -> Result<(), Error> {
        let first = self.rows[0].channels[axis];
        if self.rows.len() == 1 || self.rows.iter().any(|row| row.channels[axis] != first) {
            return Ok(());
        }
        Err(self.wrong(SENSOR + axis, format!("{first} in all {} rows", self.rows.len()), expected))
    }

    /// Error of a column of [`COLUMNS`] as a whole, at its first value.
    fn wrong(&self, column: usize, found: String, expected: &str) -> Error {
        let place = format!("column {}, `{}`", column + 1, COLUMNS[column]);
        Error::Table { path: self.path.clone(), line: 2, place, found, expected: expected.into() }
    }

    /// Reading far from contact.
    fn rest_counts(&self) -> f64 {
        self.rows[0].counts
    }

    /// Standard deviation of the reading at rest, from differences between consecutive visits of the first row's
    /// position, which suppress drift. With too few visits, from differences between consecutive readings within
    /// `touch_counts` of rest.
    fn noise_sd_counts(&self, touch_counts: f64) -> f64 {
        const ENOUGH: usize = 3;
        let counts_of = |is_rest: &dyn Fn(&Row) -> bool| -> Vec<f64> {
            self.rows.iter().filter(|row| is_rest(row)).map(|row| row.counts).collect()
        };
        let visits = counts_of(&|row| row.stage_m == self.rows[0].stage_m);
        let readings = match visits.len() {
            ENOUGH.. => visits,
            _ => counts_of(&|row| (row.counts - self.rest_counts()).abs() < touch_counts),
        };
        let steps: f64 = readings.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).fold(0.0, |sum, step| sum + step);
        // The difference of two independent readings has twice the variance of one.
        (steps / (2.0 * (readings.len().max(2) - 1) as f64)).sqrt()
    }
}

/// Position of the stage (and hence of a pin on it) in the frame of a resting sensor, whose origin is the sensor's
/// reference.
fn on_sensor(sensor: &Sensor, row: &Row) -> Point<World> {
    let [x, y, _] = row.stage_m;
    Point::new(x - sensor.reference_mm[0] * M_PER_MM, y - sensor.reference_mm[1] * M_PER_MM)
}

fn is_planar(sensor: &Sensor, row: &Row) -> bool {
    (row.stage_m[2] - sensor.reference_mm[2] * M_PER_MM).abs() < PLANE_M
}

/// Calibration with its registration, common to all recordings of the sensor.
struct Calibrated {
    sensor: &'static Sensor,
    table: Table,
    registration: Registration,
    /// Contact threshold in counts.
    touch_counts: f64,
    noise_sd_counts: f64,
}

impl Calibrated {
    fn read(sensor: &'static Sensor, path: &Path) -> Result<Self, Error> {
        let table = Table::read_planar(path)?;
        let rest_counts = table.rest_counts();
        let planar: Vec<Pressed> = table
            .rows
            .iter()
            .filter(|row| is_planar(sensor, row))
            .map(|row| Pressed { pin: on_sensor(sensor, row), counts: row.counts - rest_counts })
            .collect();
        let largest_counts = planar.iter().map(|sample| sample.counts.abs()).fold(0.0, f64::max);
        let touch_counts = TOUCH_SHARE * largest_counts;
        let touching: Vec<Pressed> = planar.into_iter().filter(|sample| sample.counts.abs() > touch_counts).collect();
        let name = format!("stanford-{}", stem(path).replace("_calib", ""));
        let registration = register(&sensor.drawing(name), &touching).ok_or_else(|| {
            let found = format!("{} in contact within {} mm of the plane", touching.len(), PLANE_M / M_PER_MM);
            Error::value(
                path,
                "rows",
                found,
                "enough contacts, sufficiently spread, to determine the wire's pose and shape",
            )
        })?;
        let noise_sd_counts = table.noise_sd_counts(touch_counts);
        Ok(Self { sensor, table, registration, touch_counts, noise_sd_counts })
    }

    /// Splits the calibration into traces: planar lines are assigned to the traces in turn. Lines between the same end
    /// points go to the same trace.
    fn traces(&self) -> Vec<Trace> {
        let lines = lines(&self.table.rows);
        let ends = |line: &[usize]| {
            let place = |i: usize| self.table.rows[i].stage_m.map(|m| (m / 1e-4).round() as i64);
            line.first().zip(line.last()).map(|(first, last)| (place(*first), place(*last)))
        };
        let mut traces_of_ends = BTreeMap::new();
        let mut rows: Vec<Vec<usize>> = vec![Vec::new(); CALIBRATION_TRACES];
        let is_kept = |&row: &usize| {
            let row = &self.table.rows[row];
            is_planar(self.sensor, row) && (row.counts - self.table.rest_counts()).abs() > self.touch_counts
        };
        for line in lines.iter().filter(|line| line.iter().any(is_kept)) {
            let next = traces_of_ends.len() % CALIBRATION_TRACES;
            rows[*traces_of_ends.entry(ends(line)).or_insert(next)].extend(line);
        }
        let stem = stem(&self.table.path);
        let dealt = rows.iter_mut().enumerate().filter_map(|(i, rows)| {
            rows.sort_unstable();
            rows.retain(is_kept);
            (!rows.is_empty()).then(|| {
                // World is the frame of the resting sensor.
                let base = self.registration.mounted.base;
                let instants = rows.iter().map(|&row| {
                    let at = &self.table.rows[row];
                    self.instant(&self.table, row, base, Some(on_sensor(self.sensor, at)))
                });
                let head =
                    Head { name: format!("{stem}_{i}"), role: Role::Calibration, group: "calibration", object: "pin" };
                self.trace(head, &self.table, instants)
            })
        });
        dealt.collect()
    }

    fn test(&self, session: &str, table: &Table, test: &Test) -> Trace {
        let name = format!("{}-{}", session.trim_start_matches("tip_test_"), stem(&table.path));
        let mount = &self.registration.mounted.base;
        let (group, object) = match test {
            Test::Pin(_) => ("real pins", "pin"),
            Test::Sweep(object) => ("real objects", object.as_str()),
        };
        let instants = table.rows.iter().enumerate().map(|(i, row)| match test {
            // World is fixed to the pin: the sensor moves against the stage.
            Test::Pin(_) => {
                let pin = on_sensor(self.sensor, row).vector();
                let sensor: Pose<World, World> = Pose::new(-pin.x, -pin.y, 0.0);
                let truth = is_planar(self.sensor, row).then(|| Point::new(0.0, 0.0));
                self.instant(table, i, mount.then(&sensor), truth)
            }
            // The sensor moves with the stage, rotated by 180 degrees relative to the calibration.
            Test::Sweep(_) => {
                let [x, y, _] = row.stage_m;
                let [origin_x, origin_y] = OBJECTS_MM.map(|mm| mm * M_PER_MM);
                let sensor: Pose<World, World> = Pose::new(x - origin_x, y - origin_y, PI);
                self.instant(table, i, mount.then(&sensor), None)
            }
        });
        self.trace(Head { name, role: Role::Trial, group, object }, table, instants)
    }

    /// Instant of a row. While the whisker is in contact, the true contact is `pin`, if known.
    fn instant(
        &self,
        table: &Table,
        row: usize,
        base: Pose<Base, World>,
        pin: Option<Point<World>>,
    ) -> (Instant, TruthInstant) {
        let counts = table.rows[row].counts - table.rest_counts();
        let known = Instant {
            t_s: row as f64 / NOMINAL_RATE_HZ,
            base,
            twist: None,
            moment_z_n_m: self.registration.characteristic.moment_n_m(counts),
            rotation_z_rad: None,
        };
        let contact = pin.filter(|_| counts.abs() > self.touch_counts);
        (known, TruthInstant { touching: contact.map(|_| true), contact, ..TruthInstant::default() })
    }

    fn trace(&self, head: Head<'_>, table: &Table, instants: impl Iterator<Item = (Instant, TruthInstant)>) -> Trace {
        let Registration { mounted, characteristic, largest_n_m, residual_counts } = &self.registration;
        let coefficients: [f64; 3] = std::array::from_fn(|i| characteristic.coefficients[i]);
        let [counts_per_n_m, ..] = coefficients;
        let (recording, truth): (Vec<_>, Vec<_>) = instants.unzip();
        let mut inputs = Digest::default();
        inputs.add(&table.sha256).add(&self.table.sha256).add(source_sha256());
        let sidecar = Sidecar {
            format: FORMAT,
            kind: "trace".into(),
            name: head.name,
            role: head.role,
            group: head.group.into(),
            object: head.object.into(),
            face: Face::of_reading(*largest_n_m),
            seed: 0,
            rate_hz: NOMINAL_RATE_HZ,
            rows: recording.len(),
            whisker: mounted.whisker.clone(),
            scene: serde_json::Value::Null,
            generator: generator(NAME, source_sha256()),
            inputs_sha256: inputs.finish(),
            csv_sha256: String::new(),
            contour: None,
            certificate: None,
            recorded: Some(Recorded {
                clock: "nominal, a row a stage step".into(),
                characteristic: coefficients,
                range_n_m: Some(characteristic.range_n_m),
                residual_counts: *residual_counts,
                rest_counts: table.rest_counts(),
                noise_sd_n_m: self.noise_sd_counts / counts_per_n_m.abs(),
                touch_counts: self.touch_counts,
                object_class: Some(class_of(head.object)),
            }),
            recording: None,
            replay: None,
        };
        let mut trace =
            Trace { sidecar, recording: Recording { instants: recording }, truth: Truth { instants: truth } };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace
    }
}

/// Class of an object by its name.
fn class_of(object: &str) -> ObjectClass {
    Fixture::named(object).map_or_else(|| ObjectClass::of_shape(object), |fixture| fixture.class)
}

/// Name and classification of a trace.
struct Head<'a> {
    name: String,
    role: Role,
    group: &'a str,
    object: &'a str,
}

fn source_sha256() -> String {
    let mut sources = Digest::default();
    for source in
        [&include_bytes!("stanford_whisker.rs")[..], include_bytes!("registration.rs"), include_bytes!("mesh.rs")]
    {
        sources.add(source);
    }
    sources.finish()
}

/// Splits a grid into lines with constant steps; returns the row indices of each line.
fn lines(rows: &[Row]) -> Vec<Vec<usize>> {
    const EVEN_M: f64 = 1e-5;
    let step = |i: usize| -> [f64; 3] { std::array::from_fn(|axis| rows[i].stage_m[axis] - rows[i - 1].stage_m[axis]) };
    let mut lines: Vec<Vec<usize>> = Vec::new();
    for i in 0..rows.len() {
        let goes_on = lines.last().is_some_and(|line| {
            line.len() == 1 || step(i).iter().zip(step(i - 1)).all(|(now, before)| (now - before).abs() < EVEN_M)
        });
        if goes_on {
            lines.last_mut().expect("it goes on").push(i);
        } else {
            lines.push(vec![i]);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_file_names_determine_the_kind_of_test() {
        let sweep = |stem: &str| match Test::named(stem) {
            Some(Test::Sweep(object)) => object,
            _ => panic!("{stem} is no sweep"),
        };
        assert!(
            matches!(Test::named("curved_test_May_22_trial3"), Some(Test::Pin(sensor)) if sensor.curvature_per_m < 0.0)
        );
        assert!(matches!(Test::named("tip_test_May_04"), Some(Test::Pin(_))));
        assert_eq!(sweep("reference_double_squaretip_test_scan_object_May_19_trial0"), "reference_double_square");
        assert_eq!(sweep("tip_test_cylinder_30mm_May_09_trial10"), "cylinder_30mm");
        assert!(Test::named("notes").is_none() && Test::named("random_May_04").is_none());
        assert_eq!((attempt("curved_calib_May_22_try2"), attempt("tip_test_05_22_23")), ("_try2", ""));
    }

    #[test]
    fn verif_a_grid_is_split_into_its_lines() {
        let row = |x: f64, y: f64| Row { stage_m: [x, y, 0.0], counts: 0.0, channels: [0.0; 3] };
        let rows: Vec<Row> = (0..12).map(|i| row(1e-3 * f64::from(i % 4), 2e-3 * f64::from(i / 4))).collect();
        assert_eq!(lines(&rows), [vec![0, 1, 2, 3], vec![4, 5, 6, 7], vec![8, 9, 10, 11]]);
    }
}
