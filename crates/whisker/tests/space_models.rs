//! Sensor models in space: fit to lines of exact contacts, derivatives, cross-validation, storage, and refused calibrations.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use nalgebra::{Matrix2x3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde_json::json;
use whisker::Whisker;
use whisker::frames::Base;
use whisker::rod::Suspension;
use whisker::sensor::ModelError;
use whisker::space::frames::Point;
use whisker::space::sensor::{
    self, Across, Around, Axis, CalibratedSpace, SPATIAL_MODELS, SpatialFitData, SpatialModelRow, SpatialRegion,
    SpatialSample, SpatialWhisker, spatial_model,
};

/// Noise of the readings, relative to the largest.
const NOISE: f64 = 1e-2;

fn round(whisker: Whisker) -> SpatialWhisker {
    let k = whisker.root_stiffness_n_m_rad;
    let suspension = Suspension { yaw_n_m_rad: k, pitch_n_m_rad: k, twist_n_m_rad: k };
    SpatialWhisker { whisker, suspension, poisson_ratio: 0.33 }
}

fn whiskers() -> [SpatialWhisker; 2] {
    [round(Whisker::straight()), round(Whisker::curved())]
}

/// Exact bending moments of a contact, through gains of 0.97 and 1.04.
fn exact(whisker: &SpatialWhisker, contact: Point<Base>) -> Vector2<f64> {
    let moment = whisker.rod().unwrap().at_point(contact.vector()).unwrap().deflection.moment_n_m;
    Vector2::new(0.97 * moment.y, 1.04 * moment.z)
}

/// Lines of contacts at seven arc lengths, in the given directions, up to the distance 2.4 s^2.
fn lines(whisker: &SpatialWhisker, directions: &[f64]) -> Vec<Vec<SpatialSample>> {
    let (axis, mut random) = (Axis::new(&whisker.whisker, Across::Normal), Pcg64::seed_from_u64(4));
    let mut lines = Vec::new();
    for node in 0..7 {
        for azimuth in directions {
            let along_m = 0.032 + 0.0045 * f64::from(node);
            let sample = |step: u32| {
                let away_m = 2.4 * along_m * along_m * f64::from(step) / 6.0;
                let contact = Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()).contact(&axis);
                SpatialSample {
                    contact,
                    reading_n_m: Vector2::zeros(),
                    reference_n_m: exact(whisker, contact),
                    count: 1.0,
                }
            };
            lines.push((0..=6).map(sample).collect::<Vec<_>>());
        }
    }
    let largest = lines.iter().flatten().map(|sample| sample.reference_n_m.norm()).fold(0.0, f64::max);
    for sample in lines.iter_mut().flatten() {
        let noise = Vector2::from_fn(|_, _| NOISE * largest * random.sample::<f64, _>(StandardNormal));
        sample.reading_n_m = sample.reference_n_m + noise;
    }
    lines
}

fn all_around() -> Vec<f64> {
    (0..9).map(|i| TAU * f64::from(i) / 9.0).collect()
}

/// Data without noise of a simulated whisker.
fn exact_data<'a>(whisker: &'a SpatialWhisker, lines: &'a [Vec<SpatialSample>]) -> SpatialFitData<'a> {
    SpatialFitData { whisker, lines, reference_noise_sd_n_m: 0.0, across: Across::Normal, real_sensor: false }
}

fn fitted(whisker: &SpatialWhisker, kind: &str, config: serde_json::Value) -> CalibratedSpace {
    let lines = lines(whisker, &all_around());
    let data = exact_data(whisker, &lines);
    sensor::fit(spatial_model(kind).unwrap(), &config, &data).unwrap().calibrated
}

/// The rod that is fitted to the curved whisker.
static CURVED_ROD: LazyLock<CalibratedSpace> = LazyLock::new(|| fitted(&whiskers()[1], "rod", json!({})));

/// The Gaussian process that is fitted to a part of the samples of the curved whisker.
static PROCESS: LazyLock<CalibratedSpace> =
    LazyLock::new(|| fitted(&whiskers()[1], "gaussian-process", json!({ "most_samples": 150 })));

/// The spline that is fitted to the curved whisker.
static SPLINE: LazyLock<CalibratedSpace> =
    LazyLock::new(|| fitted(&whiskers()[1], "spline", json!({ "along": 3, "across": 2 })));

