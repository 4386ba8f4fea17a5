//! From recordings in space to estimates: import, check, fit, replay and evaluation of the example.

mod command;
#[path = "own_data/laboratory.rs"]
mod laboratory;
#[path = "own_data/made_in_space.rs"]
mod made;

use std::fs;
use std::path::{Path, PathBuf};

use bag::messages::{Header, MagneticField, Point, Pose, PoseStamped, Quaternion, Time, Vector3 as RosVector3};
use bag::{Publisher, Writer};
use nalgebra::{Isometry3, Matrix2, Quaternion as Rotation, UnitQuaternion, Vector2, Vector3};
use serde_json::{Value, json};
use trace::{SpatialCalibrationFile, SpatialInstant, SpatialSidecar, SpatialTrace};

use command::{assert_fails, text, whisker};
use laboratory::{assert_stored, copied, good, live, lived, root};

fn example() -> PathBuf {
    root().join("examples/own-data-space")
}

/// Copy of the example with another mapping.
fn changed(change: impl FnOnce(&mut Value)) -> tempfile::TempDir {
    let folder = copied(&example());
    let path = folder.path().join("import.json");
    let mut mapping = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut mapping);
    fs::write(&path, mapping.to_string()).unwrap();
    folder
}

/// Changes the cells of a recording, by line from 1.
fn rewrite(folder: &tempfile::TempDir, name: &str, change: impl Fn(usize, &mut Vec<String>)) {
    let path = folder.path().join(name);
    let text = fs::read_to_string(&path).unwrap();
    let line = |(i, line): (usize, &str)| {
        let mut cells: Vec<String> = line.split(',').map(Into::into).collect();
        change(i + 1, &mut cells);
        cells.join(",") + "\n"
    };
    fs::write(&path, text.lines().enumerate().map(line).collect::<String>()).unwrap();
}

/// Imports the mapping of a folder. Returns the folder of the traces.
fn imported(folder: &tempfile::TempDir) -> PathBuf {
    let out = folder.path().join("traces");
    good(&["import", "csv", text(&folder.path().join("import.json")), "--space", "--out", text(&out)]);
    out
}

/// Asserts that an import fails with a single error that contains every one of `words`.
fn fails(folder: &tempfile::TempDir, words: &[&str]) {
    let out = folder.path().join("traces");
    let output = whisker(&["import", "csv", text(&folder.path().join("import.json")), "--space", "--out", text(&out)]);
    assert_fails(output, words);
}

/// Angles of a rotation, as a robot states them.
type StateAngles = fn(&UnitQuaternion<f64>) -> [f64; 3];

fn read(traces: &Path, name: &str) -> SpatialTrace {
    SpatialTrace::read(&traces.join(format!("{name}.csv"))).unwrap()
}

#[test]
#[ignore = "writes examples/own-data-space"]
fn write_example() {
    for (name, rows) in made::recordings() {
        fs::write(example().join(format!("{name}.csv")), made::csv(&rows)).unwrap();
    }
}

#[test]
fn regress_the_example_is_that_of_the_rod() {
    for (name, rows) in made::recordings() {
        assert_stored(&example().join(format!("{name}.csv")), &made::csv(&rows));
    }
}

/// Response, poses and contacts of the import are those from which the example was made.
#[test]
fn verif_the_import_recovers_response_poses_and_contacts() {
    let folder = changed(|_| {});
    let traces = imported(&folder);
    let true_response = Matrix2::from(made::COUNTS_PER_N_M).transpose();
    for (name, rows) in made::recordings() {
        let trace = read(&traces, &name);
        let recorded = trace.sidecar.recorded.as_ref().unwrap();
        let response = recorded.counts_per_n_m.response();
        // Its cubic part is not part of the linear response.
        assert!((response - true_response).norm() < 0.02 * true_response.norm(), "{name}: {response}");
        assert!(recorded.residual_counts.iter().all(|residual| *residual < 5.0), "{name}: {recorded:?}");
        let off = recorded.rest_counts.iter().zip([512.0, -140.0]).map(|(found, expected)| (found - expected).abs());
        assert!(off.fold(0.0, f64::max) <= 1.0, "{name}: {:?}", recorded.rest_counts);
        let known = trace.truth.instants.iter().filter(|truth| truth.place.is_some()).count();
        let touching = rows.iter().filter(|row| row.contact_m.is_some()).count();
        assert!(known > touching * 9 / 10 && known <= touching, "{name}: {known} of {touching}");
        let mut worst_m: f64 = 0.0;
        for (row, (now, truth)) in trace.recording.instants.iter().zip(&trace.truth.instants).enumerate() {
            // The time of a row differs from that of a sample by up to 3 ms.
            let (base, expected) = (now.base, rows[row].flange * made::mount());
            assert!((base.position - expected.translation.vector).norm() < 1e-3, "{name} {row}");
            assert!(base.rotation.angle_to(&expected.rotation) < 0.02, "{name} {row}");
            if let (Some(found), Some(expected)) = (truth.place, rows[row].contact_m) {
                worst_m = worst_m.max((found - expected).norm());
            }
        }
        assert!(worst_m < 0.3e-3, "{name}: {worst_m} m");
    }
}

