//! Import, fit and evaluation of synthetic recordings of a known wire in the layout of the public whisker data set.

mod command;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use files::{sha256, write_json};
use nalgebra::{Vector3, Vector6};
use trace::{SpatialCalibrationFile, SpatialTrace};
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};
use whisker::rod::Rod;
use whisker::{Curvature, Whisker};

use command::{assert_fails, text, whisker};

const CALIBRATION: &str = "data/all_datasets/calibration/curved_calib_May_22_try2.csv";
const TRIAL: &str = "data/all_datasets/test/tip_test_05_22_23_try2/curved_test_May_22_trial0.csv";
const SWEEP: &str = "data/all_datasets/test/tip_test_05_25_23/reference_cylindertip_test_scan_object_May_25_trial0.csv";

const SWEEPING: &str = "data/all_datasets/calibration/sensor1_tip_calib_May_04.csv";

/// Quantile of 99 % of the chi-squared distribution with six degrees of freedom.
const CHI2_6_99: f64 = 16.81;

/// Runs a command that must succeed. Returns stdout followed by stderr.
fn good(arguments: &[&str]) -> String {
    let output = whisker(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?} ended with {:?}: {errors}", output.status);
    String::from_utf8(output.stdout).unwrap() + &errors
}

/// A wire and its pose on the rig, both different from the drawing, as on a real rig.
struct Rig {
    elastica: Elastica,
    rod: Rod,
    base: Pose<World, Base>,
    reference_mm: [f64; 3],
}

impl Rig {
    fn curved() -> Self {
        Self::new([(0.004, 0.0), (0.026, -48.0), (0.026, -48.0)], [63.479219625, 98.55717525, 16.1023935])
    }

    fn sweeping() -> Self {
        Self::new([(0.034, 0.0), (0.011, -48.0), (0.011, -48.0)], [64.30451325, 98.0687005, 16.1023935])
    }

    fn new(curvature: [(f64, f64); 3], reference_mm: [f64; 3]) -> Self {
        let wire = Whisker { youngs_modulus_pa: 40e9, damping_s: 0.0, ..Whisker::stanford() }
            .named("wire")
            .with_curvature(curvature.map(|(length_m, curvature_per_m)| Curvature::new(length_m, curvature_per_m)));
        let base: Pose<Base, World> = Pose::new(0.001, 0.0055, -1.85);
        let (elastica, rod) = (Elastica::new(&wire).unwrap(), Rod::round(&wire, 0.33).unwrap());
        Self { elastica, rod, base: base.inverse(), reference_mm }
    }

    /// Reading (counts) with the pin at this offset from the reference (mm). Equals the reading at rest if the pin does
    /// not touch or is on the other side of the wire.
    fn counts(&self, x_mm: f64, y_mm: f64) -> f64 {
        let pin = self.base.apply(Point::new(1e-3 * x_mm, 1e-3 * y_mm));
        let moment_n_m = self.elastica.at_point(pin).map_or(0.0, |contact| contact.deflection.moment_n_m.min(0.0));
        -40.0 - 2e7 * moment_n_m - 5e14 * moment_n_m.powi(3)
    }

    /// Readings of both channels (counts) with a pin that holds the wire at this offset from the reference (mm), of a sensor that
    /// is turned about the whisker.
    fn counts_in_space(&self, [x_mm, y_mm, z_mm]: [f64; 3]) -> [f64; 2] {
        let pin = self.base.apply(Point::new(1e-3 * x_mm, 1e-3 * y_mm));
        let contact = self.rod.at_point(Vector3::new(pin.x(), pin.y(), 1e-3 * z_mm));
        let moment_n_m = contact.map_or(Vector3::zeros(), |contact| contact.deflection.moment_n_m);
        // The pin touches one side of the wire.
        let [y_n_m, z_n_m] = if moment_n_m.z < 0.0 { [moment_n_m.y, moment_n_m.z] } else { [0.0; 2] };
        [90.0 + 1.8e7 * y_n_m + 6e6 * z_n_m, -40.0 + 2e6 * y_n_m - 2e7 * z_n_m - 5e14 * z_n_m.powi(3)]
    }

