//! How fast traces are read, with every check, and written.

use std::path::{Path, PathBuf};
use std::{env, fs};

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use trace::{Trace, TraceRows, TraceWriter};

/// Rows of the trace that is read: some ten megabytes.
const ROWS: usize = 60_000;

fn main() {
    divan::main();
}

/// A trace that repeats a golden one, and its size.
fn long() -> (PathBuf, u64) {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv");
    let Trace { mut sidecar, recording, truth } = Trace::read(&golden).expect("the golden trace is sound");
    sidecar.name = "long".into();
    let folder = env::temp_dir().join("whisker-bench-reading");
    let mut writer = TraceWriter::create(&folder, sidecar).expect("the temporary folder can be written");
    for row in 0..ROWS {
        let at = row % recording.instants.len();
        let mut known = recording.instants[at];
        known.t_s = row as f64 / 250.0;
        writer.push(&known, &truth.instants[at]).expect("the temporary folder can be written");
    }
    let path = writer.finish().expect("the temporary folder can be written");
    let bytes = fs::metadata(&path).expect("it was just written").len();
    (path, bytes)
}

/// Into memory.
#[divan::bench]
fn whole(bencher: Bencher) {
    let (path, bytes) = long();
    bencher.counter(BytesCount::new(bytes)).bench(|| Trace::read(black_box(&path)).expect("it is sound"));
}

/// Row by row.
#[divan::bench]
fn rows(bencher: Bencher) {
    let (path, bytes) = long();
    bencher.counter(BytesCount::new(bytes)).bench(|| {
        let (_, rows) = TraceRows::open(black_box(&path)).expect("it is sound");
        rows.map(|row| row.expect("it is sound").0.moment_z_n_m).fold(0.0, f64::max)
    });
}

/// To text.
#[divan::bench]
fn text(bencher: Bencher) {
    let (path, bytes) = long();
    let trace = Trace::read(&path).expect("it is sound");
    bencher.counter(BytesCount::new(bytes)).bench(|| black_box(&trace).to_csv());
}
