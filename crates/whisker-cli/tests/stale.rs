//! Stale data and lost results: edited scenes, changed traces, finished runs, outputs that are inputs, concurrent commands.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use files::{OutputLock, sha256};
use serde_json::{Value, json};
use tempfile::TempDir;
use trace::{Role, Trace};

const SUITE: &str = "scenes/suite.json";
const FIT: &str = "fit scenes/suite.json --model elastica";
const EVALUATE: &str = "evaluate scenes/suite.json --estimators ekf --seeds 2";
const REPLAY: &str = "replay datasets/mine/golden_pin.csv --estimator ekf --out estimates.csv";

/// Working folder with a suite of golden scenes, one of them run with two seeds as calibration, and their traces in
/// `datasets/mine`.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        bench.trace("golden_pin", "golden_pin", "pin", Role::Trial, None);
        bench.trace("golden_circle_00", "golden_circle", "circle", Role::Calibration, Some(0));
        bench.trace("golden_circle_01", "golden_circle", "circle", Role::Calibration, Some(1));
        let entries = json!([{"scene": "pin.json"}, {"scene": "circle.json", "seeds": [0, 1]}]);
        bench.write(SUITE, &json!({"format": 1, "name": "mine", "scenes": entries}));
        bench
    }

    /// Writes a golden trace under another name, and its scene.
    fn trace(&self, name: &str, golden: &str, scene: &str, role: Role, seed: Option<u64>) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden").join(golden);
        let mut trace = Trace::read(&path.with_extension("csv")).unwrap();
        let sidecar = &mut trace.sidecar;
        (sidecar.name, sidecar.role, sidecar.contour) = (name.into(), role, None);
        self.write(&format!("scenes/{scene}.json"), &sidecar.scene);
        if let Some(seed) = seed {
            sidecar.scene["seed"] = seed.into();
        }
        trace.write(&self.path("datasets/mine")).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, value: &Value) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, value.to_string()).unwrap();
    }

    /// Changes a JSON file.
    fn edit(&self, name: &str, change: impl FnOnce(&mut Value)) {
        let mut value = serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap();
        change(&mut value);
        self.write(name, &value);
    }

    /// Removes the last row of a trace and states the new hash in its sidecar.
    fn shorten(&self, name: &str) {
        let csv = self.path(&format!("datasets/mine/{name}.csv"));
        let text = fs::read_to_string(&csv).unwrap();
        let rows: Vec<&str> = text.lines().collect();
        let shorter = rows[..rows.len() - 1].join("\n") + "\n";
        fs::write(csv, &shorter).unwrap();
        self.edit(&format!("datasets/mine/{name}.json"), |sidecar| {
            sidecar["rows"] = (rows.len() - 2).into();
            sidecar["csv_sha256"] = sha256(&shorter).into();
        });
    }

    fn command(&self, command_line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
        command.args(command_line.split(' ')).current_dir(self.0.path());
        command
    }

    fn run(&self, command_line: &str) -> Output {
        self.command(command_line).output().unwrap()
    }

    /// Standard output of a command that succeeds.
    fn good(&self, command_line: &str) -> String {
        let output = self.run(command_line);
        assert!(output.status.success(), "{command_line}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Asserts that a command fails with one error line that contains every one of `words`, and changes no file.
    fn refused(&self, command_line: &str, words: &[&str]) {
        let before = self.files();
        let output = self.run(command_line);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{command_line}: {text}");
        assert!(text.starts_with("error: ") && text.trim_end().lines().count() == 1, "{command_line}: {text}");
        for word in words {
            assert!(text.contains(word), "{command_line}: does not contain `{word}`: {text}");
        }
        assert!(self.files() == before, "{command_line}: changed a file");
    }

    /// Contents of all files, hidden ones included.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut folders = vec![self.0.path().to_path_buf()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() && !path.is_symlink() {
                    folders.push(path);
                } else if path.is_file() {
                    files.insert(path.clone(), fs::read(&path).unwrap());
                }
            }
        }
        files
    }
}

/// An edit of a JSON file.
type Change = fn(&mut Value);

