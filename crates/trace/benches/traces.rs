//! How fast traces are read and written: the golden pin's rows, over and over until they are those of a minute.

use std::path::Path;

use divan::Bencher;
use divan::counter::BytesCount;
use tempfile::TempDir;
use trace::{Trace, sha256};

/// Rows of a minute at 250 Hz.
const ROWS: usize = 15_000;

fn main() {
    divan::main();
}

/// A long trace.
fn long() -> Trace {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv");
    let mut trace = Trace::read(&golden).expect("the golden trace");
    let count = trace.recording.instants.len();
    let step_s = 1.0 / trace.sidecar.rate_hz;
    for row in count..ROWS {
        let (mut instant, truth) = (trace.recording.instants[row % count], trace.truth.instants[row % count]);
        instant.t_s = row as f64 * step_s;
        trace.recording.instants.push(instant);
        trace.truth.instants.push(truth);
    }
    trace.sidecar.rows = ROWS;
    trace.sidecar.contour = None;
    trace.sidecar.csv_sha256 = sha256(trace.to_csv());
    trace
}

#[divan::bench(max_time = 3)]
fn read(bencher: Bencher) {
    let (folder, trace) = (TempDir::new().expect("a temporary folder"), long());
    let path = trace.write(folder.path()).expect("a folder that can be written");
    let bytes = trace.to_csv().len();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| Trace::read(&path).expect("the trace just written"));
}

#[divan::bench(max_time = 3)]
fn write(bencher: Bencher) {
    let (folder, trace) = (TempDir::new().expect("a temporary folder"), long());
    let bytes = trace.to_csv().len();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| trace.write(folder.path()));
}
