//! Bayesian model averaging over several methods.
//!
//! Each candidate predicts every reading and so gives its likelihood, `N(y; 0, S)`. Prior and likelihood give the
//! posterior probability of each candidate (Bayes' theorem; Kass and Raftery, "Bayes factors", JASA 90(430), 1995): a
//! wrong model predicts poorly, an over-flexible one predicts diffusely. As long as the readings do not discriminate,
//! the priors decide. The estimate is the mean and covariance of the mixture, not of the most probable candidate, so
//! that the disagreement of probable candidates counts as uncertainty.
//!
//! A *considered* candidate, for example one that doubts the calibration, does not move the mean unless the evidence for it
//! is large. Its belief is part of the covariance about the stated mean, so that a possible systematic
//! error that the readings do not show counts as uncertainty and costs no accuracy. Its evidence against the others has a
//! power of its own: innovations hardly depend on errors of the calibration, and models that are slightly wrong
//! in the same way imitate them. For the mean, which needs a decision, the power is larger than for the covariance, and
//! evidence below a threshold does not count.
//!
//! The stated variance of the sensor model's error is an upper bound that depends on the place. Where the innovations are smaller
//! than stated, `ln det S` would favour the candidate whose contact has the smallest variance, whatever its residuals. In the
//! evidence, `S` is therefore multiplied by the running mean of the mixture's normalised innovations squared, if this is below 1.
//!
//! The object, and with it the right candidate, may change: transitions occur at a constant rate, to each candidate
//! in proportion to its prior. A rejected candidate can therefore recover within a small multiple of the number of
//! readings that reject the others.
//!
//! The settings are those of [`config`]. At each sample the candidates are updated ([`onset`]), weighted by their [`evidence`], and
//! combined to the estimate ([`mixture`]) and the outline ([`outline`]); then the sample is tested for a [`second_contact`]. An
//! [`alternative`] may take the place of the average.

mod alternative;
mod config;
mod evidence;
mod mixture;
mod onset;
mod outline;
mod second_contact;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use filters::Innovation;
use filters::imm::Modes;
use nalgebra::{Matrix2, Vector2};
use serde_json::{Map, Value};

use self::alternative::{Alternative, Weighed};
use self::config::Candidate;
pub(super) use self::config::Config;
use self::evidence::{probably_moves, signals_motion};
use super::block::{BlockMean, Blocks, Latecomers};
use super::second::Second;
use super::touched::TouchedPlaces;
use super::{
    Ahead, ESTIMATORS, Estimate, EstimatorRow, Knowledge, Method, MethodClass, ModelShares, OutlinePoint, Sample,
    Touch, Tracker, Undetected, estimator,
};
use crate::candidates::{CANDIDATES, refused, unknown};
use crate::doubt::Doubtful;
use crate::elastica::Elastica;
use crate::frames::{Base, Point, Pose, Start};
use crate::sensor::CalibratedFace;
use crate::settings::{SettingsError, parse, to_json, with_defaults, within};

/// The registry's row of a method named at a key of the settings, which must not average itself and must smooth if and only if
/// `looks_back`.
fn row_of(key: &str, name: &str, looks_back: bool) -> Result<&'static EstimatorRow, SettingsError> {
    let row = estimator(name).ok_or_else(|| unknown(key, name, ESTIMATORS.iter().map(|row| row.name)))?;
    if (row.defaults)().get("candidates").is_some() {
        return Err(refused(key, name, "a model average itself, expected a single method"));
    }
    if row.sensor_model.is_some() {
        return Err(refused(key, name, "bound to its own sensor model, expected a method that uses the calibration's"));
    }
    match (row.class == MethodClass::Hindsight, looks_back) {
        (true, false) => Err(refused(key, name, "a hindsight method, expected a recursive one")),
        (false, true) => Err(refused(key, name, "a recursive method, expected a hindsight one")),
        _ => Ok(row),
    }
}

