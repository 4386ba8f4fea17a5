//! Conversion of recordings of real sensors into traces.
//!
//! `csv` and `bag` read the recordings of any laboratory by a mapping file that names columns, units and frames. Other
//! importers read the layout in which a group publishes its data. All return [`Trace`]s with their units, frames and
//! provenance, so that estimators run on them as on simulated traces. If the position of the whisker on the rig is not
//! documented, it is estimated from the calibration (registration). To add a format, add one file with an import
//! function and one row in [`IMPORTERS`].
//!
//! # Example: root moment of a pressed whisker from raw counts
//!
//! A folder in the layout of `stanford-whisker` contains the calibration of a Hall sensor: the position of a pin (mm) and
//! the reading (counts) at each point of a grid. The readings in this example are computed for a known wire and a sensor of
//! -20 counts per micronewton metre. The import estimates the wire's pose, its shape and the characteristic of the sensor,
//! and converts the counts into moments:
//!
//! ```
//! use std::fmt::Write as _;
//!
//! use whisker::elastica::Elastica;
//! use whisker::frames::{Base, Point, Pose, World};
//! use whisker::{Curvature, Whisker};
//!
//! let curvature = [(0.034, 0.0), (0.011, -48.0), (0.011, -48.0)];
//! let wire = Whisker {
//!     name: "wire".into(),
//!     length_m: 0.056,
//!     root_diameter_m: 0.2e-3,
//!     tip_diameter_m: 0.2e-3,
//!     youngs_modulus_pa: 40e9,
//!     density_kg_m3: 6450.0,
//!     curvature: curvature.map(|(length_m, curvature_per_m)| Curvature { length_m, curvature_per_m }).into(),
//!     root_stiffness_n_m_rad: 0.17e-3,
//!     segments: 40,
//!     damping_s: 0.0,
//! };
//! let elastica = Elastica::new(&wire)?;
//! let base: Pose<Base, World> = Pose::new(0.001, 0.0055, -1.85);
//! // Grid of pin positions beside the wire, from the free whisker on.
//! let mut table = String::from(",px,py,pz,sx,sy,sz\n0,74.3,98.07,16.1,90,-40,-550\n");
//! let mut largest_n_m: f64 = 0.0;
//! for (row, arc_m) in (0..9).map(|i| 0.012 + 0.004 * f64::from(i)).enumerate() {
//!     for away_m in (1..8).map(|j| 0.001 * f64::from(j)) {
//!         let pin = wire.rest_shape().beside(arc_m, -away_m);
//!         let Ok(contact) = elastica.at_point(pin) else { continue };
//!         let moment_n_m = contact.deflection.moment_n_m;
//!         largest_n_m = largest_n_m.max(moment_n_m.abs());
//!         let pin = base.apply(pin);
//!         let (x_mm, y_mm) = (64.30451325 + 1e3 * pin.x(), 98.0687005 + 1e3 * pin.y());
//!         writeln!(table, "{row},{x_mm},{y_mm},16.1,90,{},-550", -40.0 - 2e7 * moment_n_m)?;
//!     }
//! }
//! let home = tempfile::tempdir()?;
//! let data = home.path().join("data/all_datasets");
//! std::fs::create_dir_all(data.join("calibration"))?;
//! std::fs::create_dir_all(data.join("test"))?;
//! std::fs::write(data.join("calibration/sensor1_tip_calib_May_04.csv"), table)?;
//!
//! let importer = importers::importer("stanford-whisker").expect("a registered format");
//! let imported = (importer.import)(home.path(), &|_, _| {})?;
//! assert!(imported.failures.is_empty());
//! let moments = imported.traces.iter().flat_map(|trace| &trace.recording.instants).map(|at| at.moment_z_n_m.abs());
//! let found_n_m = moments.fold(0.0, f64::max);
//! assert!((found_n_m / largest_n_m - 1.0).abs() < 0.05, "{found_n_m} N m, expected {largest_n_m} N m");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`Trace`]: trace::Trace

mod mesh;
mod own;
mod provenance;
mod registration;
mod stanford_whisker;

use std::path::Path;

use files::Error;
use trace::{Outline, SpatialTrace, Trace};

pub use mesh::Triangle;
pub use stanford_whisker::space::{
    Labelled, SpatialCalibration, SpatialRecordings, SpatialSweep, SpatialTrial, Wire, stanford_in_space,
};

/// Default Poisson ratio of a wire: that of nitinol.
const POISSON_RATIO: f64 = 0.33;

/// Largest reading of a sensor (counts).
const MOST_COUNTS: f64 = 1e10;

/// Entry of the registry of importers.
pub struct ImporterRow {
    /// Name of the format.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Imports a mapping file, or a folder in the published layout.
    pub import: Import,
    /// Imports recordings in space.
    pub import_in_space: Import,
}

/// Imports the recordings of a path.
pub type Import = fn(&Path, Progress<'_>) -> Result<Imported, Error>;

/// Receives the number of files that are done, and of all files.
pub type Progress<'a> = &'a dyn Fn(u64, u64);

/// Result of an import.
#[derive(Debug, Default)]
pub struct Imported {
    /// Imported planar traces.
    pub traces: Vec<Trace>,
    /// Imported traces in space.
    pub spatial_traces: Vec<SpatialTrace>,
    /// Outlines of the traces' objects, each with the file name given in the trace's sidecar.
    pub outlines: Vec<(String, Outline)>,
    /// Remarks about recordings, for example that they were interpolated.
    pub notes: Vec<String>,
    /// Remarks that the result is probably wrong.
    pub warnings: Vec<String>,
    /// Errors of the files that could not be imported. The other files do not depend on them.
    pub failures: Vec<Error>,
}

/// Registry of importers.
pub const IMPORTERS: &[ImporterRow] = &[
    ImporterRow {
        name: own::columns::NAME,
        about: "CSV files of any laboratory, by a mapping file (docs/own-data.md)",
        import: own::import_columns,
        import_in_space: own::import_columns_in_space,
    },
    ImporterRow {
        name: own::topics::NAME,
        about: "rosbag2 folders and MCAP files of any robot, by a mapping file (docs/own-data.md)",
        import: own::import_topics,
        import_in_space: own::import_topics_in_space,
    },
    ImporterRow {
        name: stanford_whisker::NAME,
        about: "HaoLiRobo/WhiskerSensing (Li et al. 2024): calibrations, pin trials and object sweeps, planar or in space",
        import: stanford_whisker::import,
        import_in_space: stanford_whisker::space::traces::import,
    },
];

/// Entry with this name. `None` if there is none.
pub fn importer(name: &str) -> Option<&'static ImporterRow> {
    IMPORTERS.iter().find(|row| row.name == name)
}
