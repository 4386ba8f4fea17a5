//! Estimates of one estimator on one trial, together with the ground truth.

use filters::Innovation;
use trace::{Outline, Trace, TruthInstant};
use whisker::RestShape;
use whisker::estimators::{Estimate, Knowledge};
use whisker::frames::{Base, Point};
use whisker::sensor::CalibratedFace;

use crate::bound::TraceBound;
use crate::contact_events::Events;
use crate::contour::{Comparison, Contour, SurfacePoint, Swept, Touched, second_stroke, surface_points};
use crate::replay::Replay;

/// End of the start-up phase after the touch.
pub const START_UP_S: f64 = 2.0;

/// Largest fraction of missing estimates, of the contacts in the calibrated domain that a score counts, for which there is a score;
/// more would bias it.
pub const MOST_MISSING: f64 = 0.1;

/// Trial under one noise realisation: input of the estimators and ground truth.
#[derive(Clone, Copy, Debug)]
pub struct Trial<'a> {
    /// Trace with the ground truth.
    pub trace: &'a Trace,
    /// Outline of the object, if known.
    pub outline: Option<&'a Outline>,
    /// Prior information available to the estimators.
    pub knowledge: &'a Knowledge,
    /// Readings, one entry per instant.
    pub readings_n_m: &'a [f64],
    /// True and detected contact events. `None` if the truth is unknown.
    pub events: Option<&'a Events>,
    /// Cramér–Rao bound. `None` without noise or truth.
    pub bound: Option<&'a TraceBound>,
    /// Strokes and touched part of the outline.
    pub ground_truth: &'a GroundTruth,
}

impl Trial<'_> {
    /// Surface points of an estimator's replay, see [`surface_points`].
    pub fn surface_points(&self, replay: &Replay) -> Vec<SurfacePoint> {
        surface_points(&self.trace.recording, self.knowledge, self.readings_n_m, &replay.estimates)
    }

    /// The face that is touched. `None` if it is not calibrated.
    pub(super) fn face(&self) -> Option<&CalibratedFace> {
        self.knowledge.face(self.trace.sidecar.face).map(|face| &**face)
    }

    /// The true contact in Base at a row.
    pub(super) fn true_contact(&self, row: usize) -> Option<Point<Base>> {
        true_contact(self.trace, row)
    }

    /// Whether a true contact, at `at` in Base, lies in the calibrated domain and not at the tip.
    fn is_calibrated(&self, at: Point<Base>, truth: &TruthInstant) -> bool {
        truth.tip != Some(true) && self.face().is_some_and(|face| is_in_domain(face, at))
    }

    /// Outline of an estimator's replay with these surface points from the row `since` on, see [`Contour::found`].
    pub fn contour(&self, replay: &Replay, points: &[SurfacePoint], since: usize) -> Option<Contour> {
        Contour::found(&self.trace.recording, replay.outline.as_ref(), points, since)
    }
}

/// The true contact of a trace in Base at a row.
fn true_contact(trace: &Trace, row: usize) -> Option<Point<Base>> {
    let contact = trace.truth.instants[row].contact?;
    Some(trace.recording.instants[row].base.inverse().apply(contact))
}

/// Whether a contact, at `at` in Base, lies in the calibrated domain of a face.
fn is_in_domain(face: &CalibratedFace, at: Point<Base>) -> bool {
    face.domain.contains(face.along_and_away(at))
}

/// Number of true contacts on the side of the whisker, at a single place and not at its tip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactCount {
    /// All of them.
    pub all: usize,
    /// Those outside of the calibrated domain, at which no estimate is expected.
    pub outside: usize,
}

impl ContactCount {
    /// Counts the contacts of a trace. `face` is the calibration of the touched face; without one, all contacts lie outside.
    pub fn of(trace: &Trace, face: Option<&CalibratedFace>) -> Self {
        let truths = trace.truth.instants.iter().enumerate();
        let single = truths.filter(|(_, truth)| truth.split != Some(true) && truth.tip != Some(true));
        let contacts = single.filter_map(|(row, _)| true_contact(trace, row));
        contacts.map(|at| face.is_some_and(|face| is_in_domain(face, at))).collect()
    }

    /// Adds the contacts of another trace.
    pub fn add(&mut self, other: Self) {
        self.all += other.all;
        self.outside += other.outside;
    }

    /// Share of the contacts that lie outside. 0 without contacts.
    pub fn share_outside(&self) -> f64 {
        if self.all == 0 { 0.0 } else { self.outside as f64 / self.all as f64 }
    }
}

