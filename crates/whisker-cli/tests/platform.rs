//! The commands of the calibration platform on the emulated rig: a session, its fit, and live estimates.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::{Duration, Instant};

use platform::Error;
use platform::emulate::{Emulated, Emulation, RigTable};
use platform::printer::{Head, Printer};
use platform::record::LogSidecar;
use platform::rig::Rig;
use platform::routine::{Contact, IncrementsBeamTest, Observer, Overload};
use platform::sensor::format;
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// Maximum time until a program has opened its port.
const START: Duration = Duration::from_millis(500);

fn whisker(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
    command.arg("platform").args(arguments);
    command
}

fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// Runs a command that must succeed.
fn done(arguments: &[&str]) -> Output {
    let output = whisker(arguments).output().expect("starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn emulation() -> Emulation {
    let (rig, table) = (Arc::new(Rig::built_in()), Arc::new(RigTable::built_in()));
    Emulation::start(&Emulated { rig, table, format: format("hex").unwrap(), seed: 1 }).unwrap()
}

struct NoObserver;

impl Observer for NoObserver {
    fn head(&mut self, _: Head) -> Result<(), Error> {
        Ok(())
    }

    fn contact(&mut self, _: Contact) -> Result<(), Error> {
        Ok(())
    }
}

/// Asserts that a command fails with an error that contains `message`.
fn fails(arguments: &[&str], message: &str) {
    let output = whisker(arguments).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && stderr.contains(message), "{stderr}");
}

/// Checks warnings and errors about a log with another rate, another unit of time, or another label.
fn check_logs(log: &Path, calibrated: &[&str]) {
    let folder = tempfile::tempdir().unwrap();

    // Samples at another rate give a warning.
    let rows = fs::read_to_string(log).unwrap();
    let half = folder.path().join("half.csv");
    fs::write(&half, rows.split_inclusive('\n').step_by(2).collect::<String>()).unwrap();
    for (log, is_warned) in [(log, false), (&half, true)] {
        let stderr = String::from_utf8(done(&[&["infer", text(log)], calibrated].concat()).stderr).unwrap();
        assert_eq!(stderr.contains("warning: found "), is_warned, "{stderr}");
        // Every second sample is half of the calibration's rate, which the message states too.
        let rates: Vec<f64> = stderr.split(' ').filter_map(|word| word.parse().ok()).collect();
        assert!(!is_warned || (rates[0] / rates[1] - 0.5).abs() < 0.01, "{stderr}");
    }

    // Times in milliseconds are rejected.
    let milliseconds = folder.path().join("milliseconds.csv");
    let scaled = rows.lines().map(|row| match row.split_once(',') {
        Some((t_s, rest)) if t_s != "t_s" => format!("{},{rest}\n", 1e3 * t_s.parse::<f64>().unwrap()),
        _ => format!("{row}\n"),
    });
    fs::write(&milliseconds, scaled.collect::<String>()).unwrap();
    fails(&[&["infer", text(&milliseconds)], calibrated].concat(), "the times look like milliseconds");

    // A label does not override the distances that the sidecar states.
    let (labelled, out) = (format!("65={}", text(log)), folder.path().join("none"));
    fails(&["fit", "--label", &labelled, "--out", text(&out)], "found 65.0 mm, and 45.0 to 145.0 mm in ");
    assert!(!out.exists());
}

#[test]
fn verif_contacts_are_estimated_live_until_the_port_is_unplugged() {
    let folder = tempfile::tempdir().unwrap();
    let emulation = emulation();
    let [log, calibration] = ["log", "calibration.json"].map(|name| folder.path().join(name));
    let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
    let ports = ["run", "--printer", printer, "--sensor", sensor, "--out", text(&log)];
    done(&[&ports[..], &["--speed", "15000", "--increments-y", "7"]].concat());
    done(&["fit", text(&log.join("log.csv")), "--out", text(&calibration)]);
    let calibrated = ["--calibration", text(&calibration)];

    // An existing session is not overwritten, and the printer does not move.
    fails(&ports, "log.csv: path: found a log, expected none");
    check_logs(&log.join("log.csv"), &calibrated);

    // A session prints contacts on the standard output and their errors on stderr.
    let out = folder.path().join("second");
    let ports = ["run", "--printer", printer, "--sensor", sensor, "--out", text(&out)];
    let session = done(&[&ports[..], &["--speed", "15000", "--y", "80", "--increments-y", "1"], &calibrated].concat());
    let events = String::from_utf8(session.stdout).unwrap();
    let kinds: Vec<String> = events
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["event"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(kinds, ["pressed", "released", "pushed", "pressed", "released", "pushed"]);
    let summary = String::from_utf8(session.stderr).unwrap();
    assert!(
        summary.contains("2 of 2 pushes found: RMSE 0.") && summary.contains("latency from arrival to report"),
        "{summary}"
    );

    // `infer` reads only the port while another program drives the printer.
    let mut listener =
        whisker(&[&["infer", "--port", sensor, "--print", "csv", "--latency"], &calibrated[..]].concat());
    let listener = listener.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    thread::sleep(START);
    let routine = IncrementsBeamTest { increments_y: 1, speed_m_s: 0.25, ..Default::default() };
    let rig = Rig::built_in();
    let mut driver = Printer::open(printer, rig.bed, Instant::now(), Arc::default()).unwrap();
    routine
        .on(&rig, Overload::Refused)
        .unwrap()
        .run(&mut driver, Instant::now(), &AtomicBool::new(false), &mut NoObserver)
        .unwrap();
    emulation.unplug();
    let output = listener.wait_with_output().unwrap();
    let (events, stderr) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(
        stderr.contains("is the cable plugged in?") && stderr.contains("latency from arrival to report"),
        "{stderr}"
    );
    let found_m: Vec<f64> = events
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|cells| cells[1] == "pressed")
        .map(|cells| cells[3].parse().unwrap())
        .collect();
    assert_eq!(found_m.len(), 2, "{events}");
    assert!(found_m.iter().zip([0.145, 0.045]).all(|(found_m, true_m)| (found_m - true_m).abs() < 2e-3), "{events}");
    assert!(fs::exists(out.join("log.csv")).unwrap());
}

