//! The parameters of a whisker.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::RestShape;

/// A piece of constant pre-curvature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Curvature {
    /// Length of the piece.
    pub length_m: f64,
    /// Its curvature; positive bends to the left.
    pub curvature_per_m: f64,
}

impl Curvature {
    /// A piece of this length (m) and curvature (1/m).
    pub fn new(length_m: f64, curvature_per_m: f64) -> Self {
        Self { length_m, curvature_per_m }
    }
}

/// A thin, tapered, pre-curved elastic wire on a compliant root, and the discretisation of its chain in the simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Whisker {
    /// Name of the preset or of the sensor.
    pub name: String,
    /// Length from root to tip.
    pub length_m: f64,
    /// Diameter at the root.
    pub root_diameter_m: f64,
    /// Diameter at the tip; linear in between.
    pub tip_diameter_m: f64,
    /// Young's modulus.
    pub youngs_modulus_pa: f64,
    /// Density.
    pub density_kg_m3: f64,
    /// Pre-curvature from root to tip.
    pub curvature: Vec<Curvature>,
    /// Stiffness of the suspension at the root.
    pub root_stiffness_n_m_rad: f64,
    /// Segments of the simulated chain.
    pub segments: u32,
    /// Ratio of damping to stiffness: of the joints of the simulated chain, and of the wire, for whose lag the fits in space
    /// correct. Zero if it is not known.
    pub damping_s: f64,
}

/// A parameter with its smallest and largest value, beyond which it probably has another unit.
struct Plausible {
    key: &'static str,
    of: fn(&Whisker) -> f64,
    range: [f64; 2],
    expected: &'static str,
}

impl Plausible {
    const fn new(key: &'static str, of: fn(&Whisker) -> f64, range: [f64; 2], expected: &'static str) -> Self {
        Self { key, of, range, expected }
    }
}

/// Diameters, modulus and density are those of scenes. The root is softer than any suspension, or practically clamped, beyond its
/// range.
const PLAUSIBLE: [Plausible; 6] = [
    Plausible::new("length_m", |of| of.length_m, [1e-3, 1.0], "1e-3 to 1 m"),
    Plausible::new("root_diameter_m", |of| of.root_diameter_m, [1e-6, 0.1], "1e-6 to 0.1 m"),
    Plausible::new("tip_diameter_m", |of| of.tip_diameter_m, [1e-6, 0.1], "1e-6 to 0.1 m"),
    Plausible::new("youngs_modulus_pa", |of| of.youngs_modulus_pa, [1e3, 1e13], "1e3 to 1e13 Pa"),
    Plausible::new("density_kg_m3", |of| of.density_kg_m3, [1.0, 3e4], "1 to 3e4 kg/m3"),
    Plausible::new("root_stiffness_n_m_rad", |of| of.root_stiffness_n_m_rad, [1e-9, 1e6], "1e-9 to 1e6 N m/rad"),
];

/// Invalid parameter of a whisker.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("whisker.{key}: found {found}, expected {expected}")]
pub struct Invalid {
    /// Key of the parameter.
    pub key: &'static str,
    /// Value found.
    pub found: f64,
    /// Values expected.
    pub expected: String,
}

impl Whisker {
    /// The first parameter in which this whisker differs from an expected one, with both values, for error messages. `None` if they
    /// are equal.
    pub fn difference(&self, expected: &Self) -> Option<String> {
        let [found, expected] =
            [self, expected].map(|whisker| serde_json::to_value(whisker).expect("numbers and names"));
        let parameters = found.as_object().expect("a struct").iter();
        let mut other = parameters.filter(|(key, value)| expected[key.as_str()] != **value);
        other.next().map(|(key, value)| format!("{key}: found {value}, expected {}", expected[key.as_str()]))
    }

