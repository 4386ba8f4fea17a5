//! A contact that slides without friction over an object at rest, common to objects of all shapes.
//!
//! Without friction the force at the contact `p` is along the normal of wire and object. In equilibrium it has the direction `n(p)`
//! of the rod's mechanics. While the base accelerates, the wire lags behind and rings along the surface for a moment: inertia
//! then turns the normal about the wire's tangent `t`, across which the force stays, by an angle `beta`,
//!
//! ```text
//! nu = n cos beta + (n x t) sin beta
//! ```
//!
//! an Ornstein-Uhlenbeck process with the standard deviation `m a / F`: the inertial force of the wire with mass `m` under the
//! recent acceleration `a` of the base across wire and force, relative to the force of the contact. A fit computes the tilt from the
//! motion of the base instead ([`ringing`]).
//!
//! An object is moved with the base's motion, and the new contact solves three equations, by Newton's method. The Jacobian follows
//! from the same equations by the implicit function theorem.

use filters::Process;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};

use crate::frames::Base;
use crate::space::estimators::Sample;
use crate::space::estimators::ringing::{self, Response};
use crate::space::estimators::side::Side;
use crate::space::frames::{Point, Pose, rotation_vector};
use crate::space::sensor::{Around, Directions};

/// Largest number of Newton iterations, and the step length (m) below which they end: as they converge quadratically, the
/// remaining error is then below 10 nm.
const ITERATIONS: usize = 8;
const CONVERGED_M: f64 = 2e-6;

/// Longest step of the iteration, a guard against steps out of the table.
const LONGEST_M: f64 = 2e-3;

/// Correlation time of the tilt: about a fifth of the period of the oscillation along a surface, 0.2 to 0.3 s.
pub(in crate::space::estimators) const TILT_S: f64 = 0.05;

/// Share of an acceleration in any direction that tilts the normal: on a curved or oblique surface, a base that moves along the
/// normal makes the contact and the wire slide. Chosen on random scenes in space that are not reported.
const SLIDING_SHARE: f64 = 0.3;

/// Share of the oscillation by inertia that is unknown: frequency and masses are those of a straight beam and of the fitted object,
/// and the oscillation with which a touch begins is left out. Chosen on random scenes in space that are not reported.
const UNKNOWN_SHARE: f64 = 0.6;

/// Smallest and largest standard deviation of the tilt, and that at the touch.
const LEAST_TILT_RAD: f64 = 5e-4;
const MOST_TILT_RAD: f64 = 0.3;
pub(super) const FIRST_TILT_RAD: f64 = 0.05;

/// Index of the tilt in the state, which begins with the contact's coordinates.
pub(in crate::space::estimators) const TILT: usize = 3;

/// Steps of the differences: lengths, and angles or logarithms.
const STEP_M: f64 = 1e-7;
const STEP: f64 = 1e-6;

/// Square of the time (s2) in which an acceleration displaces an object for a difference.
const STEP_S2: f64 = 1e-6;

/// Number of parts of a motion in which a contact is followed.
const PARTS: usize = 8;

/// A contact with its geometry in Base.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Place {
    /// Coordinates about the whisker.
    pub(in crate::space::estimators) at: Around,
    /// Contact on the centre line (m), and its derivatives by the coordinates about the whisker.
    pub(super) contact: Vector3<f64>,
    pub(super) slopes: Matrix3<f64>,
    /// Directions of the equilibrium, and the axes that they give.
    directions: Directions,
    untilted: Axes,
}

/// Tilt of the normal by the inertia of the wire.
#[derive(Clone, Copy, Debug)]
pub(in crate::space::estimators) struct InertialTilt {
    /// At the present instant.
    pub(in crate::space::estimators) rad: f64,
    /// Amplitude of its oscillation.
    amplitude_rad: f64,
}

impl InertialTilt {
    /// Standard deviation of the part of the oscillation that is unknown.
    pub(in crate::space::estimators) fn sd_rad(&self) -> f64 {
        (UNKNOWN_SHARE * self.amplitude_rad).max(LEAST_TILT_RAD)
    }
}

