//! `whisker platform infer`: distances from a stream of samples.

use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::bail;
use platform::calibration::logs::LogReader;
use platform::calibration::{Calibration, Intervals, Rate};
use platform::inference::{Inference, Latency};
use platform::interrupt;
use platform::sensor::{Arrival, Reader, ReaderSettings};

use super::events::{Events, Form};
use super::{calibration, format, inference, rate_hz, report, warn_of_rate};
use crate::commands::diagnose;

/// Longest wait for samples, and so the delay of an interrupt.
const PATIENCE: Duration = Duration::from_millis(50);

/// Estimate radial contact distances from a log or live from a magnetometer
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Calibration, written by `whisker platform fit`
    #[arg(long)]
    calibration: PathBuf,
    /// Log of samples, or - for stdin
    #[arg(required_unless_present = "port", conflicts_with = "port")]
    log: Option<PathBuf>,
    /// Port of the magnetometer; it is read until an interrupt or until it is unplugged
    #[arg(long)]
    port: Option<String>,
    /// Line format of the magnetometer; `whisker platform list` names the formats
    #[arg(long, default_value = "hex", conflicts_with = "log")]
    format: String,
    /// Nominal rate of the magnetometer in readings per second [default: the calibration's]
    #[arg(long, value_parser = rate_hz, conflicts_with = "log")]
    rate_hz: Option<f64>,
    /// Format of events
    #[arg(long, value_enum, default_value_t = Form::Json)]
    print: Form,
    /// Print the latency of the samples to stderr at the end
    #[arg(long)]
    latency: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let calibration = calibration(&arguments.calibration)?;
    let inference = inference(&calibration, &arguments.calibration)?;
    let (latency, error) = match &arguments.port {
        Some(port) => from_port(port, inference, &calibration, arguments)?,
        None => {
            let log = arguments.log.as_deref().expect("the arguments have one of the two");
            (from_log(log, inference, &calibration, arguments.print)?, None)
        }
    };
    if arguments.latency {
        diagnose(&latency.to_string());
    }
    error.map_or(Ok(ExitCode::SUCCESS), |error| Err(error.into()))
}

/// Processes the samples of a port until an interrupt or an error of the port. Returns the latency and the error of the port.
fn from_port(
    port: &str,
    mut inference: Inference<'_>,
    calibration: &Calibration,
    arguments: &Arguments,
) -> anyhow::Result<(Latency, Option<platform::Error>)> {
    let mut settings = ReaderSettings::new(format(&arguments.format)?, Instant::now());
    let chain_hz = calibration.chain().map(|chain| chain.rate_hz);
    settings.rate_hz = arguments.rate_hz.or(chain_hz).unwrap_or(settings.rate_hz);
    let stop = interrupt::asked()?;
    let reader = Reader::open(port, settings)?;
    let mut events = Events::begin(arguments.print)?;
    let mut arrivals = Vec::new();
    while reader.take(&mut arrivals, PATIENCE) {
        for arrival in arrivals.drain(..) {
            inference.step(&arrival, |detection| events.report(detection)).transpose()?;
        }
        if stop.load(Ordering::Relaxed) {
            reader.end();
        }
    }
    let (read, error) = reader.finish();
    report(&read, Some(calibration));
    Ok((inference.latency(), error))
}

/// Processes the samples of a log, each of which arrives when it is read.
fn from_log(
    log: &Path,
    mut inference: Inference<'_>,
    calibration: &Calibration,
    form: Form,
) -> anyhow::Result<Latency> {
    let mut reader = if log == Path::new("-") {
        LogReader::new(Path::new("stdin"), BufReader::new(io::stdin()))
    } else {
        LogReader::open(log)?
    };
    let (mut events, mut rate, mut intervals) = (Events::begin(form)?, Rate::default(), Intervals::default());
    for sample in reader.by_ref() {
        let arrival = Arrival { sample: sample?, at: Instant::now() };
        rate.step(arrival.sample.t_s);
        if intervals.step(arrival.sample.t_s) {
            check_unit(log, &intervals, calibration)?;
        }
        inference.step(&arrival, |detection| events.report(detection)).transpose()?;
    }
    if reader.cut_off() {
        diagnose(&format!("{}: skipped the incomplete last line", log.display()));
    }
    check_unit(log, &intervals, calibration)?;
    if rate.hz().is_finite() {
        warn_of_rate(rate.hz(), calibration);
    }
    Ok(inference.latency())
}

/// Checks that the times of a log are in seconds.
fn check_unit(log: &Path, intervals: &Intervals, calibration: &Calibration) -> anyhow::Result<()> {
    let Some(rate_hz) = calibration.chain().map(|chain| chain.rate_hz) else { return Ok(()) };
    if let Some((interval_s, hint)) = intervals.misread(rate_hz) {
        let expected_s = 1.0 / rate_hz;
        bail!(
            "{}: times: found a sample every {interval_s} s, expected one every {expected_s:.6} s as in the calibration{hint}",
            log.display()
        );
    }
    Ok(())
}
