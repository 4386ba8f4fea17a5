//! Joint encoders: what a robot knows of its own motion.
//!
//! A recording holds the joints as they were. A robot reads them with noise and in steps, and takes the pose of a whisker's base from what it reads. The
//! motion from one instant to the next, which is all that estimators are given of it, is that between two such poses: the rate of a joint is the
//! difference of its last two readings, without a filter, which would lag behind. So noise does not add up on the way, for the poses do not drift; it shakes
//! the base, and by it the contact.

use anyhow::bail;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use trace::{ArrayRecording, JOINTS, JointInstant, PoseMatrix, Recording};

use crate::front_end::derived_seed;

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
