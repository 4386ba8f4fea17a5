//! Geometry of a rig: the whisker on the printer's bed and the ruler on its head, read from a JSON file.
//!
//! Coordinates are those of the printer: x to the right, y away from the front. The whisker lies along y, its tip to
//! the front. The ruler hangs on the head; its end touches the whisker, and its right side pushes from the whisker's
//! left. `datasets/FORMAT.md` specifies the file.

mod shaft;

use std::path::Path;

use files::{FORMAT, read_json};
use serde::{Deserialize, Serialize};
use strict_json::parse_json;

pub use shaft::{LargestPush, LargestPushes, Limit, Shaft};

use crate::range;

/// Kind of the file.
pub const KIND: &str = "platform_rig";

/// Smallest length (m), speed (mm/min) and strain.
const LEAST: f64 = 1e-6;
/// Largest absolute coordinate or length (m).
const MOST_M: f64 = 10.0;
/// Highest speed of a head (mm/min).
const MOST_MM_MIN: f64 = 100_000.0;
/// Smallest distance of a place from the root, as a share of the whisker's length.
const LEAST_SHARE: f64 = 0.01;
/// Largest strain of a whisker: above the recoverable strain of every elastic material of a whisker.
const MOST_STRAIN: f64 = 0.2;

/// A rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    format: u32,
    kind: String,
    /// Name.
    pub name: String,
    /// Range of the head.
    pub bed: Bed,
    /// The ruler on the head.
    pub ruler: Ruler,
    /// The whisker on the bed.
    #[serde(rename = "whisker")]
    pub shaft: Shaft,
    /// Constants of the routine.
    pub routine: Constants,
}

/// Range of a printer's head.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bed {
    /// Range of x (m).
    pub x_m: [f64; 2],
    /// Range of y (m).
    pub y_m: [f64; 2],
    /// Range of the speed (mm/min).
    pub speed_mm_min: [f64; 2],
}

/// Ruler relative to the nozzle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ruler {
    /// x of its left side (m).
    pub left_m: f64,
    /// Width in x (m).
    pub width_m: f64,
    /// Distance of its end in front of the nozzle (m).
    pub end_m: f64,
}

/// Constants of the routine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constants {
    /// Distance of the first place from the tip (m).
    pub first_from_tip_m: f64,
    /// Clearance between ruler and whisker between two pushes (m).
    pub clearance_m: f64,
    /// Default speed of the head (mm/min).
    pub speed_mm_min: f64,
}

impl Bed {
    /// Range of the speed (m/s).
    pub fn speeds_m_s(&self) -> [f64; 2] {
        self.speed_mm_min.map(|speed| speed / 60e3)
    }
}

impl Rig {
    /// The rig of OpenWhisker, a Prusa i3: `rigs/openwhisker.json`.
    pub fn built_in() -> Self {
        let rig: Self =
            parse_json(include_bytes!("../../../../rigs/openwhisker.json")).expect("the built-in rig parses");
        rig.check(Path::new("rigs/openwhisker.json")).expect("the built-in rig is valid");
        rig
    }

    /// Reads a rig.
    ///
    /// # Errors
    /// [`files::Error`] names the file, and line and column or the key.
    pub fn read(path: &Path) -> Result<Self, files::Error> {
        let rig: Self = read_json(path)?;
        rig.check(path)?;
        Ok(rig)
    }

    /// Default speed of the head (m/s).
    pub fn speed_m_s(&self) -> f64 {
        self.routine.speed_mm_min / 60e3
    }

    /// x of the nozzle at which the ruler, coming from the left, is this far past first contact (m).
    pub fn nozzle_x_m(&self, push_m: f64) -> f64 {
        self.shaft.x_m - self.ruler_right_m() + push_m
    }

    /// y of the nozzle at which the ruler's end is this far from the whisker's root along the undeflected whisker (m).
    pub fn nozzle_y_m(&self, distance_m: f64) -> f64 {
        self.shaft.tip_y_m + self.shaft.length_m - distance_m + self.ruler.end_m
    }