#[test]
fn robust_an_edited_scene_is_refused_with_its_key_both_values_and_the_remedy() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.good(EVALUATE);
    let remedy = "run `whisker simulate scenes/suite.json";
    let changes: [(&str, Change, &[&str]); 4] = [
        (
            "scenes/pin.json",
            |scene| scene["duration_s"] = json!(2),
            &["duration_s", "found 2,", "1.2", "golden_pin.csv"],
        ),
        ("scenes/pin.json", |scene| scene["whisker"] = json!("curved"), &["whisker", "\"curved\"", "\"straight\""]),
        ("scenes/circle.json", |scene| scene["object"]["center_m"] = json!([0, 0.01]), &["object.center_m[1]", "0.01"]),
        (SUITE, |suite| suite["scenes"][1]["seeds"] = json!([0, 2]), &["golden_circle_02", "no such trace"]),
    ];
    for (file, change, words) in changes {
        let kept = fs::read(bench.path(file)).unwrap();
        bench.edit(file, change);
        for command in [FIT, EVALUATE] {
            bench.refused(command, &[words, &[remedy]].concat());
        }
        let elsewhere = format!("{FIT} --traces datasets/mine");
        bench.refused(&elsewhere, &[words, &[remedy, "--out datasets/mine"]].concat());
        fs::write(bench.path(file), kept).unwrap();
    }
    assert!(bench.good(FIT).contains("(up to date)") && bench.good(EVALUATE).contains("(up to date)"));
    // Defaults may be stated or left out, and the settings of the simulation may be replaced by `simulate --simulation`
    // in another folder.
    bench.edit("scenes/pin.json", |scene| {
        let keys = scene.as_object_mut().unwrap();
        ["vibration", "seed", "rate_hz", "simulation"].iter().for_each(|key| _ = keys.shift_remove(*key));
    });
    assert!(bench.good(FIT).contains("(up to date)"));
    bench.edit("scenes/pin.json", |scene| scene["simulation"] = json!("fast"));
    bench.refused(FIT, &["simulation.timestep_s", "0.001", "0.0005"]);
    assert!(bench.good(&format!("{FIT} --traces datasets/mine")).contains("(up to date)"));
}

#[test]
fn robust_a_suite_is_checked_against_its_traces() {
    let bench = Bench::new();
    bench.edit("scenes/pin.json", |scene| scene["duration_s"] = json!(2));
    bench.refused("check scenes/suite.json", &["duration_s", "found 2,", "golden_pin.csv", "whisker simulate"]);
}

#[test]
fn robust_an_edited_random_suite_is_refused() {
    let bench = Bench::new();
    let of_whisker = |name: &str, golden: &str, role| {
        bench.trace(name, golden, "unused", role, None);
        bench.edit(&format!("datasets/mine/{name}.json"), |sidecar| sidecar["whisker"]["name"] = json!("mine_7_w01"));
    };
    for name in ["mine_7_0000_00", "mine_7_0000_01"] {
        of_whisker(name, "golden_pin", Role::Trial);
    }
    for name in ["mine_7_w01_left_00", "mine_7_w01_left_01"] {
        of_whisker(name, "golden_circle", Role::Calibration);
    }
    let suite = |change: Change| {
        let mut random = json!({"seed": 7, "sets": 1, "traces": 2, "whiskers": 2});
        change(&mut random);
        bench.write(SUITE, &json!({"format": 1, "name": "mine", "random": random}));
    };
    suite(|_| {});
    bench.good(FIT);
    bench.good(EVALUATE);
    let changes: [(Change, &[&str]); 4] = [
        (
            |random| random["whiskers"] = json!(1),
            &["random.whiskers", "found 1,", "more whiskers", "remove the traces"],
        ),
        (|random| random["traces"] = json!(1), &["random.traces", "found 1,", "mine_7_0000_01", "remove the traces"]),
        (|random| random["sets"] = json!(2), &["mine_7_0001_00", "no such trace"]),
        (|random| random["seed"] = json!(8), &["mine_8_0000_00", "no such trace"]),
    ];
    for (change, words) in changes {
        suite(change);
        for command in [FIT, EVALUATE] {
            bench.refused(command, &[words, &["run `whisker simulate scenes/suite.json`"]].concat());
        }
    }
}

