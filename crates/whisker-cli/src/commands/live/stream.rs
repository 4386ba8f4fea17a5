//! JSON lines on stdin. Each whisker has a thread of its own, so that a new touch, whose first step takes long, delays no other.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use live::counts::{self, BendingCounts, Conversion, Counts, MODULI, Reading, Sensor, ZEROING_S, ZEROINGS_S};
use live::wire::{self, BadLine, Given, Line, PriorLine, SampleLine, SpatialGiven, SpatialPriorLine, Written};
use live::{
    Answer, Counters, Kind, LiveEstimator, Motion, Output, Planar, Poses, Spatial, SpatialPoses, Status, Timing,
    check_noise, noise_n_m,
};
use nalgebra::Vector2;
use serde_json::{Value, json};
use strict_json::{one_line, shown_number};
use testbed::fitted_traces::above_calibrations;
use testbed::protocol::PROTOCOL;
use testbed::protocol::space::SPATIAL_PROTOCOL;
use testbed::replay::{method, read_by};
use testbed::space;
use trace::{BendingSensor, CalibrationFile, RATES_HZ, SensorFile, SpatialCalibrationFile, is_spatial};
use whisker::estimators::{Estimator, EstimatorRow, Knowledge, MethodClass, Runner};
use whisker::events::TouchConfig;
use whisker::space::estimators::{Knowledge as SpatialKnowledge, SpatialEstimatorRow};
use whisker::space::sensor::CalibratedSpace;

use super::blocked::Writing;
use super::sink::{Sink, ZEROING};
use super::{Arguments, named};
use crate::commands::played::{InSpace, read_calibration};

/// Longest line in bytes: the first line of an evaluation contains tables of the sensor model.
const LONGEST_LINE: u64 = 1 << 23;

/// Lines that are read ahead.
const AHEAD: usize = 1 << 12;

/// Longest wait for a line, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// Longest wait of a whisker without a waiting reading.
const IDLE: Duration = Duration::from_secs(1);

/// A line and its arrival.
struct Arrival {
    /// Bytes without the line end. An error if it is too long.
    line: Result<Vec<u8>, io::Error>,
    at: Instant,
}

/// Estimators of the plane or of space, and their lines.
trait Method: 'static {
    type Kind: Kind;
    type Motion: Motion<Measured = <Self::Kind as Kind>::Base, Base = <Self::Kind as Kind>::Base> + 'static;
    type Prior;
    type Calibration;
    /// A reading as a line gives it.
    type Given;
    /// Conversion of the readings of a whisker.
    type Conversion;

    /// Version of the protocol.
    const PROTOCOL: u32;

    /// Reads a calibration.
    fn read(path: &Path) -> anyhow::Result<Self::Calibration>;

    /// Parses a line.
    fn parse(line: &str) -> Result<LineOf<Self>, BadLine>;

    /// Name of the whisker in its first line.
    fn name(prior: &Self::Prior) -> Option<&str>;

    /// The estimator of a whisker, and the conversion of its readings.
    fn begin(
        &self,
        calibration: &Self::Calibration,
        path: &Path,
        prior: &Self::Prior,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>>;

    /// Converts a reading of the time `t_s` that arrives at `at_s`.
    ///
    /// # Errors
    /// The text found and the text expected, if it cannot be converted.
    fn convert(
        conversion: &mut Self::Conversion,
        t_s: f64,
        given: Self::Given,
        at_s: f64,
    ) -> Result<Taken<<Self::Kind as Kind>::Reading>, String>;

    /// Number of times that the zeroing of counts was repeated, see [`Conversion::zeroings_repeated`].
    fn zeroings_repeated(conversion: &Self::Conversion) -> u64;
}

/// A line, and a later one, of a method.
type LineOf<T> = Line<<T as Method>::Prior, <T as Method>::Given, <<T as Method>::Kind as Kind>::Base>;
type SampleOf<T> = SampleLine<<T as Method>::Given, <<T as Method>::Kind as Kind>::Base>;

