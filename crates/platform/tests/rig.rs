//! The routine on the emulated rig: from port to log, and from log to live estimates.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use bag::messages::PoseStamped;
use bag::topics;
use files::Watermark;
use platform::Error;
use platform::calibration::logs::{Source, gather};
use platform::calibration::regression::regression;
use platform::calibration::{Calibration, HoldOut, Live, Settings};
use platform::emulate::{Emulated, Emulation, RigTable};
use platform::inference::Inference;
use platform::printer::Printer;
use platform::record::{Log, LogSidecar, Sink};
use platform::rig::Rig;
use platform::routine::{IncrementsBeamTest, Overload};
use platform::sensor::{Reader, ReaderSettings, format};
use platform::session::{self, Outcome};
use platform::streams::{Bag, PUSHED};

/// Highest speed of the head (m/s).
const FASTEST_M_S: f64 = 0.25;

fn emulation() -> Emulation {
    let (rig, table) = (Arc::new(Rig::built_in()), Arc::new(RigTable::built_in()));
    Emulation::start(&Emulated { rig, table, format: format("hex").expect("registered"), seed: 1 }).expect("ports")
}

fn watermark() -> Watermark {
    Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() }
}

fn session(emulation: &Emulation, routine: &IncrementsBeamTest, folder: &Path, stop: Arc<AtomicBool>) -> Outcome {
    let log = Log::create(folder, LogSidecar::new("hex", 800.0, watermark())).expect("a log");
    session_into(emulation, routine, None, Box::new(log), stop)
}

fn session_into(
    emulation: &Emulation,
    routine: &IncrementsBeamTest,
    inference: Option<Inference<'_>>,
    sink: Box<dyn Sink>,
    stop: Arc<AtomicBool>,
) -> Outcome {
    let (origin, rig) = (Instant::now(), Rig::built_in());
    let plan = routine.on(&rig, Overload::Refused).expect("allowed");
    let row = format("hex").expect("registered");
    let mut printer =
        Printer::open(emulation.printer.to_str().expect("text"), rig.bed, origin, stop).expect("a printer");
    let settings = ReaderSettings::new(row, origin);
    let reader = Reader::open(emulation.sensor.to_str().expect("text"), settings).expect("a sensor");
    session::run(&plan, &mut printer, reader, inference, vec![sink], origin)
}

/// Times and y counts of a log's table, unwrapped.
fn readings(path: &Path) -> Vec<(f64, f64)> {
    let text = fs::read_to_string(path).expect("a table");
    let (mut turns, mut last) = (0.0, None);
    let rows = text.lines().skip(1).map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        let (t_s, y): (f64, f64) = (cells[0].parse().expect("a time"), cells[2].parse().expect("counts"));
        let step = y - last.unwrap_or(y);
        turns -= f64::from(i8::from(step > 32768.0)) - f64::from(i8::from(step < -32768.0));
        last = Some(y);
        (t_s, y + 65536.0 * turns)
    });
    rows.collect()
}

#[test]
fn verif_pushes_at_two_places_are_recorded() {
    let emulation = emulation();
    let folder = tempfile::tempdir().expect("a folder");
    let routine = IncrementsBeamTest { increments_y: 1, speed_m_s: FASTEST_M_S, ..Default::default() };
    let outcome = session(&emulation, &routine, folder.path(), Arc::default());
    assert!(outcome.error.is_none(), "{:?}", outcome.error);
    let sidecar: LogSidecar = files::read_json(&folder.path().join("log.json")).expect("a sidecar");
    assert_eq!(sidecar.contacts.len(), 2);
    let rows = readings(&folder.path().join("log.csv"));
    assert_eq!(rows.len() as u64, outcome.report.tally.samples);
    assert_eq!((outcome.report.overwritten, outcome.report.tally.garbage_lines), (0, 0));
    let table = RigTable::built_in();
    let rest = rows[..200].iter().map(|(_, y)| y).sum::<f64>() / 200.0;
    for (contact, distance_m) in sidecar.contacts.iter().zip([0.145, 0.045]) {
        assert!((contact.distance_m - distance_m).abs() < 1e-9 && (contact.push_m - 0.006).abs() < 1e-9);
        let within = rows.iter().filter(|(t_s, _)| (contact.start_s..contact.end_s).contains(t_s));
        let peak = within.map(|(_, y)| y - rest).fold(0.0, |most: f64, y| if y.abs() > most.abs() { y } else { most });
        let expected = table.deflection_counts(distance_m, 0.006).expect("touches")[1];
        // Four standard deviations of the noise.
        assert!((peak - expected).abs() < 200.0 + 0.01 * expected.abs(), "{distance_m}: {peak} {expected}");
    }
    let heads = fs::read_to_string(folder.path().join("head.csv")).expect("a table");
    assert!(heads.lines().any(|row| row.contains(",0.153000,0.096750,")), "the head reached its target");
    let sent = emulation.finish().expect("ran");
    assert_eq!(sent.dropped, 0);
    assert!(sent.readings - outcome.report.tally.samples < 80, "{sent:?} {}", outcome.report);
}

