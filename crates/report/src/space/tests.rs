//! The report of a small run in space that is built in memory.

use std::fs;
use std::path::Path;

use files::Watermark;
use nalgebra::Vector3;
use serde_json::json;
use testbed::results::csv_bytes;
use testbed::space::SpatialEstimateRow;
use testbed::space::rows::{SpatialSummaryRow, SpatialTrialRow};
use testbed::space::run::{SpatialRun, SpatialRunTrial, SpatialRunWhisker};
use testbed::space::surface::{SurfaceMesh, Vertex};
use trace::StatedSuspension;
use whisker::Whisker;
use whisker::space::frames::Point;
use whisker::space::surface::ProjectedPoint;

use super::FIGURES;
use crate::tests::{files_of_report, report};

const ESTIMATORS: [&str; 2] = ["line", "point"];

fn estimate(instant: u32) -> SpatialEstimateRow {
    let t_s = 0.01 * f64::from(instant);
    let contact = (instant > 5).then_some([0.06, -0.01, 0.002]);
    let of = |axis: usize, shift: f64| contact.map(|at| at[axis] + shift);
    SpatialEstimateRow {
        t_s,
        base_x_m: 0.001 * t_s,
        base_qw: 1.0,
        moment_y_n_m: 1e-6,
        moment_z_n_m: -1e-5,
        contact_x_m: of(0, 1e-4),
        contact_y_m: of(1, 0.0),
        contact_z_m: of(2, 2e-4),
        surface_x_m: of(0, 1e-4),
        surface_y_m: of(1, 1e-4),
        surface_z_m: of(2, 2e-4),
        cov_xx_m2: contact.map(|_| 1e-8),
        cov_xy_m2: contact.map(|_| 0.0),
        cov_xz_m2: contact.map(|_| 0.0),
        cov_yy_m2: contact.map(|_| 4e-8),
        cov_yz_m2: contact.map(|_| 0.0),
        cov_zz_m2: contact.map(|_| 1e-8),
        normal_x: contact.map(|_| 0.0),
        normal_y: contact.map(|_| 1.0),
        normal_z: contact.map(|_| 0.0),
        calibrated: contact.map(|_| true),
        truth_contact_x_m: of(0, 0.0),
        truth_contact_y_m: of(1, 0.0),
        truth_contact_z_m: of(2, 0.0),
        truth_surface_x_m: of(0, 0.0),
        truth_surface_y_m: of(1, 1e-4),
        truth_surface_z_m: of(2, 0.0),
        ..SpatialEstimateRow::default()
    }
}