/// Axes at a contact: normal of the touched surface, tangent of the wire, and the direction across both.
#[derive(Clone, Copy)]
pub(super) struct Axes {
    pub(super) normal: Vector3<f64>,
    pub(super) tangent: Vector3<f64>,
    pub(super) across: Vector3<f64>,
}

impl Axes {
    fn of(directions: &Directions) -> Self {
        let Directions { normal, tangent, .. } = *directions;
        let across = normal.cross(&tangent).normalize();
        Self { normal, tangent: across.cross(&normal), across }
    }
}

impl Place {
    pub(in crate::space::estimators) fn new(side: &Side, at: Around) -> Option<Self> {
        let (contact, slopes) = at.contact_with_jacobian(side.rest());
        let directions = side.directions(at)?;
        Some(Self { at, contact: contact.vector(), slopes, untilted: Axes::of(&directions), directions })
    }

    /// The place after a step so short that its derivatives stay the same.
    fn shifted(&self, step: &Vector3<f64>) -> Self {
        let mut directions = self.directions;
        directions.normal = (directions.normal + directions.normal_slopes * step).normalize();
        directions.tangent = (directions.tangent + directions.tangent_slopes * step).normalize();
        Self {
            at: Around::of_state(&(self.at.vector() + step)),
            contact: self.contact + self.slopes * step,
            untilted: Axes::of(&directions),
            directions,
            ..*self
        }
    }

    /// Axes with the normal tilted by `tilt_rad`.
    pub(super) fn axes(&self, tilt_rad: f64) -> Axes {
        let Axes { normal, tangent, across } = self.untilted;
        if tilt_rad == 0.0 {
            return self.untilted;
        }
        let (sin, cos) = tilt_rad.sin_cos();
        Axes { normal: normal * cos + across * sin, tangent, across: across * cos - normal * sin }
    }

    /// Standard deviation of the tilt after accelerations of the base with this second moment (m2/s4).
    pub(in crate::space::estimators) fn tilt_sd_rad(&self, side: &Side, unrest: &Matrix3<f64>) -> f64 {
        let across = self.axes(0.0).across;
        let second = across.dot(&(unrest * across)) + SLIDING_SHARE.powi(2) * unrest.trace();
        let acceleration_m_s2 = second.max(0.0).sqrt();
        (side.masses(self.at).whole_kg * acceleration_m_s2 / self.directions.force_n)
            .clamp(LEAST_TILT_RAD, MOST_TILT_RAD)
    }

    /// Angular frequency of the wire's oscillation along a surface on which a tilt displaces the contact by `by_tilt`, in the
    /// coordinates about the whisker per radian ([`ringing`]).
    pub(in crate::space::estimators) fn oscillation_rad_s(&self, side: &Side, by_tilt: &Vector3<f64>) -> f64 {
        let displaced_m = self.untilted.across.dot(&(self.slopes * by_tilt)).abs();
        (self.directions.force_n / (side.masses(self.at).bent_kg * displaced_m)).sqrt()
    }

    /// The same on a plane. `None` if the derivatives vanish.
    pub(in crate::space::estimators) fn plane_rad_s(&self, side: &Side) -> Option<f64> {
        let across = self.untilted.across;
        let along_m = self.slopes.try_inverse()? * across;
        let turned = across.dot(&(self.directions.normal_slopes * along_m));
        Some(self.oscillation_rad_s(side, &(along_m / turned)))
    }

    /// Derivatives of the tilted normal by the coordinates about the whisker.
    pub(super) fn normal_slopes(&self, tilt_rad: f64) -> Matrix3<f64> {
        let Directions { normal, normal_slopes, tangent, tangent_slopes, .. } = self.directions;
        if tilt_rad == 0.0 {
            return normal_slopes;
        }
        let across = normal.cross_matrix() * tangent_slopes - tangent.cross_matrix() * normal_slopes;
        normal_slopes * tilt_rad.cos() + across * tilt_rad.sin()
    }
}

