//! A contact with an object at rest as a function of a state at a reference pose of the base, for fits.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};

use super::rolling::{MOST_TILT_RAD, Object, Place, STEP, Shape, TILT, stable_touch, step_of, stepped};
use super::swing::{Equilibrium, SwingTilt};
use crate::frames::Base;
use crate::space::estimators::ringing::{self, Rates, Response};
use crate::space::estimators::side::Side;
use crate::space::frames::{Point, Pose, rotation_vector};
use crate::space::sensor::Around;

/// Square of a time (s2): step of differences over an acceleration.
const STEP_S2: f64 = 1e-6;

/// Step of differences over the motion during the lag of the elastic force, relative to that motion.
const LAG_STEP: f64 = 1e-2;

/// Number of parts of a motion in which a contact is followed.
const PARTS: usize = 8;

/// Share of the tilt by inertia and damping that is unknown: frequency and masses are those of a straight beam and of the fitted
/// object, and the oscillation with which a touch begins is left out. Chosen on random scenes in space that are not reported.
const UNKNOWN_SHARE: f64 = 0.3;

/// Smallest standard deviation of the unknown part of the tilt (rad), chosen likewise.
const LEAST_UNKNOWN_RAD: f64 = 2e-4;

/// Tilt of the normal by the inertia and the damping of the wire.
#[derive(Clone, Copy, Debug)]
pub(in crate::space::estimators) struct DynamicTilt {
    /// At the present instant.
    pub(in crate::space::estimators) rad: f64,
    /// Root of the sum of squares of the amplitude of the oscillation by inertia, of the tilt by damping, and of the swing.
    size_rad: f64,
    /// Tilt by damping, as if the damping varied slowly.
    pub(in crate::space::estimators) damped_rad: f64,
}

impl DynamicTilt {
    /// The sum of this tilt and that by the swing of the wire.
    pub(in crate::space::estimators) fn with(self, swing: &SwingTilt) -> Self {
        Self { rad: self.rad + swing.rad, size_rad: self.size_rad.hypot(swing.size_rad2.sqrt()), ..self }
    }

    /// Standard deviation of the unknown part (rad).
    pub(in crate::space::estimators) fn sd_rad(&self) -> f64 {
        (UNKNOWN_SHARE * self.size_rad).max(LEAST_UNKNOWN_RAD)
    }
}

/// A state with its object, and those of the neighbouring states by which derivatives are computed.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Fitted<Body, const N: usize> {
    pub(in crate::space::estimators) x: SVector<f64, N>,
    here: Place,
    object: Body,
    /// The objects after a step along each entry; that of the tilt is not used.
    ahead: [Body; N],
}

impl<Body: Object, const N: usize> Fitted<Body, N> {
    /// Evaluations of the whisker's geometry in [`Self::new`].
    pub(in crate::space::estimators) const WORK: usize = 4;

    /// `None` if a state is no contact.
    pub(in crate::space::estimators) fn new<Model: Shape<N, Object = Body>>(
        side: &Side,
        shape: &Model,
        x: &SVector<f64, N>,
    ) -> Option<Self> {
        let here = Place::new(side, Around::of_state(x))?;
        let object = shape.object(x, &here);
        let mut ahead = [object; N];
        for (i, ahead) in ahead.iter_mut().enumerate().filter(|(i, _)| *i != TILT) {
            let (x, place) = stepped(side, x, &here, i, step_of(i))?;
            *ahead = shape.object(&x, &place);
        }
        Some(Self { x: *x, here, object, ahead })
    }

    /// The object after the base's motion, without tilt.
    pub(in crate::space::estimators) fn object(&self, motion: &Pose<Base, Base>) -> Body {
        self.object.moved(motion, 0.0)
    }

    /// Derivatives of the coordinates of a contact with the moved object by the state, except for its tilt, and by the tilt at the
    /// present instant; and the residual of the equations at the contact. By differences to one side, whose error is far below that
    /// of the model.
    pub(in crate::space::estimators) fn contact_slopes<Model: Shape<N, Object = Body>>(
        &self,
        shape: &Model,
        motion: &Pose<Base, Base>,
        (found, inverse): &(Place, Matrix3<f64>),
    ) -> (SMatrix<f64, 3, N>, Vector3<f64>, Vector3<f64>) {
        let mut slopes = SMatrix::<f64, 3, N>::zeros();
        let here = shape.residual(&self.object(motion), found);
        for (i, ahead) in self.ahead.iter().enumerate().filter(|(i, _)| *i != TILT) {
            let ahead = shape.residual(&ahead.moved(motion, 0.0), found);
            slopes.set_column(i, &(inverse * (here - ahead) / step_of(i)));
        }
        let tilted = shape.residual(&self.object.moved(motion, STEP), found);
        (slopes, inverse * (here - tilted) / STEP, here)
    }

