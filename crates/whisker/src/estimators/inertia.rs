//! Inertia of the wire between root and contact.

use nalgebra::Vector2;

use super::Sample;
use super::side::Side;
use crate::Whisker;
use crate::sensor::AlongAway;

/// Moment at the root by the inertia of a wire whose root accelerates while its contact rests.
///
/// The wire moves by `a (1 - s / c)` at the arc length `s`, with the acceleration `a` of the root and the contact at `c`:
/// as a rigid link, since root and contact carry no moment in the limit of a soft root. The load `-m' a (1 - s / c)` on a
/// beam that is held at its root by a spring of stiffness `k`, propped at `c` and free at its end `L` has the moment
///
/// ```text
/// M = m' a (c^2 / 15 + (L - c)^3 / (6 c)) / (1 + 3 EI / (k c))
/// ```
///
/// at the root: the fixed-end moments of span and overhang, distributed by the stiffnesses of spring and beam
/// (Hibbeler, *Structural Analysis*, moment distribution).
#[derive(Clone, Copy, Debug)]
pub(super) struct Inertia {
    length_m: f64,
    /// Mass per length, `m'`.
    mass_kg_m: f64,
    /// `3 EI / k`.
    soft_m: f64,
    /// Displacement of the base over the last step, in Base (m), and its duration. `None` before the first step.
    last: Option<(Vector2<f64>, f64)>,
    /// Acceleration (m/s2) of the surroundings in Base.
    acceleration_m_s2: Vector2<f64>,
}

impl Inertia {
    pub(super) fn new(whisker: &Whisker) -> Self {
        let diameter_m = 0.5 * (whisker.root_diameter_m + whisker.tip_diameter_m);
        let area_m2 = std::f64::consts::FRAC_PI_4 * diameter_m.powi(2);
        let stiffness_n_m2 = whisker.youngs_modulus_pa * area_m2.powi(2) / (4.0 * std::f64::consts::PI);
        Self {
            length_m: whisker.length_m,
            mass_kg_m: whisker.density_kg_m3 * area_m2,
            soft_m: 3.0 * stiffness_n_m2 / whisker.root_stiffness_n_m_rad,
            last: None,
            acceleration_m_s2: Vector2::zeros(),
        }
    }

    /// Takes the motion of a step.
    pub(super) fn advance(&mut self, sample: &Sample) {
        let moved_m = sample.motion.origin().vector();
        let before = self.last.replace((moved_m, sample.dt_s));
        self.acceleration_m_s2 = match before {
            Some((before_m, before_s)) if before_s > 0.0 && sample.dt_s > 0.0 => {
                (moved_m / sample.dt_s - before_m / before_s) / (0.5 * (sample.dt_s + before_s))
            }
            _ => Vector2::zeros(),
        };
    }

    /// The moment at the root with a contact at these coordinates, of the sign of the contact's reading.
    pub(super) fn moment_n_m(&self, side: &Side, at: AlongAway) -> f64 {
        let arc_m = at.along_m.max(0.1 * self.length_m);
        let away = side.face.contact_jacobian(at).column(1).dot(&self.acceleration_m_s2);
        let beyond_m = (self.length_m - arc_m).max(0.0);
        let lever_m2 = arc_m.powi(2) / 15.0 + beyond_m.powi(3) / (6.0 * arc_m);
        let moment_n_m = self.mass_kg_m * away * lever_m2 / (1.0 + self.soft_m / arc_m);
        moment_n_m.copysign(moment_n_m * side.expect(at).1[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge;
    use crate::frames::Pose;

    fn step(y_m: f64) -> Sample {
        Sample { motion: Pose::new(0.0, y_m, 0.0), dt_s: 4e-3, reading_n_m: 0.0 }
    }

    #[test]
    fn verif_only_an_acceleration_has_a_moment() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let mut inertia = Inertia::new(&knowledge.whisker);
        let at = AlongAway::new(0.055, 3e-3);
        for _ in 0..3 {
            inertia.advance(&step(1e-4));
            assert!(inertia.moment_n_m(&side, at).abs() < 1e-15);
        }
        // The surroundings accelerate by 1 m/s2 along y.
        inertia.advance(&step(1e-4 + 1.6e-5));
        let forth_n_m = inertia.moment_n_m(&side, at);
        inertia.advance(&step(1e-4));
        let back_n_m = inertia.moment_n_m(&side, at);
        assert!((forth_n_m + back_n_m).abs() < 1e-12 * forth_n_m.abs());
        // Of the order of m' a c^2 / 60.
        assert!((3e-9..1e-7).contains(&forth_n_m.abs()), "{forth_n_m}");
    }

    /// An object that accelerates towards the whisker is read as a larger deflection.
    #[test]
    fn verif_the_moment_has_the_sign_of_a_push() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let at = AlongAway::new(0.055, 3e-3);
        let mut inertia = Inertia::new(&knowledge.whisker);
        let away = side.face.contact_jacobian(at).column(1).into_owned() * 1e-5;
        for i in 1..4 {
            let motion = Pose::new(away.x * f64::from(i), away.y * f64::from(i), 0.0);
            inertia.advance(&Sample { motion, dt_s: 4e-3, reading_n_m: 0.0 });
        }
        assert!(inertia.moment_n_m(&side, at) * side.reading_n_m(at) > 0.0);
    }
}
