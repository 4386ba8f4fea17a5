//! Field of a magnet that rotates with the whisker's root.

use nalgebra::Vector3;

/// Magnetic constant divided by 4 pi, in T m/A.
const MAGNETIC_T_M_A: f64 = 1e-7;

/// Dipole field at a position relative to the dipole, `B = mu0 / (4 pi r^3) (3 (m . u) u - m)` with distance `r` and
/// direction `u` (Jackson, Classical Electrodynamics, 5.56). Both arguments have the same axes.
pub(super) fn dipole_field_t(moment_a_m2: Vector3<f64>, place_m: Vector3<f64>) -> Vector3<f64> {
    let distance_m = place_m.norm();
    let towards = place_m / distance_m;
    MAGNETIC_T_M_A / distance_m.powi(3) * (3.0 * moment_a_m2.dot(&towards) * towards - moment_a_m2)
}

/// Magnet on the root, in Base. At rest its moment points along +x, the direction of the whisker, and it lies behind
/// the root, at -x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Magnet {
    /// Magnetic moment.
    pub moment_a_m2: f64,
    /// Distance from the root's axis of rotation to the magnet.
    pub lever_m: f64,
}

impl Magnet {
    /// Field at a position in Base for a given rotation of the root.
    pub(super) fn field_t(&self, rotation_rad: f64, place_m: Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = rotation_rad.sin_cos();
        self.field_along_t(Vector3::new(cos, sin, 0.0), place_m)
    }

    /// Field at a position in Base for a given direction of the root, a unit vector.
    pub(super) fn field_along_t(&self, along: Vector3<f64>, place_m: Vector3<f64>) -> Vector3<f64> {
        dipole_field_t(self.moment_a_m2 * along, place_m + self.lever_m * along)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_field_on_the_axis_and_across_it() {
        let moment = Vector3::new(0.0, 0.0, 6.5e-3);
        for distance_m in [2e-3, 4e-3, 50e-3] {
            // mu0 m / (2 pi z^3) on the axis and minus half of that across it.
            let on_axis_t =
                4e-7 * std::f64::consts::PI * 6.5e-3 / (2.0 * std::f64::consts::PI * f64::powi(distance_m, 3));
            let axis = dipole_field_t(moment, Vector3::new(0.0, 0.0, -distance_m));
            assert!((axis - Vector3::new(0.0, 0.0, on_axis_t)).norm() < 1e-12 * on_axis_t);
            let across = dipole_field_t(moment, Vector3::new(distance_m, 0.0, 0.0));
            assert!((across + Vector3::new(0.0, 0.0, 0.5 * on_axis_t)).norm() < 1e-12 * on_axis_t);
        }
    }

    #[test]
    fn val_without_lever_the_field_is_sinusoidal() {
        let magnet = Magnet { moment_a_m2: 6.5e-3, lever_m: 0.0 };
        let place = Vector3::new(-4e-3, 0.0, 0.0);
        let across_t = 1e-7 * 6.5e-3 / 4e-3_f64.powi(3);
        for rotation_rad in [-0.4, 0.1, 1.2] {
            let field = magnet.field_t(rotation_rad, place);
            assert!((field.y + across_t * rotation_rad.sin()).abs() < 1e-12 * across_t);
            assert!((field.x - 2.0 * across_t * rotation_rad.cos()).abs() < 1e-12 * across_t);
        }
    }

    #[test]
    fn verif_a_lever_increases_the_slope_and_the_nonlinearity() {
        let magnet = Magnet { moment_a_m2: 6.5e-3, lever_m: 0.5e-3 };
        let field_y = |rotation_rad: f64| magnet.field_t(rotation_rad, Vector3::new(-4.5e-3, 0.0, 0.0)).y;
        // For small rotations, a dipole at distance `g` with lever `l` has (1 + 3 l / g) times the sensitivity without
        // lever.
        let across_t = 1e-7 * 6.5e-3 / 4e-3_f64.powi(3);
        assert!((field_y(1e-5) / 1e-5 / across_t + 1.375).abs() < 1e-6);
        assert!((field_y(0.4) / 0.4).abs() < 0.95 * 1.375 * across_t);
        assert_eq!(field_y(0.3), -field_y(-0.3));
    }
}
