//! Golden traces written by the Python generator: reading and rewriting preserves their bytes.

use std::fs;
use std::path::{Path, PathBuf};

use files::sha256;
use serde_json::json;
use trace::{Sidecar, Trace};

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden")
}

const NAMES: [&str; 2] = ["golden_pin", "golden_circle"];

#[test]
fn regress_rewriting_preserves_the_bytes_of_the_golden_traces() {
    for name in NAMES {
        let trace = Trace::read(&golden().join(format!("{name}.csv"))).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let written = trace.write(folder.path()).unwrap();
        for extension in ["csv", "json"] {
            let old = fs::read(golden().join(name).with_extension(extension)).unwrap();
            let new = fs::read(written.with_extension(extension)).unwrap();
            assert!(old == new, "{name}.{extension} changes when it is rewritten");
        }
    }
}

#[test]
fn val_golden_traces_are_physically_consistent() {
    for name in NAMES {
        let trace = Trace::read(&golden().join(format!("{name}.json"))).unwrap();
        let outline = trace.outline(&golden()).unwrap().expect("an outline");
        let whisker = &trace.sidecar.whisker;
        let mut touching = 0;
        for pair in trace.recording.instants.windows(2) {
            // The recorded twist, integrated over one step, predicts the next pose up to the acceleration in between.
            let dt_s = pair[1].t_s - pair[0].t_s;
            let twist = pair[1].twist.expect("a twist");
            let moved = twist.motion(dt_s).origin();
            let recorded = pair[0].base.then(&pair[1].base.inverse()).origin();
            assert!(moved.distance(&recorded) < 5e-6, "{name} at {} s", pair[1].t_s);
        }
        for (known, truth) in trace.recording.instants.iter().zip(&trace.truth.instants) {
            let rotation = known.rotation_z_rad.expect("a rotation");
            assert!((known.moment_z_n_m - whisker.root_stiffness_n_m_rad * rotation).abs() < 1e-13);
            let (Some(contact), Some(surface)) = (truth.contact, truth.surface) else { continue };
            touching += 1;
            assert!(outline.distance_m(surface) < 2e-6);
            assert!((contact.distance(&surface) - 0.5 * whisker.root_diameter_m).abs() < 1e-5);
        }
        assert!(touching > 100, "{name} touches {touching} times");
    }
}

#[test]
fn verif_an_object_rests_unless_its_velocity_is_stated() {
    let mut sidecar = Sidecar::read(&golden().join("golden_pin.json")).unwrap();
    assert!(sidecar.object_velocity_m_s() == [0.0; 2] && sidecar.is_object_at_rest());
    sidecar.scene["object_velocity_m_s"] = json!([1e-3, -2e-3]);
    assert!(sidecar.object_velocity_m_s() == [1e-3, -2e-3] && !sidecar.is_object_at_rest());
}

#[test]
fn verif_an_object_gives_way_if_a_stand_or_a_stiffness_is_stated() {
    let fixed = Sidecar::read(&golden().join("golden_pin.json")).unwrap();
    assert!(!fixed.is_yielding());
    for (key, value) in
        [("object_stand", json!({"mass_kg": 0.002, "friction": 0.3})), ("object_stiffness_n_m", json!(20.0))]
    {
        let mut sidecar = fixed.clone();
        sidecar.scene[key] = value;
        assert!(
            sidecar.is_yielding() && !sidecar.is_object_at_rest() && sidecar.object_velocity_m_s() == [0.0; 2],
            "{key}"
        );
    }
}

#[test]
fn robust_a_velocity_that_is_not_two_numbers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut sidecar = Sidecar::read(&golden().join("golden_pin.json")).unwrap();
    for value in [json!(null), json!([1e-3]), json!([0.0, 0.0, 0.0]), json!(["0", 0.0])] {
        sidecar.scene["object_velocity_m_s"] = value.clone();
        let path = folder.path().join("moving.json");
        fs::write(&path, serde_json::to_string_pretty(&sidecar).unwrap()).unwrap();
        let error = Sidecar::read(&path).unwrap_err().to_string();
        let expected = format!("scene.object_velocity_m_s: found {value}, expected two numbers");
        assert!(error.contains(&expected), "{error}");
    }
}

#[test]
fn val_sha256_matches_the_published_test_vector() {
    assert_eq!(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

#[test]
fn robust_a_range_in_which_a_characteristic_is_not_monotone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("golden_pin.json");
    let read = |range_n_m: serde_json::Value| {
        let mut sidecar: serde_json::Value = files::read_json(&golden().join("golden_pin.json")).unwrap();
        sidecar["recorded"] = json!({
            "clock": "recorded", "characteristic": [1e7, 0.0, -1e15], "range_n_m": range_n_m, "residual_counts": 1.0,
            "rest_counts": 0.0, "noise_sd_n_m": 1e-7, "touch_counts": 1.0,
        });
        files::write_json(&path, &sidecar).unwrap();
        Sidecar::read(&path)
    };
    let recorded = read(json!([-5e-5, 5e-5])).unwrap().recorded.unwrap();
    assert_eq!(recorded.characteristic().unwrap().range_n_m, [-5e-5, 5e-5]);
    // The slope changes its sign at 5.8e-5 N m.
    let error = read(json!([-5e-5, 6e-5])).unwrap_err().to_string();
    assert!(error.contains("golden_pin.json: recorded.range_n_m: found [-5e-5, 6e-5], expected a range"), "{error}");
}
