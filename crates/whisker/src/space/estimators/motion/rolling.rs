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
//! recent acceleration `a` of the base across wire and force, relative to the force of the contact. A fit computes the tilt from
//! the motion of the base instead ([`crate::space::estimators::ringing`]).
//!
//! An object is moved with the base's motion, and the new contact solves three equations, by Newton's method. The Jacobian follows
//! from the same equations by the implicit function theorem.

use filters::Process;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::frames::Base;
use crate::space::estimators::Sample;
use crate::space::estimators::side::Side;
use crate::space::frames::{Point, Pose};
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

/// Smallest and largest standard deviation of the tilt, and that at the touch.
const LEAST_TILT_RAD: f64 = 5e-4;
pub(super) const MOST_TILT_RAD: f64 = 0.3;
pub(super) const FIRST_TILT_RAD: f64 = 0.05;

/// Index of the tilt in the state, which begins with the contact's coordinates.
pub(in crate::space::estimators) const TILT: usize = 3;

/// Steps of the differences: lengths, and angles or logarithms.
const STEP_M: f64 = 1e-7;
pub(super) const STEP: f64 = 1e-6;

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
        let (contact, slopes) = at.contact_with_jacobian(side.axis());
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

    /// Tilt of the normal by a force of inertia, per newton along each axis.
    pub(super) fn tilt_per_n(&self) -> Vector3<f64> {
        self.untilted.across / self.directions.force_n
    }

    /// Angle (rad) across the wire by which a displacement of the contact, in the coordinates about the whisker, turns the force of
    /// the equilibrium.
    pub(super) fn turned_across(&self, displacement: &Vector3<f64>) -> f64 {
        self.untilted.across.dot(&(self.directions.normal_slopes * displacement))
    }

    /// Angular frequency of the wire's oscillation along a surface on which a tilt displaces the contact by `by_tilt`, in the
    /// coordinates about the whisker per radian ([`crate::space::estimators::ringing`]).
    pub(in crate::space::estimators) fn oscillation_rad_s(&self, side: &Side, by_tilt: &Vector3<f64>) -> f64 {
        let displaced_m = self.untilted.across.dot(&(self.slopes * by_tilt)).abs();
        (self.directions.force_n / (side.masses(self.at).bent_kg * displaced_m)).sqrt()
    }

    /// The same on a plane. `None` if the derivatives vanish.
    pub(in crate::space::estimators) fn plane_rad_s(&self, side: &Side) -> Option<f64> {
        let across = self.untilted.across;
        let along_m = self.slopes.try_inverse()? * across;
        let turned = self.turned_across(&along_m);
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

/// An object at rest in the world, with the tilt of the normal at the contact.
pub(in crate::space::estimators) trait Object: Copy + Send {
    /// The object after the motion of the base, with the tilt at that instant.
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self;
}

/// The shape of an object at rest, with a state of `N` entries.
pub(in crate::space::estimators) trait Shape<const N: usize>:
    Copy + Send + Sync + 'static
{
    /// The object in Base.
    type Object: Object;

    /// The object that is touched at a place by a state, without tilt.
    fn object(&self, x: &SVector<f64, N>, place: &Place) -> Self::Object;

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
/// iteration does not converge. `evaluations` grows by the number of places at which the equations were evaluated.
pub(in crate::space::estimators) fn touch<Model: Shape<N>, const N: usize>(
    side: &Side,
    shape: &Model,
    object: &Model::Object,
    start: Around,
    evaluations: &mut usize,
) -> Option<(Place, Matrix3<f64>)> {
    let mut at = start.vector();
    for _ in 0..ITERATIONS {
        *evaluations += 1;
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
pub(super) fn stable_touch<Model: Shape<N>, const N: usize>(
    side: &Side,
    shape: &Model,
    object: &Model::Object,
    start: Around,
    evaluations: &mut usize,
) -> Option<(Place, Matrix3<f64>)> {
    touch(side, shape, object, start, evaluations).filter(|(_, inverse)| inverse.determinant() > 0.0)
}

/// The state of the contact after the base's motion, sought from `start`, and its derivatives by the state before it, by central
/// differences. The tilt is multiplied by `decay`. `None` if there is no contact.
pub(in crate::space::estimators) fn moved<Model: Shape<N>, const N: usize>(
    side: &Side,
    shape: &Model,
    x: &SVector<f64, N>,
    (motion, decay): (&Pose<Base, Base>, f64),
    start: Around,
) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
    let here = Place::new(side, Around::of_state(x))?;
    let object = shape.object(x, &here).moved(motion, decay * x[TILT]);
    let (found, inverse) = touch(side, shape, &object, start, &mut 0)?;
    let mut jacobian = SMatrix::<f64, N, N>::zeros();
    for i in 0..N {
        let step = step_of(i);
        let mut slope = SVector::<f64, N>::zeros();
        for sign in [1.0, -1.0] {
            let (x, place) = stepped(side, x, &here, i, sign * step)?;
            let object = shape.object(&x, &place).moved(motion, decay * x[TILT]);
            let at = found.at.vector() - inverse * shape.residual(&object, &found);
            let place = Place::new(side, Around::of_state(&at))?;
            slope += shape.state(&object, &place, &x) * sign;
        }
        jacobian.set_column(i, &(slope / (2.0 * step)));
    }
    Some((shape.state(&object, &found, x), jacobian))
}

/// Step of the differences along an entry.
pub(super) fn step_of(entry: usize) -> f64 {
    if entry < 3 { STEP_M } else { STEP }
}

/// A state after a step along one entry, and its place. `None` if it is no contact.
pub(super) fn stepped<const N: usize>(
    side: &Side,
    x: &SVector<f64, N>,
    here: &Place,
    entry: usize,
    step: f64,
) -> Option<(SVector<f64, N>, Place)> {
    let mut ahead = *x;
    ahead[entry] += step;
    let place = if entry < 3 { Place::new(side, Around::of_state(&ahead))? } else { *here };
    Some((ahead, place))
}

/// Process of one step.
pub(in crate::space::estimators) struct Roll<'a, Model, const N: usize> {
    side: &'a Side,
    motion: Pose<Base, Base>,
    shape: Model,
    dt_s: f64,
    /// Second moment of the base's recent acceleration (m2/s4).
    unrest: Matrix3<f64>,
}

impl<'a, Model: Shape<N>, const N: usize> Roll<'a, Model, N> {
    pub(super) fn new(shape: Model, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Self {
        Self { side, motion: sample.motion, shape, dt_s: sample.dt_s, unrest: *unrest }
    }

    /// Factor of the tilt from one instant to the next.
    fn decay(&self) -> f64 {
        (-self.dt_s / TILT_S).exp()
    }

    fn object(&self, x: &SVector<f64, N>, place: &Place) -> Model::Object {
        self.shape.object(x, place).moved(&self.motion, self.decay() * x[TILT])
    }

    fn start(&self, x: &SVector<f64, N>) -> Around {
        let contact = Around::of_state(x).contact(self.side.axis());
        Around::of(self.side.axis(), self.motion.apply(contact))
    }

    /// The state after the step, and its derivatives.
    fn moved(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        moved(self.side, &self.shape, x, (&self.motion, self.decay()), self.start(x))
    }

    /// A step in which the contact rests: where the equations have no solution.
    fn rested(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let mut moved = *x;
        moved.fixed_rows_mut::<3>(0).copy_from(&self.start(x).vector());
        moved[TILT] *= self.decay();
        moved
    }
}

impl<Model: Shape<N>, const N: usize> Process<N> for Roll<'_, Model, N> {
    fn predict(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let solved = || {
            let here = Place::new(self.side, Around::of_state(x))?;
            let object = self.object(x, &here);
            let (found, _) = touch(self.side, &self.shape, &object, self.start(x), &mut 0)?;
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
