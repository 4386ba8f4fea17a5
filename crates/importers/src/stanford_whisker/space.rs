//! The recordings in space: all three axes of the stage and both bending channels of the Hall sensor.
//!
//! A calibration is a list of labelled contacts; a pin trial has the true contact of every row; a sweep has the pose of the
//! sensor in the frame of the object, and the object's mesh if it is published. `docs/REAL.md` specifies the frames. [`traces`]
//! makes traces of them.

pub(crate) mod traces;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use files::Error;
use nalgebra::{Vector2, Vector3};
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};

use super::{
    Calibrated, FOLDER, IN_PLANE, M_PER_MM, MESHES, MESHES_MM, OBJECTS_MM, OBJECTS_Z_MM, OUT_OF_PLANE, PLANE_M, Row,
    STAGE, Sensor, Table, Test, attempt, calibrated_sensor, folders, lines, stem, tables,
};
use crate::mesh::{self, Triangle};
use crate::registration::{Mounted, pieces};

/// Published mesh of an object, by a word of its name.
const FIXTURES: [(&str, &str); 6] = [
    ("cylinder", "ConeFixture.stl"),
    ("cone", "ConeFixture.stl"),
    ("square", "SquareFixture.stl"),
    ("surface", "FlatFixture.stl"),
    ("step", "StepFixture.stl"),
    ("star", "StarFixture2.stl"),
];

/// Largest extent of a mesh below which its unit cannot be the millimetre.
const SMALLEST_MESH_MM: f64 = 1.0;

/// Rounding of the coordinates of a mesh (mm).
const ROUNDED_MM: f64 = 1e-3;

/// Smallest travel of a stage below which the unit of its positions cannot be the millimetre.
const SMALLEST_TRAVEL_MM: f64 = 1.0;

/// The file of a recording, as far as its trace states it.
#[derive(Clone, Debug, PartialEq)]
struct Source {
    /// Hash of the file.
    sha256: String,
    /// Reading of both bending channels in the first row, from which the readings are counted.
    first_counts: Vector2<f64>,
}

impl Source {
    fn of(table: &Table) -> Self {
        let [out_of_plane, in_plane, _] = table.rows[0].channels;
        Self { sha256: table.sha256.clone(), first_counts: Vector2::new(out_of_plane, in_plane) }
    }
}

/// The recordings of a clone.
#[derive(Debug, Default)]
pub struct SpatialRecordings {
    /// Calibrations, in order of their paths.
    pub calibrations: Vec<SpatialCalibration>,
    /// Trials with a pin that moves against the resting sensor.
    pub pins: Vec<SpatialTrial>,
    /// Sweeps of the sensor over fixed objects.
    pub sweeps: Vec<SpatialSweep>,
    /// Errors of files with unknown names and of tests that could not be read. The others do not depend on them.
    pub failures: Vec<Error>,
}

/// A known contact, and the reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Labelled {
    /// Axis of the pin in the frame of the resting sensor (m), 3x1.
    pub contact_m: Vector3<f64>,
    /// Both bending channels above the reading of the first row (counts), 2x1: out of the whisker's plane, and in it.
    pub counts: Vector2<f64>,
}

/// A calibration: a pin is moved along lines.
#[derive(Clone, Debug)]
pub struct SpatialCalibration {
    /// File.
    pub path: PathBuf,
    /// Name of the file without extension.
    pub name: String,
    /// Readings in order of the file.
    pub rows: Vec<Labelled>,
    /// Indices of the rows of each line.
    pub lines: Vec<Vec<usize>>,
    /// Point about which the root of the wire rotates, by the planar registration (m), 3x1.
    pub root_m: Vector3<f64>,
    /// The wire of the planar registration.
    pub wire: Wire,
    /// The same with the pose of its base.
    mounted: Mounted,
    /// Standard deviations of the noise of both channels at rest (counts).
    noise_sd_counts: Vector2<f64>,
    source: Source,
}

/// The wire of a planar registration, without an end: where its tip is, the registration does not tell.
#[derive(Clone, Debug)]
pub struct Wire {
    elastica: Elastica,
    to_base: Pose<World, Base>,
}

impl Wire {
    /// Length of the wire, beyond the tip of any of these whiskers.
    const LENGTH_M: f64 = 0.08;

    /// `None` if the wire has no elastica.
    fn new(mounted: &Mounted) -> Option<Self> {
        let whisker = with_length(&mounted.whisker, Self::LENGTH_M)?;
        Some(Self { elastica: Elastica::new(&whisker).ok()?, to_base: mounted.base.inverse() })
    }

