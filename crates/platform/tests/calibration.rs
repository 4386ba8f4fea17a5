//! The calibration pipeline on synthetic recordings with known ground truth, and on real ones.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use files::Watermark;
use flate2::Compression;
use flate2::write::GzEncoder;
use platform::Sample;
use platform::calibration::logs::{GatherError, LogReader, Source, gather};
use platform::calibration::published::zero_phase;
use platform::calibration::regression::{Fit, REGRESSIONS, RegressionRow, by_places, regression};
use platform::calibration::{
    Calibration, Detection, Error, Estimate, Features, HoldOut, LabelledPress, Live, Presses, Settings, cross_validate,
    no_progress,
};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

const RATE_HZ: f64 = 888.0;
const NOISE_COUNTS: f64 = 20.0;

fn watermark() -> Watermark {
    Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() }
}

/// Counts per metre of push for a contact at this distance (m).
fn counts_per_m(distance_m: f64) -> f64 {
    6e4 / (distance_m + 5.0 * distance_m * distance_m)
}

/// Synthetic recording: at each distance the edge moves 6 mm at 2000 mm/min, rests, and moves back. The stage shakes
/// the whisker before each push. The counts of the y axis wrap around.
fn record(distances_m: &[f64], seed: u64) -> (Vec<Sample>, Vec<(f64, f64, f64)>) {
    record_pushes(distances_m, seed, 2.0 / 60.0, |_| 6e-3)
}

/// As [`record`], at another speed and with a depth that depends on the number of the push.
fn record_pushes(
    distances_m: &[f64],
    seed: u64,
    speed_m_s: f64,
    depth_m: impl Fn(usize) -> f64,
) -> (Vec<Sample>, Vec<(f64, f64, f64)>) {
    const CYCLE_S: f64 = 2.5;
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let spans: Vec<_> =
        distances_m.iter().enumerate().map(|(i, &d)| (CYCLE_S * i as f64, CYCLE_S * (i + 1) as f64, d)).collect();
    let count = (CYCLE_S * distances_m.len() as f64 * RATE_HZ) as usize;
    let sample = |i: usize| {
        let t_s = i as f64 / RATE_HZ;
        let push = ((t_s / CYCLE_S) as usize).min(spans.len() - 1);
        let (start_s, _, distance_m) = spans[push];
        let t = t_s - start_s;
        let push_m = (speed_m_s * (t - 1.0)).min(speed_m_s * (2.0 - t)).clamp(0.0, depth_m(push));
        let shake = if t > 0.5 { 150.0 * (-(t - 0.5) / 0.02).exp() * (200.0 * (t - 0.5)).sin() } else { 0.0 };
        let moved = counts_per_m(distance_m) * push_m;
        let mut axis = |rest: f64, share: f64| {
            let noise: f64 = generator.sample(StandardNormal);
            (rest + share * (moved + shake) + NOISE_COUNTS * noise).round() as i64 as u16
        };
        Sample { t_s, counts: [axis(25_000.0, -0.2), axis(64_900.0, 1.0), axis(36_000.0, 0.02)] }
    };
    ((0..count).map(sample).collect(), spans)
}

fn write_log(folder: &Path, name: &str, distances_m: &[f64], seed: u64) -> PathBuf {
    write_samples(folder, name, &record(distances_m, seed))
}

fn write_samples(folder: &Path, name: &str, (samples, spans): &(Vec<Sample>, Vec<(f64, f64, f64)>)) -> PathBuf {
    let path = folder.join(format!("{name}.csv"));
    let mut text = String::from("t_s,x_counts,y_counts,z_counts\n");
    for Sample { t_s, counts: [x, y, z] } in samples {
        text.push_str(&format!("{t_s:.6},{x},{y},{z}\n"));
    }
    fs::write(&path, text).unwrap();
    let spans: Vec<_> = spans
        .iter()
        .map(|(start_s, end_s, d)| serde_json::json!({"start_s": start_s, "end_s": end_s, "distance_m": d}))
        .collect();
    let sidecar = serde_json::json!({"format": 1, "kind": "platform_log", "contacts": spans});
    fs::write(path.with_extension("json"), sidecar.to_string()).unwrap();
    path
}

fn positions(count: usize, from_m: f64, to_m: f64) -> Vec<f64> {
    (0..count).map(|i| from_m + (to_m - from_m) * i as f64 / (count - 1) as f64).collect()
}

fn source(path: PathBuf) -> Source {
    Source { path, distance_m: None }
}

