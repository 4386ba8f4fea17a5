//! `whisker live`: recordings and JSON lines against `whisker replay`, bad lines and signals.
#![cfg(unix)]

mod golden;

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::{Value, json};
use tempfile::TempDir;
use testbed::results::{EstimateRow, read_rows};
use trace::Trace;

use golden::write_dataset;

/// Estimators of every class, for one whisker each.
const ESTIMATORS: [&str; 3] = ["ekf", "outline", "smoother"];

fn whisker(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn good(arguments: &[&str]) -> Output {
    let output = whisker(arguments).stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    output
}

/// Golden traces with a calibration.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        write_dataset(bench.0.path());
        good(&["fit", bench.0.path().to_str().unwrap(), "--model", "elastica"]);
        bench
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    fn calibration(&self) -> String {
        let files: Vec<PathBuf> =
            fs::read_dir(self.path("calibrations")).unwrap().map(|entry| entry.unwrap().path()).collect();
        let json = files.iter().find(|file| file.extension().is_some_and(|extension| extension == "json")).unwrap();
        json.to_str().unwrap().to_owned()
    }

    fn replayed(&self, trace: &str, estimator: &str) -> Vec<EstimateRow> {
        let out = self.path(&format!("{trace}.{estimator}.txt"));
        good(&["replay", &self.path(&format!("{trace}.csv")), "--estimator", estimator, "--out", &out]);
        read_rows(Path::new(&out)).unwrap()
    }

    /// First line of the whisker of a trace.
    fn prior(&self, trace: &str, name: Option<&str>, rows: &[EstimateRow]) -> Value {
        let trace = Trace::read(Path::new(&self.path(&format!("{trace}.csv")))).unwrap();
        let largest = trace.recording.instants.iter().map(|instant| instant.moment_z_n_m.abs()).fold(0.0, f64::max);
        assert_eq!(rows.len(), trace.sidecar.rows);
        json!({"protocol": 1, "name": name, "rate_hz": trace.sidecar.rate_hz, "noise_sd_n_m": 0.01 * largest})
    }
}

/// Pose and reading of a row, each as a line. In this order no reading waits, whatever the load of the machine.
fn lines(name: Option<&str>, row: &EstimateRow) -> [Value; 2] {
    let mut pose =
        json!({"t_s": row.t_s, "base_x_m": row.base_x_m, "base_y_m": row.base_y_m, "base_yaw_rad": row.base_yaw_rad});
    let mut reading = json!({"t_s": row.t_s, "reading_n_m": row.reading_n_m});
    if let Some(name) = name {
        (pose["name"], reading["name"]) = (name.into(), name.into());
    }
    [pose, reading]
}

