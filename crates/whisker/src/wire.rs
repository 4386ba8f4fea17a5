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
    /// Ratio of damping to stiffness: of the joints of the simulated chain, and of the wire, for whose lag the fits in space correct.
    /// Zero if it is not known.
    pub damping_s: f64,
}

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
    /// The first parameter in which this whisker differs from an expected one, with both values, for error messages. `None` if they are
    /// equal.
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
    fn verif_the_first_different_parameter_is_named() {
        let straight = Whisker::straight();
        assert_eq!(straight.difference(&straight), None);
        let name = "name: found \"curved\", expected \"straight\"";
        assert_eq!(Whisker::curved().difference(&straight).as_deref(), Some(name));
        let longer = Whisker { length_m: 0.09, ..straight.clone() };
        assert_eq!(longer.difference(&straight).as_deref(), Some("length_m: found 0.09, expected 0.08"));
    }
}
