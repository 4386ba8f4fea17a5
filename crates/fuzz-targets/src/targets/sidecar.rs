//! Sidecar of a trace, with the golden table and outline.

use serde_json::Value;
use strict_json::parse_json;
use trace::{Sidecar, Trace};
use whisker::events::{ContactDetector, DETECTORS, Sensing};
use whisker::frames::Point;

use crate::properties::{one_error, same_json};
use crate::{golden, scratch};

pub(super) fn run(bytes: &[u8]) {
    scratch::kept(&format!("{}.csv", golden::TRACE), golden::CSV);
    scratch::kept(&format!("{}.contour.csv", golden::TRACE), golden::CONTOUR);
    let path = scratch::file(&format!("{}.json", golden::TRACE), bytes);
    let folder = path.parent().expect("a folder");
    let Some(trace) = one_error(Trace::read(&path), golden::TRACE) else { return };
    let sidecar = &trace.sidecar;
    let file: Value = parse_json(bytes).expect("it was read");
    let text = serde_json::to_value(sidecar).expect("it serialises");
    same_json(&file, &text);
    let again: Sidecar = serde_json::from_value(text).expect("written data can be read");
    assert_eq!(&again, sidecar);
    // Paths are formed from these names.
    for name in [&sidecar.name, &sidecar.group, &sidecar.whisker.name].into_iter().chain(&sidecar.recording) {
        assert_eq!(folder.join(name).parent(), Some(folder), "{name}");
    }
    one_error(trace.outline(folder), "");
    sidecar.certificate.as_ref().map(trace::Certificate::breaches);
    let rest = sidecar.whisker.rest_shape();
    rest.foot(Point::new(0.03, 0.004));
    rest.arc_at_radius(0.03);
    let sensing = Sensing::new(&sidecar.whisker, sidecar.rate_hz, 1e-7, 1e-4);
    for row in DETECTORS {
        let mut detector = ContactDetector::new((row.config)(), &sensing);
        for reading_n_m in [0.0, 1e-5, -2e-5] {
            detector.judge(reading_n_m, 1e-3);
        }
    }
}
