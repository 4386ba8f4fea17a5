//! Link to a printer: each command is acknowledged before the next.
//!
//! Every line has a number and a checksum (Marlin's protocol). The printer accepts only the successor of the last
//! accepted line and otherwise requests it again, so that a line is sent again, without being executed twice, if the
//! line or its `ok` was damaged.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::answer::{Answer, Position};
use super::gcode::numbered;
use crate::lines::{Line, Lines, shown};
use crate::{Error, port};

/// Timeout of a read, and so the delay of an interrupt.
const TICK: Duration = Duration::from_millis(20);
/// Longest start of a printer after its port was opened.
const START: Duration = Duration::from_secs(15);
/// Longest delay of an answer of a printer that is not busy.
pub(super) const PROMPT: Duration = Duration::from_secs(3);
/// Silence after which all answers to earlier commands have arrived.
const QUIET: Duration = Duration::from_millis(250);
/// Silence after an error without `ok` or request to send again, after which the line is sent again.
const COMPLAINT: Duration = Duration::from_secs(1);
/// Largest number of attempts to send a line.
const MOST_SENDS: u32 = 6;

/// A printer's port and the numbers of the lines on it.
pub(super) struct Link {
    pub(super) name: String,
    port: Box<dyn SerialPort>,
    opened: Instant,
    lines: Lines,
    waiting: VecDeque<String>,
    /// Number of the last line that the printer accepted.
    number: u32,
    stop: Arc<AtomicBool>,
}

/// Outcome of a sent line.
enum Fate {
    Taken(Option<Position>),
    /// The printer requests the line of this number.
    Wanted(u32),
    /// No answer, or only an error.
    Unanswered(Option<String>),
}

impl Link {
    /// Opens a port and waits for the printer to answer.
    pub(super) fn open(name: &str, baud: u32, stop: Arc<AtomicBool>) -> Result<Self, Error> {
        let port = port::open(name, baud, TICK)?;
        let (name, opened) = (name.into(), Instant::now());
        let mut link = Self { name, port, opened, lines: Lines::default(), waiting: VecDeque::new(), number: 0, stop };
        link.begin()?;
        Ok(link)
    }

    /// Resets the line numbers, repeatedly, as the printer may be starting.
    fn begin(&mut self) -> Result<(), Error> {
        let command = "M110 N0";
        let began = Instant::now();
        while began.elapsed() < START {
            self.write(&numbered(0, command))?;
            if let Fate::Taken(_) = self.fate(command, PROMPT)? {
                self.number = 0;
                // `ok` to an earlier attempt, or the rest of the start message.
                while self.line(QUIET)?.is_some() {}
                return Ok(());
            }
        }
        Err(self.no_answer(command, START))
    }

    /// Sends a command and waits until the printer has accepted it, as long as it reports to be busy. Returns the position that it
    /// reported meanwhile.
    pub(super) fn send(&mut self, command: &str, patience: Duration) -> Result<Option<Position>, Error> {
        let number = self.number + 1;
        let mut complaint = None;
        for _ in 0..MOST_SENDS {
            self.write(&numbered(number, command))?;
            match self.fate(command, patience)? {
                Fate::Taken(position) => {
                    self.number = number;
                    return Ok(position);
                }
                // The line was accepted, and its `ok` was lost.
                Fate::Wanted(wanted) if wanted == number + 1 => {
                    self.number = number;
                    return Ok(None);
                }
                Fate::Wanted(wanted) if wanted == number => {}
                // Its line numbers were set by another client's `M110`.
                Fate::Wanted(wanted) => {
                    let number = wanted.saturating_sub(1);
                    return Err(self.refused(command, format!("Resend: {wanted}, though {number} was never sent")));
                }
                Fate::Unanswered(trouble) => complaint = trouble.or(complaint),
            }
        }
        Err(match complaint {
            Some(complaint) => self.refused(command, complaint),
            None => self.no_answer(command, patience * MOST_SENDS),
        })
    }