/// The models of the registry, fitted to the curved whisker.
fn models() -> [(&'static SpatialModelRow, CalibratedSpace); 4] {
    let polynomial = fitted(&whiskers()[1], "polynomial", json!({}));
    let faces = [CURVED_ROD.clone(), polynomial, SPLINE.clone(), PROCESS.clone()];
    let kinds = ["rod", "polynomial", "spline", "gaussian-process"];
    std::array::from_fn(|i| (kinds[i], faces[i].clone())).map(|(kind, face)| (spatial_model(kind).unwrap(), face))
}

/// Contacts within the calibrated domain that no line passes through.
fn between() -> Vec<Around> {
    let mut found = Vec::new();
    for (i, along_m) in [0.0341, 0.0412, 0.0487, 0.0569].into_iter().enumerate() {
        for turn in 0..6 {
            let (azimuth, away_m) = (0.4 + 0.2 * i as f64 + TAU * f64::from(turn) / 6.0, 1.7 * along_m * along_m);
            found.push(Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()));
        }
    }
    found
}

#[test]
fn val_the_rod_reproduces_exact_readings_and_recovers_the_gains() {
    let [straight, curved] = whiskers();
    let fitted_straight = fitted(&straight, "rod", json!({}));
    for (whisker, face) in [(&straight, &fitted_straight), (&curved, &*CURVED_ROD)] {
        let axis = Axis::new(&whisker.whisker, Across::Normal);
        for at in between() {
            let contact = at.contact(&axis);
            let found = face.predict(contact).expect("a calibrated contact");
            let error = (found.reading_n_m - exact(whisker, contact)).norm() / face.largest_reading_n_m;
            // Fourteen parameters from 882 readings with 1 % noise.
            assert!(error < 4e-3, "{} {at:?}: {error}", whisker.whisker.name);
        }
        assert!(face.heldout_rms_n_m < 4e-3 * face.largest_reading_n_m, "{}", face.heldout_rms_n_m);
        let covariance = face.model_covariance_n2_m2(Around::new(0.045, 2e-3, 1e-3));
        assert!(covariance.symmetric_eigenvalues().min() > 0.0);
    }
}

#[test]
fn val_models_without_mechanics_reproduce_exact_readings_and_state_their_error() {
    let whisker = &whiskers()[1];
    for face in [&*SPLINE, &*PROCESS] {
        let mut squares = 0.0;
        for at in between() {
            let contact = at.contact(&face.axis);
            let found = face.predict(contact).expect("a calibrated contact");
            squares += (found.reading_n_m - exact(whisker, contact)).norm_squared() / (2.0 * between().len() as f64);
        }
        let (rms, heldout) =
            (squares.sqrt() / face.largest_reading_n_m, face.heldout_rms_n_m / face.largest_reading_n_m);
        // 150 places or more with 1 % noise. Some held-out lines lie at the border of the calibrated domain, with no lines beyond
        // them.
        assert!(rms < 1e-2 && rms < heldout && heldout < 5e-2, "{}: {rms} {heldout}", face.label);
    }
}

#[test]
fn verif_the_covariance_contains_the_variances_that_the_model_predicts() {
    let at = Around::new(0.045, 2e-3, 1e-3);
    for (row, face) in models() {
        let (covariance, sd_n_m) = (face.model_covariance_n2_m2(at), face.model.sd_n_m(at));
        assert_eq!(sd_n_m.min() > 0.0, row.kind == "gaussian-process", "{}", row.kind);
        assert!((0..2).all(|moment| covariance[(moment, moment)] > sd_n_m[moment].powi(2)), "{}", row.kind);
    }
}

#[test]
fn verif_candidates_are_settings_and_each_calibration_has_some() {
    for real_sensor in [false, true] {
        let compared: Vec<_> = SPATIAL_MODELS.iter().filter(|row| !(row.candidates)(real_sensor).is_empty()).collect();
        let kinds: Vec<_> = compared.iter().map(|row| row.kind).collect();
        let others: &[&str] = if real_sensor { &["spline", "gaussian-process"] } else { &["rod"] };
        assert_eq!(kinds, [&["polynomial"], others].concat());
        for row in compared {
            let known = (row.defaults)();
            for settings in (row.candidates)(real_sensor) {
                assert!(settings.as_object().unwrap().keys().all(|key| known.get(key).is_some()), "{settings}");
            }
        }
    }
}