/// The shape of an object at rest, with a state of `N` entries.
pub(in crate::space::estimators) trait Shape<const N: usize>:
    Copy + Send + Sync + 'static
{
    /// The object in Base, at the present instant.
    type Object: Copy;

    /// The object that is touched at a place by a state, moved with the base's motion, and the tilt at the present instant.
    fn object(&self, x: &SVector<f64, N>, place: &Place, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self::Object;

    /// The equations of a contact with an object, in metres: zero at the contact.
    fn residual(&self, object: &Self::Object, place: &Place) -> Vector3<f64>;

    /// The same, and their derivatives by the coordinates about the whisker, whose determinant is positive where the contact is
    /// stable ([`stable_touch`]).
    fn equations(&self, object: &Self::Object, place: &Place) -> (Vector3<f64>, Matrix3<f64>);

    /// The state of a contact with an object, from the former state.
    fn state(&self, object: &Self::Object, place: &Place, before: &SVector<f64, N>) -> SVector<f64, N>;

    /// Means and standard deviations of the prior of a state's entries after the tilt, given those of one hypothesis; the other
    /// entries are arbitrary.
    fn prior(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SVector<f64, N>);

    /// Variance that one step of `dt_s` adds to each entry, except for the tilt.
    fn variances(&self, dt_s: f64) -> SVector<f64, N>;
}

/// The contact with an object nearest to `start`, and the inverse of the derivatives of its equations, 3x3. `None` if the
/// iteration does not converge.
pub(in crate::space::estimators) fn touch<Object: Shape<N>, const N: usize>(
    side: &Side,
    shape: &Object,
    object: &Object::Object,
    start: Around,
) -> Option<(Place, Matrix3<f64>)> {
    let mut at = start.vector();
    for _ in 0..ITERATIONS {
        let place = Place::new(side, Around::of_state(&at))?;
        let (residual, jacobian) = shape.equations(object, &place);
        let inverse = jacobian.try_inverse()?;
        let step = inverse * residual;
        let length_m = step.norm();
        if !length_m.is_finite() {
            return None;
        }
        if length_m < CONVERGED_M {
            return Some((place.shifted(&-step), inverse));
        }
        at -= step * (LONGEST_M / length_m).min(1.0);
    }
    None
}

/// As [`touch`], if the contact is a stable equilibrium. The energy of the whisker, as a function of the point of the surface
/// that holds it, has a minimum across the wire, where the whisker may slide off sideways, and a maximum along it, where the
/// wire touches the point that deflects it most: the determinant of its Hessian is negative, and that of the derivatives of
/// the equations positive. On a sphere with a radius below the deflection the contact is unstable.
fn stable_touch<Object: Shape<N>, const N: usize>(
    side: &Side,
    shape: &Object,
    object: &Object::Object,
    start: Around,
) -> Option<(Place, Matrix3<f64>)> {
    touch(side, shape, object, start).filter(|(_, inverse)| inverse.determinant() > 0.0)
}

/// The states after a step forwards and backwards along one entry, and half the inverse of the step.
type Sides<const N: usize> = ([(SVector<f64, N>, Place); 2], f64);

/// A state with the neighbouring states by which derivatives are computed.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Neighbours<const N: usize> {
    pub(in crate::space::estimators) x: SVector<f64, N>,
    here: Place,
    sides: [Sides<N>; N],
}

impl<const N: usize> Neighbours<N> {
    /// `None` if a state is no contact.
    pub(in crate::space::estimators) fn new(side: &Side, x: &SVector<f64, N>) -> Option<Self> {
        let here = Place::new(side, Around::of_state(x))?;
        let mut sides = [([(*x, here); 2], 0.0); N];
        for (i, (neighbours, share)) in sides.iter_mut().enumerate() {
            let step = if i < 3 { STEP_M } else { STEP };
            *share = 0.5 / step;
            for ((x, place), step) in neighbours.iter_mut().zip([step, -step]) {
                x[i] += step;
                if i < 3 {
                    *place = Place::new(side, Around::of_state(x))?;
                }
            }
        }
        Some(Self { x: *x, here, sides })
    }

    /// The object of the state, moved with the base's motion, with the tilt at the present instant.
    pub(in crate::space::estimators) fn object<Object: Shape<N>>(
        &self,
        shape: &Object,
        motion: &Pose<Base, Base>,
        tilt_rad: f64,
    ) -> Object::Object {
        shape.object(&self.x, &self.here, motion, tilt_rad)
    }