/// `cargo xtask rig` does the same at all places and at the documented speed.
#[test]
fn verif_a_calibration_of_one_session_estimates_the_next_live() {
    let folder = tempfile::tempdir().expect("a folder");
    let routine = IncrementsBeamTest { increments_y: 7, speed_m_s: FASTEST_M_S, ..Default::default() };
    let outcome = session(&emulation(), &routine, folder.path(), Arc::default());
    assert!(outcome.error.is_none(), "{:?}", outcome.error);
    let log = [Source { path: folder.path().join("log.csv"), distance_m: None }];
    let row = regression("robust").expect("registered");
    let gathered = gather(&log, &Settings::default(), row, 800.0).expect("a log");
    let calibration = Calibration::fit(row, gathered.presses, gathered.chain, HoldOut::Press, 0.8, watermark());
    let calibration = calibration.expect("fitted");

    let inference = Inference::new(Live::new(&calibration).expect("a low-pass").expect("a chain"));
    let recording = folder.path().join("recording");
    let sidecar = LogSidecar::new("hex", 800.0, watermark());
    let bag = Box::new(Bag::create(&recording, sidecar).expect("a recording"));
    let routine = IncrementsBeamTest { total_y_m: 0.090, increments_y: 3, ..routine };
    let outcome = session_into(&emulation(), &routine, Some(inference), bag, Arc::default());
    assert!(outcome.error.is_none(), "{:?}", outcome.error);
    assert_eq!(outcome.latency.expect("inferred").all.count(), outcome.report.tally.samples);

    let records: Vec<_> =
        bag::Reader::open(&recording).expect("a recording").records().collect::<Result<_, _>>().expect("whole");
    let along_m = |topic: &str| {
        let messages = records.iter().filter(|record| record.topic == topic);
        messages.map(|record| record.decode::<PoseStamped>().expect("a pose").pose.position.y).collect::<Vec<f64>>()
    };
    let (found_m, pushed_m) = (along_m(topics::DETECTED_CONTACT), along_m(PUSHED));
    assert_eq!((found_m.len(), pushed_m.len()), (4, 4), "{found_m:?}");
    for (found_m, pushed_m) in found_m.iter().zip(&pushed_m) {
        assert!((found_m - pushed_m).abs() < 2e-3, "{found_m} {pushed_m}");
    }
}

#[test]
fn robust_an_interrupt_stops_the_head_and_keeps_the_data() {
    let emulation = emulation();
    let folder = tempfile::tempdir().expect("a folder");
    let stop = Arc::new(AtomicBool::new(false));
    let stop_request = stop.clone();
    thread::spawn(move || {
        thread::sleep(Duration::from_secs(2));
        stop_request.store(true, Ordering::Relaxed);
    });
    let outcome = session(&emulation, &IncrementsBeamTest::default(), folder.path(), stop);
    assert!(matches!(outcome.error, Some(Error::Interrupted)), "{:?}", outcome.error);
    assert!(!folder.path().join("log.csv").exists());
    let rows = readings(&folder.path().join("log.interrupted.csv"));
    assert_eq!(rows.len() as u64, outcome.report.tally.samples);
    assert!(rows.len() > 800);
    // A reopened printer restarts: its answers to the previous client are discarded.
    #[cfg(not(target_os = "linux"))]
    thread::sleep(Duration::from_millis(200));
    let printer = emulation.printer.to_str().expect("text");
    Printer::open(printer, Rig::built_in().bed, Instant::now(), Arc::default())
        .and_then(|mut printer| printer.home())
        .expect("homed");
}

#[test]
fn robust_an_unplugged_rig_ends_the_session_and_keeps_the_data() {
    let emulation = emulation();
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = thread::scope(|scope| {
        let session = scope.spawn(|| {
            // Both ports are open before they vanish.
            session(&emulation, &IncrementsBeamTest::default(), folder.path(), Arc::default())
        });
        thread::sleep(Duration::from_secs(3));
        emulation.unplug();
        session.join().expect("no panic")
    });
    assert!(matches!(outcome.error, Some(Error::Gone { .. })), "{:?}", outcome.error);
    assert!(folder.path().join("log.interrupted.csv").exists());
}
