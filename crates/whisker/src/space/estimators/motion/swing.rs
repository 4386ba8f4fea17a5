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

use super::rolling::{MOST_TILT_RAD, Place};
use crate::space::estimators::ringing::{self, Oscillator, SwingTilt};

/// What makes the wire swing at a sample.
pub(in crate::space::estimators) struct Drive {
    /// Acceleration of the contact relative to the base due to that of the base (m/s2), in Base.
    pub(in crate::space::estimators) by_base_m_s2: Vector3<f64>,
    /// Mass of the wire that bends.
    pub(in crate::space::estimators) bent_kg: f64,
    /// Tilt by the damping, if it varied slowly.
    pub(in crate::space::estimators) damped_rad: f64,
}

/// Swing of the wire along one object.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::space::estimators) struct Swing {
    /// Contact (m) at the last sample and its velocity (m/s), in Base. `None` if they are not known.
    contact: Option<Vector3<f64>>,
    velocity: Option<Vector3<f64>>,
    /// The tilt. `None` before the first sample.
    oscillator: Option<Oscillator<1>>,
    tilt: SwingTilt,
}

impl Swing {
    /// Takes the equilibrium at the next sample. A frequency that is not a number is ignored.
    pub(in crate::space::estimators) fn advance(
        &mut self,
        place: &Place,
        drive: &Drive,
        (rad_s, damping_s): (f64, f64),
        dt_s: f64,
    ) {
        let Some(rad_s) = ringing::frequency(rad_s).filter(|_| dt_s > 0.0) else { return };
        let velocity = self.contact.replace(place.contact).map(|last| (place.contact - last) / dt_s);
        let before = std::mem::replace(&mut self.velocity, velocity);
        let by_path_m_s2 = velocity.zip(before).map_or_else(Vector3::zeros, |(velocity, before)| {
            (velocity - before) / dt_s - drive.by_base_m_s2
        });
        let driven_rad = drive.damped_rad + place.tilt_by(&(by_path_m_s2 * drive.bent_kg));
        let driven_rad = driven_rad.clamp(-MOST_TILT_RAD, MOST_TILT_RAD);
        let resting = Oscillator { value: Vector1::new(drive.damped_rad), rate: Vector1::zeros() };
        let oscillator = self.oscillator.get_or_insert(resting);
        oscillator.advance(&Vector1::new(driven_rad), rad_s, damping_s, dt_s);
        let rad = oscillator.value.x - drive.damped_rad;
        let amplitude_rad = (oscillator.value.x - driven_rad).hypot(oscillator.rate.x / rad_s);
        self.tilt = SwingTilt { rad, size_rad2: rad.powi(2) + amplitude_rad.powi(2) };
    }

    /// Goes on with another object that explains the readings better: its contact is elsewhere, but not because the wire has moved.
    pub(in crate::space::estimators) fn go_on(&mut self) {
        (self.contact, self.velocity) = (None, None);
    }

    /// The present tilt.
    pub(in crate::space::estimators) fn tilt(&self) -> SwingTilt {
        self.tilt
    }
}
