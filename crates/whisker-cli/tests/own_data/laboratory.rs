//! Commands on copies of an example of own recordings.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::command::{text, whisker};

/// Folder of the repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Runs a command that must succeed. Returns stdout and stderr.
pub(crate) fn good(arguments: &[&str]) -> (String, String) {
    let output = whisker(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?} ended with {:?}: {errors}", output.status);
    (String::from_utf8(output.stdout).unwrap(), errors)
}

/// Copy of an example.
pub(crate) fn copied(example: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(example).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    folder
}

/// Asserts that a stored table is that which has been made.
pub(crate) fn assert_stored(path: &Path, made: &str) {
    let stored = fs::read_to_string(path).unwrap();
    let name = path.display();
    assert_eq!(stored.lines().count(), made.lines().count(), "{name}");
    for (stored, made) in stored.lines().zip(made.lines()).skip(1) {
        let cells = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>();
        // The last digit may differ with the C library.
        assert!(cells(stored).iter().zip(cells(made)).all(|(a, b)| (a - b).abs() <= 1.0), "{name}: {stored} {made}");
    }
}

/// Output of `whisker live` with this calibration and estimator after lines on stdin.
pub(crate) fn live(calibration: &Path, estimator: &str, lines: &[Value]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
    command.args(["live", "--calibration", text(calibration), "--estimator", estimator]);
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input: String = lines.iter().map(|line| format!("{line}\n")).collect();
    let writes = std::thread::spawn(move || stdin.write_all(input.as_bytes()).unwrap());
    let output = child.wait_with_output().unwrap();
    writes.join().unwrap();
    output
}

/// Answers of `whisker live`, which must succeed.
pub(crate) fn lived(calibration: &Path, estimator: &str, lines: &[Value]) -> Vec<Value> {
    let output = live(calibration, estimator, lines);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    let answers = String::from_utf8(output.stdout).unwrap();
    answers.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}
