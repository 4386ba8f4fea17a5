//! Targets: one file each, and one row in [`TARGETS`].

mod answer;
mod bag;
mod calibration;
mod contact_mapping;
mod import;
mod log;
mod mapping;
mod outline;
mod platform_calibration;
mod printer;
mod recording;
mod results;
mod rig;
mod run;
mod sensor;
mod settings;
mod sidecar;
mod spatial;
mod stream;
mod suite;
mod surface;
mod trace;

/// Parser of untrusted input.
pub struct Target {
    /// Name of the target and of its folder in the corpus.
    pub name: &'static str,
    /// Input format.
    pub about: &'static str,
    /// Runs the parser on the bytes. Panics if a property is violated.
    pub run: fn(&[u8]),
}

#[rustfmt::skip]
/// Registry of targets.
pub const TARGETS: &[Target] = &[
    Target { name: "trace", about: "table of a trace", run: trace::run },
    Target { name: "sidecar", about: "sidecar of a trace", run: sidecar::run },
    Target { name: "spatial", about: "trace in space: sidecar and table", run: spatial::run },
    Target { name: "outline", about: "outline of an object", run: outline::run },
    Target { name: "recording", about: "array recording: sidecar, joint table and pose table", run: recording::run },
    Target { name: "suite", about: "suite and one of its scenes", run: suite::run },
    Target { name: "calibration", about: "calibration of a whisker", run: calibration::run },
    Target { name: "import", about: "published recordings: calibration, test and mesh", run: import::run },
    Target { name: "mapping", about: "mapping of own recordings, with a CSV and an MCAP file", run: mapping::run },
    Target { name: "run", about: "description of a run", run: run::run },
    Target { name: "results", about: "tables of a run", run: results::run },
    Target { name: "surface", about: "surface of a map: PLY file of a triangle mesh", run: surface::run },
    Target { name: "settings", about: "settings of estimators, front ends, detection and maps", run: settings::run },
    Target { name: "stream", about: "line of a live stream", run: stream::run },
    Target { name: "contact_mapping", about: "mapping of ROS 2 topics to whiskers, with a URDF", run: contact_mapping::run },
    Target { name: "answer", about: "answer of an external program", run: answer::run },
    Target { name: "bag", about: "ROS 2 bag: metadata and MCAP file", run: bag::run },
    Target { name: "sensor", about: "serial stream of a magnetometer", run: sensor::run },
    Target { name: "printer", about: "replies of a printer", run: printer::run },
    Target { name: "platform_calibration", about: "calibration of the platform", run: platform_calibration::run },
    Target { name: "rig", about: "rig of the platform", run: rig::run },
    Target { name: "log", about: "recorded log: table, sidecar and manifest", run: log::run },
];