    /// Derivatives of the coordinates of a contact with the moved object by the state, except for its tilt, and by the tilt at the
    /// present instant; and the residual of the equations at the contact. By differences to one side, whose error is far below that
    /// of the model.
    pub(in crate::space::estimators) fn contact_slopes<Object: Shape<N>>(
        &self,
        shape: &Object,
        motion: &Pose<Base, Base>,
        (found, inverse): &(Place, Matrix3<f64>),
    ) -> (SMatrix<f64, 3, N>, Vector3<f64>, Vector3<f64>) {
        let mut slopes = SMatrix::<f64, 3, N>::zeros();
        let here = shape.residual(&self.object(shape, motion, 0.0), found);
        for (i, ([(x, place), _], share)) in self.sides.iter().enumerate().filter(|(i, _)| *i != TILT) {
            let ahead = shape.residual(&shape.object(x, place, motion, 0.0), found);
            slopes.set_column(i, &(inverse * (here - ahead) * (2.0 * share)));
        }
        let tilted = shape.residual(&self.object(shape, motion, STEP), found);
        (slopes, inverse * (here - tilted) / STEP, here)
    }

    /// Tilt of the normal at a contact by the inertia of the wire ([`ringing`]), and the amplitude of its oscillation. `here` is the
    /// residual of the equations at the contact.
    pub(in crate::space::estimators) fn inertial_tilt<Object: Shape<N>>(
        &self,
        side: &Side,
        shape: &Object,
        motion: &Pose<Base, Base>,
        (found, inverse, here): (&Place, &Matrix3<f64>, &Vector3<f64>),
        response: &Response,
    ) -> InertialTilt {
        let masses = side.masses(found.at);
        let tilt_rad = |of_base| {
            let moved = motion.then(&ringing::displaced(of_base, STEP_S2));
            let ahead = shape.residual(&self.object(shape, &moved, 0.0), found);
            let relative_m_s2 = found.slopes * (inverse * (here - ahead)) / STEP_S2;
            let inertia_n = ringing::inertia_n(of_base, &found.contact, &masses) + relative_m_s2 * masses.bent_kg;
            (found.untilted.across.dot(&inertia_n) / found.directions.force_n).clamp(-MOST_TILT_RAD, MOST_TILT_RAD)
        };
        let rad = tilt_rad(&response.now);
        InertialTilt { rad, amplitude_rad: rad.hypot(tilt_rad(&response.apart)) }
    }

    /// The stable contact with an object after the base's motion, sought from `near`, then from the place that it has if it rests,
    /// then through the motion. `None` if there is none.
    pub(in crate::space::estimators) fn touched<Object: Shape<N>>(
        &self,
        side: &Side,
        shape: &Object,
        (object, motion): (&Object::Object, &Pose<Base, Base>),
        near: Around,
    ) -> Option<(Place, Matrix3<f64>)> {
        stable_touch(side, shape, object, near)
            .or_else(|| stable_touch(side, shape, object, self.carried(side, motion)))
            .or_else(|| self.followed(side, shape, motion))
    }

    /// The place of the contact after the base's motion, if it rests.
    fn carried(&self, side: &Side, motion: &Pose<Base, Base>) -> Around {
        Around::of(side.rest(), motion.apply(Point::from_vector(self.here.contact)))
    }

    /// The stable contact after the base's motion, followed from the contact before it in small parts of the motion: where the
    /// whisker is hardly deflected, the contact is found from nearby only. `None` if there is no contact on the way.
    fn followed<Object: Shape<N>>(
        &self,
        side: &Side,
        shape: &Object,
        motion: &Pose<Base, Base>,
    ) -> Option<(Place, Matrix3<f64>)> {
        let turn_rad = rotation_vector(&motion.rotation());
        let (mut near, mut found) = (self.here.at, None);
        for part in (1..=PARTS).map(|part| part as f64 / PARTS as f64) {
            let so_far = Pose::new(motion.origin().vector() * part, Rotation3::new(turn_rad * part));
            let touch = stable_touch(side, shape, &self.object(shape, &so_far, 0.0), near)?;
            near = touch.0.at;
            found = Some(touch);
        }
        found
    }