#[test]
fn robust_a_calibration_of_changed_traces_is_refused() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.good(EVALUATE);
    bench.good(REPLAY);
    let calibration = "datasets/mine/calibrations/straight.json";
    bench.shorten("golden_circle_01");
    for command in [EVALUATE, REPLAY] {
        bench.refused(command, &[calibration, "data_sha256", "have changed", "run `whisker fit datasets/mine`"]);
    }
    assert!(!bench.good(FIT).contains("(up to date)"));
    assert!(!bench.good(EVALUATE).contains("(up to date)"), "the same run, brought up to date");
    bench.good(REPLAY);

    let csv = bench.path("datasets/mine/golden_circle_01.csv");
    let kept = fs::read_to_string(&csv).unwrap();
    fs::write(&csv, kept.replacen(",0.", ",1.", 1)).unwrap();
    for command in [EVALUATE, REPLAY] {
        bench.refused(command, &["golden_circle_01.csv", "sha256", "as stated by its sidecar"]);
    }
    fs::remove_file(&csv).unwrap();
    fs::remove_file(csv.with_extension("json")).unwrap();
    bench.refused(REPLAY, &["golden_circle_01.csv is missing", "whisker fit"]);

    // A calibration without its traces cannot be compared.
    fs::create_dir_all(bench.path("elsewhere/calibrations")).unwrap();
    fs::copy(bench.path(calibration), bench.path("elsewhere/calibrations/straight.json")).unwrap();
    bench.good(&format!("{REPLAY} --calibration elsewhere/calibrations/straight.json"));
}

#[test]
fn robust_a_calibration_that_lacks_a_calibration_trace_is_refused() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.trace("golden_circle_02", "golden_circle", "circle", Role::Calibration, Some(2));
    bench.edit(SUITE, |suite| suite["scenes"][1]["seeds"] = json!([0, 1, 2]));
    bench.refused(
        EVALUATE,
        &["straight.json", "not fitted to", "golden_circle_02.csv", "run `whisker fit scenes/suite.json`"],
    );
}

#[test]
fn robust_every_property_of_a_recording_is_an_input_of_its_calibration_and_run() {
    let bench = Bench::new();
    let recorded = json!({
        "clock": "none", "characteristic": [1.0, 0.0, 0.0], "residual_counts": 1.0, "rest_counts": 0.0, "noise_sd_n_m": 1e-7,
        "touch_counts": 1.0
    });
    for trace in ["golden_pin", "golden_circle_00", "golden_circle_01"] {
        bench.edit(&format!("datasets/mine/{trace}.json"), |sidecar| {
            (sidecar["scene"], sidecar["recorded"]) = (Value::Null, recorded.clone());
        });
    }
    bench.good(FIT);
    bench.good(EVALUATE);
    assert!(bench.good(FIT).contains("(up to date)") && bench.good(EVALUATE).contains("(up to date)"));
    bench.edit("datasets/mine/golden_pin.json", |sidecar| sidecar["recorded"]["noise_sd_n_m"] = json!(2e-7));
    assert!(!bench.good(EVALUATE).contains("(up to date)"), "noise of a trial");
    bench.edit("datasets/mine/golden_circle_00.json", |sidecar| sidecar["recorded"]["noise_sd_n_m"] = json!(2e-7));
    bench.refused(EVALUATE, &["straight.json", "have changed"]);
    assert!(!bench.good(FIT).contains("(up to date)"), "noise of a calibration trace");
}