fn parsed(stdout: &[u8]) -> Vec<Value> {
    text(stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Asserts that answers have the contacts of a replay.
fn assert_same(answers: &[&Value], rows: &[EstimateRow], of: &str) {
    assert_within(1e-12, answers, rows, of);
}

/// Asserts that answers have the contacts of a replay to within a distance.
fn assert_within(most_m: f64, answers: &[&Value], rows: &[EstimateRow], of: &str) {
    assert_eq!(answers.len(), rows.len(), "{of}");
    let mut contacts = 0;
    for (answer, row) in answers.iter().zip(rows) {
        assert_eq!(answer["t_s"].as_f64(), Some(row.t_s));
        let Some(x) = answer["contact_x_m"].as_f64() else {
            assert_eq!(row.contact_x_m, None, "{of}: {answer}");
            continue;
        };
        let number = |key: &str| answer[key].as_f64().unwrap();
        let (sin, cos) = number("base_yaw_rad").sin_cos();
        let y = number("contact_y_m");
        let found = [number("base_x_m") + cos * x - sin * y, number("base_y_m") + sin * x + cos * y];
        let off_m = (found[0] - row.contact_x_m.unwrap()).hypot(found[1] - row.contact_y_m.unwrap());
        assert!(off_m < most_m, "{of}: {off_m} m at {} s", row.t_s);
        contacts += 1;
    }
    assert!(contacts > 100, "{of}: {contacts} contacts");
}

/// Runs the command with these lines on stdin.
fn fed(arguments: &[&str], lines: &[Value]) -> Output {
    let input: String = lines.iter().map(|line| format!("{line}\n")).collect();
    fed_text(arguments, &input)
}

fn fed_text(arguments: &[&str], input: &str) -> Output {
    let mut child = whisker(arguments).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_owned();
    // A command that refuses its first line does not read the others.
    let writes = std::thread::spawn(move || drop(stdin.write_all(input.as_bytes())));
    let output = child.wait_with_output().unwrap();
    writes.join().unwrap();
    output
}

#[test]
fn robust_streams_that_look_wrong_are_noted_at_their_end() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let calibration = bench.calibration();
    let named = |name: &str| format!("{name}={calibration}");
    let options = [named("left"), named("right")];
    let arguments: Vec<&str> =
        ["live", "--estimator", "ekf", "--calibration", &options[0], "--calibration", &options[1]].into();
    let noted_at = |rate_hz: f64, factor: f64, per_second: f64| {
        let mut first = bench.prior("pin", Some("left"), &rows);
        first["rate_hz"] = rate_hz.into();
        let of_row = |row: &EstimateRow| {
            let [pose, mut reading] = lines(Some("left"), row);
            reading["reading_n_m"] = (factor * row.reading_n_m).into();
            [pose, reading].map(|mut line| {
                line["t_s"] = (per_second * row.t_s).into();
                line
            })
        };
        let all: Vec<Value> = rows.iter().flat_map(of_row).collect();
        text(&fed(&arguments, &[vec![first], all].concat()).stderr).to_owned()
    };
    let noted = |rate_hz: f64, factor: f64| noted_at(rate_hz, factor, 1.0);
    let good = noted(250.0, 1.0);
    assert!(good.contains("right: note: no first line arrived") && !good.contains("left: note"), "{good}");
    let negative = noted(250.0, -1.0);
    assert!(negative.contains("left: note: ") && negative.contains("compare units, signs and frames"), "{negative}");
    let large = noted(250.0, 1e6);
    assert!(large.contains("beyond the largest plausible one; compare the unit"), "{large}");
    let fast = noted(2500.0, 1.0);
    assert!(fast.contains("compare rate_hz with the times of the readings"), "{fast}");
    let milliseconds = noted_at(0.25, 1.0, 1e3);
    assert!(
        milliseconds.contains("left: note: ") && milliseconds.contains("check that times are in seconds"),
        "{milliseconds}"
    );
}

#[test]
fn regress_notes_of_one_whisker_do_not_suppress_those_of_another() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let options = ["left", "right"].map(|name| format!("{name}={}", bench.calibration()));
    let arguments = ["live", "--estimator", "ekf", "--calibration", &options[0], "--calibration", &options[1]];
    let mut input = ["left", "right"].map(|name| bench.prior("pin", Some(name), &rows)).to_vec();
    // Each pose lies a minute ahead of the one before.
    let jumps = |name: &str, count: u64| -> Vec<Value> {
        let pose = |step| json!({"name": name, "t_s": 60 * step, "base_x_m": 0, "base_y_m": 0, "base_yaw_rad": 0});
        (0..=count).map(pose).collect()
    };
    input.extend(jumps("left", 12));
    input.extend(jumps("right", 2));
    let output = fed(&arguments, &input);
    let errors = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{errors}");
    let noted = |name: &str| {
        let begins = format!("error: {name}: clock of the poses: ");
        errors.lines().filter(|line| line.starts_with(&begins)).count()
    };
    assert_eq!((noted("left"), noted("right")), (10, 2), "{errors}");
    for counted in ["left: jumps of a clock: 12", "right: jumps of a clock: 2"] {
        assert!(errors.lines().any(|line| line == counted), "{errors}");
    }
}

