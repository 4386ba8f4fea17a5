//! Streaming reading and writing of traces.

use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::{Path, PathBuf};

use files::Error;
use trace::{
    FARTHEST_M, FrictionTruth, FurtherColumns, LARGEST, SecondTruth, Trace, TraceRows, TraceWriter, YieldingTruth,
};
use whisker::frames::{Point, Pose};

fn golden() -> Trace {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv");
    Trace::read(&path).unwrap()
}

/// Golden trace repeated `times` times with a continuous clock.
fn repeated(folder: &Path, times: usize) -> PathBuf {
    let Trace { sidecar, recording, truth } = golden();
    let period_s = recording.instants.len() as f64 / sidecar.rate_hz;
    let mut writer = TraceWriter::create(folder, sidecar, FurtherColumns::of(&truth)).unwrap();
    for round in 0..times {
        for (known, truth) in recording.instants.iter().zip(&truth.instants) {
            let mut known = *known;
            known.t_s += round as f64 * period_s;
            writer.push(&known, truth).unwrap();
        }
    }
    writer.finish().unwrap()
}

/// Error messages of a trace's rows.
fn error(path: &Path) -> String {
    let (_, rows) = TraceRows::open(path).unwrap();
    rows.filter_map(Result::err).map(|error: Error| error.to_string()).collect()
}

#[test]
fn verif_streaming_writer_produces_the_same_bytes() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let once = repeated(folders[0].path(), 1);
    let whole = golden().write(folders[1].path()).unwrap();
    for extension in ["csv", "json"] {
        let read = |path: &Path| fs::read(path.with_extension(extension)).unwrap();
        assert!(read(&once) == read(&whole), "{extension}");
    }
}

#[test]
fn verif_streaming_reader_returns_the_rows_of_the_whole_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = repeated(folder.path(), 3);
    let (_, rows) = TraceRows::open(&path).unwrap();
    let (known, truth): (Vec<_>, Vec<_>) = rows.map(Result::unwrap).unzip();
    let whole = Trace::read(&path).unwrap();
    assert_eq!((known, truth), (whole.recording.instants, whole.truth.instants));
}

#[test]
fn verif_memory_is_independent_of_the_length() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let most_bytes = |path: PathBuf| {
        allocation_counter::measure(|| {
            let (_, rows) = TraceRows::open(&path).unwrap();
            assert!(rows.map(|row| row.unwrap().0.t_s).sum::<f64>() > 0.0);
        })
        .bytes_max
    };
    let (short, long) = (most_bytes(repeated(folders[0].path(), 2)), most_bytes(repeated(folders[1].path(), 100)));
    assert_eq!(short, long);
}

#[test]
fn robust_a_damaged_trace_ends_in_one_error_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = repeated(folder.path(), 2);
    let text = fs::read_to_string(&path).unwrap();
    let rows: Vec<&str> = text.lines().collect();
    let with = |line: usize, row: &str| {
        let mut rows = rows.clone();
        rows[line - 1] = row;
        rows.join("\n") + "\n"
    };
    let endless = "1".repeat(1 << 20);
    let (cell, cells) = (rows[39].replacen(',', ",1e999", 1), rows[39].replacen(',', "", 1));
    for (damaged, expected) in [
        (with(40, &cell), ".csv:40: column base_x_m: found `1e999"),
        (with(40, &cells), ".csv:40: row: found 18 fields, expected 19 fields"),
        (with(40, rows[38]), ".csv:40: column t_s: found"),
        (with(40, &endless), ".csv:40: row: found more than 16384 bytes"),
        (with(40, "\"1\""), ".csv:40: row: found 1 fields"),
        (text[..text.len() / 2].to_owned(), ".csv:"),
        (with(40, &rows[39].replacen("0.0", "0.1", 1)), "sha256: found"),
        (rows[..100].join("\n") + "\n", ".csv:101: row: found the end after 99 rows, expected 602 rows"),
    ] {
        fs::write(&path, damaged).unwrap();
        let found = error(&path);
        assert!(found.contains(expected) && found.lines().count() == 1, "{expected}: {found}");
    }
    for (header, expected) in
        [("", "an empty file"), ("t_s,base_y_m\n", "header, column 2"), (&endless, "more than 16384 bytes")]
    {
        fs::write(&path, header).unwrap();
        let found = TraceRows::open(&path).unwrap_err().to_string();
        assert!(found.contains(":1: ") && found.contains(expected), "{expected}: {found}");
    }
}

