//! `whisker platform run`: records a session of the routine.

use std::path::PathBuf;
use std::process::ExitCode;
use std::slice;
use std::time::{Duration, Instant};

use platform::interrupt;
use platform::printer::Printer;
use platform::record::{Log, LogSidecar, Sink};
use platform::routine::{IncrementsBeamTest, Overload};
use platform::sensor::{Reader, ReaderSettings};
use platform::session;
use platform::streams::Bag;
use testbed::provenance::watermark;

use super::events::{Events, Form};
use super::{calibration, format, inference, rate_hz, report, rig};
use crate::commands::output::check_apart;
use crate::commands::{diagnose, print};

/// Run the routine increments_beam_test and record it; an interrupt stops the printer at once
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Port of the printer
    #[arg(long)]
    printer: String,
    /// Port of the magnetometer
    #[arg(long)]
    sensor: String,
    /// Line format of the magnetometer; `whisker platform list` names the formats
    #[arg(long, default_value = "hex")]
    format: String,
    /// Nominal rate of the magnetometer in readings per second [default: the format's]
    #[arg(long, value_parser = rate_hz)]
    rate_hz: Option<f64>,
    /// Depth of a push in millimetres
    #[arg(long, default_value_t = 6.0)]
    x: f64,
    /// Distance from the first place to the last in millimetres
    #[arg(long, default_value_t = 100.0)]
    y: f64,
    /// Number of stops of a push before its end
    #[arg(long, default_value_t = 0)]
    increments_x: u32,
    /// Number of steps from the first place to the last
    #[arg(long, default_value_t = 15)]
    increments_y: u32,
    /// Pause at each stop in seconds
    #[arg(long, default_value_t = 0)]
    pause: u32,
    /// Speed of the head in millimetres per minute [default: the rig's]
    #[arg(long)]
    speed: Option<f64>,
    /// Geometry of the rig, such as rigs/openwhisker.json [default: that one, which is built in]
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Allow pushes that strain the whisker beyond its limit or exceed its length
    #[arg(long)]
    allow_overload: bool,
    /// Folder for log.csv, log.json and head.csv; it must not contain a log
    #[arg(long)]
    out: PathBuf,
    /// Rosbag2 folder to record the session into as well
    #[arg(long)]
    bag: Option<PathBuf>,
    /// Calibration, written by `whisker platform fit`, with which contacts are estimated and printed live, and their
    /// errors at the end
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Format of the printed contacts
    #[arg(long, value_enum, default_value_t = Form::Json, requires = "calibration")]
    print: Form,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let format = format(&arguments.format)?;
    let rig = rig(arguments.rig.as_deref())?;
    let routine = IncrementsBeamTest {
        total_x_m: 1e-3 * arguments.x,
        total_y_m: 1e-3 * arguments.y,
        increments_x: arguments.increments_x,
        increments_y: arguments.increments_y,
        pause: Duration::from_secs(arguments.pause.into()),
        speed_m_s: arguments.speed.map_or(rig.speed_m_s(), |speed| speed / 60e3),
    };
    let overload = if arguments.allow_overload { Overload::Allowed } else { Overload::Refused };
    let plan = routine.on(&rig, overload)?;
    Log::check_is_free(&arguments.out)?;
    check_apart(&arguments.out, arguments.calibration.as_slice())?;
    if let Some(bag) = &arguments.bag {
        check_apart(bag, &[slice::from_ref(&arguments.out), arguments.calibration.as_slice()].concat())?;
    }
    let calibration = arguments.calibration.as_deref().map(calibration).transpose()?;
    let calibrated = calibration.as_ref().zip(arguments.calibration.as_deref());
    let inference = calibrated.map(|(calibration, path)| inference(calibration, path)).transpose()?;
    let stop = interrupt::asked()?;
    let origin = Instant::now();
    let mut settings = ReaderSettings::new(format, origin);
    settings.rate_hz = arguments.rate_hz.unwrap_or(format.rate_hz);
    let mut printer = Printer::open(&arguments.printer, rig.bed, origin, stop)?;
    let reader = Reader::open(&arguments.sensor, settings)?;
    let described = format!("{routine:?} {rig:?}");
    let sidecar = LogSidecar::new(format.name, settings.rate_hz, watermark([described.as_str(), format.name]));
    let bag = arguments.bag.as_deref().map(|folder| Bag::create(folder, sidecar.clone())).transpose()?;
    let mut sinks: Vec<Box<dyn Sink>> = Vec::new();
    if inference.is_some() {
        // The first sink: printing must not wait for the files.
        sinks.push(Box::new(Events::begin(arguments.print)?));
    }
    sinks.push(Box::new(Log::create(&arguments.out, sidecar)?));
    if let Some(bag) = bag {
        sinks.push(Box::new(bag));
    }
    let outcome = session::run(&plan, &mut printer, reader, inference, sinks, origin);
    report(&outcome.report, calibration.as_ref());
    if let Some(latency) = &outcome.latency {
        diagnose(&latency.to_string());
    }
    for path in &outcome.files {
        // If events are printed, the standard output contains only them.
        match outcome.latency {
            None => print(&format!("{}\n", path.display()))?,
            Some(_) => diagnose(&path.display().to_string()),
        }
    }
    match outcome.error {
        Some(error) => Err(error.into()),
        None => Ok(ExitCode::SUCCESS),
    }
}