#[test]
fn robust_settings_are_refused_before_the_first_line() {
    let bench = Bench::new();
    let config = r#"{"doubt": {"nis": -1.0}}"#;
    let refused = fed_text(&["live", "--calibration", &bench.calibration(), "--config", config], "");
    assert!(!refused.status.success());
    assert!(text(&refused.stderr).contains("doubt.nis"), "{}", text(&refused.stderr));
}

#[test]
fn verif_recordings_and_lines_have_the_contacts_of_a_replay() {
    let bench = Bench::new();
    let calibration = bench.calibration();
    for estimator in ESTIMATORS {
        for trace in ["pin", "round"] {
            let of = format!("{estimator}, {trace}");
            let rows = bench.replayed(trace, estimator);
            let path = bench.path(&format!("{trace}.csv"));
            let played = good(&["live", "--recording", &path, "--estimator", estimator, "--speed", "1e6"]);
            let answers = parsed(&played.stdout);
            assert_same(&answers.iter().collect::<Vec<_>>(), &rows, &format!("{of}, recording"));
            assert!(text(&played.stderr).contains("latency from reading to answer: "), "{}", text(&played.stderr));
            let mut input = vec![bench.prior(trace, None, &rows)];
            input.extend(rows.iter().flat_map(|row| lines(None, row)));
            let output = fed(&["live", "--calibration", &calibration, "--estimator", estimator], &input);
            assert!(output.status.success(), "{}", text(&output.stderr));
            let answers = parsed(&output.stdout);
            assert_same(&answers.iter().collect::<Vec<_>>(), &rows, &format!("{of}, lines"));
        }
    }
}

#[test]
fn verif_several_whiskers_have_the_contacts_of_their_replays() {
    let bench = Bench::new();
    let calibration = bench.calibration();
    let traces = ["pin", "round"];
    let rows = traces.map(|trace| bench.replayed(trace, "ekf"));
    let named = traces.map(|trace| format!("{trace}={calibration}"));
    let mut input: Vec<Value> =
        traces.iter().zip(&rows).map(|(trace, rows)| bench.prior(trace, Some(trace), rows)).collect();
    for row in 0..rows[0].len().max(rows[1].len()) {
        for (trace, rows) in traces.iter().zip(&rows) {
            input.extend(rows.get(row).into_iter().flat_map(|row| lines(Some(trace), row)));
        }
    }
    let stdin = fed(&["live", "--calibration", &named[0], "--calibration", &named[1], "--estimator", "ekf"], &input);
    let [pin, round] = traces.map(|trace| bench.path(&format!("{trace}.csv")));
    let recorded = ["live", "--recording", &pin, "--recording", &round, "--estimator", "ekf", "--speed", "1e6"];
    for output in [stdin, good(&recorded)] {
        assert!(output.status.success(), "{}", text(&output.stderr));
        let answers = parsed(&output.stdout);
        for (trace, rows) in traces.iter().zip(&rows) {
            let of: Vec<&Value> = answers.iter().filter(|answer| answer["name"] == **trace).collect();
            assert_same(&of, rows, trace);
        }
    }
}

#[test]
fn verif_an_evaluation_runs_it_as_an_external_program() {
    let bench = Bench::new();
    let program =
        format!("live={} live --estimator ekf --calibration {}", env!("CARGO_BIN_EXE_whisker"), bench.calibration());
    let other = tempfile::tempdir().unwrap();
    let results = other.path().join("results").to_str().unwrap().to_owned();
    good(&[
        "evaluate",
        &bench.path(""),
        "--results",
        &results,
        "--name",
        "run",
        "--estimators",
        "ekf",
        "--exec",
        &program,
        "--seeds",
        "1",
    ]);
    for trace in ["pin", "round"] {
        let of = |name: &str| -> Vec<EstimateRow> {
            read_rows(&Path::new(&results).join(format!("run/estimates/{trace}.{name}.csv"))).unwrap()
        };
        let mut contacts = 0;
        for (own, other) in of("ekf").iter().zip(&of("live")) {
            assert_eq!(own.contact_x_m.is_some(), other.contact_x_m.is_some());
            let Some((x_m, y_m)) = own.contact_x_m.zip(own.contact_y_m) else { continue };
            contacts += 1;
            let off_m = (x_m - other.contact_x_m.unwrap()).hypot(y_m - other.contact_y_m.unwrap());
            assert!(off_m < 1e-9, "{trace}: {off_m} m");
        }
        assert!(contacts > 100);
    }
}

