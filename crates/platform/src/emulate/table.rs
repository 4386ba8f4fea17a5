//! The rig's physics as a table: `rig.csv` and `rig.json`, written by the generator.

use std::path::Path;

use serde::Deserialize;

use crate::Error;
use crate::rig::Shaft;

const COLUMNS: [&str; 6] = ["contact_m", "push_m", "rotation_rad", "slope_rad", "moment_n_m", "force_n"];

/// Static rotation of the whisker's root under the ruler, its ringing, and the magnetometer's response.
#[derive(Clone, Debug)]
pub struct RigTable {
    contacts_m: Vec<f64>,
    pushes_m: Vec<f64>,
    /// Rotation of the root, by contact and push, row by row (rad). `None` if the ruler has slipped off.
    rotations_rad: Vec<Option<f64>>,
    pub(super) ring_hz: f64,
    pub(super) decay_s: f64,
    pub(super) field: Field,
    whisker: Dimensions,
}

/// Keys of `rig.json` that are read; the others document its origin.
#[derive(Deserialize)]
struct Sidecar {
    ring_hz: f64,
    decay_s: f64,
    field: Field,
    whisker: Dimensions,
}

/// Dimensions of the whisker that the table was computed for.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Dimensions {
    length_m: f64,
    root_diameter_m: f64,
    tip_diameter_m: f64,
}

/// Response of the magnetometer: counts = `rest_counts + counts_per_rad` x rotation of the root + noise, modulo 2^16.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(super) struct Field {
    pub(super) rest_counts: [f64; 3],
    pub(super) counts_per_rad: [f64; 3],
    pub(super) noise_sd_counts: f64,
}

impl RigTable {
    /// Table that is built into the program.
    pub fn built_in() -> Self {
        let [csv, json] = ["crates/platform/data/rig.csv", "crates/platform/data/rig.json"].map(Path::new);
        Self::parse(csv, include_str!("../../data/rig.csv"), json, include_str!("../../data/rig.json"))
            .expect("the built-in table is valid")
    }

    /// Parses the two files; the paths are for errors.
    ///
    /// # Errors
    /// [`Error::File`] names file, line and column.
    pub fn parse(csv: &Path, rows: &str, json: &Path, sidecar: &str) -> Result<Self, Error> {
        let Sidecar { ring_hz, decay_s, field, whisker } =
            serde_json::from_str(sidecar).map_err(files::Error::json(json))?;
        for (key, value) in [("ring_hz", ring_hz), ("decay_s", decay_s)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(files::Error::value(json, key, value, "more than zero").into());
            }
        }
        let mut table = Self {
            contacts_m: Vec::new(),
            pushes_m: Vec::new(),
            rotations_rad: Vec::new(),
            ring_hz,
            decay_s,
            field,
            whisker,
        };
        table.fill(csv, rows)?;
        Ok(table)
    }

    /// Checks that the table was computed for this shaft.
    pub(super) fn check_is_of(&self, shaft: &Shaft) -> Result<(), Error> {
        let Dimensions { length_m, root_diameter_m, tip_diameter_m } = self.whisker;
        for (key, found_m, table_m) in [
            ("length_m", shaft.length_m, length_m),
            ("root_diameter_m", shaft.root_diameter_m, root_diameter_m),
            ("tip_diameter_m", shaft.tip_diameter_m, tip_diameter_m),
        ] {
            if found_m != table_m {
                let expected = format!("{table_m}, that of the whisker whose physics is emulated");
                return Err(Error::range(&format!("rig: whisker.{key}"), found_m, expected));
            }
        }
        Ok(())
    }

    fn fill(&mut self, path: &Path, rows: &str) -> Result<(), files::Error> {
        let wrong = |line: usize, place: &str, found: &str, expected: &str| files::Error::Table {
            path: path.into(),
            line: line as u64 + 1,
            place: place.into(),
            found: format!("`{found}`"),
            expected: expected.into(),
        };
        let mut lines = rows.lines().enumerate();
        let (_, header) = lines.next().ok_or_else(|| wrong(0, "header", "nothing", &COLUMNS.join(",")))?;
        if header != COLUMNS.join(",") {
            return Err(wrong(0, "header", header, &COLUMNS.join(",")));
        }
        for (line, row) in lines {
            let cells: Vec<_> = row.split(',').collect();
            let [contact, push, rotation, ..] = cells[..] else { return Err(wrong(line, "row", row, "six fields")) };
            let number = |column: usize, text: &str| {
                let value = text.parse().ok().filter(|value: &f64| value.is_finite());
                value.ok_or_else(|| wrong(line, COLUMNS[column], text, "a number"))
            };
            let (contact_m, push_m) = (number(0, contact)?, number(1, push)?);
            if self.contacts_m.last() != Some(&contact_m) {
                self.contacts_m.push(contact_m);
            }
            if self.contacts_m.len() == 1 {
                self.pushes_m.push(push_m);
            }
            // A full grid: each contact has the pushes of the first one.
            let place = self.rotations_rad.len() % self.pushes_m.len();
            let is_next = self.pushes_m.get(place) == Some(&push_m)
                && self.rotations_rad.len() / self.pushes_m.len() + 1 == self.contacts_m.len();
            if !is_next {
                return Err(wrong(line, "row", row, "a full grid, sorted by contact, then push"));
            }
            self.rotations_rad.push(if rotation.is_empty() { None } else { Some(number(2, rotation)?) });
        }
        let is_rising = |values: &[f64]| values.len() > 1 && values.windows(2).all(|pair| pair[0] < pair[1]);
        let cells = self.contacts_m.len() * self.pushes_m.len();
        if !(is_rising(&self.contacts_m) && is_rising(&self.pushes_m) && self.rotations_rad.len() == cells) {
            let found = format!("{} rows", self.rotations_rad.len());
            return Err(wrong(0, "table", &found, "a full grid of two contacts and two pushes at least, rising"));
        }
        Ok(())
    }

    /// Change of the counts from rest for a contact distance and a push past first contact (m), without noise and
    /// wrap-around. `None` without contact.
    pub fn deflection_counts(&self, contact_m: f64, push_m: f64) -> Option<[f64; 3]> {
        let rotation_rad = self.rotation_rad(contact_m, push_m)?;
        Some(self.field.counts_per_rad.map(|counts_per_rad| counts_per_rad * rotation_rad))
    }

    /// Rotation of the root (rad) for a contact distance and a push past first contact (m), by bilinear interpolation.
    /// `None` without contact: beyond the tip, or slipped off. Larger pushes and smaller distances than those of the
    /// grid are clamped to it.
    pub(super) fn rotation_rad(&self, contact_m: f64, push_m: f64) -> Option<f64> {
        if contact_m > *self.contacts_m.last()? {
            return None;
        }
        let (row, along) = place(&self.contacts_m, contact_m);
        let (column, deep) = place(&self.pushes_m, push_m);
        let node = |row: usize, column: usize| self.rotations_rad[row * self.pushes_m.len() + column];
        let mut sum = 0.0;
        for (row, weight) in [(row, 1.0 - along), (row + 1, along)] {
            for (column, weight) in [(column, weight * (1.0 - deep)), (column + 1, weight * deep)] {
                // A node of zero weight may be `None`.
                if weight > 0.0 {
                    sum += weight * node(row, column)?;
                }
            }
        }
        Some(sum)
    }
}