/// Estimator of a whisker, and the conversion of its readings.
type Begun<T> = (LiveEstimator<<T as Method>::Motion, <T as Method>::Kind>, <T as Method>::Conversion);

/// A reading that has been converted.
enum Taken<R> {
    /// For the estimator.
    Reading(R),
    /// Left out, with its status.
    LeftOut(&'static str),
}

/// A converted reading, a pose, or both, with their time and arrival.
struct Sample<K: Kind> {
    t_s: f64,
    reading: Option<Taken<K::Reading>>,
    base: Option<K::Base>,
    at_s: f64,
}

/// A whisker of the options, and its thread once its first line has arrived.
struct Whisker<T: Method> {
    name: Option<String>,
    path: PathBuf,
    /// Shared by all whiskers with this path.
    calibration: Arc<T::Calibration>,
    worker: Option<Worker<T>>,
}

/// Conversion of the readings of a whisker, and the thread that runs its estimator.
struct Worker<T: Method> {
    conversion: T::Conversion,
    samples: SyncSender<Sample<T::Kind>>,
    thread: JoinHandle<anyhow::Result<Counters>>,
}

/// Whiskers with one estimator.
struct Session<T: Method> {
    whiskers: Vec<Whisker<T>>,
    method: T,
    timing: Timing,
    sink: Arc<Mutex<Sink>>,
    origin: Instant,
    lines: u64,
}

pub(super) fn run(
    arguments: &Arguments,
    timing: Timing,
    stop: &AtomicBool,
    writing: Writing,
) -> anyhow::Result<ExitCode> {
    let mut in_space = 0;
    for option in &arguments.calibration {
        let (_, path) = named(option);
        in_space += usize::from(path.is_file() && is_spatial(&path)?);
    }
    match in_space {
        0 => {
            let (row, config) = arguments.played.method.registered()?;
            serve(InPlane { row, config }, arguments, timing, stop, writing)
        }
        count if count == arguments.calibration.len() => {
            let InSpace { row, config, .. } = arguments.played.in_space()?;
            serve(OfSpace { row, config }, arguments, timing, stop, writing)
        }
        count => bail!(
            "--calibration: found {count} calibrations in space among {}, expected calibrations in the plane or in space alone",
            arguments.calibration.len()
        ),
    }
}

fn serve<T: Method>(
    method: T,
    arguments: &Arguments,
    timing: Timing,
    stop: &AtomicBool,
    writing: Writing,
) -> anyhow::Result<ExitCode>
where
    Answered<T::Kind>: Written,
{
    let whiskers = whiskers(&arguments.calibration)?;
    check(&method, &whiskers, timing)?;
    let origin = Instant::now();
    let sink = Arc::new(Mutex::new(Sink::new(origin, 1.0, writing)));
    let mut session = Session { whiskers, method, timing, sink, origin, lines: 0 };
    let (sender, lines) = sync_channel(AHEAD);
    thread::Builder::new().name("stdin".into()).spawn(move || read(&sender)).context("thread of stdin")?;
    let served = session.serve(&lines, stop);
    let waiting = session.waiting();
    let counts = session.end_workers()?;
    served?;
    locked(&session.sink).state_waiting(&waiting);
    Ok(locked(&session.sink).finish(&counts))
}

/// Answer of a kind of estimator.
type Answered<K> = Answer<<K as Kind>::Reading, <K as Kind>::Base, <K as Kind>::Estimate>;

/// Reads the calibrations and checks that the names are distinct.
fn whiskers<T: Method>(options: &[String]) -> anyhow::Result<Vec<Whisker<T>>> {
    let mut whiskers: Vec<Whisker<T>> = Vec::new();
    for option in options {
        let (name, path) = named(option);
        if options.len() > 1 && name.is_none() {
            bail!("--calibration: found `{option}` among several, expected NAME={option}");
        }
        if whiskers.iter().any(|whisker| whisker.name.as_deref() == name) {
            bail!("--calibration: found the name `{}` twice, expected each once", name.unwrap_or_default());
        }
        let known = whiskers.iter().find(|whisker| whisker.path == path);
        let calibration = match known {
            Some(whisker) => whisker.calibration.clone(),
            None => Arc::new(T::read(&path)?),
        };
        whiskers.push(Whisker { name: name.map(Into::into), path, calibration, worker: None });
    }
    Ok(whiskers)
}

/// Checks the settings with every calibration, so that errors in them do not wait for the first line.
fn check<T: Method>(method: &T, whiskers: &[Whisker<T>], timing: Timing) -> anyhow::Result<()> {
    let first = json!({"protocol": T::PROTOCOL, "rate_hz": 250, "noise_sd_n_m": 0}).to_string();
    let Ok(Line::Prior(prior)) = T::parse(&first) else { bail!("found no first line in `{first}`") };
    for whisker in whiskers {
        method.begin(&whisker.calibration, &whisker.path, &prior, timing)?;
    }
    Ok(())
}

/// Reads stdin and sends its lines until its end.
fn read(lines: &SyncSender<Arrival>) {
    let mut stdin = BufReader::new(io::stdin().lock());
    loop {
        let mut line = Vec::new();
        let read = stdin.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut line);
        let at = Instant::now();
        let is_last = read.as_ref().map_or(true, |count| *count == 0);
        let line = match read {
            Ok(0) => return,
            Ok(_) if line.len() as u64 > LONGEST_LINE && line.last() != Some(&b'\n') => {
                let skipped = stdin.skip_until(b'\n').map(drop);
                let long = format!("found more than {LONGEST_LINE} bytes, expected a line of at most that length");
                Err(skipped.err().unwrap_or_else(|| io::Error::new(io::ErrorKind::InvalidData, long)))
            }
            Ok(_) => Ok(line),
            Err(error) => Err(error),
        };
        // The session has ended if nobody receives.
        if lines.send(Arrival { line, at }).is_err() || is_last {
            return;
        }
    }
}