/// Counts of the sensor below at a moment.
const REST: f64 = 65_500.0;
const COUNTS_PER_N_M: f64 = -2e6;
const COMMON_MODE: [f64; 2] = [0.02, 1.1];
const MODULO: f64 = 65_536.0;

/// Copy of the calibration with a sensor, which has a common mode, of a front end.
fn with_sensor(bench: &Bench) -> String {
    let mut calibration: Value = serde_json::from_slice(&fs::read(bench.calibration()).unwrap()).unwrap();
    calibration["front_end"] = json!({"name": "hall", "config": {}, "sensors": [{
        "name": "s", "array": "a", "common_mode": COMMON_MODE, "cross_talk": [],
        "characteristic": {"coefficients": [COUNTS_PER_N_M], "range_n_m": [-1e-3, 1e-3]},
        "noise_sd_n_m": 1e-7, "offset_sd_n_m": 0.0, "gain_sd": 0.0,
    }]});
    let path = bench.path("sensor.json");
    fs::write(&path, calibration.to_string()).unwrap();
    path
}

#[test]
fn verif_counts_of_a_calibrated_sensor_have_the_contacts_of_their_moments() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let mut first = bench.prior("pin", None, &rows);
    (first["sensor"], first["modulo"]) = ("a.s".into(), MODULO.into());
    let line = |t_s: f64, n_m: f64| {
        let [x, y] = [30.0 * (3.0 * t_s).sin(), 50.0 * (2.0 * t_s).cos()];
        let counts = REST + COMMON_MODE[0] * x + COMMON_MODE[1] * y + COUNTS_PER_N_M * n_m;
        json!({"t_s": t_s, "counts": counts.rem_euclid(MODULO), "reference_counts": [x, y]})
    };
    // A second of rest before the trace.
    let at_rest = (1..=251).rev().map(|step| line(rows[0].t_s - 0.004 * f64::from(step), 0.0));
    let moving = rows.iter().flat_map(|row| {
        let [pose, reading] = lines(None, row);
        [pose, line(row.t_s, reading["reading_n_m"].as_f64().unwrap())]
    });
    let input: Vec<Value> = std::iter::once(first).chain(at_rest).chain(moving).collect();
    let output = fed(&["live", "--calibration", &with_sensor(&bench), "--estimator", "ekf"], &input);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answers = parsed(&output.stdout);
    let (zeroing, answers): (Vec<&Value>, Vec<&Value>) =
        answers.iter().partition(|answer| answer["status"] == "zeroing");
    assert_eq!(zeroing.len(), 251);
    assert_within(1e-8, &answers, &rows, "counts");
}