#[test]
fn robust_recordings_are_given_noise_by_name_alone() {
    let bench = Bench::new();
    let recorded = json!({
        "clock": "none", "characteristic": [1.0, 0.0, 0.0], "residual_counts": 1.0, "rest_counts": 0.0, "noise_sd_n_m": 1e-7,
        "touch_counts": 1.0
    });
    bench.trace("real_pin", "golden_pin", "pin", Role::Trial, None);
    bench.edit("datasets/mine/real_pin.json", |sidecar| {
        (sidecar["scene"], sidecar["recorded"]) = (Value::Null, recorded.clone());
    });
    // A recording whose calibration is simulated, and a simulated trial, in folders of their own.
    for (folder, trial) in [("real", "real_pin"), ("made", "golden_pin")] {
        fs::create_dir(bench.path(folder)).unwrap();
        for name in [trial, "golden_circle_00", "golden_circle_01"] {
            for end in ["csv", "json"] {
                let file = format!("{name}.{end}");
                fs::copy(bench.path(&format!("datasets/mine/{file}")), bench.path(&format!("{folder}/{file}")))
                    .unwrap();
            }
        }
        bench.good(&format!("fit {folder} --model elastica"));
    }
    let noise_of = |command: &str| -> (Value, Value) {
        bench.good(&format!("evaluate {command} --estimators ekf --name run --force"));
        let run: Value = serde_json::from_slice(&fs::read(bench.path("results/run/run.json")).unwrap()).unwrap();
        (run["noise"].clone(), run["seeds"].clone())
    };
    assert_eq!(noise_of("made --seeds 2"), (json!([0.01]), json!([1, 2])));
    assert_eq!(noise_of("real"), (json!([0.0]), json!([1])));
    assert_eq!(noise_of("real --noise 0.02 --seeds 2"), (json!([0.02]), json!([1, 2])));
    let together = "evaluate real made --calibrations made/calibrations --estimators ekf";
    bench.refused(together, &["recordings and simulated traces together", "by --noise"]);
    bench.good(&format!("{together} --noise 0"));

    let estimates = |trace: &str, noise: &str| {
        let command = format!("replay {trace} --estimator ekf {noise}");
        bench.good(command.trim_end())
    };
    assert_eq!(estimates("real/real_pin.csv", ""), estimates("real/real_pin.csv", "--noise 0"));
    assert_eq!(estimates("made/golden_pin.csv", ""), estimates("made/golden_pin.csv", "--noise 0.01"));
    assert_ne!(estimates("made/golden_pin.csv", ""), estimates("made/golden_pin.csv", "--noise 0"));
}

/// Whether a process runs. A zombie that has not been reaped yet has ended too.
#[cfg(target_os = "linux")]
fn is_running(pid: &str) -> bool {
    let status = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    status.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with(|state| state != 'Z'))
}

#[cfg(target_os = "linux")]
#[test]
fn robust_an_interrupted_evaluation_leaves_no_process_of_its_programs() {
    let bench = Bench::new();
    bench.good(FIT);
    let script = "(setsid sh -c 'echo $$ >> pids; exec sleep 600' &)\necho $$ >> pids\nexec sleep 600\n";
    fs::write(bench.path("program.sh"), script).unwrap();
    let mut command = bench.command("evaluate datasets/mine --estimators ekf --seeds 2 --name run --threads 1");
    let mut child = command.args(["--exec", "sh program.sh", "--exec-timeout", "600"]).spawn().unwrap();
    let pids = || fs::read_to_string(bench.path("pids")).unwrap_or_default();
    // The program and its child; the program is also started once before the evaluation.
    while pids().lines().filter(|pid| is_running(pid)).count() < 2 {
        assert_eq!(child.try_wait().unwrap(), None);
    }
    let interrupted = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(interrupted.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(pids().lines().find(|pid| is_running(pid)), None);
    assert!(!bench.path("results/run").exists(), "no run with a failed program");
}

#[test]
fn regress_a_program_that_failed_or_imports_a_changed_file_is_evaluated_again() {
    let bench = Bench::new();
    bench.good(FIT);
    fs::write(bench.path("program.sh"), ". ./imported.sh\n").unwrap();
    let evaluate = |options: &[&str]| {
        let mut command = bench.command("evaluate datasets/mine --estimators ekf --seeds 2 --name run");
        let output = command.args(["--exec", "sh program.sh"]).args(options).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stdout).contains("(up to date)"))
    };
    fs::write(bench.path("imported.sh"), "exit 1\n").unwrap();
    assert_eq!(evaluate(&[]), (Some(3), false));
    fs::write(bench.path("imported.sh"), "read first; while read row; do echo null; done\n").unwrap();
    assert_eq!(evaluate(&[]), (Some(0), false), "its failure has been mended");
    assert_eq!(evaluate(&[]), (Some(0), true));
    assert_eq!(evaluate(&["--force"]), (Some(0), false), "what it imports may have changed");
}

