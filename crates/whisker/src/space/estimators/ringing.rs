//! Oscillation of the wire along the surface that it touches.
//!
//! Without friction, elasticity alone holds the wire along the surface. If it is displaced by `y` across itself from the
//! equilibrium, the force of its deflection is turned from the normal by the angle `k y / F`, with the force `F` of the contact,
//! and
//!
//! ```text
//! m y'' + c y' + k y = -m_a a - m_r r - m b - T F n'        c = T k
//! ```
//!
//! where `a` is the acceleration of the base, `r` the acceleration of the contact due to the rotation of the base, `b` that of the
//! equilibrium relative to the base, `n'` the rate of change of the direction of the equilibrium's force across the wire, in Base,
//! and `T` the ratio of damping to stiffness of the material. The masses `m`, `m_a` and `m_r` are those of a wire that bends, that
//! accelerates as a whole, and that rotates about its root ([`Masses`]): the rotation accelerates the free end of a wire that is
//! touched near the root far more than the contact. They are those of a straight wire. If the accelerations vary slowly, the angle
//! without damping is `-(m_a a + m_r r + m b) / F`. Otherwise, since the equation is linear, it is the same expression with the
//! response of a damped oscillator to the accelerations in their place.
//!
//! The elastic force lags behind that of the contact by the time `T`, for small deflections exactly. If the contact slides along
//! the whisker or the deflection changes, the damping adds the angle `-T n'`. Where this angle varies slowly, the response of the
//! oscillator is not applied to it.
//!
//! Over the short time of an oscillation, `b` usually depends linearly on the acceleration of the base. The oscillator is therefore
//! driven by the acceleration of the base, in six components, and the object determines the angle from the response. The stiffness
//! `k` follows from the displacement of the contact by a tilt of the normal. Where the equilibrium moves fast,
//! [`super::motion::Swing`] computes the additional tilt for each object.

use std::f64::consts::PI;

use nalgebra::{Rotation3, SVector, Vector3};

use super::Sample;
use crate::Whisker;
use crate::frames::Base;
use crate::space::frames::{Pose, rotation_vector};

/// Angular frequency before the first contact is known (rad/s).
const FIRST_RAD_S: f64 = 50.0;

/// Range of angular frequencies (rad/s). Where a small object makes the contact unstable, the frequency vanishes.
const RAD_S: std::ops::RangeInclusive<f64> = 10.0..=1000.0;

/// Smallest frequency of a damped oscillation relative to the undamped one: beyond critical damping there is none.
const LEAST_DAMPED: f64 = 0.1;

/// Linear (m/s, m/s2) and angular (rad/s, rad/s2) rates of the base, in Base: those of its origin, and those of its rotation.
pub(super) type Rates = SVector<f64, 6>;

/// The angular frequency (rad/s), limited to [`RAD_S`]. `None` if it is not a number.
pub(super) fn frequency(rad_s: f64) -> Option<f64> {
    (!rad_s.is_nan()).then(|| rad_s.clamp(*RAD_S.start(), *RAD_S.end()))
}

/// Damped oscillator in `N` components.
#[derive(Clone, Copy, Debug)]
pub(super) struct Oscillator<const N: usize> {
    pub(super) value: SVector<f64, N>,
    /// Change of the value per second.
    pub(super) rate: SVector<f64, N>,
}

impl<const N: usize> Oscillator<N> {
    /// Advances by `dt_s`, during which the equilibrium counts as constant. `rad_s` is the angular frequency without damping.
    pub(super) fn advance(&mut self, equilibrium: &SVector<f64, N>, rad_s: f64, damping_s: f64, dt_s: f64) {
        let per_s = 0.5 * damping_s * rad_s.powi(2);
        let damped_rad_s = (rad_s.powi(2) - per_s.powi(2)).max(0.0).sqrt().max(LEAST_DAMPED * rad_s);
        let (sin, cos) = (damped_rad_s * dt_s).sin_cos();
        let (sin_s, decay) = (sin / damped_rad_s, (-per_s * dt_s).exp());
        let (away, rate) = (self.value - equilibrium, self.rate);
        self.value = equilibrium + (away * (cos + per_s * sin_s) + rate * sin_s) * decay;
        self.rate = (rate * (cos - per_s * sin_s) - away * ((per_s.powi(2) + damped_rad_s.powi(2)) * sin_s)) * decay;
    }
}

/// Response of a wire that touches an object to the accelerations of the base.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ringing {
    /// Ratio of damping to stiffness of the wire (s).
    damping_s: f64,
    /// Angular frequency of the undamped oscillation.
    rad_s: f64,
    /// `None` before the first motion.
    velocity: Option<Rates>,
    response: Oscillator<6>,
    /// Acceleration of the base at the last step.
    acceleration: Rates,
    /// [`Response::lag`].
    lag: Rates,
}

impl Ringing {
    pub(super) fn new(damping_s: f64) -> Self {
        let [value, rate, acceleration, lag] = [Rates::zeros(); 4];
        let response = Oscillator { value, rate };
        Self { damping_s, rad_s: FIRST_RAD_S, velocity: None, response, acceleration, lag }
    }

