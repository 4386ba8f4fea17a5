//! The calibration pipeline on made-up recordings of a rig whose truth is known.

use std::fs;
use std::path::{Path, PathBuf};

use files::Watermark;
use platform::Sample;
use platform::calibration::logs::{GatherError, LogReader, Source, gather};
use platform::calibration::published::zero_phase;
use platform::calibration::regression::{REGRESSIONS, regression};
use platform::calibration::{
    Calibration, Detection, Error, Features, HoldOut, LabelledPress, Live, Presses, Settings, cross_validate,
};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

const RATE_HZ: f64 = 888.0;
const NOISE_COUNTS: f64 = 20.0;

fn watermark() -> Watermark {
    Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() }
}

/// Counts per metre of push of a whisker that is touched at this distance.
fn counts_per_m(distance_m: f64) -> f64 {
    6e4 / (distance_m + 5.0 * distance_m * distance_m)
}

/// A recording: at each distance the edge moves 6 mm at 2000 mm/min, rests, and moves back. The stage shakes the whisker before each push. The y
/// axis begins so near to its upper end that it wraps around.
fn record(distances_m: &[f64], seed: u64) -> (Vec<Sample>, Vec<(f64, f64, f64)>) {
    const PUSH_M: f64 = 6e-3;
    const SPEED_M_S: f64 = 2.0 / 60.0;
    const CYCLE_S: f64 = 2.5;
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let spans: Vec<_> =
        distances_m.iter().enumerate().map(|(i, &d)| (CYCLE_S * i as f64, CYCLE_S * (i + 1) as f64, d)).collect();
    let count = (CYCLE_S * distances_m.len() as f64 * RATE_HZ) as usize;
    let sample = |i: usize| {
        let t_s = i as f64 / RATE_HZ;
        let (start_s, _, distance_m) = spans[((t_s / CYCLE_S) as usize).min(spans.len() - 1)];
        let t = t_s - start_s;
        let push_m = (SPEED_M_S * (t - 1.0)).min(SPEED_M_S * (2.0 - t)).clamp(0.0, PUSH_M);
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
    let (samples, spans) = record(distances_m, seed);
    let path = folder.join(format!("{name}.csv"));
    let mut text = String::from("t_s,x_counts,y_counts,z_counts\n");
    for Sample { t_s, counts: [x, y, z] } in &samples {
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

/// Presses of a table: the slope that the rig has at each distance, with scatter.
fn scattered(count: usize, scatter: f64, seed: u64) -> Vec<LabelledPress> {
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let press = |_| {
        let distance_m = 0.045 + 0.1 * generator.random::<f64>();
        let noise: f64 = generator.sample(StandardNormal);
        let slope_counts_per_s = counts_per_m(distance_m) / 30.0 * (1.0 + scatter * noise);
        let features = Features { slope_counts_per_s, peak_counts: None, slope_ratio: None };
        LabelledPress { log: "table".into(), onset_s: None, features, distance_m }
    };
    (0..count).map(press).collect()
}

#[test]
fn val_a_calibrated_rig_tells_presses_that_it_has_not_seen_live() {
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
            // Known as soon as the edge rests, 0.18 s later, and the low-pass has seen it.
            assert!(press.t_s - press.onset_s < 0.3);
            let estimate = estimate.unwrap();
            assert_eq!(Some(estimate), calibration.estimate(&press.features), "what is read is what was fitted");
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
    // Slopes that say nothing: they are the same at each distance, but for noise. Whoever estimates the distance honestly gets no
    // better than its spread.
    let mut generator = Pcg64Mcg::seed_from_u64(7);
    let mut presses = scattered(45, 0.0, 8);
    for press in &mut presses {
        let noise: f64 = generator.sample(StandardNormal);
        press.features.slope_counts_per_s = 1e5 * (1.0 + 0.02 * noise);
    }
    let mean_m = presses.iter().map(|press| press.distance_m).sum::<f64>() / 45.0;
    let spread_m = (presses.iter().map(|press| (press.distance_m - mean_m).powi(2)).sum::<f64>() / 45.0).sqrt();
    let rmse_m = |name| {
        let validation = cross_validate(regression(name).unwrap(), &presses, HoldOut::Press).unwrap();
        validation.scores().rmse_m
    };
    assert!(rmse_m("published") < 0.1 * spread_m, "the answer is in the feature");
    for honest in ["cubic", "logarithmic"] {
        assert!(rmse_m(honest) > 0.9 * spread_m, "{honest}");
    }
    let refused = Calibration::fit(regression("published").unwrap(), presses, None, HoldOut::Press, 0.9, watermark());
    assert_eq!(refused.unwrap_err(), Error::Leaks("published"));
}

#[test]
fn val_the_prediction_interval_contains_new_presses_as_often_as_it_says() {
    for row in REGRESSIONS.iter().filter(|row| ["robust", "monotone", "gaussian-process"].contains(&row.name)) {
        let (mut inside, mut asked) = (0, 0);
        for seed in 0..20 {
            let presses = scattered(40, 0.02, 100 + seed);
            let calibration = Calibration::fit(row, presses, None, HoldOut::Press, 0.9, watermark()).unwrap();
            for press in scattered(50, 0.02, 200 + seed) {
                let Some(estimate) = calibration.estimate(&press.features) else { continue };
                let [low_m, high_m] = estimate.interval_m.unwrap();
                asked += 1;
                inside += u32::from((low_m..=high_m).contains(&press.distance_m));
            }
        }
        let share = f64::from(inside) / f64::from(asked);
        assert!(asked > 950 && (0.86..0.95).contains(&share), "{}: {share} of {asked}", row.name);
    }
}

#[test]
fn robust_mislabelled_presses_are_pointed_out_and_do_not_bend_the_curve() {
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
fn verif_no_distance_beyond_the_calibrated_slopes_and_no_interval_of_few_presses() {
    let presses = scattered(8, 0.0, 3);
    let row = regression("logarithmic").unwrap();
    let calibration = Calibration::fit(row, presses.clone(), None, HoldOut::Press, 0.9, watermark()).unwrap();
    let at = |slope_counts_per_s| {
        calibration.estimate(&Features { slope_counts_per_s, peak_counts: None, slope_ratio: None })
    };
    assert!(at(presses[0].features.slope_counts_per_s).is_some_and(|estimate| estimate.interval_m.is_none()));
    assert!([0.0, 1.0, 1e9, f64::NAN, f64::INFINITY].iter().all(|&slope| at(slope).is_none()));
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
    // As a serial line hands samples on: sixteen at a time.
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
fn robust_recordings_that_do_not_fit_each_other_are_an_error() {
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
}

/// Recordings of real whiskers lie where this variable points, if anywhere: `openwhisker/` and `ratatouille/`.
fn real() -> Option<PathBuf> {
    std::env::var_os("WHISKER_REAL_RECORDINGS").map(PathBuf::from)
}

#[test]
fn val_openwhisker_episodes_leave_one_out() {
    let Some(folder) = real() else { return };
    let table = [source(folder.join("openwhisker/episodes_46_distance_vs_min_grad.csv"))];
    for name in ["robust", "logarithmic"] {
        let row = regression(name).unwrap();
        let gathered = gather(&table, &Settings::default(), row, RATE_HZ).unwrap();
        assert_eq!(gathered.presses.len(), 45);
        let scores = cross_validate(row, &gathered.presses, HoldOut::Press).unwrap().scores();
        assert!(scores.rmse_m <= 1.35e-3 && scores.median_m <= 0.8e-3, "{name}: {scores:?}");
        assert!(!scores.suspicious.is_empty(), "{name}");
    }
}

#[test]
fn val_ratatouille_presses_are_all_found_and_their_slopes_fall_with_the_distance() {
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
    let held_out = |by| cross_validate(row, &gathered.presses, by).unwrap().scores().rmse_m;
    assert!(held_out(HoldOut::Press) < held_out(HoldOut::Log), "what tells files apart is not only the distance");
}

#[test]
fn robust_a_static_grid_is_read_and_has_no_presses() {
    let Some(folder) = real() else { return };
    let reader = LogReader::open(&folder.join("openwhisker/static_grid_labelled.csv")).unwrap();
    assert!(reader.collect::<Result<Vec<_>, _>>().unwrap().len() > 10_000);
}