    fn table_in_space(&self, places_mm: impl IntoIterator<Item = [f64; 3]>) -> String {
        let mut table = String::from(",px,py,pz,sx,sy,sz\n");
        for (index, place) in places_mm.into_iter().enumerate() {
            let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| self.reference_mm[axis] + place[axis]);
            let noise = if index.is_multiple_of(2) { 2.0 } else { -2.0 };
            let [first, second] = self.counts_in_space(place).map(|counts| counts + noise);
            writeln!(table, "{index},{x},{y},{z},{first},{second},-550.0").unwrap();
        }
        table
    }

    fn row(&self, table: &mut String, index: usize, (x_mm, y_mm): (f64, f64)) {
        let [x, y, z] = [self.reference_mm[0] + x_mm, self.reference_mm[1] + y_mm, self.reference_mm[2]];
        let counts = self.counts(x_mm, y_mm) + if index.is_multiple_of(2) { 2.0 } else { -2.0 };
        writeln!(table, "{index},{x},{y},{z},90.0,{counts},-550.0").unwrap();
    }

    fn table(&self, places_mm: impl IntoIterator<Item = (f64, f64)>) -> String {
        let mut table = String::from(",px,py,pz,sx,sy,sz\n");
        places_mm.into_iter().enumerate().for_each(|(index, place)| self.row(&mut table, index, place));
        table
    }
}

/// Path of the mesh of the swept object.
const MESH: &str = "data/3d_data/ConeFixture.stl";

/// Binary STL of a square tube, 20 mm wide, with the same section at every height.
fn mesh() -> Vec<u8> {
    let corners = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]];
    let mut bytes = vec![0; 80];
    bytes.extend(8u32.to_le_bytes());
    for i in 0..4 {
        let ([ax, ay], [bx, by]): ([f32; 2], [f32; 2]) = (corners[i], corners[(i + 1) % 4]);
        let (low, high) = (-60.0, 0.0);
        for triangle in
            [[[ax, ay, low], [bx, by, low], [bx, by, high]], [[ax, ay, low], [bx, by, high], [ax, ay, high]]]
        {
            let numbers = [0.0; 3].into_iter().chain(triangle.into_iter().flatten());
            bytes.extend(numbers.flat_map(f32::to_le_bytes).chain([0, 0]));
        }
    }
    bytes
}

/// Clone of the repository with two calibrations, one pin trial and one sweep.
fn clone() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (curved, sweeping) = (Rig::curved(), Rig::sweeping());
    // Lines along -x from the side on which the whisker is free, each after one reading at rest.
    let grid = |lines: u32| {
        (0..lines).flat_map(|j| {
            let line = (0..21).map(move |i| (3.0 - 2.0 * f64::from(i), -0.6 - 1.1 * f64::from(j)));
            std::iter::once((5.0, 0.0)).chain(line)
        })
    };
    let line = || (0..90).map(|i| (3.0 - 0.5 * f64::from(i), -3.3));
    let tables = [
        (CALIBRATION, curved.table(grid(9))),
        (TRIAL, curved.table(line())),
        (SWEEPING, sweeping.table(grid(9))),
        (SWEEP, sweeping.table(line())),
    ];
    for (path, table) in tables {
        write(&folder.path().join(path), &table);
    }
    fs::create_dir_all(folder.path().join(MESH).parent().unwrap()).unwrap();
    fs::write(folder.path().join(MESH), mesh()).unwrap();
    folder
}