    /// Outcome of the line that was sent last.
    fn fate(&mut self, command: &str, patience: Duration) -> Result<Fate, Error> {
        let mut deadline = Instant::now() + patience;
        let (mut position, mut wanted, mut trouble) = (None, None, None);
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let Some(line) = self.line(left)? else {
                return Ok(wanted.map_or(Fate::Unanswered(trouble), Fate::Wanted));
            };
            match Answer::parse(&line) {
                Answer::Ok(stated) => match (wanted, trouble) {
                    // This `ok` belongs to the request to send again, not to the command.
                    (Some(number), _) => return Ok(Fate::Wanted(number)),
                    (None, Some(trouble)) => return Err(self.refused(command, trouble)),
                    (None, None) => return Ok(Fate::Taken(stated.or(position))),
                },
                Answer::Position(stated) => position = Some(stated),
                Answer::Busy => deadline = Instant::now() + patience,
                Answer::Error(text) => {
                    trouble = Some(text);
                    // Lines that belong to it follow at once.
                    deadline = deadline.min(Instant::now() + COMPLAINT);
                }
                Answer::Halted(text) => return Err(self.refused(command, text)),
                Answer::Resend(number) => {
                    wanted = Some(number);
                    // Not every printer appends `ok`.
                    deadline = Instant::now() + QUIET;
                }
                // After a restart its position is unknown.
                Answer::Started if self.number > 0 => return Err(self.refused(command, "start".into())),
                Answer::Started | Answer::Remark => {}
            }
        }
    }

    /// Waits for this time or for an interrupt. Lines that arrive meanwhile are ignored.
    pub(super) fn idle(&mut self, time: Duration) -> Result<(), Error> {
        let until = Instant::now() + time;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(());
            }
            self.line(left)?;
        }
    }

    /// Writes and flushes a line.
    fn write(&mut self, line: &str) -> Result<(), Error> {
        self.port.write_all(line.as_bytes()).and_then(|()| self.port.flush()).map_err(|reason| self.gone(reason))
    }

    /// Next line. `None` after the timeout.
    fn line(&mut self, patience: Duration) -> Result<Option<String>, Error> {
        let deadline = Instant::now() + patience;
        let mut bytes = [0; 1024];
        loop {
            if self.stop.load(Ordering::Relaxed) {
                self.stop_at_once();
                return Err(Error::Interrupted);
            }
            if let Some(line) = self.waiting.pop_front() {
                return Ok(Some(line));
            }
            match self.port.read(&mut bytes) {
                Ok(0) => return Err(self.gone(io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => {
                    let waiting = &mut self.waiting;
                    let keep = |line: Line| waiting.push_back(String::from_utf8_lossy(line.bytes).into());
                    self.lines.push(&bytes[..count], keep);
                }
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => {
                    if Instant::now() >= deadline {
                        return Ok(None);
                    }
                }
                Err(error) => return Err(self.gone(error)),
            }
        }
    }

    /// Emergency stop: motors and heaters off. It needs no line number, and printers execute it before queued commands.
    pub(super) fn stop_at_once(&mut self) {
        // A vanished port cannot be written to; the caller reports the original error.
        let _ = self.port.write_all(b"M112\n").and_then(|()| self.port.flush());
    }

    fn gone(&self, reason: io::Error) -> Error {
        Error::Gone { port: self.name.clone(), after_s: self.opened.elapsed().as_secs_f64(), reason }
    }

    fn refused(&self, command: &str, answer: String) -> Error {
        let answer = shown(answer.as_bytes()).trim_matches('`').to_owned();
        Error::Refused { port: self.name.clone(), command: command.into(), answer }
    }

    fn no_answer(&self, command: &str, within: Duration) -> Error {
        Error::NoAnswer { port: self.name.clone(), command: command.into(), within_s: within.as_secs_f64() }
    }
}
