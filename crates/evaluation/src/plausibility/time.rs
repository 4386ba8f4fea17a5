//! Times of a trace, in the plane or in space.

use trace::{SpatialTrace, Trace};

use super::{Finding, Subject, median};

/// Relative tolerance of the time step.
const TOLERANCE: f64 = 0.02;

/// Time unit by which times may be too large, and its factor.
const UNITS: [(&str, f64); 3] = [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)];

/// Start of `recorded.clock` if the times are nominal. They give the order of the rows then, of which many may be left
/// out.
const NOMINAL: &str = "nominal";

/// Largest number of steps that are kept: of longer traces every second one, every fourth one and so on.
const MOST_STEPS: usize = 1 << 16;

/// Steps between the times of a trace, to be compared with its sampling rate. Their number in memory is bounded, so that a trace
/// of any length can be compared while its rows are read.
#[derive(Clone, Debug)]
pub struct TimeSteps {
    /// Every `stride`-th step (s).
    steps_s: Vec<f64>,
    stride: usize,
    /// Number of all steps.
    count: usize,
    last_s: Option<f64>,
}

impl Default for TimeSteps {
    fn default() -> Self {
        Self { steps_s: Vec::new(), stride: 1, count: 0, last_s: None }
    }
}

impl TimeSteps {
    /// Takes the time of the next row (s).
    pub fn push(&mut self, t_s: f64) {
        let Some(last_s) = self.last_s.replace(t_s) else { return };
        if self.steps_s.len() == MOST_STEPS {
            self.steps_s = self.steps_s.iter().step_by(2).copied().collect();
            self.stride *= 2;
        }
        if self.count.is_multiple_of(self.stride) {
            self.steps_s.push(t_s - last_s);
        }
        self.count += 1;
    }

    /// Compares the median time step with the sampling rate `rate_hz` (Hz). Single gaps have no influence. `clock` is that of a
    /// recording (`recorded.clock`). `None` if they agree, or there are no steps.
    pub fn contradiction_with(mut self, rate_hz: f64, clock: Option<&str>) -> Option<Finding> {
        let step_s = median(&mut self.steps_s)?;
        let over = step_s * rate_hz;
        let is_thinned = over > 1.0 && clock.is_some_and(|clock| clock.starts_with(NOMINAL));
        // Times are written in microseconds.
        if is_thinned || (over - 1.0).abs() <= TOLERANCE + 1e-6 * rate_hz {
            return None;
        }
        let unit = UNITS.iter().find(|(_, factor)| (over / factor - 1.0).abs() < TOLERANCE);
        let looks_like = unit.map_or_else(
            || format!("rate_hz {rate_hz} but times step {:.4} ms ({:.4} Hz)", 1e3 * step_s, 1.0 / step_s),
            |(unit, _)| format!("times look like {unit}"),
        );
        Some(Finding {
            place: "rate_hz",
            found: format!("{rate_hz} with times that step {step_s:.6} s"),
            expected: format!("steps of {:.6} s", 1.0 / rate_hz),
            looks_like,
        })
    }
}

impl FromIterator<f64> for TimeSteps {
    fn from_iter<T: IntoIterator<Item = f64>>(times_s: T) -> Self {
        let mut steps = Self::default();
        times_s.into_iter().for_each(|t_s| steps.push(t_s));
        steps
    }
}

/// Compares the times of a trace with its sampling rate.
pub fn contradicted_rate(trace: &Trace) -> Option<Finding> {
    let steps: TimeSteps = trace.recording.instants.iter().map(|instant| instant.t_s).collect();
    let sidecar = &trace.sidecar;
    steps.contradiction_with(sidecar.rate_hz, sidecar.clock())
}

/// As [`contradicted_rate`], of a trace in space.
pub fn contradicted_rate_in_space(trace: &SpatialTrace) -> Option<Finding> {
    let steps: TimeSteps = trace.recording.instants.iter().map(|instant| instant.t_s).collect();
    let sidecar = &trace.sidecar;
    steps.contradiction_with(sidecar.rate_hz, sidecar.clock())
}

/// As [`contradicted_rate`], as a test of the registry.
pub(super) fn rate(subject: &Subject<'_>) -> Vec<Finding> {
    contradicted_rate(subject.trace).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_steps_of_a_long_trace_are_compared_in_bounded_memory() {
        let steps: TimeSteps = (0..20 * MOST_STEPS).map(|row| 0.004 * row as f64).collect();
        assert!(steps.steps_s.len() <= MOST_STEPS && steps.steps_s.len() > MOST_STEPS / 2);
        assert_eq!(steps.clone().contradiction_with(250.0, None), None);
        let found = steps.contradiction_with(2500.0, None).unwrap().to_string();
        assert!(
            found.starts_with("rate_hz: found 2500 with times that step 0.004000 s, expected steps of 0.000400 s"),
            "{found}"
        );
    }

    #[test]
    fn verif_gaps_and_thinned_rows_of_a_nominal_clock_agree_with_the_rate() {
        let with_gaps = (0..100).map(|row| 0.004 * f64::from(row) + f64::from(row / 10));
        assert_eq!(with_gaps.collect::<TimeSteps>().contradiction_with(250.0, None), None);
        let thinned: TimeSteps = (0..100).map(|row| 0.02 * f64::from(row)).collect();
        assert_eq!(thinned.clone().contradiction_with(250.0, Some("nominal, 250 Hz")), None);
        assert!(thinned.contradiction_with(250.0, Some("stamps")).is_some());
        assert_eq!(TimeSteps::from_iter([0.0]).contradiction_with(250.0, None), None);
    }
}
