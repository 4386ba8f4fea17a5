//! The preset whiskers against those of the simulator.

use std::path::{Path, PathBuf};

use whisker::{Curvature, Whisker};

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden")
}

/// Whiskers of the table of the simulator's presets, one per row.
fn simulated() -> Vec<Whisker> {
    let path = golden().join("whisker_presets.csv");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let whisker = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells[column].parse::<f64>().unwrap();
        let piece = |piece: &str| {
            let (length, curvature) = piece.split_once(':').unwrap();
            Curvature::new(length.parse().unwrap(), curvature.parse().unwrap())
        };
        Whisker {
            name: cells[0].into(),
            length_m: number(1),
            root_diameter_m: number(2),
            tip_diameter_m: number(3),
            youngs_modulus_pa: number(4),
            density_kg_m3: number(5),
            curvature: cells[6].split(';').map(piece).collect(),
            root_stiffness_n_m_rad: number(7),
            segments: cells[8].parse().unwrap(),
            damping_s: number(9),
        }
    };
    text.lines().skip(1).map(whisker).collect()
}

#[test]
fn val_presets_equal_those_of_the_simulator() {
    let simulated = simulated();
    for preset in [Whisker::straight(), Whisker::curved(), Whisker::stanford()] {
        preset.validate().unwrap();
        let expected = simulated.iter().find(|whisker| whisker.name == preset.name);
        assert_eq!(Some(&preset), expected);
    }
}

#[test]
fn val_the_straight_preset_equals_the_golden_sidecars() {
    for stem in ["golden_pin", "golden_circle"] {
        let text = std::fs::read(golden().join(format!("{stem}.json"))).unwrap();
        let sidecar: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let whisker: Whisker = serde_json::from_value(sidecar["whisker"].clone()).unwrap();
        assert_eq!(Whisker::straight(), whisker, "{stem}");
    }
}
