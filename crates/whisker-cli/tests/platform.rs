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
use platform::rig::SPEEDS_M_S;
use platform::routine::{Contact, IncrementsBeamTest, Observer};
use platform::sensor::format;

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

struct NoObserver;

impl Observer for NoObserver {
    fn head(&mut self, _: Head) -> Result<(), Error> {
        Ok(())
    }

    fn contact(&mut self, _: Contact) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn verif_contacts_are_estimated_live_until_the_port_is_unplugged() {
    let folder = tempfile::tempdir().unwrap();
    let emulated = || Emulated { rig: Arc::new(RigTable::built_in()), format: format("hex").unwrap(), seed: 1 };
    let emulation = Emulation::start(&emulated()).unwrap();
    let [log, calibration] = ["log", "calibration.json"].map(|name| folder.path().join(name));
    let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
    let ports = ["run", "--printer", printer, "--sensor", sensor, "--out", text(&log)];
    done(&[&ports[..], &["--speed", "15000", "--increments-y", "7"]].concat());
    done(&["fit", text(&log.join("log.csv")), "--out", text(&calibration)]);
    let calibrated = ["--calibration", text(&calibration)];

    // An existing session is not overwritten, and the printer does not move.
    let again = whisker(&ports).output().unwrap();
    let stderr = String::from_utf8(again.stderr).unwrap();
    assert!(
        again.status.code() == Some(1) && stderr.contains("log.csv: path: found a log, expected nothing yet"),
        "{stderr}"
    );

    // Samples at another rate give a warning.
    let rows = fs::read_to_string(log.join("log.csv")).unwrap();
    let half = folder.path().join("half.csv");
    fs::write(&half, rows.split_inclusive('\n').step_by(2).collect::<String>()).unwrap();
    for (log, is_warned) in [(log.join("log.csv"), false), (half, true)] {
        let stderr = String::from_utf8(done(&[&["infer", text(&log)], &calibrated[..]].concat()).stderr).unwrap();
        assert_eq!(stderr.contains("warning: found 4"), is_warned, "{stderr}");
    }

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
    let routine = IncrementsBeamTest { increments_y: 1, speed_m_s: SPEEDS_M_S[1], ..Default::default() };
    let mut driver = Printer::open(printer, Instant::now(), Arc::default()).unwrap();
    routine.run(&mut driver, Instant::now(), &AtomicBool::new(false), &mut NoObserver).unwrap();
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

#[test]
fn robust_two_signals_at_once_are_one_request_to_stop_the_printer() {
    let folder = tempfile::tempdir().unwrap();
    let emulated = Emulated { rig: Arc::new(RigTable::built_in()), format: format("hex").unwrap(), seed: 1 };
    let emulation = Emulation::start(&emulated).unwrap();
    let (printer, sensor) = (text(&emulation.printer), text(&emulation.sensor));
    let mut run = whisker(&["run", "--printer", printer, "--sensor", sensor, "--out", text(folder.path())]);
    let run = run.stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !folder.path().join("log.csv.part").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no log was created");
        thread::sleep(START / 10);
    }
    let pid = rustix::process::Pid::from_child(&run);
    for _ in 0..2 {
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    }
    let output = run.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && stderr.contains("the printer was stopped at once"), "{stderr}");
    assert!(folder.path().join("log.interrupted.csv").exists());
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
