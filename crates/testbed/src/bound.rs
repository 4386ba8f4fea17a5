//! The physical limit of a trial: how well the contact could be known from its readings, whatever the estimator.
//!
//! This is the posterior Cramer-Rao bound ([`filters::bound`]) along the trace, at the true contacts, under the calibrated sensor model and the
//! measurement noise alone: the model's own error is left out, since a better model would not have it. The state is the contact in World, and the
//! process has no noise: physically the contact on a pin does not diffuse, it moves by `(R + r) dpsi` while the whisker turns by `dpsi` on a pin of
//! radius `R` with a wire of radius `r`. That displacement counts as known, so this is the bound of an estimator that is told how
//! the contact slides. One that is not told knows less: the bound still holds for it, narrowly on a pin and loosely on a round object, where the slide
//! is most of what there is to find out. Around a large one, or from one object on to the next, a contact slides over centimetres, and all readings of a long sweep
//! tell of one place for whoever knows that slide: there the bound lies far below what anybody else can reach.
//!
//! Where the robot knows its base with noise, that counts as noise of the readings ([`BaseNoise`]).
//!
//! At each touch one starts with the contact anywhere along the calibrated part of the undeflected whisker; a gap of [`CHATTER_S`] at most, which
//! detectors ride through, ends no touch. So this is a bound per touch: an estimator that remembers an object over lift-offs (`resume` and `outline` of
//! its tracker) starts a later touch with more, and may lie under it until the readings of that touch tell as much. Where the
//! true contact lies outside the calibrated region, at the tip or in several places, the reading adds nothing.

use std::collections::VecDeque;

use filters::bound::{Bound, information};
use filters::{Measurement, Process};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, vector};
use trace::Trace;
use whisker::estimators::BaseNoise;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::CalibratedFace;

use crate::metrics::contact_events::CHATTER_S;

/// Standard deviation of the contact's distance from the undeflected whisker at the touch. The first reading tells it ten times better.
const START_AWAY_SD_M: f64 = 1e-3;

/// Length of the window of [`Window`]: long enough for a trajectory to show more than one direction, short enough to tell when it does.
pub const WINDOW_S: f64 = 0.5;

/// The bound at every instant of a trace.
#[derive(Clone, Debug)]
pub struct TraceBound {
    instants: Vec<Option<BoundAt>>,
}

/// The bound at one instant of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundAt {
    /// Time since the touch.
    pub since_touch_s: f64,
    /// Root of the trace of the bound's covariance: the least root mean square error.
    pub sd_m: f64,
    /// What the readings of the last [`WINDOW_S`] tell by themselves; nothing where they tell of one direction at most.
    pub window: Option<Window>,
}

/// What the readings of a window tell without any knowledge from before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Root of the trace of the inverse information.
    pub sd_m: f64,
    /// Condition number of the information: the square of the ratio in which it leaves the contact uncertain along and across its weakest direction.
    pub condition: f64,
}

impl TraceBound {
    /// The bound along a trace that touches `face`, with the measurement noise of the sensor and the base; nothing without noise, which has no bound.
    pub fn new(trace: &Trace, face: &CalibratedFace, noise_sd_n_m: f64, base_noise: &BaseNoise) -> Option<Self> {
        if noise_sd_n_m <= 0.0 && base_noise.is_none() {
            return None;
        }
        let mut contact: Option<InContact> = None;
        let mut free_since_s: Option<f64> = None;
        let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
        let instants = instants
            .map(|(known, truth)| {
                let Some(at) = truth.contact else {
                    free_since_s.get_or_insert(known.t_s);
                    return None;
                };
                if free_since_s.take().is_some_and(|since_s| known.t_s - since_s >= CHATTER_S) {
                    contact = None;
                }
                let contact = contact.get_or_insert_with(|| {
                    InContact::begin(face, &known.base, known.base.inverse().apply(at), known.t_s)
                });
                let is_plain = truth.tip != Some(true) && truth.split != Some(true);
                let reading = Reading { face, base: &known.base, noise_sd_n_m, base_noise };
                let gained = information(&reading, &at.vector()).filter(|_| is_plain).unwrap_or_default();
                contact.step(known.t_s, &at.vector(), gained)
            })
            .collect();
        Some(Self { instants })
    }