#[test]
fn robust_counts_that_cannot_be_converted_are_named() {
    let bench = Bench::new();
    let (without, with) = (bench.calibration(), with_sensor(&bench));
    let first = json!({"protocol": 1, "rate_hz": 250, "noise_sd_n_m": 1e-7});
    let pose = json!({"base_x_m": 0, "base_y_m": 0, "base_yaw_rad": 0});
    let changed = |of: &Value, keys: Value| {
        let mut line = of.clone();
        line.as_object_mut().unwrap().extend(keys.as_object().unwrap().clone());
        line
    };
    let one_error = |calibration: &str, first: &Value, line: Value, code: i32, words: &[&str]| {
        let output = fed(&["live", "--calibration", calibration, "--estimator", "ekf"], &[first.clone(), line]);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{errors}");
        let said: Vec<&str> = errors.lines().filter(|line| line.starts_with("error: ")).collect();
        let [error] = said[..] else { panic!("printed: {errors}") };
        assert!(words.iter().all(|words| error.contains(words)) && error.contains("expected"), "{words:?}: {error}");
    };
    let counts = changed(&pose, json!({"t_s": 0, "counts": 500}));
    let none = ["stdin: line 2, counts: found those of a whisker", without.as_str(), "has no sensor", "reading_n_m"];
    one_error(&without, &first, counts.clone(), 3, &none);
    // A calibration through a front end is one of moments unless the first line states otherwise.
    one_error(&with, &first, counts.clone(), 3, &["none of sensor, zeroing_s and modulo", "sensor.json: a.s"]);
    let both = changed(&counts, json!({"reading_n_m": 0}));
    one_error(&without, &first, both, 3, &["stdin: line 2, found reading_n_m and counts, expected one of the two"]);
    let of_sensor = changed(&first, json!({"sensor": "a.s"}));
    one_error(&with, &of_sensor, counts.clone(), 3, &["line 2, reference_counts: found none", "sensor.json"]);

    for (calibration, keys, words) in [
        (&without, json!({"zeroing_s": 1}), ["sensor: found none", "whisker fit"]),
        (&without, json!({"noise_sd_n_m": null}), ["noise_sd_n_m: found none", "names no sensor of"]),
        (&with, json!({"sensor": "a.t"}), ["front_end.sensors: found a.s", "`a.t` among them"]),
        (&with, json!({"zeroing_s": 0}), ["zeroing_s: found 0", "0.01 to 60"]),
        (&with, json!({"modulo": 1}), ["modulo: found 1", "2 to 4294967296"]),
    ] {
        one_error(calibration, &changed(&first, keys), counts.clone(), 1, &[&["stdin: line 1"], &words[..]].concat());
    }
}

