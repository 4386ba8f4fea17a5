//! Natural frequencies of the unloaded whisker, against which the dynamics of a simulator are validated.

use std::f64::consts::PI;

use crate::{Invalid, Whisker};

/// The first `N` natural frequencies of a straight whisker of uniform diameter on its compliant root, without damping,
/// ascending.
///
/// Euler-Bernoulli beam, free at the tip, on a rotational spring at the root: `f = (lambda / L)^2 sqrt(EI / (rho A)) /
/// (2 pi)` with `lambda` the positive roots of
///
/// ```text
/// K (1 + cos l cosh l) = l (sin l cosh l - cos l sinh l)    K = k L / EI
/// ```
///
/// (Blevins, "Formulas for Natural Frequency and Mode Shape", 1979, beams on springs). The limit of a stiff root is the
/// clamped beam, 1.8751, 4.6941, 7.8548; that of a soft root the pinned one, 0, 3.9266, 7.0686. Root `n` lies between
/// `(n - 1) pi` and `n pi`.
///
/// # Errors
/// [`Invalid`] if the parameters do not describe a whisker that is straight and uniform.
pub fn natural_frequencies_hz<const N: usize>(whisker: &Whisker) -> Result<[f64; N], Invalid> {
    whisker.validate()?;
    if whisker.tip_diameter_m != whisker.root_diameter_m {
        let expected = format!("root_diameter_m = {}: a uniform whisker", whisker.root_diameter_m);
        return Err(Invalid { key: "tip_diameter_m", found: whisker.tip_diameter_m, expected });
    }
    if let Some(bent) = whisker.curvature.iter().find(|piece| piece.curvature_per_m != 0.0) {
        return Err(Invalid {
            key: "curvature",
            found: bent.curvature_per_m,
            expected: "0: a straight whisker".into(),
        });
    }
    let stiffness_n_m2 = whisker.bending_stiffness_n_m2(0.0);
    let line_density_kg_m = whisker.density_kg_m3 * PI * whisker.root_diameter_m.powi(2) / 4.0;
    let root = whisker.root_stiffness_n_m_rad * whisker.length_m / stiffness_n_m2;
    // Divided by cosh, which would overflow at high roots.
    let characteristic = |l: f64| root * (1.0 / l.cosh() + l.cos()) - l * (l.sin() - l.cos() * l.tanh());
    Ok(std::array::from_fn(|n| {
        let (mut low, mut high) = (n as f64 * PI, (n as f64 + 1.0) * PI);
        // Positive below the first root, then of alternating sign.
        let below = if n % 2 == 0 { 1.0 } else { -1.0 };
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if below * characteristic(middle) > 0.0 { low = middle } else { high = middle }
        }
        let wave_per_m = 0.5 * (low + high) / whisker.length_m;
        wave_per_m * wave_per_m * (stiffness_n_m2 / line_density_kg_m).sqrt() / (2.0 * PI)
    }))
}
