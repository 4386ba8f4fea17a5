//! A trial in memory.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::OnceLock;

use testbed::bound::TraceBound;
use testbed::metrics::GroundTruth;
use testbed::miscalibration::{displaced, displaces, stiffness_ratios};
use testbed::replay::motions;
use trace::{Recording, Trace, Truth};
use whisker::estimators::Sample;

use super::prepared::TrialSpec;

/// A trial with its trace in memory, and the data common to all noise levels and seeds.
pub(super) struct LoadedTrial<'a> {
    pub(super) spec: &'a TrialSpec,
    pub(super) trace: Trace,
    /// Samples without readings, with the true motion.
    pub(super) motions: Vec<Sample>,
    /// True strokes and touched part of the outline, with the true motion.
    pub(super) ground_truth: GroundTruth,
    /// The recording with the poses of the calibrated Base. `None` if these are the actual ones.
    pub(super) displaced: Option<Recording>,
    /// Ratios of the readings to those with the calibrated stiffness, see [`stiffness_ratios`].
    pub(super) stiffness_ratios: Option<Vec<f64>>,
    /// Posterior Cramér–Rao bound by noise level.
    bounds: Vec<OnceLock<Option<TraceBound>>>,
}

impl<'a> LoadedTrial<'a> {
    pub(super) fn read(spec: &'a TrialSpec, levels: usize) -> Result<Self, String> {
        let trace = Trace::read(&spec.path).map_err(|error| error.to_string())?;
        if trace.sidecar.csv_sha256 != spec.sidecar.csv_sha256 {
            return Err(format!("{}: has changed since the evaluation began", spec.path.display()));
        }
        let trace = Trace { sidecar: spec.sidecar.clone(), ..trace };
        let motions = motions(&trace.recording);
        let ground_truth = GroundTruth::new(&trace, spec.outline.as_ref(), &trace.sidecar.whisker.rest_shape());
        let displaced = displaces(&spec.miscalibration).then(|| displaced(&spec.miscalibration, &trace.recording));
        let stiffness_ratios = stiffness_ratios(&spec.miscalibration, &trace).map_err(|error| format!("{error:#}"))?;
        let bounds = (0..levels).map(|_| OnceLock::new()).collect();
        Ok(Self { spec, trace, motions, ground_truth, displaced, stiffness_ratios, bounds })
    }

    /// Keeps the first instants and the data derived from them.
    pub(super) fn truncate(&mut self, rows: usize) {
        self.trace.recording.instants.truncate(rows);
        self.trace.truth.instants.truncate(rows);
        self.motions.truncate(rows);
        self.displaced.iter_mut().for_each(|recording| recording.instants.truncate(rows));
        let rest = self.trace.sidecar.whisker.rest_shape();
        self.ground_truth = GroundTruth::new(&self.trace, self.spec.outline.as_ref(), &rest);
    }

    /// Whether it is another whisker of the same board.
    pub(super) fn is_beside(&self, other: &Self) -> bool {
        let (one, other) = (&self.spec.mounting, &other.spec.mounting);
        one.array == other.array && one.sensor != other.sensor
    }

    /// Truth with the index of the whisker in its recording. `None` if the trial is a trace by itself.
    pub(super) fn truth(&self) -> Option<(usize, &Truth)> {
        Some((self.spec.array.as_ref()?.whisker(), &self.trace.truth))
    }

    /// Bound at a noise level, computed once.
    pub(super) fn bound(&self, level: usize, compute: impl FnOnce() -> Option<TraceBound>) -> Option<&TraceBound> {
        self.bounds[level].get_or_init(compute).as_ref()
    }
}

/// Result of a function, or the message of its panic.
pub(super) fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    let message = |panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no reason given".into())
    };
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| format!("broke down: {}", message(panic)))
}
