//! Throughput of reading (with all checks) and writing traces.

use std::path::Path;

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use files::sha256;
use tempfile::TempDir;
use trace::{Trace, TraceRows};

/// Number of rows, about 10 MB of text.
const ROWS: usize = 60_000;

fn main() {
    divan::main();
}

/// Trace that repeats a golden one, and the size of its text.
fn long() -> (Trace, BytesCount) {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv");
    let mut trace = Trace::read(&golden).expect("the golden trace is sound");
    let count = trace.recording.instants.len();
    let step_s = 1.0 / trace.sidecar.rate_hz;
    for row in count..ROWS {
        let (mut instant, truth) = (trace.recording.instants[row % count], trace.truth.instants[row % count]);
        instant.t_s = row as f64 * step_s;
        trace.recording.instants.push(instant);
        trace.truth.instants.push(truth);
    }
    let text = trace.to_csv();
    (trace.sidecar.name, trace.sidecar.rows, trace.sidecar.contour) = ("long".into(), ROWS, None);
    trace.sidecar.csv_sha256 = sha256(&text);
    (trace, BytesCount::of_str(&text))
}

/// Reading into memory.
#[divan::bench]
fn read(bencher: Bencher) {
    let (folder, (trace, bytes)) = (TempDir::new().expect("a temporary folder"), long());
    let path = trace.write(folder.path()).expect("the folder can be written");
    bencher.counter(bytes).bench_local(|| Trace::read(black_box(&path)).expect("it is sound"));
}

/// Streaming reading.
#[divan::bench]
fn read_rows(bencher: Bencher) {
    let (folder, (trace, bytes)) = (TempDir::new().expect("a temporary folder"), long());
    let path = trace.write(folder.path()).expect("the folder can be written");
    bencher.counter(bytes).bench_local(|| {
        let (_, rows) = TraceRows::open(black_box(&path)).expect("it is sound");
        rows.map(|row| row.expect("it is sound").0.moment_z_n_m).fold(0.0, f64::max)
    });
}

/// Formatting as text.
#[divan::bench]
fn text(bencher: Bencher) {
    let (trace, bytes) = long();
    bencher.counter(bytes).bench_local(|| black_box(&trace).to_csv());
}

/// Formatting, hashing and writing to disk.
#[divan::bench]
fn write(bencher: Bencher) {
    let (folder, (trace, bytes)) = (TempDir::new().expect("a temporary folder"), long());
    bencher.counter(bytes).bench_local(|| black_box(&trace).write(folder.path()).expect("the folder can be written"));
}