    /// Sets the angular frequency of the undamped oscillation. One that is not a number is ignored.
    pub(super) fn set_frequency(&mut self, rad_s: f64) {
        self.rad_s = frequency(rad_s).unwrap_or(self.rad_s);
    }

    /// Takes the motion of a step, in which the acceleration counts as constant.
    pub(super) fn advance(&mut self, sample: &Sample) {
        let dt_s = sample.dt_s;
        if dt_s <= 0.0 {
            return;
        }
        let (linear, angular) = (sample.motion.origin().vector(), rotation_vector(&sample.motion.rotation()));
        // Objects at rest move in Base opposite to the base.
        let velocity = Rates::from_fn(|i, _| if i < 3 { linear[i] } else { angular[i - 3] }) / -dt_s;
        let before = self.velocity.replace(velocity).unwrap_or(velocity);
        self.acceleration = (velocity - before) / dt_s;
        self.lag = velocity * self.damping_s;
        self.response.advance(&self.acceleration, self.rad_s, self.damping_s, dt_s);
    }

    /// The present response.
    pub(super) fn response(&self) -> Response {
        let Oscillator { value, rate } = self.response;
        Response { now: value, apart: rate / self.rad_s, lag: self.lag }
    }

    /// Acceleration of the base at the last step.
    pub(super) fn acceleration(&self) -> Rates {
        self.acceleration
    }
}

/// Response of a wire to the motion of the base.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Response {
    /// At the present instant, as an acceleration of the base.
    pub(super) now: Rates,
    /// A quarter of a period away. Both together give the amplitude.
    pub(super) apart: Rates,
    /// Motion of the base (m, rad) during the time by which the elastic force lags behind.
    pub(super) lag: Rates,
}

impl Response {
    /// Moves the mean of two, with a share of the other. The mean of an oscillation has the amplitude of the means.
    pub(super) fn include(&mut self, other: &Self, share: f64) {
        self.now += (other.now - self.now) * share;
        self.apart += (other.apart - self.apart) * share;
        self.lag += (other.lag - self.lag) * share;
    }
}

/// Mass times acceleration of the wire at a contact (N), in Base, for an acceleration of the base. Its component across the wire
/// tilts the force of the contact.
pub(super) fn inertia_n(of_base: &Rates, contact_m: &Vector3<f64>, masses: &Masses) -> Vector3<f64> {
    let (linear_m_s2, angular_rad_s2) = (of_base.fixed_rows::<3>(0), of_base.fixed_rows::<3>(3));
    linear_m_s2 * masses.whole_kg + angular_rad_s2.cross(contact_m) * masses.turned_kg
}

/// Motion of objects at rest relative to a base that is displaced by `of_base * multiple` (m, rad).
pub(super) fn displaced(of_base: &Rates, multiple: f64) -> Pose<Base, Base> {
    let moved = of_base * -multiple;
    Pose::new(moved.fixed_rows::<3>(0).into_owned(), Rotation3::new(moved.fixed_rows::<3>(3).into_owned()))
}

/// Masses that act across a wire at a contact (kg), if the wire bends as under a force at the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Masses {
    /// Force by the inertia of a wire that accelerates as a whole, per acceleration: by reciprocity, the deflection of the contact
    /// under a uniform load over that under a force at the contact.
    pub(super) whole_kg: f64,
    /// The same for a rigid rotation about the root, per acceleration of the contact.
    pub(super) turned_kg: f64,
    /// The same of a wire that bends, per acceleration of the contact relative to the base.
    pub(super) bent_kg: f64,
}

/// A straight uniform beam on a compliant root.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    mass_kg: f64,
    length_m: f64,
    /// Arc length of a force at which root and bending displace its place equally: three times the bending stiffness over the
    /// stiffness of the root.
    root_m: f64,
}

/// Smallest relative arc length of a contact at which the masses are evaluated; nearer to the root, those at this place are used.
const LEAST_SHARE: f64 = 0.05;

impl Beam {
    /// The beam with the mass and the length of a whisker, and with the stiffness of its middle.
    pub(super) fn new(whisker: &Whisker) -> Self {
        let Whisker { root_diameter_m: root_m, tip_diameter_m: tip_m, length_m, .. } = *whisker;
        let section_m2 = PI / 12.0 * (root_m * root_m + root_m * tip_m + tip_m * tip_m);
        let stiffness_n_m2 = whisker.bending_stiffness_n_m2(0.5 * length_m);
        Self {
            mass_kg: whisker.density_kg_m3 * section_m2 * length_m,
            length_m,
            root_m: 3.0 * stiffness_n_m2 / whisker.root_stiffness_n_m_rad,
        }
    }

    /// Mass of the whisker.
    pub(super) fn mass_kg(&self) -> f64 {
        self.mass_kg
    }

