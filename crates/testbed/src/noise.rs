//! Units of noise levels.

use serde::{Deserialize, Serialize};

/// Unit in which the noise levels of an evaluation are stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseUnit {
    /// Largest reading of each set.
    #[default]
    Set,
    /// Largest reading of the calibration of the face that touches.
    Range,
    /// Newton metre.
    NewtonMetre,
    /// Noise that each trace states.
    Stated,
}

impl NoiseUnit {
    /// Whether it is the default.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Symbol of the unit in which levels are printed.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Set | Self::Range => "%",
            Self::NewtonMetre => "µN m",
            Self::Stated => "×",
        }
    }

    /// A level in the unit of [`Self::symbol`], to nine digits, without the traces of binary arithmetic.
    pub fn printed(self, level: f64) -> f64 {
        let factor = match self {
            Self::Set | Self::Range => 100.0,
            Self::NewtonMetre => 1e6,
            Self::Stated => 1.0,
        };
        format!("{:.8e}", factor * level).parse().expect("a formatted number is a number")
    }

    /// Noise levels in words.
    pub fn describe(self, levels: &[f64]) -> String {
        let printed = |level: &f64| format!("{} {}", self.printed(*level), self.symbol());
        let levels = levels.iter().map(printed).collect::<Vec<_>>().join(", ");
        match self {
            Self::Set => format!("{levels} of each set's largest reading"),
            Self::Range => format!("{levels} of the largest calibrated reading"),
            Self::NewtonMetre => levels,
            Self::Stated => format!("{levels} the noise that the traces state"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_levels_are_printed_in_their_unit() {
        for (unit, levels, words) in [
            (NoiseUnit::Set, &[0.01, 0.07][..], "1 %, 7 % of each set's largest reading"),
            (NoiseUnit::Range, &[0.003], "0.3 % of the largest calibrated reading"),
            (NoiseUnit::NewtonMetre, &[2.1e-6], "2.1 µN m"),
            (NoiseUnit::Stated, &[1.0], "1 × the noise that the traces state"),
        ] {
            assert_eq!(unit.describe(levels), words);
        }
    }
}
