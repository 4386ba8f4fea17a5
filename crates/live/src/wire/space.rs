//! Messages of a stream in space.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trace::{SpatialPose, StatedSuspension};
use whisker::Whisker;

use super::{BadLine, Line, MOST_COUNTS, SampleLine, check_magnitudes, check_pose, is_prior, strict, unplaced};

/// Largest difference of a quaternion's length from 1.
const UNIT: f64 = 1e-3;

/// First line of a whisker in space: prior information. Keys of the protocol that the calibration determines are read but not used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialPriorLine {
    /// Version of the protocol.
    pub protocol: u32,
    /// Name of the whisker, if there are several.
    #[serde(default)]
    pub name: Option<String>,
    /// Not used: `particle` takes the seed of its settings.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Readings per second.
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise of each moment. Missing: that of the sensor.
    #[serde(default)]
    pub noise_sd_n_m: Option<f64>,
    /// Duration of the zeroing at the beginning, with a free whisker (s). Missing: [`crate::counts::ZEROING_S`].
    #[serde(default)]
    pub zeroing_s: Option<f64>,
    /// Number of values of a counter that wraps. Missing: the counts do not wrap.
    #[serde(default)]
    pub modulo: Option<f64>,
    /// Parameters of the whisker, which must be those of the calibration.
    #[serde(default)]
    pub whisker: Option<Whisker>,
    /// Springs at its root, likewise.
    #[serde(default)]
    pub suspension: Option<StatedSuspension>,
    /// Poisson ratio of its wire, likewise.
    #[serde(default)]
    pub poisson_ratio: Option<f64>,
    /// Undeflected whisker; not used.
    #[serde(default)]
    pub rest: Option<Value>,
    /// Largest bending moment; not used.
    #[serde(default)]
    pub largest_reading_n_m: Option<f64>,
    /// Calibrated domain; not used.
    #[serde(default)]
    pub domain: Option<Value>,
    /// Shape of the table; not used.
    #[serde(default)]
    pub shape: Option<Value>,
    /// Sensor model; not used.
    #[serde(default)]
    pub table: Option<Value>,
}

/// Reading of a line in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpatialGiven {
    /// Bending moments about y and z of Base (N m), 2x1.
    Moments(Vector2<f64>),
    /// Counts of both channels of the sensor, 2x1.
    Counts(Vector2<f64>),
}

/// Later line in space: a reading, a pose, or both at one time.
pub type SpatialSampleLine = SampleLine<SpatialGiven, SpatialPose>;

/// Line of a stream in space.
pub type SpatialLine = Line<SpatialPriorLine, SpatialGiven, SpatialPose>;

/// All keys of a later line. Those of the protocol that follow from the poses are read but not used.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    #[serde(default)]
    name: Option<String>,
    t_s: f64,
    #[serde(default)]
    moment_y_n_m: Option<f64>,
    #[serde(default)]
    moment_z_n_m: Option<f64>,
    #[serde(default)]
    counts: Option<[f64; 2]>,
    #[serde(default)]
    base_x_m: Option<f64>,
    #[serde(default)]
    base_y_m: Option<f64>,
    #[serde(default)]
    base_z_m: Option<f64>,
    #[serde(default)]
    base_qw: Option<f64>,
    #[serde(default)]
    base_qx: Option<f64>,
    #[serde(default)]
    base_qy: Option<f64>,
    #[serde(default)]
    base_qz: Option<f64>,
    #[serde(default)]
    dt_s: Option<f64>,
    #[serde(default)]
    last_x_m: Option<f64>,
    #[serde(default)]
    last_y_m: Option<f64>,
    #[serde(default)]
    last_z_m: Option<f64>,
    #[serde(default)]
    last_qw: Option<f64>,
    #[serde(default)]
    last_qx: Option<f64>,
    #[serde(default)]
    last_qy: Option<f64>,
    #[serde(default)]
    last_qz: Option<f64>,
    #[serde(default)]
    touched: Option<Value>,
}