    /// Arc length of a contact on the wire that it deflects (m). The contact, in the frame of the resting sensor, is projected
    /// onto the whisker's plane. `None` if no wire reaches it.
    pub fn arc_m(&self, contact_m: &Vector3<f64>) -> Option<f64> {
        let contact = self.to_base.apply(Point::new(contact_m.x, contact_m.y));
        self.elastica.at_point(contact).ok().map(|found| found.load.arc_m)
    }
}

/// A registered wire with another length. `None` if it is no straight piece followed by an arc.
fn with_length(whisker: &Whisker, length_m: f64) -> Option<Whisker> {
    let [straight, arc, ..] = whisker.curvature[..] else { return None };
    let [first, second] = pieces(straight.length_m, length_m, arc.curvature_per_m)[..] else { return None };
    // In two parts, because the rotation of a piece is limited.
    let half = whisker::Curvature { length_m: 0.5 * second.length_m, ..second };
    Some(Whisker { length_m, curvature: vec![first, half, half], ..whisker.clone() })
}

/// A pin trial.
#[derive(Clone, Debug)]
pub struct SpatialTrial {
    /// Session and file, unique.
    pub name: String,
    /// Session.
    pub session: String,
    /// Index of the sensor's calibration.
    pub calibration: usize,
    /// Readings with the true positions of the pin.
    pub rows: Vec<Labelled>,
    source: Source,
}

/// A sweep over an object.
#[derive(Clone, Debug)]
pub struct SpatialSweep {
    /// Session and file, unique.
    pub name: String,
    /// Name of the object.
    pub object: String,
    /// Index of the sensor's calibration.
    pub calibration: usize,
    /// Origin of the sensor in the frame of the object (m), and reading above that of the first row (counts), by row. The sensor
    /// is rotated by half a turn about z.
    pub rows: Vec<(Vector3<f64>, Vector2<f64>)>,
    /// Surface of the object in its frame (m). `None` if no mesh of it is published.
    pub mesh: Option<Vec<Triangle>>,
    source: Source,
}

/// Reads the recordings of a clone of the repository in space.
///
/// # Errors
/// [`Error`] if a folder of the layout is missing, or a calibration is damaged, lies in a plane or has one channel.
pub fn stanford_in_space(folder: &Path) -> Result<SpatialRecordings, Error> {
    let data = folder.join(FOLDER);
    let mut recordings = SpatialRecordings::default();
    let mut sensors: Vec<(&'static Sensor, String)> = Vec::new();
    for path in tables(&data.join("calibration"))? {
        match calibrated_sensor(&path) {
            Ok(sensor) => {
                recordings.calibrations.push(calibration(sensor, &path)?);
                sensors.push((sensor, stem(&path)));
            }
            Err(error) => recordings.failures.push(error),
        }
    }
    let mut meshes: BTreeMap<&str, Vec<Triangle>> = BTreeMap::new();
    for session in folders(&data.join("test"))? {
        for path in tables(&session)? {
            if let Err(error) = test(folder, &session, &path, &sensors, &mut meshes, &mut recordings) {
                recordings.failures.push(error);
            }
        }
    }
    Ok(recordings)
}

/// Reads a file, whose positions must be in millimetres.
fn read(path: &Path) -> Result<Table, Error> {
    let table = Table::read(path)?;
    let travel_mm = |axis: usize| {
        let values = || table.rows.iter().map(|row| row.stage_m[axis] / M_PER_MM);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let most_mm = (0..3).map(travel_mm).fold(0.0, f64::max);
    if table.rows.len() > 1 && most_mm < SMALLEST_TRAVEL_MM {
        let found = format!("a stage that travels {most_mm:.3}");
        return Err(table.wrong(STAGE, found, "positions px, py and pz in mm, not in m"));
    }
    Ok(table)
}

/// Readings of both bending channels above that of the first row.
fn channels(table: &Table) -> Result<Vec<Vector2<f64>>, Error> {
    for axis in [OUT_OF_PLANE, IN_PLANE] {
        table.check_channel(axis, "the readings of two bending channels, sx and sy")?;
    }
    let first = table.rows[0].channels;
    let above = |row: &Row| Vector2::new(OUT_OF_PLANE, IN_PLANE).map(|axis| row.channels[axis] - first[axis]);
    Ok(table.rows.iter().map(above).collect())
}

fn on_sensor(sensor: &Sensor, row: &Row) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| row.stage_m[axis] - sensor.reference_mm[axis] * M_PER_MM)
}

fn labelled(sensor: &Sensor, table: &Table) -> Result<Vec<Labelled>, Error> {
    let rows = table.rows.iter().zip(channels(table)?);
    Ok(rows.map(|(row, counts)| Labelled { contact_m: on_sensor(sensor, row), counts }).collect())
}

