//! Long computations that release the interpreter lock and that Ctrl-C ends.

use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::error::raised;

/// Time between two checks for signals.
const SLICE: Duration = Duration::from_millis(50);

/// Number of steps between two readings of the clock.
const BLOCK: usize = 32;

/// Runs the steps 0 to `count - 1` in their order without the interpreter lock, and checks for signals between slices of
/// time.
///
/// # Errors
/// The exception of the first step that fails, or that of a signal handler (`KeyboardInterrupt`).
pub(crate) fn each(
    py: Python<'_>,
    count: usize,
    mut step: impl FnMut(usize) -> anyhow::Result<()> + Send,
) -> PyResult<()> {
    let mut done = 0;
    while done < count {
        done = py.detach(|| slice(done, count, &mut step)).map_err(raised)?;
        py.check_signals()?;
    }
    Ok(())
}

/// Runs steps for one slice of time and returns the next.
fn slice(mut next: usize, count: usize, step: &mut impl FnMut(usize) -> anyhow::Result<()>) -> anyhow::Result<usize> {
    let start = Instant::now();
    while next < count && start.elapsed() < SLICE {
        let end = count.min(next + BLOCK);
        for index in next..end {
            step(index)?;
        }
        next = end;
    }
    Ok(next)
}
