//! External programs: messages sent to them, accepted answers and all failure modes.
#![cfg(unix)]

#[path = "../../whisker/tests/world/mod.rs"]
mod world;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use evaluation::participant::{Participant, Program, Registered, Task};
use nalgebra::Matrix3;
use serde_json::{Value, json};
use testbed::replay::{Replay, detect_contact};
use whisker::estimators::{self, BaseNoise, ContactPrior, Knowledge, Sample};
use whisker::events::TouchConfig;
use whisker::frames::{Point, Pose};
use whisker::sensor::Face;

/// Timeout that only a program without an answer exceeds, even on a loaded machine.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Timeout that suffices for the start of a program and some answers.
const MIDDLING: Duration = Duration::from_secs(3);
/// Timeout that may end before a program has started.
const SHORT: Duration = Duration::from_millis(300);

/// Measurement noise known to the estimators.
const NOISE_N_M: f64 = 3e-7;

fn trial(knowledge: &Knowledge) -> Vec<Sample> {
    world::samples(knowledge, 0.6, |_| true).into_iter().map(|(_, sample)| sample).collect()
}

/// Runs a shell script over a trial of [`world`].
fn replay_of(script: &str, timeout: Duration, knowledge: &Arc<Knowledge>) -> Replay {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("script");
    fs::write(&path, script).unwrap();
    let program = Program::new(&format!("sh {}", path.display()), timeout).unwrap();
    let mut samples = trial(knowledge);
    let touched = detect_contact(TouchConfig::default(), knowledge, &mut samples);
    let task = Task { knowledge, samples: &samples, touched: &touched, trace: "secret", seed: 1 };
    let replay = program.replay(&task).unwrap();
    assert_eq!(replay.estimates.len(), samples.len());
    replay
}

fn replay(script: &str) -> Replay {
    replay_of(script, TIMEOUT, &world::knowledge(NOISE_N_M))
}

/// Asserts that a script fails with a message containing these words and yields no further estimates.
fn fails(script: &str, timeout: Duration, words: &[&str]) {
    let replay = replay_of(script, timeout, &world::knowledge(NOISE_N_M));
    let reason = replay.failure.unwrap_or_else(|| panic!("{script}: did not fail"));
    assert!(!reason.contains('\n'), "{reason}");
    for word in words {
        assert!(reason.contains(word), "{script}: `{reason}` does not contain `{word}`");
    }
    assert!(replay.estimates.last().unwrap().is_none(), "{script}");
}

/// Script that answers every row with this line.
fn always(answer: &str) -> String {
    format!("read -r known; while read -r row; do echo '{answer}'; done")
}

/// Script that answers the third row with this line and every other with `null`.
fn third(answer: &str) -> String {
    format!("read -r known; i=0; while read -r row; do i=$((i+1)); [ $i = 3 ] && echo '{answer}' || echo null; done")
}

#[test]
fn verif_answers_are_converted_to_estimates() {
    let replay = replay(&always(
        r#"{"contact_x_m": 0.05, "contact_y_m": -0.002, "cov_xx_m2": 4e-8, "cov_xy_m2": 1e-8, "cov_yy_m2": 1e-8,
            "innovation_n_m": 6e-7, "innovation_variance_n2_m2": 9e-14}"#
            .replace('\n', " ")
            .as_str(),
    ));
    assert_eq!(replay.failure, None);
    let last = replay.estimates.last().unwrap().unwrap();
    assert_eq!((last.contact.x(), last.contact.y(), last.face), (0.05, -0.002, Face::Left));
    assert!(last.calibrated && !last.at_tip);
    assert_eq!(last.covariance_m2.unwrap()[(0, 1)], 1e-8);
    assert!((last.innovation.unwrap().nis - 4.0).abs() < 1e-9);
}