fn write(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// A column of a table.
fn column(path: &Path, name: &str) -> Vec<String> {
    let mut table = csv::Reader::from_path(path).unwrap();
    let place = table.headers().unwrap().iter().position(|column| column == name).unwrap();
    table.records().map(|row| row.unwrap()[place].to_owned()).collect()
}

#[test]
fn verif_known_contacts_are_found_in_imported_recordings() {
    let (source, work) = (clone(), tempfile::tempdir().unwrap());
    let dataset = work.path().join("stanford");
    let output = good(&["import", "stanford-whisker", text(source.path()), "--out", text(&dataset)]);
    assert!(output.contains("real pins") && output.contains("real objects"), "{output}");
    good(&["check", text(&dataset)]);
    good(&["fit", text(&dataset), "--model", "elastica"]);
    let results = work.path().join("results");
    // The contact is the pin's axis, which is at rest.
    let config = work.path().join("config.json");
    write(&config, r#"{"ekf": {"motion": {"kind": "resting"}}}"#);
    let run = ["evaluate", text(&dataset), "--estimators", "ekf", "--seeds", "1", "--starts", "wrong"];
    let output = good(&[&run[..], &["--config", text(&config), "--results", text(&results)]].concat());
    assert!(output.contains("wrong prior") && output.contains("not scored"), "{output}");
    let trials = results.join("stanford/trials.csv");
    let errors = column(&trials, "late_mean_m");
    assert_eq!(errors.len(), 7, "the correct start and six wrong ones: {errors:?}");
    for error in errors {
        assert!(error.parse::<f64>().unwrap() < 0.2e-3, "{error} m");
    }
}

#[test]
fn verif_outlines_of_objects_come_from_their_meshes() {
    let (source, work) = (clone(), tempfile::tempdir().unwrap());
    let dataset = work.path().join("stanford");
    good(&["import", "stanford-whisker", text(source.path()), "--out", text(&dataset)]);
    let outline = dataset.join("05_25_23-reference_cylindertip_test_scan_object_May_25_trial0.contour.csv");
    let ends = |name: &str| {
        let values: Vec<f64> = column(&outline, name).iter().map(|cell| cell.parse().unwrap()).collect();
        values.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)))
    };
    assert_eq!((ends("x_m"), ends("y_m")), ((-0.0095, 0.0105), (0.0025, 0.0225)));

    fs::write(source.path().join(MESH), &mesh()[..200]).unwrap();
    fails_on(source.path(), &["ConeFixture.stl", "found 200", "484 bytes of a binary STL"]);
}

#[test]
fn regress_a_sensor_that_reads_the_same_in_every_row_is_named() {
    for (file, name) in [(CALIBRATION, "curved_calib_May_22_try2.csv"), (TRIAL, "curved_test_May_22_trial0.csv")] {
        let source = clone();
        let path = source.path().join(file);
        let table = fs::read_to_string(&path).unwrap();
        let rows = table.lines().skip(1).map(|line| {
            let mut cells: Vec<&str> = line.split(',').collect();
            cells[5] = "-40";
            cells.join(",") + "\n"
        });
        let count = rows.clone().count();
        fs::write(&path, ",px,py,pz,sx,sy,sz\n".to_owned() + &rows.collect::<String>()).unwrap();
        let found = format!("{name}:2: column 6, `sy`: found -40 in all {count} rows, expected varying readings");
        fails_on(source.path(), &[&found]);
    }
}

/// Clone of the repository with a calibration in space, and a trial with a pin 1.5 mm above the whisker's plane.
fn clone_in_space() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let curved = Rig::curved();
    // Lines along -x at several depths and heights, each after one reading at rest.
    let lines = (0..7).flat_map(|depth| (-3..=3).map(move |height| (-0.6 - 1.4 * f64::from(depth), f64::from(height))));
    let grid = lines.flat_map(|(y, z)| {
        let line = (0..12).map(move |i| [3.0 - 3.6 * f64::from(i), y, 2.0 * z]);
        std::iter::once([5.0, 0.0, 0.0]).chain(line)
    });
    write(&folder.path().join(CALIBRATION), &curved.table_in_space(grid));
    let trial = (0..90).map(|i| [3.0 - 0.5 * f64::from(i), -3.3, 1.5]);
    write(&folder.path().join(TRIAL), &curved.table_in_space(trial));
    folder
}

