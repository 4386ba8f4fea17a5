//! Swing of the wire along an object, where the equilibrium of the contact moves fast.
//!
//! Where the contact is close to unstable, a small motion of the base moves the equilibrium far along a curved path, and the wire
//! swings about it afterwards. The acceleration of the equilibrium is then larger than the part that depends linearly on the
//! acceleration of the base, and the damping does not vary slowly ([`ringing`]). Both turn the normal by the angle `u`,
//!
//! ```text
//! u = (m (b - b_a) + T F n') / F
//! ```
//!
//! with `b`, the second difference of the contact in Base, `n'` of the equilibrium, and `b_a` the part of `b` due to the
//! acceleration of the base. The tilt is the response of the oscillator to `u`. The response to the acceleration of the base
//! contains `b_a`; that the frequency and the slopes of the object vary meanwhile is neglected.

use nalgebra::{Vector1, Vector3};

use super::rolling::MOST_TILT_RAD;
use crate::space::estimators::ringing::{self, Oscillator};

/// Size ([`SwingTilt::size_rad2`]) below which a swing is ignored (rad): it may result from errors of a fit whose object is still
/// uncertain. Chosen on the suite `random_space_training_large`.
const LEAST_RAD: f64 = 0.01;

/// Equilibrium of the contact at a sample, the input of the oscillator.
#[derive(Clone, Copy, Debug)]
pub(in crate::space::estimators) struct Equilibrium {
    /// The contact (m), and its acceleration relative to the base due to that of the base (m/s2), in Base.
    pub(in crate::space::estimators) contact_m: Vector3<f64>,
    pub(in crate::space::estimators) by_base_m_s2: Vector3<f64>,
    /// Tilt by an acceleration of the contact relative to the base, per m/s2 along each axis.
    pub(in crate::space::estimators) rad_per_m_s2: Vector3<f64>,
    /// Tilt by damping, as if the damping varied slowly.
    pub(in crate::space::estimators) damped_rad: f64,
}

/// Tilt of the normal by the swing of the wire, in addition to the tilt by the acceleration of the base and to that by damping that
/// varies slowly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::space::estimators) struct SwingTilt {
    pub(super) rad: f64,
    /// Sum of the squares of the tilt and of the amplitude of the oscillation (rad2).
    pub(super) size_rad2: f64,
}

impl SwingTilt {
    /// Moves the mean of two, with a share of the other.
    pub(in crate::space::estimators) fn include(&mut self, other: &Self, share: f64) {
        self.rad += (other.rad - self.rad) * share;
        self.size_rad2 += (other.size_rad2 - self.size_rad2) * share;
    }
}

/// Swing of the wire along one object.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::space::estimators) struct Swing {
    /// The contact (m), in Base, and the tilt by damping at the last sample. `None` before the first sample of an object.
    last: Option<(Vector3<f64>, f64)>,
    /// Velocity of the contact (m/s), in Base. `None` if it is not known.
    velocity_m_s: Option<Vector3<f64>>,
    /// Additional tilt at the last sample, and change of the whole tilt per second.
    rad: f64,
    rad_per_s: f64,
    /// The additional tilt if it counts.
    tilt: SwingTilt,
}

impl Swing {
    /// Takes the equilibrium at the next sample, with the angular frequency without damping. Values that are not numbers end the
    /// swing.
    pub(in crate::space::estimators) fn advance(
        &mut self,
        equilibrium: &Equilibrium,
        rad_s: f64,
        damping_s: f64,
        dt_s: f64,
    ) {
        if dt_s <= 0.0 {
            return;
        }
        let Equilibrium { contact_m, by_base_m_s2, rad_per_m_s2, damped_rad } = *equilibrium;
        let velocity_m_s = self.last.map(|(last_m, _)| (contact_m - last_m) / dt_s);
        let by_path_m_s2 = velocity_m_s
            .zip(self.velocity_m_s)
            .map_or_else(Vector3::zeros, |(velocity, before)| (velocity - before) / dt_s - by_base_m_s2);
        let driven_rad = damped_rad + rad_per_m_s2.dot(&by_path_m_s2);
        let Some(rad_s) = ringing::frequency(rad_s).filter(|_| !driven_rad.is_nan()) else {
            *self = Self::default();
            return;
        };
        let driven_rad = driven_rad.clamp(-MOST_TILT_RAD, MOST_TILT_RAD);
        // The damping of another object does not turn the wire.
        let before_rad = self.last.map_or(damped_rad, |(_, damped_rad)| damped_rad);
        let mut whole = Oscillator { value: Vector1::new(before_rad + self.rad), rate: Vector1::new(self.rad_per_s) };
        whole.advance(&Vector1::new(driven_rad), rad_s, damping_s, dt_s);
        (self.rad, self.rad_per_s) = (whole.value.x - damped_rad, whole.rate.x);
        (self.last, self.velocity_m_s) = (Some((contact_m, damped_rad)), velocity_m_s);
        let amplitude_rad = (whole.value.x - driven_rad).hypot(self.rad_per_s / rad_s);
        let size_rad2 = self.rad.powi(2) + amplitude_rad.powi(2);
        let counts = size_rad2 >= LEAST_RAD.powi(2);
        self.tilt = if counts { SwingTilt { rad: self.rad, size_rad2 } } else { SwingTilt::default() };
    }

    /// Continues the oscillation with a new estimate of the object. The contact changes with the estimate, which is not a motion of
    /// the wire: at the next two samples, the acceleration of the contact is not known, and the damping alone drives the
    /// oscillation.
    pub(in crate::space::estimators) fn change_object(&mut self) {
        (self.last, self.velocity_m_s) = (None, None);
    }

