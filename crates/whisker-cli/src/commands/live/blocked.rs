//! End of the command after an interrupt although nothing reads its output.

use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;

use crate::commands::diagnose;

/// Longest duration of a write after an interrupt.
const PATIENCE: Duration = Duration::from_secs(1);

/// Interval at which the writes are checked.
const TICK: Duration = Duration::from_millis(50);

/// Longest time for the error, which is not shown if stderr is not read either.
const LAST_WORDS: Duration = Duration::from_millis(200);

/// Exit code of errors.
const FAILURE: i32 = 1;

/// Number of begun and ended writes: odd during a write.
#[derive(Clone, Debug, Default)]
pub(super) struct Writing(Arc<AtomicU64>);

/// A write in progress.
pub(super) struct Write(Arc<AtomicU64>);

impl Writing {
    /// Writes that are watched: after `stop` is set, one that is blocked ends the program with an error.
    pub(super) fn watched(stop: Arc<AtomicBool>) -> anyhow::Result<Self> {
        let writing = Self::default();
        let Self(count) = writing.clone();
        let watch = move || {
            while !stop.load(Ordering::Relaxed) {
                thread::sleep(TICK);
            }
            let (mut last, mut since) = (count.load(Ordering::Relaxed), Instant::now());
            loop {
                thread::sleep(TICK);
                let now = count.load(Ordering::Relaxed);
                if now != last || now % 2 == 0 {
                    (last, since) = (now, Instant::now());
                } else if since.elapsed() >= PATIENCE {
                    end();
                }
            }
        };
        thread::Builder::new().name("blocked output".into()).spawn(watch).context("thread of the output")?;
        Ok(writing)
    }

    /// Begins a write, which ends when the value is dropped.
    pub(super) fn begin(&self) -> Write {
        self.0.fetch_add(1, Ordering::Relaxed);
        Write(self.0.clone())
    }
}

impl Drop for Write {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

fn end() -> ! {
    let error = "error: stdout: found a reader that does not read, expected one that takes the answers until the end; the last ones are lost";
    // Writing the error may be blocked too.
    thread::spawn(move || diagnose(error));
    thread::sleep(LAST_WORDS);
    process::exit(FAILURE)
}