/// Presses with slopes of the synthetic rig at random distances, with relative scatter.
fn scattered(count: usize, scatter: f64, seed: u64) -> Vec<LabelledPress> {
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let press = |_| {
        let distance_m = 0.045 + 0.1 * generator.random::<f64>();
        let noise: f64 = generator.sample(StandardNormal);
        let slope_counts_per_s = counts_per_m(distance_m) / 30.0 * (1.0 + scatter * noise);
        let features = Features::of_slope(slope_counts_per_s);
        LabelledPress { log: "table".into(), onset_s: None, features, distance_m }
    };
    (0..count).map(press).collect()
}

#[test]
fn val_a_calibration_estimates_new_presses_live() {
    let folder = tempfile::tempdir().unwrap();
    let fitted = write_log(folder.path(), "fit", &positions(16, 0.045, 0.145), 1);
    let row = regression("robust").unwrap();
    let gathered = gather(&[source(fitted)], &Settings::default(), row, RATE_HZ).unwrap();
    assert_eq!(gathered.presses.len(), 16, "{:?}", gathered.notes);
    let calibration =
        Calibration::fit(row, gathered.presses, gathered.chain, HoldOut::Press, 0.9, watermark()).unwrap();
    assert!(calibration.scores().rmse_m < 1e-3, "{:?}", calibration.scores());
    let file = folder.path().join("calibration.json");
    calibration.write(&file).unwrap();
    let read = Calibration::read(&file).unwrap();

    let (samples, spans) = record(&positions(15, 0.048, 0.142), 2);
    let mut live = Live::new(&read).unwrap().unwrap();
    let mut errors_m = Vec::new();
    for sample in &samples {
        if let Some(Detection::Pressed(press, estimate)) = live.step(sample) {
            let (start_s, _, distance_m) = spans[errors_m.len()];
            // The contact begins a second after its cycle.
            assert!((press.onset_s - start_s - 1.0).abs() < 0.03, "{}", press.onset_s - start_s);
            // Reported when the edge rests, 0.18 s later, and after the delay of the low-pass.
            assert!(press.t_s - press.onset_s < 0.3);
            let estimate = estimate.unwrap();
            assert_eq!(
                Some(estimate),
                calibration.estimate(&press.features),
                "the calibration that was read estimates as the fitted one"
            );
            errors_m.push(estimate.distance_m - distance_m);
        }
    }
    assert_eq!(errors_m.len(), 15);
    let rmse_m = (errors_m.iter().map(|e| e * e).sum::<f64>() / 15.0).sqrt();
    assert!(rmse_m < 1e-3, "{rmse_m}");
    assert_eq!(presses_of(&samples, &read), errors_m.len());
}

fn presses_of(samples: &[Sample], calibration: &Calibration) -> usize {
    Presses::new(calibration.chain().unwrap()).unwrap().of(samples).len()
}

#[test]
fn verif_the_published_feature_leaks_the_truth() {
    // Slopes that are independent of the distance: without the true distance no error can be smaller than the spread of
    // the distances.
    let mut generator = Pcg64Mcg::seed_from_u64(7);
    let mut presses = scattered(45, 0.0, 8);
    for press in &mut presses {
        let noise: f64 = generator.sample(StandardNormal);
        press.features.slope_counts_per_s = 1e5 * (1.0 + 0.02 * noise);
    }
    let mean_m = presses.iter().map(|press| press.distance_m).sum::<f64>() / 45.0;
    let spread_m = (presses.iter().map(|press| (press.distance_m - mean_m).powi(2)).sum::<f64>() / 45.0).sqrt();
    let rmse_m = |name| {
        let validation = cross_validate(regression(name).unwrap(), &presses, HoldOut::Press, &mut no_progress).unwrap();
        validation.scores().rmse_m
    };
    assert!(rmse_m("published") < 0.1 * spread_m, "the feature contains the true distance");
    for name in ["robust", "beam"] {
        assert!(rmse_m(name) > 0.9 * spread_m, "{name}");
    }
    let refused = Calibration::fit(regression("published").unwrap(), presses, None, HoldOut::Press, 0.9, watermark());
    assert_eq!(refused.unwrap_err(), Error::Leaks("published"));
}

#[test]
fn val_the_prediction_interval_has_its_nominal_coverage() {
    for row in live_regressions().filter(|row| ["robust", "several"].contains(&row.name)) {
        let (mut inside, mut count) = (0, 0);
        for seed in 0..20 {
            let presses = with_all_features(40, 100 + seed);
            let calibration = Calibration::fit(row, presses, None, HoldOut::Press, 0.9, watermark()).unwrap();
            for press in with_all_features(50, 200 + seed) {
                let Some(estimate) = calibration.estimate(&press.features) else { continue };
                let [low_m, high_m] = estimate.interval_m.unwrap();
                count += 1;
                inside += u32::from((low_m..=high_m).contains(&press.distance_m));
            }
        }
        let coverage = f64::from(inside) / f64::from(count);
        assert!(count > 950 && (0.86..0.95).contains(&coverage), "{}: {coverage} of {count}", row.name);
    }
}

