//! Joint encoders: measured base motion of a whisker on an arm.
//!
//! A recording contains the exact joint states. Encoders measure them with noise and quantisation, and the pose of a
//! whisker's base follows by forward kinematics. Estimators receive the motion between consecutive measured poses; the
//! rate of a joint is the difference of its last two readings, without a filter and hence without delay. The poses do
//! not drift: the noise does not accumulate, it makes the base and thereby the contact jitter.

use anyhow::bail;
use nalgebra::{Matrix3, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use strict_json::shown_number;
use trace::{ArrayRecording, JOINTS, JointInstant, PoseMatrix, Recording};
use whisker::estimators::BaseNoise;

use crate::seeds::derived_seed;

/// Encoders of an arm's joints, with equal properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Encoders {
    /// Quantisation step; 0 for none.
    pub resolution_rad: f64,
    /// Standard deviation of the white noise of an angle before quantisation.
    pub noise_rad: f64,
}

impl Encoders {
    /// Checks the settings.
    ///
    /// # Errors
    /// If a setting is negative or above 0.1 rad.
    pub fn validate(&self) -> anyhow::Result<()> {
        for (key, value) in [("resolution_rad", self.resolution_rad), ("noise_rad", self.noise_rad)] {
            if !(0.0..=0.1).contains(&value) {
                bail!("encoders: {key}: found {}, expected 0 to 0.1", shown_number(value));
            }
        }
        Ok(())
    }

    /// Whether the encoders are noise-free and unquantised.
    pub fn are_perfect(&self) -> bool {
        *self == Self::default()
    }

    /// Label in names of traces and groups, in plain characters; empty for perfect encoders.
    pub fn label(&self) -> String {
        let parts = [("noise", self.noise_rad), ("step", self.resolution_rad)];
        let words = parts.iter().filter(|(_, value)| *value > 0.0).map(|(word, value)| format!("{word}_{value:e}"));
        words.collect::<Vec<_>>().join("_")
    }

    /// Standard deviation of the error of an angle: noise and quantisation error, which is uniform over one step.
    pub fn sd_rad(&self) -> f64 {
        self.noise_rad.hypot(self.resolution_rad / 12f64.sqrt())
    }

    /// Covariance of the measured pose of a base mounted at `mount`, propagated from the encoders' error through the
    /// body Jacobian and averaged over a recording. Column `i` of the Jacobian is the twist of the base when joint `i`
    /// alone rotates at 1 rad/s.
    pub fn base_noise(&self, array: &ArrayRecording, mount: &PoseMatrix) -> BaseNoise {
        let mut spread = Matrix3::zeros();
        for joint in 0..JOINTS {
            let rates_rad_s = std::array::from_fn(|other| f64::from(u8::from(other == joint)));
            let turning: Vec<JointInstant> =
                array.joints.iter().map(|instant| JointInstant { rates_rad_s, ..*instant }).collect();
            for (_, twist) in array.sidecar.arm.carry(mount, &turning) {
                let column = vector![twist.vx_m_s, twist.vy_m_s, twist.wz_rad_s];
                spread += column * column.transpose();
            }
        }
        BaseNoise(spread * (self.sd_rad().powi(2) / array.joints.len() as f64))
    }

    /// Recording with the measured poses and twists of the base mounted at `mount`. The noise is derived from the seed
    /// and the recording's name, so that all whiskers of the arm have the same joint readings.
    pub fn measured(&self, array: &ArrayRecording, mount: &PoseMatrix, exact: &Recording, seed: u64) -> Recording {
        let carried = array.sidecar.arm.carry(mount, &self.joints(array, seed));
        let mut instants = exact.instants.clone();
        for (instant, (base, twist)) in instants.iter_mut().zip(carried) {
            (instant.base, instant.twist) = (base, Some(twist));
        }
        Recording { instants }
    }

