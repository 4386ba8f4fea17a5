//! Colours in sRGB.

/// An opaque colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rgb(pub(crate) u8, pub(crate) u8, pub(crate) u8);

/// A colour with an opacity from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rgba(pub(crate) Rgb, pub(crate) f64);

impl Rgb {
    /// White.
    pub(crate) const WHITE: Self = Self(255, 255, 255);

    /// The colour at an opacity from 0 to 1.
    pub(crate) const fn mix(self, opacity: f64) -> Rgba {
        Rgba(self, opacity)
    }
}

impl From<Rgb> for Rgba {
    fn from(color: Rgb) -> Self {
        Self(color, 1.0)
    }
}

/// Nodes of the colour map viridis (van der Walt and Smith 2015) at equal distances.
const VIRIDIS: [Rgb; 8] = [
    Rgb(68, 1, 84),
    Rgb(70, 50, 127),
    Rgb(54, 92, 141),
    Rgb(39, 127, 143),
    Rgb(31, 162, 136),
    Rgb(74, 194, 110),
    Rgb(160, 219, 57),
    Rgb(254, 232, 37),
];

/// The colour map viridis, linear between its nodes: dark at 0, light at 1, constant beyond.
pub(crate) fn viridis(fraction: f64) -> Rgb {
    let last = VIRIDIS.len() - 1;
    let place = fraction.clamp(0.0, 1.0) * last as f64;
    let index = (place as usize).min(last - 1);
    let (from, to) = (VIRIDIS[index], VIRIDIS[index + 1]);
    let share = place - index as f64;
    let between = |from: u8, to: u8| (f64::from(from) + share * (f64::from(to) - f64::from(from))).round() as u8;
    Rgb(between(from.0, to.0), between(from.1, to.1), between(from.2, to.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_viridis_passes_through_its_nodes_and_is_constant_beyond() {
        assert_eq!([-1.0, 0.0, 1.0, 2.0].map(viridis), [VIRIDIS[0], VIRIDIS[0], VIRIDIS[7], VIRIDIS[7]]);
        assert_eq!(viridis(3.0 / 7.0), VIRIDIS[3]);
        assert_eq!(viridis(0.5 / 7.0), Rgb(69, 26, 106));
    }
}
