//! Contact of a whisker with a pin, in space.
//!
//! A pin is touched at a place along its axis that its axis alone does not determine: without friction the force on the whisker has
//! no component along the axis. The contact on the centre line lies beside the axis, along the common normal of whisker and pin.

use std::path::Path;

use files::Error;
use nalgebra::{Unit, Vector2, Vector3};
use trace::StatedSuspension;
use whisker::Whisker;
use whisker::rod::{Rod, SpatialContact};

/// Largest number of iterations that find the place along a pin and the normal.
const ITERATIONS: usize = 30;

/// Change of the contact that ends the iterations (m).
const TOLERANCE_M: f64 = 1e-9;

/// Largest step along a pin, relative to the length of the whisker.
const MOST_STEP: f64 = 0.1;

/// Number of points of the undeflected whisker. The iterations start at the one nearest to the pin.
const POINTS: u32 = 64;

/// Smallest sine of the angle between whisker and pin.
const LEAST_ACROSS: f64 = 0.05;

/// Mechanics of a whisker.
pub(crate) struct Mechanics {
    whisker: Whisker,
    rod: Rod,
}

/// A pin in Base.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pin {
    /// A point of the axis (m).
    pub(super) place: Vector3<f64>,
    pub(super) axis: Unit<Vector3<f64>>,
    /// Radius (m). `None` if the contact lies on the axis.
    pub(super) radius_m: Option<f64>,
}

/// Side of a pin on which a whisker lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// Along the vector product of the whisker's tangent and the pin's axis.
    Along,
    /// Against it.
    Against,
}

impl Side {
    pub(super) const BOTH: [Self; 2] = [Self::Along, Self::Against];

    fn sign(self) -> f64 {
        match self {
            Self::Along => 1.0,
            Self::Against => -1.0,
        }
    }
}

/// Where a contact with a pin lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlaceOnPin {
    /// Place along the axis (m).
    along_m: f64,
    /// Arc length on the whisker.
    arc_m: f64,
}

/// Contact with a pin, in Base.
#[derive(Clone, Copy, Debug)]
pub(super) struct PinContact {
    /// Contact on the centre line (m).
    pub(super) point: Vector3<f64>,
    /// Bending moments about y and z of the rod (N m), 2x1.
    pub(super) moment_n_m: Vector2<f64>,
    pub(super) place: PlaceOnPin,
}

impl Mechanics {
    /// # Errors
    /// [`Error::Value`] of the mapping's parameter that has no rod.
    pub(super) fn new(
        path: &Path,
        whisker: &Whisker,
        suspension: StatedSuspension,
        poisson_ratio: f64,
    ) -> Result<Self, Error> {
        let rod = Rod::new(whisker, suspension.into(), poisson_ratio)
            .map_err(|error| Error::value(path, error.key, error.found, error.expected))?;
        Ok(Self { whisker: whisker.clone(), rod })
    }