    /// The state of the contact with the object after the base's motion, sought from `start`, and its derivatives. The tilt is
    /// multiplied by `decay`. `None` if there is no contact.
    pub(in crate::space::estimators) fn moved<Object: Shape<N>>(
        &self,
        side: &Side,
        shape: &Object,
        motion: &Pose<Base, Base>,
        decay: f64,
        start: Around,
    ) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        let object = self.object(shape, motion, decay * self.x[TILT]);
        let (found, inverse) = touch(side, shape, &object, start)?;
        let mut jacobian = SMatrix::<f64, N, N>::zeros();
        for (i, (neighbours, share)) in self.sides.iter().enumerate() {
            let mut slope = SVector::<f64, N>::zeros();
            for ((x, place), sign) in neighbours.iter().zip([1.0, -1.0]) {
                let object = shape.object(x, place, motion, decay * x[TILT]);
                let at = found.at.vector() - inverse * shape.residual(&object, &found);
                let place = Place::new(side, Around::of_state(&at))?;
                slope += shape.state(&object, &place, x) * sign;
            }
            jacobian.set_column(i, &(slope * *share));
        }
        Some((shape.state(&object, &found, &self.x), jacobian))
    }
}

/// Process of one step.
pub(in crate::space::estimators) struct Roll<'a, Object, const N: usize> {
    side: &'a Side,
    motion: Pose<Base, Base>,
    shape: Object,
    dt_s: f64,
    /// Second moment of the base's recent acceleration (m2/s4).
    unrest: Matrix3<f64>,
}

impl<'a, Object: Shape<N>, const N: usize> Roll<'a, Object, N> {
    pub(super) fn new(shape: Object, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Self {
        Self { side, motion: sample.motion, shape, dt_s: sample.dt_s, unrest: *unrest }
    }

    /// Factor of the tilt from one instant to the next.
    fn decay(&self) -> f64 {
        (-self.dt_s / TILT_S).exp()
    }

    fn object(&self, x: &SVector<f64, N>, place: &Place) -> Object::Object {
        self.shape.object(x, place, &self.motion, self.decay() * x[TILT])
    }

    fn start(&self, x: &SVector<f64, N>) -> Around {
        let contact = Around::of_state(x).contact(self.side.rest());
        Around::of(self.side.rest(), self.motion.apply(contact))
    }

    /// The state after the step, and its derivatives.
    fn moved(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        Neighbours::new(self.side, x)?.moved(self.side, &self.shape, &self.motion, self.decay(), self.start(x))
    }

    /// A step in which the contact rests: where the equations have no solution.
    fn rested(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let mut moved = *x;
        moved.fixed_rows_mut::<3>(0).copy_from(&self.start(x).vector());
        moved[TILT] *= self.decay();
        moved
    }
}

impl<Object: Shape<N>, const N: usize> Process<N> for Roll<'_, Object, N> {
    fn predict(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let solved = || {
            let here = Place::new(self.side, Around::of_state(x))?;
            let object = self.object(x, &here);
            let (found, _) = touch(self.side, &self.shape, &object, self.start(x))?;
            Some(self.shape.state(&object, &found, x))
        };
        solved().unwrap_or_else(|| self.rested(x))
    }

    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let mut variances = self.shape.variances(self.dt_s);
        let tilt = Place::new(self.side, Around::of_state(x))
            .map_or(MOST_TILT_RAD, |place| place.tilt_sd_rad(self.side, &self.unrest));
        variances[TILT] = tilt.powi(2) * (1.0 - self.decay().powi(2));
        SMatrix::from_diagonal(&variances)
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        self.linearised(x).1
    }

    fn linearised(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
        let (moved, jacobian) = self.moved(x).unwrap_or_else(|| (self.rested(x), SMatrix::identity()));
        (moved, jacobian, self.noise(x))
    }
}

/// A point of Base, moved with the motion of the base.
pub(super) fn carried(point: Vector3<f64>, motion: &Pose<Base, Base>) -> Vector3<f64> {
    motion.apply(Point::from_vector(point)).vector()
}
