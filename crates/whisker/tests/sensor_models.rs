//! The exam of every registered sensor model with each of its candidate settings: fitted to noisy samples of the exact
//! quasi-static whisker.

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde_json::Value;
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point};
use whisker::sensor::{self, AlongAway, Domain, Face, Fit, FitData, FittedModel, ModelError, ModelRow, Region, Sample};

/// Typical noise of the calibrations, relative to the largest reading.
const NOISE: f64 = 0.01;

fn cases() -> [(Whisker, Face); 3] {
    [(Whisker::straight(), Face::Left), (Whisker::curved(), Face::Left), (Whisker::curved(), Face::Right)]
}

/// Contacts on a grid beside a whisker, shifted by the share `phase` of a cell, without readings.
fn contacts(whisker: &Whisker, face: Face, phase: f64) -> Vec<Point<Base>> {
    let rest = whisker.rest_shape();
    let places = (0..32).flat_map(|i| (0..20).map(move |j| (f64::from(i) + phase, f64::from(j) + phase)));
    places
        .map(|(i, j)| {
            let arc_m = 0.018 + 0.056 * i / 32.0;
            rest.beside(arc_m, face.away_sign() * 0.35 * arc_m * j / 20.0)
        })
        .collect()
}

/// Readings of the exact whisker at the contacts within its reach.
fn samples(whisker: &Whisker, contacts: &[Point<Base>]) -> Vec<Sample> {
    let elastica = Elastica::new(whisker).unwrap();
    let reached = contacts.iter().filter_map(|&contact| Some((contact, elastica.at_point(contact).ok()?)));
    reached.map(|(contact, found)| Sample { contact, reading_n_m: found.deflection.moment_n_m }).collect()
}

fn largest_n_m(samples: &[Sample]) -> f64 {
    samples.iter().map(|sample| sample.reading_n_m.abs()).fold(0.0, f64::max)
}

fn noisy(samples: &[Sample], noise: f64, seed: u64) -> Vec<Sample> {
    let noise_sd_n_m = noise * largest_n_m(samples);
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut noise = || noise_sd_n_m * rng.sample::<f64, _>(StandardNormal);
    samples.iter().map(|sample| Sample { reading_n_m: sample.reading_n_m + noise(), ..*sample }).collect()
}

/// Every model with each of its candidate settings.
fn candidates() -> Vec<(&'static ModelRow, Value)> {
    let of_row = |row: &'static ModelRow| (row.candidates)().into_iter().map(move |config| (row, config));
    sensor::MODELS.iter().flat_map(of_row).collect()
}