#[test]
fn regress_shares_of_a_program_that_imports_a_changed_file_are_computed_again_with_force() {
    let bench = Bench::new();
    bench.good(FIT);
    fs::write(bench.path("program.sh"), ". ./imported.sh\n").unwrap();
    let evaluate = |name: &str, options: &[&str]| {
        // Two items.
        let mut command = bench.command(&format!("evaluate datasets/mine --estimators ekf --seeds 12 --name {name}"));
        let output = command.args(["--exec", "sh program.sh"]).args(options).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let starts = |bench: &Bench| fs::read_to_string(bench.path("starts")).unwrap_or_default().lines().count();
    let version = |number: u32| {
        // Without a trial, a program is started only to find out whether it can be.
        let script = format!("read first || exit\necho {number} >> starts\nwhile read row; do echo null; done\n");
        fs::write(bench.path("imported.sh"), script).unwrap();
        let _ = fs::remove_file(bench.path("starts"));
    };
    let first = "1/2";
    version(1);
    // An interrupted evaluation in shares.
    evaluate("run", &["--share", first]);
    let once = starts(&bench);
    assert!(once > 0);
    version(2);
    evaluate("run", &["--share", first]);
    assert_eq!(starts(&bench), 0, "without --force the finished items are kept");
    version(3);
    evaluate("run", &["--share", first, "--force"]);
    assert_eq!(starts(&bench), once, "with --force they are not");
    evaluate("run", &["--share", "2/2", "--force"]);
    version(4);
    evaluate("run", &["--force"]);
    assert_eq!(starts(&bench), 0, "the shares are merged");
    // A finished run is not up to date.
    version(5);
    evaluate("run", &["--share", first, "--force"]);
    assert_eq!(starts(&bench), once);
    // Nor is it while the shares that replace it are resumed.
    version(6);
    evaluate("run", &["--share", "2/2"]);
    let second = starts(&bench);
    assert!(second > 0);
    version(7);
    evaluate("run", &["--share", first]);
    evaluate("run", &["--force"]);
    assert_eq!(starts(&bench), 0, "resumed shares are merged");
    // Shares without --force may have kept earlier items.
    evaluate("other", &["--share", first]);
    version(8);
    evaluate("other", &["--force"]);
    assert_eq!(starts(&bench), once + second);
    // Shares with --force that replace a finished run with other settings are resumed likewise.
    evaluate("run", &["--noise", "0.02", "--share", first, "--force"]);
    evaluate("run", &["--noise", "0.02", "--share", "2/2"]);
    version(9);
    evaluate("run", &["--noise", "0.02", "--force"]);
    assert_eq!(starts(&bench), 0);
}

#[test]
fn robust_a_finished_run_with_other_settings_is_kept() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.good(EVALUATE);
    bench.good("report results/mine");
    for (other, words) in [
        ("evaluate scenes/suite.json --estimators ekf --seeds 1", "seeds: 1 to 2 there, [1] here"),
        ("evaluate scenes/suite.json --estimators ekf,ukf --seeds 2", "estimators: none only there, ukf only here"),
        ("evaluate scenes/suite.json --estimators ekf --seeds 2 --noise 0.02", "noise: [0.01] there, [0.02] here"),
        ("evaluate scenes/suite.json --estimators ekf --seeds 2 --starts wrong", "traces: none only there"),
        ("evaluate scenes/suite.json --estimators ekf --seeds 1 --share 1/2", "seeds: 1 to 2 there"),
    ] {
        bench.refused(other, &["results/mine", "finished run", words, "--name", "--force"]);
        bench.refused(&format!("{other} --exec cat"), &["results/mine", "finished run", "estimators"]);
    }
    assert!(bench.good(EVALUATE).contains("(up to date)"));
    let before = fs::read(bench.path("results/mine/index.html")).unwrap();
    bench.good(&format!("{EVALUATE} --noise 0.02 --name mine_2"));
    assert_eq!(fs::read(bench.path("results/mine/index.html")).unwrap(), before);
    bench.good(&format!("{EVALUATE} --noise 0.02 --force"));
    assert!(!bench.path("results/mine/index.html").exists(), "the page of the old run");

    let path = bench.path("results/mine/run.json");
    fs::write(&path, "{}").unwrap();
    bench.refused(EVALUATE, &["results/mine", "cannot be compared", "--force"]);
}