/// Waits for the log of a session.
fn wait_for_log(folder: &Path) {
    let start = Instant::now();
    while !folder.join("log.csv.part").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no log was created");
        thread::sleep(START / 10);
    }
}

#[test]
fn robust_two_signals_at_once_are_one_request_to_stop_the_printer() {
    for signal in [Signal::INT, Signal::HUP] {
        let folder = tempfile::tempdir().unwrap();
        let emulation = emulation();
        let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
        let mut run = whisker(&["run", "--printer", printer, "--sensor", sensor, "--out", text(folder.path())]);
        let run = run.stderr(Stdio::piped()).spawn().unwrap();
        wait_for_log(folder.path());
        for _ in 0..2 {
            kill_process(Pid::from_child(&run), signal).unwrap();
        }
        let output = run.wait_with_output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(1) && stderr.contains("the printer was stopped at once"), "{stderr}");
        assert!(["csv", "json"].iter().all(|end| folder.path().join(format!("log.interrupted.{end}")).exists()));
    }
}

#[test]
fn robust_a_closed_terminal_ends_the_session_and_keeps_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let emulation = emulation();
    let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
    let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&terminal).and_then(|()| unlockpt(&terminal)).unwrap();
    let path = ptsname(&terminal, Vec::new()).unwrap().into_string().unwrap();
    let side = || Stdio::from(fs::File::options().read(true).write(true).open(&path).unwrap());
    let mut run = whisker(&["run", "--printer", printer, "--sensor", sensor, "--out", text(folder.path())])
        .stdout(side())
        .stderr(side())
        .spawn()
        .unwrap();
    wait_for_log(folder.path());
    drop(terminal);
    kill_process(Pid::from_child(&run), Signal::HUP).unwrap();
    assert_eq!(run.wait().unwrap().code(), Some(1), "an error, not a panic");
    assert!(["csv", "json"].iter().all(|end| folder.path().join(format!("log.interrupted.{end}")).exists()));
}

/// The session fills a file system of 1200 KiB within ten seconds.
#[cfg(target_os = "linux")]
#[test]
fn robust_a_disk_that_fills_up_ends_the_session_and_keeps_every_sample() {
    let mounts = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
        command
    };
    let (disk, kept) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mount = format!("mount -t tmpfs -o size=1200k tmpfs {}", text(disk.path()));
    if !mounts(&mount).output().is_ok_and(|output| output.status.success()) {
        return;
    }
    let emulation = emulation();
    let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
    let script = format!(
        "{mount} && {{ {} platform run --printer {printer} --sensor {sensor} --speed 15000 --out {disk}/log; code=$?; cp {disk}/log/* {}; exit $code; }}",
        env!("CARGO_BIN_EXE_whisker"),
        text(kept.path()),
        disk = text(disk.path()),
    );
    let output = mounts(&script).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && stderr.contains("No space left on device"), "{stderr}");
    let samples: usize = stderr.split_whitespace().next().unwrap().parse().unwrap();
    let rows = fs::read_to_string(kept.path().join("log.interrupted.csv")).unwrap();
    assert_eq!(rows.lines().count(), samples + 1, "{stderr}");
    let sidecar: LogSidecar = files::read_json(&kept.path().join("log.interrupted.json")).unwrap();
    assert!(!sidecar.contacts.is_empty());
    assert_eq!(fs::read_dir(kept.path()).unwrap().count(), 3);
}

#[test]
fn robust_a_push_beyond_the_whiskers_limit_is_refused_before_the_printer_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let (out, rig) = (folder.path().join("log"), folder.path().join("rig.json"));
    let run = |options: &[&str]| {
        let ports = ["run", "--printer", "/dev/none", "--sensor", "/dev/none", "--out", text(&out)];
        let output = whisker(&[&ports[..], options].concat()).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    let refused = run(&["--x", "103"]);
    assert!(refused.contains("found 103.0 mm, expected at most 18.4 mm, the largest push at 45 mm"), "{refused}");
    // A whisker of another rig, without a rebuild.
    let shipped = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/openwhisker.json")).unwrap();
    fs::write(&rig, shipped.replace("\"largest_strain\": 0.025", "\"largest_strain\": 0.008")).unwrap();
    let refused = run(&["--rig", text(&rig)]);
    assert!(refused.contains("found 6.0 mm, expected at most 4."), "{refused}");
    fs::write(&rig, shipped.replace("0.025", "0.025x")).unwrap();
    let invalid = run(&["--rig", text(&rig)]);
    assert!(invalid.contains("rig.json:21:"), "{invalid}");
    let allowed = run(&["--x", "103", "--allow-overload"]);
    assert!(allowed.contains("/dev/none: cannot be opened"), "{allowed}");
}

#[test]
fn robust_infer_reads_either_a_log_or_a_port() {
    for (arguments, words) in [
        (&["infer", "--calibration", "none.json"][..], "required"),
        (&["infer", "--calibration", "none.json", "--port", "/dev/none", "log.csv"], "cannot be used with"),
        (&["infer", "--calibration", "none.json", "--rate-hz", "800", "log.csv"], "cannot be used with"),
        (&["infer", "--calibration", "none.json", "--port", "/dev/none", "--rate-hz", "0"], "1 to 10000"),
    ] {
        let output = whisker(arguments).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && stderr.contains(words), "{stderr}");
    }
}
