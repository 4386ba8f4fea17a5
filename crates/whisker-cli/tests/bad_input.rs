//! Invalid input: one error line on stderr, exit code 1 or 2, and no result.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn whisker(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_whisker")).args(arguments).current_dir(root()).output().unwrap()
}

/// Asserts that the command fails with a single line that contains every one of `words`.
fn fails(arguments: &[&str], words: &[&str]) {
    let output = whisker(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?} ended with {:?}: {text}", output.status);
    assert_eq!(text.trim_end().lines().count(), 1, "{arguments:?} printed:\n{text}");
    assert!(text.starts_with("error: ") && !text.contains("panicked"), "{arguments:?} printed: {text}");
    for word in words {
        assert!(text.contains(word), "{arguments:?} does not contain `{word}`: {text}");
    }
}

/// Copy of a golden trace with one changed file.
fn damaged(file: &str, change: impl FnOnce(String) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["golden_pin.csv", "golden_pin.json", "golden_pin.contour.csv"] {
        fs::copy(root().join("datasets/golden").join(name), folder.path().join(name)).unwrap();
    }
    let path = folder.path().join(file);
    fs::write(&path, change(fs::read_to_string(&path).unwrap())).unwrap();
    folder
}

/// Asserts that `whisker check` fails on a golden trace with one changed file, with a single line that contains every
/// one of `words`.
fn check_fails(file: &str, change: impl FnOnce(String) -> String, words: &[&str]) {
    let folder = damaged(file, change);
    fails(&["check", folder.path().join("golden_pin.csv").to_str().unwrap()], words);
}

/// The CSV with its `line`-th line (from 1) replaced.
fn with_line(text: &str, line: usize, change: impl FnOnce(&str) -> String) -> String {
    let mut lines: Vec<String> = text.lines().map(Into::into).collect();
    lines[line - 1] = change(&lines[line - 1]);
    lines.join("\n") + "\n"
}

const CSV: &str = "golden_pin.csv";
const SIDECAR: &str = "golden_pin.json";

#[test]
fn robust_missing_column() {
    let change = |text: String| text.replacen(",base_yaw_rad", "", 1);
    check_fails(CSV, change, &["golden_pin.csv:1", "column 4", "`base_vx_m_s`", "`base_yaw_rad`"]);
}

#[test]
fn robust_extra_column() {
    let change = |text: String| text.replacen("truth_tangent_rad", "truth_tangent_rad,colour", 1);
    check_fails(CSV, change, &["golden_pin.csv:1", "column 20", "`colour`", "no more columns"]);
}

#[test]
fn robust_not_a_number() {
    let change = |text: String| with_line(&text, 20, |line| line.replacen(',', ",NaN", 1));
    check_fails(CSV, change, &["golden_pin.csv:20", "base_x_m", "NaN", "a finite number"]);
}

#[test]
fn robust_empty_required_field() {
    let change = |text: String| with_line(&text, 9, |line| format!(",{}", line.split_once(',').unwrap().1));
    check_fails(CSV, change, &["golden_pin.csv:9", "t_s", "an empty field", "a number"]);
}

#[test]
fn robust_unsorted_time() {
    let change = |text: String| with_line(&text, 30, |line| format!("0.000000,{}", line.split_once(',').unwrap().1));
    check_fails(CSV, change, &["golden_pin.csv:30", "t_s", "order of time"]);
}

#[test]
fn robust_truncated_row() {
    let change = |text: String| text[..text.len() - 40].to_owned();
    check_fails(CSV, change, &["golden_pin.csv:", "fields", "19 fields"]);
}

#[test]
fn robust_missing_rows_at_the_end() {
    let change = |text: String| text.lines().take(100).map(|line| format!("{line}\n")).collect();
    check_fails(CSV, change, &["the end after 99 rows", "as stated by its sidecar"]);
}

#[test]
fn robust_empty_file() {
    check_fails(CSV, |_| String::new(), &["golden_pin.csv:1", "header", "an empty file"]);
}

