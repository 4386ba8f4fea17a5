//! Joint encoders: what a robot knows of its own motion.
//!
//! A recording holds the joints as they were. A robot reads them with noise and in steps, and takes the pose of a whisker's base from what it reads. The
//! motion from one instant to the next, which is all that estimators are given of it, is that between two such poses: the rate of a joint is the
//! difference of its last two readings, without a filter, which would lag behind. So noise does not add up on the way, for the poses do not drift; it shakes
//! the base, and by it the contact.

use anyhow::bail;
use nalgebra::{Matrix3, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use trace::{ArrayRecording, JOINTS, JointInstant, PoseMatrix, Recording};
use whisker::estimators::BaseNoise;

use crate::seeds::derived_seed;

/// The encoders of an arm's joints, all alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Encoders {
    /// The step of what they count; 0 for none.
    pub resolution_rad: f64,
    /// Standard deviation of the white noise of an angle, before it is rounded to a step.
    pub noise_rad: f64,
}

impl Encoders {
    /// Checks the settings.
    ///
    /// # Errors
    /// If one is negative or beyond what an encoder can be.
    pub fn validate(&self) -> anyhow::Result<()> {
        for (key, value) in [("resolution_rad", self.resolution_rad), ("noise_rad", self.noise_rad)] {
            if !(0.0..=0.1).contains(&value) {
                bail!("encoders: {key}: found {value}, expected 0 to 0.1");
            }
        }
        Ok(())
    }

    /// Whether they show the joints as they are.
    pub fn are_perfect(&self) -> bool {
        *self == Self::default()
    }

    /// What they are called in names of traces and groups, in plain characters.
    pub fn label(&self) -> String {
        let parts = [("noise", self.noise_rad), ("step", self.resolution_rad)];
        let words = parts.iter().filter(|(_, value)| *value > 0.0).map(|(word, value)| format!("{word}_{value:e}"));
        words.collect::<Vec<_>>().join("_")
    }

    /// Standard deviation of the error of an angle: noise, and the rounding to steps, which is spread evenly over one.
    pub fn sd_rad(&self) -> f64 {
        self.noise_rad.hypot(self.resolution_rad / 12f64.sqrt())
    }

    /// What their data sheet tells of the pose of a base that is mounted at `mount`: the noise that their errors make of it through the body Jacobian, on the
    /// average over a recording. A column of the Jacobian is the twist of the base while that joint alone turns at 1 rad/s.
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

    /// What a robot makes of a trace: the poses and twists of the base that is mounted at `mount`, by what the encoders show. The readings of the joints follow from
    /// the seed and the recording's name, so that they are the same for all whiskers of the arm.
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

    /// Where one base is mounted on the hand, and another beside it.
    const MOUNT: PoseMatrix = mount(0.0);
    const BESIDE: PoseMatrix = mount(0.1);

    const fn mount(x_m: f64) -> PoseMatrix {
        PoseMatrix([1.0, 0.0, 0.0, x_m, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    }

    /// A planar arm of two links and a hand, which stands still.
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

    /// The poses of a base by what encoders show.
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
    fn verif_angles_are_rounded_to_steps() {
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
    fn robust_what_no_encoder_can_be_is_refused() {
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
    fn verif_labels_name_what_is_not_perfect() {
        assert_eq!(NOISY.label(), "noise_2e-4_step_1e-3");
        assert_eq!(Encoders { noise_rad: 0.0, ..NOISY }.label(), "step_1e-3");
        assert_eq!(Encoders::default().label(), "");
        assert!(Encoders::default().are_perfect() && !NOISY.are_perfect());
    }

    /// The hand is rigid: two whiskers on it stay where they are to one another, however the joints are read.
    #[test]
    fn verif_all_whiskers_see_the_same_joints() {
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
    fn val_noise_of_the_base_is_the_scatter_of_its_measured_poses() {
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
        // Each entry in units of what the two numbers that it belongs to scatter; four standard errors of a mean of so many.
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let off = (scatter[(i, j)] - stated[(i, j)]) / (stated[(i, i)] * stated[(j, j)]).sqrt();
            assert!(off.abs() < 4.0 * (2.0 / 4000f64).sqrt(), "{i}, {j}: {scatter} {stated}");
        }
        assert!(Encoders::default().base_noise(&array, &BESIDE).is_none());
    }
}