fn fits(whisker: &Whisker, face: Face) -> Vec<Fit> {
    let reference: Vec<Vec<Sample>> =
        [0.0, 0.3, 0.6].map(|phase| samples(whisker, &contacts(whisker, face, phase))).into();
    let measured: Vec<Vec<Sample>> = reference.iter().zip(1..).map(|(trace, seed)| noisy(trace, NOISE, seed)).collect();
    let material = FitData {
        whisker,
        face,
        measured: &measured,
        reference: &reference,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    candidates().iter().map(|(row, config)| sensor::fit(row, config, &material).unwrap()).collect()
}

/// Contacts off the grid, well within the region.
fn probes(whisker: &Whisker, face: Face) -> Vec<Point<Base>> {
    let rest = whisker.rest_shape();
    let places = [(0.03, 0.1), (0.043, 0.3), (0.0512, 0.02), (0.06, 0.21), (0.068, 0.26)];
    places.map(|(arc_m, share)| rest.beside(arc_m, face.away_sign() * share * arc_m)).into()
}

#[test]
fn val_readings_and_tangents_are_those_of_the_exact_whisker_and_the_right_mechanics_predict_best() {
    let mut known = 0;
    for (whisker, face) in cases() {
        let (elastica, fits) = (Elastica::new(&whisker).unwrap(), fits(&whisker, face));
        for fit in &fits {
            let face = &fit.face;
            let share = face.heldout_rms_n_m / face.largest_reading_n_m;
            let most = if face.label.starts_with("elastica") { 1e-3 } else { 4e-3 };
            assert!(share < most, "{} {:?} {}: {share}", whisker.name, face.face, face.label);
        }
        let best = fits.iter().min_by(|a, b| a.face.heldout_rms_n_m.total_cmp(&b.face.heldout_rms_n_m)).unwrap();
        assert!(best.face.label.starts_with("elastica"), "{} {face:?}: {}", whisker.name, best.face.label);
        for fit in &fits {
            for contact in probes(&whisker, face) {
                let Some(tangent_rad) = fit.face.model.tangent_rad(contact) else { continue };
                let expected_rad = elastica.at_point(contact).unwrap().deflection.tangent_rad;
                // The noise of the calibration leaves the root's yaw uncertain.
                assert!((tangent_rad - expected_rad).abs() < 0.03, "{tangent_rad} {expected_rad}");
                known += 1;
            }
        }
    }
    assert!(known > 0);
}

#[test]
fn verif_gradients_are_those_of_the_reading() {
    const STEP_M: f64 = 1e-6;
    let (whisker, face) = (Whisker::curved(), Face::Right);
    for fit in fits(&whisker, face) {
        let model = &fit.face.model;
        for contact in probes(&whisker, face) {
            let slope = |step: Vector2<f64>| {
                (model.reading_n_m(contact.shifted(step)) - model.reading_n_m(contact.shifted(-step))) / (2.0 * STEP_M)
            };
            let expected_n = Vector2::new(slope(Vector2::x() * STEP_M), slope(Vector2::y() * STEP_M));
            let found = model.predict(contact);
            let miss = (found.gradient_n - expected_n).norm() / expected_n.norm();
            assert!(miss < 1e-6, "{} at {contact:?}: {miss}", fit.face.label);
            assert_eq!(found.reading_n_m.to_bits(), model.reading_n_m(contact).to_bits());
        }
    }
}

#[test]
fn verif_storing_and_loading_preserves_every_bit() {
    let (whisker, face) = (Whisker::curved(), Face::Left);
    for fit in fits(&whisker, face) {
        let model = &fit.face.model;
        let text = serde_json::to_string(&model.to_json()).unwrap();
        let region = Region { whisker: &whisker, face, domain: &fit.face.domain };
        let load = sensor::model(model.kind()).unwrap().load;
        let again = load(&region, &serde_json::from_str(&text).unwrap()).unwrap();
        assert_eq!(serde_json::to_string(&again.to_json()).unwrap(), text);
        assert_eq!((again.label(), again.about()), (model.label(), model.about()));
        for contact in probes(&whisker, face) {
            assert_eq!(again.reading_n_m(contact).to_bits(), model.reading_n_m(contact).to_bits());
        }
    }
}

#[test]
fn verif_labels_are_unique() {
    let fits = fits(&Whisker::straight(), Face::Left);
    for (i, fit) in fits.iter().enumerate() {
        assert!(fits[..i].iter().all(|other| other.face.label != fit.face.label), "{}", fit.face.label);
    }
}

#[test]
fn verif_model_error_is_never_zero_and_of_the_size_of_the_residuals() {
    for fit in fits(&Whisker::curved(), Face::Left) {
        let face = &fit.face;
        let samples = samples(&Whisker::curved(), &contacts(&Whisker::curved(), Face::Left, 0.1));
        let variances: Vec<f64> = samples.iter().map(|s| face.model_variance_n2_m2(s.contact)).collect();
        assert!(variances.iter().all(|variance| *variance > 0.0), "{}", face.label);
        // The final fit has more samples than those of the cross-validation, so its error is no larger.
        let ratio = (variances.iter().sum::<f64>() / samples.len() as f64).sqrt() / face.heldout_rms_n_m;
        assert!((0.5..1.25).contains(&ratio), "{}: {ratio}", face.label);
    }
}

/// A fit to samples that are dense along the inner half of the whisker and sparse along the outer half.
fn unevenly_fitted(row: &ModelRow, config: &Value) -> FittedModel {
    let (whisker, face) = (Whisker::straight(), Face::Left);
    let clean = samples(&whisker, &contacts(&whisker, face, 0.5));
    let rest = whisker.rest_shape();
    let foot = |sample: &Sample| rest.foot(sample.contact);
    let at = |sample: &Sample| AlongAway::new(foot(sample).arc_m, foot(sample).left_m * face.away_sign());
    let places: Vec<AlongAway> = clean.iter().map(at).collect();
    let domain = Domain::covering(&places).unwrap();
    let kept: Vec<Sample> = noisy(&clean, NOISE, 5)
        .into_iter()
        .enumerate()
        .filter(|(i, sample)| foot(sample).arc_m < 0.045 || i % 8 == 0)
        .map(|(_, sample)| sample)
        .collect();
    (row.fit)(&Region { whisker: &whisker, face, domain: &domain }, &kept, config).unwrap()
}

#[test]
fn val_variance_is_positive_and_grows_where_samples_are_sparse() {
    for (row, config) in candidates() {
        let variance_n2_m2 = unevenly_fitted(row, &config).variance_n2_m2;
        let at = |arc_m: f64| variance_n2_m2(Point::new(arc_m, -0.17 * arc_m));
        assert!(at(0.03) > 0.0, "{}", row.kind);
        // Mechanics with few parameters interpolate between positions.
        let factor = if row.kind == "elastica" { 0.3 } else { 1.5 };
        assert!(at(0.065) > factor * at(0.03), "{} {config}: {} {}", row.kind, at(0.065), at(0.03));
    }
}

#[test]
fn robust_data_that_do_not_determine_a_model_are_refused() {
    let whisker = Whisker::straight();
    let rest = whisker.rest_shape();
    let at_rest: Vec<Sample> =
        (0..400).map(|i| Sample { contact: rest.point(0.02 + 1e-4 * f64::from(i)), reading_n_m: 0.0 }).collect();
    let few = samples(&whisker, &contacts(&whisker, Face::Left, 0.5)[400..404]);
    for (row, config) in candidates() {
        for data in [&at_rest, &few] {
            let traces = [data.clone()];
            let material = FitData {
                whisker: &whisker,
                face: Face::Left,
                measured: &traces,
                reference: &traces,
                reference_noise_sd_n_m: 0.0,
                pin_radius_m: 0.0,
            };
            let error = sensor::fit(row, &config, &material).unwrap_err();
            assert!(matches!(error, ModelError::Data(_)), "{}: {error}", row.kind);
            assert_eq!(error.to_string().lines().count(), 1);
        }
    }
}

#[test]
fn robust_invalid_settings_are_refused() {
    let whisker = Whisker::straight();
    let data = samples(&whisker, &contacts(&whisker, Face::Left, 0.5));
    let traces = [data];
    let material = FitData {
        whisker: &whisker,
        face: Face::Left,
        measured: &traces,
        reference: &traces,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    for (kind, config, word) in [
        ("polynomial", r#"{"degree": 99}"#, "degree"),
        ("polynomial", r#"{"grade": 5}"#, "grade"),
        ("spline", r#"{"along": 0}"#, "along"),
        ("elastica", r#"{"response": 2}"#, "response"),
        ("elastica", r#"{"root_sd_m": -1.0}"#, "root_sd_m"),
    ] {
        let row = sensor::model(kind).unwrap();
        let error = sensor::fit(row, &serde_json::from_str(config).unwrap(), &material).unwrap_err().to_string();
        assert!(error.contains(word) && error.lines().count() == 1, "{error}");
    }
}

/// A whisker that is stiffer, more curved, rotated and displaced compared with the nominal one, under a sensor with a
/// gain.
#[test]
fn val_physical_parameters_are_recovered() {
    let nominal = Whisker::curved();
    let mut real = Whisker::curved();
    real.youngs_modulus_pa *= 1.2;
    real.curvature[0].curvature_per_m *= 1.05;
    let (gain, shift, yaw_rad) = (3.0e6, Vector2::new(0.4e-3, -0.2e-3), 0.01_f64);
    let (sin, cos) = yaw_rad.sin_cos();
    let mounted = |p: Vector2<f64>| Vector2::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y) + shift;
    let data: Vec<Sample> = samples(&real, &contacts(&nominal, Face::Left, 0.5))
        .iter()
        .map(|sample| Sample {
            contact: Point::from_vector(mounted(sample.contact.vector())),
            reading_n_m: gain * sample.reading_n_m,
        })
        .collect();
    let traces = [noisy(&data, 1e-3, 3), noisy(&data, 1e-3, 4)];
    let material = FitData {
        whisker: &nominal,
        face: Face::Left,
        measured: &traces,
        reference: &[data.clone(), data],
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    let row = sensor::model("elastica").unwrap();
    let fit = sensor::fit(row, &(row.defaults)(), &material).unwrap();
    assert!(fit.face.heldout_rms_n_m < 2e-3 * fit.face.largest_reading_n_m);

    let stored = fit.face.model.to_json();
    let find = |name: &str| {
        let parameters = stored["parameters"].as_array().unwrap();
        let found = parameters.iter().find(|parameter| parameter["name"] == name).unwrap();
        (found["value"].as_f64().unwrap(), found["sd"].as_f64().unwrap(), found["told"].as_bool().unwrap())
    };
    let ((modulus, _, modulus_informed), (stiffness, _, stiffness_informed)) =
        (find("youngs_modulus_pa"), find("root_stiffness_n_m_rad"));
    let ratio = modulus / stiffness / (real.youngs_modulus_pa / real.root_stiffness_n_m_rad);
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
    assert!(!modulus_informed && !stiffness_informed);
    let scale = find("gain").0 * stiffness / (gain * real.root_stiffness_n_m_rad);
    assert!((scale - 1.0).abs() < 0.01, "{scale}");
    for (name, expected) in [("root_x_m", shift.x), ("root_y_m", shift.y), ("root_yaw_rad", yaw_rad)] {
        let (value, sd, informed) = find(name);
        assert!((value - expected).abs() < 4.0 * sd && informed, "{name}: {value} +- {sd}, expected {expected}");
    }
}