#[test]
fn robust_an_output_is_never_an_input() {
    let bench = Bench::new();
    bench.good(FIT);
    symlink(bench.path("datasets/mine/golden_pin.csv"), bench.path("link.csv")).unwrap();
    symlink(bench.path("datasets"), bench.path("data")).unwrap();
    let to = |out: &str| format!("replay datasets/mine/golden_pin.csv --estimator ekf --out {out}");
    for out in [
        "datasets/mine/golden_pin.csv",
        "datasets/mine/golden_pin.json",
        "datasets/mine/calibrations/straight.json",
        "datasets/../datasets/mine/golden_pin.csv",
        "data/mine/golden_pin.csv",
        "data/../datasets/mine/golden_pin.csv",
        "link.csv",
    ] {
        bench.refused(&to(out), &[out, "is the input"]);
    }
    fs::write(bench.path("log.csv"), "t_s,x_counts,y_counts,z_counts\n").unwrap();
    fs::write(bench.path("log.json"), "{}").unwrap();
    let manifest = json!({"format": 1, "kind": "platform_logs", "logs": [{"file": "log.csv", "distance_m": 0.1}]});
    bench.write("logs.json", &manifest);
    for (input, out) in [
        ("log.csv", "log.csv"),
        ("log.csv", "log.json"),
        ("log.csv", "datasets/../log.csv"),
        ("--label 105=log.csv", "log.csv"),
        ("logs.json", "log.csv"),
        ("logs.json", "logs.json"),
    ] {
        bench.refused(&format!("platform fit {input} --out {out}"), &[out, "is the input"]);
    }
    for (command, word) in [
        ("fit datasets/mine --out datasets/mine", "is the input"),
        ("fit datasets/mine --out data/mine/own", "lies in the input"),
        ("evaluate scenes/suite.json --results datasets --name mine", "is the input"),
        ("evaluate scenes/suite.json --results datasets/mine", "lies in the input"),
        ("evaluate datasets/mine --results . --name datasets", "would replace"),
        ("bag export datasets/mine/golden_pin.csv --out datasets/mine/golden_pin.json", "is the input"),
        ("import stanford-whisker datasets --out datasets/stanford", "lies in the input"),
    ] {
        bench.refused(command, &[word]);
    }
    fs::create_dir(bench.path("bag")).unwrap();
    bench.refused("bag import bag --out bag", &["is the input"]);
    assert!(bench.good(FIT).contains("(up to date)"), "the folder of calibrations is a place of its own");
}