/// From whether each contact lies in the calibrated domain.
impl FromIterator<bool> for ContactCount {
    fn from_iter<T: IntoIterator<Item = bool>>(inside: T) -> Self {
        let mut count = Self::default();
        for is_inside in inside {
            count.add(Self { all: 1, outside: usize::from(!is_inside) });
        }
        count
    }
}

/// Ground truth derived from a trace and its measured motion, independent of estimator and noise.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// First row of the second stroke, if any.
    pub second_stroke: Option<usize>,
    /// Touched part of the outline.
    pub touched: Touched,
    /// Part of the outline that is touched from the second stroke on.
    pub touched_later: Touched,
    /// Space that the whisker has swept. `None` if the object is convex or unknown.
    pub swept: Option<Swept>,
}

impl GroundTruth {
    /// Ground truth of a trace with the object's outline, if known, for a whisker with this undeflected shape.
    pub fn new(trace: &Trace, outline: Option<&Outline>, rest: &RestShape) -> Self {
        let truths = &trace.truth.instants;
        let touch = truths.iter().position(|truth| truth.contact.is_some() && truth.split != Some(true));
        let second_stroke = touch.and_then(|row| second_stroke(&trace.recording, rest, row));
        let surfaces = |since: usize| {
            let of_second = |truth: &TruthInstant| truth.second.map(|second| second.surface);
            truths[since..].iter().flat_map(move |truth| truth.surface.into_iter().chain(of_second(truth)))
        };
        let touched = |since| outline.map_or_else(Touched::default, |outline| Touched::new(outline, surfaces(since)));
        let swept = outline.filter(|outline| !outline.is_convex()).and_then(|_| Swept::new(trace));
        let touched_later = second_stroke.map_or_else(Touched::default, touched);
        Self { second_stroke, touched: touched(0), touched_later, swept }
    }
}

/// Reason why a trial cannot be scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unscored {
    /// The recording has no ground truth of the contact.
    #[error("the true contact is unknown, so that the trial cannot be scored")]
    TruthUnknown,
    /// The whisker is never in contact.
    #[error("the whisker never touches, so that the trial cannot be scored")]
    NeverTouches,
}

/// Time of the true first touch of a trace.
///
/// # Errors
/// [`Unscored`] if there is no true contact.
pub fn first_touch_s(trace: &Trace) -> Result<f64, Unscored> {
    let truths = &trace.truth.instants;
    let first = truths.iter().zip(&trace.recording.instants).find(|(truth, _)| truth.contact.is_some());
    let is_known = truths.iter().any(|truth| truth.touching.is_some());
    let unscored = if is_known { Unscored::NeverTouches } else { Unscored::TruthUnknown };
    first.map(|(_, known)| known.t_s).ok_or(unscored)
}

/// Instant with a single true contact. Fields of the estimate are `None` if there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Row of the trace.
    pub row: usize,
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Whether the true contact lies in the calibrated domain and before the tip, so that an estimate can be expected.
    pub is_calibrated: bool,
    /// Distance between estimated and true contact.
    pub error_m: Option<f64>,
    /// Normalised estimation error squared `e' P^-1 e`: chi-square with two degrees of freedom if the stated covariance
    /// is correct.
    pub nees: Option<f64>,
    /// Normalised innovation squared: chi-square with one degree of freedom if the stated variance is correct.
    pub nis: Option<f64>,
}

/// Estimates of one estimator on one trial with the ground truth, prepared for all metrics.
#[derive(Clone, Debug)]
pub struct Scored<'a> {
    /// Trial.
    pub trial: &'a Trial<'a>,
    /// Estimates, one entry per instant of the trace.
    pub estimates: &'a [Option<Estimate>],
    /// Time of the true first touch.
    pub touch_s: f64,
    /// Instants with a single true contact.
    pub contacts: Vec<Contact>,
    /// First row of the second stroke, if any.
    pub second_stroke: Option<usize>,
    /// Comparison of the estimated outline with the true one. `None` if either is missing.
    pub contour: Option<Comparison>,
    /// Comparison for the part touched from the second stroke on.
    pub later_contour: Option<Comparison>,
    /// Largest depth of the estimated outline in the space that the whisker has swept. `None` if either is missing.
    pub in_free_space_m: Option<f64>,
}

