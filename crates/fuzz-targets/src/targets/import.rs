//! Small repository of a rig: a calibration, a test and a mesh.

use importers::IMPORTERS;
use trace::is_plain_name;

use crate::properties::one_error;
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let [calibration, test, mesh] = scratch::parts(bytes);
    let calibration = scratch::file("clone/data/all_datasets/calibration/sensor1_tip_calib_May_04.csv", calibration);
    scratch::file("clone/data/all_datasets/test/tip_test_05_04/tip_test_cylinder_30mm_May_04_trial1.csv", test);
    scratch::file("clone/data/3d_data/ConeFixture.stl", mesh);
    let clone = calibration.ancestors().nth(4).expect("the clone");
    for row in IMPORTERS {
        let Some(imported) = one_error((row.import)(clone, &|_, _| {}), "clone") else { continue };
        for failure in imported.failures {
            one_error(Err::<(), _>(failure), "clone");
        }
        for (file, outline) in &imported.outlines {
            assert!(is_plain_name(file), "{file}");
            assert!(outline.to_csv().lines().skip(1).all(|line| !line.contains("NaN") && !line.contains("inf")));
        }
        for trace in &imported.traces {
            assert!(is_plain_name(&trace.sidecar.name));
            // Imported traces are readable.
            let json = serde_json::to_vec(&trace.sidecar).expect("it serialises");
            scratch::file(&format!("{}.json", trace.sidecar.name), json);
            let path = scratch::file(&format!("{}.csv", trace.sidecar.name), trace.to_csv());
            let again = trace::Trace::read(&path).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(again.recording.instants.len(), trace.recording.instants.len());
        }
    }
}
