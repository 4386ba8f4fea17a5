//! Fixture shared by the unit tests of estimators.

use std::sync::Arc;

use super::Knowledge;
use crate::elastica::{Elastica, Load};
use crate::sensor::{self, Face, FitData};
use crate::{Curvature, Whisker};

/// A curved whisker, its left face calibrated by the elastica.
pub(super) fn knowledge() -> Knowledge {
    let whisker = Whisker { damping_s: 0.0, ..Whisker::curved() }.with_curvature([Curvature::new(0.08, -6.0)]);
    let elastica = Elastica::new(&whisker).unwrap();
    let lines: Vec<Vec<sensor::Sample>> = (0..24)
        .map(|i| {
            let arc_m = 0.03 + 0.002 * f64::from(i);
            let pressed = (0..24).map(|j| {
                let left_n = -8e-5 * f64::from(j) * (0.03 / arc_m).powi(2);
                let pressed = elastica.deflect(Load { arc_m, along_n: 0.0, left_n, couple_n_m: 0.0 }).unwrap();
                sensor::Sample { contact: pressed.point, reading_n_m: pressed.moment_n_m }
            });
            pressed.collect()
        })
        .collect();
    let material = FitData {
        whisker: &whisker,
        face: Face::Left,
        measured: &lines,
        reference: &lines,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    let row = sensor::model("polynomial").unwrap();
    let face = sensor::fit(row, &(row.defaults)(), &material).unwrap().face;
    let rest = whisker.rest_shape();
    Knowledge {
        whisker,
        rest,
        faces: vec![Arc::new(face)],
        noise_sd_n_m: 1e-7,
        base_noise: Default::default(),
        rate_hz: 250.0,
        contact_prior: None,
    }
}
