//! The whisker's shaft and the largest push that it withstands.
//!
//! A round, conical shaft of the diameter `D (1 - t s)` at the arc length `s` from the root is clamped at the root and
//! bent by the frictionless edge of the ruler, whose force is normal to the shaft at the arc length `a` of the contact.
//! Beyond the contact the shaft is straight. The equation of the exact elastica (Frisch-Fay, *Flexible Bars*, 1962) is
//! an initial-value problem from the contact to the root: with the contact as origin, the tangent there along x and the
//! force along y,
//!
//! ```text
//! dx/ds = cos(angle),  dy/ds = sin(angle),  d(angle)/ds = -q x / (1 - t s)^4
//! ```
//!
//! with the ratio `q` of force and bending stiffness at the root. The strain of the surface is half the diameter times
//! the curvature. For small deflections the strain of a cylinder at a push `y` at the distance `d` is `3 D y / (2 d^2)`
//! (Gere and Timoshenko, *Mechanics of Materials*).
//!
//! The largest push is that at which the strain reaches its limit, the shaft is turned by [`MOST_TURN_RAD`] at the
//! ruler and slips along it, or the ruler reaches the tip. A soft root takes a part of the push, so that a shaft on it
//! withstands a larger push.

use serde::{Deserialize, Serialize};

/// Largest angle of the shaft at the ruler (rad): 80 degrees.
const MOST_TURN_RAD: f64 = 1.4;
/// Number of contacts along the shaft, and of forces at its tip, for which pushes are computed.
const CONTACTS: u32 = 64;
/// Number of steps of the midpoint rule along the shaft.
const STEPS: u32 = 128;
/// Number of bisections of the force.
const BISECTIONS: u32 = 40;

/// The whisker on the bed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shaft {
    /// x of the undeflected whisker (m).
    pub x_m: f64,
    /// y of its tip (m).
    pub tip_y_m: f64,
    /// Length (m).
    pub length_m: f64,
    /// Diameter at the root (m).
    pub root_diameter_m: f64,
    /// Diameter at the tip (m).
    pub tip_diameter_m: f64,
    /// Largest strain from which the material recovers.
    pub largest_strain: f64,
}

/// Largest push at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestPush {
    /// The push (m).
    pub push_m: f64,
    /// Quantity that limits it.
    pub limit: Limit,
}

/// Quantity that limits a push.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The strain of the shaft.
    Strain,
    /// The angle of the shaft, which slips along the ruler.
    Angle,
    /// The length of the shaft: beyond it the ruler slips off the tip.
    Length,
}

/// Largest pushes along a shaft.
#[derive(Clone, Debug)]
pub struct LargestPushes {
    /// Distances along the undeflected shaft (m) and the largest pushes there, for contacts from the root to the tip.
    nodes: Vec<(f64, LargestPush)>,
}

/// Shaft in contact.
#[derive(Clone, Copy, Debug)]
struct Bent {
    /// Distance of the contact from the root along the undeflected shaft (m).
    distance_m: f64,
    /// Deflection at the contact (m).
    push_m: f64,
    /// Largest strain.
    strain: f64,
    /// Angle between the tangents at root and contact (rad).
    turn_rad: f64,
}

impl Shaft {
    /// Shaft in contact at an arc length (m), for a ratio of force and stiffness at the root (1/m^2).
    fn bent(&self, arc_m: f64, force: f64) -> Bent {
        let taper = (1.0 - self.tip_diameter_m / self.root_diameter_m) / self.length_m;
        let (step_m, mut x, mut y, mut angle, mut strain) = (arc_m / f64::from(STEPS), 0.0, 0.0, 0.0_f64, 0.0_f64);
        for step in 0..STEPS {
            let thickness = |steps: f64| 1.0 - taper * (arc_m - steps * step_m);
            let (half, whole) = (thickness(f64::from(step) + 0.5), thickness(f64::from(step) + 1.0));
            let curvature = |x: f64| -force * x / half.powi(4);
            let middle = angle - 0.5 * step_m * curvature(x);
            angle -= step_m * curvature(x - 0.5 * step_m * angle.cos());
            (x, y) = (x - step_m * middle.cos(), y - step_m * middle.sin());
            strain = strain.max(0.5 * self.root_diameter_m * (force * x).abs() / whole.powi(3));
        }
        // The contact in the frame of the root.
        let (sine, cosine) = angle.sin_cos();
        Bent {
            distance_m: -(x * cosine + y * sine),
            push_m: (x * sine - y * cosine).abs(),
            strain,
            turn_rad: angle.abs(),
        }
    }

    fn bears(&self, bent: &Bent) -> bool {
        bent.strain <= self.largest_strain && bent.turn_rad <= MOST_TURN_RAD
    }

