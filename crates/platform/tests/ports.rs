//! Sensor and printer over pseudo-terminals: errors of ports and devices are reported, and no data that arrived are lost.
#![cfg(unix)]

mod pseudo;

use std::io::{BufRead, BufReader, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use platform::printer::Printer;
use platform::rig::Rig;
use platform::sensor::{FormatRow, Reader, ReaderSettings, Report, format};
use platform::{Error, Sample};
use pseudo::{Device, pair};

fn hex() -> &'static FormatRow {
    format("hex").expect("registered")
}

/// Counts that encode a number.
fn counts(number: u64) -> [u16; 3] {
    [number as u16, (number >> 16) as u16, !number as u16]
}

fn print(number: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    (hex().build)().print(counts(number), &mut bytes);
    bytes
}

/// Takes samples up to this number or the end of the stream.
fn take(reader: &Reader, count: usize) -> Vec<Sample> {
    let mut arrivals = Vec::new();
    while arrivals.len() < count && reader.take(&mut arrivals, Duration::from_secs(10)) {}
    arrivals.into_iter().map(|arrival| arrival.sample).collect()
}

#[test]
fn verif_every_sample_that_arrives_is_taken_once() {
    let (name, mut device, _port) = pair();
    let reader = Reader::open(&name, ReaderSettings::new(hex(), Instant::now())).expect("open");
    // The rest of a line, then readings in arbitrary pieces, with garbage in between.
    let mut bytes = b"34abcd\n".to_vec();
    for number in 0..5000 {
        bytes.extend(print(number));
        if number % 100 == 50 {
            bytes.extend(b"Sensor restarted\n");
        }
    }
    let writer = thread::spawn(move || {
        bytes.chunks(101).for_each(|piece| device.write_all(piece).expect("written"));
        device
    });
    let samples = take(&reader, 5000);
    let _device = writer.join().expect("writes");
    let (Report { tally, overwritten, .. }, error) = reader.finish();
    assert!(error.is_none(), "{error:?}");
    assert!(samples.iter().map(|sample| sample.counts).eq((0..5000).map(counts)));
    assert!(samples.windows(2).all(|pair| pair[0].t_s < pair[1].t_s), "times increase");
    assert_eq!((tally.samples, tally.garbage_lines, tally.partial_lines, overwritten), (5000, 50, 1, 0));
}

#[test]
fn robust_an_unplugged_sensor_is_named_and_its_samples_are_kept() {
    let (name, mut device, port) = pair();
    let reader = Reader::open(&name, ReaderSettings::new(hex(), Instant::now())).expect("open");
    (0..10).for_each(|number| device.write_all(&print(number)).expect("written"));
    assert_eq!(take(&reader, 10).len(), 10);
    drop((device, port));
    let mut more = Vec::new();
    while reader.take(&mut more, Duration::from_secs(10)) {}
    let (report, error) = reader.finish();
    assert_eq!(report.tally.samples, 10);
    let error = error.expect("unplugged").to_string();
    assert!(error.starts_with(&name) && error.contains("is the cable plugged in?"), "{error}");
}

#[test]
fn robust_overrun_is_counted_and_reported() {
    let (name, mut device, port) = pair();
    let settings = ReaderSettings { capacity: 100, ..ReaderSettings::new(hex(), Instant::now()) };
    let reader = Reader::open(&name, settings).expect("open");
    (0..250).for_each(|number| device.write_all(&print(number)).expect("written"));
    // The samples are not taken; the reader ends after the pending bytes.
    let mut quiet_since = Instant::now();
    while quiet_since.elapsed() < Duration::from_millis(300) {
        if rustix::io::ioctl_fionread(&port).expect("the number of pending bytes") > 0 {
            quiet_since = Instant::now();
        }
        thread::yield_now();
    }
    let (report, error) = reader.finish();
    assert_eq!(report.tally.samples, 250);
    assert_eq!(report.overwritten, 150);
    assert!(matches!(error, Some(Error::Overrun { lost: 150, .. })), "{error:?}");
}

#[test]
fn robust_a_missing_port_is_named() {
    let error = Reader::open("/dev/none", ReaderSettings::new(hex(), Instant::now())).expect_err("refused");
    assert!(error.to_string().starts_with("/dev/none: cannot be opened: "), "{error}");
}

/// Scripted printer, which records the lines it receives.
fn scripted(device: Device, mut answer: impl FnMut(&str) -> String + Send + 'static) -> JoinHandle<Vec<String>> {
    thread::spawn(move || {
        let mut writer = device.try_clone().expect("cloned");
        let mut received = Vec::new();
        for line in BufReader::new(device).lines().map_while(Result::ok) {
            let bytes = answer(&line);
            received.push(line);
            if writer.write_all(bytes.as_bytes()).is_err() {
                break;
            }
        }
        received
    })
}

fn open(name: &str, stop: &Arc<AtomicBool>) -> Result<Printer, Error> {
    Printer::open(name, Rig::built_in().bed, Instant::now(), stop.clone())
}