/// Presses at new places vary as the labelled ones do: the speed of the push differs by 2 % from place to place and by
/// 0.5 % from press to press.
#[test]
fn val_the_interval_of_held_out_places_covers_new_places() {
    let row = regression("robust").unwrap();
    for places in [8, 16] {
        let (mut inside, mut count) = (0, 0);
        for seed in 0..60 {
            let mut generator = Pcg64Mcg::seed_from_u64(1000 * places as u64 + seed);
            let mut normal = || -> f64 { generator.sample(StandardNormal) };
            let mut at_place = |distance_m: f64, presses: usize| -> Vec<LabelledPress> {
                let speed = 1.0 + 0.02 * normal();
                let press = |_| {
                    let slope = counts_per_m(distance_m) / 30.0 * speed * (1.0 + 0.005 * normal());
                    LabelledPress {
                        log: "table".into(),
                        onset_s: None,
                        features: Features::of_slope(slope),
                        distance_m,
                    }
                };
                (0..presses).map(press).collect()
            };
            let labelled = positions(places, 0.045, 0.145).into_iter().flat_map(|d| at_place(d, 3)).collect();
            let calibration = Calibration::fit(row, labelled, None, HoldOut::Place, 0.9, watermark()).unwrap();
            for distance_m in positions(11, 0.0531, 0.1369) {
                for press in at_place(distance_m, 1) {
                    let Some(estimate) = calibration.estimate(&press.features) else { continue };
                    let [low_m, high_m] = estimate.interval_m.unwrap();
                    count += 1;
                    inside += u32::from((low_m..=high_m).contains(&distance_m));
                }
            }
        }
        let coverage = f64::from(inside) / f64::from(count);
        assert!(count > 600 && (0.88..0.97).contains(&coverage), "{places} places: {coverage} of {count}");
    }
}

#[test]
fn val_pushes_of_different_depth_are_estimated_by_the_slope_before_the_low_pass() {
    let folder = tempfile::tempdir().unwrap();
    // 25 and 45 ms: short for a low-pass of 10 Hz.
    let recorded = record_pushes(&positions(16, 0.045, 0.145), 9, 0.2, |push| if push % 3 == 0 { 9e-3 } else { 5e-3 });
    let log = write_samples(folder.path(), "short", &recorded);
    let row = regression("robust").unwrap();
    let gathered = gather(&[source(log)], &Settings::default(), row, RATE_HZ).unwrap();
    assert_eq!(gathered.presses.len(), 16, "{:?}", gathered.notes);
    let errors: Vec<f64> = gathered
        .presses
        .iter()
        .map(|press| press.features.ramp_counts_per_s.unwrap() / (0.2 * counts_per_m(press.distance_m)) - 1.0)
        .collect();
    // The noise of peak and slope is amplified.
    let rms = (errors.iter().map(|error| error * error).sum::<f64>() / 16.0).sqrt();
    assert!(rms < 0.04, "{errors:?}");
    let candidates = by_places(&gathered.presses, &mut no_progress);
    let rmse_m = |name: &str| {
        let candidate = candidates.iter().find(|candidate| candidate.row.name == name).unwrap();
        *candidate.rmse_m.as_ref().unwrap()
    };
    assert!(candidates[0].row.name.ends_with("-ramp"), "{}", candidates[0].row.name);
    for name in ["robust", "beam"] {
        assert!(rmse_m(&format!("{name}-ramp")) < 0.3 * rmse_m(name), "{name}: {}", rmse_m(name));
    }
}

