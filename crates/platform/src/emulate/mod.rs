//! Emulation of the rig: a printer and a magnetometer on two pseudo-terminals.
//!
//! The printer simulates the motion of the head. The sensor computes the deflection of the whisker by the ruler from it
//! and prints readings at the magnetometer's rate.

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
use crate::rig::Rig;
use crate::sensor::FormatRow;

/// Settings of an emulation.
#[derive(Clone, Debug)]
pub struct Emulated {
    /// Geometry of the rig.
    pub rig: Arc<Rig>,
    /// Physics of its whisker.
    pub table: Arc<RigTable>,
    /// Line format of the sensor.
    pub format: &'static FormatRow,
    /// Seed of the sensor's noise.
    pub seed: u64,
}

/// Statistics of the sensor's port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Number of readings printed while the port was open.
    pub readings: u64,
    /// Number of readings dropped because the buffer was full.
    pub dropped: u64,
}

/// A running emulation of printer and sensor.
#[derive(Debug)]
pub struct Emulation {
    /// Port of the printer.
    pub printer: PathBuf,
    /// Port of the sensor.
    pub sensor: PathBuf,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<Result<(), Error>>>,
    /// Symbolic links, each with its target.
    links: Vec<(PathBuf, PathBuf)>,
}

/// State shared by the two threads.
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
    /// Starts an emulation.
    ///
    /// # Errors
    /// If the table is not that of the rig's whisker, or no pseudo-terminal or thread can be created.
    pub fn start(emulated: &Emulated) -> Result<Self, Error> {
        emulated.table.check_is_of(&emulated.rig.shaft)?;
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
        let bed = emulated.rig.bed;
        emulation.spawn("printer", move || printer::run(&printer, bed, &of_printer))?;
        let emulated = emulated.clone();
        emulation.spawn("sensor", move || sensor::run(&sensor, &emulated, &shared))?;
        Ok(emulation)
    }

    fn spawn(&mut self, name: &str, run: impl FnOnce() -> Result<(), Error> + Send + 'static) -> Result<(), Error> {
        let thread = std::thread::Builder::new().name(name.into()).spawn(run);
        self.threads.push(thread.map_err(Error::system(format!("thread of the {name}")))?);
        Ok(())
    }

    /// Creates a symbolic link to a port for the duration of the emulation. An existing link is replaced, another file is not.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn link(&mut self, port: &Path, link: &Path) -> Result<(), Error> {
        if link.symlink_metadata().is_ok_and(|found| found.is_symlink()) {
            std::fs::remove_file(link).map_err(Error::file(link))?;
        }
        std::os::unix::fs::symlink(port, link).map_err(Error::file(link))?;
        self.links.push((link.into(), port.into()));
        Ok(())
    }

    /// Whether both devices are running.
    pub fn is_alive(&self) -> bool {
        self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// Statistics of the sensor's port so far.
    pub fn sent(&self) -> Sent {
        let Shared { readings, dropped, .. } = &*self.shared;
        Sent { readings: readings.load(Ordering::Relaxed), dropped: dropped.load(Ordering::Relaxed) }
    }

    /// Removes both ports, as if their cables were pulled.
    pub fn unplug(&self) {
        self.shared.ends.store(true, Ordering::Relaxed);
    }

    /// Ends the emulation.
    ///
    /// # Errors
    /// Error of a failed device.
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
            // Errors of devices are reported by `finish` only.
            let _ = thread.join();
        }
        for (link, port) in &self.links {
            // A link with another target belongs to another program.
            if std::fs::read_link(link).is_ok_and(|target| target == *port) {
                // It may have been removed already.
                let _ = std::fs::remove_file(link);
            }
        }
    }
}