impl<'a> Scored<'a> {
    /// Combines estimates, their surface points and their outline with the ground truth.
    ///
    /// # Errors
    /// [`Unscored`] if the trace has no instant of contact.
    pub fn new(
        trial: &'a Trial<'a>,
        replay: &'a Replay,
        points: &[SurfacePoint],
        contour: Option<&Contour>,
    ) -> Result<Self, Unscored> {
        let Trace { recording, truth, .. } = trial.trace;
        let estimates = &replay.estimates;
        let touch_s = first_touch_s(trial.trace)?;
        let mut contacts = Vec::new();
        for (row, (known, truth)) in recording.instants.iter().zip(&truth.instants).enumerate() {
            let Some(seen) = trial.true_contact(row) else { continue };
            if truth.split == Some(true) {
                continue;
            }
            let estimate = estimates[row].as_ref();
            contacts.push(Contact {
                row,
                t_contact_s: known.t_s - touch_s,
                is_calibrated: trial.is_calibrated(seen, truth),
                error_m: estimate.map(|estimate| estimate.contact.distance(&seen)),
                nees: estimate.and_then(|estimate| {
                    let error = estimate.contact.vector() - seen.vector();
                    Some(Innovation::of(error, estimate.covariance_m2?)?.nis)
                }),
                nis: estimate.and_then(|estimate| Some(estimate.innovation?.nis)),
            });
        }
        let GroundTruth { second_stroke, touched, touched_later, swept } = trial.ground_truth;
        let compared = |contour: &Contour, touched| Some(Comparison::new(contour, trial.outline?, touched));
        let mut scored = Self {
            trial,
            estimates,
            touch_s,
            contacts,
            second_stroke: *second_stroke,
            contour: None,
            later_contour: None,
            in_free_space_m: None,
        };
        if !scored.is_silent() {
            scored.contour = contour.and_then(|contour| compared(contour, touched));
            scored.in_free_space_m = contour.zip(swept.as_ref()).map(|(contour, swept)| swept.depth_m(contour));
            scored.later_contour =
                second_stroke.and_then(|row| compared(&trial.contour(replay, points, row)?, touched_later));
        }
        Ok(scored)
    }

    /// Contacts after start-up.
    pub fn steady(&self) -> &[Contact] {
        &self.contacts[self.start_up().len()..]
    }

    /// Contacts during start-up.
    pub fn start_up(&self) -> &[Contact] {
        let end = self.contacts.partition_point(|contact| contact.t_contact_s < START_UP_S);
        &self.contacts[..end]
    }

    /// Number of steady contacts in the calibrated domain without an estimate.
    pub fn missing(&self) -> usize {
        missing(self.steady())
    }

    /// Whether too many estimates of the steady contact are missing for steady scores.
    pub fn is_silent(&self) -> bool {
        is_silent(self.steady())
    }
}

/// Errors of the contacts with an estimate; empty if the estimates of too many contacts are missing.
pub(super) fn errors_m<'a>(contacts: impl IntoIterator<Item = &'a Contact, IntoIter: Clone>) -> Vec<f64> {
    let contacts = contacts.into_iter();
    if is_silent(contacts.clone()) { Vec::new() } else { contacts.filter_map(|contact| contact.error_m).collect() }
}

/// Whether too many estimates of these contacts are missing for scores that count these contacts, or none is expected.
fn is_silent<'a>(contacts: impl IntoIterator<Item = &'a Contact, IntoIter: Clone>) -> bool {
    let contacts = contacts.into_iter();
    let calibrated = contacts.clone().filter(|contact| contact.is_calibrated).count();
    calibrated == 0 || missing(contacts) as f64 > MOST_MISSING * calibrated as f64
}

/// Number of contacts in the calibrated domain without an estimate.
fn missing<'a>(contacts: impl IntoIterator<Item = &'a Contact>) -> usize {
    contacts.into_iter().filter(|contact| contact.is_calibrated && contact.error_m.is_none()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact((row, error_m): (usize, Option<f64>)) -> Contact {
        Contact { row, t_contact_s: 0.0, is_calibrated: true, error_m, nees: None, nis: None }
    }

    /// A first touch of which half is missed is short compared with the rest of the contact.
    #[test]
    fn verif_estimates_are_missing_in_the_contacts_that_a_score_counts() {
        let errors = |row: usize| (row, (row >= 5).then_some(1e-3));
        let contacts: Vec<Contact> = (0..100).map(errors).map(contact).collect();
        let first = contacts.iter().filter(|contact| contact.row < 10);
        let later = contacts.iter().filter(|contact| contact.row >= 10);
        assert!(errors_m(first).is_empty());
        assert_eq!((errors_m(later).len(), errors_m(&contacts).len()), (90, 95));
    }

    #[test]
    fn verif_estimates_outside_of_the_calibrated_domain_may_be_missing() {
        let outside = Contact { is_calibrated: false, ..contact((0, None)) };
        assert_eq!(errors_m(&[outside, contact((1, Some(1e-3)))]), [1e-3]);
        assert!(errors_m(&[contact((0, None)), contact((1, Some(1e-3)))]).is_empty());
    }
}