#[test]
fn verif_own_csv_in_space_gives_accurate_contacts() {
    let work = tempfile::tempdir().unwrap();
    let (traces, results) = (work.path().join("lab"), work.path().join("results"));
    let mapping = example().join("import.json");
    let (listed, notes) = good(&["import", "csv", text(&mapping), "--space", "--out", text(&traces)]);
    assert!(listed.contains("lab-whisker") && notes.contains("trial_1: interpolated"), "{listed}{notes}");
    assert!(!notes.contains("warning") && !notes.contains("without a contact"), "{notes}");
    good(&["check", text(&traces)]);
    good(&["fit", text(&traces), "--model", "spline"]);
    good(&["evaluate", text(&traces), "--estimators", "recommended", "--results", text(&results)]);
    let mut table = csv::Reader::from_path(results.join("lab/space_trials.csv")).unwrap();
    let place = table.headers().unwrap().iter().position(|column| column == "rmse_m").unwrap();
    let rmse_m: Vec<f64> = table.records().map(|row| row.unwrap()[place].parse().unwrap()).collect();
    assert!(rmse_m.len() == 1 && rmse_m[0] < 0.3e-3, "{rmse_m:?}");
}

#[test]
fn verif_live_counts_in_space_have_the_contacts_of_their_moments() {
    let folder = changed(|_| {});
    let traces = imported(&folder);
    let (_, notes) = good(&["fit", text(&traces), "--model", "spline"]);
    assert!(!notes.contains("no sensor"), "{notes}");
    let calibration = traces.join("calibrations/lab-whisker.json");
    let (checked, _) = good(&["check", text(&calibration)]);
    assert!(checked.contains("; with the sensor of its recordings"), "{checked}");
    let sensor = SpatialCalibrationFile::read(&calibration).unwrap().sensor.unwrap();
    let trial = read(&traces, "trial_1");
    let recorded = trial.sidecar.recorded.unwrap();
    assert_eq!(sensor.counts_per_n_m, recorded.counts_per_n_m);

    let rest = Vector2::from(recorded.rest_counts);
    let pose = |now: &SpatialInstant| {
        let (at, turn) = (now.base.position, now.base.rotation);
        json!({"t_s": now.t_s, "base_x_m": at.x, "base_y_m": at.y, "base_z_m": at.z, "base_qw": turn.w, "base_qx": turn.i,
            "base_qy": turn.j, "base_qz": turn.k})
    };
    let moments = |now: &SpatialInstant| Vector2::new(now.moment_y_n_m, now.moment_z_n_m);
    let rows: Vec<(Value, Vector2<f64>)> = trial
        .recording
        .instants
        .iter()
        .map(|now| (pose(now), rest + sensor.counts_per_n_m.counts(moments(now))))
        .collect();
    // The noise is that of the sensor.
    let mut of_counts = vec![json!({"protocol": 2, "rate_hz": 100, "zeroing_s": 0.3})];
    of_counts.extend(rows.iter().map(|(pose, counts)| {
        let mut line = pose.clone();
        line["counts"] = json!([counts.x, counts.y]);
        line
    }));
    let answers = lived(&calibration, "point", &of_counts);
    assert_eq!(answers.len(), rows.len());
    let zeroing = answers.iter().take_while(|answer| answer["status"] == "zeroing").count();
    assert_eq!(zeroing, 31);

    let (at_rest, moving) = rows.split_at(zeroing);
    let zero = at_rest.iter().map(|(_, counts)| counts).sum::<Vector2<f64>>() / zeroing as f64;
    let mut of_moments = vec![json!({"protocol": 2, "rate_hz": 100, "noise_sd_n_m": sensor.noise_sd_n_m})];
    of_moments.extend(moving.iter().map(|(pose, counts)| {
        let moment_n_m = sensor.counts_per_n_m.moment_n_m(counts - zero);
        let mut line = pose.clone();
        (line["moment_y_n_m"], line["moment_z_n_m"]) = (moment_n_m.x.into(), moment_n_m.y.into());
        line
    }));
    assert_eq!(answers[zeroing..], lived(&calibration, "point", &of_moments));
    assert!(answers.iter().filter(|answer| answer["contact_x_m"].is_f64()).count() > 100);
}

