//! A printer and a magnetometer that are not there: two pseudo-terminals, and the rig between them.
//!
//! The printer keeps the head's way in time. The sensor asks it where the ruler is, lets the whisker be bent by it, and prints what the
//! magnetometer would, at its rate.

mod closings;
mod firmware;
mod motion;
mod printer;
mod pty;
mod sensor;
mod table;
mod whisker;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use motion::Motion;
use pty::Pty;
pub use table::RigTable;

use crate::Error;
use crate::sensor::FormatRow;

/// What is emulated.
#[derive(Clone, Debug)]
pub struct Emulated {
    /// The rig's physics.
    pub rig: Arc<RigTable>,
    /// What the sensor prints.
    pub format: &'static FormatRow,
    /// Seed of its noise.
    pub seed: u64,
}

/// What went over the sensor's port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Readings that were printed while somebody listened.
    pub readings: u64,
    /// Readings for which there was no room, because whoever listens does not read.
    pub dropped: u64,
}

/// A printer and a sensor, running until they are stopped.
#[derive(Debug)]
pub struct Emulation {
    /// Port of the printer.
    pub printer: PathBuf,
    /// Port of the sensor.
    pub sensor: PathBuf,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<Result<(), Error>>>,
    /// Links that were made, and the port that each leads to.
    links: Vec<(PathBuf, PathBuf)>,
}

/// What the two threads share.
#[derive(Debug)]
struct Shared {
    origin: Instant,
    motion: Mutex<Motion>,
    ends: AtomicBool,
    readings: AtomicU64,
    dropped: AtomicU64,
}

impl Shared {
    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}

impl Emulation {
    /// Begins.
    ///
    /// # Errors
    /// If the system gives no pseudo-terminals or threads.
    pub fn start(emulated: &Emulated) -> Result<Self, Error> {
        let [printer, sensor] = [Pty::open()?, Pty::open()?];
        let (printer_path, sensor_path) = (printer.path.clone(), sensor.path.clone());
        let shared = Arc::new(Shared {
            origin: Instant::now(),
            motion: Mutex::default(),
            ends: AtomicBool::new(false),
            readings: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
        });
        let mut emulation = Self {
            printer: printer_path,
            sensor: sensor_path,
            shared: shared.clone(),
            threads: Vec::new(),
            links: Vec::new(),
        };
        let of_printer = shared.clone();
        emulation.spawn("printer", move || printer::run(&printer, &of_printer))?;
        let emulated = emulated.clone();
        emulation.spawn("sensor", move || sensor::run(&sensor, &emulated, &shared))?;
        Ok(emulation)
    }

    fn spawn(&mut self, name: &str, run: impl FnOnce() -> Result<(), Error> + Send + 'static) -> Result<(), Error> {
        let thread = std::thread::Builder::new().name(name.into()).spawn(run);
        self.threads.push(thread.map_err(Error::system(format!("thread of the {name}")))?);
        Ok(())
    }

    /// Makes a symbolic link to a port, which lasts as long as the emulation. A link that is there is replaced, another file is not.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn link(&mut self, port: &Path, link: &Path) -> Result<(), Error> {
        if link.symlink_metadata().is_ok_and(|found| found.is_symlink()) {
            std::fs::remove_file(link).map_err(Error::file(link))?;
        }
        std::os::unix::fs::symlink(port, link).map_err(Error::file(link))?;
        self.links.push((link.into(), port.into()));
        Ok(())
    }

    /// Whether both devices still run.
    pub fn is_alive(&self) -> bool {
        self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// What went over the sensor's port so far.
    pub fn sent(&self) -> Sent {
        let Shared { readings, dropped, .. } = &*self.shared;
        Sent { readings: readings.load(Ordering::Relaxed), dropped: dropped.load(Ordering::Relaxed) }
    }

    /// Pulls both cables: the ports vanish.
    pub fn unplug(&self) {
        self.shared.ends.store(true, Ordering::Relaxed);
    }

    /// Ends it.
    ///
    /// # Errors
    /// What made a device fail, if one did.
    pub fn finish(mut self) -> Result<Sent, Error> {
        self.unplug();
        for thread in self.threads.drain(..) {
            thread.join().expect("the devices do not panic")?;
        }
        Ok(self.sent())
    }
}

impl Drop for Emulation {
    fn drop(&mut self) {
        self.unplug();
        for thread in self.threads.drain(..) {
            // What a device failed of is for those who ask.
            let _ = thread.join();
        }
        for (link, port) in &self.links {
            // One that leads elsewhere by now is another's.
            if std::fs::read_link(link).is_ok_and(|target| target == *port) {
                // One that is gone need not go.
                let _ = std::fs::remove_file(link);
            }
        }
    }
}