#[test]
fn robust_labelled_presses_at_one_place_or_with_two_labels_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let log = write_log(folder.path(), "log", &positions(6, 0.05, 0.14), 1);
    let row = regression("robust").unwrap();
    let labelled = |path: &Path| Source { path: path.into(), distance_m: Some(0.065) };
    let error = gather(&[labelled(&log)], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
    assert!(error.contains("log.csv: label: found 65.0 mm, and 50.0 to 140.0 mm in "), "{error}");
    let table = folder.path().join("table.csv");
    fs::write(&table, "distance_mm,slope_counts_per_s\n50,9e4\n60,8e4\n").unwrap();
    let error = gather(&[labelled(&table)], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
    assert!(error.contains("table.csv: label: found 65.0 mm for the whole table"), "{error}");

    // Without a sidecar, the label is the only one, and all presses are at one place.
    fs::remove_file(log.with_extension("json")).unwrap();
    let gathered = gather(&[labelled(&log)], &Settings::default(), row, RATE_HZ).unwrap();
    let fitted = Calibration::fit(row, gathered.presses, gathered.chain, HoldOut::Press, 0.9, watermark());
    assert_eq!(fitted.unwrap_err(), Error::OnePlace { regression: "robust", distance_m: 0.065 });
}

#[test]
fn verif_the_domain_is_that_of_the_features_of_the_regression() {
    let presses = with_all_features(40, 5);
    let inside = presses[0].features;
    let far = Some(1e3 * inside.slope_counts_per_s);
    let changed = |change: fn(&mut Features, Option<f64>)| {
        let mut features = inside;
        change(&mut features, far);
        features
    };
    let slope = changed(|features, far| features.slope_counts_per_s = far.unwrap());
    let ramp = changed(|features, far| features.ramp_counts_per_s = far);
    let peak = changed(|features, far| features.peak_counts = far);
    let ratio = changed(|features, far| features.slope_ratio = far);
    for (name, used, unused) in [
        ("robust", vec![slope], vec![ramp, peak, ratio]),
        ("robust-ramp", vec![ramp], vec![slope, peak, ratio]),
        ("beam-ramp", vec![ramp], vec![slope, peak, ratio]),
        ("several", vec![slope, peak, ratio], vec![ramp]),
    ] {
        let row = regression(name).unwrap();
        let calibration = Calibration::fit(row, presses.clone(), None, HoldOut::Press, 0.9, watermark()).unwrap();
        assert!(used.iter().all(|features| calibration.estimate(features).is_none()), "{name}");
        assert!(unused.iter().all(|features| calibration.estimate(features).is_some()), "{name}");
    }
}

#[test]
fn robust_a_log_given_twice_and_an_incomplete_compressed_log_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let log = write_log(folder.path(), "log", &positions(4, 0.05, 0.14), 1);
    let copy = folder.path().join("copy.csv");
    fs::copy(&log, &copy).unwrap();
    fs::copy(log.with_extension("json"), copy.with_extension("json")).unwrap();
    let table = folder.path().join("table.csv");
    fs::write(&table, "distance_mm,slope_counts_per_s\n50,9e4\n60,8e4\n").unwrap();
    let row = regression("robust").unwrap();
    let refused = |paths: &[&PathBuf]| {
        let sources: Vec<_> = paths.iter().map(|path| source(path.to_path_buf())).collect();
        gather(&sources, &Settings::default(), row, RATE_HZ).unwrap_err().to_string()
    };
    for paths in [[&log, &log], [&log, &copy], [&table, &table]] {
        let error = refused(&paths);
        let expected = format!("log: found the same content as {}, expected each log once", paths[0].display());
        assert!(error.starts_with(&format!("{}: {expected}", paths[1].display())), "{error}");
    }

    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&fs::read(&log).unwrap()).unwrap();
    let bytes = encoder.finish().unwrap();
    let cut = folder.path().join("log.csv.gz");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let error = refused(&[&cut]);
    assert!(error.contains("row: found the end of an incomplete gzip file, expected a complete one"), "{error}");
}