#[test]
fn robust_recordings_in_space_that_state_different_responses_give_no_sensor() {
    let folder = changed(|_| {});
    let traces = imported(&folder);
    let path = traces.join("calibration_3.json");
    let mut sidecar: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    sidecar["recorded"]["counts_per_n_m"] = json!([[3e7, 0], [0, 3e7]]);
    fs::write(&path, sidecar.to_string()).unwrap();
    let (_, notes) = good(&["fit", text(&traces), "--model", "spline"]);
    let calibration = traces.join("calibrations/lab-whisker.json");
    assert_eq!(SpatialCalibrationFile::read(&calibration).unwrap().sensor, None);
    let words = "calibration_3: recorded.counts_per_n_m: found [[30000000.0, 0.0], [0.0, 30000000.0]], expected [[";
    assert!(notes.contains("no sensor") && notes.contains(words), "{notes}");
    // Without a sensor neither noise nor counts are known.
    let refused = |lines: &[Value]| String::from_utf8(live(&calibration, "point", lines).stderr).unwrap();
    let errors = refused(&[json!({"protocol": 2, "rate_hz": 100})]);
    assert!(errors.contains("line 1: noise_sd_n_m: found none, expected the standard deviation"), "{errors}");
    let first = json!({"protocol": 2, "rate_hz": 100, "noise_sd_n_m": 1e-7});
    let errors = refused(&[first, json!({"t_s": 0, "counts": [1, 2]})]);
    assert!(errors.contains("counts: found those of a whisker whose calibration"), "{errors}");
}

/// Roll, pitch and yaw, a rotation vector and a quaternion of either sign give the same poses.
#[test]
fn verif_orientations_in_every_form_give_the_same_poses() {
    let reference = read(&imported(&changed(|_| {})), "trial_1");
    let forms: [(Value, StateAngles); 2] = [
        (
            json!({"roll_pitch_yaw": {"roll": {"column": "flange_qx", "unit": "deg"},
                "pitch": {"column": "flange_qy", "unit": "deg"}, "yaw": {"column": "flange_qz", "unit": "deg"}}}),
            |rotation| {
                let (roll, pitch, yaw) = rotation.euler_angles();
                [roll, pitch, yaw].map(f64::to_degrees)
            },
        ),
        (
            json!({"rotation_vector": {"x": {"column": "flange_qx", "unit": "rad"},
                "y": {"column": "flange_qy", "unit": "rad"}, "z": {"column": "flange_qz", "unit": "rad"}}}),
            |rotation| rotation.scaled_axis().into(),
        ),
    ];
    let quaternion = |cells: &[String]| {
        let [w, x, y, z] = [4, 5, 6, 7].map(|place: usize| cells[place].parse::<f64>().unwrap());
        UnitQuaternion::new_normalize(Rotation::new(w, x, y, z))
    };
    let mut found = Vec::new();
    for (orientation, state) in forms {
        let folder = changed(|mapping| mapping["pose"]["orientation"] = orientation);
        for name in made::recordings().into_iter().map(|(name, _)| name + ".csv") {
            rewrite(&folder, &name, |line, cells| {
                if line > 1 {
                    let stated = state(&quaternion(cells)).map(|angle| format!("{angle:.9}"));
                    cells.splice(5..8, stated);
                }
            });
        }
        found.push(read(&imported(&folder), "trial_1"));
    }
    // Every other row with the opposite sign.
    let folder = changed(|_| {});
    rewrite(&folder, "trial_1.csv", |line, cells| {
        if line > 1 && line % 2 == 0 {
            for component in &mut cells[4..8] {
                *component = (-component.parse::<f64>().unwrap()).to_string();
            }
        }
    });
    found.push(read(&imported(&folder), "trial_1"));
    for trace in found {
        for (found, expected) in trace.recording.instants.iter().zip(&reference.recording.instants) {
            assert!((found.base.position - expected.base.position).norm() < 1e-7);
            assert!((found.base.rotation.coords - expected.base.rotation.coords).norm() < 1e-6);
        }
    }
}