    /// Distance of the ruler's end from the whisker's root for this y of the nozzle (m).
    pub fn distance_m(&self, nozzle_y_m: f64) -> f64 {
        self.shaft.tip_y_m + self.shaft.length_m - (nozzle_y_m - self.ruler.end_m)
    }

    /// Distance of the first place from the root (m).
    pub fn first_distance_m(&self) -> f64 {
        self.shaft.length_m - self.routine.first_from_tip_m
    }

    /// Smallest distance of a place from the root (m): at the root the whisker yields to no push.
    pub(crate) fn least_distance_m(&self) -> f64 {
        LEAST_SHARE * self.shaft.length_m
    }

    /// y of the nozzle on the path to the whisker's left side, in front of the tip (m).
    pub fn front_y_m(&self) -> f64 {
        self.nozzle_y_m(self.shaft.length_m) - self.routine.clearance_m
    }

    /// x of the ruler's right side relative to the nozzle (m): this side pushes.
    pub(crate) fn ruler_right_m(&self) -> f64 {
        self.ruler.left_m + self.ruler.width_m
    }

    fn check(&self, path: &Path) -> Result<(), files::Error> {
        if self.format != FORMAT {
            return Err(files::Error::value(path, "format", self.format, FORMAT));
        }
        if self.kind != KIND {
            return Err(files::Error::value(path, "kind", &self.kind, KIND));
        }
        let Self { bed, ruler, shaft, routine, .. } = self;
        let coordinate = [-MOST_M, MOST_M];
        let positive = [LEAST, MOST_M];
        let speed = [LEAST, MOST_MM_MIN];
        for (key, found, [least, most]) in [
            ("bed.x_m.0", bed.x_m[0], coordinate),
            ("bed.x_m.1", bed.x_m[1], [bed.x_m[0], MOST_M]),
            ("bed.y_m.0", bed.y_m[0], coordinate),
            ("bed.y_m.1", bed.y_m[1], [bed.y_m[0], MOST_M]),
            ("bed.speed_mm_min.0", bed.speed_mm_min[0], speed),
            ("bed.speed_mm_min.1", bed.speed_mm_min[1], [bed.speed_mm_min[0], MOST_MM_MIN]),
            ("ruler.left_m", ruler.left_m, coordinate),
            ("ruler.width_m", ruler.width_m, positive),
            ("ruler.end_m", ruler.end_m, coordinate),
            ("whisker.x_m", shaft.x_m, coordinate),
            ("whisker.tip_y_m", shaft.tip_y_m, coordinate),
            ("whisker.length_m", shaft.length_m, positive),
            ("whisker.root_diameter_m", shaft.root_diameter_m, [LEAST, shaft.length_m]),
            ("whisker.tip_diameter_m", shaft.tip_diameter_m, [LEAST, shaft.root_diameter_m]),
            ("whisker.largest_strain", shaft.largest_strain, [LEAST, MOST_STRAIN]),
            ("routine.first_from_tip_m", routine.first_from_tip_m, [0.0, shaft.length_m - self.least_distance_m()]),
            ("routine.clearance_m", routine.clearance_m, positive),
            ("routine.speed_mm_min", routine.speed_mm_min, bed.speed_mm_min),
        ] {
            if !(least..=most).contains(&found) {
                return Err(files::Error::value(path, key, found, format!("{least} to {most}")));
            }
        }
        self.check_reach(path)
    }

