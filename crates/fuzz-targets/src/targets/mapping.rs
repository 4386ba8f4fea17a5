//! Mapping of own recordings, and the recording: a CSV or an MCAP file.

use importers::Imported;
use trace::{SpatialTrace, Trace, is_plain_name};

use crate::properties::one_error;
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let [mapping, csv, mcap] = scratch::parts(bytes);
    let mapping = scratch::file("laboratory/mapping.json", mapping);
    scratch::file("laboratory/recording.csv", csv);
    scratch::file("laboratory/recording.mcap", mcap);
    for format in ["csv", "bag"] {
        let row = importers::importer(format).expect("a registered format");
        for import in [row.import, row.import_in_space] {
            let Some(imported) = one_error(import(&mapping, &|_, _| {}), "") else { continue };
            for failure in &imported.failures {
                one_error(Err::<(), _>(failure), "");
            }
            check(&imported);
        }
    }
}

/// Checks that the imported traces are readable.
fn check(imported: &Imported) {
    for (file, outline) in &imported.outlines {
        assert!(is_plain_name(file), "{file}");
        assert!(outline.to_csv().lines().skip(1).all(|line| !line.contains("NaN") && !line.contains("inf")));
    }
    let write = |name: &str, json: Vec<u8>, csv: String| {
        assert!(is_plain_name(name), "{name}");
        scratch::file(&format!("of_laboratory/{name}.json"), json);
        scratch::file(&format!("of_laboratory/{name}.csv"), csv)
    };
    for trace in &imported.traces {
        let json = serde_json::to_vec(&trace.sidecar).expect("it serialises");
        let path = write(&trace.sidecar.name, json, trace.to_csv());
        let again = Trace::read(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(again.recording.instants.len(), trace.recording.instants.len());
    }
    for trace in &imported.spatial_traces {
        let json = serde_json::to_vec(&trace.sidecar).expect("it serialises");
        let path = write(&trace.sidecar.name, json, trace.to_csv());
        let again = SpatialTrace::read(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(again.recording.instants.len(), trace.recording.instants.len());
    }
}
