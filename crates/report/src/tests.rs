//! The report of a small run that is built in memory.

use std::fs;
use std::path::Path;

use indicatif::ProgressBar;
use serde::Serialize;
use serde_json::json;
use testbed::map::MapConfig;
use testbed::metrics::Scores;
use testbed::results::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, GridRow,
    MapPointRow, MapRow, MapVertexRow, ResidualRow, RunSet, SummaryHead, SummaryRow, SurfaceRow, TransferRow,
    TrialHead, TrialRow, TurnRow, VertexRow, csv_bytes, score_bytes,
};
use whisker::events::{DETECTORS, TouchConfig};

use super::run_data::RunData;
use super::{FIGURES, ReportPaths, take_animations};

const ESTIMATORS: [&str; 3] = ["ekf", "euler-bernoulli", "paper-ekf"];

fn write_table<T: Serialize>(path: &Path, rows: &[T]) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("created");
    let mut writer = csv::Writer::from_path(path).expect("opened");
    for row in rows {
        writer.serialize(row).expect("written");
    }
    writer.flush().expect("written");
}

/// Writes a run with one trial on a pin and, if `whole`, one on a circle, its estimates and a sensor model.
fn write_run(folder: &Path, whole: bool) {
    write_run_of(folder, whole, &ESTIMATORS);
}

/// As [`write_run`], with the estimators of these names. The first has a smaller error than the others.
fn write_run_of(folder: &Path, whole: bool, estimators: &[&str]) {
    let objects: &[&str] = if whole { &["pin", "circle"] } else { &["pin"] };
    write_description(folder, whole, objects, estimators);
    let (mut trials, mut summary, mut bands, mut consistency) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for object in objects {
        for (index, estimator) in estimators.iter().enumerate() {
            let error_m = if index == 0 { 2e-4 } else { 5e-3 };
            trials.push(trial(object, estimator, error_m));
            summary.push(summary_row(object, estimator, error_m));
            bands.extend((0..50).map(|step| band_row(object, estimator, f64::from(step) * 0.1, error_m)));
            consistency.extend((0..50).map(|step| consistency_row(object, estimator, f64::from(step) * 0.1, error_m)));
            if whole {
                let rows: Vec<_> = (0..1000).map(|step| estimate(step, error_m)).collect();
                write_table(&folder.join(format!("estimates/{object}_straight.{estimator}.csv")), &rows);
            }
        }
        if whole {
            let bounds: Vec<_> = (100..1000).map(bound).collect();
            write_table(&folder.join(format!("bounds/{object}_straight.csv")), &bounds);
            let events: Vec<_> = (0..1000).map(event).collect();
            for detector in DETECTORS {
                write_table(&folder.join(format!("events/{object}_straight.{}.csv", detector.name)), &events);
            }
        }
        fs::create_dir_all(folder.join("outlines")).expect("created");
        let outline = "x_m,y_m\n0.05,0\n0.06,0.01\n0.05,0.02\n0.04,0.01\n0.05,0\n";
        fs::write(folder.join(format!("outlines/{object}_straight.csv")), outline).expect("written");
    }
    fs::write(folder.join("trials.csv"), score_bytes(&trials).expect("scores")).expect("written");
    fs::write(folder.join("summary.csv"), score_bytes(&summary).expect("scores")).expect("written");
    write_table(&folder.join("error_over_time.csv"), &bands);
    write_table(&folder.join("consistency.csv"), &consistency);
    let contours: &[(&str, &str, Option<f64>)] =
        if whole { &[("circle", "circle", Some(1e-4)), ("real objects", "drum", None)] } else { &[] };
    write_contours(folder, contours);
    if whole {
        write_model(folder);
        write_sensor(folder);
        write_maps(folder);
    }
}

fn class_of(estimator: &str) -> &'static str {
    match estimator {
        name if name.starts_with("paper") => "published",
        name if name.starts_with("euler") => "baseline",
        name if name.starts_with("batch") => "hindsight",
        _ => "recursive",
    }
}