/// Averages methods whose estimates depend on the samples so far.
pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(parse(config)?, knowledge, false)
}

/// Averages methods that smooth over the whole contact.
pub(super) fn build_hindsight(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    if config.get(ALTERNATIVE).is_some_and(|alternative| !alternative.is_null()) {
        let why = "found a method, expected none for estimates in hindsight";
        return Err(SettingsError::Parse(format!("`{ALTERNATIVE}`: {why}")));
    }
    // Settings that are not given are those of hindsight.
    let config = match config.as_object() {
        Some(own) => parse::<Config>(&with_defaults(own, to_json(&Config::hindsight())))?,
        None => parse(config)?,
    };
    // Revised estimates are those of single samples.
    within("block.samples", f64::from(config.block.samples), 1.0..=1.0)?;
    build(Config { alternative: None, ..config }, knowledge, true)
}

/// Key of the settings of the alternative.
const ALTERNATIVE: &str = "alternative";

fn build(config: Config, knowledge: &Arc<Knowledge>, looks_back: bool) -> Result<Box<dyn Method>, SettingsError> {
    let method = |key: &str, name: &str, own: &Map<String, Value>| {
        let row = row_of(key, name, looks_back)?;
        Ok((row.name, (row.build)(&with_defaults(own, (row.defaults)()), knowledge)?))
    };
    let methods = config.candidates.iter().map(|Candidate { name, settings, .. }| method(CANDIDATES, name, settings));
    let methods = methods.collect::<Result<_, SettingsError>>()?;
    let alternative =
        config.alternative.as_ref().map(|alternative| method(ALTERNATIVE, &alternative.name, &alternative.settings));
    let alternative = alternative.transpose()?.map(|(_, method)| Arc::from(method));
    let noise_n2_m2 = knowledge.noise_sd_n_m.powi(2);
    let elastica = Elastica::new(&knowledge.whisker).ok().map(Arc::new);
    Ok(Box::new(ModelAveraging { config: Arc::new(config), methods, alternative, noise_n2_m2, elastica }))
}

