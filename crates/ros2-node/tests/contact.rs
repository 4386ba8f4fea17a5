//! `ros2-node contact` as a program: errors of its input.

use std::fs;
use std::process::Command;

/// Standard error of a run that must fail with one line.
fn error(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_ros2-node")).arg("contact").args(arguments).output().expect("starts");
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert!(!output.status.success() && stderr.lines().count() == 1, "{stderr}");
    stderr
}

#[test]
fn robust_wrong_input_gives_one_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let mapping = folder.path().join("mapping.json");
    let mapping_text = mapping.to_str().expect("text");
    assert!(error(&[mapping_text]).starts_with(&format!("error: {mapping_text}: ")));
    let whisker =
        r#"{"name": "w", "calibration": "none.json", "rate_hz": 250, "noise_sd_n_m": 1e-9, "moment": "/moment"}"#;
    for (keys, words) in [
        (r#""whisker": []"#.to_owned(), "unknown field `whisker`"),
        (r#""whiskers": []"#.to_owned(), "whiskers: found 0, expected 1 to 64 whiskers"),
        (format!(r#""whiskers": [{whisker}, {whisker}]"#), "whiskers[1].name: found `w` again"),
        (format!(r#""urdf": "none.urdf", "whiskers": [{whisker}]"#), "none.urdf: No such file"),
        (format!(r#""whiskers": [{whisker}]"#), "none.json: No such file"),
    ] {
        fs::write(&mapping, format!(r#"{{"format": 1, "kind": "contact_mapping", {keys}}}"#)).expect("written");
        let found = error(&[mapping_text]);
        assert!(found.contains(words), "{words}: {found}");
    }
}