fn write_description(folder: &Path, whole: bool, objects: &[&str], estimators: &[&str]) {
    let names = |object: &&str| {
        json!({
            "group": object, "whisker": "straight", "object": object,
            "traces": [format!("{object}_straight")], "largest_reading_n_m": 1e-4,
        })
    };
    let estimator = |name: &&str| {
        json!({
            "name": name, "about": "one line", "kind": class_of(name), "sensor_model": null, "config": {"fading": 1.004},
        })
    };
    let calibration = json!({
        "whisker": "straight", "face": "left", "model": "polynomial <5>", "sha256": "cd",
        "heldout_rms_n_m": 1e-7, "heldout_worst_n_m": 5e-7, "largest_reading_n_m": 1e-4,
    });
    let sensor = json!({
        "name": "straight", "array": "left", "common_mode": [0.0, 1.0], "cross_talk": [], "noise_sd_n_m": 1e-7, "offset_sd_n_m": 1e-8, "gain_sd": 1e-3,
        "characteristic": {"coefficients": [2e7], "range_n_m": [-5e-5, 0.0]},
    });
    let run = json!({
        "format": 1, "kind": "run", "name": "small",
        "watermark": {"tool": "whisker", "version": "0.1.0", "git_commit": null, "inputs_sha256": "ab"},
        "noise": [0.01], "seeds": [1],
        "front_end": {"name": "hall", "config": {}, "sensors": if whole { vec![sensor] } else { Vec::new() }},
        "touch": TouchConfig::default(),
        "estimators": estimators.iter().map(estimator).collect::<Vec<_>>(),
        "sets": objects.iter().chain(whole.then_some(&"drum")).map(names).collect::<Vec<_>>(),
        "calibrations": if whole { vec![calibration] } else { Vec::new() },
        "whiskers": [{
            "name": "straight", "length_m": 0.08, "root_diameter_m": 0.25e-3, "tip_diameter_m": 0.25e-3, "youngs_modulus_pa": 60e9,
            "density_kg_m3": 6450.0, "curvature": [{"length_m": 0.08, "curvature_per_m": 0.0}],
            "root_stiffness_n_m_rad": 0.17e-3, "segments": 40, "damping_s": 0.0,
        }],
        "recordings": if whole { LEVELS.map(recording).to_vec() } else { Vec::new() },
    });
    fs::write(folder.join("run.json"), run.to_string()).expect("written");
}

fn band_row(object: &str, estimator: &str, t_contact_s: f64, error_m: f64) -> ErrorBandRow {
    ErrorBandRow {
        group: object.to_owned(),
        whisker: "straight".to_owned(),
        estimator: estimator.to_owned(),
        noise: 0.01,
        t_contact_s,
        trials: 1,
        p10_m: 0.5 * error_m,
        median_m: error_m,
        p90_m: 2.0 * error_m,
    }
}

fn consistency_row(object: &str, estimator: &str, start_s: f64, error_m: f64) -> ConsistencyRow {
    ConsistencyRow {
        group: object.to_owned(),
        whisker: "straight".to_owned(),
        estimator: estimator.to_owned(),
        noise: 0.01,
        t_contact_s: start_s + 0.05,
        trials: 1,
        rmse_m: error_m,
        bound_m: Some(1e-4),
        anees: Some(2.0),
        anees_low: Some(0.05),
        anees_high: Some(7.4),
        anis: Some(1.0),
        anis_low: Some(0.001),
        anis_high: Some(5.0),
        condition: Some(100.0),
    }
}

/// Recording of one whisker and one object at each level of encoder noise: its name, and the noise (rad).
const LEVELS: [(&str, f64); 3] = [("scene", 0.0), ("scene_noise_1e-4", 1e-4), ("scene_noise_1e-3", 1e-3)];

fn recording((name, noise_rad): (&str, f64)) -> serde_json::Value {
    json!({
        "name": name, "group": "circle", "encoders": {"resolution_rad": 0.0, "noise_rad": noise_rad},
        "map": MapConfig::default(), "objects": ["disc"],
        "whiskers": [{"name": "left_1", "array": "left", "trace": "circle_straight"}],
    })
}

