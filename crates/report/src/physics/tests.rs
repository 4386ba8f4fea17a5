//! The report of a small study that is built in memory.

use std::fs;
use std::path::Path;

use super::FIGURES;
use crate::tests::{files_of_report, report};

const WATERMARK: &str = r#"{"format": 1, "kind": "physics", "numpy": "2", "scipy": "1", "traces": {}, "generator":
    {"name": "whisker_sim", "version": "0.1.0", "mujoco": "3", "git_commit": null, "source_sha256": "ab"}}"#;

const CLAIMS: &str = "id,claim,measured,relation,bound,unit,holds
rest_straight_moment,moment,0.01,<=,0.05,%,true
rest_straight_surface,surface,0.01,<=,0.03,mm,true
rest_straight_arc,arc,0.03,<=,0.02,mm,false
trial_moment_rms,trials,0.01,<=,0.05,% of range,true
trial_surface_rms_m,trials,0.001,<=,0.005,mm,true
trial_surface_worst_m,trials,0.001,<=,0.03,mm,true
trial_arc_rms_m,trials,0.001,<=,0.02,mm,true
frequency_1,frequency,0.003,<=,1,%,true
step_halved,step,0.02,<=,0.1,% of range,true
dynamic_20,slow,-6.4e-16,<=,0.1,% of range,true
dynamic_100,fast,0.06,<=,1,% of range,true
disturbance_curved,curved,0.0001,<=,0.01,mm,true
rig_rotation,rig at rest,0.09,<=,0.1,%,true
rig_slope,rig moving,0.7,<=,1,%,true
space_suite_moment_rms,moment in space,0.03,<=,0.05,% of range,true
space_suite_surface_rms_m,surface in space,0.004,<=,0.02,mm,true
space_suite_normal_rms_rad,normal in space,0.005,<=,0.2,degrees,true
";

const CONVERGENCE: &str = "whisker,object,segments,moment_error,surface_error_m,arc_error_m,tip_error_m
straight,pin,10,0.001,1e-5,1e-5,1e-5
straight,pin,20,0.00025,2.5e-6,2.5e-6,2.5e-6
straight,corner,10,0.001,0,1e-5,1e-5
straight,corner,20,0.00025,0,2.5e-6,2.5e-6
";

const DISTURBANCE: &str =
    "whisker,root_stiffness_n_m_rad,diameter_m,mass_kg,approach_rad,tip_friction,speed_m_s,peak_force_n,moved_m,fell,\
    slides_at_n,tips_at_n
";

const RINGING: &str = "case,damping_ratio,amplitude_n_m,decay_s,published_dying_s,published_fall
preset,0.07,4e-5,0.28,1.4,135
undamped hinges,0.01,4e-5,1.6,1.4,135
never drawn,0.01,4e-5,1.6,1.4,135
";