    /// The bound at a row of the trace; nothing while the whisker is free.
    pub fn at(&self, row: usize) -> Option<BoundAt> {
        self.instants[row]
    }
}

/// One contact from touch to release.
struct InContact {
    touch_s: f64,
    bound: Bound<2>,
    /// Time and information of each reading of the window.
    window: VecDeque<(f64, Matrix2<f64>)>,
}

impl InContact {
    fn begin(face: &CalibratedFace, base: &Pose<Base, World>, seen: Point<Base>, touch_s: f64) -> Self {
        let (low, high) = face.domain.arc_range_m();
        // An even spread over a length has the variance of its square over twelve.
        let prior = Matrix2::from_diagonal(&vector![(high - low).powi(2) / 12.0, START_AWAY_SD_M.powi(2)]);
        let jacobian = base.rotation() * face.contact_jacobian(face.along_and_away(seen));
        let bound = Bound::new(&(jacobian * prior * jacobian.transpose())).expect("the contact is near the whisker");
        Self { touch_s, bound, window: VecDeque::new() }
    }

    fn step(&mut self, t_s: f64, contact: &Vector2<f64>, gained: Matrix2<f64>) -> Option<BoundAt> {
        self.bound.predict(&KnownSlide, contact);
        self.bound.update(gained);
        self.window.push_back((t_s, gained));
        while self.window.front().is_some_and(|(then_s, _)| t_s - then_s > WINDOW_S) {
            self.window.pop_front();
        }
        let window: Matrix2<f64> = self.window.iter().map(|(_, information)| information).sum();
        let sd_m = self.bound.covariance()?.trace().sqrt();
        Some(BoundAt { since_touch_s: t_s - self.touch_s, sd_m, window: Window::of(&window) })
    }
}

impl Window {
    fn of(information: &Matrix2<f64>) -> Option<Self> {
        let eigenvalues = information.symmetric_eigenvalues();
        let (weak, strong) = (eigenvalues.min(), eigenvalues.max());
        // Below that the smaller one is what rounding left of zero.
        (weak > 1e-12 * strong).then(|| Self { sd_m: (1.0 / weak + 1.0 / strong).sqrt(), condition: strong / weak })
    }
}

/// A contact whose displacement in World is known: uncertainty about it stays what it was.
struct KnownSlide;

impl Process<2> for KnownSlide {
    fn predict(&self, contact: &Vector2<f64>) -> Vector2<f64> {
        *contact
    }

    fn jacobian(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity()
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::zeros()
    }
}

/// The reading of a contact in World.
struct Reading<'a> {
    face: &'a CalibratedFace,
    base: &'a Pose<Base, World>,
    noise_sd_n_m: f64,
    base_noise: &'a BaseNoise,
}

impl Reading<'_> {
    fn seen(&self, contact: &Vector2<f64>) -> Point<Base> {
        self.base.inverse().apply(Point::from_vector(*contact))
    }
}

impl Measurement<2, 1> for Reading<'_> {
    fn predict(&self, contact: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(self.face.predict(self.seen(contact))?.reading_n_m))
    }

    fn jacobian(&self, contact: &Vector2<f64>) -> Option<RowVector2<f64>> {
        let gradient_n = self.face.predict(self.seen(contact))?.gradient_n;
        Some((self.base.rotation() * gradient_n).transpose())
    }

    fn noise(&self, contact: &Vector2<f64>) -> Matrix1<f64> {
        let seen = self.seen(contact);
        let of_base = |gradient_n| self.base_noise.of_reading_n2_m2(seen, &gradient_n);
        let of_base_n2_m2 = self.face.predict(seen).map_or(0.0, |expected| of_base(expected.gradient_n));
        Matrix1::new(self.noise_sd_n_m.powi(2) + of_base_n2_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_window_sees_one_direction_less_than_two() {
        let along = vector![3.0, 0.0];
        assert!(Window::of(&(along * along.transpose())).is_none());
        let both = Window::of(&Matrix2::from_diagonal(&vector![4.0, 1.0])).unwrap();
        assert_eq!((both.condition, both.sd_m), (4.0, 1.25f64.sqrt()));
    }
}