/// Writes the maps of the first estimator.
fn write_maps(folder: &Path) {
    let map = |(name, noise_rad): (&str, f64)| MapRow {
        recording: name.to_owned(),
        group: "circle".to_owned(),
        estimator: ESTIMATORS[0].to_owned(),
        noise: 0.01,
        seed: 1,
        whiskers: 1,
        points: 20,
        points_share: Some(0.5),
        points_mean_m: Some(1e-4 + noise_rad),
        points_p95_m: Some(2e-4),
        points_left_out: 0,
        objects_touched: 1,
        objects_found: 1,
        objects_split: 0,
        objects_merged: 0,
    };
    write_table(&folder.join("maps.csv"), &LEVELS.map(map));
    let outline = "x_m,y_m\n0.05,0\n0.06,0.01\n0.05,0.02\n0.04,0.01\n0.05,0\n";
    fs::write(folder.join("outlines/scene.disc.csv"), outline).expect("written");
    let places: Vec<(f64, f64)> = (0..10).map(|i| (0.04 + 1e-3 * f64::from(i), 0.01 - 1e-3 * f64::from(i))).collect();
    let covariance = (Some(1e-8), Some(0.0), Some(1e-8));
    let point = |&(x_m, y_m): &(f64, f64)| MapPointRow {
        t_s: 1.0,
        whisker: "left_1".to_owned(),
        array: "left".to_owned(),
        object: (y_m > 0.0015).then_some(1),
        x_m,
        y_m,
        normal_rad: -2.4,
        cov_xx_m2: covariance.0,
        cov_xy_m2: covariance.1,
        cov_yy_m2: covariance.2,
    };
    let vertex = |&(x_m, y_m): &(f64, f64)| MapVertexRow {
        object: 1,
        x_m,
        y_m,
        normal_rad: -2.4,
        cov_xx_m2: covariance.0,
        cov_xy_m2: covariance.1,
        cov_yy_m2: covariance.2,
        touched: true,
    };
    let cell = |i: u32| GridRow {
        x_m: 0.001 + 0.002 * f64::from(i),
        y_m: 0.001,
        swept: 3,
        touched: 0,
        occupied: if i < 4 { 0.2 } else { 0.9 },
    };
    let name = |table: &str| folder.join(format!("maps/scene.{}.{table}.csv", ESTIMATORS[0]));
    write_table(&name("points"), &places.iter().map(point).collect::<Vec<_>>());
    write_table(&name("outlines"), &places.iter().map(vertex).collect::<Vec<_>>());
    write_table(&name("grid"), &(0..6).map(cell).collect::<Vec<_>>());
}

/// Writes the outlines estimated by the first estimator. `objects` lists group, name, and mean distance from the true
/// outline (m), `None` if that is unknown.
fn write_contours(folder: &Path, objects: &[(&str, &str, Option<f64>)]) {
    let (mut scores, mut trials) = (Vec::new(), Vec::new());
    for &(group, object, mean_m) in objects {
        let (group, whisker) = (group.to_owned(), "straight".to_owned());
        let estimator = ESTIMATORS[0].to_owned();
        scores.push(ContourScoreRow {
            group: group.clone(),
            whisker: whisker.clone(),
            estimator: estimator.clone(),
            noise: 0.01,
            trials: 1,
            contact_rmse_m: mean_m,
            mean_m,
            p95_m: mean_m,
            hausdorff_m: mean_m,
            band_coverage: None,
        });
        trials.push(ContourTrialRow {
            trace: format!("{object}_straight"),
            group,
            whisker,
            object: object.to_owned(),
            estimator,
            noise: 0.01,
            seed: 1,
            length_m: Some(7e-3),
            mean_m,
            radius_m: Some(0.0153),
            radius_low_m: Some(0.0149),
            residual_rms_m: Some(1e-4),
            ..ContourTrialRow::default()
        });
        let vertex = |step: i32| VertexRow {
            x_m: 0.05 + 1e-3 * f64::from(step),
            y_m: 0.0,
            normal_rad: -1.6,
            cov_xx_m2: Some(1e-7),
            cov_xy_m2: Some(0.0),
            cov_yy_m2: Some(1e-8),
            touched: step != 3,
        };
        let vertices: Vec<_> = (0..8).map(vertex).collect();
        write_table(&folder.join(format!("contours/{object}_straight.{}.csv", ESTIMATORS[0])), &vertices);
    }
    fs::write(folder.join("contours.csv"), csv_bytes(&scores).expect("rows")).expect("written");
    fs::write(folder.join("contour_trials.csv"), csv_bytes(&trials).expect("rows")).expect("written");
}

fn trial(object: &str, estimator: &str, error_m: f64) -> TrialRow {
    let head = TrialHead {
        trace: format!("{object}_straight"),
        group: object.to_owned(),
        whisker: "straight".to_owned(),
        object: object.to_owned(),
        estimator: estimator.to_owned(),
        noise: 0.01,
        seed: 1,
        touch_s: 0.4,
        samples: 900,
        missing: 0,
        models: None,
    };
    TrialRow { head, scores: scores(error_m) }
}