#[test]
fn verif_known_contacts_are_found_in_recordings_in_space() {
    let (source, work) = (clone_in_space(), tempfile::tempdir().unwrap());
    let dataset = work.path().join("stanford");
    let output = good(&["import", "stanford-whisker", text(source.path()), "--space", "--out", text(&dataset)]);
    assert!(output.contains("real pins") && !output.contains("warning"), "{output}");
    good(&["check", text(&dataset)]);
    let trial = "05_22_23_try2-curved_test_May_22_trial0";
    let read = SpatialTrace::read(&dataset.join(trial)).unwrap();
    let recorded = read.sidecar.recorded.as_ref().unwrap();
    assert_eq!(recorded.rest_counts, [92.0, -38.0]);
    assert_eq!(read.to_csv(), fs::read_to_string(dataset.join(format!("{trial}.csv"))).unwrap());
    // The pin is the origin of World, and only its place is known.
    let known: Vec<_> = read.truth.instants.iter().filter(|truth| truth.touching == Some(true)).collect();
    assert!(known.len() > 40 && known.iter().all(|truth| truth.place == Some(Vector3::zeros())));
    assert!(known.iter().all(|truth| truth.contact.is_none()));

    let fitted = good(&["fit", text(&dataset), "--model", "polynomial"]);
    assert!(fitted.contains("polynomial-5"), "{fitted}");
    let results = work.path().join("results");
    let run = ["evaluate", text(&dataset), "--estimators", "point", "--results", text(&results)];
    good(&run);
    let trials = results.join("stanford/space_trials.csv");
    let number = |name: &str| column(&trials, name)[0].parse::<f64>().unwrap();
    assert_eq!(column(&trials, "rmse_m").len(), 1, "no noise is added, so that one seed suffices");
    assert!(number("rmse_m") < 0.5e-3 && number("answered") > 0.9, "{} m", number("rmse_m"));
    assert_eq!((column(&trials, "normal_rad")[0].as_str(), column(&trials, "surface_m")[0].as_str()), ("", ""));
    let estimates = work.path().join("estimates.csv");
    let path = dataset.join(format!("{trial}.csv"));
    good(&["replay", text(&path), "--estimator", "point", "--out", text(&estimates)]);
    assert_eq!(column(&estimates, "truth_contact_z_m").iter().filter(|cell| !cell.is_empty()).count(), known.len());

    let mut damaged = SpatialTrace::read(&path).unwrap();
    damaged.recording.instants[5].moment_z_n_m = 1.0;
    damaged.sidecar.name = "glitch".into();
    damaged.sidecar.csv_sha256 = sha256(damaged.to_csv());
    let glitch = work.path().join("glitch.csv");
    fs::write(&glitch, damaged.to_csv()).unwrap();
    write_json(&glitch.with_extension("json"), &damaged.sidecar).unwrap();
    // A touch of the pin shows that the sensor is mounted as in its calibration.
    let calibration = dataset.join("calibrations/stanford-curved_May_22_try2.json");
    let read = SpatialCalibrationFile::read(&calibration).unwrap();
    assert!(
        read.real_sensor && read.mounting.is_none() && read.models.iter().all(|one| one.error.correlation_m.is_some())
    );
    let notes = good(&["replay", text(&glitch), "--calibration", text(&calibration), "--out", text(&estimates)]);
    assert!(notes.starts_with("gated: 1 of "), "{notes}");
    let mounted = work.path().join("mounted.json");
    let mount = |out: &Path| whisker(&["mount", text(&path), "--calibration", text(&calibration), "--out", text(out)]);
    let output = mount(&mounted);
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(["translation, mm", "contacts used", trial].iter().all(|words| printed.contains(words)), "{printed}");
    let learnt = SpatialCalibrationFile::read(&mounted).unwrap().mounting.unwrap();
    assert_eq!(learnt.traces, [trial]);
    let deviation = learnt.deviation;
    let values = Vector6::from_iterator(deviation.shift_m.iter().chain(&deviation.turn_rad).copied());
    let square = values.dot(&deviation.covariance.cholesky().unwrap().solve(&values));
    assert!(square < CHI2_6_99 && deviation.shift_m.norm() < 0.5e-3, "{square} {deviation:?}");
    good(&["replay", text(&path), "--estimator", "point", "--calibration", text(&mounted), "--out", text(&estimates)]);
    assert!(output.stderr.is_empty(), "{output:?}");
    let copies = ["mount", text(&path), text(&path), "--calibration", text(&calibration), "--out", text(&mounted)];
    let refused = whisker(&copies);
    for (refused, words) in [
        (refused, "expected each trace once"),
        (mount(&calibration), "expected another place for the output"),
        (mount(&path), "expected another place for the output"),
    ] {
        let errors = String::from_utf8_lossy(&refused.stderr);
        assert!(errors.contains(words) && errors.lines().count() == 1, "{errors}");
    }
}

/// Asserts that an import in space fails with a single line that contains every one of `words`.
fn fails_in_space(file: &str, change: impl Fn([f64; 7]) -> [f64; 7], words: &[&str]) {
    let (source, out) = (clone_in_space(), tempfile::tempdir().unwrap());
    let path = source.path().join(file);
    let table = fs::read_to_string(&path).unwrap();
    let rows = table.lines().skip(1).map(|line| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        change(cells.try_into().unwrap()).map(|cell| cell.to_string()).join(",") + "\n"
    });
    fs::write(&path, ",px,py,pz,sx,sy,sz\n".to_owned() + &rows.collect::<String>()).unwrap();
    let output = whisker(&["import", "stanford-whisker", text(source.path()), "--space", "--out", text(out.path())]);
    assert_fails(output, words);
}

