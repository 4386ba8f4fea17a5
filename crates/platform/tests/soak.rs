//! The emulated rig for as long as is asked: no sample lost, and what reading costs.
#![cfg(target_os = "linux")]

mod pseudo;

use std::fs;
use std::io::Write;
use std::thread;
use std::time::{Duration, Instant};

use platform::record::{Ending, Log, Sink};
use platform::sensor::{Reader, ReaderSettings, format};
use trace::Watermark;

const RATE_HZ: f64 = 800.0;
/// Processor time of this process without the threads of this name.
fn processor_s(without: &str) -> f64 {
    let tasks = fs::read_dir("/proc/self/task").expect("Linux");
    let nanoseconds = tasks.map(|task| {
        let read = |file| fs::read_to_string(task.as_ref().expect("a task").path().join(file)).unwrap_or_default();
        // The scheduler's own account, in nanoseconds: others count in ticks, between which a short reader hides.
        let on_processor = read("schedstat").split(' ').next().and_then(|text| text.parse::<f64>().ok());
        if read("comm").trim() == without { 0.0 } else { on_processor.unwrap_or(0.0) }
    });
    1e-9 * nanoseconds.sum::<f64>()
}

/// 800 readings a second that count, for `WHISKER_SOAK_S` seconds (60), through a pseudo-terminal into a log. Each must come, once and in order; prints what
/// that costs, and how late samples are taken.
#[test]
#[ignore = "as long as WHISKER_SOAK_S says; run it by name"]
fn verif_no_sample_is_lost() {
    let soak_s: f64 = std::env::var("WHISKER_SOAK_S").map_or(60.0, |text| text.parse().expect("seconds"));
    let (name, mut device, _port) = pseudo::pair();
    let origin = Instant::now();
    let row = format("hex").expect("registered");
    let reader = Reader::open(&name, ReaderSettings::new(row, origin)).expect("open");
    let count = (soak_s * RATE_HZ) as u64;
    let counts = |number: u64| [number as u16, (number >> 16) as u16, !number as u16];
    let writer = thread::Builder::new().name("writer".into());
    let writer = writer.spawn(move || {
        let (printer, mut line) = ((row.build)(), Vec::new());
        let mut sent_s = Vec::with_capacity(count as usize);
        for number in 0..count {
            let early_s = number as f64 / RATE_HZ - origin.elapsed().as_secs_f64();
            thread::sleep(Duration::from_secs_f64(early_s.max(0.0)));
            line.clear();
            printer.print(counts(number), &mut line);
            sent_s.push(origin.elapsed().as_secs_f64());
            device.write_all(&line).expect("written");
        }
        (sent_s, device)
    });
    let writer = writer.expect("a thread");
    let folder = tempfile::tempdir().expect("a folder");
    let watermark =
        Watermark { tool: "soak".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() };
    let mut log = Box::new(Log::create(folder.path(), row.name, RATE_HZ, watermark).expect("a log"));
    let (mut taken_s, mut samples) = (Vec::with_capacity(count as usize), Vec::new());
    let before_s = processor_s("writer");
    while (taken_s.len() as u64) < count && reader.take(&mut samples, Duration::from_secs(10)) {
        let now_s = origin.elapsed().as_secs_f64();
        for sample in &samples {
            assert_eq!(sample.counts, counts(taken_s.len() as u64));
            taken_s.push(now_s);
        }
        log.samples(&samples).expect("kept");
        samples.clear();
    }
    let processor_s = processor_s("writer") - before_s;
    let elapsed_s = origin.elapsed().as_secs_f64();
    let (sent_s, _device) = writer.join().expect("writes");
    let (report, error) = reader.finish();
    assert!(error.is_none(), "{error:?}");
    let files = log.finish(Ending::Complete).expect("written");
    let rows = fs::read_to_string(&files[2]).expect("a table").lines().count() as u64 - 1;
    assert_eq!((report.tally.samples, report.tally.garbage_lines, rows), (count, 0, count));
    let mut late_s: Vec<f64> = taken_s.iter().zip(&sent_s).map(|(taken_s, sent_s)| taken_s - sent_s).collect();
    late_s.sort_by(f64::total_cmp);
    let at = |share: f64| 1e3 * late_s[((late_s.len() - 1) as f64 * share) as usize];
    println!("{report}");
    println!("{:.1} % of one core over {elapsed_s:.0} s", 100.0 * processor_s / elapsed_s);
    println!("from write to taken: median {:.2} ms, 99 % {:.2} ms, worst {:.2} ms", at(0.5), at(0.99), at(1.0));
}
