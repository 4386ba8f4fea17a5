//! First mode of the free whisker.

use std::f64::consts::PI;

use crate::Whisker;

/// Panels of the integrals along the whisker.
const PANELS: usize = 200;

/// The first mode of a free whisker on its compliant root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstMode {
    /// Natural frequency.
    pub frequency_hz: f64,
    /// Damping ratio: damping relative to the critical one.
    pub damping_ratio: f64,
}

impl FirstMode {
    /// The first mode by Rayleigh's quotient, with the deflection under the inertial load of a rigid rotation: within
    /// 0.1 % of beam theory for uniform wires. Pre-curvature is neglected; a radius of curvature equal to the length
    /// raises the frequency by 2 %. Hinges whose damping is `damping_s` times their stiffness damp a mode of angular
    /// frequency w by the ratio `w damping_s / 2`.
    pub fn of(whisker: &Whisker) -> Self {
        let step_m = whisker.length_m / PANELS as f64;
        let arcs_m: Vec<f64> = (0..PANELS).map(|panel| (panel as f64 + 0.5) * step_m).collect();
        let mass_kg: Vec<f64> = arcs_m
            .iter()
            .map(|&arc_m| whisker.density_kg_m3 * 0.25 * PI * whisker.diameter_m(arc_m).powi(2) * step_m)
            .collect();
        // Load, shear and bending moment for an angular acceleration of one.
        let load_n: Vec<f64> = mass_kg.iter().zip(&arcs_m).map(|(mass_kg, arc_m)| mass_kg * arc_m).collect();
        let moment_n_m: Vec<f64> = arcs_m
            .iter()
            .map(|&at_m| load_n.iter().zip(&arcs_m).map(|(load_n, arc_m)| load_n * (arc_m - at_m).max(0.0)).sum())
            .collect();
        let root_n_m: f64 = load_n.iter().zip(&arcs_m).map(|(load_n, arc_m)| load_n * arc_m).sum();
        let mut angle_rad = root_n_m / whisker.root_stiffness_n_m_rad;
        let mut deflection_m = 0.0;
        let (mut work, mut inertia) = (0.0, 0.0);
        for panel in 0..PANELS {
            let bend_rad = moment_n_m[panel] / whisker.bending_stiffness_n_m2(arcs_m[panel]) * step_m;
            let middle_m = deflection_m + 0.5 * step_m * (angle_rad + 0.25 * bend_rad);
            work += load_n[panel] * middle_m;
            inertia += mass_kg[panel] * middle_m * middle_m;
            deflection_m += step_m * (angle_rad + 0.5 * bend_rad);
            angle_rad += bend_rad;
        }
        let angular_rad_s = (work / inertia).sqrt();
        Self { frequency_hz: angular_rad_s / (2.0 * PI), damping_ratio: 0.5 * angular_rad_s * whisker.damping_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::natural_frequencies_hz;

    #[test]
    fn val_first_mode_of_a_beam_on_a_spring() {
        for root_stiffness_n_m_rad in [0.17e-3, 3.2e-3, 1.0] {
            let whisker = Whisker { root_stiffness_n_m_rad, ..Whisker::straight() };
            let [beam_hz] = natural_frequencies_hz(&whisker).unwrap();
            let first_mode = FirstMode::of(&whisker);
            assert!((first_mode.frequency_hz / beam_hz - 1.0).abs() < 1e-3, "{} {beam_hz}", first_mode.frequency_hz);
            assert!((first_mode.damping_ratio / (PI * beam_hz * 2.35e-3) - 1.0).abs() < 1e-3);
        }
    }
}