#[test]
fn robust_distances_in_millimetres_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let row = regression("robust").unwrap();
    let refused = |source: Source, words: &str| {
        let error = gather(&[source], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    let log = write_log(folder.path(), "log", &positions(4, 0.05, 145.0), 1);
    refused(source(log.clone()), "log.json: contacts.1.distance_m: found 48.3");
    refused(source(log.clone()), ", expected at most 1 m; compare the unit");
    fs::remove_file(log.with_extension("json")).unwrap();
    let labelled = Source { path: log, distance_m: Some(145.0) };
    refused(labelled, "log.csv: label: found 145 m, expected at most 1 m; compare the unit");
    let table = folder.path().join("table.csv");
    fs::write(&table, "distance_m,slope_counts_per_s\n0.05,9e4\n145,8e4\n").unwrap();
    refused(source(table), "table.csv:3: column distance_m: found `145`, expected at most 1 m; compare the unit");
    let manifest = folder.path().join("manifest.json");
    for (distance_m, expected) in [("145", "at most 1 m; compare the unit"), ("0", "a distance above zero")] {
        let logs = format!(r#"{{"file": "log.csv", "distance_m": {distance_m}}}"#);
        fs::write(&manifest, format!(r#"{{"format": 1, "kind": "platform_logs", "logs": [{logs}]}}"#)).unwrap();
        let error = Source::of_manifest(&manifest).unwrap_err().to_string();
        assert!(error.ends_with(&format!("logs.0.distance_m: found {distance_m}, expected {expected}")), "{error}");
    }
}

#[test]
fn robust_tables_with_a_byte_order_mark_or_an_incomplete_last_line() {
    let folder = tempfile::tempdir().unwrap();
    let row = regression("robust").unwrap();
    let table = folder.path().join("table.csv");
    for (text, presses, notes) in [
        ("\u{feff}distance_mm,slope_counts_per_s\r\n50,9e4\r\n60,8e4\r\n", 2, 0),
        ("distance_mm,slope_counts_per_s\n50,9e4\n60,8", 1, 1),
        ("distance_mm,slope_counts_per_s\n50,9e4\n6", 1, 1),
    ] {
        fs::write(&table, text).unwrap();
        let gathered = gather(&[source(table.clone())], &Settings::default(), row, RATE_HZ).unwrap();
        assert_eq!((gathered.presses.len(), gathered.notes.len()), (presses, notes), "{text}: {:?}", gathered.notes);
        let is_stated = |note: &String| note.ends_with("table.csv: skipped the incomplete last line");
        assert!(gathered.notes.iter().all(is_stated), "{:?}", gathered.notes);
    }
}

#[test]
fn robust_a_log_without_distances_and_a_low_pass_that_is_too_fast_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let row = regression("robust").unwrap();
    let log = write_log(folder.path(), "log", &positions(4, 0.05, 0.14), 1);
    let refused = |settings: Settings| gather(&[source(log.clone())], &settings, row, RATE_HZ).unwrap_err().to_string();
    let error = refused(Settings { cutoff_hz: 500.0, ..Settings::default() });
    assert!(error.starts_with("--cutoff-hz: found 500, expected below 444.0, half the sampling rate of "), "{error}");
    for cutoff_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused(Settings { cutoff_hz, ..Settings::default() });
        assert!(error.starts_with("--cutoff-hz: found ") && error.ends_with("expected a frequency above 0"), "{error}");
    }
    fs::remove_file(log.with_extension("json")).unwrap();
    let error = refused(Settings::default());
    let words = "log.csv: label: found no sidecar with the distances, expected ";
    assert!(error.contains(words) && error.ends_with("log.json; write it, or give `--label MM=FILE`"), "{error}");
}

#[test]
fn robust_times_in_milliseconds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (mut samples, spans) = record(&positions(4, 0.05, 0.14), 1);
    samples.iter_mut().for_each(|sample| sample.t_s *= 1e3);
    let log = write_samples(folder.path(), "milliseconds", &(samples, spans));
    let row = regression("robust").unwrap();
    let error = gather(&[source(log)], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
    assert!(
        error.contains("milliseconds.csv: found a sample every 1.12") && error.contains("look like milliseconds"),
        "{error}"
    );
}

#[test]
fn robust_equal_times_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (mut samples, spans) = record(&positions(4, 0.05, 0.14), 1);
    samples.iter_mut().for_each(|sample| sample.t_s = 1.0);
    let log = write_samples(folder.path(), "equal", &(samples, spans));
    let row = regression("robust").unwrap();
    let error = gather(&[source(log)], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
    assert!(error.ends_with("equal.csv: found all times equal, expected increasing times"), "{error}");
}

#[test]
fn robust_mislabelled_presses_are_suspicious_and_have_no_weight() {
    let mut presses = scattered(45, 0.005, 3);
    for i in [5, 20, 33] {
        presses[i].distance_m += if i == 20 { -0.012 } else { 0.0067 };
    }
    let row = regression("robust").unwrap();
    let calibration = Calibration::fit(row, presses, None, HoldOut::Press, 0.9, watermark()).unwrap();
    assert_eq!(calibration.scores().suspicious, [6, 21, 34]);
    for press in scattered(50, 0.0, 4) {
        if let Some(estimate) = calibration.estimate(&press.features) {
            assert!((estimate.distance_m - press.distance_m).abs() < 1e-3);
        }
    }
}

#[test]
fn verif_no_estimate_outside_the_calibrated_domain_and_no_interval_of_few_presses() {
    let presses = scattered(8, 0.0, 3);
    let row = regression("robust").unwrap();
    let calibration = Calibration::fit(row, presses.clone(), None, HoldOut::Press, 0.9, watermark()).unwrap();
    let at = |slope_counts_per_s| calibration.estimate(&Features::of_slope(slope_counts_per_s));
    assert!(at(presses[0].features.slope_counts_per_s).is_some_and(|estimate| estimate.interval_m.is_none()));
    assert!([0.0, 1.0, 1e9, f64::NAN, f64::INFINITY].iter().all(|&slope| at(slope).is_none()));
}

/// Presses of [`scattered`] with all features: peaks and slope ratios vary.
fn with_all_features(count: usize, seed: u64) -> Vec<LabelledPress> {
    let mut presses = scattered(count, 0.02, seed);
    for (i, press) in presses.iter_mut().enumerate() {
        press.log = format!("log {}", i % 4);
        let Features { slope_counts_per_s, peak_counts, slope_ratio, ramp_counts_per_s } = &mut press.features;
        *peak_counts = Some(0.02 * *slope_counts_per_s * (1.0 + 0.3 * (7.0 * i as f64).sin()));
        *slope_ratio = Some(0.1 + 0.02 * (3.0 * i as f64).cos());
        *ramp_counts_per_s = Some(1.1 * *slope_counts_per_s);
    }
    presses
}

/// Every regression that works at run time.
fn live_regressions() -> impl Iterator<Item = &'static RegressionRow> {
    REGRESSIONS.iter().filter(|row| matches!(row.fit, Fit::Live(_)))
}

fn fitted(row: &RegressionRow, hold_out: HoldOut) -> Calibration {
    Calibration::fit(row, with_all_features(24, 11), None, hold_out, 0.9, watermark()).unwrap()
}

/// The written file as JSON, after a change.
fn changed(calibration: &Calibration, file: &Path, change: impl FnOnce(&mut serde_json::Value)) {
    calibration.write(file).unwrap();
    let mut json = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    change(&mut json);
    fs::write(file, json.to_string()).unwrap();
}

#[test]
fn verif_a_calibration_read_from_its_file_gives_the_same_bits_as_the_fitted_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("calibration.json");
    let bits = |estimate: Option<Estimate>| {
        estimate.map(|estimate| (estimate.distance_m.to_bits(), estimate.interval_m.map(|ends| ends.map(f64::to_bits))))
    };
    for row in live_regressions() {
        for hold_out in [HoldOut::Press, HoldOut::Log] {
            let fitted = fitted(row, hold_out);
            fitted.write(&file).unwrap();
            let stored = Calibration::read(&file).unwrap();
            changed(&fitted, &file, |json| drop(json.as_object_mut().unwrap().remove("coefficients")));
            let fitted_again = Calibration::read(&file).unwrap();
            assert_eq!([&stored, &fitted_again].map(Calibration::was_fitted_on_reading), [false, true], "{}", row.name);
            let mut estimated = 0;
            for press in with_all_features(200, 12) {
                let expected = bits(fitted.estimate(&press.features));
                estimated += u32::from(expected.is_some_and(|(_, interval)| interval.is_some()));
                for read in [&stored, &fitted_again] {
                    assert_eq!(bits(read.estimate(&press.features)), expected, "{}: {press:?}", row.name);
                }
            }
            assert!(estimated > 150, "{}: {estimated}", row.name);
            assert_eq!(stored.scores(), fitted.scores());
        }
    }
}