fn summary_row(object: &str, estimator: &str, error_m: f64) -> SummaryRow {
    let head = SummaryHead {
        group: object.to_owned(),
        whisker: "straight".to_owned(),
        object: object.to_owned(),
        estimator: estimator.to_owned(),
        noise: 0.01,
        trials: 1,
        step_ns: 500.0,
        models: None,
        verdict: None,
        nis_verdict: None,
        rmse_mean_m: Some(error_m),
        rmse_p90_m: Some(error_m),
        above_0p5mm: 0.0,
    };
    SummaryRow { head, scores: scores(error_m) }
}

/// Scores with every length equal to the error, no settling times, and 1 for every other metric.
fn scores(error_m: f64) -> Scores {
    Scores::from_fn(|metric| match metric.name {
        name if name.ends_with("_m") => Some(error_m),
        name if name.ends_with("_s") => None,
        _ => Some(1.0),
    })
}

fn estimate(step: u32, error_m: f64) -> EstimateRow {
    let t_s = f64::from(step) * 0.004;
    let touching = t_s >= 0.4;
    let at = |value: f64| touching.then_some(value);
    EstimateRow {
        t_s,
        base_x_m: 1e-3 * t_s.sin(),
        base_y_m: 1e-3 * t_s.cos(),
        base_yaw_rad: 0.01 * t_s,
        reading_n_m: -1e-5 * t_s,
        contact_x_m: at(0.05 + error_m),
        contact_y_m: at(0.0),
        surface_x_m: at(0.05 + error_m),
        surface_y_m: at(0.0),
        cov_xx_m2: at(error_m * error_m),
        cov_xy_m2: at(0.0),
        cov_yy_m2: at(error_m * error_m),
        calibrated: touching.then_some(true),
        at_tip: touching.then_some(false),
        truth_contact_x_m: at(0.05),
        truth_contact_y_m: at(0.0),
        truth_surface_x_m: at(0.05),
        truth_surface_y_m: at(0.0),
        ..EstimateRow::default()
    }
}

fn bound(step: u32) -> BoundRow {
    let t_s = f64::from(step) * 0.004;
    BoundRow { t_s, bound_m: 1e-4 / t_s, window_m: Some(2e-4), condition: (step > 110).then_some(100.0) }
}

fn event(step: u32) -> EventRow {
    let estimate = estimate(step, 1e-4);
    let touched = estimate.contact_x_m.is_some();
    EventRow {
        t_s: estimate.t_s,
        reading_n_m: estimate.reading_n_m,
        watched_n_m: estimate.reading_n_m,
        threshold_n_m: 1e-6,
        touched,
        truth_touching: Some(touched),
    }
}

fn write_model(folder: &Path) {
    let nodes = (0..6).flat_map(|along| (0..5).map(move |across| (f64::from(along), f64::from(across))));
    let surface: Vec<_> = nodes
        .map(|(along, across)| SurfaceRow {
            arc_m: 0.02 + 0.01 * along,
            distance_m: 0.002 * across,
            x_m: 0.02 + 0.01 * along,
            y_m: -0.002 * across,
            reading_n_m: -2e-5 * across,
        })
        .collect();
    write_table(&folder.join("models/straight_left.surface.csv"), &surface);
    let residuals: Vec<_> = (0..20)
        .map(|index| ResidualRow {
            trace: "grid".to_owned(),
            x_m: 0.03,
            y_m: -0.002,
            reading_n_m: -1e-6 * f64::from(index),
            residual_n_m: 1e-8 * f64::from(index % 3),
        })
        .collect();
    write_table(&folder.join("models/straight_left.residuals.csv"), &residuals);
}

fn write_sensor(folder: &Path) {
    let turn = (0..1000).map(|step| {
        let yaw_rad = if (300..700).contains(&step) { std::f64::consts::PI } else { 0.0 };
        TurnRow { t_s: f64::from(step) * 0.01, yaw_rad, counts: 4.0 * yaw_rad, compensated_counts: 0.1 * yaw_rad }
    });
    write_table(&folder.join("sensors/left.straight.turn.csv"), &turn.collect::<Vec<_>>());
    let transfer = [1.0, 16.0].into_iter().flat_map(|amplified| {
        (-20..=20).map(move |step| TransferRow {
            amplified,
            rotation_rad: 0.02 * f64::from(step),
            x_counts: 5000.0,
            y_counts: -60.0 * amplified * f64::from(step),
            z_counts: 0.0,
        })
    });
    write_table(&folder.join("sensors/left.straight.transfer.csv"), &transfer.collect::<Vec<_>>());
}

