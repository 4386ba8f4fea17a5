//! JSON lines on stdin. Each whisker has a thread of its own, so that a new touch, whose first step takes long, delays no other.
//!
//! ```text
//! stdin -> lines with their arrival -> session -> worker of each whisker -> sink
//! ```
//!
//! | module | contents |
//! | --- | --- |
//! | `stdin` | lines with their arrival |
//! | `session` | whiskers by name; each line goes to the thread of its whisker |
//! | `worker` | thread that runs the estimator of a whisker |
//! | `method` | what estimators of the plane and of space have in common |
//! | `plane`, `space` | the two kinds: first lines, readings and counts |

mod method;
mod plane;
mod session;
mod space;
mod stdin;
mod worker;

use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Instant;

use anyhow::{Context, bail};
use live::Timing;
use live::wire::{Line, Written};
use serde_json::json;
use trace::is_spatial;

use super::blocked::Writing;
use super::sink::Sink;
use super::{Arguments, named};
use crate::commands::played::InSpace;
use method::{Answered, Method};
use plane::InPlane;
use session::{Session, Whisker};
use space::OfSpace;
use worker::locked;

/// Lines that are read ahead.
const AHEAD: usize = 1 << 12;

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
    thread::Builder::new().name("stdin".into()).spawn(move || stdin::read(&sender)).context("thread of stdin")?;
    let served = session.serve(&lines, stop);
    let waiting = session.waiting();
    let counts = session.end_workers()?;
    served?;
    locked(&session.sink).state_waiting(&waiting);
    Ok(locked(&session.sink).finish(&counts))
}

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
    // Less noise than any sensor has, so that it does not exceed the largest reading of any calibration.
    let first = json!({"protocol": T::PROTOCOL, "rate_hz": 250, "noise_sd_n_m": 1e-12}).to_string();
    let Ok(Line::Prior(prior)) = T::parse(&first) else { bail!("found no first line in `{first}`") };
    for whisker in whiskers {
        method.begin(&whisker.calibration, &whisker.path, &prior, timing)?;
    }
    Ok(())
}