/// Names and methods of the candidates.
type Methods = Arc<[(&'static str, Box<dyn Method>)]>;

struct ModelAveraging {
    config: Arc<Config>,
    methods: Methods,
    alternative: Option<Arc<dyn Method>>,
    noise_n2_m2: f64,
    /// `None` if the parameters of the whisker are not valid.
    elastica: Option<Arc<Elastica>>,
}

impl Method for ModelAveraging {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let weights: Vec<f64> = self.config.candidates.iter().map(|candidate| candidate.weight).collect();
        let settings = self.config.alternative.as_ref();
        Box::new(AveragingTracker {
            config: self.config.clone(),
            considered: self.config.candidates.iter().map(|candidate| candidate.considered).collect(),
            face: touch.face.clone(),
            noise_n2_m2: self.noise_n2_m2,
            methods: self.methods.clone(),
            trackers: self.methods.iter().map(|(_, method)| method.begin(touch)).collect(),
            alternative: settings
                .zip(self.alternative.as_ref())
                .map(|(settings, method)| Alternative::new(settings, self.config.gate_sds, method, touch)),
            right: Modes::new(weights.iter().copied()),
            doubtful: Doubtful::default(),
            moves: false,
            signals_motion: false,
            second: Second::default(),
            touched: TouchedPlaces::new(self.elastica.clone(), touch.face.face),
            has_returned: false,
            base: touch.before,
            last: None,
            off_tip_m2: None,
            blocks: Blocks::new(touch.before, touch.face.rest.length_m()),
            has_begun: false,
            late: None,
            stated: None,
            continues: false,
            weights,
        })
    }
}

/// The candidates on one contact.
struct AveragingTracker {
    config: Arc<Config>,
    considered: Vec<bool>,
    face: Arc<CalibratedFace>,
    /// Variance of the noise of a reading.
    noise_n2_m2: f64,
    weights: Vec<f64>,
    methods: Methods,
    trackers: Vec<Box<dyn Tracker>>,
    alternative: Option<Alternative>,
    /// Probabilities of the candidates.
    right: Modes,
    doubtful: Doubtful,
    /// Whether the object probably moves.
    moves: bool,
    /// Whether the signal that the object moves is raised.
    signals_motion: bool,
    second: Second,
    touched: TouchedPlaces,
    /// Whether the whisker bears on a place that was touched before.
    has_returned: bool,
    base: Pose<Base, Start>,
    /// The last stated contact and its covariance (m2).
    last: Option<(Point<Start>, Matrix2<f64>)>,
    /// Covariance (m2) of the last stated contact that was not at the tip, 2x2 in Start.
    off_tip_m2: Option<Matrix2<f64>>,
    blocks: Blocks,
    /// Whether the candidates have taken the first sample of the touch.
    has_begun: bool,
    /// At the onset of a touch, the candidates that are late.
    late: Option<Latecomers>,
    /// Estimate at the mean of the last block.
    stated: Option<Estimate>,
    /// Whether the readings show a contact with the object of the last touch while none is detected.
    continues: bool,
}

impl AveragingTracker {
    fn names(&self) -> impl Iterator<Item = &'static str> {
        self.methods.iter().map(|(name, _)| *name)
    }

    /// Probabilities of the candidates.
    fn shares(&self) -> ModelShares {
        ModelShares::new(self.names().zip(self.right.probabilities().iter().copied()))
    }

    /// Begins a new touch at the present sample: the contact may be the last one or another, anywhere along the whisker.
    fn begin_again(&mut self) {
        let face = self.face.clone();
        self.begin_again_with(&Touch {
            face: &face,
            history: &[],
            free_s: 0.0,
            before: self.base,
            contact_prior: None,
            seed: 0,
        });
        self.blocks.alert(&self.config.block);
        (self.has_begun, self.late) = (false, None);
    }

    /// Begins a new touch. A candidate restarts from its prior if it keeps no posterior of the object, or if it assumes an object
    /// at rest and the object probably moves.
    fn begin_again_with(&mut self, touch: &Touch<'_>) {
        if let Some(alternative) = &mut self.alternative {
            alternative.begin_again(touch);
        }
        for (tracker, (_, method)) in self.trackers.iter_mut().zip(&*self.methods) {
            let may_resume = tracker.assumes_motion() || !self.moves;
            if !(may_resume && tracker.resume(touch)) {
                *tracker = method.begin(touch);
            }
        }
    }

    /// Predicts a sample, with the motion and the time from the last block's mean to it, by the leading candidate.
    fn look_ahead(&self, since: &Sample) -> Ahead {
        if let Some(ahead) = self.alternative.as_ref().and_then(|alternative| alternative.look_ahead(since)) {
            return ahead;
        }
        let candidates = self.right.probabilities().iter().zip(&self.considered).zip(&self.trackers);
        let leading = candidates.filter(|((_, considered), _)| !**considered);
        leading
            .max_by(|((a, _), _), ((b, _), _)| a.total_cmp(b))
            .map_or_else(Ahead::default, |(_, tracker)| tracker.look_ahead(since))
    }

    /// The estimate of the last block's mean, carried along by the motion of the base to a sample: the contact rests but for its
    /// slip over the object.
    fn carried(&self, since: &Sample, slip_m: Vector2<f64>) -> Option<Estimate> {
        let stated = self.stated?;
        Some(Estimate {
            contact: since.motion.apply(stated.contact).shifted(slip_m),
            covariance_m2: stated.covariance_m2.map(|covariance_m2| since.motion.turn(covariance_m2)),
            velocity: stated.velocity.map(|velocity| velocity.turned(&since.motion)),
            ..stated
        })
    }

    /// Takes a block of samples.
    fn take(&mut self, block: &BlockMean) {
        let now = std::mem::replace(&mut self.base, block.base);
        self.stated = self.step_mean_of(&block.sample, block.count);
        self.base = now;
        let nis = self.stated.and_then(|stated| stated.innovation).map(|innovation| innovation.nis);
        if nis.is_some_and(|nis| nis > self.config.block.alert_nis) {
            self.blocks.alert(&self.config.block);
        }
    }

    /// Takes the mean of `count` samples, with the base at the mean pose.
    fn step_mean_of(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        let estimates = self.estimates(sample, count);
        let jumps = self.trackers.iter().any(|tracker| tracker.refutes_convexity());
        self.trackers.iter_mut().for_each(|tracker| tracker.expect_jumps(jumps));
        let innovation = self.weigh(sample, count, &estimates);
        self.moves = probably_moves(self.moves, self.moving_share());
        self.doubtful.advance(&self.config.doubt, sample.dt_s, innovation);
        if innovation.is_some() && self.shows_motion(&estimates) {
            self.signals_motion = signals_motion(self.signals_motion, self.moving_share());
        }
        let together = self.together(&estimates, innovation).map(|estimate| self.with_systematic(estimate, &estimates));
        let is_led = self.try_alternative(sample, count, innovation, together.as_ref());
        let model_doubtful = self.doubtful.is_raised() || self.signals_motion || is_led;
        let (together, second_contact) = if is_led {
            // The places that were touched before are those of the candidates' object.
            self.touched.forget();
            let stated = self.alternative.as_ref().and_then(Alternative::stated);
            (stated.map(|stated| Estimate { models: Some(self.shares()), ..stated }), false)
        } else {
            let is_second = self.seek_second(sample.dt_s, count, &estimates, together.as_ref());
            let is_raised = self.second.is_raised();
            if is_second && self.config.second.begins_touch {
                self.begin_again();
            }
            (together, is_raised)
        };
        let stated = self.near_the_domain(Estimate { model_doubtful, second_contact, ..together? })?;
        let in_start = |covariance_m2| (self.base.apply(stated.contact), self.base.turn(covariance_m2));
        let placed = stated.covariance_m2.map(in_start);
        self.last = placed.or(self.last);
        let off_tip = placed.filter(|_| !stated.at_tip);
        self.off_tip_m2 = off_tip.map(|(_, covariance_m2)| covariance_m2).or(self.off_tip_m2);
        Some(stated)
    }

    /// Whether the alternative leads.
    fn is_led(&self) -> bool {
        self.alternative.as_ref().is_some_and(Alternative::leads)
    }

    /// Weighs the alternative against the average with this innovation and estimate. Returns whether it leads.
    fn try_alternative(
        &mut self,
        sample: &Sample,
        count: f64,
        innovation: Option<Innovation<1>>,
        average: Option<&Estimate>,
    ) -> bool {
        let stated = self.stated.or_else(|| self.alternative.as_ref()?.stated());
        let share = stated.map_or(0.0, |stated| self.noise_share(count, stated.contact));
        let weighed = Weighed {
            sample: *sample,
            count,
            innovation,
            contact: average.map(|average| average.contact),
            noise_factor: self.noise_factor(),
            power: self.config.evidence_power * share,
        };
        let Some(alternative) = &mut self.alternative else { return false };
        alternative.take(weighed);
        alternative.leads()
    }
}