    fn joints(&self, array: &ArrayRecording, seed: u64) -> Vec<JointInstant> {
        let mut rng = Pcg64::seed_from_u64(derived_seed(seed, &["encoders", &array.sidecar.name]));
        let mut last: Option<JointInstant> = None;
        let mut read = |exact: &JointInstant| {
            let angles_rad: [f64; JOINTS] = exact.angles_rad.map(|angle_rad| {
                let noisy_rad = angle_rad + self.noise_rad * rng.sample::<f64, _>(StandardNormal);
                if self.resolution_rad > 0.0 {
                    (noisy_rad / self.resolution_rad).round() * self.resolution_rad
                } else {
                    noisy_rad
                }
            });
            let rates_rad_s = last.map_or([0.0; JOINTS], |last| {
                std::array::from_fn(|joint| (angles_rad[joint] - last.angles_rad[joint]) / (exact.t_s - last.t_s))
            });
            let instant = JointInstant { t_s: exact.t_s, angles_rad, rates_rad_s };
            last = Some(instant);
            instant
        };
        array.joints.iter().map(&mut read).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use serde_json::{Value, json};
    use trace::Instant;
    use whisker::frames::{Base, Pose, World};

    use super::*;

    const NOISY: Encoders = Encoders { resolution_rad: 1e-3, noise_rad: 2e-4 };

    /// Mounts of two bases on the hand.
    const MOUNT: PoseMatrix = mount(0.0);
    const BESIDE: PoseMatrix = mount(0.1);

    const fn mount(x_m: f64) -> PoseMatrix {
        PoseMatrix([1.0, 0.0, 0.0, x_m, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    }

    /// Planar arm of two links and a hand, at rest.
    fn array(rows: usize) -> ArrayRecording {
        let link = |a_m: f64| json!({"a_m": a_m, "alpha_rad": 0.0, "d_m": 0.0});
        let links: Vec<Value> = [0.0, 0.3, 0.25, 0.0, 0.0, 0.0, 0.0].map(link).to_vec();
        let file = json!({"file": "none.csv", "sha256": ""});
        let sidecar = json!({
            "format": 1, "kind": "recording", "name": "scene", "seed": 0, "rate_hz": 250.0, "rows": rows, "whiskers": [],
            "arm": {"name": "planar", "base": MOUNT, "links": links, "flange_d_m": 0.0},
            "objects": [], "joints": file, "poses": file, "scene": {},
            "generator": {"name": "test", "version": "0", "mujoco": null, "git_commit": null, "source_sha256": ""},
            "inputs_sha256": "",
        });
        let instant = |row: usize| JointInstant {
            t_s: row as f64 / 250.0,
            angles_rad: [0.3, 0.9, -0.5, 0.0, 0.0, 0.0, 0.0],
            rates_rad_s: [0.0; JOINTS],
        };
        ArrayRecording {
            sidecar: serde_json::from_value(sidecar).unwrap(),
            joints: (0..rows).map(instant).collect(),
            outlines: Vec::new(),
            moved_m: Vec::new(),
        }
    }

    /// Measured poses of a base.
    fn measured(encoders: Encoders, array: &ArrayRecording, mount: &PoseMatrix, seed: u64) -> Vec<Pose<Base, World>> {
        let exact = array.sidecar.arm.carry(mount, &array.joints);
        let instant = |(joints, (base, twist)): (&JointInstant, _)| Instant {
            t_s: joints.t_s,
            base,
            twist: Some(twist),
            moment_z_n_m: 0.0,
            rotation_z_rad: None,
        };
        let exact = Recording { instants: array.joints.iter().zip(exact).map(instant).collect() };
        encoders.measured(array, mount, &exact, seed).instants.iter().map(|instant| instant.base).collect()
    }

    #[test]
    fn verif_angles_are_quantised() {
        let shown = NOISY.joints(&array(100), 1);
        let steps =
            shown.iter().flat_map(|instant| instant.angles_rad).map(|angle_rad| angle_rad / NOISY.resolution_rad);
        assert!(steps.clone().all(|steps| (steps - steps.round()).abs() < 1e-6));
        let first: Vec<f64> =
            shown.iter().map(|instant| (instant.angles_rad[0] / NOISY.resolution_rad).round()).collect();
        assert!(first.iter().all(|steps| (299.0..=301.0).contains(steps)) && first.contains(&300.0));
        let smooth = Encoders { resolution_rad: 0.0, ..NOISY }.joints(&array(100), 1);
        let errors_rad: Vec<f64> = smooth.iter().map(|instant| instant.angles_rad[1] - 0.9).collect();
        let rms_rad = crate::statistics::rms(&errors_rad).unwrap();
        assert!((rms_rad / NOISY.noise_rad - 1.0).abs() < 0.25, "{rms_rad}");
    }

    #[test]
    fn robust_settings_out_of_range_are_rejected() {
        for (encoders, words) in [
            (Encoders { noise_rad: -1e-3, ..NOISY }, "encoders: noise_rad: found -0.001, expected 0 to 0.1"),
            (Encoders { noise_rad: f64::NAN, ..NOISY }, "encoders: noise_rad: found NaN, expected 0 to 0.1"),
            (Encoders { resolution_rad: 0.2, ..NOISY }, "encoders: resolution_rad: found 0.2, expected 0 to 0.1"),
        ] {
            assert_eq!(encoders.validate().unwrap_err().to_string(), words);
        }
        assert!(NOISY.validate().is_ok() && Encoders::default().validate().is_ok());
    }

    #[test]
    fn verif_labels_state_the_imperfections() {
        assert_eq!(NOISY.label(), "noise_2e-4_step_1e-3");
        assert_eq!(Encoders { noise_rad: 0.0, ..NOISY }.label(), "step_1e-3");
        assert_eq!(Encoders::default().label(), "");
        assert!(Encoders::default().are_perfect() && !NOISY.are_perfect());
    }

    /// The hand is rigid: the relative pose of two whiskers on it is independent of encoder noise.
    #[test]
    fn verif_all_whiskers_share_the_joint_readings() {
        let array = array(50);
        let encoders = Encoders { resolution_rad: 1e-5, ..NOISY };
        let [one, other] = [MOUNT, BESIDE].map(|mount| measured(encoders, &array, &mount, 1));
        for (one, other) in one.iter().zip(&other) {
            let seen = one.inverse().apply(other.origin());
            assert!((seen.x() - 0.1).abs() < 1e-12 && seen.y().abs() < 1e-12, "{seen:?}");
        }
        assert!(one[0] != one[1] && one != measured(encoders, &array, &MOUNT, 2));
    }

    #[test]
    fn val_base_covariance_matches_the_scatter_of_measured_poses() {
        let array = array(4000);
        let encoders = Encoders { resolution_rad: 0.0, noise_rad: 1e-4 };
        let exact = array.sidecar.arm.carry(&BESIDE, &array.joints)[0].0;
        let error = |pose: &Pose<Base, World>| {
            let at = exact.inverse().apply(pose.origin());
            Vector3::new(at.x(), at.y(), pose.yaw_rad() - exact.yaw_rad())
        };
        let errors: Vec<Vector3<f64>> = measured(encoders, &array, &BESIDE, 1).iter().map(error).collect();
        let scatter = errors.iter().map(|error| error * error.transpose()).sum::<Matrix3<f64>>() / errors.len() as f64;
        let BaseNoise(stated) = encoders.base_noise(&array, &BESIDE);
        // Entries are normalised by the standard deviations of their two components; the bound is four standard errors
        // of the sample covariance.
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let off = (scatter[(i, j)] - stated[(i, j)]) / (stated[(i, i)] * stated[(j, j)]).sqrt();
            assert!(off.abs() < 4.0 * (2.0 / 4000f64).sqrt(), "{i}, {j}: {scatter} {stated}");
        }
        assert!(Encoders::default().base_noise(&array, &BESIDE).is_none());
    }
}
