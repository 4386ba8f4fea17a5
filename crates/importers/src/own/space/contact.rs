//! Contact of a whisker with a pin, in space.
//!
//! A pin is touched at a place along its axis that its axis alone does not determine: without friction the force on the whisker has
//! no component along the axis. The contact on the centre line lies beside the axis, along the common normal of whisker and pin.

use std::path::Path;

use files::Error;
use nalgebra::{Unit, Vector2, Vector3};
use trace::StatedSuspension;
use whisker::Whisker;
use whisker::rod::Rod;

/// Largest number of iterations that find the place along a pin and the normal.
const ITERATIONS: usize = 20;

/// Change of the place along a pin that ends the iterations (m).
const TOLERANCE_M: f64 = 1e-8;

/// Number of points of the undeflected whisker of which the nearest to a pin begins the iterations.
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

/// Contact with a pin, in Base.
#[derive(Clone, Copy, Debug)]
pub(super) struct PinContact {
    /// Contact on the centre line (m).
    pub(super) point: Vector3<f64>,
    /// Its place along the axis (m).
    along_m: f64,
    /// Its arc length.
    arc_m: f64,
    /// Unit normal out of the pin.
    normal: Vector3<f64>,
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

    /// Frictionless contact with a pin, near that of another row of the same touch. Without one, the whisker must be deflected by
    /// more than the radius, so that the axis lies on the side to which it is pushed. `None` if the pin does not push the whisker.
    pub(super) fn with_pin(&self, pin: &Pin, near: Option<&PinContact>) -> Option<PinContact> {
        let PinContact { mut along_m, mut arc_m, mut normal, .. } = near.copied().unwrap_or_else(|| self.nearest(pin));
        for _ in 0..ITERATIONS {
            let distance_m = pin.radius_m.map_or(0.0, |radius_m| radius_m + 0.5 * self.whisker.diameter_m(arc_m));
            let point = pin.place + along_m * pin.axis.into_inner() + distance_m * normal;
            let contact = self.rod.at_point(point).ok()?;
            let directors = contact.deflection.directors;
            let force = contact.deflection.force_n;
            let across = directors.column(0).cross(&pin.axis);
            if across.norm() < LEAST_ACROSS {
                return None;
            }
            let across = across.normalize();
            let reference = if normal == Vector3::zeros() { force } else { normal };
            let next = if across.dot(&reference) < 0.0 { -across } else { across };
            // Change of the force along the axis with the place along it; the rotation of the whisker's normals is left out.
            let stiffness = directors.fixed_columns::<2>(1) * contact.force_gradient_n_m;
            let step_m = -force.dot(&pin.axis) / (stiffness * pin.axis.into_inner()).dot(&pin.axis);
            if !step_m.is_finite() {
                return None;
            }
            let is_found = step_m.abs() < TOLERANCE_M && distance_m * (next - normal).norm() < TOLERANCE_M;
            (along_m, arc_m, normal) = (along_m + step_m, contact.load.arc_m, next);
            if is_found {
                return (force.dot(&normal) > 0.0).then_some(PinContact { point, along_m, arc_m, normal });
            }
        }
        None
    }

    /// Point of a pin's axis nearest to the undeflected whisker, without a normal.
    fn nearest(&self, pin: &Pin) -> PinContact {
        let rest = self.whisker.rest_shape();
        let beside = |i: u32| {
            let arc_m = self.whisker.length_m * f64::from(i) / f64::from(POINTS);
            let from_place = rest.point(arc_m).vector().push(0.0) - pin.place;
            let along_m = from_place.dot(&pin.axis);
            let point = pin.place + along_m * pin.axis.into_inner();
            let distance_m = (from_place - along_m * pin.axis.into_inner()).norm();
            (distance_m, PinContact { point, along_m, arc_m, normal: Vector3::zeros() })
        };
        let nearest = (1..=POINTS).map(beside).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.expect("there are points").1
    }
}
