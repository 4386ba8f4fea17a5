//! Writes a trace of any length by repeating the rows of a short one with continued time stamps, to measure time and
//! memory of long traces.
//!
//! `cargo run --release --example long_trace -- TRACE ROWS FOLDER`

use std::path::Path;
use std::{env, process};

use anyhow::{Context, bail};
use trace::{FurtherColumns, Sidecar, Trace, TraceWriter};

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error:#}");
        process::exit(1);
    }
}

fn run() -> anyhow::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [source, rows, folder] = arguments.as_slice() else { bail!("usage: long_trace TRACE ROWS FOLDER") };
    let rows: usize = rows.parse().with_context(|| format!("ROWS: found `{rows}`, expected a number"))?;
    let Trace { sidecar, recording, truth } = Trace::read(Path::new(source))?;
    let round_s = recording.instants.len() as f64 / sidecar.rate_hz;
    let sidecar = Sidecar { name: "long".into(), contour: None, ..sidecar };
    let mut writer = TraceWriter::create(Path::new(folder), sidecar, FurtherColumns::of(&truth))?;
    for row in 0..rows {
        let (round, at) = (row / recording.instants.len(), row % recording.instants.len());
        let mut known = recording.instants[at];
        known.t_s += round_s * round as f64;
        writer.push(&known, &truth.instants[at])?;
    }
    writer.finish()?;
    Ok(())
}