/// Interval of a value among increasing nodes, and the relative position in it, clamped to the ends.
fn place(nodes: &[f64], value: f64) -> (usize, f64) {
    let below = nodes.partition_point(|node| *node <= value).clamp(1, nodes.len() - 1) - 1;
    (below, ((value - nodes[below]) / (nodes[below + 1] - nodes[below])).clamp(0.0, 1.0))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const JSON: &str = r#"{"ring_hz": 20.0, "decay_s": 0.1, "field": {"rest_counts": [25000, 500, 36000],
        "counts_per_rad": [1000.0, -50000.0, 0.0], "noise_sd_counts": 2.0, "bits": 16},
        "whisker": {"length_m": 0.15, "root_diameter_m": 0.003, "tip_diameter_m": 0.0006}}"#;

    /// The rotation is push over contact; at the tip the ruler slips off at the second node.
    const CSV: &str = "contact_m,push_m,rotation_rad,slope_rad,moment_n_m,force_n\n\
        0.05,0,0,0,0,0\n0.05,0.01,0.2,0,0,0\n0.1,0,0,0,0,0\n0.1,0.01,0.1,0,0,0\n0.15,0,0,0,0,0\n0.15,0.01,,,,\n";

    pub(in crate::emulate) fn parse(csv: &str, json: &str) -> Result<RigTable, Error> {
        RigTable::parse(Path::new("rig.csv"), csv, Path::new("rig.json"), json)
    }

    pub(in crate::emulate) fn small() -> RigTable {
        parse(CSV, JSON).expect("a table")
    }

    #[test]
    fn verif_linear_between_nodes_and_none_beyond() {
        let table = small();
        assert!((table.rotation_rad(0.075, 0.005).expect("touches") - 0.075).abs() < 1e-12);
        assert_eq!(table.rotation_rad(0.05, 0.02), Some(0.2));
        assert_eq!(table.rotation_rad(0.01, 0.01), Some(0.2));
        assert_eq!(table.rotation_rad(0.15, 0.0), Some(0.0));
        assert_eq!(table.rotation_rad(0.15, 0.001), None);
        assert_eq!(table.rotation_rad(0.1501, 0.0), None);
    }

    #[test]
    fn robust_errors_name_the_place() {
        let of_csv = |from: &str, to: &str| parse(&CSV.replace(from, to), JSON).expect_err("refused").to_string();
        let grid = "a full grid, sorted by contact, then push";
        assert_eq!(of_csv("0.1,0.01,0.1", "0.1,x,0.1"), "rig.csv:5: push_m: found `x`, expected a number");
        assert_eq!(
            of_csv("0.1,0.01,0.1", "0.1,0.02,0.1"),
            format!("rig.csv:5: row: found `0.1,0.02,0.1,0,0,0`, expected {grid}")
        );
        assert!(of_csv("contact_m", "contact").starts_with("rig.csv:1: header: found"));
        assert!(of_csv("0.15,0.01,,,,\n", "").starts_with("rig.csv:1: table: found `5 rows`"));
        let json = JSON.replace("20.0", "0.0");
        assert_eq!(
            parse(CSV, &json).expect_err("refused").to_string(),
            "rig.json: ring_hz: found 0, expected more than zero"
        );
    }
}