#[test]
fn robust_wrong_coefficients_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("calibration.json");
    for row in live_regressions() {
        let fitted = fitted(row, HoldOut::Press);
        let refused = |change: &dyn Fn(&mut serde_json::Value), words: &str| {
            changed(&fitted, &file, |json| change(&mut json["coefficients"]));
            let message = Calibration::read(&file).unwrap_err().to_string();
            assert!(message.contains("calibration.json: ") && message.contains(words), "{}: {message}", row.name);
        };
        refused(&|json| json["names"][0] = "unknown".into(), "coefficients.names: found unknown, ");
        refused(&|json| drop(json["all"].as_array_mut().unwrap().pop()), "coefficients.all: found ");
        refused(&|json| drop(json["held_out"].as_array_mut().unwrap().pop()), "coefficients.held_out: found 23 rows");
        refused(&|json| json["held_out"][3] = serde_json::json!([]), "coefficients.held_out.3: found 0 numbers");
        refused(&|json| json["all"][1] = serde_json::json!(-1.0), "coefficients.all.1 (");
        // Coefficients of other presses.
        let other_m = |json: &mut serde_json::Value| json["held_out"][3] = json["held_out"][4].clone();
        refused(&other_m, "scores.");
        changed(&fitted, &file, |json| json["presses"][5]["distance_m"] = serde_json::json!(0.3));
        let message = Calibration::read(&file).unwrap_err().to_string();
        assert!(message.contains("remove the key `coefficients` to fit again"), "{message}");
        let text = fs::read_to_string(&file).unwrap().replacen("\"all\":[", "\"all\":[1e999,", 1);
        fs::write(&file, text).unwrap();
        assert!(Calibration::read(&file).unwrap_err().to_string().contains("calibration.json:"));
    }
}

