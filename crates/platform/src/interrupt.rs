//! Ctrl-C, and whoever else asks the program to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::Error;

/// What comes within this time is the same request: shells and wrappers hand a signal on more than once, and the printer is to be told to stop.
const GRACE: Duration = Duration::from_secs(1);
/// How soon the time begins to count.
const TICK: Duration = Duration::from_millis(50);

/// Is set once somebody asks the program to end. Who asks again a second later ends it the hard way.
///
/// # Errors
/// If the system takes no handlers or gives no thread.
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