#[test]
fn robust_value_contradicts_the_hash() {
    let change = |text: String| with_line(&text, 50, |line| line.replacen("0.0", "0.1", 1));
    check_fails(CSV, change, &["golden_pin.csv", "sha256"]);
}

#[test]
fn robust_outline_contradicts_the_hash() {
    let change = |text: String| with_line(&text, 5, |_| "0.5,0.5".into());
    check_fails("golden_pin.contour.csv", change, &["golden_pin.contour.csv", "sha256"]);
}

#[test]
fn robust_unknown_version() {
    let change = |text: String| text.replacen("\"format\": 1", "\"format\": 9", 1);
    check_fails(SIDECAR, change, &["golden_pin.json", "format", "found 9", "expected 1"]);
}

#[test]
fn robust_unknown_key() {
    let change = |text: String| text.replacen("\"kind\"", "\"colour\": 3, \"kind\"", 1);
    check_fails(SIDECAR, change, &["golden_pin.json:3", "`colour`"]);
}

#[test]
fn robust_wrong_unit() {
    let change = |text: String| text.replacen("length_m\"", "length_mm\"", 1);
    check_fails(SIDECAR, change, &["golden_pin.json", "`length_mm`", "`length_m`"]);
}

#[test]
fn robust_impossible_parameter() {
    let change = |text: String| text.replacen("\"root_diameter_m\": ", "\"root_diameter_m\": -", 1);
    check_fails(SIDECAR, change, &["golden_pin.json", "root_diameter_m", "a positive number"]);
}

#[test]
fn robust_truncated_sidecar() {
    check_fails(SIDECAR, |text| text[..200].to_owned(), &["golden_pin.json", "found the end within"]);
}

#[test]
fn robust_truth_above_its_bound() {
    let change = |text: String| {
        let start = text.find("\"moment_rms\": ").unwrap() + "\"moment_rms\": ".len();
        let end = start + text[start..].find(',').unwrap();
        format!("{}2.5e-3{}", &text[..start], &text[end..])
    };
    check_fails(SIDECAR, change, &["golden_pin.json", "certificate.moment_rms", "found 2.5e-3", "at most 1e-3"]);
}

#[test]
fn robust_name_outside_the_folder() {
    let change = |text: String| text.replacen("\"golden_pin\"", "\"../golden_pin\"", 1);
    check_fails(SIDECAR, change, &["golden_pin.json", "name", "a plain file name"]);
}

#[test]
fn robust_missing_files() {
    fails(&["check", "datasets/nowhere.csv"], &["datasets/nowhere.json"]);
    fails(&["report", "results/nowhere"], &["results/nowhere"]);
    fails(&["evaluate", "scenes/suites/nowhere.json"], &["scenes/suites/nowhere.json"]);
}

#[test]
fn robust_no_calibration() {
    let results = tempfile::tempdir().unwrap();
    let out = results.path().to_str().unwrap();
    fails(&["evaluate", "datasets/golden", "--results", out], &["calibrations/straight.json", "whisker fit"]);
    assert_eq!(fs::read_dir(results.path()).unwrap().count(), 0, "a failed evaluation writes no files");
}

#[test]
fn robust_a_run_does_not_replace_another_folder() {
    let results = tempfile::tempdir().unwrap();
    let precious = results.path().join("golden");
    fs::create_dir(&precious).unwrap();
    fs::write(precious.join("thesis.tex"), "years of work").unwrap();
    let out = results.path().to_str().unwrap();
    fails(&["evaluate", "datasets/golden", "--results", out], &["golden", "found other files, expected a run"]);
    fails(
        &["evaluate", "datasets/golden", "--results", out, "--name", "../golden"],
        &["../golden", "a plain folder name"],
    );
    assert!(precious.join("thesis.tex").is_file());
}

#[test]
fn robust_no_calibration_traces() {
    fails(&["fit", "datasets/golden"], &["datasets/golden", "role `calibration`"]);
}