/// A pin that is moved past a whisker at rest: World is fixed to the pin.
#[test]
fn verif_a_moving_object_gives_the_same_contacts_in_base() {
    let reference = read(&imported(&changed(|_| {})), "trial_1");
    let folder = changed(|mapping| {
        // The pose of the pin in the frame of the base, which is at rest in that of the recorded positions.
        mapping["pose"]["of"] = "object".into();
        mapping["base"] =
            json!({"x": {"value": 0, "unit": "m"}, "y": {"value": 0, "unit": "m"}, "z": {"value": 0, "unit": "m"}});
        for axis in ["x", "y", "z"] {
            mapping["contact"][axis] = json!({"value": 0, "unit": "m"});
        }
    });
    for (name, rows) in made::recordings() {
        rewrite(&folder, &format!("{name}.csv"), |line, cells| {
            let Some(row) = line.checked_sub(2).map(|row| rows[row]) else { return };
            let pin = (row.flange * made::mount()).inverse()
                * Isometry3::from_parts(Vector3::from(made::PIN_M).into(), UnitQuaternion::identity());
            let at = pin.translation.vector;
            let [x, y, z, w]: [f64; 4] = pin.rotation.coords.into();
            let pose = [1e3 * at.x, 1e3 * at.y, 1e3 * at.z, w, x, y, z].map(|number| format!("{number:.9}"));
            cells.splice(1..8, pose);
        });
    }
    let trace = read(&imported(&folder), "trial_1");
    let mut known = 0;
    for (row, truth) in trace.truth.instants.iter().enumerate() {
        let in_base = |trace: &SpatialTrace| {
            let base = trace.recording.instants[row].base;
            Some(base.rotation.inverse() * (trace.truth.instants[row].place? - base.position))
        };
        if let (Some(_), Some(found), Some(expected)) = (truth.place, in_base(&trace), in_base(&reference)) {
            assert!((found - expected).norm() < 1e-5, "{row}: {found} {expected}");
            known += 1;
        }
    }
    assert!(known > 400, "{known}");
}

#[test]
fn verif_own_bag_in_space_gives_the_same_contacts_as_the_csv() {
    let work = tempfile::tempdir().unwrap();
    for (name, rows) in made::recordings() {
        let mut writer = Writer::create(&work.path().join(name)).unwrap();
        for row in rows {
            let time_ns = |late_ms: f64| (1e6 * (row.time_ms + late_ms)) as u64;
            let header = |time_ns| Header { stamp: Time::from_nanoseconds(time_ns), frame_id: "world".into() };
            let at = row.flange.translation.vector;
            let [x, y, z, w]: [f64; 4] = row.flange.rotation.coords.into();
            let pose = Pose { position: Point { x: at.x, y: at.y, z: at.z }, orientation: Quaternion { x, y, z, w } };
            writer.write("/flange", time_ns(0.0), &PoseStamped { header: header(time_ns(0.0)), pose }).unwrap();
            let [a, b] = row.counts;
            let magnetic_field = RosVector3 { x: a, y: b, z: 0.0 };
            let header = header(time_ns(0.4));
            let field = MagneticField { header, magnetic_field, magnetic_field_covariance: [0.0; 9] };
            writer.write("/magnetometer", time_ns(0.4), &field).unwrap();
        }
        writer.finish().unwrap();
    }
    let mut mapping: Value = serde_json::from_slice(&fs::read(example().join("import.json")).unwrap()).unwrap();
    mapping.as_object_mut().unwrap().remove("time");
    mapping["stamps"] = "header".into();
    for axis in ["x", "y", "z"] {
        mapping["pose"][axis] = json!({"column": format!("/flange/pose/position/{axis}"), "unit": "m"});
    }
    let components =
        ["w", "x", "y", "z"].map(|name| (name.to_owned(), format!("/flange/pose/orientation/{name}").into()));
    mapping["pose"]["orientation"] = json!({"quaternion": Value::Object(components.into_iter().collect())});
    let channel = |axis: &str| json!({"column": format!("/magnetometer/magnetic_field/{axis}")});
    mapping["reading"]["channels"] = json!([channel("x"), channel("y")]);
    for recording in mapping["recordings"].as_array_mut().unwrap() {
        recording["file"] = recording["file"].as_str().unwrap().trim_end_matches(".csv").into();
    }
    let path = work.path().join("import.json");
    fs::write(&path, mapping.to_string()).unwrap();
    let from_bag = work.path().join("bag");
    good(&["import", "bag", text(&path), "--space", "--out", text(&from_bag)]);
    let (bag, csv) = (read(&from_bag, "trial_1"), read(&imported(&changed(|_| {})), "trial_1"));
    let mut known = 0;
    for (bag, csv) in bag.truth.instants.iter().zip(&csv.truth.instants) {
        if let (Some(bag), Some(csv)) = (bag.place, csv.place) {
            assert!((bag - csv).norm() < 0.3e-3, "{bag} {csv}");
            known += 1;
        }
    }
    assert!(known > 400, "{known}");
}