/// Draws the report. Returns the bytes of each of its files.
/// The report of a folder, without showing progress.
pub(crate) fn report(folder: &Path) -> anyhow::Result<ReportPaths> {
    super::report(folder, &ProgressBar::hidden())
}

pub(crate) fn files_of_report(folder: &Path) -> Vec<Vec<u8>> {
    let paths = report(folder).expect("drawn");
    let files = paths.figures.iter().chain([&paths.page]);
    files.map(|path| fs::read(path).expect("exists")).collect()
}

#[test]
fn verif_every_figure_is_drawn_and_shown_on_the_page() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let paths = report(folder.path()).expect("drawn");
    assert_eq!(paths.figures.len(), 2 * FIGURES.len());
    for path in &paths.figures {
        assert!(fs::metadata(path).expect("exists").len() > 1000, "{}", path.display());
    }
    let page = fs::read_to_string(&paths.page).expect("page");
    assert_eq!(page.matches("<figure><div class=\"scroll\"").count(), FIGURES.len());
    for figure in FIGURES {
        assert!(page.contains(&format!("id=\"{}\"", figure.name)), "{}", figure.name);
    }
    assert!(page.contains("polynomial &lt;5&gt;"), "text is escaped");
    assert!(!page.contains("Left out"));
    assert!(page.contains("id=\"outlines\"") && page.contains("<td class=\"number\">15.30</td>"), "a radius");
    // The median error of the baseline is 25 times that of the filter.
    assert!(page.contains("25 ×"));
}

#[test]
fn regress_points_left_out_of_the_outlines_of_a_map_are_counted() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    report(folder.path()).expect("drawn");
    let map = fs::read_to_string(folder.path().join("figures/scene_map.svg")).expect("drawn");
    assert!(map.contains(">contact points left out of the outlines, 1 of 10<"));
}

#[test]
fn verif_few_methods_are_drawn_and_all_are_reachable() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let names = [
        "ekf",
        "recommended",
        "iekf",
        "ukf",
        "particle",
        "imm",
        "batch",
        "batch-recommended",
        "euler-bernoulli",
        "paper-ekf",
    ];
    write_run_of(folder.path(), true, &names);
    let paths = report(folder.path()).expect("drawn");
    let drawing = |name: &str| fs::read_to_string(folder.path().join(format!("figures/{name}.svg"))).expect("drawn");
    let shows = |drawing: &str, name: &str| {
        drawing.contains(&format!(">{name}<")) || drawing.contains(&format!(">{name} (hindsight)<"))
    };
    let shown = |figure: &str| -> Vec<&str> {
        let drawing = drawing(figure);
        names.into_iter().filter(|name| shows(&drawing, name)).collect()
    };
    let few = ["recommended", "particle", "batch", "euler-bernoulli", "paper-ekf"];
    for figure in ["error_over_time", "objects", "start_and_steady"] {
        assert_eq!(shown(figure), few, "{figure}");
        let groups = [1, 2].map(|number| shown(&format!("all/{figure}_{number}")));
        assert!(groups.iter().all(|group| group.len() <= 6 && group.contains(&"recommended")), "{groups:?}");
        assert!(names.iter().all(|name| groups.iter().any(|group| group.contains(name))), "{groups:?}");
    }
    assert!(paths.figures.contains(&folder.path().join("figures/all/physical_limit_2.png")));
    let page = fs::read_to_string(&paths.page).expect("page");
    assert_eq!(page.matches("<figure><div class=\"scroll\"").count(), FIGURES.len());
    assert!(page.contains("<summary>All methods</summary>"));
    let (_, rest) = page.split_once("data-part=\"trials\">").expect("a replay");
    let trials: serde_json::Value =
        serde_json::from_str(rest.split_once("</script>").expect("its end").0).expect("JSON");
    assert_eq!(trials[0]["runs"][0]["name"], "recommended");

    write_run(folder.path(), true);
    report(folder.path()).expect("drawn");
    assert!(!folder.path().join("figures/all").exists(), "pictures of the earlier run");
}

