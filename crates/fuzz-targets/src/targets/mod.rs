//! The targets: one file each, and one row in [`TARGETS`].

mod answer;
mod bag;
mod calibration;
mod import;
mod log;
mod outline;
mod platform_calibration;
mod printer;
mod recording;
mod results;
mod run;
mod sensor;
mod settings;
mod sidecar;
mod suite;
mod trace;

/// A parser that is given any bytes.
pub struct Target {
    /// Its name, and that of its folder in the corpus.
    pub name: &'static str,
    /// What the bytes stand for.
    pub about: &'static str,
    /// Gives it the bytes; panics where it does not do what every parser must.
    pub run: fn(&[u8]),
}

#[rustfmt::skip]
/// The registry of targets.
pub const TARGETS: &[Target] = &[
    Target { name: "trace", about: "table of a trace", run: trace::run },
    Target { name: "sidecar", about: "sidecar of a trace", run: sidecar::run },
    Target { name: "outline", about: "outline of an object", run: outline::run },
    Target { name: "recording", about: "recording of several whiskers: its file, the joints' table and the objects'", run: recording::run },
    Target { name: "suite", about: "suite, and a scene of it", run: suite::run },
    Target { name: "calibration", about: "calibration of a whisker", run: calibration::run },
    Target { name: "import", about: "recordings of others: calibration, test and mesh", run: import::run },
    Target { name: "run", about: "description of a run", run: run::run },
    Target { name: "results", about: "tables of a run", run: results::run },
    Target { name: "settings", about: "settings of estimators, front ends, detection and maps", run: settings::run },
    Target { name: "answer", about: "answer of a program that takes part", run: answer::run },
    Target { name: "bag", about: "recording of messages: metadata and MCAP file, which becomes a trace or a log", run: bag::run },
    Target { name: "sensor", about: "what comes over a magnetometer's port", run: sensor::run },
    Target { name: "printer", about: "what a printer answers", run: printer::run },
    Target { name: "platform_calibration", about: "calibration of the platform", run: platform_calibration::run },
    Target { name: "log", about: "recorded log: table, sidecar and manifest", run: log::run },
];