fn write_study(folder: &Path) {
    let waves = |case: &str| -> String {
        let wave = |step: u32| format!("{case},{},{}\n", f64::from(step) * 0.01, 4e-5 * f64::from(step).cos());
        (0..160).map(wave).collect()
    };
    let sweep = |trace: &str| -> String {
        let instant = |step: u32| format!("{trace},{},1e-9,1e-6,-1e-6,{}\n", f64::from(step) * 0.01, step % 2);
        (0..50).map(instant).collect()
    };
    let tables = [
        ("claims", CLAIMS.to_owned()),
        ("convergence", CONVERGENCE.to_owned()),
        ("convergence_orders", "whisker,figure,order\nstraight,moment,2.0\n".to_owned()),
        ("sweeps", "trace,range_n_m\noctagon_straight,1e-4\ncircle_15_curved,1e-4\n".to_owned()),
        (
            "sweep_errors",
            format!(
                "trace,t_s,moment_error_n_m,surface_error_m,arc_error_m,quasi_static\n{}{}",
                sweep("octagon_straight"),
                sweep("circle_15_curved")
            ),
        ),
        ("frequencies", "segments,mode,beam_hz,error\n10,1,7.89,1e-3\n20,1,7.89,-2.5e-4\n".to_owned()),
        ("ringing", RINGING.to_owned()),
        ("ringing_signal", format!("case,t_s,moment_n_m\n{}{}", waves("preset"), waves("undamped hinges"))),
        (
            "disturbance_approach",
            format!(
                "{DISTURBANCE}a,1.7e-4,2.5e-4,0.02,0.1,0,0.05,0.001,1e-9,0,0.1,0.04\na,1.7e-4,2.5e-4,0.02,1.5,0.5,0.1,0.1,1e-2,1,0.1,0.04\n"
            ),
        ),
        (
            "disturbance_stiffness",
            format!(
                "{DISTURBANCE}a,1.7e-4,2e-4,0.02,0.1,0,0.05,0.001,1e-9,0,0.1,0.04\na,10,4e-4,0.02,1.5,0.5,0.1,0.1,1e-2,1,0.1,0.04\n"
            ),
        ),
        (
            "disturbance_speed",
            format!(
                "{DISTURBANCE}a,1.7e-4,2e-4,0.02,0.1,0.5,0.05,0.001,1e-9,0,0.1,0.04\na,1.7e-4,2e-4,0.02,0.1,0.5,0.1,0.1,1e-2,1,0.1,0.04\n"
            ),
        ),
        ("speeds", "case,speed_m_s,first_rms,settled_rms\na,0.02,1e-4,1e-5\na,0.1,1e-4,1e-3\n".to_owned()),
        (
            "rig",
            "distance_m,push_m,rotation_rad,elastica_rad,error,slope_rad_m,beam_rad_m,rigid_rad_m\n\
                0.145,0.006,0.03,0.03002,-7e-4,5.1,5.12,6.9\n0.045,0.006,0.12,0.1201,-8e-4,20.1,20.2,22.2\n"
                .to_owned(),
        ),
        ("friction", "case,coefficient,range_n_m\npin,0.3,6e-5\n".to_owned()),
        (
            "friction_instants",
            "case,t_s,press_m,lengthwise_m,friction_n_m,static_friction_n_m,angle_rad,static_angle_rad\n\
                pin,0.5,0.001,0,1e-8,1e-8,0.29,0.29\npin,1.5,0.02,0,-1e-7,-1e-7,0.29,0.29\n\
                pin,2,0.02,0.006,2e-7,2e-7,-0.29,-0.29\npin,3,0.001,0,-1e-8,-1e-8,-0.29,-0.29\n"
                .to_owned(),
        ),
        ("steps", "case,segments,timestep_s,change_worst\na,40,0.0005,0\na,40,0.00025,1e-4\n".to_owned()),
        (
            "space_chain",
            "whisker,arrangement,segments,moment_error,point_error_m\nstraight,alternating,12,4e-4,4e-6\n\
                straight,alternating,24,1e-4,1e-6\nstraight,same order,12,4e-3,4e-5\nstraight,same order,24,2e-3,2e-5\n"
                .to_owned(),
        ),
        (
            "space_scenes",
            "scene,refined,coarse,fine,change_rms,change_worst\nsphere,segments,12,24,4e-4,5e-4\n\
                sphere,segments,24,48,1e-4,2e-4\nsphere,timestep_s,0.001,0.0005,4e-3,5e-3\n\
                sphere,timestep_s,0.0005,0.00025,2e-3,3e-3\n"
                .to_owned(),
        ),
        (
            "space_suite",
            "trace,whisker,moment_rms,surface_rms_m,normal_rms_rad\npin_00_straight,straight,1e-4,1e-6,1e-5\n\
                pin_00_curved,curved,3e-4,2e-6,3e-5\n"
                .to_owned(),
        ),
    ];
    for (name, text) in tables {
        fs::write(folder.join(format!("{name}.csv")), text).expect("written");
    }
    fs::write(folder.join("watermark.json"), WATERMARK).expect("written");
}

#[test]
fn verif_every_figure_is_drawn_and_every_claim_stands_on_the_page() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_study(folder.path());
    let paths = report(folder.path()).expect("drawn");
    assert_eq!(paths.figures.len(), 2 * FIGURES.len());
    for path in &paths.figures {
        let bytes = fs::read(path).expect("exists");
        let start: &[u8] = if path.extension().is_some_and(|kind| kind == "svg") { b"<svg" } else { b"\x89PNG" };
        assert!(bytes.starts_with(start), "{}", path.display());
    }
    let page = fs::read_to_string(&paths.page).expect("page");
    assert_eq!(page.matches("<svg").count(), FIGURES.len());
    assert!(page.contains("16 of 17 claims hold"));
    assert!(page.contains("≤ 0.02") && page.contains("does not hold"));
    assert!(!page.contains("Left out"));
}

#[test]
fn verif_the_same_study_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_study(folder.path());
    assert!(files_of_report(folder.path()) == files_of_report(folder.path()));
}

#[test]
fn robust_an_empty_table_is_left_out_and_a_missing_one_gives_one_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_study(folder.path());
    fs::write(folder.path().join("steps.csv"), "case,segments,timestep_s,change_worst\n").expect("written");
    let page = fs::read_to_string(report(folder.path()).expect("drawn").page).expect("page");
    assert_eq!(page.matches("Left out").count(), 1);
    assert!(!page.contains("id=\"steps\"") && !page.contains("href=\"#steps\""));
    fs::remove_file(folder.path().join("steps.csv")).expect("removed");
    let message = format!("{:#}", report(folder.path()).expect_err("no table"));
    assert!(message.starts_with("figure `steps`") && message.contains("steps.csv"), "{message}");
}

#[test]
fn robust_a_missing_claim_gives_one_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write_study(folder.path());
    let claims = CLAIMS.replace("frequency_1", "frequency_9");
    fs::write(folder.path().join("claims.csv"), claims).expect("written");
    let message = format!("{:#}", report(folder.path()).expect_err("no claim"));
    assert!(message.contains("claims.csv: expected a claim `frequency_1`, found none"), "{message}");
}