/// Writes a run with one trial, whose group `<edge>` has a name that a page must escape.
fn write_run(folder: &Path) {
    let stiffness = 1.7e-4;
    let suspension = StatedSuspension { yaw_n_m_rad: stiffness, pitch_n_m_rad: stiffness, twist_n_m_rad: stiffness };
    let whisker = SpatialRunWhisker { whisker: Whisker::straight(), suspension, poisson_ratio: 0.33 };
    let solid = json!({"shape": "pin", "radius_m": 5e-4, "length_m": 0.2, "center_m": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0]});
    let run = SpatialRun {
        watermark: Watermark {
            tool: "whisker".into(),
            version: "0".into(),
            git_commit: None,
            inputs_sha256: "ab".into(),
        },
        name: "space".into(),
        noise: 0.01,
        seeds: vec![1],
        front_end: None,
        calibrations: Vec::new(),
        estimators: ESTIMATORS.iter().map(|name| ((*name).to_owned(), json!({}))).collect(),
        trials: vec![SpatialRunTrial { trace: "edge".into(), group: "<edge>".into(), whisker, solid }],
    };
    let trial = |estimator: &str| SpatialTrialRow {
        trace: "edge".into(),
        group: "<edge>".into(),
        whisker: "straight".into(),
        estimator: estimator.into(),
        seed: 1,
        noise_sd_n_m: 1e-7,
        answered: Some(1.0),
        rmse_m: Some(2e-4),
        out_of_plane_m: Some(1e-4),
        bound_m: Some(1e-4),
        object_bound_m: Some(1.5e-4),
        nees: Some(3.0),
        coverage: Some(0.9),
        early_coverage: Some(0.8),
        surface_m: Some(2e-5),
        normal_rad: Some(0.01),
        direction_rad: Some(0.02),
        direction_bound_rad: Some(0.015),
        radius_error: Some(0.05),
        radius_bound: Some(0.04),
        radius_coverage: Some(1.0),
        edge_m: Some(1e-4),
        corner_m: None,
        nees_mean: Some(2.5),
        nees_samples: Some(4.0),
        contact_s: 1.5,
        doubted: Some(0.25),
        doubt_time_s: Some(0.5),
    };
    let summary = |estimator: &str| SpatialSummaryRow {
        group: "<edge>".into(),
        whisker: "straight".into(),
        estimator: estimator.into(),
        trials: 1,
        answered: Some(1.0),
        rmse_m: Some(2e-4),
        out_of_plane_m: Some(1e-4),
        bound_m: Some(1e-4),
        object_bound_m: Some(1.5e-4),
        nees: Some(1.0),
        nees_low: 0.1,
        nees_high: 3.0,
        coverage: Some(0.9),
        early_coverage: Some(0.8),
        surface_m: Some(2e-5),
        normal_rad: Some(0.01),
        direction_rad: Some(0.02),
        direction_bound_rad: Some(0.015),
        radius_error: Some(0.05),
        radius_bound: Some(0.04),
        radius_coverage: Some(1.0),
        edge_m: Some(1e-4),
        corner_m: None,
        nees_mean: Some(0.8),
        verdict: Some("consistent".into()),
        doubted: Some(0.25),
    };
    files::write_json(&folder.join("space_run.json"), &run).expect("written");
    let write =
        |name: &str, bytes: anyhow::Result<Vec<u8>>| fs::write(folder.join(name), bytes.unwrap()).expect("written");
    write("space_trials.csv", csv_bytes(&ESTIMATORS.map(trial)));
    write("space_summary.csv", csv_bytes(&ESTIMATORS.map(summary)));
    for name in ["space_estimates", "space_maps"] {
        fs::create_dir(folder.join(name)).expect("created");
    }
    let vertex = |x_m: f64, z_m: f64| Vertex {
        on: ProjectedPoint { at: Point::new(x_m, 6e-4, z_m), normal: Vector3::y(), sd_m: 1e-5 },
        object: 0,
    };
    let mesh = SurfaceMesh {
        vertices: vec![vertex(-1e-3, 0.0), vertex(1e-3, 0.0), vertex(0.0, 2e-3)],
        triangles: vec![[0, 1, 2]],
    };
    for estimator in ESTIMATORS {
        let rows: Vec<SpatialEstimateRow> = (0..20).map(estimate).collect();
        write(&format!("space_estimates/edge.{estimator}.csv"), csv_bytes(&rows));
        write(&format!("space_maps/edge.{estimator}.surface.ply"), Ok(mesh.to_ply().into_bytes()));
    }
}

#[test]
fn verif_every_figure_of_a_run_in_space_is_drawn_and_the_trial_is_replayed() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path());
    let paths = report(folder.path()).expect("drawn");
    assert_eq!(paths.figures.len(), 2 * FIGURES.len());
    let page = fs::read_to_string(&paths.page).expect("page");
    assert!(page.contains("&lt;edge&gt;") && !page.contains("<edge>"), "text is escaped");
    assert!(page.contains("\"t_s\":[0.0,0.01") && page.contains("function stageOf"));
    assert!(
        page.contains("\"vertices_um\":[[-1000,600,0],") && page.contains("\"triangles\":[[0,1,2]]"),
        "the surface"
    );
    // The whisker ends at its tip, 80 mm from the base, while it is free.
    assert!(page.contains("[80000,0,0]]"), "the free whisker is drawn");
    assert!(!page.contains("<td class=\"number\"><b class=\"best\">"), "equal values are not ranked");
    assert_eq!(files_of_report(folder.path()), files_of_report(folder.path()));
}

#[test]
fn robust_a_run_in_space_without_its_estimates_is_one_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_run(folder.path());
    fs::remove_file(folder.path().join("space_estimates/edge.line.csv")).expect("removed");
    let message = format!("{:#}", report(folder.path()).expect_err("refused"));
    assert!(message.contains("edge.line.csv: cannot be read"), "{message}");
}