    /// The present tilt.
    pub(in crate::space::estimators) fn tilt(&self) -> SwingTilt {
        self.tilt
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RAD_S: f64 = 50.0;
    const DAMPING_S: f64 = 4e-3;
    const DT_S: f64 = 1e-3;

    /// An equilibrium at rest, with a tilt of 10 mrad per m/s2 along y.
    const RESTING: Equilibrium = Equilibrium {
        contact_m: Vector3::new(0.05, 0.0, 0.0),
        by_base_m_s2: Vector3::new(0.0, 0.0, 0.0),
        rad_per_m_s2: Vector3::new(0.0, 1e-2, 0.0),
        damped_rad: 0.0,
    };

    /// Tilts at the samples of equilibria at the given times.
    fn tilts(swing: &mut Swing, samples: u32, equilibrium: impl Fn(f64) -> Equilibrium) -> Vec<SwingTilt> {
        let at = |i| {
            swing.advance(&equilibrium(f64::from(i) * DT_S), RAD_S, DAMPING_S, DT_S);
            swing.tilt()
        };
        (0..samples).map(at).collect()
    }

    /// The response of a damped oscillator at its frequency is the drive divided by twice the damping ratio, here by 0.2.
    #[test]
    fn verif_the_tilt_is_amplified_where_the_equilibrium_oscillates_at_the_frequency_of_the_wire() {
        let acceleration_m_s2 = 2.0;
        let moving = |t_s: f64| {
            let y_m = -acceleration_m_s2 / RAD_S.powi(2) * (RAD_S * t_s).sin();
            Equilibrium { contact_m: RESTING.contact_m + Vector3::y() * y_m, ..RESTING }
        };
        let found = tilts(&mut Swing::default(), 2000, moving);
        let largest = found[1500..].iter().map(|tilt| tilt.rad.abs()).fold(0.0, f64::max);
        let expected = 1e-2 * acceleration_m_s2 / (DAMPING_S * RAD_S);
        assert!((largest / expected - 1.0).abs() < 0.05, "{largest} {expected}");
        assert!(found[1500..].iter().all(|tilt| tilt.size_rad2.sqrt() > 0.9 * expected));
    }

    #[test]
    fn verif_an_acceleration_due_to_the_base_is_not_counted_twice() {
        let acceleration = Vector3::y() * 2.0;
        let moving = |t_s: f64| Equilibrium {
            contact_m: RESTING.contact_m + acceleration * (0.5 * t_s * t_s),
            by_base_m_s2: acceleration,
            ..RESTING
        };
        let found = tilts(&mut Swing::default(), 100, moving);
        assert!(found.iter().all(|tilt| tilt.rad.abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn verif_the_wire_oscillates_after_the_damping_ends_suddenly() {
        let mut swing = Swing::default();
        let sliding = tilts(&mut swing, 50, |_| Equilibrium { damped_rad: 0.1, ..RESTING });
        assert!(sliding.iter().all(|tilt| *tilt == SwingTilt::default()));
        let stopped = tilts(&mut swing, 1000, |_| RESTING);
        let period = (std::f64::consts::TAU / RAD_S / DT_S) as usize;
        assert!((stopped[0].rad - 0.1).abs() < 1e-3, "the tilt is continuous");
        assert!(stopped[period / 2].rad < -0.06 && stopped[period].rad > 0.04, "{stopped:?}");
        assert_eq!(stopped[999], SwingTilt::default(), "a small tilt does not count");
    }

    #[test]
    fn verif_a_new_estimate_of_the_object_does_not_move_the_wire() {
        let mut swing = Swing::default();
        tilts(&mut swing, 5, |_| Equilibrium { damped_rad: 0.1, ..RESTING });
        swing.change_object();
        let elsewhere = Equilibrium { contact_m: Vector3::new(0.03, 0.01, 0.0), damped_rad: -0.1, ..RESTING };
        assert!(tilts(&mut swing, 5, |_| elsewhere).iter().all(|tilt| *tilt == SwingTilt::default()));
    }

    #[test]
    fn robust_values_that_are_no_numbers_end_the_swing() {
        let nan = Vector3::repeat(f64::NAN);
        let wrong = [
            (Equilibrium { contact_m: nan, ..RESTING }, RAD_S),
            (Equilibrium { by_base_m_s2: nan, ..RESTING }, RAD_S),
            (Equilibrium { rad_per_m_s2: nan, ..RESTING }, RAD_S),
            (Equilibrium { damped_rad: f64::NAN, ..RESTING }, RAD_S),
            (RESTING, f64::NAN),
        ];
        for (equilibrium, rad_s) in wrong {
            let mut swing = Swing::default();
            tilts(&mut swing, 10, |t_s| Equilibrium { damped_rad: 10.0 * t_s, ..RESTING });
            swing.advance(&equilibrium, rad_s, DAMPING_S, DT_S);
            let later = tilts(&mut swing, 10, |_| RESTING);
            assert!(later.iter().all(|tilt| *tilt == SwingTilt::default()), "{equilibrium:?} {rad_s}");
        }
    }

    #[test]
    fn robust_a_sample_without_duration_changes_nothing() {
        let mut swing = Swing::default();
        tilts(&mut swing, 10, |t_s| Equilibrium { damped_rad: 10.0 * t_s, ..RESTING });
        let before = swing.tilt();
        swing.advance(&RESTING, RAD_S, DAMPING_S, 0.0);
        assert_eq!(swing.tilt(), before);
    }
}