    /// Bending moments about y and z (N m), 2x1, of the rod through a contact in Base (m). `None` if the whisker does not reach it.
    pub(super) fn moment_n_m(&self, contact: Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.rod.at_point(contact).ok()?.deflection.moment_n_m.yz())
    }

    /// Side of the pin on which the whisker would lie if its centre line passed through the axis. It is the true side if the
    /// whisker is deflected by more than the radii of pin and wire together. `None` if there is no such contact.
    pub(super) fn side_of_axis(&self, pin: &Pin) -> Option<Side> {
        let on_axis = Pin { radius_m: None, ..*pin };
        Side::BOTH.into_iter().find(|side| self.with_pin(&on_axis, *side, None).is_some())
    }

    /// Frictionless contact with a pin of a whisker on this side of it, sought near that of another row of the same touch. `None`
    /// if none is found, or if the pin would have to pull.
    pub(super) fn with_pin(&self, pin: &Pin, side: Side, near: Option<&PlaceOnPin>) -> Option<PinContact> {
        let mut place = near.copied().unwrap_or_else(|| self.nearest(pin));
        let mut normal: Option<Unit<Vector3<f64>>> = None;
        // Place along the axis, and force along it there, of the last iteration.
        let mut last: Option<(f64, f64)> = None;
        for _ in 0..ITERATIONS {
            let PlaceOnPin { along_m, arc_m } = place;
            let distance_m = pin.radius_m.map_or(0.0, |radius_m| radius_m + 0.5 * self.whisker.diameter_m(arc_m));
            let beside = normal.map_or_else(Vector3::zeros, |normal| distance_m * normal.into_inner());
            let point = pin.place + along_m * pin.axis.into_inner() + beside;
            let contact = self.rod.at_point(point).ok()?;
            let directors = contact.deflection.directors;
            let across = directors.column(0).cross(&pin.axis) * side.sign();
            let next = Unit::try_new(across, LEAST_ACROSS)?;
            let force_n = contact.deflection.force_n.dot(&pin.axis);
            let approximate_m_n = compliance_m_n(pin, &contact);
            // At a place with a negative compliance the whisker would slide away.
            let by_secant = last.map(|(last_m, last_n)| (along_m - last_m) / (force_n - last_n));
            let by_secant = by_secant.filter(|slope_m_n| slope_m_n.is_finite() && *slope_m_n > 0.0);
            let step_m = self.limited(-force_n * by_secant.unwrap_or(approximate_m_n))?;
            last = normal.map(|_| (along_m, force_n));
            let off_m = (force_n * approximate_m_n).abs();
            let turned_m =
                (next.into_inner() - normal.map_or_else(Vector3::zeros, Unit::into_inner)).norm() * distance_m;
            let moved_m = (contact.load.arc_m - arc_m).abs();
            if normal.is_some() && step_m.abs().max(off_m).max(turned_m).max(moved_m) < TOLERANCE_M {
                let pushes = contact.deflection.force_n.dot(&next) > 0.0;
                let moment_n_m = contact.deflection.moment_n_m.yz();
                return pushes.then_some(PinContact { point, moment_n_m, place });
            }
            place = PlaceOnPin { along_m: along_m + step_m, arc_m: contact.load.arc_m };
            normal = Some(next);
        }
        None
    }

    /// A step along a pin (m), limited. `None` if it is not finite.
    fn limited(&self, step_m: f64) -> Option<f64> {
        let most_m = MOST_STEP * self.whisker.length_m;
        step_m.is_finite().then(|| step_m.clamp(-most_m, most_m))
    }

    /// Point of a pin's axis nearest to the undeflected whisker.
    fn nearest(&self, pin: &Pin) -> PlaceOnPin {
        let rest = self.whisker.rest_shape();
        let beside = |i: u32| {
            let arc_m = self.whisker.length_m * f64::from(i) / f64::from(POINTS);
            let from_place = rest.point(arc_m).vector().push(0.0) - pin.place;
            let along_m = from_place.dot(&pin.axis);
            ((from_place - along_m * pin.axis.into_inner()).norm(), PlaceOnPin { along_m, arc_m })
        };
        let nearest = (1..=POINTS).map(beside).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.expect("there are points").1
    }
}

