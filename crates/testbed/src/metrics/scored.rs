//! One estimator on one trial, beside the truth.

use filters::Innovation;
use trace::{Outline, Trace};
use whisker::RestShape;
use whisker::estimators::{Estimate, Knowledge};

use super::contact_events::Events;
use crate::bound::TraceBound;
use crate::contour::{Comparison, Contour, SurfacePoint, Touched, second_stroke};
use crate::replay::Replay;

/// Start-up ends this long after the touch.
pub const START_UP_S: f64 = 2.0;

/// An estimator that is silent for more than this share of the steady contact has no steady score: what it left out would flatter it.
const MOST_MISSING: f64 = 0.1;

/// A trial under one measurement noise: what the robot knew and read, and what only the judge knows.
#[derive(Clone, Copy, Debug)]
pub struct Trial<'a> {
    /// The trace, with the truth.
    pub trace: &'a Trace,
    /// The object's outline, where known.
    pub outline: Option<&'a Outline>,
    /// What the robot knew.
    pub knowledge: &'a Knowledge,
    /// What it read.
    pub readings_n_m: &'a [f64],
    /// Its touches and lost contacts, true and found; nothing where the truth is not known.
    pub events: Option<&'a Events>,
    /// What no estimator can do better than; nothing without noise or truth.
    pub bound: Option<&'a TraceBound>,
    /// What the truth tells of its strokes and outline.
    pub ground_truth: &'a GroundTruth,
}

/// What is told by the truth of a trace, and by the motion as the robot knows it, whoever estimates and whatever the noise.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// First row of the second stroke, where there is one.
    pub second_stroke: Option<usize>,
    /// The part of the outline that is touched.
    pub touched: Touched,
    /// The part that is touched from the second stroke on.
    pub touched_later: Touched,
}

impl GroundTruth {
    /// That of a trace, with the object's outline where that is known, of a whisker with this undeflected shape.
    pub fn new(trace: &Trace, outline: Option<&Outline>, rest: &RestShape) -> Self {
        let truths = &trace.truth.instants;
        let touch = truths.iter().position(|truth| truth.contact.is_some() && truth.split != Some(true));
        let second_stroke = touch.and_then(|row| second_stroke(&trace.recording, rest, row));
        let surfaces = |since: usize| truths[since..].iter().filter_map(|truth| truth.surface);
        let touched = |since| outline.map_or_else(Touched::default, |outline| Touched::new(outline, surfaces(since)));
        Self { second_stroke, touched: touched(0), touched_later: second_stroke.map_or_else(Touched::default, touched) }
    }
}

/// Why a trial cannot be scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unscored {
    /// The recording does not tell where the contact was.
    #[error("the true contact is not known; there is nothing to score against")]
    TruthUnknown,
    /// There was none.
    #[error("the whisker never touches; there is nothing to score")]
    NeverTouches,
}

/// Instant of the true first touch of a trace.
///
/// # Errors
/// [`Unscored`] where there is none to score against.
pub fn first_touch_s(trace: &Trace) -> Result<f64, Unscored> {
    let truths = &trace.truth.instants;
    let first = truths.iter().zip(&trace.recording.instants).find(|(truth, _)| truth.contact.is_some());
    let is_known = truths.iter().any(|truth| truth.touching.is_some());
    let unscored = if is_known { Unscored::NeverTouches } else { Unscored::TruthUnknown };
    first.map(|(_, known)| known.t_s).ok_or(unscored)
}

/// One instant at which the whisker truly touches in one place. What is said of the estimate is nothing where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Row of the trace.
    pub row: usize,
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Distance between estimated and true contact.
    pub error_m: Option<f64>,
    /// Normalised estimation error squared `e' P^-1 e`: chi-square with two degrees of freedom if the stated covariance is right.
    pub nees: Option<f64>,
    /// Normalised innovation squared, chi-square with one degree of freedom.
    pub nis: Option<f64>,
}

/// The estimates of one estimator on one trial, beside the truth, prepared once for all metrics.
#[derive(Clone, Debug)]
pub struct Scored<'a> {
    /// The trial.
    pub trial: &'a Trial<'a>,
    /// The estimates, one an instant of the trace.
    pub estimates: &'a [Option<Estimate>],
    /// Instant of the true first touch.
    pub touch_s: f64,
    /// The instants of contact.
    pub contacts: Vec<Contact>,
    /// First row of the second stroke, where there is one.
    pub second_stroke: Option<usize>,
    /// The outline that the estimates make, beside the true one; nothing where there is none of either.
    pub contour: Option<Comparison>,
    /// The same of what was touched from the second stroke on.
    pub later_contour: Option<Comparison>,
}

impl<'a> Scored<'a> {
    /// Lays estimates, what they say of the surface, and the outline that they make, beside the truth.
    ///
    /// # Errors
    /// [`Unscored`] where the trace has no instant of contact.
    pub fn new(
        trial: &'a Trial<'a>,
        replay: &'a Replay,
        said: &[SurfacePoint],
        contour: Option<&Contour>,
    ) -> Result<Self, Unscored> {
        let Trace { recording, truth, .. } = trial.trace;
        let estimates = &replay.estimates;
        let touch_s = first_touch_s(trial.trace)?;
        let mut contacts = Vec::new();
        for (row, (known, truth)) in recording.instants.iter().zip(&truth.instants).enumerate() {
            let Some(contact) = truth.contact else { continue };
            if truth.split == Some(true) {
                continue;
            }
            let seen = known.base.inverse().apply(contact);
            let estimate = estimates[row].as_ref();
            contacts.push(Contact {
                row,
                t_contact_s: known.t_s - touch_s,
                error_m: estimate.map(|estimate| estimate.contact.distance(&seen)),
                nees: estimate.and_then(|estimate| {
                    let error = estimate.contact.vector() - seen.vector();
                    Some(Innovation::of(error, estimate.covariance_m2?)?.nis)
                }),
                nis: estimate.and_then(|estimate| Some(estimate.innovation?.nis)),
            });
        }
        let GroundTruth { second_stroke, touched, touched_later } = trial.ground_truth;
        let compared = |contour: &Contour, touched| Some(Comparison::new(contour, trial.outline?, touched));
        let mut scored = Self {
            trial,
            estimates,
            touch_s,
            contacts,
            second_stroke: *second_stroke,
            contour: None,
            later_contour: None,
        };
        if !scored.is_silent() {
            scored.contour = contour.and_then(|contour| compared(contour, touched));
            scored.later_contour =
                second_stroke.and_then(|row| compared(&Contour::found(trial, replay, said, row)?, touched_later));
        }
        Ok(scored)
    }

    /// The contact after start-up.
    pub fn steady(&self) -> &[Contact] {
        &self.contacts[self.start_up().len()..]
    }

    /// The contact during start-up.
    pub fn start_up(&self) -> &[Contact] {
        let end = self.contacts.partition_point(|contact| contact.t_contact_s < START_UP_S);
        &self.contacts[..end]
    }

    /// Instants of the steady contact without an estimate.
    pub fn missing(&self) -> usize {
        self.steady().iter().filter(|contact| contact.error_m.is_none()).count()
    }

    /// Whether the estimator left out too much of the steady contact to be scored on the rest.
    pub fn is_silent(&self) -> bool {
        self.missing() as f64 > MOST_MISSING * self.steady().len() as f64
    }
}
