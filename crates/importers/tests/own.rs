//! Imports of changed copies of the example of own recordings.

mod common;

use std::fs;

use bag::messages::{Bool, Header, Point, PointStamped, Pose, PoseStamped, WrenchStamped};
use bag::{Publisher, Writer};
use importers::{Imported, importer};
use serde_json::{Value, json};
use trace::{Sidecar, Trace};

use common::Laboratory;

impl Laboratory {
    fn new() -> Self {
        Self::of("own-data")
    }

    /// Changes the cells of a recording, by line from 1.
    fn cells(self, name: &str, change: impl Fn(usize, &mut Vec<String>)) -> Self {
        let path = self.path(name);
        let text = fs::read_to_string(&path).unwrap();
        let line = |(i, line): (usize, &str)| {
            let mut cells: Vec<String> = line.split(',').map(Into::into).collect();
            change(i + 1, &mut cells);
            cells.join(",") + "\n"
        };
        fs::write(&path, text.lines().enumerate().map(line).collect::<String>()).unwrap();
        self
    }

    /// Replaces a reading.
    fn reading(self, name: &str, at: usize, counts: &str) -> Self {
        self.cells(name, |line, cells| {
            if line == at {
                cells[4] = counts.into();
            }
        })
    }

    fn import(&self) -> Result<Imported, String> {
        let result = (importer("csv").unwrap().import)(&self.path("import.json"), &|_, _| {});
        result.map_err(|error| error.to_string())
    }

    /// Asserts that the import, or that of one recording, fails with an error that ends in `words`.
    fn fails(&self, words: &str) {
        let errors = match self.import() {
            Err(error) => vec![error],
            Ok(imported) => imported.failures.iter().map(ToString::to_string).collect(),
        };
        assert!(errors.len() == 1 && errors[0].contains(words), "`{words}`: {errors:?}");
    }
}

fn known(imported: &Imported, name: &str) -> usize {
    trace(imported, name).truth.instants.iter().filter(|truth| truth.contact.is_some()).count()
}

fn trace<'a>(imported: &'a Imported, name: &str) -> &'a Trace {
    imported.traces.iter().find(|trace| trace.sidecar.name == name).unwrap()
}

fn of_calibration(imported: &Imported) -> usize {
    (1..=4).map(|index| known(imported, &format!("calibration_{index}"))).sum()
}