/// Change of the place along a pin with the force along it (m/N), without the twist of the whisker's normals.
fn compliance_m_n(pin: &Pin, contact: &SpatialContact) -> f64 {
    let stiffness = contact.deflection.directors.fixed_columns::<2>(1) * contact.force_gradient_n_m;
    1.0 / (stiffness * pin.axis.into_inner()).dot(&pin.axis)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use whisker::rod::SpatialLoad;

    use super::*;

    const RADIUS_M: f64 = 1e-3;

    fn mechanics(whisker: &Whisker) -> Mechanics {
        let stiffness = StatedSuspension::isotropic(whisker.root_stiffness_n_m_rad);
        Mechanics::new(Path::new("import.json"), whisker, stiffness, 0.33).unwrap()
    }

    /// A pin that exerts a force in this direction about the whisker, and the contact. A linear whisker is deflected by `depth_m`.
    /// The axis is tilted out of the plane across the whisker, and given by a point `off_m` from the contact.
    fn pressed(
        mechanics: &Mechanics,
        direction_rad: f64,
        depth_m: f64,
        tilt_rad: f64,
        off_m: f64,
        radius_m: Option<f64>,
    ) -> (Pin, Vector3<f64>, Vector2<f64>) {
        let (sin, cos) = direction_rad.sin_cos();
        let arc_m = 0.6 * mechanics.whisker.length_m;
        let load = |force_n: f64| SpatialLoad { arc_m, force_n: force_n * Vector3::new(0.0, cos, sin) };
        let at = |force_n: f64| mechanics.rod.deflect(load(force_n)).unwrap();
        let at = at(1e-6 * depth_m / (at(1e-6).point - at(0.0).point).norm());
        let (tangent, normal) = (at.directors.column(0).into_owned(), at.directors * Vector3::new(0.0, cos, sin));
        let axis = Unit::new_normalize(tilt_rad.cos() * tangent.cross(&normal) + tilt_rad.sin() * tangent);
        let distance_m = radius_m.map_or(0.0, |radius_m| radius_m + 0.5 * mechanics.whisker.diameter_m(arc_m));
        let place = at.point - distance_m * normal + off_m * axis.into_inner();
        (Pin { place, axis, radius_m }, at.point, at.moment_n_m.yz())
    }

    #[test]
    fn verif_the_contact_with_a_pin_is_that_of_the_force_which_it_exerts() {
        for whisker in [Whisker::straight(), Whisker::curved()] {
            let mechanics = mechanics(&whisker);
            for (i, (tilt_rad, off_m)) in
                (0..8).flat_map(|i| [(0.0, 0.0), (0.5, 0.05), (-0.5, -0.05)].map(|of| (i, of)))
            {
                let direction_rad = TAU * f64::from(i) / 8.0;
                // From light touches, in which the whisker is deflected by less than the radius, to deep ones.
                for (depth_m, radius_m) in [(3e-4, Some(RADIUS_M)), (6e-3, Some(RADIUS_M)), (6e-3, None)] {
                    let (pin, point, moment_n_m) =
                        pressed(&mechanics, direction_rad, depth_m, tilt_rad, off_m, radius_m);
                    let found = Side::BOTH.into_iter().filter_map(|side| mechanics.with_pin(&pin, side, None));
                    let same = found.filter(|found| found.moment_n_m.dot(&moment_n_m) > 0.0).collect::<Vec<_>>();
                    let [found] = same[..] else { panic!("{direction_rad} {tilt_rad} {depth_m}: {same:?}") };
                    let error_m = (found.point - point).norm();
                    assert!(error_m < 1e-7, "{direction_rad} {tilt_rad} {depth_m}: {error_m} m");
                    assert!((found.moment_n_m - moment_n_m).norm() < 1e-5 * moment_n_m.norm());
                }
            }
        }
    }

    #[test]
    fn verif_the_side_of_a_deep_touch_is_that_of_the_axis() {
        let mechanics = mechanics(&Whisker::curved());
        for i in 0..8 {
            let direction_rad = TAU * f64::from(i) / 8.0;
            let (pin, point, _) = pressed(&mechanics, direction_rad, 6e-3, 0.2, 0.0, Some(RADIUS_M));
            let side = mechanics.side_of_axis(&pin).unwrap();
            let found = mechanics.with_pin(&pin, side, None).unwrap();
            assert!((found.point - point).norm() < 1e-7, "{direction_rad}");
        }
    }

    #[test]
    fn robust_a_pin_along_the_whisker_or_out_of_reach_has_no_contact() {
        let mechanics = mechanics(&Whisker::straight());
        let pin = |place: Vector3<f64>, axis: Vector3<f64>| Pin {
            place,
            axis: Unit::new_normalize(axis),
            radius_m: Some(RADIUS_M),
        };
        for pin in [
            pin(Vector3::new(0.05, 0.01, 0.0), Vector3::x()),
            pin(Vector3::new(0.5, 0.01, 0.0), Vector3::z()),
            pin(Vector3::zeros(), Vector3::z()),
        ] {
            assert!(Side::BOTH.into_iter().all(|side| mechanics.with_pin(&pin, side, None).is_none()), "{pin:?}");
        }
    }
}
