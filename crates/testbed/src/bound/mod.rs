//! Posterior Cramér–Rao bound of a trial: lower bound of the contact error for any estimator with the same readings.
//!
//! The bound ([`filters::bound`]) is evaluated along the trace at the true contacts, with the calibrated sensor model
//! and the measurement noise; model errors are excluded, since a better model would not have them. The state is the
//! contact in World and has no process noise: the contact on a pin does not diffuse, it moves by `(R + r) dpsi` while
//! the whisker rotates by `dpsi`, with pin radius `R` and wire radius `r`. This displacement is taken as known, so the
//! bound is that of an estimator with exact knowledge of the sliding motion. It holds for estimators without that
//! knowledge too: it is nearly tight on a pin and loose on round objects, where most of the uncertainty is in the
//! sliding motion. On large objects, or from one object to the next, a contact slides over centimetres; with known
//! sliding, all readings of a long sweep inform about one position, and the bound is far below the error of any
//! practical estimator.
//!
//! Noise of the measured base pose is included as noise of the readings ([`BaseNoise`]).
//!
//! The prior at each touch is the calibrated part of the undeflected whisker. Gaps of at most [`CHATTER_S`], which
//! detectors bridge, do not end a touch. It is a bound per touch: an estimator that remembers an object over lift-offs
//! (`resume` and `outline` of its tracker) starts a later touch with more information and may be below the bound until
//! the readings of that touch are equally informative. If the true contact is outside of the calibrated domain, at the
//! tip or at several positions, the reading adds no information.

mod deviations;
mod yielding;

pub use deviations::{Deviations, QuantityBounds};

use std::collections::VecDeque;

use filters::bound::{Bound, information};
use filters::{Measurement, Process};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, vector};
use trace::Trace;
use whisker::estimators::BaseNoise;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::CalibratedFace;

use crate::contact_events::CHATTER_S;
use deviations::{Joint, JointReading, size_variance};
use yielding::{TouchedPlace, displacement_m};

/// Prior standard deviation of the contact's distance from the undeflected whisker at the touch, in space in either direction
/// across it. The first reading reduces it about tenfold.
pub(crate) const START_AWAY_SD_M: f64 = 1e-3;

/// Length of the window of [`Window`]: long enough for information in more than one direction, short enough to resolve
/// its changes.
pub const WINDOW_S: f64 = 0.5;

/// Bound at every instant of a trace.
#[derive(Clone, Debug)]
pub struct TraceBound {
    instants: Vec<Option<BoundAt>>,
    quantities: Option<QuantityBounds>,
}

/// Bound at one instant of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundAt {
    /// Time since the start of the touch.
    pub since_touch_s: f64,
    /// Square root of the trace of the bound's covariance: lower bound of the RMS error.
    pub sd_m: f64,
    /// The same for a sensor with deviations from its calibration whose values are unknown, see [`Deviations`].
    pub deviating_sd_m: f64,
    /// The same if the size of the object is unknown as well.
    pub unsized_sd_m: f64,
    /// The same if the object moves with an unknown constant velocity as well, or gives way by unknown displacements; equal to
    /// [`Self::unsized_sd_m`] if it is at rest.
    pub moving_sd_m: f64,
    /// Information of the readings of the last [`WINDOW_S`] alone. `None` if it has rank one or less.
    pub window: Option<Window>,
}

/// Information of the readings of a window, without a prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Square root of the trace of the inverse information.
    pub sd_m: f64,
    /// Condition number of the information matrix.
    pub condition: f64,
}