/// Other line endings leave the numbers unchanged, but not the bytes; the sidecar's hash detects the difference.
#[test]
fn robust_other_line_endings_are_parsed_and_rejected_by_the_hash() {
    let folder = tempfile::tempdir().unwrap();
    let path = repeated(folder.path(), 1);
    let text = fs::read_to_string(&path).unwrap().replace('\n', "\r\n");
    fs::write(&path, text).unwrap();
    assert!(error(&path).contains("sha256"), "{}", error(&path));
}

/// A golden trace with the columns of friction while the whisker touches, and the path of its table.
fn with_friction(folder: &Path) -> (Trace, PathBuf) {
    let mut trace = golden();
    for truth in trace.truth.instants.iter_mut().filter(|truth| truth.touching == Some(true)) {
        truth.friction = Some(FrictionTruth { angle_rad: -0.25, slip_m_s: 0.003, sticking: false });
    }
    trace.sidecar.csv_sha256 = files::sha256(trace.to_csv().as_bytes());
    let path = trace.write(folder).unwrap();
    (trace, path)
}

#[test]
fn verif_friction_is_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let (trace, path) = with_friction(folder.path());
    assert_eq!(Trace::read(&path).unwrap(), trace);
    assert!(!golden().to_csv().contains("friction"));
}

#[test]
fn verif_a_trace_written_row_by_row_has_the_bytes_of_one_written_whole() {
    let (folder, rows) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (trace, path) = with_friction(folder.path());
    let further = FurtherColumns::of(&trace.truth);
    let mut writer = TraceWriter::create(rows.path(), trace.sidecar, further).unwrap();
    for (known, truth) in trace.recording.instants.iter().zip(&trace.truth.instants) {
        writer.push(known, truth).unwrap();
    }
    let again = writer.finish().unwrap();
    for extension in ["csv", "json"] {
        let read = |path: &Path| fs::read(path.with_extension(extension)).unwrap();
        assert!(read(&again) == read(&path), "{extension}");
    }
}

#[test]
fn verif_a_right_angle_of_the_force_is_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let (mut trace, _) = with_friction(folder.path());
    for truth in &mut trace.truth.instants {
        truth.friction = truth.friction.map(|friction| FrictionTruth { angle_rad: FRAC_PI_2, ..friction });
    }
    trace.sidecar.csv_sha256 = files::sha256(trace.to_csv().as_bytes());
    let again = Trace::read(&trace.write(folder.path()).unwrap()).unwrap();
    assert_eq!(again.to_csv(), trace.to_csv());
}

#[test]
fn robust_moments_have_another_limit_than_positions() {
    let folder = tempfile::tempdir().unwrap();
    let with = |change: &dyn Fn(&mut Trace)| {
        let mut trace = golden();
        change(&mut trace);
        trace.sidecar.csv_sha256 = files::sha256(trace.to_csv().as_bytes());
        error(&trace.write(folder.path()).unwrap())
    };
    let moment = |n_m: f64| with(&|trace| trace.recording.instants[3].moment_z_n_m = n_m);
    assert_eq!(moment(LARGEST), "");
    let found = moment(-2.0 * LARGEST);
    assert!(found.contains(".csv:5: column moment_z_n_m: found `-2000000.0"), "{found}");
    assert!(found.ends_with("expected a number of at most 1000000"), "{found}");
    let place = |x_m: f64| with(&|trace| trace.recording.instants[3].base = Pose::new(x_m, 0.0, 0.0));
    assert_eq!(place(FARTHEST_M), "");
    let found = place(2.0 * FARTHEST_M);
    assert!(
        found.contains(".csv:5: column base_x_m: ") && found.ends_with("expected a number of at most 1000"),
        "{found}"
    );
}

/// Checks that the first row that ends with `values` is refused with each of the other cells, by one error that begins with the
/// place of the row and goes on with the text beside the cells.
fn check_places(path: &Path, text: &str, values: &str, cases: &[(&str, &str)]) {
    let line = 1 + text.lines().position(|row| row.ends_with(values)).unwrap();
    for (cells, expected) in cases {
        fs::write(path, text.replacen(values, cells, 1)).unwrap();
        let found = error(path);
        let place = format!(".csv:{line}: {expected}");
        assert!(found.contains(&place) && found.lines().count() == 1, "{place}: {found}");
    }
}

