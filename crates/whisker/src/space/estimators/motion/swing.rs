//! Swing of the wire along an object, where the equilibrium of the contact moves fast.
//!
//! Around an object on which the contact is hardly stable, a small motion of the base moves the equilibrium far along a curved path,
//! and the wire swings about it afterwards. The acceleration of the path is then larger than the part that depends linearly on the
//! acceleration of the base, and the damping does not vary slowly ([`ringing`]). Both turn the normal by the angle `u`,
//!
//! ```text
//! u = -(m (b - b_a) + T F n') / F
//! ```
//!
//! with `b` and `n'` of the equilibrium at successive samples, and `b_a` the part that the response to the acceleration of the base
//! contains. The tilt is the response of the oscillator to `u`.

use nalgebra::{Vector1, Vector3};

use super::rolling::MOST_TILT_RAD;
use crate::space::estimators::ringing::{self, Oscillator, SwingTilt};

/// Tilt below which a swing does not count (rad): it may follow from errors of a fit that hardly knows its object. Chosen on random
/// scenes in space that are not reported.
const LEAST_RAD: f64 = 0.01;

/// The equilibrium at a sample, which makes the wire swing.
#[derive(Clone, Copy, Debug)]
pub(in crate::space::estimators) struct Equilibrium {
    /// The contact (m), and its acceleration relative to the base due to that of the base (m/s2), in Base.
    pub(in crate::space::estimators) contact_m: Vector3<f64>,
    pub(in crate::space::estimators) by_base_m_s2: Vector3<f64>,
    /// Tilt by an acceleration of the contact relative to the base, per m/s2 along each axis.
    pub(in crate::space::estimators) rad_per_m_s2: Vector3<f64>,
    /// Tilt by the damping, if that varied slowly.
    pub(in crate::space::estimators) damped_rad: f64,
}

/// Swing of the wire along one object.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::space::estimators) struct Swing {
    /// Contact (m) at the last sample and its velocity (m/s), in Base. `None` if they are not known.
    contact_m: Option<Vector3<f64>>,
    velocity_m_s: Option<Vector3<f64>>,
    /// The tilt. `None` before the first sample.
    oscillator: Option<Oscillator<1>>,
    tilt: SwingTilt,
}

impl Swing {
    /// Takes the equilibrium at the next sample, with the angular frequency without damping. If that is not a number, the sample is
    /// ignored.
    pub(in crate::space::estimators) fn advance(
        &mut self,
        equilibrium: &Equilibrium,
        rad_s: f64,
        damping_s: f64,
        dt_s: f64,
    ) {
        let Some(rad_s) = ringing::frequency(rad_s).filter(|_| dt_s > 0.0) else { return };
        let Equilibrium { contact_m, by_base_m_s2, rad_per_m_s2, damped_rad } = *equilibrium;
        let velocity_m_s = self.contact_m.replace(contact_m).map(|last_m| (contact_m - last_m) / dt_s);
        let before_m_s = std::mem::replace(&mut self.velocity_m_s, velocity_m_s);
        let by_path_m_s2 = velocity_m_s
            .zip(before_m_s)
            .map_or_else(Vector3::zeros, |(velocity, before)| (velocity - before) / dt_s - by_base_m_s2);
        let driven_rad = (damped_rad + rad_per_m_s2.dot(&by_path_m_s2)).clamp(-MOST_TILT_RAD, MOST_TILT_RAD);
        let resting = Oscillator { value: Vector1::new(damped_rad), rate: Vector1::zeros() };
        let oscillator = self.oscillator.get_or_insert(resting);
        oscillator.advance(&Vector1::new(driven_rad), rad_s, damping_s, dt_s);
        let rad = oscillator.value.x - damped_rad;
        let amplitude_rad = (oscillator.value.x - driven_rad).hypot(oscillator.rate.x / rad_s);
        let size_rad2 = rad.powi(2) + amplitude_rad.powi(2);
        self.tilt = if size_rad2 < LEAST_RAD.powi(2) { SwingTilt::default() } else { SwingTilt { rad, size_rad2 } };
    }

    /// Goes on with another object that explains the readings better: its contact is elsewhere, but not because the wire has moved.
    pub(in crate::space::estimators) fn go_on(&mut self) {
        (self.contact_m, self.velocity_m_s) = (None, None);
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

    /// The response of a damped oscillator at its frequency is the drive over twice the ratio of damping, here over 0.2.
    #[test]
    fn verif_an_equilibrium_that_moves_to_and_fro_at_the_frequency_is_amplified() {
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
    fn verif_an_acceleration_by_that_of_the_base_is_not_counted_twice() {
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
    fn verif_the_wire_swings_on_when_the_damping_ends_at_once() {
        let mut swing = Swing::default();
        let sliding = tilts(&mut swing, 50, |_| Equilibrium { damped_rad: 0.1, ..RESTING });
        assert!(sliding.iter().all(|tilt| *tilt == SwingTilt::default()));
        let stopped = tilts(&mut swing, 1000, |_| RESTING);
        let period = (std::f64::consts::TAU / RAD_S / DT_S) as usize;
        assert!((stopped[0].rad - 0.1).abs() < 1e-3, "the tilt goes on");
        assert!(stopped[period / 2].rad < -0.06 && stopped[period].rad > 0.04, "{stopped:?}");
        assert_eq!(stopped[999], SwingTilt::default(), "a small tilt does not count");
    }

    #[test]
    fn verif_another_object_does_not_accelerate_the_wire() {
        let mut swing = Swing::default();
        tilts(&mut swing, 5, |_| RESTING);
        swing.go_on();
        let elsewhere = Equilibrium { contact_m: Vector3::new(0.03, 0.01, 0.0), ..RESTING };
        assert!(tilts(&mut swing, 5, |_| elsewhere).iter().all(|tilt| tilt.rad == 0.0));
    }

    #[test]
    fn robust_frequencies_that_are_no_numbers_are_ignored() {
        let mut swing = Swing::default();
        swing.advance(&RESTING, f64::NAN, DAMPING_S, DT_S);
        swing.advance(&RESTING, f64::INFINITY, DAMPING_S, DT_S);
        swing.advance(&RESTING, RAD_S, DAMPING_S, 0.0);
        assert_eq!(swing.tilt(), SwingTilt::default());
    }
}