#[test]
fn regress_a_chain_with_an_implausible_rate_or_edge_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (file, row) = (folder.path().join("calibration.json"), regression("robust").unwrap());
    let log = write_log(folder.path(), "log", &positions(20, 0.05, 0.14), 1);
    let gathered = gather(&[source(log)], &Settings::default(), row, RATE_HZ).unwrap();
    let fitted = Calibration::fit(row, gathered.presses, gathered.chain, HoldOut::Press, 0.9, watermark()).unwrap();
    let rate_hz = fitted.chain().unwrap().rate_hz;
    for (key, value, words) in [
        ("rate_hz", 1e3 * rate_hz, "expected a number above zero, at most 10000"),
        ("rate_hz", -1.0, "expected a number above zero"),
        ("cutoff_hz", 1e-3, "expected at least 0.4"),
        ("cutoff_hz", 0.6 * rate_hz, "and below half of rate_hz"),
    ] {
        changed(&fitted, &file, |json| json["chain"][key] = serde_json::json!(value));
        let message = Calibration::read(&file).unwrap_err().to_string();
        let found = format!("calibration.json: chain.{key}: found {value}, ");
        assert!(message.contains(&found) && message.contains(words), "{message}");
    }
    changed(&fitted, &file, |json| json["chain"]["cutoff_hz"] = serde_json::json!(0.5));
    let least = Calibration::read(&file).unwrap();
    assert!(Presses::new(least.chain().unwrap()).is_ok());
}

#[test]
fn regress_logs_with_an_implausible_rate_or_edge_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let row = regression("robust").unwrap();
    let (mut samples, spans) = record(&positions(4, 0.05, 0.14), 1);
    let slow = write_samples(folder.path(), "log", &(samples.clone(), spans.clone()));
    let settings = Settings { cutoff_hz: 1e-3, ..Settings::default() };
    let error = gather(&[source(slow)], &settings, row, RATE_HZ).unwrap_err().to_string();
    assert!(
        error.starts_with("--cutoff-hz: found 0.001, expected at least 0.444, 1/2000 of the sampling rate"),
        "{error}"
    );
    samples.iter_mut().for_each(|sample| sample.t_s *= 1e-3);
    let fast = write_samples(folder.path(), "fast", &(samples, spans));
    let error = gather(&[source(fast)], &Settings::default(), row, RATE_HZ).unwrap_err().to_string();
    assert!(
        error.contains("fast.csv: found 887989") && error.contains("samples a second, expected at most 10000"),
        "{error}"
    );
}

#[test]
fn robust_features_without_a_logarithm_are_refused_by_the_regressions_that_use_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("calibration.json");
    for row in live_regressions() {
        let fitted = fitted(row, HoldOut::Press);
        for (key, users) in [
            ("slope_counts_per_s", &["robust", "several", "beam", "robust-ramp", "beam-ramp"][..]),
            ("peak_counts", &["several"]),
            ("ramp_counts_per_s", &["robust-ramp", "beam-ramp"]),
        ] {
            let read = |value: f64, is_fitted: bool| {
                changed(&fitted, &file, |json| {
                    json["presses"][5]["features"][key] = value.into();
                    if !is_fitted {
                        json.as_object_mut().unwrap().remove("coefficients");
                    }
                });
                Calibration::read(&file).map_err(|error| error.to_string())
            };
            if !users.contains(&row.name) {
                assert!(read(-1.0, true).is_ok(), "{}: {key}", row.name);
                continue;
            }
            for (value, is_fitted) in [(-1.0, true), (0.0, true), (-1.0, false), (0.0, false)] {
                let message = read(value, is_fitted).unwrap_err();
                let expected = format!("presses.5.features.{key}: found {value}, expected a number above zero");
                assert!(message.ends_with(&expected), "{}: {message}", row.name);
            }
        }
    }
    // The fit to such presses ends with an error too.
    for (name, peak_counts, ramp_counts_per_s) in
        [("several", -1.0, 1.0), ("several", 0.0, 1.0), ("robust-ramp", 1.0, -1.0)]
    {
        let mut presses = with_all_features(24, 11);
        presses[5].features.peak_counts = Some(peak_counts);
        presses[5].features.ramp_counts_per_s = Some(ramp_counts_per_s);
        let refused = Calibration::fit(regression(name).unwrap(), presses, None, HoldOut::Press, 0.9, watermark());
        assert!(matches!(refused, Err(Error::Undetermined(found)) if found == name), "{name}");
    }
}

#[test]
fn robust_an_unknown_regression_is_reported_with_the_registered_ones() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("calibration.json");
    let fitted = fitted(regression("robust").unwrap(), HoldOut::Press);
    for name in ["cubic", "gaussian-process", "published"] {
        changed(&fitted, &file, |json| json["regression"] = name.into());
        let message = Calibration::read(&file).unwrap_err().to_string();
        let expected = format!(
            "regression: found {name}, expected robust, several, beam, robust-ramp, beam-ramp: fit again with one of these"
        );
        assert!(message.ends_with(&expected), "{message}");
    }
}

#[test]
fn val_zero_phase_against_scipy() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/butterworth_low_pass.csv");
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> = lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    let input: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    for (design, order, edge_hz, rate_hz) in [
        ("published", 2, 5.0, 888.0),
        ("published_live", 2, 2.0, 888.0),
        ("odd", 3, 30.0, 800.0),
        ("high_order", 6, 40.0, 800.0),
    ] {
        let column = header.iter().position(|name| *name == format!("{design}_zero_phase")).unwrap();
        let found = zero_phase(&input, order, edge_hz, rate_hz).unwrap();
        for (row, found) in rows.iter().zip(&found) {
            assert!((row[column] - found).abs() < 1e-9, "{design}: {found} {}", row[column]);
        }
    }
}