impl TraceBound {
    /// Bound along a trace that touches `face`, with the measurement noise of sensor and base. `None` without noise,
    /// since the bound is then zero.
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
        Some(Self { instants, quantities: None })
    }

    /// Adds the bounds with unknown deviations, size and velocity, for the same trace, face and noise as in [`Self::new`]:
    /// [`BoundAt::deviating_sd_m`], [`BoundAt::unsized_sd_m`], [`BoundAt::moving_sd_m`] and [`Self::quantities`].
    #[must_use]
    pub fn with_deviations(
        mut self,
        trace: &Trace,
        face: &CalibratedFace,
        noise_sd_n_m: f64,
        base_noise: &BaseNoise,
        deviations: &Deviations<'_>,
    ) -> Self {
        let instants = &trace.recording.instants;
        let start_s = instants.first().map_or(0.0, |first| first.t_s);
        let of_size = size_variance(&trace.sidecar.object);
        let object_m_s = Vector2::from(trace.sidecar.object_velocity_m_s());
        let is_uniform = object_m_s != Vector2::zeros();
        let known_motion = Joint::new(deviations, of_size);
        let unknown_motion = if is_uniform { known_motion.clone().moving() } else { known_motion.clone() };
        let installed = unknown_motion.clone().installed();
        let mut joints = [Joint::new(deviations, 0.0), known_motion, unknown_motion, installed];
        let mut touched = Vector2::zeros();
        let (mut first_place, mut last_place) = (None, None);
        for (row, (bound, truth)) in self.instants.iter_mut().zip(&trace.truth.instants).enumerate() {
            let (Some(bound), Some(at)) = (bound, truth.contact) else { continue };
            let known = &instants[row];
            let seen = known.base.inverse().apply(at);
            let place = TouchedPlace::new(truth, &trace.sidecar);
            if bound.since_touch_s == 0.0 {
                touched = at.vector();
                (first_place, last_place) = (place, place);
                joints.iter_mut().for_each(|joint| joint.touch(&prior_m2(face, &known.base, seen)));
            }
            // Displacement relative to the object.
            let object_m = displacement_m(first_place.as_ref(), place.as_ref());
            let moved_m = at.vector() - touched - object_m_s * bound.since_touch_s - object_m;
            let step_m = -displacement_m(place.as_ref(), last_place.as_ref());
            joints[2..].iter_mut().for_each(|joint| joint.walk(&step_m));
            last_place = place;
            let is_plain = truth.tip != Some(true) && truth.split != Some(true);
            if let Some(expected) = face.predict(seen).filter(|_| is_plain) {
                let [before, after] =
                    [row.saturating_sub(1), (row + 1).min(instants.len() - 1)].map(|row| &instants[row]);
                let passed_m = after.base.inverse().apply(at).vector() - before.base.inverse().apply(at).vector();
                let velocity_m_s = passed_m / (after.t_s - before.t_s);
                let reading = JointReading {
                    by_contact: known.base.rotation() * expected.gradient_n,
                    moved_m,
                    since_touch_s: bound.since_touch_s,
                    by_deviations: deviations.slopes(row, known.t_s - start_s, seen, velocity_m_s, &expected),
                    variance_n2_m2: Reading { face, base: &known.base, noise_sd_n_m, base_noise }.noise(&at.vector())
                        [0],
                };
                joints.iter_mut().for_each(|joint| joint.update(&reading));
            }
            let [deviating, unsized_object, moving, _] = &joints;
            [bound.deviating_sd_m, bound.unsized_sd_m, bound.moving_sd_m] =
                [deviating, unsized_object, moving].map(|joint| joint.sd_m(moved_m, bound.since_touch_s));
        }
        let [_, _, moving, installed] = &joints;
        let velocity_m_s = is_uniform.then(|| moving.velocity_sds_m_s());
        self.quantities = Some(QuantityBounds { installation: installed.installation_sds(), velocity_m_s });
        self
    }

    /// Bounds of what may be stated beside the contact after the last reading. `None` before [`Self::with_deviations`].
    pub fn quantities(&self) -> Option<&QuantityBounds> {
        self.quantities.as_ref()
    }

    /// Bound at a row of the trace. `None` while the whisker is free.
    pub fn at(&self, row: usize) -> Option<BoundAt> {
        self.instants[row]
    }
}

/// Contact from touch to release.
struct InContact {
    touch_s: f64,
    bound: Bound<2>,
    /// Time and information of each reading in the window.
    window: VecDeque<(f64, Matrix2<f64>)>,
}

impl InContact {
    fn begin(face: &CalibratedFace, base: &Pose<Base, World>, seen: Point<Base>, touch_s: f64) -> Self {
        let bound = Bound::new(&prior_m2(face, base, seen)).expect("the contact is near the whisker");
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
        let window = Window::of(&window);
        Some(BoundAt {
            since_touch_s: t_s - self.touch_s,
            sd_m,
            deviating_sd_m: sd_m,
            unsized_sd_m: sd_m,
            moving_sd_m: sd_m,
            window,
        })
    }
}

/// Prior covariance in World of a contact at a touch that is seen at `seen`.
fn prior_m2(face: &CalibratedFace, base: &Pose<Base, World>, seen: Point<Base>) -> Matrix2<f64> {
    let (low, high) = face.domain.arc_range_m();
    // A uniform distribution has the variance of its squared length divided by 12.
    let prior = Matrix2::from_diagonal(&vector![(high - low).powi(2) / 12.0, START_AWAY_SD_M.powi(2)]);
    let jacobian = base.rotation() * face.contact_jacobian(face.along_and_away(seen));
    jacobian * prior * jacobian.transpose()
}

impl Window {
    fn of(information: &Matrix2<f64>) -> Option<Self> {
        let eigenvalues = information.symmetric_eigenvalues();
        let (weak, strong) = (eigenvalues.min(), eigenvalues.max());
        // A smaller eigenvalue ratio is due to rounding.
        (weak > 1e-12 * strong).then(|| Self { sd_m: (1.0 / weak + 1.0 / strong).sqrt(), condition: strong / weak })
    }
}

/// Process model of a contact whose displacement in World is known: the covariance is unchanged.
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

/// Measurement model of a contact in World.
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
    fn verif_a_window_needs_information_in_two_directions() {
        let along = vector![3.0, 0.0];
        assert!(Window::of(&(along * along.transpose())).is_none());
        let both = Window::of(&Matrix2::from_diagonal(&vector![4.0, 1.0])).unwrap();
        assert_eq!((both.condition, both.sd_m), (4.0, 1.25f64.sqrt()));
    }
}
