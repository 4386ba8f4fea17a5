//! Soak test on the emulated rig: lost samples, processor load and latency.
#![cfg(target_os = "linux")]

mod pseudo;

use std::fs;
use std::io::Write;
use std::thread;
use std::time::{Duration, Instant};

use bag::messages::MagneticFieldArray;
use bag::topics;
use files::Watermark;
use platform::Sample;
use platform::calibration::regression::regression;
use platform::calibration::{Calibration, Detection, HoldOut, LabelledPress, Live, Presses, Settings, learn};
use platform::emulate::RigTable;
use platform::inference::Inference;
use platform::record::{Ending, LogSidecar, Sink};
use platform::sensor::{Reader, ReaderSettings, format};
use platform::streams::Bag;

const RATE_HZ: f64 = 800.0;
/// Bounds: share of one core, and 99th-percentile latency from the device's write to the report.
const MAX_PROCESSOR: f64 = 0.1;
const MAX_LATENCY: Duration = Duration::from_millis(5);

/// Samples per press, distances of the presses, and speed and depth of the pushes.
const PERIOD: u64 = 2400;
const PLACES: u64 = 16;
const SPEED_M_S: f64 = 2.0 / 60.0;
const DEPTH_M: f64 = 0.006;

/// Distance of the press at this sample (m).
fn distance_m(number: u64) -> f64 {
    0.145 - 0.1 * (number / PERIOD % PLACES) as f64 / (PLACES - 1) as f64
}

/// Counts of a sample: presses of the rig's physics on the main axis, its number on the others.
fn counts(rig: &RigTable, number: u64) -> [u16; 3] {
    // Half of the time before the push and half after it.
    let since_s = (number % PERIOD) as f64 / RATE_HZ - 0.5 * PERIOD as f64 / RATE_HZ;
    let push_m = (DEPTH_M - SPEED_M_S * since_s.abs()).max(0.0);
    let main = rig.deflection_counts(distance_m(number), push_m).expect("touches")[1];
    [(number >> 16) as u16, main.round() as i64 as u16, number as u16]
}

fn watermark() -> Watermark {
    Watermark { tool: "soak".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() }
}

/// Calibration fitted to one press at each distance.
fn calibration(rig: &RigTable) -> Calibration {
    let sample = |number: u64| Sample { t_s: number as f64 / RATE_HZ, counts: counts(rig, number) };
    let samples: Vec<Sample> = (0..PERIOD * PLACES).map(sample).collect();
    let chain = learn(&[("rig", &samples)], &Settings::default()).expect("a chain");
    let labelled = |press: platform::calibration::Press| LabelledPress {
        log: "rig".into(),
        onset_s: Some(press.onset_s),
        features: press.features,
        distance_m: distance_m((press.onset_s * RATE_HZ) as u64),
    };
    let presses = Presses::new(&chain).expect("a low-pass").of(&samples).into_iter().map(labelled).collect();
    let row = regression("robust").expect("registered");
    Calibration::fit(row, presses, Some(chain), HoldOut::Press, 0.9, watermark()).expect("fits")
}

/// Processor time of this process without the threads of this name (s).
fn processor_s(without: &str) -> f64 {
    let tasks = fs::read_dir("/proc/self/task").expect("Linux");
    let nanoseconds = tasks.map(|task| {
        let read = |file| fs::read_to_string(task.as_ref().expect("a task").path().join(file)).unwrap_or_default();
        // The scheduler's statistics in nanoseconds: accounting by ticks misses short runs.
        let on_processor = read("schedstat").split(' ').next().and_then(|text| text.parse::<f64>().ok());
        if read("comm").trim() == without { 0.0 } else { on_processor.unwrap_or(0.0) }
    });
    1e-9 * nanoseconds.sum::<f64>()
}

