//! Preset whiskers: the same parameters as those of the simulator (`whisker_sim.whisker.PRESETS`).

use crate::{Curvature, Whisker};

impl Whisker {
    /// Straight nitinol wire, 80 mm x 0.25 mm, on a compliant root.
    pub fn straight() -> Self {
        Self {
            name: "straight".into(),
            length_m: 0.08,
            root_diameter_m: 0.25e-3,
            tip_diameter_m: 0.25e-3,
            youngs_modulus_pa: 60e9,
            density_kg_m3: 6450.0,
            curvature: vec![Curvature::new(0.08, 0.0)],
            root_stiffness_n_m_rad: 0.17e-3,
            segments: 40,
            // The released whisker's oscillation falls below the noise at rest within 1.4 s, as in Lin et al. (IROS
            // 2022).
            damping_s: 2.35e-3,
        }
    }

    /// The same wire with a radius of curvature of 80 mm, bent to the left.
    pub fn curved() -> Self {
        Self::straight().named("curved").with_curvature([Curvature::new(0.08, 12.5)])
    }

    /// Nitinol wire, 50 mm x 0.2 mm: 20 mm straight, then an arc of radius 18 mm to the left.
    pub fn stanford() -> Self {
        Self { root_diameter_m: 0.2e-3, tip_diameter_m: 0.2e-3, youngs_modulus_pa: 75e9, ..Self::straight() }
            .named("stanford")
            .with_curvature([Curvature::new(0.02, 0.0), Curvature::new(0.03, 1.0 / 0.018)])
    }

    /// The whisker under another name.
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self }
    }

    /// The whisker with these pieces of constant pre-curvature, from root to tip, whose lengths add up to its length.
    pub fn with_curvature(self, pieces: impl Into<Vec<Curvature>>) -> Self {
        let curvature = pieces.into();
        Self { length_m: curvature.iter().map(|piece| piece.length_m).sum(), curvature, ..self }
    }
}