/// Parses a line of a stream in space.
///
/// # Errors
/// [`BadLine`] if it is no message.
pub fn parse(line: &str) -> Result<SpatialLine, BadLine> {
    if is_prior(line) {
        return Ok(Line::Prior(Box::new(strict(line)?)));
    }
    let keys: Keys = strict(line)?;
    check_pose(&[("base_x_m", keys.base_x_m), ("base_y_m", keys.base_y_m), ("base_z_m", keys.base_z_m)])?;
    check_magnitudes(&keys.counts.unwrap_or_default().map(|counts| ("counts", Some(counts))), MOST_COUNTS)?;
    let reading = match (keys.moment_y_n_m, keys.moment_z_n_m, keys.counts) {
        (Some(y), Some(z), None) => Some(SpatialGiven::Moments(Vector2::new(y, z))),
        (None, None, Some(counts)) => Some(SpatialGiven::Counts(counts.into())),
        (None, None, None) => None,
        (_, _, Some(_)) => return Err(unplaced("found moments and counts, expected one of the two")),
        _ => return Err(unplaced("found one bending moment, expected both moment_y_n_m and moment_z_n_m")),
    };
    let place = [keys.base_x_m, keys.base_y_m, keys.base_z_m];
    let turn = [keys.base_qw, keys.base_qx, keys.base_qy, keys.base_qz];
    let base = match (place, turn) {
        ([Some(x), Some(y), Some(z)], [Some(w), Some(i), Some(j), Some(k)]) => {
            let turn = Quaternion::new(w, i, j, k);
            if (turn.norm() - 1.0).abs() > UNIT {
                let found = format!("found a quaternion of the length {}, expected a unit quaternion", turn.norm());
                return Err(unplaced(&found));
            }
            Some(SpatialPose { position: Vector3::new(x, y, z), rotation: UnitQuaternion::new_normalize(turn) })
        }
        ([None, None, None], [None, None, None, None]) => None,
        _ => {
            return Err(unplaced(
                "found a part of a pose, expected all of base_x_m, base_y_m, base_z_m, base_qw, base_qx, base_qy and base_qz",
            ));
        }
    };
    if reading.is_none() && base.is_none() {
        return Err(unplaced(
            "found neither a reading nor a pose, expected a reading (moment_y_n_m and moment_z_n_m, or counts), the seven keys of a \
             pose, or both",
        ));
    }
    Ok(Line::Sample(SampleLine { name: keys.name, t_s: keys.t_s, reading, base }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bad(line: &str) -> String {
        parse(line).unwrap_err().to_string()
    }

    #[test]
    fn verif_lines_in_space_are_parsed() {
        let Ok(Line::Sample(row)) = parse(
            r#"{"t_s":1,"dt_s":0.004,"base_x_m":1,"base_y_m":2,"base_z_m":3,"base_qw":0.6,"base_qx":0,"base_qy":0.8,
            "base_qz":0,"last_x_m":0,"last_qw":1,"moment_y_n_m":1e-6,"moment_z_n_m":-2e-6,"touched":true}"#,
        ) else {
            panic!("a sample")
        };
        assert_eq!(row.reading, Some(SpatialGiven::Moments(Vector2::new(1e-6, -2e-6))));
        let base = row.base.expect("a pose");
        assert_eq!((base.position, base.rotation.j), (Vector3::new(1.0, 2.0, 3.0), 0.8));
        let Ok(Line::Sample(row)) = parse(r#"{"t_s": 1, "counts": [512, -3.5]}"#) else { panic!("a sample") };
        assert_eq!((row.reading, row.base), (Some(SpatialGiven::Counts(Vector2::new(512.0, -3.5))), None));
        let prior = parse(r#"{"protocol": 2, "rate_hz": 250, "noise_sd_n_m": 1e-7}"#);
        assert!(matches!(prior, Ok(Line::Prior(prior)) if prior.rate_hz == 250.0 && prior.whisker.is_none()));
    }

    #[test]
    fn robust_lines_that_are_no_messages_in_space_are_refused() {
        assert!(bad(r#"{"t_s": 1}"#).starts_with("found neither a reading nor a pose"));
        assert!(bad(r#"{"t_s": 1, "counts": [1, 2], "moment_y_n_m": 0}"#).starts_with("found moments and counts"));
        assert!(bad(r#"{"t_s": 1, "counts": [1, 1e300]}"#).starts_with("counts: found 1e300, expected a magnitude"));
        assert!(bad(r#"{"t_s": 1, "counts": 5}"#).contains("expected"));
        assert!(bad(r#"{"t_s": 1, "moment_y_n_m": 0}"#).starts_with("found one bending moment"));
        assert!(bad(r#"{"t_s": 1, "base_x_m": 0}"#).starts_with("found a part of a pose"));
        assert!(bad(r#"{"t_s": 1, "reading_n_m": 0}"#).contains("unknown field `reading_n_m`"));
        let long =
            r#"{"t_s":1,"base_x_m":0,"base_y_m":0,"base_z_m":0,"base_qw":2,"base_qx":0,"base_qy":0,"base_qz":0}"#;
        assert!(bad(long).contains("found a quaternion of the length 2"), "{}", bad(long));
    }
}