#[test]
fn verif_the_page_begins_with_the_summary() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let page = fs::read_to_string(report(folder.path()).expect("drawn").page).expect("page");
    let (_, first) = page.split_once("<section id=\"").expect("a section");
    assert!(first.starts_with("summary\""));
}

#[test]
fn verif_the_replay_has_whisker_truth_and_estimators_of_each_set() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let page = fs::read_to_string(report(folder.path()).expect("drawn").page).expect("read");
    let (_, rest) = page.split_once("data-part=\"trials\">").expect("a replay");
    let trials: serde_json::Value =
        serde_json::from_str(rest.split_once("</script>").expect("its end").0).expect("JSON");
    assert_eq!(trials.as_array().expect("a list").len(), 2);
    let trial = &trials[0];
    let frames = trial["t_s"].as_array().expect("a list").len();
    assert_eq!(frames, 200);
    for column in ["base_um", "wire_um", "truth_um"] {
        assert_eq!(trial[column].as_array().expect("a list").len(), frames, "{column}");
    }
    assert!(trial["wire_um"].as_array().expect("a list").iter().all(|wire| !wire.is_null()));
    assert!(trial["truth_um"][0].is_null() && trial["truth_um"][frames - 1] == serde_json::json!([50_000, 0]));
    assert_eq!(trial["runs"][0]["name"], "ekf");
    assert_eq!(trial["runs"][0]["error_um"][frames - 1], 200);
    assert_eq!(trial["runs"][1]["name"], "euler-bernoulli");
}

#[test]
fn robust_an_estimator_whose_table_has_no_rows_is_left_out_of_the_replay() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let header = csv_bytes::<EstimateRow>(&[]).expect("a header");
    fs::write(folder.path().join("estimates/pin_straight.ekf.csv"), header).expect("written");
    let page = fs::read_to_string(report(folder.path()).expect("drawn").page).expect("read");
    let (_, rest) = page.split_once("data-part=\"trials\">").expect("a replay");
    let trials: serde_json::Value =
        serde_json::from_str(rest.split_once("</script>").expect("its end").0).expect("JSON");
    assert_eq!(trials[0]["runs"][0]["name"], "euler-bernoulli");
}

#[test]
fn verif_a_set_is_unscored_by_its_group_and_whisker() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let mut data = RunData::read(folder.path()).expect("a run");
    let scored = data.run.sets.iter().find(|set| set.group == "circle").expect("a set").clone();
    data.run.sets.push(RunSet { whisker: "curved".to_owned(), ..scored });
    let found = data.unscored_sets().into_iter().map(|set| (set.group.as_str(), set.whisker.as_str()));
    assert_eq!(found.collect::<Vec<_>>(), [("drum", "straight"), ("circle", "curved")]);
}

#[test]
fn verif_animations_are_copied_into_the_run_linked_and_removed() {
    let [folder, drawn] = [(); 2].map(|()| tempfile::tempdir().expect("temporary folder"));
    write_run(folder.path(), false);
    let page = || {
        take_animations(folder.path(), drawn.path()).expect("copied");
        fs::read_to_string(report(folder.path()).expect("drawn").page).expect("page")
    };
    fs::write(drawn.path().join("pin.straight.webp"), "pin.straight.webp").expect("written");
    assert!(!page().contains("id=\"sweeps\""), "an animation without its still");

    for name in ["pin.straight.png", "other.straight.webp"] {
        fs::write(drawn.path().join(name), name).expect("written");
    }
    let with_animation = page();
    assert!(with_animation.contains("href=\"animations/pin.straight.webp\""));
    // The still of the pin, `pin.straight.png`, in base 64.
    assert!(
        with_animation
            .contains("src=\"data:image/png;base64,cGluLnN0cmFpZ2h0LnBuZw==\" loading=\"lazy\" alt=\"Plan view")
    );
    let copied = folder.path().join("animations/pin.straight.webp");
    assert_eq!(fs::read(&copied).expect("copied"), b"pin.straight.webp");
    assert!(!folder.path().join("animations/other.straight.webp").exists(), "of no set of the run");

    fs::remove_file(drawn.path().join("pin.straight.webp")).expect("removed");
    assert!(!page().contains("id=\"sweeps\""));
    assert!(!copied.exists());
}

#[test]
fn robust_a_missing_folder_of_animations_gives_one_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), false);
    let message = format!("{:#}", take_animations(folder.path(), &folder.path().join("none")).expect_err("no folder"));
    assert!(message.ends_with("none: found no folder, expected that of the animations"), "{message}");
}

