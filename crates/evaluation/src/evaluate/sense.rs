//! Sensing: known motion, readings and detected contacts of a trial at one noise level and under one seed.

use std::borrow::Cow;
use std::sync::Arc;

use testbed::bound::{Deviations, TraceBound};
use testbed::contact_events::Events;
use testbed::front_end::SensorInput;
use testbed::metrics::GroundTruth;
use testbed::miscalibration::disturb;
use testbed::replay::{detect_contact, knowledge, motions, read_by, with_readings};
use trace::Trace;
use whisker::estimators::{Knowledge, Sample};
use whisker::sensor::Face;

use super::job::TrialJob;
use super::loaded_trial::LoadedTrial;
use super::prepared::Prepared;

/// A trial as the robot senses it, with the truth that all estimators are compared with.
pub(super) struct Sensed<'a> {
    /// Trace with the base poses that the encoders measure.
    pub(super) trace: Cow<'a, Trace>,
    /// Readings with measurement noise.
    pub(super) readings_n_m: Vec<f64>,
    /// Motion and reading at each instant. The rest reading is subtracted.
    pub(super) samples: Vec<Sample>,
    /// Standard deviation of all measurement noise.
    pub(super) noise_sd_n_m: f64,
    /// Prior information with the sensor model that the calibration chose.
    pub(super) knowledge: Arc<Knowledge>,
    /// Side of the detected contact at each instant. `None` while none is detected.
    pub(super) touched: Vec<Option<Face>>,
    /// True and detected contacts. `None` if the truth is unknown.
    pub(super) events: Option<Events>,
    /// Posterior Cramér–Rao bound. `None` without noise or truth.
    pub(super) bound: Option<&'a TraceBound>,
    /// True strokes and touched part of the outline.
    pub(super) ground_truth: Cow<'a, GroundTruth>,
}

impl<'a> TrialJob<'a> {
    /// Passes the trial through encoders, front end and touch detection.
    ///
    /// # Errors
    /// If the front end cannot read the trace.
    pub(super) fn sense(&self) -> anyhow::Result<Sensed<'a>> {
        let (loaded, prepared) = (self.loaded, self.prepared);
        let spec = loaded.spec;
        let noise = self.noise();
        let bound = loaded.bound(self.level, || prepared.bound(loaded, noise));
        let trace = match (&spec.array, &loaded.displaced) {
            (Some(member), _) => member.measured(&loaded.trace, self.seed),
            (None, Some(displaced)) => Cow::Owned(Trace { recording: displaced.clone(), ..loaded.trace.clone() }),
            (None, None) => Cow::Borrowed(&loaded.trace),
        };
        let readings_n_m = self.readings_n_m()?;
        let (mut samples, ground_truth) = match &trace {
            Cow::Borrowed(_) => (with_readings(&loaded.motions, &readings_n_m), Cow::Borrowed(&loaded.ground_truth)),
            Cow::Owned(measured) => {
                let rest = measured.sidecar.whisker.rest_shape();
                // The space that the whisker has swept is that of the true motion.
                let swept = loaded.ground_truth.swept.clone();
                let ground_truth = GroundTruth { swept, ..GroundTruth::new(measured, spec.outline.as_ref(), &rest) };
                (with_readings(&motions(&measured.recording), &readings_n_m), Cow::Owned(ground_truth))
            }
        };
        let noise_sd_n_m = prepared.noise_sd_n_m(spec, noise);
        let faces = read_by(spec.sensor.as_ref(), prepared.calibration(spec).faces(None));
        let knowledge = knowledge(&trace.sidecar, &faces, noise_sd_n_m);
        let touched = detect_contact(self.settings.touch, &knowledge, &mut samples);
        let events = Events::of(&trace, &touched);
        Ok(Sensed { trace, readings_n_m, samples, noise_sd_n_m, knowledge, touched, events, bound, ground_truth })
    }

    /// Readings of the front end, including the influence of the other whiskers of its board.
    fn readings_n_m(&self) -> anyhow::Result<Vec<f64>> {
        let (noise, seed) = (self.noise(), self.seed);
        let beside = self.scene.iter().filter(|other| other.is_beside(self.loaded));
        let neighbours: Vec<SensorInput> = beside.map(|other| self.prepared.sensor_input(other, noise, seed)).collect();
        let input = SensorInput { neighbours: &neighbours, ..self.prepared.sensor_input(self.loaded, noise, seed) };
        let mut readings_n_m = self.prepared.front_end.readings_n_m(&input)?;
        let (loaded, miscalibration) = (self.loaded, &self.loaded.spec.miscalibration);
        if !miscalibration.is_none() {
            let largest_n_m = self.prepared.largest_calibrated_n_m(loaded.spec);
            let ratios = loaded.stiffness_ratios.as_deref();
            disturb(miscalibration, ratios, largest_n_m, &loaded.trace.recording, &mut readings_n_m);
        }
        Ok(readings_n_m)
    }
}

impl Prepared {
    /// Input of the front end for a trial at a noise level. The earth's field turns with the true pose of the sensor,
    /// and the sensor's noise is independent of the encoders.
    fn sensor_input<'a>(&self, loaded: &'a LoadedTrial<'_>, noise: f64, seed: u64) -> SensorInput<'a> {
        let spec = loaded.spec;
        let input = SensorInput::new(&loaded.trace, &spec.mounting, self.added_noise_sd_n_m(spec, noise), seed);
        SensorInput { sidecar: &spec.recorded, sensor: spec.sensor.as_ref(), ..input }
    }

    /// Posterior Cramér–Rao bound of a trial at a noise level.
    fn bound(&self, loaded: &LoadedTrial<'_>, noise: f64) -> Option<TraceBound> {
        let spec = loaded.spec;
        let faces = self.calibration(spec).faces(None);
        let face = faces
            .iter()
            .find(|face| face.face == spec.sidecar.face)
            .expect("the face was checked when the trial was prepared");
        let (noise_sd_n_m, base_noise) = (self.noise_sd_n_m(spec, noise), spec.base_noise());
        let deviations = Deviations {
            of: &spec.miscalibration,
            stiffness_ratios: loaded.stiffness_ratios.as_deref(),
            largest_n_m: self.largest_calibrated_n_m(spec),
        };
        let bound = TraceBound::new(&loaded.trace, face, noise_sd_n_m, &base_noise)?;
        Some(bound.with_deviations(&loaded.trace, face, noise_sd_n_m, &base_noise, &deviations))
    }
}
