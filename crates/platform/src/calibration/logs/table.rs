//! Tables of presses with one distance and one slope each.

use std::path::Path;

use files::Error;

use super::expected_distance;
use crate::calibration::{Features, LabelledPress};

/// Names of distance columns, and their unit in metres.
const DISTANCES: [(&str, f64); 3] = [("distance_m", 1.0), ("distance_mm", 1e-3), ("distance_from_base_mm", 1e-3)];

/// Names of slope columns, and whether their unit is counts/sample.
const SLOPES: [(&str, bool); 3] =
    [("slope_counts_per_s", false), ("slope_counts_per_sample", true), ("min_grad_counts_per_sample", true)];

/// Presses of a table.
pub(super) struct Table {
    pub(super) presses: Vec<LabelledPress>,
    /// Numbers, from 1, of the lines without a distance.
    pub(super) unlabelled: Vec<usize>,
    /// Whether the last line has no line end, and is skipped: a number may lack digits.
    pub(super) is_cut_off: bool,
}

/// Whether a first line is the header of a table of presses.
pub(super) fn is_header(line: &str) -> bool {
    let columns: Vec<&str> = line.trim_end().split(',').collect();
    DISTANCES.iter().any(|(name, _)| columns.contains(name)) && SLOPES.iter().any(|(name, _)| columns.contains(name))
}

/// Reads a table whose header [`is_header`]. The sign of a slope, the direction of the press, is ignored. An empty or
/// `NaN` distance is unknown. A header without a line end is complete.
pub(super) fn read(path: &Path, text: &str, rate_hz: f64) -> Result<Table, Error> {
    let complete = &text[..text.rfind('\n').map_or(text.len(), |end| end + 1)];
    let mut lines = complete.lines();
    let columns: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let place = |name: &str| columns.iter().position(|column| *column == name);
    let of_distance = DISTANCES.iter().find_map(|&(name, metres)| Some((place(name)?, metres)));
    let of_slope = SLOPES.iter().find_map(|&(name, by_sample)| Some((place(name)?, by_sample)));
    let (Some((distance_at, metres)), Some((slope_at, by_sample))) = (of_distance, of_slope) else {
        let expected = "a column of distances and a column of slopes";
        return Err(Error::value(path, "header", columns.join(","), expected));
    };
    let mut table = Table { presses: Vec::new(), unlabelled: Vec::new(), is_cut_off: complete.len() < text.len() };
    for (i, line) in lines.enumerate() {
        let wrong = |place: String, found: String, expected: String| Error::Table {
            path: path.into(),
            line: i as u64 + 2,
            place,
            found,
            expected,
        };
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != columns.len() {
            let found = format!("{} fields", fields.len());
            return Err(wrong("row".into(), found, format!("{} fields", columns.len())));
        }
        let number = |at: usize, expected: &str| {
            let parsed = fields[at].parse::<f64>();
            parsed.map_err(|_| wrong(format!("column {}", columns[at]), format!("`{}`", fields[at]), expected.into()))
        };
        let slope = number(slope_at, "a number")?.abs();
        if !(slope > 0.0 && slope.is_finite()) {
            let found = format!("`{}`", fields[slope_at]);
            return Err(wrong(
                format!("column {}", columns[slope_at]),
                found,
                "a finite slope that is not zero".into(),
            ));
        }
        let distance = if fields[distance_at].is_empty() {
            f64::NAN
        } else {
            number(distance_at, "a distance or an empty field")?
        };
        if distance.is_nan() {
            table.unlabelled.push(i + 2);
            continue;
        }
        if let Some(expected) = expected_distance(metres * distance) {
            let found = format!("`{}`", fields[distance_at]);
            return Err(wrong(format!("column {}", columns[distance_at]), found, expected));
        }
        let slope_counts_per_s = if by_sample { slope * rate_hz } else { slope };
        table.presses.push(LabelledPress {
            log: path.display().to_string(),
            onset_s: None,
            features: Features::of_slope(slope_counts_per_s),
            distance_m: metres * distance,
        });
    }
    Ok(table)
}
