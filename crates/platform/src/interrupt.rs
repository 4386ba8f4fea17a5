//! Interrupts: Ctrl-C and the other termination signals.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::Error;

/// Signals within this time count as one request: shells and wrappers forward a signal repeatedly, and the printer must still be stopped.
const GRACE: Duration = Duration::from_secs(1);
/// Polling interval for the first signal.
const TICK: Duration = Duration::from_millis(50);

/// Flag that the first signal sets. A second signal after one second terminates the program immediately.
///
/// # Errors
/// If no handler can be installed or no thread started.
pub fn asked() -> Result<Arc<AtomicBool>, Error> {
    let (asked, insists) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    for signal in [SIGINT, SIGTERM] {
        flag::register_conditional_default(signal, insists.clone()).map_err(Error::system("interrupt"))?;
        flag::register(signal, asked.clone()).map_err(Error::system("interrupt"))?;
    }
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
