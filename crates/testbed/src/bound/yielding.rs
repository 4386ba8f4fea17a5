//! Displacement of an object that gives way.

use nalgebra::{Rotation2, Vector2};
use trace::{Sidecar, TruthInstant, YieldingTruth};

/// A touched place of an object that gives way.
#[derive(Clone, Copy, Debug)]
pub(super) struct TouchedPlace {
    /// Place in World of the object's surface without its indentation (m).
    place_m: Vector2<f64>,
    /// Displacement of the surface by its indentation (m).
    indented_m: Vector2<f64>,
    /// Place at the start of the origin of the shape's frame (m).
    center_m: Vector2<f64>,
    given: YieldingTruth,
}

impl TouchedPlace {
    /// `None` for an object that does not give way, and without contact.
    pub(super) fn new(truth: &TruthInstant, sidecar: &Sidecar) -> Option<Self> {
        let (given, contact, surface) = (truth.yielding?, truth.contact?.vector(), truth.surface?.vector());
        // From the object's surface to the centre line of the whisker.
        let normal = (contact - surface).try_normalize(0.0).unwrap_or_default();
        let indented_m = -normal * given.indentation_m;
        Some(Self { place_m: surface - indented_m, indented_m, center_m: sidecar.object_center_m().into(), given })
    }

    /// Displacement in World, from the instant of this place to that of `other`, of the point of the object that is touched here
    /// (m), and of its surface by the indentation.
    pub(super) fn displacement_m(&self, other: &Self) -> Vector2<f64> {
        let moved = |given: &YieldingTruth| Vector2::from(given.moved_m);
        let turn = Rotation2::new(other.given.yaw_rad - self.given.yaw_rad);
        let carried = self.center_m + moved(&other.given) + turn * (self.place_m - self.center_m - moved(&self.given));
        carried - self.place_m + other.indented_m - self.indented_m
    }
}

/// [`TouchedPlace::displacement_m`] from one instant to another; zero for an object that does not give way.
pub(super) fn displacement_m(from: Option<&TouchedPlace>, to: Option<&TouchedPlace>) -> Vector2<f64> {
    from.zip(to).map_or_else(Vector2::zeros, |(from, to)| from.displacement_m(to))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;
    use std::path::Path;

    use whisker::frames::Point;

    use super::*;

    fn touched(surface: [f64; 2], given: YieldingTruth) -> TouchedPlace {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.json");
        let mut sidecar = Sidecar::read(&golden).unwrap();
        sidecar.scene["object"]["center_m"] = serde_json::json!([0.01, 0.0]);
        let surface = Point::new(surface[0], surface[1]);
        // The whisker touches from the left.
        let contact = Some(Point::new(surface.x() - 1e-4, surface.y()));
        let truth = TruthInstant { contact, surface: Some(surface), yielding: Some(given), ..TruthInstant::default() };
        TouchedPlace::new(&truth, &sidecar).unwrap()
    }

    /// An object about (0.01, 0), of which (0.01, 0.005) is touched, turns by a right angle, moves by (1, 2) mm and is indented by
    /// 0.5 mm: the place is then at (0.005, 0), moved and indented.
    #[test]
    fn verif_the_displacement_is_that_of_the_touched_point() {
        let before = touched([0.01, 0.005], YieldingTruth { moved_m: [0.0; 2], yaw_rad: 0.0, indentation_m: 0.0 });
        let given = YieldingTruth { moved_m: [1e-3, 2e-3], yaw_rad: FRAC_PI_2, indentation_m: 0.5e-3 };
        let at_m = Vector2::new(0.005 + 1e-3 + 0.5e-3, 2e-3);
        let after = touched(at_m.into(), given);
        let expected = at_m - Vector2::new(0.01, 0.005);
        assert!((before.displacement_m(&after) - expected).norm() < 1e-15);
        assert!((after.displacement_m(&before) + expected).norm() < 1e-15);
    }

    #[test]
    fn verif_a_turned_object_at_rest_is_not_displaced_when_another_point_is_touched() {
        let given = YieldingTruth { moved_m: [1e-3, 0.0], yaw_rad: 0.5, indentation_m: 0.0 };
        let (one, other) = (touched([0.005, 0.0], given), touched([0.006, 0.003], given));
        assert!(one.displacement_m(&other).norm() < 1e-15);
        assert_eq!(displacement_m(None, Some(&one)), Vector2::zeros());
    }
}