#[test]
fn regress_the_example_has_the_known_contacts_and_threshold_of_before() {
    let imported = Laboratory::new().import().unwrap();
    assert!(imported.failures.is_empty());
    assert_eq!((of_calibration(&imported), known(&imported, "trial_1")), (919, 449));
    let recorded = trace(&imported, "trial_1").sidecar.recorded.as_ref().unwrap();
    let pairs = [
        (recorded.characteristic[0], -29_936_408.937_419_068),
        (recorded.residual_counts, 2.303_107_832_838_619),
        (recorded.noise_sd_n_m, 8.111_466_025_458_73e-8),
        (recorded.touch_counts, 29.58),
    ];
    for (found, expected) in pairs {
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn robust_a_glitch_of_unevenly_spaced_readings_changes_its_neighbourhood_alone() {
    let clean = Laboratory::new().import().unwrap();
    // While the whisker is free and while it touches, in a trial and in a calibration.
    for (name, line) in [("trial_1", 300), ("trial_1", 20), ("calibration_1", 30), ("calibration_1", 200)] {
        for counts in ["65535", "1e8", "-1e8"] {
            let file = format!("{name}.csv");
            let imported = Laboratory::new().reading(&file, line, counts).import().unwrap();
            let place = format!("{name} {line} {counts}");
            assert!(imported.failures.is_empty(), "{place}");
            let value = counts.parse::<f64>().unwrap();
            let note = format!("{file}:{line}: column `hall_counts`: found {value}, the first of 1 such readings");
            assert!(imported.notes.iter().any(|remark| remark.contains(&note)), "{place}: {:?}", imported.notes);
            for (found, expected) in imported.traces.iter().zip(&clean.traces) {
                let (of, at) = (&found.sidecar, found.sidecar.recorded.as_ref().unwrap());
                let before = expected.sidecar.recorded.as_ref().unwrap();
                // Rest is a median, which a single value may shift to the next count.
                assert!((at.rest_counts - before.rest_counts).abs() <= 1.0, "{place}");
                assert!((at.touch_counts / before.touch_counts - 1.0).abs() < 1e-2, "{place}");
                let ratio = at.noise_sd_n_m / before.noise_sd_n_m;
                assert!((0.8..1.25).contains(&ratio), "{place}: {} has {ratio} times the noise", of.name);
                let scale = at.characteristic[0] / before.characteristic[0];
                assert!((scale - 1.0).abs() < 3e-3, "{place}: {scale} times the counts per moment");
                let rows = found.truth.instants.iter().zip(&expected.truth.instants);
                let changed = rows.filter(|(found, expected)| found.contact.is_some() != expected.contact.is_some());
                assert!(changed.count() <= 2, "{place}: {}", of.name);
                let largest_n_m =
                    expected.recording.instants.iter().map(|now| now.moment_z_n_m.abs()).fold(0.0, f64::max);
                let wrong = found.recording.instants.iter().filter(|now| now.moment_z_n_m.abs() > 1.1 * largest_n_m);
                assert!(wrong.count() <= 2, "{place}: {}", of.name);
            }
        }
    }
}

#[test]
fn robust_a_glitch_of_two_samples_in_a_trial_leaves_the_calibration() {
    let clean = Laboratory::new().import().unwrap();
    let laboratory = Laboratory::new().reading("trial_1.csv", 300, "65535").reading("trial_1.csv", 301, "65535");
    let imported = laboratory.import().unwrap();
    for (found, expected) in imported.traces.iter().zip(&clean.traces).take(4) {
        assert_eq!(found.to_csv(), expected.to_csv(), "{}", found.sidecar.name);
    }
}

#[test]
fn robust_moments_that_a_reader_refuses_are_refused() {
    let moments =
        |mapping: &mut Value| mapping["reading"] = json!({"column": "hall_counts", "unit": "N m", "rest_s": 0.3});
    // Far above the weight of any robot, but read again.
    let laboratory = Laboratory::new().mapped(moments).reading("trial_1.csv", 300, "50000");
    let imported = laboratory.import().unwrap();
    let path = trace(&imported, "trial_1").write(laboratory.folder.path()).unwrap();
    assert_eq!(Trace::read(&path).unwrap().to_csv(), trace(&imported, "trial_1").to_csv());
    let laboratory = Laboratory::new().mapped(moments).reading("trial_1.csv", 300, "1000001");
    laboratory
        .fails("trial_1.csv:300: column `hall_counts`: found 1000001 N m, expected a magnitude of at most 1000000 N m");
    let stated = |mapping: &mut Value| mapping["reading"]["characteristic"] = json!([0.01, 0, 0]);
    let laboratory = Laboratory::new().mapped(stated).reading("trial_1.csv", 300, "20512");
    laboratory.fails("trial_1.csv:300: column `hall_counts`: found 2000000 N m from rest, expected a magnitude of at most 1000000 N m");
}

#[test]
fn robust_contacts_beyond_the_range_of_a_trace_are_refused() {
    let far = |mapping: &mut Value| {
        mapping["reading"]["characteristic"] = json!([-3e7, 0, 0]);
        mapping["contact"]["x"] = json!({"value": 600, "unit": "m"});
        mapping["contact"]["radius"] = json!({"value": 500, "unit": "m"});
    };
    let error = Laboratory::new().mapped(far).import().map(drop).unwrap_err();
    assert!(error.contains("contact: found 600 m, 0.12 m, expected magnitudes of at most 499.9"), "{error}");
}

#[test]
fn robust_a_characteristic_without_known_contacts_states_what_is_missing() {
    let trials = |mapping: &mut Value| {
        for recording in mapping["recordings"].as_array_mut().unwrap() {
            recording["role"] = "trial".into();
        }
    };
    Laboratory::new().mapped(trials).fails(
        "import.json: reading.characteristic: found none, and no recording with the role `calibration`, expected recordings with",
    );
    let words = "reading.characteristic: found none, and no known contact in the recordings with the role `calibration` (4), \
                 expected a `contact`, and rows in which the whisker touches it: the reading differs by more than `touch`";
    Laboratory::new().mapped(|mapping| mapping["reading"]["touch"] = json!(1e6)).fails(words);
    Laboratory::new().mapped(|mapping| drop(mapping.as_object_mut().unwrap().remove("contact"))).fails(words);
    let metres = |mapping: &mut Value| mapping["pose"]["x"]["unit"] = "m".into();
    Laboratory::new().mapped(metres).fails("0 of 919 contacts of the calibration within reach of the whisker");
}

/// Example whose trial has a column `touch`: 1 while the whisker touches, else 0, and `cell` in line 300.
fn with_touching(cell: &str) -> Laboratory {
    let laboratory = Laboratory::new().mapped(|mapping| mapping["recordings"][4]["touching"] = "touch".into());
    laboratory.cells("trial_1.csv", |line, cells| {
        cells.push(match line {
            1 => "touch".into(),
            300 => cell.into(),
            _ => "0".into(),
        });
    })
}

#[test]
fn robust_a_column_of_touches_has_the_values_0_and_1_alone() {
    for cell in ["255", "2", "-1", "0.5"] {
        let found = format!("trial_1.csv:300: column `touch`: found {cell}, expected 0, 1 or an empty field");
        with_touching(cell).fails(&found);
    }
    let of = |cell: &str| known(&with_touching(cell).import().unwrap(), "trial_1");
    assert_eq!((of("0"), of("1.0")), (0, 1));
    // The threshold decides, in the row that the missing value would determine.
    assert_eq!(of(""), 1);
}

#[test]
fn robust_wrong_values_of_a_mapping_are_stated_as_in_the_file() {
    let of = |change: fn(&mut Value), words: &str| Laboratory::new().mapped(change).fails(words);
    of(|mapping| mapping["reading"]["rest_s"] = json!(-1), "reading.rest_s: found -1, expected");
    of(|mapping| mapping["reading"]["touch"] = json!(-5), "reading.touch: found -5, expected");
    of(|mapping| mapping["reading"]["degree"] = json!(10), "reading.degree: found 10, expected 1 to 3");
    of(|mapping| mapping["delimiter"] = json!("é"), "delimiter: found `é`, expected an ASCII character");
    of(|mapping| mapping["whisker"]["preset"] = json!(5), "whisker.preset: found 5, expected the name of a preset");
    of(
        |mapping| mapping["contact"]["radius"]["value"] = json!(-1),
        "import.json: contact.radius: found -1 mm, expected a positive radius",
    );
    of(|mapping| mapping["contact"]["y"] = json!({"unit": "mm"}), "import.json: contact.y: found neither");
    let own = |mapping: &mut Value| {
        let mut contact = mapping["contact"].clone();
        contact["radius"]["value"] = json!(0);
        mapping["recordings"][1]["contact"] = contact;
    };
    of(own, "import.json: recordings[1].contact.radius: found 0 mm, expected a positive radius");
}

#[test]
fn robust_the_default_gap_is_longer_than_the_intervals_of_a_low_rate() {
    let slow = Laboratory::new().mapped(|mapping| {
        mapping["rate_hz"] = json!(1);
        mapping["reading"]["characteristic"] = json!([-3e7, 0, 0]);
    });
    let imported = slow.import().unwrap();
    assert_eq!((imported.traces.len(), imported.failures.len()), (5, 0));
    let short = Laboratory::new().mapped(|mapping| mapping["longest_gap_s"] = json!(0.001));
    short.fails("longest_gap_s: found 0.001, expected 0.01, the interval at `rate_hz`, to 60");
}

#[test]
fn robust_the_same_content_twice_is_refused() {
    let twice = |mapping: &mut Value| {
        let again = json!({"file": "again.csv", "role": "calibration", "face": "left"});
        mapping["recordings"].as_array_mut().unwrap().push(again);
    };
    let laboratory = Laboratory::new().mapped(twice);
    fs::copy(laboratory.path("calibration_1.csv"), laboratory.path("again.csv")).unwrap();
    let error = laboratory.import().map(drop).unwrap_err();
    let words =
        "recordings[5].file: found the same content as the recording `calibration_1`, expected each recording once";
    assert!(error.contains(words), "{error}");
}

#[test]
fn robust_a_decimal_comma_is_named() {
    let of = |cell: &str, words: &str| {
        let laboratory = Laboratory::new().mapped(|mapping| mapping["delimiter"] = json!(";"));
        for entry in fs::read_dir(laboratory.folder.path()).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "csv") {
                fs::write(&path, fs::read_to_string(&path).unwrap().replace(',', ";")).unwrap();
            }
        }
        let path = laboratory.path("trial_1.csv");
        let text = fs::read_to_string(&path).unwrap();
        let line = text.lines().nth(1).unwrap();
        let (before, _) = line.rsplit_once(';').unwrap();
        fs::write(&path, text.replacen(line, &format!("{before};{cell}"), 1)).unwrap();
        laboratory.fails(words);
    };
    let words = "trial_1.csv:2: column 5 (hall_counts): found `1699,000000`, expected a number whose decimal separator is a point";
    of("1699,000000", words);
    of("1,699,000", "found `1,699,000`, expected a finite number");
}