/// Exclusive use of the sink.
fn locked(sink: &Mutex<Sink>) -> MutexGuard<'_, Sink> {
    sink.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs the estimator of a whisker on its samples, until their sender is gone. Returns the counts.
fn work<K: Kind, M: Motion<Measured = K::Base, Base = K::Base>>(
    mut estimator: LiveEstimator<M, K>,
    name: Option<&str>,
    samples: &Receiver<Sample<K>>,
    origin: Instant,
    sink: &Mutex<Sink>,
) -> anyhow::Result<Counters>
where
    Answered<K>: Written,
{
    let mut out = Output::default();
    loop {
        let now_s = origin.elapsed().as_secs_f64();
        let wait = estimator.deadline_s().map_or(IDLE, |due_s| Duration::from_secs_f64((due_s - now_s).max(0.0)));
        let sample = samples.recv_timeout(wait);
        let at_s = match &sample {
            Ok(sample) => sample.at_s,
            Err(RecvTimeoutError::Timeout) => origin.elapsed().as_secs_f64(),
            Err(RecvTimeoutError::Disconnected) => break,
        };
        while let Some(due_s) = estimator.deadline_s().filter(|due_s| *due_s <= at_s) {
            estimator.poll(due_s, &mut out);
        }
        if let Ok(Sample { t_s, reading, base, .. }) = sample {
            if let Some(base) = base {
                estimator.pose(t_s, base, at_s, &mut out)?;
            }
            match reading {
                Some(Taken::Reading(reading_n_m)) => estimator.reading(t_s, reading_n_m, at_s, &mut out)?,
                Some(Taken::LeftOut(status)) => {
                    // After the answers to earlier readings.
                    let mut sink = locked(sink);
                    sink.take(name, &mut out)?;
                    sink.leave_out(name, t_s, status)?;
                }
                None => {}
            }
        }
        if !(out.answers.is_empty() && out.events.is_empty()) {
            locked(sink).take(name, &mut out)?;
        }
    }
    estimator.finish(&mut out);
    locked(sink).take(name, &mut out)?;
    Ok(*estimator.counters())
}