#[test]
fn robust_an_output_replaces_no_file_of_another_kind() {
    let bench = Bench::new();
    bench.good(FIT);
    fs::write(bench.path("log.csv"), "t_s,x_counts,y_counts,z_counts\n").unwrap();
    fs::write(bench.path("other.csv.gz"), "another recording").unwrap();
    let estimates = "something other than a table of estimates";
    for out in ["datasets/mine/golden_circle_00.csv", "scenes/pin.json", "log.csv", "other.csv.gz", "datasets"] {
        bench.refused(&format!("replay datasets/mine/golden_pin.csv --estimator ekf --out {out}"), &[out, estimates]);
    }
    // A rename would replace the device.
    bench.refused(&REPLAY.replace("estimates.csv", "/dev/null"), &["/dev/null", "neither a file nor a folder"]);
    for out in ["scenes/pin.json", "other.csv.gz", "datasets/mine/calibrations/straight.json"] {
        bench.refused(
            &format!("platform fit log.csv --out {out}"),
            &[out, "something other than a calibration of the platform"],
        );
    }
    fs::copy(bench.path("scenes/pin.json"), bench.path("scenes/straight.json")).unwrap();
    bench.refused(&format!("{FIT} --out scenes"), &["scenes/straight.json", "something other than a calibration"]);
    fs::create_dir(bench.path("notes")).unwrap();
    let in_space = json!({"format": 2, "kind": "calibration"}).to_string();
    for (text, reason) in [("years of work", "expected"), (in_space.as_str(), "a calibration of format 1")] {
        fs::write(bench.path("notes/straight.json"), text).unwrap();
        bench.refused(&format!("{FIT} --out notes"), &["notes/straight.json", reason]);
    }

    // A conversion replaces a file by itself alone.
    bench.good("bag export datasets/mine/golden_pin.csv --out bag");
    bench.good("bag import bag --out datasets/mine");
    bench.shorten("golden_pin");
    bench.refused("bag import bag --out datasets/mine", &["golden_pin.csv", "other contents"]);
    bench.good("bag import bag --out imported");

    // An earlier output and an empty file are replaced.
    fs::write(bench.path("estimates.csv"), "").unwrap();
    bench.good(REPLAY);
    bench.good(&format!("{REPLAY} --noise 0.02"));
}

#[test]
fn robust_a_folder_of_results_holds_one_kind() {
    let bench = Bench::new();
    bench.good(FIT);
    let recordings = "recordings datasets --out results/mine";
    for (file, found) in
        [("space_settings.json", "tables of `whisker recordings`"), ("space_run.json", "a run in space")]
    {
        bench.write(&format!("results/mine/{file}"), &json!({}));
        for command in [EVALUATE, "evaluate scenes/suite.json --estimators ekf --share 1/2 --force"] {
            bench.refused(command, &["results/mine", found, file, "expected a run in the plane; move these files"]);
        }
        if file == "space_run.json" {
            bench.refused(recordings, &["results/mine", found, "expected tables of `whisker recordings`"]);
        }
        fs::remove_dir_all(bench.path("results/mine")).unwrap();
    }
    bench.good(EVALUATE);
    bench.refused(recordings, &["results/mine", "a run in the plane", "run.json"]);
    fs::create_dir_all(bench.path("space")).unwrap();
    for end in ["csv", "json"] {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space");
        fs::copy(golden.with_extension(end), bench.path(&format!("space/golden_space.{end}"))).unwrap();
    }
    bench.refused("evaluate space --estimators line --name mine --force", &["results/mine", "expected a run in space"]);
}

#[test]
fn robust_files_of_the_user_stay_in_a_run_that_is_replaced() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.good(EVALUATE);
    bench.good("report results/mine");
    for file in ["results/mine/notes.txt", "results/mine/estimates/notes.txt", "results/mine/mine/trials.csv"] {
        fs::create_dir_all(bench.path(file).parent().unwrap()).unwrap();
        fs::write(bench.path(file), "years of work").unwrap();
    }
    bench.good(&format!("{EVALUATE} --noise 0.02 --force"));
    let kept: Vec<PathBuf> =
        bench.files().into_iter().filter(|(_, bytes)| bytes == b"years of work").map(|(path, _)| path).collect();
    assert_eq!(kept.len(), 3, "{kept:?}");
    assert!(!bench.path("results/mine/index.html").exists(), "the page of the former run stays");
    assert_eq!(fs::read_dir(bench.path("results")).unwrap().count(), 1);
}

#[test]
fn robust_half_a_trace_in_a_folder_is_refused() {
    let bench = Bench::new();
    // Other tables and JSON files are no traces.
    bench.good("fit datasets/mine --model elastica");
    bench.good("replay datasets/mine/golden_pin.csv --estimator ekf --out datasets/mine/estimates.csv");
    bench.write("datasets/mine/settings.json", &json!({"kind": "settings"}));
    bench.good("fit datasets/mine --model elastica");
    for (lost, found) in [("json", "csv"), ("csv", "json")] {
        let [lost, found] = [lost, found].map(|end| format!("datasets/mine/golden_circle_01.{end}"));
        let bytes = fs::read(bench.path(&lost)).unwrap();
        fs::remove_file(bench.path(&lost)).unwrap();
        let (found, expected) = (format!("{found}: found a "), format!("expected {lost}"));
        for command in ["fit datasets/mine --model elastica", "evaluate datasets/mine --estimators ekf"] {
            bench.refused(command, &[&found, &expected]);
        }
        fs::write(bench.path(&lost), bytes).unwrap();
    }
}