#[test]
fn robust_a_recording_in_utf_16_is_named() {
    for order in [u16::to_le_bytes, u16::to_be_bytes] {
        let laboratory = Laboratory::new();
        let path = laboratory.path("trial_1.csv");
        let text = format!("\u{feff}{}", fs::read_to_string(&path).unwrap());
        fs::write(&path, text.encode_utf16().flat_map(order).collect::<Vec<u8>>()).unwrap();
        laboratory.fails("trial_1.csv: encoding: found UTF-16, expected UTF-8");
    }
}

#[test]
fn robust_a_folder_in_place_of_a_recording() {
    let laboratory = Laboratory::new();
    fs::remove_file(laboratory.path("trial_1.csv")).unwrap();
    fs::create_dir(laboratory.path("trial_1.csv")).unwrap();
    laboratory.fails("trial_1.csv: file: found a folder, expected a CSV file");
}

#[test]
fn verif_imported_traces_are_read_again() {
    let laboratory = Laboratory::new();
    let imported = laboratory.import().unwrap();
    for trace in &imported.traces {
        let folder = tempfile::tempdir().unwrap();
        let path = trace.write(folder.path()).unwrap();
        assert_eq!(&Trace::read(&path).unwrap().sidecar, &trace.sidecar);
        Sidecar::read(&path).unwrap();
    }
}

