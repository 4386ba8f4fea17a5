//! `ros2-node run`: live streams and the service of the platform.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context;
use bag::messages::{MagneticFieldArray, PoseStamped, TfMessage};
use bag::topics;
use platform::calibration::{Calibration, Live};
use platform::inference::Inference;
use platform::interrupt;
use platform::printer::{Head, Printer};
use platform::rig::Rig;
use platform::routine::{Contact, IncrementsBeamTest, Observer, Overload};
use platform::sensor::{Reader, ReaderSettings};
use platform::streams::{PUSHED, Streams};

#[cfg(feature = "foxglove")]
use crate::feed::Foxglove;
use crate::node::{Network, Node};
use crate::outlet::{Desk, Outlet};
use crate::request::Request;
use crate::service::{Middleware, Service, Stops};

/// Stream the magnetometer and offer the services increments_beam_test, which runs the routine on the printer, and stop
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Port of the printer
    #[arg(long)]
    printer: String,
    /// Port of the magnetometer
    #[arg(long)]
    sensor: String,
    /// Line format of the magnetometer; `whisker platform list` names the formats
    #[arg(long, default_value = "hex")]
    format: String,
    /// Calibration, written by `whisker platform fit`, with which contacts are estimated and published as well
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Duration of the readings in one message, in seconds; 0 for one message per reading
    #[arg(long, default_value_t = 0.1, value_parser = batch_s)]
    batch: f64,
    /// Speed of the head in millimetres per minute [default: the rig's]
    #[arg(long)]
    speed: Option<f64>,
    /// Geometry of the rig, such as rigs/openwhisker.json [default: that one, which is built in]
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Allow pushes that strain the whisker beyond its limit or exceed its length
    #[arg(long)]
    allow_overload: bool,
    /// ROS 2 middleware of the service's caller
    #[arg(long, value_enum, default_value = "fastrtps")]
    middleware: Middleware,
    #[command(flatten)]
    network: Network,
    #[cfg(feature = "foxglove")]
    #[command(flatten)]
    foxglove: Foxglove,
}

/// Longest wait for samples.
const PATIENCE: Duration = Duration::from_millis(50);

type Shared<O> = Mutex<Streams<O>>;

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let stop = interrupt::asked()?;
    #[cfg(feature = "foxglove")]
    if let Some(address) = arguments.foxglove.address {
        let (feed, calls) = arguments.foxglove.platform(address, stop.clone())?;
        return serve(arguments, feed, &calls, || {}, &stop);
    }
    let mut node = Node::new(&arguments.network)?;
    let service = Service::new(&mut node, arguments.middleware)?;
    let stops = Stops::new(&mut node, arguments.middleware)?;
    eprintln!(
        "warning: {}: everyone who reaches it reads the sensor and moves the printer with {}; confine it with \
        --localhost-only, --interface, ROS_DOMAIN_ID or a firewall",
        arguments.network,
        topics::BEAM_TEST
    );
    serve(arguments, node, &service, || stops.serve(&stop), &stop)
}

/// Streams to an outlet and runs the routine for each call, one after the other, until `stop` is set: by an interrupt,
/// or by `stops`, which runs meanwhile.
fn serve(
    arguments: &Arguments,
    mut outlet: impl Outlet,
    desk: &impl Desk,
    stops: impl FnOnce() + Send,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let rig = arguments.rig.as_deref().map_or_else(|| Ok(Rig::built_in()), Rig::read)?;
    let overload = if arguments.allow_overload { Overload::Allowed } else { Overload::Refused };
    let speed_m_s = arguments.speed.map_or(rig.speed_m_s(), |speed| speed / 60e3);
    let calibration = arguments.calibration.as_deref().map(calibration).transpose()?;
    let calibrated = calibration.as_ref().zip(arguments.calibration.as_deref());
    let inference = calibrated.map(|(calibration, path)| inference(calibration, path)).transpose()?;
    let format = platform::sensor::format(&arguments.format)
        .with_context(|| format!("unknown line format `{}`; `whisker platform list` names them", arguments.format))?;
    // Subscribers find the topics before the first push.
    outlet.announce::<MagneticFieldArray>(topics::MAGNETOMETER)?;
    outlet.announce::<TfMessage>(topics::TF_STATIC)?;
    outlet.announce::<TfMessage>(topics::TF)?;
    outlet.announce::<PoseStamped>(PUSHED)?;
    outlet.announce::<PoseStamped>(topics::DETECTED_CONTACT)?;
    let origin = Instant::now();
    let epoch_ns = u64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos())?;
    let mut printer = Printer::open(&arguments.printer, rig.bed, origin, stop.clone())?;
    let reader = Reader::open(&arguments.sensor, ReaderSettings::new(format, origin))?;
    let streams = Mutex::new(Streams::new(outlet, epoch_ns, arguments.batch));
    println!("ready");
    thread::scope(|scope| {
        scope.spawn(stops);
        let sensor = scope.spawn(|| {
            let done = stream(reader, inference, &streams, stop);
            // Without a sensor there is nothing to serve.
            stop.store(true, Ordering::Relaxed);
            done
        });
        let mut routine = |request| {
            let routine = routine(request, speed_m_s);
            Ok(routine.on(&rig, overload)?.run(&mut printer, origin, stop, &mut Published(&streams))?)
        };
        let mut served = Ok(());
        while served.is_ok() && !stop.load(Ordering::Relaxed) {
            served = desk.serve_next(&mut routine);
        }
        stop.store(true, Ordering::Relaxed);
        sensor.join().expect("the sensor's thread does not panic")?;
        served
    })
}