#[test]
fn verif_null_and_answers_without_covariance_are_accepted() {
    assert!(replay(&always("null")).estimates.iter().all(Option::is_none));
    let bare = replay(&always(r#"{"contact_x_m": 0.05, "contact_y_m": -0.002}"#));
    assert!(bare.estimates.iter().all(|estimate| estimate.is_some_and(|e| e.covariance_m2.is_none())));
}

#[test]
fn verif_a_program_receives_the_prior_information_and_no_truth() {
    let folder = tempfile::tempdir().unwrap();
    let received = folder.path().join("received");
    let contact_prior = Some(ContactPrior { contact: Point::new(0.04, 0.001), sd_m: 3e-3 });
    let base_noise = BaseNoise(Matrix3::new(1e-8, 2e-9, 3e-9, 2e-9, 4e-8, 5e-9, 3e-9, 5e-9, 6e-8));
    let knowledge =
        Arc::new(Knowledge { contact_prior, base_noise, ..Arc::unwrap_or_clone(world::knowledge(NOISE_N_M)) });
    let listen = format!(
        "while read -r line; do printf '%s\\n' \"$line\" >> {}; [ \"$first\" ] && echo null; first=1; done",
        received.display()
    );
    assert_eq!(replay_of(&listen, TIMEOUT, &knowledge).failure, None);
    let text = fs::read_to_string(received).unwrap();
    assert!(!text.contains("truth") && !text.contains("secret"));
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let samples = trial(&knowledge);
    assert_eq!(lines.len(), 1 + samples.len());
    let known = &lines[0];
    assert_eq!((known["protocol"].as_u64(), known["noise_sd_n_m"].as_f64()), (Some(1), Some(NOISE_N_M)));
    assert_eq!(known["told"]["contact_x_m"].as_f64(), Some(0.04));
    let covariance = json!({
        "cov_xx_m2": 1e-8, "cov_xy_m2": 2e-9, "cov_yy_m2": 4e-8,
        "cov_x_yaw_m_rad": 3e-9, "cov_y_yaw_m_rad": 5e-9, "cov_yaw_yaw_rad2": 6e-8,
    });
    assert_eq!(known["base_noise"], covariance);
    let face = &known["faces"][0];
    let nodes = face["shape"][0].as_u64().unwrap() * face["shape"][1].as_u64().unwrap();
    for (name, column) in face["table"].as_object().unwrap() {
        assert_eq!(column.as_array().unwrap().len() as u64, nodes, "{name}");
    }
    // A point at rest in Start moves in Base consistently with both poses of a row.
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let last = lines.last().unwrap();
    let first_to_last = world::base(0.0).then(&world::base((samples.len() - 1) as f64 / world::RATE_HZ).inverse());
    let base = first_to_last.inverse();
    for (key, expected) in [
        ("base_x_m", base.origin().x()),
        ("base_y_m", base.origin().y()),
        ("base_yaw_rad", base.yaw_rad()),
        ("last_x_m", samples.last().unwrap().motion.origin().x()),
        ("reading_n_m", samples.last().unwrap().reading_n_m),
    ] {
        assert!((number(last, key) - expected).abs() < 1e-12, "{key}");
    }
    assert!(lines[1]["touched"].is_null());
    assert_eq!(last["touched"], "left");
}

#[test]
fn verif_a_row_is_sent_only_after_the_previous_answer() {
    let folder = tempfile::tempdir().unwrap();
    let early = folder.path().join("early");
    // After the first row, a background reader waits for the second, which must not arrive before an answer.
    let script = format!(
        "read -r known; read -r row; (read -r next && touch {early}) <&0 & sleep 0.3; kill $! 2> /dev/null; [ -e {early} ] || exit 7",
        early = early.display()
    );
    fails(&script, TIMEOUT, &["exit status: 7", "before its answer to row 1"]);
    assert!(!early.exists());
}

#[test]
fn robust_invalid_answers_are_reported_with_row_found_and_expected() {
    for (answer, words) in [
        (r#"{"contact_x_m": NaN, "contact_y_m": 0}"#, ["found `{\"contact_x_m\": NaN", "expected null or"]),
        (r#"{"contact_x_m": 0.05}"#, ["found `{\"contact_x_m\": 0.05}`", "missing field `contact_y_m`"]),
        (r#"{"contact_x_m": 1, "contact_y_m": 1, "truth": 1}"#, ["unknown field `truth`", "expected null or"]),
        ("0.05 0.002", ["found `0.05 0.002`", "expected null or"]),
        ("", ["found ``", "expected null or"]),
        (r#"{"contact_x_m": 1e9, "contact_y_m": 0}"#, ["found `{", "expected a point within 1000 m"]),
        (r#"{"contact_x_m": 1, "contact_y_m": 0, "cov_xx_m2": 1}"#, ["found `{", "all of cov_xx_m2"]),
        (
            r#"{"contact_x_m": 1, "contact_y_m": 0, "cov_xx_m2": 1, "cov_xy_m2": 2, "cov_yy_m2": 1}"#,
            ["found `{", "expected a positive definite matrix"],
        ),
        (r#"{"contact_x_m": 1, "contact_y_m": 0, "innovation_n_m": 1}"#, ["found `{", "both innovation_n_m"]),
    ] {
        fails(&third(answer), TIMEOUT, &[&["answer to row 3 of 150"], &words[..]].concat());
    }
    let estimates = replay(&third("nonsense")).estimates;
    assert!(estimates.iter().all(Option::is_none));
}

#[test]
fn robust_crashes_are_reported_with_the_last_line_of_stderr() {
    let script = "read -r known; read -r row; echo null; echo first >&2; echo 'no idea' >&2; exit 3";
    fails(script, TIMEOUT, &["exit status: 3", "last line of stderr `no idea`", "before its answer to row 2 of 150"]);
    fails("kill -9 $$", TIMEOUT, &["SIGKILL", "before its answer to row 1"]);
    fails("exec > /dev/null; read -r known; sleep 600", MIDDLING, &["closed its stdout before its answer to row 1"]);
}

#[test]
fn robust_programs_that_do_not_answer_read_or_end_time_out() {
    let begin = Instant::now();
    // The first row may or may not be answered, depending on the start-up time.
    fails("read -r known; read -r row; echo null; sleep 600", SHORT, &["no answer to row", "of 150 within 0.3 s"]);
    fails("sleep 600", SHORT, &["no answer to row 1 of 150 within 0.3 s"]);
    fails(&format!("{}; sleep 600", always("null")), MIDDLING, &["still running 3 s after its input was closed"]);
    fails("while :; do echo null; done", TIMEOUT, &["more answers than the 150 rows"]);
    assert!(begin.elapsed() < Duration::from_secs(500), "a program was not killed after its timeout");
}

#[test]
fn robust_child_processes_are_killed_with_the_trial() {
    let folder = tempfile::tempdir().unwrap();
    let pids = folder.path().join("pids");
    let script = format!("sleep 600 & echo $! > {0}; echo $$ >> {0}; wait", pids.display());
    fails(&script, MIDDLING, &["no answer to row 1"]);
    let pids = fs::read_to_string(pids).unwrap();
    let is_running = |pid: &str| {
        // A zombie that has not been reaped yet has ended too.
        let ps = Command::new("ps").args(["-o", "stat=", "-p", pid]).stderr(Stdio::null()).output().unwrap();
        let state = String::from_utf8(ps.stdout).unwrap();
        !state.trim().is_empty() && !state.starts_with('Z')
    };
    assert_eq!(pids.lines().count(), 2);
    let begin = Instant::now();
    while let Some(pid) = pids.lines().find(|pid| is_running(pid)) {
        assert!(begin.elapsed() < TIMEOUT, "{pid} is still running");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
#[cfg(target_os = "linux")]
fn robust_a_child_process_with_a_session_of_its_own_is_killed_with_the_trial() {
    let folder = tempfile::tempdir().unwrap();
    let pid = folder.path().join("pid");
    // The process group ends at `setsid`, and the parent of the process ends at once.
    let daemon =
        format!("(setsid sh -c 'echo $$ > {0}; exec sleep 600' &); while [ ! -s {0} ]; do :; done", pid.display());
    fails(&format!("{daemon}; sleep 600"), MIDDLING, &["no answer to row 1"]);
    let pid = fs::read_to_string(pid).unwrap();
    assert!(!Path::new("/proc").join(pid.trim()).exists(), "{pid} is still there");
}

#[test]
fn robust_a_program_that_does_not_start_is_reported() {
    let program = Program::new("no-such-program --fast", TIMEOUT).unwrap();
    let error = format!("{:#}", program.check(&world::knowledge(NOISE_N_M)).unwrap_err());
    assert!(error.contains("`no-such-program` does not start: No such file"), "{error}");
}

#[test]
fn verif_a_registered_participant_returns_the_estimates_of_its_estimator() {
    let knowledge = world::knowledge(NOISE_N_M);
    let mut samples = trial(&knowledge);
    let touched = detect_contact(TouchConfig::default(), &knowledge, &mut samples);
    let task = Task { knowledge: &knowledge, samples: &samples, touched: &touched, trace: "exam", seed: 1 };
    let replay = Registered::new("ekf", &json!({})).unwrap().replay(&task).unwrap();
    let row = estimators::estimator("ekf").unwrap();
    assert_eq!(replay.estimates, world::estimator(row, &knowledge, 1).run(&samples));
    assert_eq!(replay.failure, None);
}

#[test]
fn verif_an_offset_is_subtracted_from_a_whole_recording_as_sample_by_sample() {
    let knowledge = world::knowledge(NOISE_N_M);
    // Free at first.
    let free = |i: usize| Sample {
        motion: Pose::new(0.0, 0.0, 0.0),
        dt_s: 1.0 / world::RATE_HZ,
        reading_n_m: NOISE_N_M * [0.6, -1.2, 0.1, 1.5, -0.4, -0.9, 1.0, -0.7][i % 8],
    };
    let exact: Vec<Sample> = (0..60).map(free).chain(trial(&knowledge)).collect();
    let largest_n_m = knowledge.faces[0].largest_reading_n_m;
    let with_offset = |sample: &Sample| Sample { reading_n_m: sample.reading_n_m + 0.015 * largest_n_m, ..*sample };
    let raw: Vec<Sample> = exact.iter().map(with_offset).collect();
    let mut samples = raw.clone();
    let touched = detect_contact(TouchConfig::default(), &knowledge, &mut samples);
    assert!(samples[0].reading_n_m.abs() < 0.005 * largest_n_m, "{}", samples[0].reading_n_m);
    let task = Task { knowledge: &knowledge, samples: &samples, touched: &touched, trace: "exam", seed: 1 };
    let replay = Registered::new("ekf", &json!({})).unwrap().replay(&task).unwrap();
    let row = estimators::estimator("ekf").unwrap();
    assert!(replay.estimates.iter().any(Option::is_some));
    assert_eq!(replay.estimates, world::estimator(row, &knowledge, 1).run(&raw));
}

#[test]
fn verif_names_and_hashes() {
    let script = tempfile::Builder::new().prefix("my_filter").rand_bytes(0).suffix(".py").tempfile().unwrap();
    let path = script.path().display().to_string();
    let described = |text: &str| Program::new(text, TIMEOUT).unwrap().describe();
    let own = described(&format!("python3 -u '{path}' --gain 2"));
    assert_eq!(own.name, "my_filter");
    assert_eq!(own.config["files_sha256"][&path].as_str().map(str::len), Some(64));
    assert_eq!(own.config["timeout_s"], TIMEOUT.as_secs_f64());
    assert_eq!(described("mine=./track --gain=2").name, "mine");
    assert_eq!(described("./track --gain=2").name, Path::new("track").to_str().unwrap());
    for (text, word) in
        [("a 'b", "matching quotes"), ("", "a command"), ("ekf=a", "`ekf` is the name"), ("./a.b.c d", "a.b")]
    {
        let error = Program::new(text, TIMEOUT).unwrap_err().to_string();
        assert!(error.starts_with("--exec: ") && error.contains(word), "{error}");
    }
}
