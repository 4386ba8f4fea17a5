//! Conversion of traces and logs of the platform to ROS 2 recordings, and back.
//!
//! A trace becomes standard messages, one for each quantity and instant; an unknown quantity has no message. Time
//! counts from the beginning of the trace. Sidecar and outline are attachments, so that the trace is restored byte for
//! byte. `docs/ROS.md` has the table.
//!
//! | module | contents |
//! | --- | --- |
//! | `plane`, `space` | traces as recordings, and back |
//! | `array` | recordings of several whiskers |
//! | `log` | logs of the platform from readings of a magnetometer |
//! | `rows`, `truth_topics` | rows of a trace as messages of the same time; topics of the truth |
//! | `estimates` | estimates that are exported with a trace |
//! | `staging`, `restore` | writing of recordings, and of the files that are restored from them |

mod array;
mod estimates;
mod log;
mod plane;
mod restore;
mod rows;
mod space;
mod staging;
mod truth_topics;

use std::fs;
use std::path::{Path, PathBuf};

use bag::Reader;
use platform::record::LogSidecar;
use platform::streams::SIDECAR;
use serde_json::Value;
use trace::SPATIAL_FORMAT;

use log::import_readings;
use plane::import_trace;
use restore::parsed;
use space::import_spatial_trace;

pub use array::export_array;
pub use plane::export_trace;
pub use space::export_spatial_trace;
pub use staging::Export;

/// Converts a recording to a trace, if it contains one, else to a log of the platform with the magnetometer's readings.
/// Returns the files written.
///
/// With `salvage` an interrupted recording is converted up to its end.
///
/// # Errors
/// If the recording cannot be read, or contains neither.
pub fn import(path: &Path, salvage: bool, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let reader = Reader::open(path)?;
    // An interrupted recording has no metadata at its end.
    let attachments = if salvage { reader.attachments().unwrap_or_default() } else { reader.attachments()? };
    for attachment in &attachments {
        if let Ok(sidecar) = serde_json::from_slice::<Value>(&attachment.data)
            && sidecar["kind"] == "trace"
        {
            if sidecar["format"] == SPATIAL_FORMAT {
                return import_spatial_trace(path, &reader, attachment, folder);
            }
            return import_trace(path, &reader, attachment, &attachments, folder);
        }
    }
    let sidecar = attachments.iter().find(|attachment| attachment.name == SIDECAR);
    if let Some(attachment) = sidecar {
        parsed::<LogSidecar>(path, attachment)?;
    }
    import_readings(path, &reader, sidecar, salvage, folder)
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    Ok(fs::read(path).map_err(files::Error::io(path))?)
}
