//! Messages of a stream in space.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trace::{SpatialPose, StatedSuspension};
use whisker::Whisker;

use super::{BadLine, Line, SampleLine, check_pose, is_prior, strict, unplaced};

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
    /// Seed for methods that draw random numbers; those in space draw none.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Readings per second.
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise of each moment.
    pub noise_sd_n_m: f64,
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

/// Later line in space: both bending moments about y and z of Base, a pose, or all at one time.
pub type SpatialSampleLine = SampleLine<Vector2<f64>, SpatialPose>;

/// Line of a stream in space.
pub type SpatialLine = Line<SpatialPriorLine, Vector2<f64>, SpatialPose>;

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
    let reading = match (keys.moment_y_n_m, keys.moment_z_n_m) {
        (Some(y), Some(z)) => Some(Vector2::new(y, z)),
        (None, None) => None,
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
            "found neither readings nor a pose, expected moment_y_n_m and moment_z_n_m, or the seven keys of a pose, or all",
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
        assert_eq!(row.reading, Some(Vector2::new(1e-6, -2e-6)));
        let base = row.base.expect("a pose");
        assert_eq!((base.position, base.rotation.j), (Vector3::new(1.0, 2.0, 3.0), 0.8));
        let prior = parse(r#"{"protocol": 2, "rate_hz": 250, "noise_sd_n_m": 1e-7}"#);
        assert!(matches!(prior, Ok(Line::Prior(prior)) if prior.rate_hz == 250.0 && prior.whisker.is_none()));
    }

    #[test]
    fn robust_lines_that_are_no_messages_in_space_are_refused() {
        assert!(bad(r#"{"t_s": 1}"#).starts_with("found neither readings nor a pose"));
        assert!(bad(r#"{"t_s": 1, "moment_y_n_m": 0}"#).starts_with("found one bending moment"));
        assert!(bad(r#"{"t_s": 1, "base_x_m": 0}"#).starts_with("found a part of a pose"));
        assert!(bad(r#"{"t_s": 1, "reading_n_m": 0}"#).contains("unknown field `reading_n_m`"));
        let long =
            r#"{"t_s":1,"base_x_m":0,"base_y_m":0,"base_z_m":0,"base_qw":2,"base_qx":0,"base_qy":0,"base_qz":0}"#;
        assert!(bad(long).contains("found a quaternion of the length 2"), "{}", bad(long));
    }
}