#[test]
fn robust_a_long_interval_that_is_interpolated_is_stated() {
    let laboratory = Laboratory::new();
    let path = laboratory.path("trial_1.csv");
    let stated = || {
        let imported = laboratory.import().unwrap();
        imported.notes.into_iter().filter(|note| note.contains("trial_1: interpolated")).collect::<Vec<_>>()
    };
    assert_eq!(stated(), ["trial_1: interpolated to equal intervals"]);
    let text = std::fs::read_to_string(&path).unwrap();
    let left: Vec<&str> =
        text.lines().enumerate().filter(|(i, _)| !(200..240).contains(i)).map(|(_, line)| line).collect();
    std::fs::write(&path, left.join("\n") + "\n").unwrap();
    let notes = stated();
    assert!(
        notes.len() == 1 && notes[0].contains("up to 0.41") && notes[0].contains("s without a sample"),
        "{notes:?}"
    );
}

/// Readings that a recorder repeats, since the sensor is slower: of each group of `hold` rows, those of its first row.
fn repeated(laboratory: Laboratory, hold: usize) -> Laboratory {
    let text = fs::read_to_string(laboratory.path("trial_1.csv")).unwrap();
    let counts: Vec<String> = text.lines().map(|line| line.split(',').nth(4).unwrap().into()).collect();
    laboratory.cells("trial_1.csv", |line, cells| {
        if line > 1 {
            cells[4] = counts[(line - 2) / hold * hold + 1].clone();
        }
    })
}

