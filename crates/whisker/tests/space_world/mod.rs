//! Calibrations in space with the exact parameters of the whisker, for tests.

use std::f64::consts::TAU;
use std::sync::Arc;

use serde_json::json;
use whisker::Whisker;
use whisker::rod::Suspension;
use whisker::space::estimators::Knowledge;
use whisker::space::sensor::{
    Across, Around, Axis, CalibratedSpace, SpatialDomain, SpatialErrorMap, SpatialRegion, SpatialWhisker, spatial_model,
};

/// Sampling rate (Hz).
pub(crate) const RATE_HZ: f64 = 250.0;

/// A calibration with the exact parameters, from 30 to 62 mm along the whisker and up to 3 s^2 away from it.
///
/// The wire has almost no mass and no damping, for which estimators would correct: the contacts of the tests are equilibria.
pub(crate) fn knowledge(whisker: Whisker) -> Arc<Knowledge> {
    let whisker = Whisker { density_kg_m3: 1e-3 * whisker.density_kg_m3, damping_s: 0.0, ..whisker };
    let k = whisker.root_stiffness_n_m_rad;
    let values = [1.0, 1.0, whisker.youngs_modulus_pa, k, k, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let names = [
        "gain_y",
        "gain_z",
        "youngs_modulus_pa",
        "yaw_stiffness_n_m_rad",
        "pitch_stiffness_n_m_rad",
        "curvature_scale",
        "reading_offset_y_n_m",
        "reading_offset_z_n_m",
        "root_x_m",
        "root_y_m",
        "root_z_m",
        "root_roll_rad",
        "root_pitch_rad",
        "root_yaw_rad",
    ];
    let parameters = names.iter().zip(values).map(
        |(name, value)| json!({"name": name, "value": value, "sd": 0.0, "prior_sd": 0.0, "informed_by_data": false}),
    );
    let mut samples = Vec::new();
    for node in 0..9 {
        for turn in 0..16 {
            let (along_m, azimuth) = (0.03 + 0.004 * f64::from(node), TAU * f64::from(turn) / 16.0);
            let away_m = 3.0 * along_m * along_m;
            samples.push(Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()));
        }
    }
    let suspension = Suspension { yaw_n_m_rad: k, pitch_n_m_rad: k, twist_n_m_rad: k };
    let axis = Axis::new(&whisker, Across::Normal);
    let whisker = SpatialWhisker { whisker, suspension, poisson_ratio: 0.33 };
    let domain = SpatialDomain::covering(&samples, Across::Normal).unwrap();
    let stored = json!({"kind": "rod", "parameters": parameters.collect::<Vec<_>>()});
    let model = (spatial_model("rod").unwrap().load)(&SpatialRegion { whisker: &whisker, domain: &domain }, &stored);
    let calibrated = CalibratedSpace {
        whisker,
        axis,
        label: "rod".into(),
        model: model.unwrap().into(),
        error: SpatialErrorMap {
            along: 2,
            away: 2,
            covariances_n2_m2: vec![[1e-18, 0.0, 1e-18]; 4],
            correlation_m: None,
        },
        heldout_rms_n_m: 1e-9,
        heldout_worst_n_m: 1e-9,
        largest_reading_n_m: 2e-5,
        real_sensor: false,
        mounting: None,
        geometry: Default::default(),
        domain,
    };
    Arc::new(Knowledge { calibrated: Arc::new(calibrated), noise_sd_n_m: 1.5e-7, rate_hz: RATE_HZ })
}