#[test]
fn robust_recordings_without_a_third_dimension_are_named() {
    let flat = |[i, x, y, _, a, b, c]: [f64; 7]| [i, x, y, 16.1023935, a, b, c];
    fails_in_space(
        CALIBRATION,
        flat,
        &["try2.csv:2: column 4, `pz`", "found contacts up to 0.000 mm", "expected lines"],
    );
    let silent = |[i, x, y, z, _, b, c]: [f64; 7]| [i, x, y, z, 90.0, b, c];
    fails_in_space(
        CALIBRATION,
        silent,
        &["try2.csv:2: column 5, `sx`", "found 90 in all", "expected the readings of two"],
    );
    fails_in_space(TRIAL, silent, &["trial0.csv:2: column 5, `sx`", "found 90 in all", "expected the readings of two"]);
    let metres = |[i, x, y, z, a, b, c]: [f64; 7]| [i, 1e-3 * x, 1e-3 * y, 1e-3 * z, a, b, c];
    fails_in_space(
        TRIAL,
        metres,
        &["trial0.csv:2: column 2, `px`", "found a stage that travels 0.0", "in mm, not in m"],
    );
}

#[test]
fn verif_formats_are_listed() {
    let listed = good(&["import", "--list"]);
    let names: Vec<&str> = listed.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, ["csv", "bag", "stanford-whisker"]);
}

/// Asserts that an import of a clone with one changed file fails with a single line that contains every one of `words`.
fn fails(file: &str, change: impl FnOnce(String) -> String, words: &[&str]) {
    let source = clone();
    let path: PathBuf = source.path().join(file);
    fs::write(&path, change(fs::read_to_string(&path).unwrap())).unwrap();
    fails_on(source.path(), words);
}

fn fails_on(source: &Path, words: &[&str]) {
    let out = tempfile::tempdir().unwrap();
    let output = whisker(&["import", "stanford-whisker", text(source), "--out", text(out.path())]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(matches!(output.status.code(), Some(1 | 3)), "ended with {:?}: {errors}", output.status);
    // A slow machine prints the progress too.
    let failures: Vec<&str> = errors.lines().filter(|line| !line.starts_with("importing: ")).collect();
    let [failure] = failures[..] else { panic!("printed:\n{errors}") };
    assert!(failure.starts_with("error: "), "printed: {errors}");
    for word in words {
        assert!(failure.contains(word), "does not contain `{word}`: {errors}");
    }
}

#[test]
fn robust_missing_folder() {
    fails_on(Path::new("/nowhere"), &["/nowhere/data/all_datasets/calibration", "a clone of the repository"]);
}

#[test]
fn robust_missing_column() {
    fails(TRIAL, |table| table.replacen(",sy", "", 1), &["trial0.csv:1", "column 6", "`sz`", "`sy`"]);
}

#[test]
fn robust_not_a_number() {
    let change = |table: String| table.replacen("\n5,", "\n5,NaN", 1);
    fails(TRIAL, change, &["trial0.csv:7", "px", "NaN", "a finite number"]);
}

#[test]
fn robust_an_impossible_reading() {
    let huge = |table: String| {
        let (before, last) = table.trim_end().rsplit_once(',').unwrap();
        assert!(last.parse::<f64>().is_ok());
        format!("{before},1e30\n")
    };
    fails(TRIAL, huge, &["trial0.csv:", "column sz", "found `1e30`", "a magnitude of at most 10000000000 counts"]);
}

#[test]
fn robust_empty_file() {
    fails(CALIBRATION, |_| String::new(), &["try2.csv:1", "an empty file"]);
}

#[test]
fn robust_calibration_with_too_few_rows() {
    let change = |table: String| table.lines().take(4).map(|line| format!("{line}\n")).collect();
    fails(CALIBRATION, change, &["try2.csv", "rows", "to determine the wire's pose"]);
}

#[test]
fn robust_missing_calibration() {
    let source = clone();
    fs::remove_file(source.path().join(CALIBRATION)).unwrap();
    fails_on(source.path(), &["trial0.csv", "curved_calib_<date>_try2.csv"]);
}