/// Moments in the frame of Base need no calibration, and keep their size.
#[test]
fn verif_moments_are_imported_without_a_response() {
    let folder = changed(|mapping| {
        mapping["reading"]["unit"] = "mN mm".into();
        mapping["reading"]["channels"][1]["sign"] = json!(-1);
        for recording in mapping["recordings"].as_array_mut().unwrap() {
            recording["role"] = "trial".into();
        }
    });
    let trace = read(&imported(&folder), "trial_1");
    let recorded = trace.sidecar.recorded.unwrap();
    let unit = Matrix2::new(1e6, 0.0, 0.0, -1e6);
    assert!((recorded.counts_per_n_m.response() - unit).norm() < 1e-6);
    assert_eq!(recorded.residual_counts, [0.0; 2]);
}

#[test]
fn robust_a_mapping_of_the_other_kind_is_named() {
    let folder = changed(|mapping| mapping["format"] = json!(1));
    fails(&folder, &["import.json: format: found 1, expected 2, a mapping in space; without `--space`"]);
    let output = whisker(&["import", "csv", text(&example().join("import.json")), "--out", text(folder.path())]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("format: found 2, expected 1, a mapping in the plane; `--space` imports"), "{errors}");
}

#[test]
fn robust_wrong_values_of_a_mapping_in_space_are_named() {
    let of = |change: fn(&mut Value), words: &[&str]| fails(&changed(change), words);
    of(
        |mapping| mapping["recordings"][1]["face"] = "left".into(),
        &["recordings[1].face: found a value, expected none in space"],
    );
    of(
        |mapping| mapping["reading"]["channels"][1]["column"] = "hall_a".into(),
        &["reading.channels: found `hall_a` twice, expected two bending channels"],
    );
    of(
        |mapping| mapping["reading"]["counts_per_n_m"] = json!([[1e7, 2e7], [2e7, 4e7]]),
        &["reading.counts_per_n_m: found [[10000000.0, 20000000.0]", "a matrix that can be inverted"],
    );
    of(
        |mapping| mapping["contact"]["axis"] = json!([0, 0, 0]),
        &["contact.axis: found [0.0, 0.0, 0.0], expected three numbers, the largest of a size of 1e-6 to 1e6"],
    );
    of(
        |mapping| mapping["contact"].as_object_mut().map_or((), |contact| drop(contact.remove("axis"))),
        &["contact.radius: found a radius without `axis`, expected"],
    );
    of(
        |mapping| mapping["pose"]["orientation"]["quaternion"]["w"] = "flange_x_mm".into(),
        &[
            "calibration_1.csv:2: columns `flange_x_mm`, `flange_qx`",
            "found a quaternion of norm",
            "expected a norm of 1",
        ],
    );
    of(
        |mapping| mapping["base"]["orientation"] = json!({"quaternion": {"w": 2, "x": 0, "y": 0, "z": 0}}),
        &["base.orientation: found a quaternion of norm 2, expected a norm of 1 within 0.01"],
    );
    of(
        |mapping| mapping["pose"]["orientation"]["roll_pitch_yaw"] = json!({}),
        &["found several forms of an orientation, expected one of roll_pitch_yaw, rotation_vector and quaternion"],
    );
    of(|mapping| mapping["pose"]["orientation"] = json!({}), &["found no form of an orientation, expected one of"]);
    of(
        |mapping| mapping["base"]["orientation"] = mapping["pose"]["orientation"].clone(),
        &["base.orientation: found columns, expected constant values"],
    );
    of(
        |mapping| mapping["suspension"] = json!({"yaw_n_m_rad": -1, "pitch_n_m_rad": 1, "twist_n_m_rad": 1}),
        &["suspension.yaw_n_m_rad: found -1, expected a positive number"],
    );
    of(|mapping| mapping["poisson_ratio"] = json!(0.7), &["poisson_ratio: found 0.7, expected"]);
}

