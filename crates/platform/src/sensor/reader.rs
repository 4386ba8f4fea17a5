//! Reader thread of a sensor's port.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::clock::SampleClock;
use super::decoder::{Decoder, Tally};
use super::ring::Ring;
use super::{BAUD, FormatRow};
use crate::{Error, Sample, port};

/// Timeout of a read, and so the delay of ending the thread.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time without bytes after which the sensor counts as silent.
const SILENCE: Duration = Duration::from_secs(2);
/// Longest start of a board after its port was opened.
const START: Duration = Duration::from_secs(5);
/// Size of the read buffer in bytes: more than the system's buffer.
const CHUNK: usize = 1 << 16;

/// Settings of a reader.
#[derive(Clone, Copy, Debug)]
pub struct ReaderSettings {
    /// Line format.
    pub format: &'static FormatRow,
    /// Nominal rate (Hz).
    pub rate_hz: f64,
    /// Capacity of the queue in samples.
    pub capacity: usize,
    /// Time zero.
    pub origin: Instant,
}

impl ReaderSettings {
    /// Settings of a format at its nominal rate, with a queue for a minute and a half at 800 Hz.
    pub fn new(format: &'static FormatRow, origin: Instant) -> Self {
        Self { format, rate_hz: format.rate_hz, capacity: 1 << 16, origin }
    }
}

/// A sample and the instant at which its last byte was read; the time of the sample is that instant without jitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Instant of reading.
    pub at: Instant,
    /// The sample.
    pub sample: Sample,
}

/// Report of a reader.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Statistics of the port.
    pub tally: Tally,
    /// Number of samples that were overwritten because they were not processed in time.
    pub overwritten: u64,
    /// Number of pauses of the sensor.
    pub pauses: u64,
    /// Estimated rate (Hz).
    pub rate_hz: f64,
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Tally { samples, garbage_lines, partial_lines, .. } = self.tally;
        write!(
            f,
            "{samples} samples at {:.1} Hz, {} overwritten, {} pauses, {garbage_lines} lines of garbage, \
            {partial_lines} partial lines",
            self.rate_hz, self.overwritten, self.pauses
        )
    }
}

/// Reader of a sensor in a thread of its own, so that no sample is lost while the consumer is busy.
#[derive(Debug)]
pub struct Reader {
    ring: Arc<Ring>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<Outcome>>,
}

/// Report, and the error that ended reading.
type Outcome = (Report, Option<Error>);

impl Reader {
    /// Opens the port and starts to read.
    ///
    /// # Errors
    /// [`Error::Open`] if the port cannot be opened.
    pub fn open(name: &str, settings: ReaderSettings) -> Result<Self, Error> {
        let opened = port::open(name, BAUD, PATIENCE)?;
        let (ring, ends) = (Arc::new(Ring::new(settings.capacity)), Arc::new(AtomicBool::new(false)));
        let source = Source { name: name.into(), port: opened, ring: ring.clone(), ends: ends.clone(), settings };
        let thread = std::thread::Builder::new().name("sensor".into()).spawn(|| source.run());
        Ok(Self { ring, ends, thread: Some(thread.map_err(Error::system("thread of the sensor"))?) })
    }

    /// Moves the pending samples into `arrivals`, waiting up to `patience` for the first one. `false` after the end of
    /// the stream, whose reason [`Reader::finish`] returns.
    pub fn take(&self, arrivals: &mut Vec<Arrival>, patience: Duration) -> bool {
        self.ring.take(arrivals, patience)
    }

    /// Signals the thread to end after the pending bytes. Samples can be taken until [`Reader::take`] returns `false`.
    pub fn end(&self) {
        self.ends.store(true, Ordering::Relaxed);
    }

    /// Ends reading. Returns the report, and the error if reading failed or samples were overwritten.
    pub fn finish(mut self) -> (Report, Option<Error>) {
        self.end();
        let thread = self.thread.take().expect("finishes once");
        thread.join().expect("the thread does not panic")
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.end();
    }
}

struct Source {
    name: String,
    port: Box<dyn SerialPort>,
    ring: Arc<Ring>,
    ends: Arc<AtomicBool>,
    settings: ReaderSettings,
}

impl Source {
    fn run(mut self) -> Outcome {
        let mut decoder = Decoder::new(self.settings.format);
        let mut clock = SampleClock::new(self.settings.rate_hz);
        let error = self.read(&mut decoder, &mut clock).err();
        self.ring.close();
        let (overwritten, tally) = (self.ring.overwritten(), decoder.finish());
        let overrun = || (overwritten > 0).then(|| Error::Overrun { port: self.name.clone(), lost: overwritten });
        let report = Report { tally, overwritten, pauses: clock.pauses(), rate_hz: clock.rate_hz() };
        (report, error.or_else(overrun))
    }

    fn read(&mut self, decoder: &mut Decoder, clock: &mut SampleClock) -> Result<(), Error> {
        let opened = Instant::now();
        let (mut last_byte, mut last_sample) = (opened, opened);
        let (mut bytes, mut readings, mut arrivals) = (vec![0; CHUNK], Vec::new(), Vec::new());
        loop {
            // Checked before the read, so that bytes that have arrived are still read.
            let ends = self.ends.load(Ordering::Relaxed);
            let read = self.arrived(&mut bytes);
            let now = Instant::now();
            match read {
                Ok(count) if count > 0 => {
                    last_byte = now;
                    decoder.push(&bytes[..count], &mut readings);
                    if !readings.is_empty() {
                        last_sample = now;
                        let arrival_s = now.duration_since(self.settings.origin).as_secs_f64();
                        let times = clock.stamp(arrival_s, readings.len());
                        let samples = readings.drain(..).zip(times).map(|(counts, t_s)| Sample { t_s, counts });
                        arrivals.extend(samples.map(|sample| Arrival { at: now, sample }));
                        self.ring.put(&arrivals);
                        arrivals.clear();
                    }
                }
                Ok(_) => {}
                Err(reason) => {
                    let after_s = now.duration_since(opened).as_secs_f64();
                    return Err(Error::Gone { port: self.name.clone(), after_s, reason });
                }
            }
            if ends {
                return Ok(());
            }
            self.check_alive(decoder.tally(), now.duration_since(last_byte), now.duration_since(last_sample))?;
        }
    }

    /// Reads the pending bytes, with a timeout; 0 if there are none.
    fn arrived(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self.port.read(bytes) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(mut count) => {
                // A terminal delivers some kilobytes at a time; the remaining bytes have arrived already. An error here
                // recurs at the next read, and the bytes so far are kept.
                while count < bytes.len() && self.port.bytes_to_read().is_ok_and(|waiting| waiting > 0) {
                    match self.port.read(&mut bytes[count..]) {
                        Ok(more) if more > 0 => count += more,
                        _ => break,
                    }
                }
                Ok(count)
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(0),
            Err(error) => Err(error),
        }
    }

    fn check_alive(&self, tally: &Tally, byteless: Duration, sampleless: Duration) -> Result<(), Error> {
        let limit = if tally.samples == 0 { START } else { SILENCE };
        let port = self.name.clone();
        if byteless > limit {
            let (samples, rate_hz) = (tally.samples, self.settings.rate_hz);
            return Err(Error::Silent { port, for_s: byteless.as_secs_f64(), samples, rate_hz });
        }
        if sampleless > limit {
            let example = tally.example.clone().unwrap_or_else(|| "one that never ends".into());
            let (lines, format) = (tally.garbage_lines, self.settings.format);
            return Err(Error::Foreign { port, lines, example, format: format.name, about: format.about });
        }
        Ok(())
    }
}
