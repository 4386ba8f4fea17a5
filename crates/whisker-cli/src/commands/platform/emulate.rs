//! `whisker platform emulate`: a printer and a magnetometer on pseudo-terminals.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use platform::emulate::{Emulated, Emulation, RigTable};
use platform::interrupt;

use super::{format, rig};
use crate::commands::print;

/// Polling interval of interrupts.
const TICK: Duration = Duration::from_millis(50);

/// Emulate a printer and a magnetometer on two pseudo-terminals until interrupted
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Symbolic link to create to the printer's port
    #[arg(long)]
    printer_link: Option<PathBuf>,
    /// Symbolic link to create to the magnetometer's port
    #[arg(long)]
    sensor_link: Option<PathBuf>,
    /// Line format of the magnetometer; `whisker platform list` names the formats
    #[arg(long, default_value = "hex")]
    format: String,
    /// Geometry of the rig, such as rigs/openwhisker.json [default: that one, which is built in]
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Seed of the magnetometer's noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Duration in seconds [default: until interrupted]
    #[arg(long)]
    seconds: Option<u32>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let format = format(&arguments.format)?;
    let stop = interrupt::asked()?;
    let (rig, table) = (Arc::new(rig(arguments.rig.as_deref())?), Arc::new(RigTable::built_in()));
    let mut emulation = Emulation::start(&Emulated { rig, table, format, seed: arguments.seed })?;
    let (printer, sensor) = (emulation.printer.clone(), emulation.sensor.clone());
    for (port, link) in [(&printer, &arguments.printer_link), (&sensor, &arguments.sensor_link)] {
        if let Some(link) = link {
            emulation.link(port, link)?;
        }
    }
    print(&format!("printer {}\nsensor {}\n", printer.display(), sensor.display()))?;
    let began = Instant::now();
    let is_over = || arguments.seconds.is_some_and(|seconds| began.elapsed() >= Duration::from_secs(seconds.into()));
    while emulation.is_alive() && !stop.load(Ordering::Relaxed) && !is_over() {
        thread::sleep(TICK);
    }
    let sent = emulation.finish()?;
    print(&format!("readings {}\ndropped {}\n", sent.readings, sent.dropped))?;
    Ok(ExitCode::SUCCESS)
}