#[test]
fn robust_a_calibration_that_does_not_determine_the_response_is_named() {
    let one_side = changed(|mapping| {
        let recordings = mapping["recordings"].as_array_mut().unwrap();
        recordings
            .retain(|recording| ["calibration_1.csv", "trial_1.csv"].iter().any(|name| recording["file"] == *name));
    });
    let words = ["reading.counts_per_n_m: found", "contacts from several directions about the whisker"];
    let folder = changed(|mapping| mapping["contact"]["x"]["unit"] = "m".into());
    fails(
        &folder,
        &["reading.counts_per_n_m: found none, and 0 of", "contacts of the calibration within reach", words[1]],
    );
    fails(&one_side, &words);
}

/// Notes and warnings of an import that succeeds.
fn remarks(folder: &tempfile::TempDir) -> String {
    let out = folder.path().join("traces");
    good(&["import", "csv", text(&folder.path().join("import.json")), "--space", "--out", text(&out)]).1
}

#[test]
fn robust_a_whisker_that_is_mounted_otherwise_is_noticed() {
    let correct = remarks(&changed(|_| {}));
    assert!(correct.contains("deviate by 0."), "{correct}");
    let folder = changed(|mapping| {
        mapping["base"]["orientation"]["roll_pitch_yaw"]["roll"] = json!({"value": 90, "unit": "deg"});
    });
    let found = remarks(&folder);
    for words in [
        "note: rows without a contact, since no contact with the pin agrees with the reading; check",
        "warning: calibration_1: moment_y_n_m, moment_z_n_m: found moments that differ by",
        "; likewise calibration_2, ",
    ] {
        assert!(found.contains(words), "does not contain `{words}`: {found}");
    }
    let (_, notes) = good(&["fit", text(&folder.path().join("traces")), "--model", "polynomial"]);
    assert!(notes.contains("warning: whisker `lab-whisker`: found a held-out RMS of"), "{notes}");
}

#[test]
fn robust_a_whisker_that_is_not_free_at_first_is_noticed() {
    let folder = changed(|mapping| mapping["reading"]["rest_s"] = json!(2.0));
    let found = remarks(&folder);
    for words in [
        "note: trial_1: reading at rest: found a change of",
        "within `rest_s`, expected at most",
        "note: trial_1: reading at rest: found 3",
        "the whisker must be free at the start",
    ] {
        assert!(found.contains(words), "does not contain `{words}`: {found}");
    }
}

#[test]
fn robust_a_trial_without_a_known_contact_is_named_by_the_evaluation() {
    let folder = changed(|mapping| {
        let contact = mapping.as_object_mut().unwrap().remove("contact").unwrap();
        for recording in mapping["recordings"].as_array_mut().unwrap() {
            if recording["role"] == "calibration" {
                recording["contact"] = contact.clone();
            }
        }
    });
    let (traces, results) = (imported(&folder), folder.path().join("results"));
    good(&["fit", text(&traces), "--model", "polynomial"]);
    let evaluate = || good(&["evaluate", text(&traces), "--estimators", "point", "--results", text(&results)]).1;
    let words = "note: not scored, since no known contact lies in the calibrated domain a second after a touch or later: trial_1";
    assert!([evaluate(), evaluate()].iter().all(|notes| notes.contains(words)));
}

#[test]
fn robust_a_known_place_that_is_wrong_is_noticed_by_the_residual() {
    let folder = changed(|_| {});
    let traces = imported(&folder);
    good(&["fit", text(&traces), "--model", "spline"]);
    let calibration = traces.join("calibrations/lab-whisker.json");
    let out = folder.path().join("mounted.json");
    let notes =
        |trace: &Path| good(&["mount", text(trace), "--calibration", text(&calibration), "--out", text(&out)]).1;
    let trial = traces.join("trial_1.csv");
    assert_eq!(notes(&trial), "");
    let mut elsewhere = read(&traces, "trial_1");
    for place in elsewhere.truth.instants.iter_mut().filter_map(|truth| truth.place.as_mut()) {
        place.x += 2e-3;
    }
    elsewhere.sidecar.name = "elsewhere".into();
    elsewhere.write(folder.path()).unwrap();
    let noted = notes(&folder.path().join("elsewhere.csv"));
    assert!(noted.contains("elsewhere: the residual after the correction is "), "{noted}");
}

