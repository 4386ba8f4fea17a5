//! `whisker live`: contacts from streams of readings and poses, or from recordings played as such.

mod blocked;
mod recording;
mod sink;
mod stream;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use live::{Disturbance, Timing};
use platform::interrupt;

use super::played;
use blocked::Writing;

/// Estimate contacts live, from JSON lines on stdin or from recordings played at their own pace; answers are JSON lines on stdout
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Calibration of the whisker; for several whiskers NAME=CALIBRATION, repeated
    /// [default with --recording: calibrations/<whisker>.json beside the trace]
    #[arg(long, value_name = "[NAME=]CALIBRATION", required_unless_present = "recording")]
    calibration: Vec<String>,
    /// Trace (.csv), or recording of several whiskers (.json), to play instead of reading stdin; may be repeated
    #[arg(long)]
    recording: Vec<PathBuf>,
    /// Speed of recordings relative to their own pace
    #[arg(long, default_value_t = 1.0, value_parser = speed, requires = "recording")]
    speed: f64,
    // Noise, seed and front end are those of recordings.
    #[command(flatten)]
    played: played::Arguments,
    #[command(flatten)]
    timing: TimingArguments,
    #[command(flatten)]
    disturbance: DisturbanceArguments,
}

/// Longest waits and gaps.
#[derive(clap::Args)]
struct TimingArguments {
    /// Longest wait of a reading for its pose (s)
    #[arg(long, default_value_t = Timing::default().wait_s)]
    wait: f64,
    /// Longest wait of a reading for earlier readings that are missing (s)
    #[arg(long, default_value_t = Timing::default().reorder_s)]
    reorder: f64,
    /// Longest time between two poses that are interpolated (s)
    #[arg(long, default_value_t = Timing::default().gap_s)]
    gap: f64,
    /// Step of a clock, relative to this machine's clock, above which it counts as a jump and the estimator restarts (s);
    /// at least three nominal intervals between readings
    #[arg(long, default_value_t = Timing::default().jump_s)]
    jump: f64,
}

/// Disturbances of a played recording.
#[derive(clap::Args)]
struct DisturbanceArguments {
    /// Fraction of messages of a recording that are lost
    #[arg(long, default_value_t = 0.0, requires = "recording")]
    lost: f64,
    /// Longest random delay of the messages of a recording (s)
    #[arg(long, default_value_t = 0.0, requires = "recording")]
    jitter: f64,
    /// Fraction of messages of a recording that arrive after their successor
    #[arg(long, default_value_t = 0.0, requires = "recording")]
    swapped: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let TimingArguments { wait, reorder, gap, jump } = arguments.timing;
    let timing = Timing { wait_s: wait, reorder_s: reorder, gap_s: gap, jump_s: jump };
    timing.validate()?;
    let stop = interrupt::asked()?;
    let writing = Writing::watched(stop.clone())?;
    if !arguments.recording.is_empty() {
        let DisturbanceArguments { lost, jitter, swapped } = arguments.disturbance;
        let disturbance = Disturbance { lost, jitter_s: jitter, swapped };
        disturbance.validate()?;
        return arguments.played.in_file(recording::run(arguments, timing, &disturbance, &stop, writing));
    }
    if arguments.played.is_for_recordings() {
        bail!(
            "--noise or --front-end: found without --recording, expected with it; on stdin, readings are those of a sensor"
        );
    }
    arguments.played.in_file(stream::run(arguments, timing, &stop, writing))
}

/// Name and calibration of an option `[NAME=]CALIBRATION`.
fn named(option: &str) -> (Option<&str>, PathBuf) {
    match option.split_once('=') {
        Some((name, path)) => (Some(name), path.into()),
        None => (None, option.into()),
    }
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number, for example 2".into()),
    }
}