#[test]
fn robust_errors_of_unknown_names_list_the_registered_ones() {
    fails(&["evaluate", "datasets/golden", "--estimators", "ekv"], &["ekv", "ekf", "particle"]);
    fails(&["evaluate", "datasets/golden", "--estimators", "ekf,ekf"], &["ekf", "twice"]);
    fails(&["evaluate", "datasets/golden", "--noise", "0.01,0.01"], &["0.01", "twice"]);
    fails(&["fit", "datasets/golden", "--model", "wavelet"], &["wavelet", "polynomial"]);
}

#[test]
fn robust_wrong_usage_exits_with_two() {
    for arguments in
        [&["evaluate"][..], &["fly"], &["evaluate", "x.json", "--noise", "-1"], &["fit", "x", "--config", "{"]]
    {
        assert_eq!(whisker(arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn robust_numbers_out_of_range_state_the_range() {
    let replay = |option: &str, value: &str, words: &[&str]| {
        let output = whisker(&["replay", "datasets/golden/golden_pin.csv", option, value]);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{option} {value}: {text}");
        words
            .iter()
            .for_each(|word| assert!(text.contains(word), "{option} {value} does not contain `{word}`: {text}"));
    };
    replay("--noise", "-0.1", &["'-0.1'", "--noise", "0 to 10"]);
    replay("--noise", "NaN", &["'NaN'", "--noise", "0 to 10"]);
    replay("--seed", "-1", &["'-1'", "--seed", "a whole number, 0 to "]);
    replay("--config", r#"{"fading": 1e400}"#, &["--config", "column 16", "number out of range"]);
    replay("--config", "missing.json", &["--config", "neither a JSON object nor a file"]);
    let gain = whisker(&["evaluate", "datasets/golden", "--miscalibrate", r#"{"gain": "x"}"#]);
    let text = String::from_utf8(gain.stderr).unwrap();
    assert!(gain.status.code() == Some(2) && text.contains(r#"column 12: found "x", expected a number"#), "{text}");
}

#[test]
fn robust_values_of_a_wrong_type_are_named_in_terms_of_json() {
    let number = |text: String| text.replacen("\"rate_hz\": 250.0", "\"rate_hz\": \"250\"", 1);
    check_fails(SIDECAR, number, &["golden_pin.json:", "found \"250\", expected a number"]);
    check_fails(SIDECAR, |_| "[]".into(), &["golden_pin.json:1:2", "expected an object"]);
    let fit = |config: &str, words: &[&str]| {
        fails(&["fit", "datasets/golden", "--model", "polynomial", "--config", config], words);
    };
    fit("[7]", &["found [7], expected a JSON object"]);
}

#[test]
fn robust_an_output_folder_that_is_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    fs::write(&file, "notes").unwrap();
    let inside = file.join("run");
    let [file_name, inside_name] = [&file, &inside].map(|path| path.to_str().unwrap());
    for arguments in [
        ["fit", "datasets/golden", "--out", file_name],
        ["fit", "datasets/golden", "--out", inside_name],
        ["evaluate", "datasets/golden", "--results", file_name],
        ["recordings", "datasets/golden", "--out", file_name],
        ["recordings", "datasets/golden", "--out", inside_name],
        ["replay", "datasets/golden/golden_pin.csv", "--out", inside_name],
    ] {
        fails(&arguments, &["notes.txt: is a file, expected a folder"]);
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "notes");
}

#[test]
fn robust_a_folder_instead_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let [given, out] = ["given", "out"].map(|name| folder.path().join(name));
    fs::create_dir(&given).unwrap();
    let (given, out) = (given.to_str().unwrap(), out.to_str().unwrap());
    let words = format!("{given}: found a folder, expected a file");
    fails(&["evaluate", "datasets/golden", "--results", out, "--config", given], &[&words]);
    fails(&["bag", "export", "datasets/golden/golden_pin.csv", "--out", out, "--estimates", given], &[&words]);
}

#[test]
fn robust_further_sensors_need_a_front_end_with_sensors() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let words = ["--sensors: found with the front end `white`", "expected with one that has", "--front-end hall"];
    fails(&["fit", "datasets/golden", "--out", out, "--sensors", "left/left_1"], &words);
}

#[test]
fn robust_a_json_file_of_no_known_kind() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings.json");
    fs::write(&file, r#"{"ekf": {"fading": 1.0}}"#).unwrap();
    fails(&["check", file.to_str().unwrap()], &["settings.json: found none of the keys", "suite or scene"]);
    let kinds = "expected that of a trace, recording, calibration or run, or a suite or scene, which states no kind";
    for (other, kind) in [("rigs/openwhisker.json", "platform_rig"), ("examples/own-data/import.json", "import")] {
        fails(&["check", other], &[other, &format!("kind: found `{kind}`, {kinds}")]);
    }
}

#[test]
fn robust_options_and_inputs_that_do_not_apply_to_traces_in_space() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let space = "datasets/golden/space";
    fails(&["fit", space, "--out", out], &["found no traces with the role `calibration`"]);
    fails(&["fit", space, "--out", out, "--sensors", "left/left_1"], &["--sensors: does not apply to traces in space"]);
    let unknown = ["unknown front end `optical` of traces in space", "expected one of: white, hall"];
    fails(&["fit", space, "--out", out, "--front-end", "optical"], &unknown);
    let evaluate = |options: &[&str], words: &[&str]| {
        let arguments = [&["evaluate", space, "--results", out], options].concat();
        fails(&arguments, words);
    };
    evaluate(
        &["--estimators", "ukf"],
        &["unknown estimator in space `ukf` (it is one for planar traces)", "line, point"],
    );
    evaluate(&["--estimators", "line, sphere, nobody"], &["unknown estimator in space `nobody`"]);
    evaluate(&["--noise", "0.01,0.02"], &["--noise: found 2 levels, expected one"]);
    evaluate(&["--encoders", "{}"], &["--encoders: does not apply to traces in space"]);
    evaluate(&["--starts", "wrong"], &["--starts: does not apply to traces in space"]);
    evaluate(&["--name", "../space"], &["name of the run", "expected a plain folder name"]);
    let settings = folder.path().join("settings.json");
    for (key, text) in [("touch", r#"{"touch": {"detector": "band-pass"}}"#), ("map", r#"{"map": {"cell_m": 0.001}}"#)]
    {
        fs::write(&settings, text).unwrap();
        let place = format!("settings.json: {key}");
        let words = [place.as_str(), "do not apply to traces in space", "expected those of estimators"];
        evaluate(&["--config", settings.to_str().unwrap()], &words);
        let place = format!("--config: {key}");
        evaluate(&["--config", text], &[place.as_str(), words[1]]);
    }
    evaluate(&["--config", r#"{"line": 1e400}"#], &["--config: column 14", "number out of range"]);
    evaluate(&["--estimators", "line"], &["calibrations/curved.json", "no such calibration"]);
    evaluate(&["--front-end", "hall"], &["calibrations/hall/curved.json", "no such calibration"]);
    evaluate(&["--front-end", "optical"], &unknown);
    fs::write(&settings, "\u{feff}{\"gap_m\": 0}").unwrap();
    let (hall, file) = (["--front-end", "hall", "--front-end-config"], settings.to_str().unwrap());
    evaluate(&[&hall[..], &[file]].concat(), &["settings.json: settings of the front end `hall`", "gap_m"]);
    evaluate(&["--calibrations", file], &["settings.json: found a file, expected the folder of the calibrations"]);
    let replay = |options: &[&str], words: &[&str]| {
        let trace = "datasets/golden/space/golden_space.csv";
        fails(&[&["replay", trace], options].concat(), words);
    };
    replay(&["--estimator", "ukf"], &["unknown estimator in space `ukf`", "line, point"]);
    replay(&["--front-end", "optical"], &unknown);
    replay(&["--estimator", "line", "--front-end", "hall"], &["calibrations/hall/curved.json", "no such calibration"]);
    let settings = ["front end `hall` of traces in space", "`gap_m`", "found 0"];
    replay(&["--front-end", "hall", "--front-end-config", r#"{"gap_m": 0}"#], &settings);
    replay(&["--estimator", "line"], &["calibrations/curved.json", "no such calibration"]);
}