#[test]
fn robust_invalid_friction_is_one_error_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = with_friction(folder.path());
    let text = fs::read_to_string(&path).unwrap();
    let values = "-0.2500000000,0.0030000000,0";
    let cases = [
        ("-1.6,0.003,0", "column truth_friction_angle_rad: found `-1.6`, expected an angle of at most a right one"),
        ("-0.25,,0", "column truth_friction_angle_rad: found `-0.25`, expected all values of the friction or none"),
        ("-0.25,nan,0", "column truth_slip_m_s: found `nan`, expected a finite number"),
        ("-0.25,0.003,2", "column truth_sticking: found `2`, expected 0, 1 or an empty field"),
        ("-0.25,0.003", "row: found 21 fields, expected 22 fields"),
    ];
    check_places(&path, &text, values, &cases);
    fs::write(&path, text.replacen("truth_slip_m_s", "slip", 1)).unwrap();
    let found = TraceRows::open(&path).unwrap_err().to_string();
    assert!(found.contains("header, column 21: found `slip`, expected `truth_slip_m_s`"), "{found}");
}

/// A golden trace with a second contact while the whisker touches, and the path of its table.
fn with_second(folder: &Path) -> (Trace, PathBuf) {
    let mut trace = golden();
    for truth in trace.truth.instants.iter_mut().filter(|truth| truth.touching == Some(true)) {
        let (contact, surface) = (Point::new(0.03, 0.01), Point::new(0.03, 0.0101));
        truth.second = Some(SecondTruth { contact, surface, arc_m: 0.03, force_n: 2e-4 });
    }
    trace.sidecar.csv_sha256 = files::sha256(trace.to_csv().as_bytes());
    let path = trace.write(folder).unwrap();
    (trace, path)
}

#[test]
fn verif_a_second_contact_is_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let (trace, path) = with_second(folder.path());
    assert_eq!(Trace::read(&path).unwrap(), trace);
    assert!(!golden().to_csv().contains("second"));
}

#[test]
fn robust_an_invalid_second_contact_is_one_error_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = with_second(folder.path());
    let text = fs::read_to_string(&path).unwrap();
    let values = "0.0300000000,0.0100000000,0.0300000000,0.0101000000,0.0300000000,0.000200000000";
    let cases = [
        (
            "0.03,,0.03,0.01,0.03,0.1",
            "column truth_second_contact_x_m: found `0.03`, expected both coordinates or neither",
        ),
        (
            "0.03,0.01,0.03,0.01,,0.1",
            "column truth_second_contact_x_m: found `0.03`, expected all values of the second contact or none",
        ),
        (
            "0.03,0.01,1e4,0.01,0.03,0.1",
            "column truth_second_surface_x_m: found `1e4`, expected a number of at most 1000",
        ),
        ("0.03,0.01,0.03,0.01,0.03", "row: found 24 fields, expected 25 fields"),
    ];
    check_places(&path, &text, values, &cases);
}

/// A golden trace with the displacement of an object that gives way, also while the whisker is free, and the path of its table.
fn with_yielding(folder: &Path) -> (Trace, PathBuf) {
    let mut trace = golden();
    for (row, truth) in trace.truth.instants.iter_mut().enumerate() {
        let indentation_m = if truth.touching == Some(true) { 2e-4 } else { 0.0 };
        truth.yielding = Some(YieldingTruth { moved_m: [1e-6 * row as f64, -2e-3], yaw_rad: 0.25, indentation_m });
    }
    trace.sidecar.csv_sha256 = files::sha256(trace.to_csv().as_bytes());
    let path = trace.write(folder).unwrap();
    (trace, path)
}

#[test]
fn verif_an_object_that_gives_way_is_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let (trace, path) = with_yielding(folder.path());
    let again = Trace::read(&path).unwrap();
    assert_eq!(again.to_csv(), trace.to_csv());
    assert!(again.truth.instants[0].touching == Some(false) && again.truth.instants[0].yielding.is_some());
    assert!(!golden().to_csv().contains("object"));
}

#[test]
fn robust_an_invalid_displacement_is_one_error_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = with_yielding(folder.path());
    let text = fs::read_to_string(&path).unwrap();
    let values = "-0.0020000000,0.2500000000,0.0002000000";
    let cases = [
        ("-0.002,0.25,-0.0002", "column truth_indentation_m: found `-0.0002`, expected an indentation of at least 0"),
        ("-0.002,nan,0.0002", "column truth_object_yaw_rad: found `nan`, expected a finite number"),
        ("-1001,0.25,0.0002", "column truth_object_y_m: found `-1001`, expected a number of at most 1000"),
        ("-0.002,0.25", "row: found 22 fields, expected 23 fields"),
    ];
    check_places(&path, &text, values, &cases);
    let row = text.lines().find(|row| row.ends_with(values)).unwrap();
    fs::write(&path, text.replacen(row, &row.replacen(values, ",0.25,0.0002", 1), 1)).unwrap();
    let found = error(&path);
    assert!(found.contains("expected the displacement of the object in every row"), "{found}");
}