    /// Checks that the parameters describe a whisker.
    ///
    /// # Errors
    /// [`Invalid`] names the first that does not.
    pub fn validate(&self) -> Result<(), Invalid> {
        let positive = [
            ("length_m", self.length_m),
            ("root_diameter_m", self.root_diameter_m),
            ("tip_diameter_m", self.tip_diameter_m),
            ("youngs_modulus_pa", self.youngs_modulus_pa),
            ("density_kg_m3", self.density_kg_m3),
            ("root_stiffness_n_m_rad", self.root_stiffness_n_m_rad),
        ];
        for (key, found) in positive {
            if !(found.is_finite() && found > 0.0) {
                return Err(Invalid { key, found, expected: "a positive number".into() });
            }
        }
        for piece in &self.curvature {
            if !(piece.length_m.is_finite() && piece.length_m > 0.0) {
                let expected = "pieces of positive length_m".into();
                return Err(Invalid { key: "curvature", found: piece.length_m, expected });
            }
            // A piece that turns by more than half a circle meets itself.
            let turn = piece.length_m * piece.curvature_per_m;
            if turn.is_nan() || turn.abs() > std::f64::consts::PI {
                let expected = "pieces that turn by at most half a circle".into();
                return Err(Invalid { key: "curvature", found: piece.curvature_per_m, expected });
            }
        }
        if self.segments == 0 {
            return Err(Invalid { key: "segments", found: 0.0, expected: "at least one".into() });
        }
        if !(self.damping_s.is_finite() && self.damping_s >= 0.0) {
            let expected = "a ratio of 0 or more".into();
            return Err(Invalid { key: "damping_s", found: self.damping_s, expected });
        }
        let total: f64 = self.curvature.iter().map(|piece| piece.length_m).sum();
        if (total - self.length_m).abs() > 1e-9 * self.length_m {
            return Err(Invalid {
                key: "curvature",
                found: total,
                expected: format!("lengths that add up to length_m = {}", self.length_m),
            });
        }
        Ok(())
    }

    /// Checks that the parameters of a valid whisker have plausible sizes. Beyond them, a parameter probably has another unit.
    ///
    /// # Errors
    /// [`Invalid`] names the first that has not.
    pub fn check_plausible(&self) -> Result<(), Invalid> {
        for Plausible { key, of, range: [least, most], expected } in PLAUSIBLE {
            let found = of(self);
            if !(least..=most).contains(&found) {
                return Err(Invalid { key, found, expected: format!("{expected}; compare the unit") });
            }
        }
        Ok(())
    }

    /// Diameter at arc length `s_m`.
    pub fn diameter_m(&self, s_m: f64) -> f64 {
        self.root_diameter_m + (self.tip_diameter_m - self.root_diameter_m) * s_m / self.length_m
    }

    /// Bending stiffness `E pi d^4 / 64` at arc length `s_m`, in N m2.
    pub fn bending_stiffness_n_m2(&self, s_m: f64) -> f64 {
        self.youngs_modulus_pa * PI * self.diameter_m(s_m).powi(4) / 64.0
    }

    /// The undeflected centre line.
    pub fn rest_shape(&self) -> RestShape {
        RestShape::new(&self.curvature)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_parameters_in_other_units_are_implausible() {
        for whisker in [Whisker::straight(), Whisker::curved(), Whisker::stanford()] {
            assert_eq!(whisker.check_plausible(), Ok(()));
        }
        let millimetres = Whisker { length_m: 80.0, ..Whisker::straight() };
        let message = millimetres.check_plausible().unwrap_err().to_string();
        assert_eq!(message, "whisker.length_m: found 80, expected 1e-3 to 1 m; compare the unit");
        let gigapascals = Whisker { youngs_modulus_pa: 75.0, ..Whisker::straight() };
        assert_eq!(gigapascals.check_plausible().unwrap_err().key, "youngs_modulus_pa");
    }

    #[test]
    fn verif_the_first_different_parameter_is_named() {
        let straight = Whisker::straight();
        assert_eq!(straight.difference(&straight), None);
        let name = "name: found \"curved\", expected \"straight\"";
        assert_eq!(Whisker::curved().difference(&straight).as_deref(), Some(name));
        let longer = Whisker { length_m: 0.09, ..straight.clone() };
        assert_eq!(longer.difference(&straight).as_deref(), Some("length_m: found 0.09, expected 0.08"));
    }
}