/// Reads a calibration, with a note on stderr if it has no coefficients and was fitted again.
fn calibration(path: &Path) -> anyhow::Result<Calibration> {
    let calibration = Calibration::read(path)?;
    if calibration.was_fitted_on_reading() {
        let path = path.display();
        eprintln!(
            "note: {path}: has no coefficients and was fitted again; `whisker platform fit` on its logs stores them"
        );
    }
    Ok(calibration)
}

/// Inference on a stream of samples; the path is for the error.
fn inference<'a>(calibration: &'a Calibration, path: &Path) -> anyhow::Result<Inference<'a>> {
    let expected =
        || format!("{}: chain: found null, expected that of a calibration from logs of samples", path.display());
    Ok(Inference::new(Live::new(calibration)?.with_context(expected)?))
}

/// The routine that a request specifies.
fn routine(request: Request, speed_m_s: f64) -> IncrementsBeamTest {
    IncrementsBeamTest {
        total_x_m: 1e-3 * f64::from(request.total_x_distance),
        total_y_m: 1e-3 * f64::from(request.total_y_distance),
        increments_x: request.increments_x,
        increments_y: request.increments_y,
        pause: Duration::from_secs(request.pause_sec.into()),
        speed_m_s,
    }
}

/// Publishes readings, and contacts detected in them, until `stop` is set.
fn stream<O: Outlet>(
    reader: Reader,
    mut inference: Option<Inference<'_>>,
    streams: &Shared<O>,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let (mut arrivals, mut samples) = (Vec::new(), Vec::new());
    while reader.take(&mut arrivals, PATIENCE) {
        samples.extend(arrivals.iter().map(|arrival| arrival.sample));
        let mut streams = locked(streams);
        if let Some(inference) = &mut inference {
            arrivals.iter().try_for_each(|arrival| {
                inference.step(arrival, |detection| streams.detected(detection)).unwrap_or(Ok(()))
            })?;
        }
        streams.samples(&samples)?;
        arrivals.clear();
        samples.clear();
        if stop.load(Ordering::Relaxed) {
            reader.end();
        }
    }
    let (report, error) = reader.finish();
    eprintln!("{report}");
    error.map_or(Ok(()), |error| Err(error.into()))
}

/// Observer that publishes positions of the head and pushes.
struct Published<'a, O>(&'a Shared<O>);

impl<O: Outlet> Observer for Published<'_, O> {
    fn head(&mut self, head: Head) -> Result<(), platform::Error> {
        Ok(locked(self.0).head(head)?)
    }

    fn contact(&mut self, contact: Contact) -> Result<(), platform::Error> {
        Ok(locked(self.0).pushed(&contact)?)
    }
}

fn locked<O>(streams: &Shared<O>) -> MutexGuard<'_, Streams<O>> {
    streams.lock().unwrap_or_else(PoisonError::into_inner)
}

fn batch_s(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=10.0).contains(&value) => Ok(value),
        _ => Err("expected seconds, 0 to 10, for example 0.1".into()),
    }
}