    /// Checks that the head reaches the places before first contact.
    fn check_reach(&self, path: &Path) -> Result<(), files::Error> {
        let first_y_m = self.nozzle_y_m(self.first_distance_m());
        for (key, what, found_m, [least_m, most_m]) in [
            ("whisker.x_m", "left of the whisker, x", self.nozzle_x_m(-self.routine.clearance_m), self.bed.x_m),
            ("whisker.x_m", "at first contact, x", self.nozzle_x_m(0.0), self.bed.x_m),
            ("whisker.tip_y_m", "in front of the tip, y", self.front_y_m(), self.bed.y_m),
            ("whisker.tip_y_m", "at the first place, y", first_y_m, self.bed.y_m),
        ] {
            if !(least_m..=most_m).contains(&found_m) {
                let found = format!("a place of the head {what} = {:.2} mm", 1e3 * found_m);
                let [least, most] = [least_m, most_m].map(|end_m| range::shown(1e3 * end_m));
                let expected = format!("{least} to {most} mm, the range of the bed");
                return Err(files::Error::value(path, key, found, expected));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPENWHISKER: &str = include_str!("../../../../rigs/openwhisker.json");

    fn read(text: &str) -> Result<Rig, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("rig.json");
        std::fs::write(&path, text).expect("written");
        Rig::read(&path).map_err(|error| error.to_string().rsplit('/').next().unwrap_or_default().to_owned())
    }

    #[test]
    fn verif_first_contact_is_at_the_published_position() {
        let rig = Rig::built_in();
        // 56.75 + 35 + 5 mm.
        let y_m = rig.nozzle_y_m(rig.first_distance_m());
        assert!((y_m - 0.09675).abs() < 1e-12);
        assert!((rig.distance_m(y_m) - 0.145).abs() < 1e-12);
        assert_eq!(rig.nozzle_x_m(0.0), 0.150 - (-0.01320 + 0.01620));
        assert_eq!(rig.speed_m_s(), 2.0 / 60.0);
        assert_eq!(rig.bed.speeds_m_s(), [1.0 / 60.0, 0.25]);
    }

    #[test]
    fn verif_the_file_of_the_built_in_rig_is_read_as_it() {
        assert_eq!(read(OPENWHISKER).expect("a rig"), Rig::built_in());
    }

    #[test]
    fn robust_an_invalid_rig_is_refused_with_its_place() {
        let of = |from: &str, to: &str| read(&OPENWHISKER.replace(from, to)).expect_err("refused");
        assert!(of("\"x_m\": 0.150", "\"x_m\": 0.150 5").starts_with("rig.json:16:18: "));
        assert!(of("\"width_m\"", "\"widht_m\"").starts_with("rig.json:12:13: unknown field `widht_m`"));
        assert!(of("\"name\": \"openwhisker\",", "\"name\": \"a\", \"name\": \"b\",").contains("duplicate field"));
        for (from, to, words) in [
            ("\"format\": 1", "\"format\": 2", "rig.json: format: found 2, expected 1"),
            ("platform_rig", "platform_log", "rig.json: kind: found platform_log, expected platform_rig"),
            ("[0.0, 0.250]", "[0.250, 0.0]", "rig.json: bed.x_m.1: found 0, expected 0.25 to 10"),
            (
                "\"length_m\": 0.150",
                "\"length_m\": -0.150",
                "rig.json: whisker.length_m: found -0.15, expected 0.000001 to 10",
            ),
            ("0.0006", "0.006", "rig.json: whisker.tip_diameter_m: found 0.006, expected 0.000001 to 0.003"),
            ("0.025", "2.5", "rig.json: whisker.largest_strain: found 2.5, expected 0.000001 to 0.2"),
            (
                "\"first_from_tip_m\": 0.005",
                "\"first_from_tip_m\": 0.150",
                "rig.json: routine.first_from_tip_m: found 0.15, expected 0 to 0.1485",
            ),
            ("2000.0", "20.0", "rig.json: routine.speed_mm_min: found 20, expected 1000 to 15000"),
            (
                "\"x_m\": 0.150",
                "\"x_m\": 0.010",
                "rig.json: whisker.x_m: found a place of the head left of the whisker, x = -13.00 mm, expected 0 to 250 mm",
            ),
            (
                "\"tip_y_m\": 0.035",
                "\"tip_y_m\": 0.180",
                "rig.json: whisker.tip_y_m: found a place of the head in front of the tip, y = 216.75 mm",
            ),
        ] {
            let error = of(from, to);
            assert!(error.starts_with(words), "{error}");
        }
    }
}