/// Noise with a standard deviation of 10 counts, with decimals, added to the readings of the trial.
fn noisy(laboratory: Laboratory, decimals: usize) -> Laboratory {
    laboratory.cells("trial_1.csv", |line, cells| {
        if line > 1 {
            let uniform = |k: usize| (43_758.545_3 * (12.989_8 * (line * 12 + k) as f64).sin()).rem_euclid(1.0);
            let noise = (0..12).map(uniform).sum::<f64>() - 6.0;
            cells[4] = format!("{:.decimals$}", cells[4].parse::<f64>().unwrap() + 10.0 * noise);
        }
    })
}

#[test]
fn robust_the_noise_of_repeated_readings_is_that_of_the_sensor() {
    let of = |laboratory: Laboratory| {
        let imported = laboratory.import().unwrap();
        let recorded = trace(&imported, "trial_1").sidecar.recorded.clone().unwrap();
        let is_noted = imported.notes.iter().any(|note| {
            note.starts_with("trial_1: reading at rest: found ")
                && note.contains("consecutive readings equal, expected")
        });
        (recorded.noise_sd_n_m * recorded.characteristic[0].abs(), is_noted)
    };
    for decimals in [0, 3] {
        for (hold, noted) in [(1, false), (3, true), (4, true)] {
            let (sd, is_noted) = of(repeated(noisy(Laboratory::new(), decimals), hold));
            assert!((6.0..14.0).contains(&sd) && is_noted == noted, "{decimals} {hold}: {sd} {is_noted}");
        }
    }
    // Readings that are equal because the resolution is coarse are those of any sensor.
    let coarse = Laboratory::new().cells("trial_1.csv", |line, cells| {
        if line > 1 {
            cells[4] = (20.0 * (cells[4].parse::<f64>().unwrap() / 20.0).round()).to_string();
        }
    });
    let (sd, is_noted) = of(coarse);
    assert!((5.0..12.0).contains(&sd) && !is_noted, "{sd} {is_noted}");
}

#[test]
fn verif_the_import_in_the_plane_states_its_misfit() {
    let remark = |laboratory: Laboratory| {
        let Imported { notes, warnings, .. } = laboratory.import().unwrap();
        let is_remark = |note: &String| note.contains("(RMS) from those of the elastica");
        [notes, warnings].map(|remarks| remarks.into_iter().filter(is_remark).collect::<Vec<_>>().join("\n"))
    };
    let [good, none] = remark(Laboratory::new());
    assert_eq!(none, "");
    assert!(good.starts_with("the readings of the calibration deviate by 0.") && !good.contains("expected"), "{good}");
    // Of a base that is wrong by 20 mm across the whisker.
    let moved = |mapping: &mut Value| mapping["base"]["y"]["value"] = json!(-30);
    let [none, wrong] = remark(Laboratory::new().mapped(moved));
    assert_eq!(none, "");
    assert!(wrong.contains("expected at most 5 %") && wrong.contains("compare `whisker`"), "{wrong}");
    let stated = |mapping: &mut Value| mapping["reading"]["characteristic"] = json!([-3e7, 0, 0]);
    assert_eq!(remark(Laboratory::new().mapped(stated)), ["", ""]);
}