    /// Tilt of the normal at a contact by the inertia and the damping of the wire ([`ringing`]). `here` is the residual of the
    /// equations at the contact.
    pub(in crate::space::estimators) fn dynamic_tilt<Model: Shape<N, Object = Body>>(
        &self,
        side: &Side,
        shape: &Model,
        motion: &Pose<Base, Base>,
        contact: (&Place, &Matrix3<f64>, &Vector3<f64>),
        response: &Response,
    ) -> DynamicTilt {
        let (found, ..) = contact;
        let masses = side.masses(found.at);
        let clamped = |rad: f64| rad.clamp(-MOST_TILT_RAD, MOST_TILT_RAD);
        let by_inertia = |of_base| {
            let relative_n = self.relative_m_s2(shape, motion, contact, of_base) * masses.bent_kg;
            clamped(found.tilt_per_n().dot(&(ringing::inertia_n(of_base, &found.contact, &masses) + relative_n)))
        };
        let inertial_rad = by_inertia(&response.now);
        let lag = self.displacement(shape, motion, contact, (&response.lag, LAG_STEP));
        let damped_rad = clamped(found.turned_across(&lag));
        let size_rad = inertial_rad.hypot(by_inertia(&response.apart)).hypot(damped_rad);
        DynamicTilt { rad: inertial_rad + damped_rad, size_rad, damped_rad }
    }

    /// Equilibrium of the contact, given the acceleration of the base and the tilt by damping, as if the damping varied slowly.
    pub(in crate::space::estimators) fn equilibrium<Model: Shape<N, Object = Body>>(
        &self,
        (side, shape): (&Side, &Model),
        motion: &Pose<Base, Base>,
        contact: (&Place, &Matrix3<f64>, &Vector3<f64>),
        of_base: &Rates,
        damped_rad: f64,
    ) -> Equilibrium {
        let found = contact.0;
        Equilibrium {
            contact_m: found.contact,
            by_base_m_s2: self.relative_m_s2(shape, motion, contact, of_base),
            rad_per_m_s2: found.tilt_per_n() * side.masses(found.at).bent_kg,
            damped_rad,
        }
    }

    /// Acceleration of the contact relative to the base (m/s2), in Base, due to the acceleration `of_base` of the base.
    fn relative_m_s2<Model: Shape<N, Object = Body>>(
        &self,
        shape: &Model,
        motion: &Pose<Base, Base>,
        contact: (&Place, &Matrix3<f64>, &Vector3<f64>),
        of_base: &Rates,
    ) -> Vector3<f64> {
        contact.0.slopes * self.displacement(shape, motion, contact, (of_base, STEP_S2))
    }

    /// Displacement of the contact, in the coordinates about the whisker, if the base is displaced by `multiple` times `of_base`,
    /// divided by `multiple`.
    fn displacement<Model: Shape<N, Object = Body>>(
        &self,
        shape: &Model,
        motion: &Pose<Base, Base>,
        (found, inverse, here): (&Place, &Matrix3<f64>, &Vector3<f64>),
        (of_base, multiple): (&Rates, f64),
    ) -> Vector3<f64> {
        let moved = motion.then(&ringing::displaced(of_base, multiple));
        inverse * (here - shape.residual(&self.object(&moved), found)) / multiple
    }

    /// The stable contact with an object after the base's motion, sought from `near`, then from the place that it has if it rests,
    /// then through the motion. `None` if there is none. `evaluations` grows as in [`super::rolling::touch`].
    pub(in crate::space::estimators) fn touched<Model: Shape<N, Object = Body>>(
        &self,
        side: &Side,
        shape: &Model,
        (object, motion): (&Body, &Pose<Base, Base>),
        near: Around,
        evaluations: &mut usize,
    ) -> Option<(Place, Matrix3<f64>)> {
        stable_touch(side, shape, object, near, evaluations)
            .or_else(|| stable_touch(side, shape, object, self.carried(side, motion), evaluations))
            .or_else(|| self.followed(side, shape, motion, evaluations))
    }

    /// The place of the contact after the base's motion, if it rests.
    fn carried(&self, side: &Side, motion: &Pose<Base, Base>) -> Around {
        Around::of(side.axis(), motion.apply(Point::from_vector(self.here.contact)))
    }

    /// The stable contact after the base's motion, followed from the contact before it in small parts of the motion: where the
    /// whisker is hardly deflected, the contact is found from nearby only. `None` if there is no contact on the way.
    fn followed<Model: Shape<N, Object = Body>>(
        &self,
        side: &Side,
        shape: &Model,
        motion: &Pose<Base, Base>,
        evaluations: &mut usize,
    ) -> Option<(Place, Matrix3<f64>)> {
        let turn_rad = rotation_vector(&motion.rotation());
        let (mut near, mut found) = (self.here.at, None);
        for part in (1..=PARTS).map(|part| part as f64 / PARTS as f64) {
            let so_far = Pose::new(motion.origin().vector() * part, Rotation3::new(turn_rad * part));
            let touch = stable_touch(side, shape, &self.object(&so_far), near, evaluations)?;
            near = touch.0.at;
            found = Some(touch);
        }
        found
    }
}
