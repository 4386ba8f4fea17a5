//! A session: the routine runs while the data of sensor and printer are recorded and, with a calibration, contacts are
//! estimated live.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use crate::inference::{Inference, Latency};
use crate::printer::{Head, Printer};
use crate::record::{Ending, Sink};
use crate::routine::{Contact, Observer, Plan};
use crate::sensor::{Reader, Report};
use crate::{Error, Sample};

/// Longest wait of the recorder for samples before it handles other data.
const PATIENCE: Duration = Duration::from_millis(50);

/// Outcome of a session.
#[derive(Debug)]
pub struct Outcome {
    /// Report on the reading of the sensor.
    pub report: Report,
    /// Latency of the inference. `None` without a calibration.
    pub latency: Option<Latency>,
    /// Files written.
    pub files: Vec<PathBuf>,
    /// Error that interrupted it; the files are those of an interrupted recording.
    pub error: Option<Error>,
}

enum Event {
    Head(Head),
    Contact(Contact),
}

/// Runs the routine on a printer while the samples of a sensor and the detections of `inference` are recorded into
/// `sinks`. Times are counted from `origin`, which must be that of printer and reader. If the sensor or a sink fails,
/// the head stops after the current push; if the printer fails, the samples up to then are recorded.
pub fn run(
    routine: &Plan<'_>,
    printer: &mut Printer,
    reader: Reader,
    inference: Option<Inference<'_>>,
    sinks: Vec<Box<dyn Sink>>,
    origin: Instant,
) -> Outcome {
    let (ends, over) = (AtomicBool::new(false), AtomicBool::new(false));
    let (sender, events) = channel();
    let (moved, recorded) = thread::scope(|scope| {
        let recorder = scope.spawn(|| record(reader, inference, sinks, events, &over, &ends));
        let moved = routine.run(printer, origin, &ends, &mut Forward(sender));
        over.store(true, Ordering::Relaxed);
        (moved, recorder.join().expect("the recorder does not panic"))
    });
    let Recorded { report, latency, sinks, error } = recorded;
    let mut error = error.or(moved.err());
    let ending = if error.is_some() { Ending::Interrupted } else { Ending::Complete };
    let mut files = Vec::new();
    for sink in sinks {
        match sink.finish(ending) {
            Ok(written) => files.extend(written),
            Err(failure) => error = error.or(Some(failure)),
        }
    }
    Outcome { report, latency, files, error }
}

/// Observer that forwards to the recorder's thread.
struct Forward(Sender<Event>);

impl Observer for Forward {
    fn head(&mut self, head: Head) -> Result<(), Error> {
        // A recorder that has ended reports its own error.
        let _ = self.0.send(Event::Head(head));
        Ok(())
    }

    fn contact(&mut self, contact: Contact) -> Result<(), Error> {
        let _ = self.0.send(Event::Contact(contact));
        Ok(())
    }
}

struct Recorded {
    report: Report,
    latency: Option<Latency>,
    sinks: Vec<Box<dyn Sink>>,
    error: Option<Error>,
}

/// Feeds the sinks until the routine is over, or until sensor or sinks fail, which ends the routine.
fn record(
    reader: Reader,
    mut inference: Option<Inference<'_>>,
    mut sinks: Vec<Box<dyn Sink>>,
    events: Receiver<Event>,
    over: &AtomicBool,
    ends: &AtomicBool,
) -> Recorded {
    let (mut arrivals, mut samples, mut failure) = (Vec::new(), Vec::new(), None);
    let mut comes_more = true;
    while comes_more {
        if over.load(Ordering::Relaxed) {
            reader.end();
        }
        comes_more = reader.take(&mut arrivals, PATIENCE);
        let events: Vec<Event> = events.try_iter().collect();
        samples.extend(arrivals.iter().map(|arrival| arrival.sample));
        let mut feed_all = |feed: &dyn Fn(&mut dyn Sink) -> Result<(), Error>| {
            // An error of one sink does not keep the data from the others.
            for error in sinks.iter_mut().filter_map(|sink| feed(sink.as_mut()).err()) {
                failure.get_or_insert(error);
                ends.store(true, Ordering::Relaxed);
            }
        };
        // Detections are reported before the samples are written.
        if let Some(inference) = &mut inference {
            for arrival in &arrivals {
                inference.step(arrival, |detection| feed_all(&|sink| sink.detected(detection)));
            }
        }
        feed_all(&|sink| feed(sink, &samples, &events));
        arrivals.clear();
        samples.clear();
    }
    ends.store(true, Ordering::Relaxed);
    let (report, error) = reader.finish();
    Recorded { report, latency: inference.map(Inference::latency), sinks, error: error.or(failure) }
}

/// Feeds a sink with everything, also after an error, and returns the first error.
fn feed(sink: &mut dyn Sink, samples: &[Sample], events: &[Event]) -> Result<(), Error> {
    events.iter().fold(sink.samples(samples), |fed, event| {
        let next = match event {
            Event::Head(head) => sink.head(*head),
            Event::Contact(contact) => sink.contact(*contact),
        };
        fed.and(next)
    })
}
