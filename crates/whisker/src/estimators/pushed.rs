//! Extended Kalman filter for an object that stands freely and is pushed along.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::doubt::Search;
use super::extended::Extended;
use super::gaussian::{self, Follower};
use super::motion::Pushed;
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The filter.
    #[serde(with = "gaussian::without_motion")]
    filter: gaussian::Config<Extended>,
    /// Object and friction limit.
    object: Pushed,
}

impl Default for Config {
    /// Innovations are large while the object begins to slide. A jump of the contact would explain them too; the filter therefore
    /// does not search for one.
    fn default() -> Self {
        let filter = gaussian::Config { search: Search::NONE, return_rate: 0.0, ..gaussian::Config::round() };
        Self { filter, object: Pushed::default() }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.filter.validate()?;
        self.object.validate()
    }
}

struct OfPushed {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(OfPushed { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for OfPushed {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, object } = self.config;
        Box::new(Follower::new(filter, object.beyond_pin(touch.face), touch, &self.knowledge))
    }

    fn is_of_fixed_size(&self) -> bool {
        !self.config.filter.search.is_on()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::elastica::{Circle, Elastica};
    use crate::estimators::testing::{followed, knowledge_of, pushed};
    use crate::frames::{Base, Point, Pose, World};

    const STEP_S: f64 = 0.004;
    const STEPS: u32 = 750;

    /// The base presses by 10 mm during the first three quarters of the steps, and then moves back by a quarter of that.
    fn base(step: u32) -> Pose<Base, World> {
        let phase = std::f64::consts::TAU * f64::from(step) / f64::from(STEPS) / 1.5;
        Pose::new(0.0, 5e-3 * (1.0 - phase.cos()), 0.0)
    }

    /// Steps after a displacement by 0.3 mm within which the average must have found out.
    const DELAY: usize = 125;

    /// Force (N) above which the objects slide, less than half of the largest one.
    const LIMIT_N: f64 = 0.2e-3;

    /// Estimates of a press against a circle that slides above a force, from [`DELAY`] after the displacement on, or of the second
    /// half if there is none.
    struct Pressed {
        /// Root mean square error, and the largest one of an estimate without doubt.
        rmse_m: f64,
        silent_m: f64,
        /// Whether the models are in doubt at the end.
        is_doubtful: bool,
        /// Displacement of the circle.
        moved_m: f64,
    }

    /// Presses along the `STEPS` poses of [`base`]. If `held` is not zero, stops at the deepest pose and rests there for `held`
    /// steps.
    fn pressed(name: &str, curvature_per_m: f64, radius_m: f64, limit_n: f64, held: u32) -> Pressed {
        let knowledge = Arc::new(knowledge_of(curvature_per_m));
        let middle = knowledge.rest.beside(0.055, radius_m - 0.1e-3);
        let circle = Circle { center: Point::from_vector(middle.vector()), radius_m };
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let last_step = if held > 0 { 3 * STEPS / 4 } else { STEPS - 1 };
        let at = |step: usize| base((step as u32).min(last_step));
        let touches = pushed(&elastica, &circle, limit_n, (0..(last_step + held) as usize).map(at));
        let displaced = touches.iter().position(|(_, moved_m)| *moved_m > 0.3e-3);
        let since = displaced.map_or(STEPS as usize / 2, |step| step + DELAY);
        let steps = (0..).map(at).zip(touches.iter().map(|(touch, _)| touch.deflection.moment_n_m));
        let estimates = followed(name, &knowledge, STEP_S, steps, 1);
        let moved_m = touches.last().unwrap().1;
        let mut found = Pressed { rmse_m: 0.0, silent_m: 0.0, is_doubtful: false, moved_m };
        for (step, ((touch, _), estimate)) in touches.iter().zip(estimates).enumerate().skip(since) {
            let Some(estimate) = estimate else { panic!("{name}: no estimate at step {step}") };
            let error_m = estimate.contact.distance(&touch.deflection.point);
            found.rmse_m += error_m.powi(2);
            found.silent_m = found.silent_m.max(if estimate.model_doubtful { 0.0 } else { error_m });
            found.is_doubtful = estimate.model_doubtful;
        }
        found.rmse_m = (found.rmse_m / (touches.len() - since) as f64).sqrt();
        found
    }

    #[test]
    fn val_an_object_that_is_pushed_is_followed() {
        for (curvature_per_m, radius_m) in [(0.0, 0.5e-3), (12.5, 0.5e-3), (12.5, 10e-3)] {
            for name in ["pushed", "recommended"] {
                let Pressed { rmse_m, is_doubtful, moved_m, .. } = pressed(name, curvature_per_m, radius_m, LIMIT_N, 0);
                assert!(moved_m > 2e-3, "{moved_m}");
                assert!(rmse_m < 0.3e-3, "{name} {curvature_per_m} {radius_m}: {rmse_m}");
                assert_eq!(is_doubtful, name == "recommended", "{curvature_per_m} {radius_m}");
            }
        }
    }

    /// While the base rests, the readings do not tell an object that was pushed from a fixed one at another place.
    #[test]
    fn verif_a_pushed_object_is_remembered_while_the_base_rests() {
        let Pressed { rmse_m, silent_m, is_doubtful, .. } = pressed("recommended", 12.5, 0.5e-3, LIMIT_N, 2000);
        assert!(rmse_m < 0.3e-3 && silent_m == 0.0 && is_doubtful, "{rmse_m} {silent_m}");
    }

    #[test]
    fn verif_an_object_that_rests_raises_no_doubt() {
        for curvature_per_m in [0.0, 12.5] {
            let Pressed { rmse_m, is_doubtful, moved_m, .. } = pressed("recommended", curvature_per_m, 0.5e-3, 1.0, 0);
            assert!(rmse_m < 0.2e-3 && !is_doubtful && moved_m == 0.0, "{curvature_per_m}: {rmse_m}");
        }
    }
}