impl<T: Method> Session<T>
where
    Answered<T::Kind>: Written,
{
    /// Processes lines until their end or until `stop` is set.
    fn serve(&mut self, lines: &Receiver<Arrival>, stop: &AtomicBool) -> anyhow::Result<()> {
        while !stop.load(Ordering::Relaxed) {
            match lines.recv_timeout(NAP) {
                Ok(arrival) => {
                    let at_s = arrival.at.duration_since(self.origin).as_secs_f64();
                    self.line(arrival.line, at_s)?;
                }
                // A thread that has ended by itself has failed.
                Err(RecvTimeoutError::Timeout) if self.has_ended_worker() => return self.end_workers().map(drop),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(())
    }

    fn has_ended_worker(&self) -> bool {
        self.whiskers.iter().flat_map(|whisker| &whisker.worker).any(|worker| worker.thread.is_finished())
    }

    /// Ends the threads of the whiskers. Returns names and counts.
    ///
    /// # Errors
    /// The error of the first that failed.
    fn end_workers(&mut self) -> anyhow::Result<Vec<(Option<String>, Counters)>> {
        let mut ended = Vec::new();
        for whisker in &mut self.whiskers {
            if let Some(Worker { samples, thread, .. }) = whisker.worker.take() {
                drop(samples);
                ended.push((whisker.name.clone(), thread.join().expect("the thread does not panic")));
            }
        }
        ended.into_iter().map(|(name, counts)| Ok((name, counts?))).collect()
    }

    fn line(&mut self, line: io::Result<Vec<u8>>, at_s: f64) -> anyhow::Result<()> {
        self.lines += 1;
        let parsed = match line.map(String::from_utf8) {
            Ok(Ok(text)) => T::parse(text.trim_end_matches(['\n', '\r'])),
            Ok(Err(error)) => {
                let column = Some(error.utf8_error().valid_up_to() + 1);
                Err(BadLine {
                    column,
                    reason: "found bytes that are not UTF-8, expected UTF-8".into(),
                    is_not_finite: false,
                })
            }
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Err(BadLine { column: None, reason: error.to_string(), is_not_finite: false })
            }
            Err(error) => return Err(error).context("stdin"),
        };
        let taken = match parsed {
            Ok(Line::Prior(prior)) if self.has_begun(&prior) => {
                return locked(&self.sink).refuse("second first lines", || {
                    format!(
                        "stdin: line {}: found a second first line of the whisker, expected its readings or poses; the line is left \
                         out, and the first one holds",
                        self.lines
                    )
                });
            }
            Ok(Line::Prior(prior)) => return self.begin(&prior).with_context(|| format!("stdin: line {}", self.lines)),
            Ok(Line::Sample(sample)) => self.sample(sample, at_s)?,
            Err(bad) => Err(bad),
        };
        let Err(bad) = taken else { return Ok(()) };
        let kind =
            if bad.is_not_finite { "lines with a value that is not finite" } else { "lines that are no messages" };
        locked(&self.sink).refuse(kind, || format!("stdin: line {}, {bad}; {}", self.lines, self.consequence()))
    }

    /// Names of the whiskers without a first line.
    fn waiting(&self) -> Vec<Option<String>> {
        self.whiskers.iter().filter(|whisker| whisker.worker.is_none()).map(|whisker| whisker.name.clone()).collect()
    }

    /// States which lines are left out after one that is no message: also those of whiskers without a first line, as which it may have
    /// been meant.
    fn consequence(&self) -> String {
        let waiting = self.waiting();
        let names: Vec<_> = waiting.iter().flatten().map(String::as_str).collect();
        match (waiting.len(), names.as_slice()) {
            (0, _) => "the line is left out".into(),
            (_, []) => "the line is left out, and so is every reading and pose before a valid first line".into(),
            (_, names) => format!(
                "the line is left out, and so is every reading and pose of {} before a valid first line of that whisker",
                names.join(", ")
            ),
        }
    }

    /// Passes a reading, a pose or both to the thread of the whisker.
    fn sample(&mut self, sample: SampleOf<T>, at_s: f64) -> anyhow::Result<Result<(), BadLine>> {
        let bad = |reason: String| Ok(Err(BadLine { column: None, reason, is_not_finite: false }));
        let Some(place) = self.place_of(sample.name.as_deref()) else {
            return bad(self.unknown(sample.name.as_deref()));
        };
        let Some(worker) = &mut self.whiskers[place].worker else {
            return bad("found a reading or a pose, expected the whisker's first line before it (docs/LIVE.md)".into());
        };
        let SampleLine { t_s, reading, base, .. } = sample;
        let repeated = T::zeroings_repeated(&worker.conversion);
        let taken = reading.map(|given| T::convert(&mut worker.conversion, t_s, given, at_s)).transpose();
        if T::zeroings_repeated(&worker.conversion) > repeated {
            locked(&self.sink).repeat_zeroing(sample.name.as_deref(), t_s);
        }
        let reading = match taken {
            Ok(reading) => reading,
            Err(reason) => return bad(reason),
        };
        if worker.samples.send(Sample { t_s, reading, base, at_s }).is_err() {
            self.end_workers()?;
        }
        Ok(Ok(()))
    }

    fn place_of(&self, name: Option<&str>) -> Option<usize> {
        self.whiskers.iter().position(|whisker| whisker.name.as_deref() == name)
    }

    fn unknown(&self, name: Option<&str>) -> String {
        let known: Vec<_> = self.whiskers.iter().filter_map(|whisker| whisker.name.as_deref()).collect();
        let found = name.map_or_else(|| "no name".into(), |name| format!("the name `{}`", one_line(name)));
        match known.as_slice() {
            [] => format!("found {found}, expected no name, as in --calibration"),
            known => format!("found {found}, expected one of those of --calibration: {}", known.join(", ")),
        }
    }

    /// Whether there was a first line of the whisker.
    fn has_begun(&self, prior: &T::Prior) -> bool {
        self.place_of(T::name(prior)).is_some_and(|place| self.whiskers[place].worker.is_some())
    }

    /// Begins the estimation of a whisker.
    fn begin(&mut self, prior: &T::Prior) -> anyhow::Result<()> {
        let name = T::name(prior);
        let Some(place) = self.place_of(name) else { bail!("name: {}", self.unknown(name)) };
        let whisker = &mut self.whiskers[place];
        let (estimator, conversion) = self.method.begin(&whisker.calibration, &whisker.path, prior, self.timing)?;
        let (samples, received) = sync_channel(AHEAD);
        let (name, origin, sink) = (whisker.name.clone(), self.origin, self.sink.clone());
        let works = move || work(estimator, name.as_deref(), &received, origin, &sink);
        let thread = thread::Builder::new().name("whisker".into()).spawn(works).context("thread of a whisker")?;
        whisker.worker = Some(Worker { conversion, samples, thread });
        Ok(())
    }
}

/// Checks what the first lines of both protocols have in common. `largest_n_m` is the largest calibrated reading.
fn check_prior(protocol: (u32, u32), rate_hz: f64, noise_sd_n_m: Option<f64>, largest_n_m: f64) -> anyhow::Result<()> {
    let (found, expected) = protocol;
    if found != expected {
        let kind = if expected == SPATIAL_PROTOCOL { "in space" } else { "in the plane" };
        bail!("protocol: found {found}, expected {expected}, the version for a calibration {kind}");
    }
    let [least, most] = RATES_HZ;
    if !(least..=most).contains(&rate_hz) {
        bail!("rate_hz: found {}, expected {least} to {most}", shown_number(rate_hz));
    }
    if let Err((found, expected)) = check_noise(noise_sd_n_m, largest_n_m) {
        bail!("noise_sd_n_m: found {found}, expected {expected}");
    }
    Ok(())
}

/// Checks the settings of counts in the first lines of both protocols.
fn check_counts(zeroing_s: Option<f64>, modulo: Option<f64>) -> anyhow::Result<()> {
    for (key, found, [least, most]) in [("zeroing_s", zeroing_s, ZEROINGS_S), ("modulo", modulo, MODULI)] {
        if let Some(found) = found.filter(|found| !(least..=most).contains(found)) {
            bail!("{key}: found {}, expected {least} to {most}", shown_number(found));
        }
    }
    Ok(())
}

/// Conversion of the counts of a whisker.
struct CountsOf {
    /// The reason if its counts cannot be converted.
    counts: Result<Counts, String>,
    has_common_mode: bool,
    /// Path of the calibration.
    path: PathBuf,
}

impl CountsOf {
    /// The sensor whose counts may follow a first line: the one that it states, or that of the recordings.
    fn sensor<'a>(
        calibration: &'a CalibrationFile,
        path: &Path,
        prior: &PriorLine,
    ) -> anyhow::Result<Option<&'a SensorFile>> {
        let PriorLine { sensor: label, zeroing_s, modulo, .. } = prior;
        check_counts(*zeroing_s, *modulo)?;
        // With a front end, the lines of a whisker are moments unless its first line states otherwise.
        if label.is_none() && zeroing_s.is_none() && modulo.is_none() {
            return Ok(calibration.sensor.as_ref());
        }
        let sensor = calibration.sensor_of_counts(path, label.as_deref())?;
        if let Some(talk) = sensor.cross_talk.first() {
            bail!(
                "{}: front_end.sensors.{}.cross_talk: found one from `{}`, expected none on stdin; `ros2-node contact` \
                compensates it",
                path.display(),
                sensor.label(),
                talk.from
            );
        }
        Ok(Some(sensor))
    }

    fn new(
        sensor: Option<&SensorFile>,
        calibration: &CalibrationFile,
        path: &Path,
        prior: &PriorLine,
        timing: Timing,
    ) -> Self {
        let has_common_mode = sensor.is_some_and(|sensor| sensor.common_mode != [0.0; 2]);
        let zeroing_s = prior.zeroing_s.unwrap_or(ZEROING_S);
        let conversion = |sensor: &SensorFile| {
            let noise_sd_n_m = sensor.noise_sd_n_m.max(prior.noise_sd_n_m.unwrap_or_default());
            let own = Sensor::new(SensorFile { noise_sd_n_m, ..sensor.clone() }, 0, prior.modulo);
            Counts::new(own, has_common_mode, Vec::new(), zeroing_s, timing, prior.rate_hz)
        };
        let reason = || {
            let known: Vec<_> = calibration.sensors().map(SensorFile::label).collect();
            let path = path.display();
            if known.is_empty() {
                return format!(
                    "counts: found those of a whisker whose calibration {path} has no sensor, expected reading_n_m, or a \
                    calibration that `whisker fit` made of imported recordings"
                );
            }
            let known = known.join(", ");
            format!(
                "counts: found some, although the first line of the whisker states none of sensor, zeroing_s and modulo; \
                 expected one of them for the sensors of {path}: {known}"
            )
        };
        Self { counts: sensor.map(conversion).ok_or_else(reason), has_common_mode, path: path.into() }
    }
}

