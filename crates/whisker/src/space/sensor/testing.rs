//! Whiskers of the tests of sensor models in space.

use super::SpatialWhisker;
use crate::rod::Suspension;
use crate::{Curvature, Whisker};

/// A whisker whose suspension is equally stiff about every axis.
pub(super) fn evenly_suspended(whisker: Whisker) -> SpatialWhisker {
    let k = whisker.root_stiffness_n_m_rad;
    let suspension = Suspension { yaw_n_m_rad: k, pitch_n_m_rad: k, twist_n_m_rad: k };
    SpatialWhisker { whisker, suspension, poisson_ratio: 0.33 }
}

/// A whisker that is bent by a radius of 20 mm near its tip, as a real one.
pub(super) fn hook() -> Whisker {
    let curvature = [(0.037, 0.0), (0.016, 50.0)];
    let curvature = curvature.map(|(length_m, curvature_per_m)| Curvature { length_m, curvature_per_m });
    Whisker { curvature: curvature.into(), length_m: 0.053, ..Whisker::straight() }
}