#[test]
fn verif_derivatives_are_those_of_differences() {
    let axis = Axis::new(&whiskers()[1].whisker, Across::Normal);
    for (row, face) in models() {
        for at in between() {
            let contact = at.contact(&axis);
            let found = face.model.predict(contact);
            let slope = |entry: usize| {
                let step = 1e-7 * Vector3::ith(entry, 1.0);
                let [after, before] = [contact.shifted(step), contact.shifted(-step)]
                    .map(|contact| face.model.predict(contact).reading_n_m);
                (after - before) / 2e-7
            };
            let expected = Matrix2x3::from_columns(&[slope(0), slope(1), slope(2)]);
            assert!((found.gradient_n - expected).norm() < 1e-5 * expected.norm(), "{} {at:?}", row.kind);
            let (reading, slopes) = face.model.predict_around(&axis, at);
            let jacobian = at.contact_with_jacobian(&axis).1;
            assert!((reading - found.reading_n_m).norm() < 1e-12 * face.largest_reading_n_m);
            assert!((slopes - found.gradient_n * jacobian).norm() < 1e-9 * slopes.norm());
        }
    }
}

#[test]
fn verif_a_stored_model_is_restored_bit_for_bit() {
    let whisker = &whiskers()[1];
    assert_eq!(models().len(), SPATIAL_MODELS.len());
    for (row, face) in models() {
        let text = face.model.to_json().to_string();
        let region = SpatialRegion { whisker, domain: &face.domain };
        let restored = (row.load)(&region, &serde_json::from_str(&text).unwrap()).unwrap();
        assert_eq!(restored.to_json().to_string(), text);
        for at in between() {
            let contact = at.contact(&face.axis);
            assert_eq!(restored.predict(contact), face.model.predict(contact), "{} {at:?}", row.kind);
        }
    }
}

#[test]
fn robust_invalid_knots_and_coefficients_of_a_spline_are_refused() {
    let whisker = &whiskers()[1];
    let lines = lines(whisker, &all_around());
    let row = spatial_model("spline").unwrap();
    let config = json!({ "along": 0 });
    let Err(error) = sensor::fit(row, &config, &exact_data(whisker, &lines)) else {
        panic!("no intervals were accepted")
    };
    assert!(error.to_string().contains("`along`: found 0 knot intervals, expected 1 to 6"), "{error}");

    let region = SpatialRegion { whisker, domain: &SPLINE.domain };
    let stored = SPLINE.model.to_json();
    for (pointer, value, expected) in [
        ("/grid/intervals/1", json!(0), "expected 1 to 6 intervals in each direction"),
        ("/grid/last/0", json!(-1.0), "of which the first is less than the last"),
        ("/coefficients_n_m/1", json!([0.0]), "found 1 numbers, expected 150 finite ones"),
    ] {
        let mut damaged = stored.clone();
        *damaged.pointer_mut(pointer).unwrap() = value;
        let error = (row.load)(&region, &damaged).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn val_directions_are_those_of_the_rod() {
    for whisker in whiskers() {
        let face = fitted(&whisker, "polynomial", json!({}));
        let (rod, geometry) = (whisker.rod().unwrap(), face.geometry().unwrap());
        for at in between() {
            let exact = rod.at_point(at.contact(&face.axis).vector()).unwrap().deflection;
            let found = geometry.at(at);
            assert!((found.normal - exact.force_n.normalize()).norm() < 1e-3, "{at:?}");
            assert!((found.tangent - exact.directors.column(0)).norm() < 1e-4, "{at:?}");
            for axis in 0..3 {
                let step = 1e-7 * Vector3::ith(axis, 1.0);
                let beside = |x: Vector3<f64>| geometry.at(Around::new(x.x, x.y, x.z)).normal;
                let x = Vector3::new(at.along_m, at.left_m, at.up_m);
                let slope = (beside(x + step) - beside(x - step)) / 2e-7;
                assert!((slope - found.normal_slopes.column(axis)).norm() < 1e-4 * slope.norm().max(1.0), "{at:?}");
            }
        }
    }
}

#[test]
fn robust_a_calibration_in_one_plane_is_refused() {
    let whisker = &whiskers()[0];
    let lines = lines(whisker, &[0.0, 0.5 * TAU]);
    let data = exact_data(whisker, &lines);
    for row in SPATIAL_MODELS {
        let Err(ModelError::Data(reason)) = sensor::fit(row, &(row.defaults)(), &data) else {
            panic!("{}: a planar calibration was accepted", row.kind)
        };
        assert!(reason.contains("do not surround the whisker"), "{reason}");
    }
}

#[test]
fn robust_outside_the_calibrated_domain_nothing_is_stated() {
    let whisker = &whiskers()[0];
    let face = fitted(whisker, "polynomial", json!({}));
    for at in [Around::new(0.025, 1e-3, 0.0), Around::new(0.065, 1e-3, 0.0), Around::new(0.045, 0.0, 6e-3)] {
        assert!(face.predict(at.contact(&face.axis)).is_none(), "{at:?}");
    }
}
