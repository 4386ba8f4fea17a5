//! Displacement of an object that gives way.

use nalgebra::{Rotation2, Vector2};
use trace::{Sidecar, TruthInstant};

/// Displacement in World, since the start, of the place of the object's outline that is touched: that of the object, and the
/// indentation of its surface. Zero for an object that does not give way, and without contact.
pub(super) fn displacement_m(truth: &TruthInstant, sidecar: &Sidecar) -> Vector2<f64> {
    let (Some(given), Some(contact), Some(surface)) = (truth.yielding, truth.contact, truth.surface) else {
        return Vector2::zeros();
    };
    // From the object's surface to the centre line of the whisker.
    let normal = (contact.vector() - surface.vector()).try_normalize(0.0).unwrap_or_default();
    let moved = Vector2::from(given.moved_m);
    let from_center =
        surface.vector() + normal * given.indentation_m - Vector2::from(sidecar.object_center_m()) - moved;
    let before_turn = Rotation2::new(-given.yaw_rad) * from_center;
    moved + from_center - before_turn - normal * given.indentation_m
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trace::YieldingTruth;
    use whisker::frames::Point;

    use super::*;

    /// An object about (0.01, 0) that has turned by a right angle, moved by (1, 2) mm and is indented by 0.5 mm from the left: its
    /// place at (0.01, 0.005) is then at (0.005, 0), moved and indented.
    #[test]
    fn verif_the_displacement_is_that_of_the_touched_place() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.json");
        let mut sidecar = Sidecar::read(&golden).unwrap();
        sidecar.scene["object"]["center_m"] = serde_json::json!([0.01, 0.0]);
        let surface = Point::new(0.005 + 1e-3 + 0.5e-3, 2e-3);
        let mut truth = TruthInstant {
            contact: Some(Point::new(surface.x() - 1e-4, surface.y())),
            surface: Some(surface),
            ..TruthInstant::default()
        };
        assert_eq!(displacement_m(&truth, &sidecar), Vector2::zeros());
        let yaw_rad = std::f64::consts::FRAC_PI_2;
        truth.yielding = Some(YieldingTruth { moved_m: [1e-3, 2e-3], yaw_rad, indentation_m: 0.5e-3 });
        let expected = surface.vector() - Vector2::new(0.01, 0.005);
        assert!((displacement_m(&truth, &sidecar) - expected).norm() < 1e-15);
    }
}
