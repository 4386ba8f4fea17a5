//! Whisker mechanics, sensor models and contact estimators.
//!
//! A whisker is a thin elastic wire on a compliant root ([`Whisker`]). The measured quantity is the bending moment at
//! the root, which depends on the point of contact: a [`sensor`] model, fitted to a calibration, predicts the reading of a
//! contact. The map is many-to-one, so a single reading does not determine the contact; readings along a known motion
//! of the base do, and an [estimator](estimators) computes the contact and its covariance from them, sample by sample.
//!
//! | module | contents |
//! | --- | --- |
//! | [`frames`] | points, poses and twists whose types include their frame |
//! | [`elastica`] | exact quasi-static mechanics of a whisker against points and convex outlines |
//! | [`rod`] | exact quasi-static mechanics in space |
//! | [`sensor`] | sensor models: fit, calibrated domain, model error |
//! | [`space`] | the same in space |
//! | [`events`] | contact detection |
//! | [`estimators`] | estimators of the contact point |
//!
//! The crate reads no files and has no access to ground truth. The Bayesian filters behind the estimators are those of
//! the crate `filters`; the crate `testbed` replays traces through the estimators and scores them.
//!
//! # Example
//! The whisker presses against a pin for one second. The robot knows the motion of its base and the noisy readings; the
//! position of the pin is unknown. The example calibrates a sensor model, replays the samples through the `recommended`
//! estimator, and compares the final estimate with the exact contact. The readings are those of the [elastica] with
//! white noise.
//!
//! ```
//! use std::sync::Arc;
//!
//! use rand::{RngExt, SeedableRng};
//! use rand_distr::StandardNormal;
//! use rand_pcg::Pcg64;
//! use whisker::Whisker;
//! use whisker::elastica::{Circle, Elastica, Failure, Load};
//! use whisker::estimators::{BaseNoise, Estimator, Knowledge, Runner, Sample, estimator};
//! use whisker::events::TouchConfig;
//! use whisker::frames::{Base, Point, Pose, World};
//! use whisker::sensor::{self, Face, FitData};
//!
//! const RATE_HZ: f64 = 250.0;
//! const NOISE_SD_N_M: f64 = 1e-7;
//! const PIN_RADIUS_M: f64 = 0.5e-3;
//!
//! let whisker = Whisker::straight();
//! let exact = Elastica::new(&whisker)?;
//!
//! // Calibration: a pin is pressed against the left face along 24 lines.
//! let line = |arc_m: f64| {
//!     let press = |step: u32| {
//!         let left_n = -8e-5 * f64::from(step) * (0.03 / arc_m).powi(2);
//!         let pressed = exact.deflect(Load { arc_m, along_n: 0.0, left_n, couple_n_m: 0.0 })?;
//!         Ok(sensor::Sample { contact: pressed.point, reading_n_m: pressed.moment_n_m })
//!     };
//!     (0..24).map(press).collect::<Result<Vec<_>, Failure>>()
//! };
//! let lines = (0..24).map(|i| line(0.03 + 0.002 * f64::from(i))).collect::<Result<Vec<_>, _>>()?;
//! let data = FitData {
//!     whisker: &whisker,
//!     face: Face::Left,
//!     measured: &lines,
//!     reference: &lines,
//!     reference_noise_sd_n_m: 0.0,
//!     pin_radius_m: PIN_RADIUS_M + 0.5 * whisker.root_diameter_m,
//! };
//! let model = sensor::model("polynomial")?;
//! let face = sensor::fit(model, &(model.defaults)(), &data)?.face;
//!
//! // Data: the base moves towards the pin for 0.5 s and to and fro for another 0.5 s.
//! let pin = Circle { center: Point::new(0.055, 0.0), radius_m: PIN_RADIUS_M };
//! let base = |row: u32| -> Pose<Base, World> {
//!     let t_s = f64::from(row) / RATE_HZ;
//!     let roam = (t_s - 0.5).max(0.0);
//!     let y_m = 12e-3 * t_s.min(0.5) - 1.5e-3 + 1e-3 * (12.0 * roam).sin();
//!     Pose::new(8e-3 * (8.0 * roam).sin(), y_m, 0.03 * (10.0 * roam).sin())
//! };
//! let mut rng = Pcg64::seed_from_u64(1);
//! let mut samples = Vec::new();
//! for row in 1..=250 {
//!     let contact = exact.against(&pin, &base(row), Face::Left)?;
//!     let moment_n_m = contact.map_or(0.0, |contact| contact.deflection.moment_n_m);
//!     let noise_n_m = NOISE_SD_N_M * rng.sample::<f64, _>(StandardNormal);
//!     samples.push(Sample {
//!         motion: base(row - 1).then(&base(row).inverse()),
//!         dt_s: 1.0 / RATE_HZ,
//!         reading_n_m: moment_n_m + noise_n_m,
//!     });
//! }
//!
//! // Replay through the recommended estimator.
//! let knowledge = Arc::new(Knowledge {
//!     rest: whisker.rest_shape(),
//!     whisker,
//!     faces: vec![Arc::new(face)],
//!     noise_sd_n_m: NOISE_SD_N_M,
//!     base_noise: BaseNoise::default(),
//!     rate_hz: RATE_HZ,
//!     contact_prior: None,
//! });
//! let row = estimator("recommended").expect("a registered name");
//! let method = (row.build)(&(row.defaults)(), &knowledge)?;
//! let mut recommended = Estimator::new(Runner::new(method, knowledge, 1), TouchConfig::default());
//! let estimates = recommended.run(&samples);
//!
//! // Answer: the error of the last estimate and its standard deviation.
//! let estimate = estimates.last().copied().flatten().expect("the whisker touches at the end");
//! let truth = exact.against(&pin, &base(250), Face::Left)?.expect("the whisker touches at the end");
//! let error_m = estimate.contact.distance(&truth.deflection.point);
//! let covariance_m2 = estimate.covariance_m2.expect("the estimator gives a covariance");
//! let sd_m = covariance_m2.trace().sqrt();
//! // error 0.06 mm, standard deviation 0.45 mm, which allows for errors of the calibration
//! println!("error {:.2} mm, standard deviation {:.2} mm", 1e3 * error_m, 1e3 * sd_m);
//! assert!(error_m < 0.2e-3 && sd_m < 0.6e-3);
//! assert!(error_m < 4.0 * sd_m);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod candidates;
mod doubt;
pub mod elastica;
pub mod estimators;
pub mod events;
mod face;
pub mod frames;
mod gate;
mod odds;
mod presets;
mod regained;
mod rest;
pub mod rod;
pub mod sensor;
mod settings;
pub mod space;
mod taylor;
mod wire;

pub use gate::ReadingGate;
pub use rest::{Foot, RestShape};
pub use wire::{Curvature, Invalid, Whisker};