/// 800 readings per second for `WHISKER_SOAK_S` seconds (default 60), through a pseudo-terminal into a recording, with
/// live inference. Each must arrive once and in order, no press may be missed, and the bounds of processor load and
/// latency must be met.
#[test]
#[ignore = "takes WHISKER_SOAK_S seconds; run it by name"]
fn verif_no_sample_is_lost_and_none_is_late() {
    let soak_s: f64 = std::env::var("WHISKER_SOAK_S").map_or(60.0, |text| text.parse().expect("seconds"));
    let rig = RigTable::built_in();
    let calibration = calibration(&rig);
    let mut inference = Inference::new(Live::new(&calibration).expect("a low-pass").expect("a chain"));
    let count = (soak_s * RATE_HZ) as u64;
    let all: Vec<[u16; 3]> = (0..count).map(|number| counts(&rig, number)).collect();
    let (name, mut device, _port) = pseudo::pair();
    let origin = Instant::now();
    let row = format("hex").expect("registered");
    let reader = Reader::open(&name, ReaderSettings::new(row, origin)).expect("open");
    let writer = thread::Builder::new().name("writer".into());
    let printed = all.clone();
    let writer = writer.spawn(move || {
        let (printer, mut line) = ((row.build)(), Vec::new());
        let mut sent = Vec::with_capacity(printed.len());
        for (number, counts) in printed.into_iter().enumerate() {
            let early_s = number as f64 / RATE_HZ - origin.elapsed().as_secs_f64();
            thread::sleep(Duration::from_secs_f64(early_s.max(0.0)));
            line.clear();
            printer.print(counts, &mut line);
            sent.push(Instant::now());
            device.write_all(&line).expect("written");
        }
        (sent, device)
    });
    let writer = writer.expect("a thread");
    let folder = tempfile::tempdir().expect("a folder");
    let sidecar = LogSidecar::new(row.name, RATE_HZ, watermark());
    let mut bag = Box::new(Bag::create(&folder.path().join("soak"), sidecar).expect("a recording"));
    let (mut reported, mut arrivals, mut errors_m) = (Vec::with_capacity(all.len()), Vec::new(), Vec::new());
    let before_s = processor_s("writer");
    while reported.len() < all.len() && reader.take(&mut arrivals, Duration::from_secs(10)) {
        for arrival in &arrivals {
            assert_eq!(arrival.sample.counts, all[reported.len()]);
            inference.step(arrival, |detection| {
                if let Detection::Pressed(_, estimate) = detection {
                    let found_m = estimate.expect("within the calibrated domain").distance_m;
                    errors_m.push(found_m - distance_m(reported.len() as u64));
                }
                bag.detected(detection).expect("kept");
            });
            reported.push(Instant::now());
        }
        let samples: Vec<Sample> = arrivals.drain(..).map(|arrival| arrival.sample).collect();
        bag.samples(&samples).expect("kept");
    }
    let processor = (processor_s("writer") - before_s) / origin.elapsed().as_secs_f64();
    let (sent, _device) = writer.join().expect("writes");
    let (report, error) = reader.finish();
    assert!(error.is_none(), "{error:?}");
    let recording = bag.finish(Ending::Complete).expect("written").remove(0);
    let mut latencies: Vec<Duration> =
        reported.iter().zip(&sent).map(|(reported, sent)| reported.duration_since(*sent)).collect();
    latencies.sort();
    let at = |share: f64| latencies[((latencies.len() - 1) as f64 * share) as usize];
    println!("{report}");
    println!("{}", inference.latency());
    println!("latency from write to report: median {:.3?}, 99 % {:.3?}, worst {:.3?}", at(0.5), at(0.99), at(1.0));
    println!("{:.1} % of one core", 100.0 * processor);

    let kept: Vec<[u16; 3]> = bag::Reader::open(&recording)
        .expect("a recording")
        .records()
        .map(|record| record.expect("whole"))
        .filter(|record| record.topic == topics::MAGNETOMETER)
        .flat_map(|record| record.decode::<MagneticFieldArray>().expect("readings").magnetic_field_array)
        .map(|reading| [reading.magnetic_field.x, reading.magnetic_field.y, reading.magnetic_field.z])
        .map(|field| field.map(|counts| counts as u16))
        .collect();
    assert!(kept == all, "{} of {count} samples are in the recording", kept.len());
    assert_eq!((report.tally.samples, report.tally.garbage_lines, report.overwritten), (count, 0, 0));
    // The last press may be incomplete.
    assert!(errors_m.len() as u64 >= count / PERIOD, "{} presses", errors_m.len());
    assert!(errors_m.iter().all(|error_m| error_m.abs() < 2e-3), "{errors_m:?}");
    assert!(processor < MAX_PROCESSOR, "{processor} of one core");
    assert!(at(0.99) < MAX_LATENCY, "{:?}", at(0.99));
}