#[test]
fn verif_the_same_run_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    assert!(files_of_report(folder.path()) == files_of_report(folder.path()));
}

#[test]
fn robust_figures_without_data_have_no_heading_and_are_listed() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    report(folder.path()).expect("drawn");
    for part in ["bounds", "contours", "estimates", "events", "maps", "models", "sensors"] {
        fs::remove_dir_all(folder.path().join(part)).expect("removed");
    }
    write_run(folder.path(), false);
    let paths = report(folder.path()).expect("drawn");
    assert!(!folder.path().join("figures/contours.svg").exists(), "a picture of the earlier run");
    let page = fs::read_to_string(&paths.page).expect("page");
    let lacking = [
        "observability",
        "contours",
        "real_objects",
        "sample_trace",
        "sensor_model",
        "contact_events",
        "transfer",
        "common_mode",
        "scene_map",
        "array_signals",
        "encoder_noise",
    ];
    let titles: Vec<&str> =
        FIGURES.iter().filter(|figure| lacking.contains(&figure.name)).map(|figure| figure.title).collect();
    assert_eq!(titles.len(), 11);
    let escaped = titles.join(", ");
    assert!(page.contains(&format!("<dt>Left out for lack of data</dt><dd>{escaped}</dd>")));
    for name in lacking.iter().chain(&["sweeps", "replay", "outlines"]) {
        assert!(!page.contains(&format!("id=\"{name}\"")) && !page.contains(&format!("href=\"#{name}\"")), "{name}");
    }
    assert_eq!(paths.figures.len(), 2 * (FIGURES.len() - 11));
}

#[test]
fn verif_the_summary_keeps_the_order_of_the_run_and_names_missing_estimates() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let mut trials = vec![trial("pin", "ekf", 2e-4), trial("pin", "euler-bernoulli", 5e-3)];
    trials[1].head.missing = 45;
    fs::write(folder.path().join("trials.csv"), score_bytes(&trials).expect("scores")).expect("written");
    let page = fs::read_to_string(report(folder.path()).expect("drawn").page).expect("page");
    let (_, summary) = page.split_once("id=\"summary\"").expect("a summary");
    let at = |text: &str| summary.find(text).unwrap_or_else(|| panic!("{text}"));
    assert!(at("<td>pin</td>") < at("<td>circle</td>"));
    assert!(at("without estimate: 5.0 %") < at("<td>circle</td>"));
    assert_eq!(summary.matches("without estimate: 5.0 %").count(), 1);
}

#[test]
fn robust_a_failed_write_leaves_no_partial_file() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    let [figures, obstacle] = ["figures", "figures/contours.png"].map(|name| folder.path().join(name));
    fs::create_dir_all(obstacle.join("occupied")).expect("created");
    let message = format!("{:#}", report(folder.path()).expect_err("an obstructed path"));
    assert!(message.contains("contours.png"), "{message}");
    let names = fs::read_dir(figures).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let hidden: Vec<_> = names.filter(|name| name.to_string_lossy().starts_with('.')).collect();
    assert!(hidden.is_empty(), "{hidden:?}");
}

#[test]
fn robust_a_run_without_scores_gives_one_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), false);
    fs::write(folder.path().join("summary.csv"), "group\n").expect("written");
    let message = format!("{:#}", report(folder.path()).expect_err("no scores"));
    assert!(message.contains("summary.csv: found no rows, expected at least one"), "{message}");
    write_run(folder.path(), false);
    fs::write(folder.path().join("trials.csv"), score_bytes::<TrialHead>(&[]).expect("scores")).expect("written");
    let message = format!("{:#}", report(folder.path()).expect_err("no scores"));
    assert!(message.contains("trials.csv: found no rows, expected at least one"), "{message}");
}

#[test]
fn robust_a_run_without_averages_over_time_is_drawn_without_their_figures() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path(), true);
    for (table, header) in
        [("consistency.csv", csv_bytes::<ConsistencyRow>(&[])), ("error_over_time.csv", csv_bytes::<ErrorBandRow>(&[]))]
    {
        fs::write(folder.path().join(table), header.expect("a header")).expect("written");
        report(folder.path()).expect("drawn");
    }
    for figure in ["consistency", "physical_limit", "error_over_time"] {
        assert!(!folder.path().join(format!("figures/{figure}.svg")).exists(), "{figure}");
    }
}
