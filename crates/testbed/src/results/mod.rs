//! Files of a run under `results/<run>/`, from which alone the report is drawn.
//!
//! [`RUN_FILES`] lists them. The columns of a table are the fields of its row type; trials and summary have one further
//! column for each of [`METRICS`](crate::metrics::METRICS) ([`ScoreRow`]).
//!
//! To add a table: a row type in the file of its topic, and one row in [`RUN_FILES`].

mod contours;
mod estimates;
pub mod files;
mod key;
mod kind;
mod maps;
mod over_time;
mod quantities;
mod run;
mod scores;
mod sensor_model;
mod sensors;
mod table;

pub use contours::{ContourScoreRow, ContourTrialRow, VertexRow};
pub use estimates::{BoundRow, EstimateRow, EventRow, estimate_row};
pub use files::{RUN_FILES, RunFile, RunNames};
pub use key::{Keyed, SetKey, SetName};
pub use kind::ResultsKind;
pub use maps::{GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow};
pub use over_time::{ConsistencyRow, ErrorBandRow};
pub use quantities::QuantityRow;
pub use run::{RECOMMENDED, Run, RunCalibration, RunEstimator, RunMounted, RunRecording, RunSet};
pub use scores::{FailureRow, ScoreRow, SummaryHead, SummaryRow, TrialHead, TrialRow, read_scores, score_bytes};
pub use sensor_model::{ResidualRow, SurfaceRow, face_stem};
pub use sensors::{TransferRow, TurnRow};
pub use table::{Table, TableFile, csv_bytes, read_rows, write_rows};
