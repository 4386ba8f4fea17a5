//! Ends the command after an interrupt even if nothing reads its output.

use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;

use crate::commands::diagnose;

/// Longest duration of a write after an interrupt.
const PATIENCE: Duration = Duration::from_secs(1);

/// Interval at which the writes are checked.
const TICK: Duration = Duration::from_millis(50);

/// Longest time for the error, which is not shown if stderr is not read either.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Exit code of errors.
const FAILURE: i32 = 1;

/// Stream of the output.
#[derive(Clone, Copy, Debug)]
pub(super) enum Stream {
    /// That of the answers.
    Stdout,
    /// That of the notes.
    Stderr,
}

/// The write in progress: its stream and its beginning. There is at most one at a time.
#[derive(Clone, Debug, Default)]
pub(super) struct Writing(Arc<Mutex<Option<(Stream, Instant)>>>);

/// A write in progress.
pub(super) struct Write<'a>(&'a Writing);

impl Writing {
    /// Writes that are watched: after `stop` is set, one that is blocked ends the program with an error.
    pub(super) fn watched(stop: Arc<AtomicBool>) -> anyhow::Result<Self> {
        let writing = Self::default();
        let watched = writing.clone();
        let watch = move || {
            while !stop.load(Ordering::Relaxed) {
                thread::sleep(TICK);
            }
            let stopped = Instant::now();
            loop {
                thread::sleep(TICK);
                let write = *watched.current();
                if let Some((stream, begun)) = write
                    && begun.max(stopped).elapsed() >= PATIENCE
                {
                    end(stream);
                }
            }
        };
        thread::Builder::new().name("blocked output".into()).spawn(watch).context("thread of the output")?;
        Ok(writing)
    }

    /// Begins a write, which ends when the value is dropped.
    pub(super) fn begin(&self, stream: Stream) -> Write<'_> {
        *self.current() = Some((stream, Instant::now()));
        Write(self)
    }

    fn current(&self) -> MutexGuard<'_, Option<(Stream, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Write<'_> {
    fn drop(&mut self) {
        *self.0.current() = None;
    }
}

fn end(stream: Stream) -> ! {
    let (name, content) = match stream {
        Stream::Stdout => ("stdout", "answers"),
        Stream::Stderr => ("stderr", "notes"),
    };
    let error = format!(
        "error: {name}: found a reader that has stopped reading, expected one that reads all {content}; the last {content} are lost"
    );
    let (shown, is_shown) = channel();
    // Writing the error may be blocked too.
    let show = move || {
        diagnose(&error);
        shown.send(())
    };
    // The program ends whether the error is shown or not.
    let _ = thread::Builder::new().spawn(show);
    let _ = is_shown.recv_timeout(LAST_WORDS);
    process::exit(FAILURE)
}
