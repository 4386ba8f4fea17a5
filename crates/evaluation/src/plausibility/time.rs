//! Times of a trace.

use super::{Finding, Subject, median};

/// Relative tolerance of the time step.
const TOLERANCE: f64 = 0.02;

/// Time unit by which times may be too large, and its factor.
const UNITS: [(&str, f64); 3] = [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)];

/// Start of `recorded.clock` if the times are nominal. They give the order of the rows then, of which many may be left
/// out.
const NOMINAL: &str = "nominal";

/// Compares the median time step with the sampling rate. Single gaps have no influence.
pub(super) fn rate(subject: &Subject<'_>) -> Vec<Finding> {
    let rate_hz = subject.trace.sidecar.rate_hz;
    let mut steps_s: Vec<f64> = subject.instants().windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let Some(step_s) = median(&mut steps_s) else { return Vec::new() };
    let over = step_s * rate_hz;
    let recorded = subject.trace.sidecar.recorded.as_ref();
    let is_thinned = over > 1.0 && recorded.is_some_and(|recorded| recorded.clock.starts_with(NOMINAL));
    // Times are written in microseconds.
    if is_thinned || (over - 1.0).abs() <= TOLERANCE + 1e-6 * rate_hz {
        return Vec::new();
    }
    let unit = UNITS.iter().find(|(_, factor)| (over / factor - 1.0).abs() < TOLERANCE);
    let looks_like = unit.map_or_else(
        || format!("rate_hz {rate_hz} but times step {:.4} ms ({:.4} Hz)", 1e3 * step_s, 1.0 / step_s),
        |(unit, _)| format!("times look like {unit}"),
    );
    vec![Finding {
        place: "rate_hz",
        found: format!("{rate_hz} with times that step {step_s:.6} s"),
        expected: format!("steps of {:.6} s", 1.0 / rate_hz),
        looks_like,
    }]
}