#[test]
fn robust_implausible_parameters_of_a_whisker_are_refused() {
    for (key, value, expected) in [
        ("length_m", json!(80), "found 80, expected 1e-3 to 1 m; compare the unit"),
        ("root_diameter_m", json!(0.25), "found 0.25, expected 1e-6 to 0.1 m; compare the unit"),
        ("tip_diameter_m", json!(1e-7), "found 0.0000001, expected 1e-6 to 0.1 m; compare the unit"),
        ("youngs_modulus_pa", json!(60), "found 60, expected 1e3 to 1e13 Pa; compare the unit"),
        ("density_kg_m3", json!(64_500), "found 64500, expected 1 to 3e4 kg/m3; compare the unit"),
        ("root_stiffness_n_m_rad", json!(1e7), "found 10000000, expected 1e-9 to 1e6 N m/rad; compare the unit"),
        ("root_stiffness_n_m_rad", json!(-1), "found -1, expected a positive number"),
    ] {
        let change = |mapping: &mut Value| {
            mapping["whisker"][key] = value.clone();
            if key == "length_m" {
                mapping["whisker"]["curvature"] = json!([{"length_m": value, "curvature_per_m": 0}]);
            }
        };
        Laboratory::new().mapped(change).fails(&format!("import.json: whisker.{key}: {expected}"));
    }
}

#[test]
fn robust_a_whisker_that_is_not_a_preset_has_another_name() {
    let of = |whisker: Value| Laboratory::new().mapped(|mapping| mapping["whisker"] = whisker);
    let expected = "expected a name that is not that of a preset, since the parameters differ from it";
    let changed = json!({"preset": "straight", "root_diameter_m": 0.0003});
    of(changed).fails(&format!("import.json: whisker.name: found none, {expected}"));
    of(json!({"preset": "straight", "name": "curved"}))
        .fails(&format!("import.json: whisker.name: found `curved`, {expected}"));
    for good in [json!("straight"), json!({"preset": "straight"}), json!({"preset": "straight", "name": "mine"})] {
        assert!(of(good.clone()).import().is_ok(), "{good}");
    }
}

