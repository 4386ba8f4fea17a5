//! A further method, whose estimates take the place of the average once the evidence for it is decisive.
//!
//! It describes objects that few scenes contain, and would cost as much as another candidate. It therefore sleeps at first; the
//! means of the blocks that it has not taken are kept. A block that surprises the average wakes it; it then takes the kept blocks,
//! with each sample at least one, and as many as update at most [`MOST_UPDATED`] hypotheses, until it has caught up. Its evidence
//! against the average is a cumulative sum of log-likelihood ratios, kept from falling below zero (Page, "Continuous inspection
//! schemes", Biometrika 41, 1954), so that earlier evidence for the average does not delay the detection of a change, such as the
//! onset of sliding. The method *leads*, that is, its estimates are stated, from the instant at which the sum exceeds a threshold
//! until it is zero. Otherwise it has no effect on the estimates.

use std::collections::VecDeque;
use std::sync::Arc;

use filters::{Innovation, robust};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::estimators::systematic::SystematicSettings;
use crate::estimators::{Ahead, Estimate, Method, Sample, Touch, Tracker, Undetected};
use crate::frames::{Base, Point};
use crate::settings::{SettingsError, to_json, within};

/// Settings of the alternative.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct AlternativeSettings {
    /// Name in the registry.
    pub name: String,
    /// Settings that differ from its default ones.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub settings: Map<String, Value>,
    /// Cumulative sum of the log-likelihood ratios to the average, with the power of the candidates, above which the method leads.
    pub log_odds: f64,
    /// Largest increase and decrease of the sum per second, so that a jump of the contact, which surprises the candidates for some
    /// blocks, is not decisive.
    pub most_per_s: f64,
    /// Amount subtracted from the sum per second, except while the method leads and its contact differs from that of the average.
    pub drift_per_s: f64,
    /// Normalised innovation squared of the average in one block, above which the method wakes.
    pub wake_nis: f64,
}

impl Default for AlternativeSettings {
    /// Objects that are pushed along. The values were chosen on the suite `yielding_training`, such that the method does not lead
    /// on the standard suite and the suite `hollow`.
    fn default() -> Self {
        let systematic = to_json(&SystematicSettings::EXPECTED);
        let filter = Map::from_iter([("systematic".into(), systematic)]);
        let settings = Map::from_iter([("filter".into(), Value::Object(filter))]);
        Self { name: "pushed".into(), settings, log_odds: 10.0, most_per_s: 100.0, drift_per_s: 5.0, wake_nis: 6.0 }
    }
}

impl AlternativeSettings {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("alternative.log_odds", self.log_odds, 1e-3..=1e6)?;
        within("alternative.most_per_s", self.most_per_s, 1e-3..=1e9)?;
        within("alternative.drift_per_s", self.drift_per_s, 0.0..=1e6)?;
        within("alternative.wake_nis", self.wake_nis, 0.0..=1e6)
    }
}

/// Largest number of kept blocks. Beyond it, the method takes the oldest one with each new one, even while it sleeps.
const MOST_KEPT: usize = 256;

/// Largest number of hypotheses that the method updates with each sample until it has caught up. A single block may update more:
/// after a touch the method has many hypotheses and takes one block at a time.
const MOST_UPDATED: usize = 48;

/// Time without evidence after which the method sleeps again.
const REST_S: f64 = 1.0;

/// Largest cumulative sum as a multiple of the threshold. Limits how long the method leads once the evidence has turned against it.
const LARGEST_SHARE: f64 = 2.0;

/// Distance between the estimates of the method and the average below which it does not matter which of them is stated.
const AGREEING_M: f64 = 0.3e-3;

/// Speed of the base at the contact below which all readings tell a method that leads from the average no better than one of them.
const RESTING_M_S: f64 = 1e-4;

/// Mean of a block of samples with what the average made of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighed {
    pub(super) sample: Sample,
    pub(super) count: f64,
    /// Innovation of the average. `None` if it predicts no reading.
    pub(super) innovation: Option<Innovation<1>>,
    /// Contact of the average. `None` if it states none.
    pub(super) contact: Option<Point<Base>>,
    /// Factor of the covariances of innovations in the evidence.
    pub(super) noise_factor: f64,
    /// Power of the likelihood ratio.
    pub(super) power: f64,
}