/// `ok`, after a position if it was queried.
fn good(line: &str, at: &str) -> String {
    if line.contains("M114") { format!("X:{at} Z:0.00 E:0.00 Count X:{at} Z:0.00\nok\n") } else { "ok\n".into() }
}

#[test]
fn verif_a_line_that_was_damaged_is_sent_again() {
    let (name, device, port) = pair();
    let mut is_damaged = true;
    let received = scripted(device, move |line| {
        if line.contains("G21") && std::mem::take(&mut is_damaged) {
            return "Error:checksum mismatch, Last Line: 0\nResend: 1\nok\n".into();
        }
        good(line, "0.00 Y:0.00")
    });
    let mut printer = open(&name, &Arc::default()).expect("open");
    printer.home().expect("homed");
    drop((printer, port));
    let received = received.join().expect("the script ends");
    let sent = ["N0 M110 N0*125", "N1 G21*27", "N1 G21*27"];
    assert_eq!(received[..3], sent);
    assert!(received[3].starts_with("N2 G90*") && received[4].starts_with("N3 G28 X Y*"), "{received:?}");
}

#[test]
fn robust_a_line_whose_ok_was_lost_is_not_executed_twice() {
    let (name, device, port) = pair();
    let received = scripted(device, move |line| {
        // The request for the next line shows that it accepted this one.
        if line.contains("G21") { "Resend: 2\nok\n".into() } else { good(line, "0.00 Y:0.00") }
    });
    open(&name, &Arc::default()).and_then(|mut printer| printer.home()).expect("homed");
    drop(port);
    assert_eq!(received.join().expect("the script ends").iter().filter(|line| line.contains("G21")).count(), 1);
}

#[test]
fn robust_an_error_of_the_printer_is_quoted() {
    let (name, device, _port) = pair();
    let _received = scripted(device, |line| {
        if line.contains("G28") { "Error:Homing failed\nok\n".into() } else { good(line, "0.00 Y:0.00") }
    });
    let error = open(&name, &Arc::default()).and_then(|mut printer| printer.home()).expect_err("refused");
    assert_eq!(error.to_string(), format!("{name}: `G28 X Y` was answered by `Error:Homing failed`, expected `ok`"));
}

#[test]
fn robust_no_move_before_homing_or_outside_the_bed() {
    let (name, device, port) = pair();
    let received = scripted(device, |line| good(line, "0.00 Y:0.00"));
    let mut printer = open(&name, &Arc::default()).expect("open");
    let mut to =
        |goal_m, speed_m_s| printer.move_to(goal_m, speed_m_s, &mut |_| Ok(())).expect_err("refused").to_string();
    assert!(to([0.1, 0.1], 0.03).contains("before homing"));
    assert!(to([0.251, 0.1], 0.03).starts_with("x of the head: found 251 mm, expected 0 to 250 mm"));
    assert!(to([0.1, -0.001], 0.03).starts_with("y of the head: "));
    assert!(to([0.1, f64::NAN], 0.03).starts_with("y of the head: "));
    assert!(to([0.1, 0.1], 1.0).starts_with("speed of the head: found 60000 mm/min, expected 1000 to 15000 mm/min"));
    drop((printer, port));
    assert!(received.join().expect("the script ends").iter().all(|line| !line.contains("G1")));
}

#[test]
fn robust_a_head_off_its_target_is_an_error() {
    let (name, device, _port) = pair();
    let _received = scripted(device, |line| good(line, "99.00 Y:50.00"));
    let mut printer = open(&name, &Arc::default()).expect("open");
    printer.home().expect("homed");
    let error = printer.move_to([0.1, 0.05], 0.03, &mut |_| Ok(())).expect_err("off its target");
    assert_eq!(
        error.to_string(),
        format!("{name}: the head stands at (99.000, 50.000) mm, expected (100.000, 50.000) mm")
    );
}

#[test]
fn robust_an_interrupt_stops_the_printer_at_once() {
    let (name, device, port) = pair();
    let stop = Arc::new(AtomicBool::new(false));
    let stop_request = stop.clone();
    let received = scripted(device, move |line| {
        if line.contains("G28") {
            stop_request.store(true, Ordering::Relaxed);
            return "echo:busy: processing\n".into();
        }
        good(line, "0.00 Y:0.00")
    });
    let error = open(&name, &stop).and_then(|mut printer| printer.home()).expect_err("interrupted");
    assert!(matches!(error, Error::Interrupted));
    drop(port);
    assert_eq!(received.join().expect("the script ends").last().map(String::as_str), Some("M112"));
}

#[test]
fn robust_an_unplugged_printer_is_named() {
    let (name, mut device, port) = pair();
    let script = thread::spawn(move || {
        let mut line = String::new();
        BufReader::new(device.try_clone().expect("cloned")).read_line(&mut line).expect("a line");
        device.write_all(b"ok\n").expect("written");
        device
    });
    let mut printer = open(&name, &Arc::default()).expect("open");
    drop((script.join().expect("the script ends"), port));
    let error = printer.home().expect_err("unplugged").to_string();
    assert!(error.starts_with(&name) && error.contains("is the cable plugged in?"), "{error}");
}