#[test]
fn robust_a_second_command_waits_and_states_who_holds_the_output() {
    let bench = Bench::new();
    let holder = format!("process {}", std::process::id());
    for (command_line, output) in [
        (FIT, "datasets/mine/calibrations"),
        (EVALUATE, "results/mine"),
        ("report results/mine", "results/mine"),
        (REPLAY, "estimates.csv"),
        ("bag export datasets/mine/golden_pin.csv --out bag", "bag"),
        ("bag import bag --out imported", "imported"),
    ] {
        let lock = OutputLock::take(&bench.path(output), |_| panic!("nobody holds it")).unwrap();
        let mut command = bench.command(command_line);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        stderr.read_line(&mut line).unwrap();
        assert!(line.starts_with(&format!("{output}: waiting for {holder}")), "{command_line}: {line}");
        drop(lock);
        assert!(child.wait().unwrap().success(), "{command_line}");
    }
    let hidden = |path: &&PathBuf| path.file_name().unwrap().to_string_lossy().starts_with('.');
    assert_eq!(bench.files().keys().find(hidden), None, "no lock and no temporary file remains");
}

#[test]
fn robust_temporary_files_of_a_killed_command_are_removed_by_the_next_one() {
    let bench = Bench::new();
    bench.good(FIT);
    bench.good(EVALUATE);
    bench.good("report results/mine");
    bench.good(REPLAY);
    let left = [
        "datasets/mine/calibrations/.straight.json.a1B2c3.part",
        "datasets/mine/.calibrations.lock",
        "results/mine/.index.html.a1B2c3.part",
        "results/mine/figures/.scores.svg.a1B2c3.part",
        "results/.mine.lock",
        ".estimates.csv.a1B2c3.part",
    ];
    left.iter().for_each(|file| fs::write(bench.path(file), "left").unwrap());
    for command in [FIT, EVALUATE, "report results/mine", REPLAY] {
        bench.good(command);
    }
    assert_eq!(left.iter().find(|file| bench.path(file).exists()), None);
}

#[test]
fn robust_messages_on_missing_inputs_state_what_to_give() {
    let bench = Bench::new();
    bench.refused("replay datasets/mine/pin.csv", &["datasets/mine/pin.csv", "expected a trace", "--out DIR"]);
    bench.refused("replay datasets/mine", &["is a folder", "one of its traces"]);
    bench.refused(REPLAY, &["straight.json", "no such calibration", "`whisker fit datasets/mine`", "--calibration"]);
    bench.refused(EVALUATE, &["straight.json", "no such calibration", "whisker fit", "--calibrations"]);
    bench.refused(
        "fit scenes/pin.json",
        &["scenes/pin.json", "scenes", "expected a suite, or the folder of the traces"],
    );
    bench.refused("fit scenes", &["found no traces", "whisker simulate"]);
    fs::rename(bench.path("datasets/mine"), bench.path("made")).unwrap();
    bench.refused(FIT, &["no such trace", "`whisker simulate scenes/suite.json`", "--traces"]);
    bench.refused("report results/mine", &["no such run", "whisker evaluate"]);
    bench.good(&format!("{FIT} --traces made"));
    for command in ["fit made2", "evaluate made2"] {
        bench.refused(command, &["made2", "no such file or folder", "expected a suite (.json) or a folder of traces"]);
    }
    let output = bench.run("platform fit --label 65= --out calibration.json");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && text.contains("expected MM=FILE"), "{text}");
    let output = bench.run("evaluate made --seeds 99999999999");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("99999999999") && text.contains("expected 1 to 1000000, since every seed"), "{text}");
}
