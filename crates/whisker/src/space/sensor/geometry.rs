//! Geometry of a frictionless contact: direction of the force and tangent of the wire at every contact.
//!
//! Without friction the force is along the normal of the touched surface, so that each contact determines the normal. The
//! directions are those of the nominal whisker ([`crate::rod`]): they depend on the ratio of stiffnesses only, which a
//! calibration of the readings hardly changes.

use nalgebra::{Matrix3, SVector, Vector3};

use super::table::{Grid, Looked, Table};
use super::{Around, SpatialDomain, SpatialWhisker};
use crate::rod::SpatialLoad;

/// Smallest distance from the undeflected whisker at which directions are evaluated: nearer, the force vanishes.
const NEAREST_M: f64 = 20e-6;

/// Directions at a contact, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directions {
    /// Unit normal of the touched surface, out of the object: the direction of the force on the whisker.
    pub normal: Vector3<f64>,
    /// Derivatives of the normal by the coordinates about the whisker (along, left, up), 3x3, in 1/m.
    pub normal_slopes: Matrix3<f64>,
    /// Unit tangent of the wire, towards the tip.
    pub tangent: Vector3<f64>,
    /// Derivatives of the tangent by the same coordinates, 3x3, in 1/m.
    pub tangent_slopes: Matrix3<f64>,
    /// Force on the whisker (N).
    pub force_n: f64,
}

/// Tabulated directions of a whisker.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Force (N) and tangent.
    table: Table<6>,
}

impl Geometry {
    /// The directions over a calibrated domain. At contacts where the nominal whisker has no equilibrium, as may happen at the
    /// border of the domain of a real whisker, they are those of the neighbouring contact nearer to the undeflected whisker. `None`
    /// if the parameters of the whisker are invalid, or if it has no equilibrium even near its undeflected shape.
    pub(super) fn new(whisker: &SpatialWhisker, domain: &SpatialDomain) -> Option<Self> {
        let (rod, axis) = (whisker.rod().ok()?, domain.axis(&whisker.whisker));
        let at_node = |at: Around, near: Option<(SpatialLoad, SVector<f64, 6>)>| {
            let Some(contact) = rod.near(at.contact(&axis).vector(), near.map(|(load, _)| load)) else {
                let (load, values) = near?;
                return Some((values, (load, values)));
            };
            let (force, tangent) = (contact.deflection.force_n, contact.deflection.directors.column(0).into_owned());
            let values = SVector::<f64, 6>::from_fn(|i, _| if i < 3 { force[i] } else { tangent[i - 3] });
            Some((values, (contact.load, values)))
        };
        Some(Self { table: Table::new(Grid::new(domain), at_node)? })
    }

    /// Directions at a contact. Closer to the undeflected whisker than 20 micrometres, those at this distance.
    pub fn at(&self, at: Around) -> Directions {
        let away_m = at.away_m();
        let held = if away_m >= NEAREST_M {
            at
        } else if away_m > 0.0 {
            Around { left_m: at.left_m * NEAREST_M / away_m, up_m: at.up_m * NEAREST_M / away_m, ..at }
        } else {
            Around { left_m: NEAREST_M, ..at }
        };
        let Looked { values, slopes } = self.table.look(held);
        let (normal, normal_slopes, force_n) =
            unit(values.fixed_rows::<3>(0).into_owned(), slopes.fixed_rows::<3>(0).into_owned());
        let (tangent, tangent_slopes, _) =
            unit(values.fixed_rows::<3>(3).into_owned(), slopes.fixed_rows::<3>(3).into_owned());
        Directions { normal, normal_slopes, tangent, tangent_slopes, force_n }
    }
}

/// Direction of a vector, the derivatives of the direction, and the size of the vector.
fn unit(vector: Vector3<f64>, slopes: Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>, f64) {
    let size = vector.norm();
    let (direction, slopes) = (vector / size, slopes / size);
    (direction, slopes - direction * direction.tr_mul(&slopes), size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Whisker;
    use crate::space::sensor::Across;
    use crate::space::sensor::testing::evenly_suspended;

    #[test]
    fn robust_contacts_out_of_reach_have_the_directions_of_those_nearer_to_the_whisker() {
        let whisker = evenly_suspended(Whisker::straight());
        let domain = |away_m: f64| SpatialDomain {
            arc_m: vec![0.04, 0.07],
            directions: 4,
            away_m: vec![away_m; 8],
            across: Across::Normal,
        };
        let [near, far] = [10e-3, 60e-3].map(|away_m| Geometry::new(&whisker, &domain(away_m)).unwrap());
        let (within, beyond) = (Around::new(0.06, 5e-3, 5e-3), Around::new(0.07, 60e-3, 0.0));
        assert!(near.at(within).normal.angle(&far.at(within).normal) < 0.05);
        let Directions { normal, force_n, .. } = far.at(beyond);
        assert!(normal.iter().all(|entry| entry.is_finite()) && force_n > 0.0, "{normal} {force_n}");
    }
}