#[test]
fn robust_wrong_parameters_of_a_whisker_are_stated_with_their_line() {
    let of = |whisker: &str, words: &str| {
        let laboratory = Laboratory::new();
        let path = laboratory.path("import.json");
        let text = fs::read_to_string(&path).unwrap();
        let before = r#"{"preset": "straight", "name": "lab-whisker"}"#;
        assert!(text.contains(before));
        fs::write(&path, text.replace(before, whisker)).unwrap();
        laboratory.fails(words);
        let error = laboratory.import().map(drop).unwrap_err();
        assert!(!error.contains("f64") && !error.contains(":0:0"), "{error}");
    };
    of(
        "{\"preset\": \"straight\",\n\"name\": \"mine\",\n\"length_m\": \"a\"\n}",
        "import.json:6:15: found \"a\", expected a number",
    );
    of(
        "{\"preset\": \"straight\",\n\"diameter_m\": 1,\n\"name\": \"mine\"}",
        "import.json:5:12: unknown field `diameter_m`, expected one of `preset`, `name`",
    );
    of(r#"{"preset": "straight", "name": null}"#, "found null, expected a string");
    of("5", "found 5, expected a `whisker`: the name of a preset, or an object");
    of(r#"{"preset": "none", "name": "mine"}"#, "import.json: whisker.preset: found `none`, expected one of: straight");
    of(
        r#"{"name": "mine"}"#,
        "import.json: whisker.length_m: found none, expected a value, or a `preset` that has one",
    );
    of(
        r#"{"preset": "straight", "name": "mine", "curvature": [[0.08, 0]]}"#,
        "import.json: whisker.curvature[0]: found a list, expected an object",
    );
}

/// A recording of 3 s at 100 Hz, whose flag is published when it changes, and whose contact is missing for one second.
#[test]
fn robust_flags_of_a_bag_are_held_and_contacts_have_gaps() {
    const INTERVAL_NS: u64 = 10_000_000;
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::create(&folder.path().join("trial")).unwrap();
    for row in 0..300 {
        let (time_ns, header) = (row * INTERVAL_NS, Header::default());
        let position = Point { x: 1e-4 * row as f64, ..Point::default() };
        let pose = Pose { position, ..Pose::default() };
        writer.write("/flange", time_ns, &PoseStamped { header: header.clone(), pose }).unwrap();
        writer.write("/wrench", time_ns, &WrenchStamped::default()).unwrap();
        if let Some(data) =
            [(50, false), (120, true), (250, false)].iter().find_map(|(at, data)| (*at == row).then_some(*data))
        {
            writer.write("/touch", time_ns, &Bool { data }).unwrap();
        }
        if row % 5 == 0 && !(151..250).contains(&row) {
            let point = Point { x: 0.05, y: 0.01, z: 0.0 };
            writer.write("/pin", time_ns, &PointStamped { header, point }).unwrap();
        }
    }
    writer.finish().unwrap();
    let mapping = json!({
        "format": 1, "kind": "import", "whisker": "straight", "rate_hz": 100,
        "pose": {"x": {"column": "/flange/pose/position/x", "unit": "m"}, "y": {"value": 0, "unit": "m"}},
        "reading": {"column": "/wrench/wrench/torque/z", "unit": "N m", "noise_sd": 1e-6, "touch": 1},
        "contact": {"x": {"column": "/pin/point/x", "unit": "m"}, "y": {"column": "/pin/point/y", "unit": "m"}},
        "recordings": [{"file": "trial", "role": "trial", "face": "left", "touching": "/touch/data"}],
    });
    let path = folder.path().join("import.json");
    fs::write(&path, mapping.to_string()).unwrap();
    let imported = (importer("bag").unwrap().import)(&path, &|_, _| {}).unwrap();
    assert!(imported.failures.is_empty(), "{:?}", imported.failures);
    let truth = &trace(&imported, "trial").truth.instants;
    assert_eq!(truth.len(), 300);
    for (row, truth) in truth.iter().enumerate() {
        // Before the first flag the threshold decides.
        let flag = (row >= 50).then_some((120..250).contains(&row));
        assert_eq!(truth.touching, flag, "{row}");
        assert_eq!(truth.contact.is_some(), (120..=150).contains(&row), "{row}");
    }
}

#[test]
fn verif_moments_by_a_stated_characteristic_that_is_monotone_over_the_readings() {
    // Monotone for all positive readings, and down to -225 counts.
    let coefficients = [-3e7, 1e12, 0.0];
    let stated = |coefficients: [f64; 3]| {
        let laboratory = Laboratory::new().mapped(|mapping| mapping["reading"]["characteristic"] = json!(coefficients));
        // An even recording keeps its readings.
        laboratory.cells("trial_1.csv", |line, cells| {
            if line > 1 {
                cells[0] = (10 * line).to_string();
            }
        })
    };
    let laboratory = stated(coefficients);
    let imported = laboratory.import().unwrap();
    let trial = trace(&imported, "trial_1");
    let rest = trial.sidecar.recorded.as_ref().unwrap().rest_counts;
    let text = fs::read_to_string(laboratory.path("trial_1.csv")).unwrap();
    for (line, instant) in text.lines().skip(1).zip(&trial.recording.instants) {
        let counts: f64 = line.split(',').nth(4).unwrap().parse().unwrap();
        let moment = instant.moment_z_n_m;
        let found = rest + moment * (coefficients[0] + moment * coefficients[1]);
        assert!((found - counts).abs() < 1e-3, "{found} {counts}");
    }
    let turning = stated([-3e7, -1e12, 0.0]);
    turning.fails("reading.characteristic: found a maximum of 225 counts, expected at least the largest reading, 14");
}