#[test]
fn verif_a_short_gap_is_jitter_and_a_long_one_ends_a_press() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_log(folder.path(), "fit", &positions(16, 0.045, 0.145), 5);
    let row = regression("robust").unwrap();
    let chain = gather(&[source(path)], &Settings::default(), row, RATE_HZ).unwrap().chain.unwrap();
    let (mut samples, _) = record(&positions(4, 0.05, 0.14), 6);
    let count = |samples: &[Sample]| Presses::new(&chain).unwrap().of(samples).len();
    assert_eq!(count(&samples), 4);
    // A serial line delivers sixteen samples at a time.
    for chunk in samples.chunks_mut(16) {
        let last_s = chunk[chunk.len() - 1].t_s;
        chunk.iter_mut().for_each(|sample| sample.t_s = last_s);
    }
    assert_eq!(count(&samples), 4);
    // The second press is missing from its rise to well after its release.
    samples.retain(|sample| !(3.4..4.6).contains(&sample.t_s));
    assert_eq!(count(&samples), 3);
}

#[test]
fn robust_incompatible_recordings_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let good = write_log(folder.path(), "good", &positions(4, 0.05, 0.14), 1);
    let short = folder.path().join("short.csv");
    fs::write(&short, "t_s,x_counts,y_counts,z_counts\n0,1,2,3\n").unwrap();
    fs::copy(good.with_extension("json"), short.with_extension("json")).unwrap();
    let row = regression("robust").unwrap();
    let error = gather(&[source(good), source(short)], &Settings::default(), row, RATE_HZ).unwrap_err();
    assert!(
        matches!(&error, GatherError::Recordings(Error::Short { log, found: 1, .. }) if log.ends_with("short.csv"))
    );
    assert!(error.to_string().contains("short.csv: samples: found 1, expected at least"), "{error}");
}

/// Folder with real recordings (`openwhisker/`, `ratatouille/`), if the variable is set.
fn real() -> Option<PathBuf> {
    std::env::var_os("WHISKER_REAL_RECORDINGS").map(PathBuf::from)
}

#[test]
fn val_openwhisker_episodes_leave_one_out() {
    let Some(folder) = real() else { return };
    let table = [source(folder.join("openwhisker/episodes_46_distance_vs_min_grad.csv"))];
    let row = regression("robust").unwrap();
    let gathered = gather(&table, &Settings::default(), row, RATE_HZ).unwrap();
    assert_eq!(gathered.presses.len(), 45);
    let scores = cross_validate(row, &gathered.presses, HoldOut::Press, &mut no_progress).unwrap().scores();
    assert!(scores.rmse_m <= 1.35e-3 && scores.median_m <= 0.8e-3, "{scores:?}");
    assert!(!scores.suspicious.is_empty());
}

#[test]
fn val_ratatouille_presses_are_all_detected_and_their_slopes_decrease_with_the_distance() {
    let Some(folder) = real() else { return };
    let log = |mm: u32| Source {
        path: folder.join(format!("ratatouille/deflection_{mm}.csv.gz")),
        distance_m: Some(1e-3 * f64::from(mm)),
    };
    let row = regression("several").unwrap();
    let logs = [65, 85, 105, 125, 145, 165].map(log);
    let gathered = gather(&logs, &Settings::default(), row, RATE_HZ).unwrap();
    let mut last = f64::INFINITY;
    for log in &logs {
        let of_log = gathered.presses.iter().filter(|press| Some(press.distance_m) == log.distance_m);
        let mut slopes: Vec<f64> = of_log.map(|press| press.features.slope_counts_per_s).collect();
        slopes.sort_by(f64::total_cmp);
        assert!((21..=31).contains(&slopes.len()), "{}: {}", log.path.display(), slopes.len());
        let median = slopes[slopes.len() / 2];
        assert!(median < last, "{}: {median}", log.path.display());
        last = median;
    }
    let held_out = |by| cross_validate(row, &gathered.presses, by, &mut no_progress).unwrap().scores().rmse_m;
    assert!(held_out(HoldOut::Press) < held_out(HoldOut::Log), "files differ in more than the distance");
}

#[test]
fn robust_a_static_grid_is_read_and_has_no_presses() {
    let Some(folder) = real() else { return };
    let reader = LogReader::open(&folder.join("openwhisker/static_grid_labelled.csv")).unwrap();
    assert!(reader.collect::<Result<Vec<_>, _>>().unwrap().len() > 10_000);
}
