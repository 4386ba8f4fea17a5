//! Interrupts: Ctrl-C, a closed terminal and the other termination signals.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::Error;

/// Signals within this time count as one request: shells and wrappers forward a signal repeatedly, and the printer must
/// still be stopped.
const GRACE: Duration = Duration::from_secs(1);
/// Polling interval for the first signal.
const TICK: Duration = Duration::from_millis(50);

/// Flag that the first signal sets: SIGINT, SIGTERM or, unless the program was started to ignore it (`nohup`), SIGHUP.
/// A second signal after one second terminates the program immediately.
///
/// A write beyond the limit of a file's size returns an error from now on instead of ending the program (SIGXFSZ).
///
/// # Errors
/// If no handler can be installed or no thread started.
pub fn asked() -> Result<Arc<AtomicBool>, Error> {
    let (asked, insists) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    for signal in [SIGINT, SIGTERM].into_iter().chain(of_system::hang_up()) {
        flag::register_conditional_default(signal, insists.clone()).map_err(Error::system("interrupt"))?;
        flag::register(signal, asked.clone()).map_err(Error::system("interrupt"))?;
    }
    of_system::keep_file_size_errors().map_err(Error::system("interrupt"))?;
    let is_asked = asked.clone();
    let waits = move || {
        while !is_asked.load(Ordering::Relaxed) {
            thread::sleep(TICK);
        }
        thread::sleep(GRACE);
        insists.store(true, Ordering::Relaxed);
    };
    thread::Builder::new().name("interrupt".into()).spawn(waits).map_err(Error::system("thread of interrupts"))?;
    Ok(asked)
}

#[cfg(unix)]
mod of_system {
    use std::sync::Arc;
    use std::{fs, io};

    use signal_hook::consts::signal::{SIGHUP, SIGXFSZ};
    use signal_hook::flag;

    /// The signal of a closed terminal. `None` if the program was started to ignore it.
    pub(super) fn hang_up() -> Option<i32> {
        let is_ignored = ignored().is_some_and(|mask| (mask >> (SIGHUP - 1)) & 1 == 1);
        (!is_ignored).then_some(SIGHUP)
    }

    /// Mask of ignored signals. `None` where the system does not report it.
    fn ignored() -> Option<u64> {
        let status = fs::read_to_string("/proc/self/status").ok()?;
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    }

    /// Handles the signal, so that the write returns an error.
    pub(super) fn keep_file_size_errors() -> io::Result<()> {
        flag::register(SIGXFSZ, Arc::default()).map(drop)
    }
}

#[cfg(not(unix))]
mod of_system {
    use std::io;

    pub(super) fn hang_up() -> Option<i32> {
        None
    }

    pub(super) fn keep_file_size_errors() -> io::Result<()> {
        Ok(())
    }
}
