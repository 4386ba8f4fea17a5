//! The thread of a whisker, which runs its estimator.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use live::wire::Written;
use live::{Counters, Kind, LiveEstimator, Motion, Output};

use super::method::{Answered, Method, Taken};
use crate::commands::live::sink::Sink;

/// Longest wait of a whisker without a waiting reading.
const IDLE: Duration = Duration::from_secs(1);

/// A converted reading, a pose, or both, with their time and arrival.
pub(super) struct Sample<K: Kind> {
    pub(super) t_s: f64,
    pub(super) reading: Option<Taken<K::Reading>>,
    pub(super) base: Option<K::Base>,
    pub(super) at_s: f64,
}

/// Conversion of the readings of a whisker, and the thread that runs its estimator.
pub(super) struct Worker<T: Method> {
    pub(super) conversion: T::Conversion,
    pub(super) samples: SyncSender<Sample<T::Kind>>,
    pub(super) thread: JoinHandle<anyhow::Result<Counters>>,
}

/// Exclusive use of the sink.
pub(super) fn locked(sink: &Mutex<Sink>) -> MutexGuard<'_, Sink> {
    sink.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs the estimator of a whisker on its samples, until their sender is gone. Returns the counts.
pub(super) fn work<K: Kind, M: Motion<Measured = K::Base, Base = K::Base>>(
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
