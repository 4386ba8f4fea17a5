//! Traces that a calibration is fitted to, in the plane or in space.

use std::path::Path;

use files::{Digest, Error};

use crate::{CalibrationFile, Role, Sidecar, SpatialCalibrationFile, SpatialSidecar};

/// Traces that a calibration was fitted to, as its file states them.
#[derive(Clone, Copy, Debug)]
pub struct FittedTraces<'a> {
    /// Name of the whisker that was calibrated.
    pub whisker: &'a str,
    /// Names of the traces.
    pub traces: &'a [String],
    /// Hash of their data, see [`data_sha256`].
    pub data_sha256: &'a str,
    /// Reads the sidecar of a trace with this CSV or sidecar path.
    pub read: fn(&Path) -> Result<TraceData, Error>,
}

impl<'a> From<&'a CalibrationFile> for FittedTraces<'a> {
    fn from(file: &'a CalibrationFile) -> Self {
        let CalibrationFile { whisker, traces, data_sha256, .. } = file;
        Self { whisker: &whisker.name, traces, data_sha256, read: |path| Ok(Sidecar::read(path)?.into()) }
    }
}

impl<'a> From<&'a SpatialCalibrationFile> for FittedTraces<'a> {
    fn from(file: &'a SpatialCalibrationFile) -> Self {
        let SpatialCalibrationFile { whisker, traces, data_sha256, .. } = file;
        Self { whisker: &whisker.name, traces, data_sha256, read: |path| Ok(SpatialSidecar::read(path)?.into()) }
    }
}

/// Description of a trace as data of a fit.
#[derive(Clone, Debug)]
pub struct TraceData {
    /// Name of the trace.
    pub name: String,
    /// Purpose of the trace.
    pub role: Role,
    /// Name of the whisker.
    pub whisker: String,
    /// Name and SHA-256 of each file beside the sidecar.
    pub files: Vec<(String, String)>,
    /// Hash of everything that a result from the trace may depend on.
    pub sha256: String,
}

impl From<Sidecar> for TraceData {
    fn from(sidecar: Sidecar) -> Self {
        let sha256 = sidecar.data_sha256();
        let Sidecar { name, role, whisker, csv_sha256, contour, .. } = sidecar;
        let contour = contour.map(|contour| (contour.file, contour.sha256));
        let files = [(format!("{name}.csv"), csv_sha256)].into_iter().chain(contour).collect();
        Self { name, role, whisker: whisker.name, files, sha256 }
    }
}

impl From<SpatialSidecar> for TraceData {
    fn from(sidecar: SpatialSidecar) -> Self {
        let sha256 = sidecar.data_sha256();
        let SpatialSidecar { name, role, whisker, csv_sha256, .. } = sidecar;
        Self { files: vec![(format!("{name}.csv"), csv_sha256)], name, role, whisker: whisker.name, sha256 }
    }
}

/// Hash of the data of several traces from those of each, in this order.
pub fn data_sha256(traces: impl IntoIterator<Item = String>) -> String {
    let mut data = Digest::default();
    for sha256 in traces {
        data.add(sha256);
    }
    data.finish()
}