/// The method on one contact.
pub(super) struct Alternative {
    settings: AlternativeSettings,
    gate_sds: f64,
    method: Arc<dyn Method>,
    tracker: Box<dyn Tracker>,
    /// Blocks that the method has not taken, the oldest first.
    kept: VecDeque<Weighed>,
    is_awake: bool,
    /// Cumulative sum of the evidence, and the time for which it has been zero.
    evidence: f64,
    idle_s: f64,
    leads: bool,
    stated: Option<Estimate>,
}

impl Alternative {
    pub(super) fn new(
        settings: &AlternativeSettings,
        gate_sds: f64,
        method: &Arc<dyn Method>,
        touch: &Touch<'_>,
    ) -> Self {
        Self {
            settings: settings.clone(),
            gate_sds,
            method: method.clone(),
            tracker: method.begin(touch),
            kept: VecDeque::with_capacity(MOST_KEPT + 1),
            is_awake: false,
            evidence: 0.0,
            idle_s: 0.0,
            leads: false,
            stated: None,
        }
    }

    /// Begins a new touch. Only a method with evidence that has caught up keeps its posterior of the object.
    pub(super) fn begin_again(&mut self, touch: &Touch<'_>) {
        let may_resume = self.evidence > 0.0 && self.kept.is_empty();
        if !(may_resume && self.tracker.resume(touch)) {
            self.tracker = self.method.begin(touch);
            (self.is_awake, self.leads, self.evidence) = (false, false, 0.0);
        }
        self.kept.clear();
        self.stated = None;
    }

    /// As [`Tracker::look_ahead`], while the method leads.
    pub(super) fn look_ahead(&self, since: &Sample) -> Option<Ahead> {
        self.leads.then(|| self.tracker.look_ahead(since))
    }