/// An estimator of the plane with its settings.
struct InPlane {
    row: &'static EstimatorRow,
    config: Value,
}

impl Method for InPlane {
    type Kind = Planar;
    type Motion = Poses;
    type Prior = PriorLine;
    type Calibration = CalibrationFile;
    type Given = Given;
    type Conversion = CountsOf;

    const PROTOCOL: u32 = PROTOCOL;

    fn read(path: &Path) -> anyhow::Result<CalibrationFile> {
        read_calibration(path, above_calibrations(path))
    }

    fn parse(line: &str) -> Result<Line, BadLine> {
        wire::parse(line)
    }

    fn name(prior: &PriorLine) -> Option<&str> {
        prior.name.as_deref()
    }

    fn begin(
        &self,
        calibration: &CalibrationFile,
        path: &Path,
        prior: &PriorLine,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>> {
        let sensor = CountsOf::sensor(calibration, path, prior)?;
        let of_sensor = sensor.map(|sensor| sensor.noise_sd_n_m);
        let noise_sd_n_m = noise_n_m(prior.noise_sd_n_m, of_sensor).with_context(|| {
            format!(
                "noise_sd_n_m: found none, expected the standard deviation of the noise: the first line names no sensor of {}, \
                 and that calibration has none of recordings",
                path.display()
            )
        })?;
        let largest_n_m = calibration.largest_reading_n_m();
        check_prior((prior.protocol, Self::PROTOCOL), prior.rate_hz, prior.noise_sd_n_m, largest_n_m)?;
        let whisker = &calibration.whisker;
        if let Some(difference) = prior.whisker.as_ref().and_then(|stated| stated.difference(whisker)) {
            bail!("whisker.{difference}, as in {}", path.display());
        }
        let expected = |key: &str, expected: String| anyhow::anyhow!("{key}: found other numbers, expected {expected}");
        let base_noise = prior.base_noise.map(|of| of.base_noise().map_err(|form| expected("base_noise", form)));
        let contact_prior = prior.told.map(|of| of.contact_prior().map_err(|form| expected("told", form)));
        let knowledge = Arc::new(Knowledge {
            whisker: whisker.clone(),
            rest: whisker.rest_shape(),
            faces: read_by(sensor, &calibration.calibrated(path, self.row.sensor_model)?),
            noise_sd_n_m,
            base_noise: base_noise.transpose()?.unwrap_or_default(),
            rate_hz: prior.rate_hz,
            contact_prior: contact_prior.transpose()?,
        });
        let (row, config, seed) = (self.row, self.config.clone(), prior.seed.unwrap_or_default());
        let of_build = knowledge.clone();
        let build = move || {
            let method = method(row, &config, &of_build)?;
            Ok(Estimator::new(Runner::new(method, of_build.clone(), seed), TouchConfig::default()))
        };
        let looks_back = row.class == MethodClass::Hindsight;
        let estimator = LiveEstimator::new(Box::new(build), &knowledge, looks_back, timing)?;
        Ok((estimator, CountsOf::new(sensor, calibration, path, prior, timing)))
    }

    fn convert(conversion: &mut CountsOf, t_s: f64, given: Given, at_s: f64) -> Result<Taken<f64>, String> {
        let (counts, reference) = match given {
            Given::Moment(n_m) => return Ok(Taken::Reading(n_m)),
            Given::Counts(counts, reference) => (counts, reference),
        };
        let CountsOf { counts: conversion, has_common_mode, path } = conversion;
        let conversion = conversion.as_mut().map_err(|reason| reason.clone())?;
        match reference {
            Some([x, y]) => conversion.take(counts::Stream::Reference, t_s, [x, y, 0.0], at_s),
            None if *has_common_mode => {
                return Err(format!(
                    "reference_counts: found none, expected those of the reference sensor, whose common mode {} has",
                    path.display()
                ));
            }
            None => {}
        }
        conversion.take(counts::Stream::Own, t_s, [counts, 0.0, 0.0], at_s);
        // The counts of the reference have the same time, so that none wait.
        Ok(match conversion.next(at_s).map(|converted| converted.reading) {
            Some(Reading::Of(n_m)) => Taken::Reading(n_m),
            Some(Reading::Zeroing) => Taken::LeftOut(ZEROING),
            Some(Reading::Late | Reading::Incomplete) | None => Taken::LeftOut(Status::Late.name()),
        })
    }

    fn zeroings_repeated(conversion: &CountsOf) -> u64 {
        conversion.counts.as_ref().map_or(0, Conversion::zeroings_repeated)
    }
}

/// A calibration in space and its tabulated sensor model.
struct Tabulated {
    file: SpatialCalibrationFile,
    calibrated: Arc<CalibratedSpace>,
}

/// An estimator of space with its settings.
struct OfSpace {
    row: &'static SpatialEstimatorRow,
    config: Value,
}

impl Method for OfSpace {
    type Kind = Spatial;
    type Motion = SpatialPoses;
    type Prior = SpatialPriorLine;
    type Calibration = Tabulated;
    type Given = SpatialGiven;
    type Conversion = Result<BendingCounts, String>;

