//! Dataset of the golden traces, shared by tests.

use std::path::Path;

use files::sha256;
use trace::{Role, Trace};

/// Writes two golden traces into a folder, as trials and as calibration traces.
pub(crate) fn write_dataset(folder: &Path) {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    for (of, name, role) in [
        ("golden_pin", "pin", Role::Trial),
        ("golden_circle", "round", Role::Trial),
        ("golden_pin", "grid_0", Role::Calibration),
        ("golden_circle", "grid_1", Role::Calibration),
    ] {
        let mut trace = Trace::read(&golden.join(format!("{of}.csv"))).unwrap();
        (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace.write(folder).unwrap();
    }
}
