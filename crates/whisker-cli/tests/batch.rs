//! Interrupted, shared and failing batches: finished items are kept and not repeated, and the bytes equal those of one
//! uninterrupted run.
#![cfg(unix)]

mod golden;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use testbed::results::{SummaryRow, read_scores, score_bytes};

use golden::write_dataset;

/// Number of seeds, which gives a dozen items per trace.
const SEEDS: &str = "120";

/// Writes two golden traces as trials and as calibration traces, and fits their whisker.
fn dataset(folder: &Path) {
    write_dataset(folder);
    let model = ["--model", "polynomial", "--config", r#"{"degree": 5}"#];
    let output = whisker(&[&["fit", folder.to_str().unwrap()], &model[..]].concat()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn whisker(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn evaluate(traces: &Path, results: &Path, more: &[&str]) -> Command {
    let (traces, results) = (traces.to_str().unwrap(), results.to_str().unwrap());
    let fixed = ["evaluate", traces, "--results", results, "--name", "run", "--estimators", "ekf"];
    let seeds: &[&str] = if more.contains(&"--seeds") { &[] } else { &["--seeds", SEEDS] };
    whisker(&[&fixed[..], seeds, more].concat())
}

/// Contents of every file of a run, by path; the summary without its timing.
fn files(run: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn collect(folder: &Path, into: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { collect(&path, into) } else { into.push(path) }
        }
    }
    let mut paths = Vec::new();
    collect(run, &mut paths);
    let read = |path: PathBuf| {
        let bytes = if path.ends_with("summary.csv") {
            let mut rows: Vec<SummaryRow> = read_scores(&path).unwrap();
            rows.iter_mut().for_each(|row| row.head.step_ns = 0.0);
            score_bytes(&rows).unwrap()
        } else {
            fs::read(&path).unwrap()
        };
        (path.strip_prefix(run).unwrap().to_owned(), bytes)
    };
    paths.into_iter().map(read).collect()
}

fn assert_same(one: &BTreeMap<PathBuf, Vec<u8>>, other: &BTreeMap<PathBuf, Vec<u8>>, case: &str) {
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>(), "{case}");
    for (path, bytes) in one {
        assert!(bytes == &other[path], "{case}: {} differs", path.display());
    }
}

fn succeed(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Folder of an unfinished run. `None` if there is none.
fn part(results: &Path) -> Option<PathBuf> {
    let mut paths = fs::read_dir(results).unwrap().map(|entry| entry.unwrap().path());
    paths.find(|path| path.extension().is_some_and(|end| end == "part"))
}

/// Contents of the finished items of an interrupted evaluation, by file.
fn shards(results: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let Some(Ok(entries)) = part(results).map(|part| fs::read_dir(part.join("shards"))) else { return BTreeMap::new() };
    let paths = entries.map(|entry| entry.unwrap().path());
    let whole = paths.filter(|path| !path.file_name().unwrap().to_string_lossy().starts_with('.'));
    // An evaluation that ends meanwhile removes its shards.
    whole.filter_map(|path| Some((path.clone(), fs::read(path).ok()?))).collect()
}

#[test]
fn verif_one_two_and_three_threads_give_the_same_bytes() {
    let folders = [(); 4].map(|()| tempfile::tempdir().unwrap());
    let [traces, results @ ..] = &folders;
    dataset(traces.path());
    let runs: Vec<_> = ["1", "2", "3"]
        .iter()
        .zip(results)
        .map(|(threads, results)| {
            succeed(&mut evaluate(traces.path(), results.path(), &["--threads", threads]));
            files(&results.path().join("run"))
        })
        .collect();
    assert_same(&runs[0], &runs[1], "two threads");
    assert_same(&runs[0], &runs[2], "three threads");
}

#[test]
fn robust_an_interrupted_run_resumes() {
    let [traces, whole, interrupted] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    dataset(traces.path());
    succeed(&mut evaluate(traces.path(), whole.path(), &[]));
    let expected = files(&whole.path().join("run"));
    let mut rng = Pcg64::seed_from_u64(7);
    let mut interruptions = 0;
    for signal in [rustix::process::Signal::INT, rustix::process::Signal::KILL].into_iter().cycle().take(40) {
        let before = shards(interrupted.path());
        let mut child = evaluate(traces.path(), interrupted.path(), &["--threads", "2"]).spawn().unwrap();
        // Until another item is finished, then up to 20 ms into the next one.
        let start = Instant::now();
        while child.try_wait().unwrap().is_none()
            && shards(interrupted.path()).len() <= before.len()
            && start.elapsed() < Duration::from_secs(60)
        {
            sleep(Duration::from_millis(1));
        }
        sleep(Duration::from_micros(rng.random_range(0..20_000)));
        let pid = rustix::process::Pid::from_child(&child);
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{status}");
        } else {
            let _ = rustix::process::kill_process(pid, signal);
            child.wait().unwrap();
        }
        let run = interrupted.path().join("run");
        if run.is_dir() {
            if interruptions > 0 {
                break;
            }
            // On a busy machine an evaluation may end before it is interrupted: it begins again.
            fs::remove_dir_all(run).unwrap();
            continue;
        }
        interruptions += 1;
        for (path, bytes) in before {
            assert!(fs::read(&path).unwrap() == bytes, "{} was recomputed or lost", path.display());
        }
    }
    assert!(interruptions > 0, "no evaluation was interrupted");
    succeed(&mut evaluate(traces.path(), interrupted.path(), &[]));
    assert_same(&expected, &files(&interrupted.path().join("run")), "after interruptions");
    assert_eq!(part(interrupted.path()), None);
}

#[test]
fn robust_an_unfinished_run_of_other_inputs_is_not_resumed() {
    let [traces, whole, interrupted] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    dataset(traces.path());
    succeed(&mut evaluate(traces.path(), whole.path(), &[]));
    succeed(&mut evaluate(traces.path(), interrupted.path(), &["--share", "1/2", "--noise", "0.02"]));
    assert!(!shards(interrupted.path()).is_empty());
    succeed(&mut evaluate(traces.path(), interrupted.path(), &[]));
    assert_same(
        &files(&whole.path().join("run")),
        &files(&interrupted.path().join("run")),
        "after a run at another noise",
    );
}

#[test]
fn verif_shares_of_several_processes_make_one_run() {
    let [traces, whole, shared] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    dataset(traces.path());
    succeed(&mut evaluate(traces.path(), whole.path(), &[]));
    let share = |share: &str| evaluate(traces.path(), shared.path(), &["--share", share]).spawn().unwrap();
    let mut processes = ["1/3", "2/3"].map(share);
    assert!(processes.iter_mut().all(|process| process.wait().unwrap().success()));
    let done = shards(shared.path());
    assert!(!done.is_empty());
    // The third share was not evaluated: this evaluation adds the missing items only.
    succeed(&mut evaluate(traces.path(), shared.path(), &[]));
    assert_same(&files(&whole.path().join("run")), &files(&shared.path().join("run")), "three shares");
}

#[test]
fn robust_an_error_in_a_file_of_settings_names_the_file() {
    let home = tempfile::tempdir().unwrap();
    let [traces, results] = ["traces", "results"].map(|name| home.path().join(name));
    dataset(&traces);
    let file = home.path().join("wrong.json");
    let path = file.to_str().unwrap();
    let refused = |command: &mut Command, place: &str, expected: &str| {
        let output = command.output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{text}");
        let whole = format!("error: {place}settings of {expected}");
        assert!(text.lines().any(|line| line.starts_with(&whole)), "{text} is not {whole}");
    };
    let found = "`fading`: found 1e300, expected 1 to ";
    let in_file = format!("{path}: ");
    for (settings, expected) in [
        (r#"{"ekf": {"fading": 1e300}}"#, format!("`ekf`: {found}")),
        (r#"{"ekf": 3}"#, "`ekf`: settings: found 3, expected a JSON object".into()),
        (r#"{"ekv": {}}"#, "`ekv`: found for no estimator of the run, expected one of: ekf".into()),
        (r#"{"map": {"cell_m": 1}}"#, "`map`: cell_m: found 1, expected 0.0002 to 0.02".into()),
        (r#"{"touch": {"detector": "band-pass", "noise_sds": -1}}"#, "`touch`: `noise_sds`: found -1, expected".into()),
    ] {
        fs::write(&file, settings).unwrap();
        refused(&mut evaluate(&traces, &results, &["--config", path]), &in_file, &expected);
        refused(&mut evaluate(&traces, &results, &["--config", settings]), "", &expected);
    }
    let settings = r#"{"fading": 1e300}"#;
    fs::write(&file, settings).unwrap();
    let trace = traces.join("pin.csv");
    let replay = ["replay", trace.to_str().unwrap(), "--estimator", "ekf", "--config"];
    let live = ["live", "--recording", trace.to_str().unwrap(), "--estimator", "ekf", "--config"];
    for command in [&replay[..], &live] {
        refused(&mut whisker(&[command, &[path]].concat()), &in_file, &format!("`ekf`: {found}"));
        refused(&mut whisker(&[command, &[settings]].concat()), "", &format!("`ekf`: {found}"));
    }
}

#[test]
fn robust_a_failed_item_does_not_affect_the_others() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    dataset(traces.path());
    let script = traces.path().join("breaks.sh");
    // Fails on every trial whose first reading is not negative.
    fs::write(&script, "read greeting\nread row\ncase \"$row\" in *'\"reading_n_m\":-'*) ;; *) exit 7;; esac\necho null\nwhile read row; do echo null; done\n").unwrap();
    let program = format!("breaks=sh {}", script.display());
    let mut command = evaluate(traces.path(), results.path(), &["--seeds", "10", "--exec", &program]);
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{text}");
    let failures = fs::read_to_string(results.path().join("run/failures.csv")).unwrap();
    let failed = failures.lines().skip(1).count();
    assert!(failures.lines().skip(1).all(|line| line.contains("breaks")), "{failures}");
    assert!(0 < failed && failed < 20, "{failed} failed");
    let trials = fs::read_to_string(results.path().join("run/trials.csv")).unwrap();
    assert_eq!(trials.lines().filter(|line| line.contains(",ekf,")).count(), 20);
}