#[test]
fn robust_bad_lines_are_named_with_line_and_column_counted_and_answered() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let clean: Vec<String> = [bench.prior("pin", None, &rows)]
        .into_iter()
        .chain(rows.iter().flat_map(|row| lines(None, row)))
        .map(|line| line.to_string())
        .collect();
    let mut dirty = clean.clone();
    dirty.insert(301, r#"{"t_s": 0.5, "reading_n_m": NaN}"#.into());
    dirty.insert(305, r#"{"t_s": 0.5, "reading_n_m": Infinity}"#.into());
    dirty.insert(501, r#"{"t_s": 0.5, "reading"#.into());
    dirty.insert(601, r#"{"t_s": 0.5, "reading_n_m": 0, "name": "left"}"#.into());
    let calibration = bench.calibration();
    let output = fed_text(&["live", "--calibration", &calibration, "--estimator", "ekf"], &(dirty.join("\n") + "\n"));
    let errors = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{errors}");
    let said: Vec<&str> = errors.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(said.len(), 2, "{errors}");
    assert!(
        said[0].starts_with("error: stdin: line 302, column ")
            && said[0].contains("found `NaN`, expected a finite number"),
        "{errors}"
    );
    assert!(
        said[1].starts_with("error: stdin: line 502, column ") && said[1].contains("messages are JSON objects"),
        "{errors}"
    );
    assert!(
        errors.contains("lines with a value that is not finite: 2") && errors.contains("lines that are no messages: 2"),
        "{errors}"
    );
    let (refused, answers): (Vec<Value>, Vec<Value>) =
        parsed(&output.stdout).into_iter().partition(|answer| answer["status"] == "refused");
    assert_eq!(refused.len(), 4);
    assert_same(&answers.iter().collect::<Vec<_>>(), &rows, "answers beside the refused lines");
}

#[test]
fn robust_a_refused_first_line_states_that_later_lines_are_refused_too() {
    let bench = Bench::new();
    let calibration = bench.calibration();
    let said = |calibrations: &[&str], input: &str| {
        let options: Vec<_> = calibrations.iter().flat_map(|calibration| ["--calibration", calibration]).collect();
        let output = fed_text(&[&["live", "--estimator", "ekf"], &options[..]].concat(), input);
        let errors = text(&output.stderr).to_owned();
        assert_eq!(output.status.code(), Some(3), "{errors}");
        (errors, parsed(&output.stdout).iter().filter(|answer| answer["status"] == "refused").count())
    };
    let wrong = r#"{"protocol": 1, "rate_hz": "x", "noise_sd_n_m": 1e-7}"#;
    let reading = r#"{"t_s": 0, "reading_n_m": 0}"#;
    let (errors, refused) = said(&[&calibration], &format!("{wrong}\n{reading}\n{reading}\n"));
    assert!(errors.starts_with("error: stdin: line 1, column "), "{errors}");
    assert!(
        errors.contains("the line is left out, and so is every reading and pose before a valid first line"),
        "{errors}"
    );
    assert_eq!(refused, 3, "{errors}");
    // A whisker whose first line is valid is not affected.
    let first = r#"{"name": "left", "protocol": 1, "rate_hz": 250, "noise_sd_n_m": 1e-7}"#;
    let both = ["left", "right"].map(|name| format!("{name}={calibration}"));
    let (errors, _) = said(&[&both[0], &both[1]], &format!("{first}\n{wrong}\n"));
    assert!(errors.contains("every reading and pose of right before a valid first line of that whisker"), "{errors}");
    let valid = r#"{"protocol": 1, "rate_hz": 250, "noise_sd_n_m": 1e-7}"#;
    let (errors, _) = said(&[&calibration], &format!("{valid}\n{wrong}\n"));
    assert!(errors.contains("; the line is left out (further"), "{errors}");
    let (errors, refused) = said(&[&calibration], &format!("{valid}\n{reading}\n{valid}\n"));
    assert!(errors.contains("stdin: line 3: found a second first line"), "{errors}");
    assert_eq!(refused, 1, "{errors}");
}

/// Asserts that the command ends with one error that contains these words.
fn fails(arguments: &[&str], input: &str, words: &[&str]) {
    let output = fed_text(arguments, input);
    let errors = text(&output.stderr);
    assert!([Some(1), Some(2)].contains(&output.status.code()), "{arguments:?}: {errors}");
    assert_eq!(errors.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{errors}");
    words.iter().for_each(|word| assert!(errors.contains(word), "{word}: {errors}"));
}

#[test]
fn robust_wrong_first_lines_and_options_end_with_one_error() {
    let bench = Bench::new();
    let calibration = bench.calibration();
    let live = ["live", "--calibration", &calibration];
    let two = format!("right={calibration}");
    fails(
        &live,
        "{\"protocol\": 2, \"rate_hz\": 250, \"noise_sd_n_m\": 1e-9}\n",
        &["stdin: line 1", "protocol: found 2, expected 1"],
    );
    fails(&live, "{\"protocol\": 2, \"rate_hz\": 250}\n", &["stdin: line 1", "protocol: found 2, expected 1"]);
    fails(&live, "{\"protocol\": 1, \"rate_hz\": 0, \"noise_sd_n_m\": 1e-9}\n", &["rate_hz: found 0, expected"]);
    for noise in ["-1", "0", "1"] {
        let prior = format!("{{\"protocol\": 1, \"rate_hz\": 250, \"noise_sd_n_m\": {noise}}}\n");
        fails(
            &live,
            &prior,
            &[
                &format!("noise_sd_n_m: found {noise}, expected more than 0, at most"),
                "largest reading of the calibration",
            ],
        );
    }
    fails(
        &live,
        "{\"protocol\": 1, \"name\": \"left\", \"rate_hz\": 250, \"noise_sd_n_m\": 1e-9}\n",
        &["found the name `left`"],
    );
    let no_protocol = fed_text(&live, "{\"rate_hz\": 250, \"noise_sd_n_m\": 1e-9}\n");
    assert!(text(&no_protocol.stderr).contains("missing field `protocol`"), "{}", text(&no_protocol.stderr));
    let told = r#"{"protocol": 1, "rate_hz": 250, "noise_sd_n_m": 1e-9, "told": {"contact_x_m": 0.05, "contact_y_m": 0, "sd_m": 0}}"#;
    fails(&live, told, &["told: ", "a positive sd_m"]);
    fails(&["live"], "", &["--calibration"]);
    fails(&[&live[..], &["--calibration", &two]].concat(), "", &["expected NAME="]);
    fails(&[&live[..], &["--estimator", "nobody"]].concat(), "", &["unknown estimator `nobody`"]);
    fails(&[&live[..], &["--wait=-1"]].concat(), "", &["wait: found -1 s"]);
    fails(&[&live[..], &["--noise", "0.01"]].concat(), "", &["--recording"]);
    fails(&["live", "--recording", &bench.path("none.csv")], "", &["none.csv: no such file"]);
    fails(&["live", "--recording", &bench.path("pin.csv"), "--lost", "2"], "", &["lost: found 2, expected 0 to 1"]);
}

fn signal(child: &Child, signal: rustix::process::Signal) {
    rustix::process::kill_process(rustix::process::Pid::from_child(child), signal).unwrap();
}

#[test]
fn robust_signals_end_the_stream_with_its_summary() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let calibration = bench.calibration();
    for sent in [rustix::process::Signal::INT, rustix::process::Signal::TERM] {
        let mut child = whisker(&["live", "--calibration", &calibration, "--estimator", "ekf"]).spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        let mut answers = BufReader::new(child.stdout.take().unwrap());
        writeln!(stdin, "{}", bench.prior("pin", None, &rows)).unwrap();
        for row in &rows[..200] {
            lines(None, row).iter().for_each(|line| writeln!(stdin, "{line}").unwrap());
        }
        let mut answer = String::new();
        for _ in 0..200 {
            answers.read_line(&mut answer).unwrap();
        }
        // stdin stays open.
        signal(&child, sent);
        let output = child.wait_with_output().unwrap();
        let errors = text(&output.stderr);
        assert!(output.status.success(), "{errors}");
        assert!(errors.contains("200 readings, 200 poses, 200 readings with a pose"), "{errors}");
        drop(stdin);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn robust_a_signal_ends_the_stream_although_nothing_reads_its_answers() {
    let bench = Bench::new();
    let calibration = bench.calibration();
    for sent in [rustix::process::Signal::INT, rustix::process::Signal::TERM] {
        let (reader, mut writer) = std::io::pipe().unwrap();
        // Fills the pipe, so that the first answer is blocked.
        rustix::io::ioctl_fionbio(&writer, true).unwrap();
        while writer.write(b" ").is_ok() {}
        rustix::io::ioctl_fionbio(&writer, false).unwrap();
        let mut child = whisker(&["live", "--calibration", &calibration]).stdout(writer).spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        let mut errors = BufReader::new(child.stderr.take().unwrap()).lines();
        writeln!(stdin, "nonsense").unwrap();
        // The note precedes the answer.
        assert!(errors.next().unwrap().unwrap().starts_with("error: stdin: line 1, "));
        signal(&child, sent);
        assert_eq!(child.wait().unwrap().code(), Some(1));
        let errors: Vec<String> = errors.map(Result::unwrap).collect();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(
            errors[0].starts_with("error: stdout: found a reader that has stopped reading, expected "),
            "{errors:?}"
        );
        drop((stdin, reader));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn robust_a_full_disk_ends_the_stream_with_one_error() {
    let bench = Bench::new();
    let rows = bench.replayed("pin", "ekf");
    let calibration = bench.calibration();
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let mut child = whisker(&["live", "--calibration", &calibration]).stdout(full).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    writeln!(stdin, "{}", bench.prior("pin", None, &rows)).unwrap();
    // The command may have ended before it reads all lines.
    let _ = rows[..50].iter().flat_map(|row| lines(None, row)).try_for_each(|line| writeln!(stdin, "{line}"));
    // stdin stays open.
    let output = child.wait_with_output().unwrap();
    drop(stdin);
    let errors = text(&output.stderr);
    assert_eq!((output.status.code(), errors.lines().count()), (Some(1), 1), "{errors}");
    assert!(errors.starts_with("error: stdout: ") && errors.contains("No space left"), "{errors}");
}
