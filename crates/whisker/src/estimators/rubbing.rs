//! Extended Kalman filter for a contact with Coulomb friction.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::extended::Extended;
use super::gaussian::{self, Follower};
use super::motion::Rubbing;
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The filter.
    #[serde(with = "gaussian::without_motion")]
    filter: gaussian::Config<Extended>,
    /// Object and friction.
    contact: Rubbing,
}

impl Default for Config {
    /// Hypotheses are dropped later than by `round`: until a contact has slid, friction and a larger radius explain its
    /// readings equally well.
    fn default() -> Self {
        let filter = gaussian::Config { prune_share: 1e-5, ..gaussian::Config::round() };
        Self { filter, contact: Rubbing::default() }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.filter.validate()?;
        self.contact.validate()
    }
}

struct OfRubbing {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    let config = parse(config)?;
    // Fitted here, so that no step has to.
    knowledge.faces.iter().for_each(|face| _ = face.lean(&knowledge.whisker));
    Ok(Box::new(OfRubbing { config, knowledge: knowledge.clone() }))
}

impl Method for OfRubbing {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, contact } = self.config;
        Box::new(Follower::new(filter, contact.beyond_pin(touch.face), touch, &self.knowledge))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::{Circle, Elastica};
    use crate::estimators::Estimate;
    use crate::estimators::testing::{followed, knowledge_of, swept};
    use crate::frames::{Base, Point, Pose, World};

    const STEP_S: f64 = 0.004;
    const STEPS: u32 = 1500;

    /// The base presses and slides to and fro.
    fn base(step: u32) -> Pose<Base, World> {
        let t = f64::from(step) * STEP_S;
        let pressed_m = 6e-3 * (1.0 - (-2.0 * t).exp());
        Pose::new(4e-3 * (2.2 * t).sin(), pressed_m + 2e-3 * (3.1 * t).sin(), 0.03 * (1.7 * t).sin())
    }

    /// The last estimates of sweeps over a circle on a whisker of this pre-curvature, one per seed of the noise; and the root
    /// mean square errors of their second halves.
    fn swept_over(curvature_per_m: f64, radius_m: f64, coefficient: f64, seeds: &[u64]) -> Vec<(Estimate, f64)> {
        let knowledge = Arc::new(Knowledge { noise_sd_n_m: 2e-7, ..knowledge_of(curvature_per_m) });
        let middle = knowledge.rest.beside(0.055, radius_m - 1e-3);
        let circle = Circle { center: Point::from_vector(middle.vector()), radius_m };
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let touches = swept(&elastica, &circle, coefficient, (0..STEPS).map(base));
        let error_of = |seed: &u64| {
            let steps = (0..).map(base).zip(touches.iter().map(|(touch, _)| touch.deflection.moment_n_m));
            let estimates = followed("rubbing", &knowledge, STEP_S, steps, *seed);
            let mut squares = 0.0;
            for ((touch, _), estimate) in touches.iter().zip(&estimates).skip(STEPS as usize / 2) {
                squares += estimate.unwrap().contact.distance(&touch.deflection.point).powi(2);
            }
            let last = estimates.into_iter().flatten().last();
            (last.unwrap(), (2.0 * squares / f64::from(STEPS)).sqrt())
        };
        seeds.iter().map(error_of).collect()
    }

    #[test]
    fn val_the_coefficient_is_that_of_the_exact_whisker() {
        let (mut stated, mut covered) = (0, 0);
        for coefficient in [0.0, 0.2, 0.4, 0.6] {
            let pin = swept_over(12.5, 0.5e-3, coefficient, &[1, 2]);
            let disc = swept_over(12.5, 15e-3, coefficient, &[3, 4]);
            for (estimate, rmse_m) in [pin, disc].concat() {
                assert!(rmse_m < 0.4e-3, "{coefficient}: {rmse_m}");
                let Some(found) = estimate.friction else { continue };
                stated += 1;
                covered += usize::from((found.coefficient - coefficient).abs() < 1.96 * found.sd);
                assert!((found.coefficient - coefficient).abs() < 0.1, "{coefficient}: {found:?}");
            }
        }
        assert!(stated >= 12 && covered * 10 >= stated * 9, "{covered} of {stated}");
    }

    /// On a straight whisker the moment at a given place hardly depends on the direction of the force.
    #[test]
    fn verif_the_coefficient_is_unknown_where_the_readings_do_not_determine_it() {
        for coefficient in [0.0, 0.4] {
            let (estimate, _) = swept_over(0.0, 0.5e-3, coefficient, &[1])[0];
            assert_eq!(estimate.friction, None);
        }
    }
}
