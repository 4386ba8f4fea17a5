//! Shape of a whisker in space at the instants of a replay.

use anyhow::Context;
use nalgebra::Vector3;
use whisker::rod::{Rod, SpatialLoad};

use super::SpatialEstimateRow;
use super::run::SpatialRunWhisker;

/// A whisker of a run, in equilibrium according to the Kirchhoff rod.
#[derive(Clone, Debug)]
pub struct SpatialWire {
    rod: Rod,
    length_m: f64,
    /// Tip of the undeflected whisker in Base.
    tip_m: Vector3<f64>,
}

impl SpatialWire {
    /// The whisker of a run.
    ///
    /// # Errors
    /// If its parameters are invalid.
    pub fn new(whisker: &SpatialRunWhisker) -> anyhow::Result<Self> {
        let SpatialRunWhisker { whisker, suspension, poisson_ratio } = whisker;
        let rod = Rod::new(whisker, (*suspension).into(), *poisson_ratio)
            .with_context(|| format!("whisker `{}`", whisker.name))?;
        let tip = whisker.rest_shape().point(whisker.length_m);
        Ok(Self { rod, length_m: whisker.length_m, tip_m: Vector3::new(tip.x(), tip.y(), 0.0) })
    }

    /// Root and tip of the undeflected whisker in World (m), with the base of `row`.
    pub(super) fn ends_m(&self, row: &SpatialEstimateRow) -> [Vector3<f64>; 2] {
        let root_m = row.base_m();
        [root_m, root_m + row.rotation() * self.tip_m]
    }

    /// Points of the centre line in World (m) at evenly spaced arc lengths from root to tip, with the base of `row` and through a
    /// contact in World, or undeflected without one. `None` if the contact is out of reach.
    pub fn points_m(
        &self,
        row: &SpatialEstimateRow,
        contact: Option<Vector3<f64>>,
        count: usize,
    ) -> Option<Vec<Vector3<f64>>> {
        let (base_m, turn) = (row.base_m(), row.rotation());
        let load = match contact {
            None => SpatialLoad { arc_m: self.length_m, force_n: Vector3::zeros() },
            Some(contact) => self.rod.at_point(turn.inverse() * (contact - base_m)).ok()?.load,
        };
        let line = self.rod.line(load).ok()?;
        let arcs = (0..count).map(|i| self.length_m * i as f64 / (count - 1) as f64);
        Some(arcs.map(|arc_m| base_m + turn * line.at(arc_m)).collect())
    }
}
