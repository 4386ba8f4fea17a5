//! Answer line of an external program.

use serde_json::Value;
use strict_json::parse_json;
use testbed::protocol::estimate;
use whisker::sensor::Face;

use crate::golden::KNOWLEDGE;
use crate::properties::one_error;

pub(super) fn run(bytes: &[u8]) {
    // A line is text; other bytes never reach the parser.
    let Ok(line) = std::str::from_utf8(bytes) else { return };
    let Some(Some(estimate)) = one_error(estimate(line, Face::Left, &KNOWLEDGE), "") else { return };
    let answer: Value = parse_json(line.trim().as_bytes()).expect("it was read");
    assert_eq!(answer["contact_x_m"].as_f64(), Some(estimate.contact.x()));
    assert_eq!(answer["contact_y_m"].as_f64(), Some(estimate.contact.y()));
    let covariance = estimate.covariance_m2.map(|covariance| covariance[(0, 1)]);
    assert_eq!(answer.get("cov_xy_m2").and_then(Value::as_f64), covariance);
    assert!(estimate.innovation.is_none_or(|innovation| innovation.nis.is_finite()));
    assert!(KNOWLEDGE.tangent_rad(&estimate, 1e-5).is_finite());
}