fn calibration(sensor: &'static Sensor, path: &Path) -> Result<SpatialCalibration, Error> {
    let table = read(path)?;
    let rows = labelled(sensor, &table)?;
    let most_m = rows.iter().map(|row| row.contact_m.z.abs()).fold(0.0, f64::max);
    if most_m < PLANE_M {
        let found = format!("contacts up to {:.3} mm out of the whisker's plane", most_m / M_PER_MM);
        return Err(table.wrong(
            STAGE + 2,
            found,
            "lines of contacts on both sides of the plane, for a model in space",
        ));
    }
    let lines = lines(&table.rows);
    let Calibrated { registration, touch_counts, .. } = Calibrated::read(sensor, path)?;
    let mounted = registration.mounted;
    let root = mounted.base.origin();
    let root_m = Vector3::new(root.x(), root.y(), 0.0);
    let wire = Wire::new(&mounted)
        .ok_or_else(|| Error::value(path, "rows", "none", "contacts that determine the shape of the wire"))?;
    let noise_sd_counts = Vector2::new(OUT_OF_PLANE, IN_PLANE).map(|axis| {
        let rows = table.rows.iter().map(|row| Row { counts: row.channels[axis], ..*row }).collect();
        Table { path: path.into(), rows, sha256: String::new() }.noise_sd_counts(touch_counts)
    });
    let source = Source::of(&table);
    Ok(SpatialCalibration {
        path: path.into(),
        name: stem(path),
        rows,
        lines,
        root_m,
        wire,
        mounted,
        noise_sd_counts,
        source,
    })
}