    /// As [`Tracker::expect_touch`], with systematic errors in the covariance.
    pub(super) fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        let estimate = self.tracker.expect_touch(undetected)?;
        Some(self.with_systematic(estimate))
    }

    /// Whether the estimates of the method take the place of the average.
    pub(super) fn leads(&self) -> bool {
        self.leads
    }

    /// Estimate after the last block, with systematic errors in its covariance.
    pub(super) fn stated(&self) -> Option<Estimate> {
        self.stated.map(|stated| self.with_systematic(stated))
    }

    fn with_systematic(&self, estimate: Estimate) -> Estimate {
        let added_m2 = self.tracker.systematic_m2().unwrap_or_default();
        Estimate { covariance_m2: estimate.covariance_m2.map(|covariance_m2| covariance_m2 + added_m2), ..estimate }
    }

    /// Takes the mean of a block.
    pub(super) fn take(&mut self, weighed: Weighed) {
        let is_surprise = |found: Innovation<1>| found.nis > self.settings.wake_nis * weighed.noise_factor;
        if weighed.innovation.is_some_and(is_surprise) {
            (self.is_awake, self.idle_s) = (true, 0.0);
        }
        self.kept.push_back(weighed);
        if !self.is_awake && self.kept.len() <= MOST_KEPT {
            return;
        }
        if self.is_awake {
            self.advance();
        } else {
            self.work();
        }
        self.leads = if self.leads {
            self.evidence > 0.0
        } else {
            self.evidence > self.settings.log_odds && self.kept.is_empty()
        };
        if self.kept.is_empty() && self.idle_s > REST_S {
            self.is_awake = false;
        }
    }

    /// If the method is awake, takes kept blocks or, if there are none, continues its work.
    pub(super) fn catch_up(&mut self) {
        if !self.is_awake {
            return;
        }
        if self.kept.is_empty() { self.tracker.work() } else { self.advance() }
    }

    /// Takes at least one kept block, and further ones while at most [`MOST_UPDATED`] hypotheses are updated.
    fn advance(&mut self) {
        let mut updated = 0;
        loop {
            updated += self.tracker.hypotheses();
            self.work();
            if self.kept.is_empty() || updated + self.tracker.hypotheses() > MOST_UPDATED {
                return;
            }
        }
    }

    /// Takes the oldest of the kept blocks.
    fn work(&mut self) {
        let Some(weighed) = self.kept.pop_front() else { return };
        self.stated = self.tracker.step_mean(&weighed.sample, weighed.count);
        let dt_s = weighed.sample.dt_s.max(0.0);
        let increase = self.increase(&weighed, dt_s);
        if increase.is_finite() {
            let most = LARGEST_SHARE * self.settings.log_odds;
            self.evidence = (self.evidence + increase).clamp(0.0, most);
        }
        self.idle_s = if self.evidence > 0.0 { 0.0 } else { self.idle_s + dt_s };
    }

    /// Increase of the sum by a block of this duration that the method has just taken.
    fn increase(&self, weighed: &Weighed, dt_s: f64) -> f64 {
        let Some(of_average) = weighed.innovation else { return 0.0 };
        let most = self.settings.most_per_s * dt_s;
        let Some(stated) = self.stated else {
            // Only the average describes the contact.
            return if self.leads { -most } else { 0.0 };
        };
        let Some(own) = stated.innovation else { return 0.0 };
        let way_m = weighed.sample.motion.apply(stated.contact).distance(&stated.contact);
        if self.leads && way_m < RESTING_M_S * dt_s {
            return 0.0;
        }
        let [own, of_average] = [own, of_average]
            .map(|innovation| robust::log_likelihood(&innovation.scaled(weighed.noise_factor), self.gate_sds));
        // Without evidence either way, a method that leads does so until the average agrees with it.
        let agrees = weighed.contact.is_some_and(|contact| contact.distance(&stated.contact) < AGREEING_M);
        let drift = if self.leads && !agrees { 0.0 } else { self.settings.drift_per_s * dt_s };
        (weighed.power * (own - of_average)).clamp(-most, most) - drift
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use nalgebra::{Matrix1, Vector1};

    use super::*;
    use crate::estimators::testing::knowledge;
    use crate::frames::{Point, Pose};
    use crate::sensor::Face;

    const NOISE_N2_M2: f64 = 1e-14;

    /// Readings that the trackers of a method have taken, in units of the noise. The trackers expect the reading 1.
    #[derive(Clone, Default)]
    struct One(Arc<Mutex<Vec<f64>>>);

    impl Method for One {
        fn begin(&self, _: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(self.clone())
        }
    }

    impl Tracker for One {
        fn step(&mut self, sample: &Sample) -> Option<Estimate> {
            let sds = sample.reading_n_m / NOISE_N2_M2.sqrt();
            self.0.lock().unwrap().push(sds);
            if sds.is_nan() {
                return None;
            }
            Some(Estimate { innovation: found(sds - 1.0), ..Estimate::at(Point::new(0.05, 0.0), Face::Left) })
        }

        /// Two blocks update 40 hypotheses; a third would exceed [`MOST_UPDATED`].
        fn hypotheses(&self) -> usize {
            20
        }

        fn resume(&mut self, _: &Touch<'_>) -> bool {
            true
        }
    }

    fn found(sds: f64) -> Option<Innovation<1>> {
        Innovation::of(Vector1::new(sds * NOISE_N2_M2.sqrt()), Matrix1::new(NOISE_N2_M2))
    }

    /// A block with this reading, of which the average predicts zero.
    fn weighed(sds: f64) -> Weighed {
        let sample = Sample { motion: Pose::new(1e-3, 0.0, 0.0), dt_s: 0.01, reading_n_m: sds * NOISE_N2_M2.sqrt() };
        Weighed { sample, count: 1.0, innovation: found(sds), contact: None, noise_factor: 1.0, power: 1.0 }
    }

    fn with_alternative(drift_per_s: f64, check: impl Fn(&mut Alternative, &One, &Touch<'_>)) {
        let knowledge = knowledge();
        let touch = Touch {
            face: &knowledge.faces[0],
            history: &[],
            free_s: 0.0,
            before: Pose::new(0.0, 0.0, 0.0),
            contact_prior: None,
            seed: 0,
        };
        let method = One::default();
        let shared: Arc<dyn Method> = Arc::new(method.clone());
        let settings = AlternativeSettings {
            name: "one".into(),
            settings: Map::new(),
            log_odds: 3.0,
            most_per_s: 1e3,
            drift_per_s,
            wake_nis: 6.0,
        };
        check(&mut Alternative::new(&settings, 5.0, &shared, &touch), &method, &touch);
    }

    #[test]
    fn verif_it_sleeps_until_a_surprise_and_takes_every_block() {
        with_alternative(0.0, |alternative, method, _| {
            (0..20).for_each(|i| alternative.take(weighed(0.1 * f64::from(i))));
            assert!(method.0.lock().unwrap().is_empty());
            alternative.take(weighed(3.0));
            assert_eq!(method.0.lock().unwrap().len(), 2);
            alternative.catch_up();
            assert_eq!(method.0.lock().unwrap().len(), 4);
            (0..20).for_each(|_| alternative.catch_up());
            let taken = method.0.lock().unwrap().clone();
            assert_eq!(taken.len(), 21);
            assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "{taken:?}");
        });
    }

    /// The logarithm of the likelihood ratio of a reading of 1 is 0.5, and -1.5 of one of -1.
    #[test]
    fn verif_it_leads_from_the_threshold_until_its_evidence_is_gone() {
        with_alternative(0.0, |alternative, _, touch| {
            alternative.take(weighed(3.0));
            let leads: Vec<bool> = (0..3)
                .map(|_| {
                    alternative.take(weighed(1.0));
                    alternative.leads()
                })
                .collect();
            assert_eq!(leads, [false, true, true]);
            assert!(alternative.stated().is_some());
            // It keeps the object, and leads, from touch to touch.
            alternative.begin_again(touch);
            assert!(alternative.leads() && alternative.stated().is_none());
            (0..100).for_each(|_| alternative.take(weighed(1.0)));
            let against = (1..)
                .find(|_| {
                    alternative.take(weighed(-1.0));
                    !alternative.leads()
                })
                .unwrap();
            assert_eq!(against, 4);
        });
    }

    #[test]
    fn verif_one_without_evidence_begins_anew_with_a_touch() {
        for (sds, resumes) in [(3.0, true), (-3.0, false)] {
            with_alternative(0.0, |alternative, method, touch| {
                alternative.take(weighed(sds));
                alternative.begin_again(touch);
                alternative.take(weighed(1.0));
                assert_eq!(method.0.lock().unwrap().len(), if resumes { 2 } else { 1 });
                assert_eq!(alternative.evidence > 0.0, resumes);
            });
        }
    }

    /// Both predict a reading of 0.5 equally well.
    #[test]
    fn verif_without_evidence_it_leads_until_the_average_agrees() {
        with_alternative(10.0, |alternative, _, _| {
            (0..20).for_each(|_| alternative.take(weighed(3.0)));
            assert!(alternative.leads());
            (0..1000).for_each(|_| alternative.take(weighed(0.5)));
            assert!(alternative.leads());
            let contact = Some(Point::new(0.05, 1e-4));
            (0..100).for_each(|_| alternative.take(Weighed { contact, ..weighed(0.5) }));
            assert!(!alternative.leads());
        });
    }

    #[test]
    fn verif_while_the_base_rests_readings_are_no_evidence_against_it() {
        with_alternative(0.0, |alternative, _, _| {
            (0..20).for_each(|_| alternative.take(weighed(3.0)));
            let sample = Sample { motion: Pose::new(0.0, 0.0, 0.0), ..weighed(-1.0).sample };
            (0..1000).for_each(|_| alternative.take(Weighed { sample, ..weighed(-1.0) }));
            assert!(alternative.leads());
        });
    }

    #[test]
    fn robust_one_that_states_no_contact_gives_way_to_the_average() {
        with_alternative(0.0, |alternative, method, _| {
            (0..20).for_each(|_| alternative.take(weighed(3.0)));
            assert!(alternative.leads());
            // No estimate follows from a reading that is not a number.
            (0..2).for_each(|_| {
                alternative.take(Weighed { innovation: found(0.0), ..weighed(f64::NAN) });
            });
            assert!(!alternative.leads() && method.0.lock().unwrap().len() == 22);
        });
    }

    #[test]
    fn robust_a_duration_that_is_not_positive_is_no_evidence() {
        with_alternative(0.0, |alternative, _, _| {
            for dt_s in [0.0, -1e-18, f64::NAN] {
                let sample = Sample { dt_s, ..weighed(3.0).sample };
                alternative.take(Weighed { sample, ..weighed(3.0) });
            }
            assert_eq!(alternative.evidence, 0.0);
        });
    }

    #[test]
    fn verif_it_sleeps_again_after_a_time_without_evidence() {
        with_alternative(0.0, |alternative, method, _| {
            alternative.take(weighed(-3.0));
            (0..200).for_each(|_| alternative.take(weighed(0.0)));
            let taken = method.0.lock().unwrap().len();
            assert!((100..103).contains(&taken), "{taken}");
        });
    }

    #[test]
    fn robust_the_number_of_kept_blocks_is_limited() {
        with_alternative(0.0, |alternative, method, _| {
            (0..MOST_KEPT + 10).for_each(|_| alternative.take(weighed(0.0)));
            assert_eq!(method.0.lock().unwrap().len(), 10);
            assert_eq!(alternative.kept.len(), MOST_KEPT);
        });
    }
}