/// Light touches, in which the whisker is deflected by less than the radius of the pin: the readings tell its side.
#[test]
fn verif_the_side_of_a_thick_pin_follows_from_the_readings() {
    let folder = changed(|_| {});
    let reference = read(&imported(&folder), "trial_1");
    // Rows from the touch on in which the pin has pressed the whisker by less than its radius.
    rewrite(&folder, "trial_1.csv", |line, cells| {
        if line > 64 {
            cells.clear();
        }
    });
    let path = folder.path().join("trial_1.csv");
    let kept: String = fs::read_to_string(&path)
        .unwrap()
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| format!("{line}\n"))
        .collect();
    fs::write(&path, kept).unwrap();
    let trace = read(&imported(&folder), "trial_1");
    let rows = trace.truth.instants.iter().zip(&reference.truth.instants);
    let known: Vec<_> = rows.filter_map(|(found, expected)| Some((found.place?, expected.place?))).collect();
    assert!(known.len() >= 3, "{known:?}");
    assert!(known.iter().all(|(found, expected)| (found - expected).norm() < 1e-4), "{known:?}");
}

#[test]
fn robust_a_single_wrong_orientation_is_named() {
    let folder = changed(|_| {});
    rewrite(&folder, "trial_1.csv", |line, cells| {
        if line == 200 {
            cells.splice(4..8, ["1", "0", "0", "0"].map(Into::into));
        }
    });
    fails(
        &folder,
        &[
            "trial_1.csv:200: columns `flange_qw`",
            "found an orientation 1.745 rad from those of the rows before and after",
        ],
    );
}

#[test]
fn verif_the_sidecar_is_read_again() {
    let folder = changed(|mapping| mapping["poisson_ratio"] = json!(0.3));
    let traces = imported(&folder);
    let sidecar = SpatialSidecar::read(&traces.join("trial_1.json")).unwrap();
    assert_eq!((sidecar.poisson_ratio, sidecar.object.as_str()), (0.3, "pin"));
}

#[test]
fn robust_missing_files_of_a_run_in_space_are_named() {
    let folder = changed(|_| {});
    let (traces, results) = (imported(&folder), folder.path().join("results"));
    good(&["fit", text(&traces), "--model", "polynomial"]);
    good(&["evaluate", text(&traces), "--estimators", "point", "--results", text(&results)]);
    let run = results.join("traces");
    assert!(good(&["check", text(&run)]).0.contains("run in space `traces` of 1 estimators\n"));
    for name in ["space_trials.csv", "space_maps/trial_1.point.glb"] {
        fs::remove_file(run.join(name)).unwrap();
    }
    let words = "space_run.json: found a run without space_trials.csv, space_maps/trial_1.point.glb, expected all files of the run";
    assert_fails(whisker(&["check", text(&run)]), &[words, "run the same `whisker evaluate` again"]);
}

#[test]
fn robust_a_rate_in_space_that_contradicts_the_times_is_noted() {
    let folder = changed(|_| {});
    let (traces, results) = (imported(&folder), folder.path().join("results"));
    good(&["fit", text(&traces), "--model", "polynomial"]);
    let trial = traces.join("trial_1.csv");
    let notes = || {
        let replayed = good(&["replay", text(&trial), "--estimator", "point"]).1;
        let arguments = ["evaluate", text(&traces), "--estimators", "point", "--results", text(&results), "--force"];
        [replayed, good(&arguments).1]
    };
    assert!(notes().iter().all(|notes| !notes.contains("rate_hz")));
    let sidecar = trial.with_extension("json");
    let mut changed: Value = serde_json::from_slice(&fs::read(&sidecar).unwrap()).unwrap();
    changed["rate_hz"] = json!(10.0 * changed["rate_hz"].as_f64().unwrap());
    fs::write(&sidecar, changed.to_string()).unwrap();
    for notes in notes() {
        assert_eq!(notes.matches("note: trial_1: rate_hz: found ").count(), 1, "{notes}");
    }
}