/// Reads a test.
fn test(
    folder: &Path,
    session: &Path,
    path: &Path,
    sensors: &[(&'static Sensor, String)],
    meshes: &mut BTreeMap<&'static str, Vec<Triangle>>,
    recordings: &mut SpatialRecordings,
) -> Result<(), Error> {
    let kind = Test::of(path)?;
    let (sensor, session_name) = (kind.sensor(), stem(session));
    let fits = |(known, name): &(&Sensor, String)| {
        known.calibration == sensor.calibration && attempt(name) == attempt(&session_name)
    };
    let calibration = sensors.iter().position(fits).ok_or_else(|| {
        let expected = format!("`{}<date>{}.csv`", sensor.calibration, attempt(&session_name));
        Error::value(path, "calibration", "none", format!("{expected} in {FOLDER}/calibration"))
    })?;
    let table = read(path)?;
    let source = Source::of(&table);
    let name = format!("{}-{}", session_name.trim_start_matches("tip_test_"), stem(path));
    match kind {
        Test::Pin(_) => {
            let rows = labelled(sensor, &table)?;
            recordings.pins.push(SpatialTrial { name, session: session_name, calibration, rows, source });
        }
        Test::Sweep(object) => {
            let [x_mm, y_mm] = OBJECTS_MM;
            let origin_m = Vector3::new(x_mm, y_mm, OBJECTS_Z_MM) * M_PER_MM;
            let rows = table.rows.iter().zip(channels(&table)?);
            let rows = rows.map(|(row, counts)| (Vector3::from(row.stage_m) - origin_m, counts)).collect();
            let mesh = mesh(folder, &object, meshes)?;
            recordings.sweeps.push(SpatialSweep { name, object, calibration, rows, mesh, source });
        }
    }
    Ok(())
}

/// The mesh of an object in its frame (m). `None` if there is none.
fn mesh(
    folder: &Path,
    object: &str,
    known: &mut BTreeMap<&'static str, Vec<Triangle>>,
) -> Result<Option<Vec<Triangle>>, Error> {
    let Some(&(_, file)) = FIXTURES.iter().find(|(word, _)| object.contains(word)) else { return Ok(None) };
    let path = folder.join(MESHES).join(file);
    if !path.is_file() {
        return Ok(None);
    }
    if !known.contains_key(file) {
        known.insert(file, placed(&path)?);
    }
    Ok(known.get(file).cloned())
}

/// The mesh of a file in the frame of the objects (m). A mesh above the plane z = 0 instead of below it is taken for one of an
/// object that was mounted upside down: half a turn brings it below. Of the turns about x and y, that about y is the one after
/// which the published readings lie on the star. A reflection at the plane would exchange left and right.
fn placed(path: &Path) -> Result<Vec<Triangle>, Error> {
    let triangles = mesh::triangles(path)?;
    let extent = |axis: usize| {
        let values = || triangles.iter().flatten().map(|corner| corner[axis]);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let most = (0..3).map(extent).fold(0.0, f64::max);
    if most < SMALLEST_MESH_MM {
        let found = format!("a mesh with a largest extent of {most}");
        return Err(Error::value(path, "vertices", found, "coordinates in mm, not in m"));
    }
    // Here z has the direction of the stage, against which the authors measure the heights of contacts.
    let [x_mm, y_mm, z_mm] = MESHES_MM;
    let is_above = triangles.iter().flatten().all(|corner| corner[2] >= -ROUNDED_MM);
    let turn = if is_above { -1.0 } else { 1.0 };
    let place =
        |[x, y, z]: [f64; 3]| [(turn * x + x_mm) * M_PER_MM, (y + y_mm) * M_PER_MM, (turn * z - z_mm) * M_PER_MM];
    Ok(triangles.into_iter().map(|corners| corners.map(place)).collect())
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::fs;

    use super::*;

    /// A calibration whose lines have these heights, and whose first channel reads `sx`.
    fn table(height_mm: f64, sx: impl Fn(i32) -> f64) -> String {
        let mut text = String::from(",px,py,pz,sx,sy,sz\n");
        for row in 0..40_i32 {
            let (line, step) = (f64::from(row / 8), f64::from(row % 8));
            let (x, y, z) = (50.0 - 2.0 * line, 95.0 - step, 16.1023935 + height_mm * (line - 2.0));
            writeln!(text, "{row},{x},{y},{z},{},{},-550", sx(row), 40.0 * step * line).unwrap();
        }
        text
    }

    fn clone_with(calibration: &str) -> tempfile::TempDir {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join(FOLDER);
        fs::create_dir_all(data.join("calibration")).unwrap();
        fs::create_dir_all(data.join("test")).unwrap();
        fs::write(data.join("calibration/sensor1_tip_calib_May_04.csv"), calibration).unwrap();
        home
    }

    #[test]
    fn robust_files_with_unknown_names_are_listed() {
        let home = tempfile::tempdir().unwrap();
        for folder in ["calibration", "test/tip_test_01"].map(|folder| home.path().join(FOLDER).join(folder)) {
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("notes.csv"), "").unwrap();
        }
        let failures = stanford_in_space(home.path()).unwrap().failures;
        assert_eq!(failures.len(), 2);
        assert!(failures.iter().all(|failure| failure.to_string().contains("file name: found notes")), "{failures:?}");
    }

    #[test]
    fn robust_a_calibration_in_a_plane_is_named() {
        let home = clone_with(&table(0.1, f64::from));
        let message = stanford_in_space(home.path()).unwrap_err().to_string();
        assert!(
            message.contains("sensor1_tip_calib_May_04.csv:2: column 4, `pz`: found contacts up to 0.200 mm out of"),
            "{message}"
        );
    }

    #[test]
    fn robust_a_recording_with_one_channel_is_named() {
        let home = clone_with(&table(3.0, |_| 0.0));
        let message = stanford_in_space(home.path()).unwrap_err().to_string();
        assert!(
            message.contains(".csv:2: column 5, `sx`: found 0 in all 40 rows, expected the readings of two bending"),
            "{message}"
        );
        let home = clone_with(&table(3.0, f64::from).replace("sx,sy,sz", "sy,sz"));
        assert!(stanford_in_space(home.path()).is_err());
    }

    /// A mesh file with one triangle, whose corners are in mm.
    fn triangle(corners_mm: [[f32; 3]; 3]) -> tempfile::NamedTempFile {
        let mut bytes = vec![0u8; 80];
        bytes.extend(1u32.to_le_bytes());
        let numbers = [0.0_f32, 0.0, 1.0].into_iter().chain(corners_mm.into_iter().flatten());
        bytes.extend(numbers.flat_map(f32::to_le_bytes).chain([0, 0]));
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), bytes).unwrap();
        file
    }

    #[test]
    fn verif_a_mesh_above_the_plane_is_turned_not_reflected() {
        let placed = |corners_mm| placed(triangle(corners_mm).path()).unwrap()[0].map(Vector3::from);
        let below = [[10.0, 0.0, -5.0], [0.0, 10.0, -6.0], [0.0, 0.0, -7.0]];
        let above = below.map(|[x, y, z]: [f32; 3]| [-x, y, -z]);
        let (one, other) = (placed(below), placed(above));
        for (a, b) in one.iter().zip(&other) {
            assert!((a - b).norm() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn robust_a_mesh_in_metres_is_named() {
        let file = triangle([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.04, 0.0]]);
        let message = placed(file.path()).unwrap_err().to_string();
        assert!(message.contains("expected coordinates in mm, not in m"), "{message}");
    }
}