    /// The masses at an arc length. In units of the arc length `s` of the force, and relative to the deflection there, the
    /// deflection is `(1 - q) g(x) + q x` with `g = x^2 (3 - x) / 2` up to the force and `(3 x - 1) / 2` beyond, and the share `q`
    /// of the root. The masses are the integrals of the deflection, of its product with `x`, and of its square.
    pub(super) fn masses(&self, along_m: f64) -> Masses {
        let along_m = along_m.max(LEAST_SHARE * self.length_m);
        let end = (self.length_m / along_m).max(1.0);
        let q = self.root_m / (self.root_m + along_m);
        let bent = 0.75 * end.powi(2) - 0.5 * end + 0.125;
        let bent_2 = 33.0 / 140.0 + ((3.0 * end - 1.0).powi(3) - 8.0) / 36.0;
        let both = 11.0 / 40.0 + 0.5 * (end.powi(3) - 0.5 * end.powi(2) - 0.5);
        let once = (1.0 - q) * bent + q * 0.5 * end.powi(2);
        let twice = (1.0 - q).powi(2) * bent_2 + 2.0 * q * (1.0 - q) * both + q.powi(2) * end.powi(3) / 3.0;
        let turned = (1.0 - q) * both + q * end.powi(3) / 3.0;
        let mass_kg = self.mass_kg / end;
        Masses { whole_kg: mass_kg * once, turned_kg: mass_kg * turned, bent_kg: mass_kg * twice }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    /// The response to a step of the velocity is that of an oscillator to an impulse.
    #[test]
    fn verif_the_lag_is_the_motion_of_the_base_during_the_damping_time() {
        let mut ringing = Ringing::new(4e-3);
        let turn = Rotation3::new(Vector3::new(0.0, 0.0, 2e-3));
        for dt_s in [0.01, 0.02] {
            // Objects move opposite to the base.
            let motion = Pose::new(Vector3::new(-1e-4, 0.0, 0.0), turn.inverse());
            ringing.advance(&Sample { motion, dt_s, reading_n_m: Vector2::zeros() });
            let expected = Rates::from([1e-4, 0.0, 0.0, 0.0, 0.0, 2e-3]) * (4e-3 / dt_s);
            assert!((ringing.response().lag - expected).norm() < 1e-12);
        }
        let mut mean = Response::default();
        mean.include(&ringing.response(), 0.25);
        assert_eq!(mean.lag, ringing.response().lag * 0.25);
    }

    #[test]
    fn verif_the_response_is_that_of_a_damped_oscillator() {
        const DT_S: f64 = 1e-3;
        let (damping_s, rad_s, speed_m_s) = (2e-3, 50.0, 0.01);
        let mut ringing = Ringing::new(damping_s);
        ringing.set_frequency(rad_s);
        let per_s = 0.5 * damping_s * rad_s * rad_s;
        let damped_rad_s = (rad_s * rad_s - per_s * per_s).sqrt();
        for i in 0..300 {
            // The base moves along y from the second step on; objects move the other way.
            let moved_m = if i == 0 { 0.0 } else { -speed_m_s * DT_S };
            let motion = Pose::new(Vector3::y() * moved_m, Rotation3::identity());
            ringing.advance(&Sample { motion, dt_s: DT_S, reading_n_m: Vector2::zeros() });
            // The impulse acts in the middle of the second step.
            let t_s = (f64::from(i) - 0.5) * DT_S;
            if t_s > 0.0 {
                let expected =
                    speed_m_s * rad_s * rad_s / damped_rad_s * (-per_s * t_s).exp() * (damped_rad_s * t_s).sin();
                let found = ringing.response().now[1];
                assert!((found - expected).abs() < 1e-3 * speed_m_s * rad_s, "{t_s}: {found} {expected}");
            }
        }
    }

    #[test]
    fn verif_the_masses_are_the_integrals_of_the_deflection() {
        let whisker = Whisker::straight();
        let beam = Beam::new(&whisker);
        let (length_m, stiffness_n_m2) = (whisker.length_m, whisker.bending_stiffness_n_m2(0.0));
        for force_m in [0.005, 0.02, 0.046, 0.08] {
            // Deflection at `x` by a unit force.
            let deflection = |x: f64| {
                let (near, far) = if x < force_m { (x, force_m) } else { (force_m, x) };
                near * near * (3.0 * far - near) / (6.0 * stiffness_n_m2) + x * force_m / whisker.root_stiffness_n_m_rad
            };
            const PARTS: u32 = 20_000;
            let share = |i: u32| deflection((f64::from(i) + 0.5) / f64::from(PARTS) * length_m) / deflection(force_m);
            let relative_x = |i: u32| (f64::from(i) + 0.5) / f64::from(PARTS) * length_m / force_m;
            let mean = |of: &dyn Fn(u32) -> f64| (0..PARTS).map(of).sum::<f64>() / f64::from(PARTS);
            let found = beam.masses(force_m);
            for (mass_kg, mean) in [
                (found.whole_kg, mean(&share)),
                (found.turned_kg, mean(&|i| share(i) * relative_x(i))),
                (found.bent_kg, mean(&|i| share(i).powi(2))),
            ] {
                assert!((mass_kg / (beam.mass_kg * mean) - 1.0).abs() < 1e-6, "{force_m}: {found:?}");
            }
        }
    }
}