    /// Largest ratio of force and stiffness that the shaft withstands at an arc length (1/m^2).
    fn largest_force(&self, arc_m: f64) -> f64 {
        // An angle of one radian or less for small deflections of a cylinder; a cone is turned more.
        let mut high = arc_m.powi(-2);
        while self.bears(&self.bent(arc_m, high)) {
            high *= 2.0;
        }
        let mut low = 0.0;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if self.bears(&self.bent(arc_m, middle)) { low = middle } else { high = middle }
        }
        low
    }

    /// Largest pushes along the shaft.
    pub fn largest_pushes(&self) -> LargestPushes {
        let node = |bent: Bent, limit| (bent.distance_m, LargestPush { push_m: bent.push_m, limit });
        let at_limit = |contact: u32| {
            let arc_m = self.length_m * f64::from(contact) / f64::from(CONTACTS);
            let bent = self.bent(arc_m, self.largest_force(arc_m));
            let is_strained = bent.strain / self.largest_strain > bent.turn_rad / MOST_TURN_RAD;
            node(bent, if is_strained { Limit::Strain } else { Limit::Angle })
        };
        let root = (0.0, LargestPush { push_m: 0.0, limit: Limit::Strain });
        let mut nodes: Vec<_> = std::iter::once(root).chain((1..=CONTACTS).map(at_limit)).collect();
        let force = self.largest_force(self.length_m);
        let at_tip = |part: u32| {
            let share = f64::from(CONTACTS - part) / f64::from(CONTACTS);
            node(self.bent(self.length_m, share * force), Limit::Length)
        };
        nodes.extend((1..=CONTACTS).map(at_tip));
        LargestPushes { nodes }
    }
}

impl LargestPushes {
    /// Largest push at this distance from the root along the undeflected shaft (m). Zero beyond the shaft.
    pub fn at(&self, distance_m: f64) -> LargestPush {
        let between = |pair: &[(f64, LargestPush)]| {
            let [(a_m, a), (b_m, b)] = [pair[0], pair[1]];
            let share = (distance_m - a_m) / (b_m - a_m);
            let push_m = a.push_m + share * (b.push_m - a.push_m);
            (0.0..=1.0).contains(&share).then_some(LargestPush { push_m, limit: b.limit })
        };
        let found = self.nodes.windows(2).filter_map(between).min_by(|a, b| a.push_m.total_cmp(&b.push_m));
        found.unwrap_or(LargestPush { push_m: 0.0, limit: Limit::Length })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn printed() -> Shaft {
        crate::rig::Rig::built_in().shaft
    }

    /// Cylinder of 3 mm with this limit of strain.
    fn rod(largest_strain: f64) -> Shaft {
        Shaft { tip_diameter_m: 0.003, largest_strain, ..printed() }
    }

    #[test]
    fn val_small_deflections_against_beam_theory() {
        // 2 e d^2 / (3 D), and for the cone 2 e d^3 / (3 D (1 - t d) f) with the largest f of (d - s) / (1 - t s)^3.
        let (e, d) = (1e-5, 0.12_f64);
        let found = rod(e).largest_pushes().at(d);
        assert!(
            (found.push_m / (2.0 * e * d * d / 0.009) - 1.0).abs() < 2e-3 && found.limit == Limit::Strain,
            "{found:?}"
        );
        let taper = 0.8 / 0.15;
        let at = |s: f64| (d - s) / (1.0 - taper * s).powi(3);
        let largest = (0..12_000).map(|k| at(1e-5 * f64::from(k))).fold(0.0, f64::max);
        let expected = 2.0 * e * d.powi(3) / (0.009 * (1.0 - taper * d) * largest);
        let found = Shaft { largest_strain: e, ..printed() }.largest_pushes().at(d);
        assert!((found.push_m / expected - 1.0).abs() < 3e-3, "{found:?} {expected}");
    }

    #[test]
    fn val_large_deflections_against_the_published_elastica_of_a_point_contact() {
        // Moment at the root times distance over stiffness, for a clamped cylinder pushed to the polar angle th: 3.0063
        // th - 0.0341 th^2 - 0.6683 th^3.
        let shaft = rod(0.1);
        for force in [20.0, 60.0, 120.0] {
            let bent = shaft.bent(0.1, force);
            let (r, th) = (bent.distance_m.hypot(bent.push_m), bent.push_m.atan2(bent.distance_m));
            let found = bent.strain / (0.5 * 0.003) * r;
            let expected = 3.0063 * th - 0.0341 * th * th - 0.6683 * th.powi(3);
            assert!((found / expected - 1.0).abs() < 0.02, "{th}: {found} {expected}");
        }
    }

    #[test]
    fn verif_a_superelastic_wire_is_limited_by_angle_and_length_and_a_rod_by_its_strain() {
        let wire = Shaft {
            length_m: 0.075,
            root_diameter_m: 0.25e-3,
            tip_diameter_m: 0.25e-3,
            largest_strain: 0.06,
            ..printed()
        };
        let pushes = wire.largest_pushes();
        assert_eq!([0.03, 0.07].map(|distance_m| pushes.at(distance_m).limit), [Limit::Angle, Limit::Length]);
        let rod = Shaft { root_diameter_m: 3e-3, tip_diameter_m: 3e-3, ..wire };
        assert_eq!(rod.largest_pushes().at(0.02).limit, Limit::Strain);
        for (shaft, pushes) in [(wire, pushes), (rod, rod.largest_pushes())] {
            for distance_m in (0..=75).map(|mm| 1e-3 * f64::from(mm)) {
                let push_m = pushes.at(distance_m).push_m;
                assert!(push_m >= 0.0 && push_m.hypot(distance_m) < 1.001 * shaft.length_m, "{push_m} at {distance_m}");
            }
            assert_eq!(pushes.at(0.0751).push_m, 0.0);
        }
    }

    #[test]
    fn verif_the_published_push_is_allowed_at_every_published_place() {
        let pushes = printed().largest_pushes();
        for place in 0..16 {
            let distance_m = 0.045 + 0.1 * f64::from(place) / 15.0;
            assert!(pushes.at(distance_m).push_m > 0.009, "{distance_m}: {:?}", pushes.at(distance_m));
        }
    }
}