    const PROTOCOL: u32 = SPATIAL_PROTOCOL;

    fn read(path: &Path) -> anyhow::Result<Tabulated> {
        let file = space::replay::read_calibration(path)?;
        let calibrated = space::replay::read_by(&file.calibrated(path, None)?, file.front_end_sensor());
        Ok(Tabulated { file, calibrated })
    }

    fn parse(line: &str) -> Result<wire::SpatialLine, BadLine> {
        wire::parse_in_space(line)
    }

    fn name(prior: &SpatialPriorLine) -> Option<&str> {
        prior.name.as_deref()
    }

    fn begin(
        &self,
        Tabulated { file, calibrated }: &Tabulated,
        path: &Path,
        prior: &SpatialPriorLine,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>> {
        let of_sensor = file.sensor.map(|sensor| sensor.noise_sd_n_m);
        let noise_sd_n_m = noise_n_m(prior.noise_sd_n_m, of_sensor).with_context(|| {
            format!(
                "noise_sd_n_m: found none, expected the standard deviation of the noise (N m), since the calibration {} has no \
                 `sensor` that states it",
                path.display()
            )
        })?;
        check_prior((prior.protocol, Self::PROTOCOL), prior.rate_hz, prior.noise_sd_n_m, file.largest_reading_n_m)?;
        check_counts(prior.zeroing_s, prior.modulo)?;
        let for_counts = [("zeroing_s", prior.zeroing_s), ("modulo", prior.modulo)];
        if let Some((key, _)) = for_counts.iter().find(|(_, stated)| stated.is_some() && file.sensor.is_none()) {
            let path = path.display();
            bail!("{key}: found a setting of counts, expected none, since the calibration {path} has no `sensor`");
        }
        let is_other = prior.whisker.as_ref().is_some_and(|stated| *stated != file.whisker)
            || prior.suspension.is_some_and(|stated| stated != file.suspension)
            || prior.poisson_ratio.is_some_and(|stated| stated != file.poisson_ratio);
        if is_other {
            bail!(
                "whisker, suspension or poisson_ratio: found other parameters than those of {}, expected the same",
                path.display()
            );
        }
        let knowledge =
            Arc::new(SpatialKnowledge { calibrated: calibrated.clone(), noise_sd_n_m, rate_hz: prior.rate_hz });
        let (row, config, of_build) = (self.row, self.config.clone(), knowledge.clone());
        let build = move || space::replay::build(row, &config, &of_build);
        let zeroing_s = prior.zeroing_s.unwrap_or(ZEROING_S);
        let conversion = |sensor: BendingSensor| {
            let sensor = BendingSensor { noise_sd_n_m, ..sensor };
            let largest_n_m = file.largest_reading_n_m;
            BendingCounts::new(sensor, largest_n_m, [0, 1], prior.modulo, zeroing_s, timing, prior.rate_hz)
        };
        let counts = file.sensor.map(conversion).ok_or_else(|| {
            format!(
                "counts: found those of a whisker whose calibration {} has no sensor, expected moment_y_n_m and moment_z_n_m, or \
                 a calibration that `whisker fit` made of imported recordings",
                path.display()
            )
        });
        Ok((LiveEstimator::in_space(Box::new(build), &knowledge, timing)?, counts))
    }

    fn convert(
        conversion: &mut Self::Conversion,
        t_s: f64,
        given: SpatialGiven,
        at_s: f64,
    ) -> Result<Taken<Vector2<f64>>, String> {
        match given {
            SpatialGiven::Moments(moments_n_m) => Ok(Taken::Reading(moments_n_m)),
            SpatialGiven::Counts(counts) => {
                let conversion = conversion.as_mut().map_err(|reason| reason.clone())?;
                let moments_n_m = conversion.moments_n_m(t_s, counts, at_s);
                Ok(moments_n_m.map_or(Taken::LeftOut(ZEROING), Taken::Reading))
            }
        }
    }

    fn zeroings_repeated(conversion: &Self::Conversion) -> u64 {
        conversion.as_ref().map_or(0, Conversion::zeroings_repeated)
    }
}