impl Tracker for AveragingTracker {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        let settings = self.config.block;
        if settings.samples == 1 {
            self.stated = self.step_mean_of(sample, 1.0);
            return self.stated;
        }
        let mut since = self.blocks.since_mean(&self.base, sample);
        let mut ahead = if self.blocks.is_calm(sample) { self.look_ahead(&since) } else { Ahead::default() };
        if ahead.nis.is_some_and(|nis| nis > settings.sample_nis) {
            // The samples collected so far belong to the contact before the jump.
            if let Some(block) = self.blocks.end() {
                self.take(&block);
                since = self.blocks.since_mean(&self.base, sample);
                ahead = self.look_ahead(&since);
            }
            self.blocks.alert(&settings);
        }
        let Some(block) = self.blocks.take(&settings, &self.base, sample) else {
            self.trackers.iter_mut().for_each(|tracker| tracker.work());
            if let Some(alternative) = &mut self.alternative {
                alternative.catch_up();
            }
            // The innovation is that of the block.
            return self.carried(&since, ahead.slip_m).map(|estimate| Estimate { innovation: None, ..estimate });
        };
        self.take(&block);
        if block.count == 1.0 {
            return self.stated;
        }
        let since = self.blocks.since_mean(&self.base, &Sample { dt_s: 0.0, ..*sample });
        self.carried(&since, self.look_ahead(&since).slip_m)
    }

    /// All readings together determine the candidates' probabilities, so those at the end apply to every instant.
    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let revised: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.hindsight()).collect();
        let count = revised.iter().flatten().map(Vec::len).min()?;
        let at = |i: usize| revised.iter().map(|smoothed| smoothed.as_ref()?[i]).collect::<Vec<_>>();
        Some((0..count).map(|i| self.together(&at(i), None)).collect())
    }

    /// If the object probably moves, the candidates for one at rest expect the contact where the object no longer is, and are ignored.
    /// The covariance of the last contact is then added: unlike that of the remaining candidate, it allows for a wrong calibration.
    fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        // The candidates have not taken the samples of a block that has not ended.
        let undetected = Undetected { free_s: undetected.free_s + self.blocks.pending_s(), ..*undetected };
        let moves = self.moves;
        let expected = |tracker: &mut Box<dyn Tracker>| {
            tracker.expect_touch(&undetected).filter(|_| !moves || tracker.assumes_motion())
        };
        let estimates: Vec<_> = self.trackers.iter_mut().map(expected).collect();
        self.continues = false;
        if let Some(alternative) = self.alternative.as_mut().filter(|alternative| alternative.leads()) {
            let estimate = alternative.expect_touch(&undetected)?;
            return self.near_the_domain(Estimate { model_doubtful: true, models: Some(self.shares()), ..estimate });
        }
        let together = self.together(&estimates, None).map(|estimate| self.with_systematic(estimate, &estimates));
        let added_m2 =
            self.off_tip_m2.filter(|_| moves).map(|covariance_m2| undetected.base.inverse().turn(covariance_m2));
        let together = together.map(|estimate| Estimate {
            covariance_m2: estimate.covariance_m2.map(|own_m2| own_m2 + added_m2.unwrap_or_default()),
            ..estimate
        });
        // It may be another object that moves, or the motion may have ended.
        self.continues = together.is_some() && !moves;
        self.near_the_domain(together?)
    }

    /// The object may be the last one or another with equal probability: the candidates' probabilities are the mean of those at
    /// the release and the priors. If the readings showed the last one before the touch was detected, they remain those at the
    /// release.
    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        // The candidates have not taken the samples of a block that has not ended.
        let touch = &Touch { free_s: touch.free_s + self.blocks.pending_s(), ..*touch };
        self.face = touch.face.clone();
        self.base = touch.before;
        self.blocks = Blocks::new(touch.before, touch.face.rest.length_m());
        (self.has_begun, self.late) = (false, None);
        self.stated = None;
        self.second.resume();
        self.touched.resume(touch.face.face);
        self.has_returned = false;
        self.doubtful.resume();
        self.signals_motion = false;
        self.begin_again_with(touch);
        if std::mem::take(&mut self.continues) {
            return true;
        }
        let total: f64 = self.weights.iter().sum();
        let halves = self.right.probabilities().iter().zip(&self.weights).map(|(share, weight)| share + weight / total);
        self.right = Modes::new(halves.collect::<Vec<_>>());
        true
    }

    /// None while the alternative leads: the candidates' outline is one of another object.
    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        if self.is_led() { None } else { self.mixture_outline() }
    }

    fn outline_leads(&self) -> bool {
        self.mixture_outline_leads()
    }
}
