//! Trace in space: sidecar and table, with the row count and hash of that table.

use files::sha256;
use serde_json::{Value, json};
use strict_json::parse_json;
use trace::{SpatialTrace, is_spatial};

use crate::properties::{lines, one_error};
use crate::scratch;

const NAME: &str = "golden_space";

pub(super) fn run(bytes: &[u8]) {
    let [sidecar, table] = scratch::parts(bytes);
    let rows = lines(table).len().saturating_sub(1);
    let sidecar = match parse_json::<Value>(sidecar) {
        Ok(Value::Object(mut keys)) => {
            keys.insert("rows".into(), json!(rows));
            keys.insert("csv_sha256".into(), json!(sha256(table)));
            Value::Object(keys).to_string().into_bytes()
        }
        _ => sidecar.to_vec(),
    };
    let path = scratch::file(&format!("{NAME}.json"), sidecar);
    scratch::file(&format!("{NAME}.csv"), table);
    one_error(is_spatial(&path), NAME);
    let Some(trace) = one_error(SpatialTrace::read(&path), NAME) else { return };
    assert_eq!(trace.recording.instants.len(), rows);
    trace.sidecar.certificate.as_ref().map(trace::SpatialCertificate::breaches);
    let is_fine = |pair: &[trace::SpatialInstant]| pair[1].t_s - pair[0].t_s < 2e-6;
    if trace.recording.instants.windows(2).any(is_fine) {
        // Time steps below the resolution of the written times.
        return;
    }
    let folder = path.parent().expect("a folder").join("again");
    std::fs::create_dir_all(&folder).expect("a folder");
    let written = trace.write(&folder).expect("a file");
    let again = SpatialTrace::read(&written).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(again.to_csv(), trace.to_csv());
}
