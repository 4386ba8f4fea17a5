//! The contact at a known point: the inverse of the forward map.

use nalgebra::{Matrix2x3, Matrix3, Rotation3, Unit, Vector3};

use super::series::Parameter;
use super::{Rate, Rod, SpatialDeflection, SpatialLoad};
use crate::elastica::{Failure, finite, newton};

/// A frictionless contact on the side of the whisker, and its derivatives by its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialContact {
    /// Load on the whisker; the force is across it.
    pub load: SpatialLoad,
    /// Deflection of the whisker.
    pub deflection: SpatialDeflection,
    /// Derivatives of the moment (rows: x, y, z) by the contact's coordinates in Base, in N (N m per m).
    pub moment_gradient_n: Matrix3<f64>,
    /// Derivatives of the force across the whisker, left and up, by the contact's coordinates in Base, in N per m.
    pub force_gradient_n_m: Matrix2x3<f64>,
}

impl Rod {
    /// The contact whose centre line passes through `point` (m, in Base), with a force across the whisker.
    ///
    /// Of several, the one reached from the undeflected whisker when the point turns about the root from there to its place, the
    /// shortest way.
    ///
    /// # Errors
    /// [`Failure::OutOfReach`] or [`Failure::SlippedOff`] if the whisker does not reach the point, [`Failure::Buckled`] if it
    /// snaps before, [`Failure::NotFinite`].
    pub fn at_point(&self, point: Vector3<f64>) -> Result<SpatialContact, Failure> {
        for (what, found) in [("point.x", point.x), ("point.y", point.y), ("point.z", point.z)] {
            finite(what, found)?;
        }
        let radius_m = point.norm();
        newton::within_reach(radius_m, self.length_m)?;
        let arc_m = self.rest.arc_at_radius(radius_m);
        let start = self.rest.point(arc_m).vector().push(0.0);
        let from_m = start.norm();
        let turn = Rotation3::rotation_between(&start, &point).map_or_else(Vector3::zeros, |turn| turn.scaled_axis());
        let way = |share: f64| {
            // Ends exactly at the point, which the rotation would miss by rounding.
            if share == 1.0 {
                return point;
            }
            let direction = Rotation3::new(share * turn) * Unit::new_normalize(start).into_inner();
            direction * (from_m + share * (radius_m - from_m))
        };
        let unloaded = Vector3::new(arc_m, 0.0, 0.0);
        let found = newton::follow(unloaded, |share, guess| self.pass_through(way(share), guess));
        let unknowns = found.map_err(|(reached, last)| newton::lost(reached, last.x, self.length_m))?;
        let arc_m = newton::up_to_the_tip(unknowns.x, self.length_m)?;
        self.contact_of(Vector3::new(arc_m, unknowns.y, unknowns.z)).ok_or(Failure::Buckled { reached: 1.0 })
    }

    /// As [`Self::at_point`], sought from the load of a near contact. The contact may lie beyond the tip, on the whisker's
    /// continuation. `None` if there is none.
    pub(crate) fn near(&self, point: Vector3<f64>, load: Option<SpatialLoad>) -> Option<SpatialContact> {
        let guess = load.map(|load| Vector3::new(load.arc_m, load.force_n.y, load.force_n.z));
        let found = guess.and_then(|guess| self.pass_through(point, guess));
        found.map_or_else(|| self.at_point(point).ok(), |unknowns| self.contact_of(unknowns))
    }

    /// Arc length and force, left and up, of a contact at `goal`.
    fn pass_through(&self, goal: Vector3<f64>, guess: Vector3<f64>) -> Option<Vector3<f64>> {
        newton::solve(guess, self.length_m, |unknowns| {
            let (deflection, rates) = self.press(unknowns)?;
            Some(newton::Equations { residual_m: deflection.point - goal, jacobian: place(&rates) })
        })
    }

    fn press(&self, unknowns: Vector3<f64>) -> Option<(SpatialDeflection, [Rate; 3])> {
        if !newton::may_continue(unknowns.x, self.length_m) {
            return None;
        }
        let by = [Parameter::Arc, Parameter::Force(Vector3::y()), Parameter::Force(Vector3::z())];
        self.respond(load(unknowns), by)
    }

    fn contact_of(&self, unknowns: Vector3<f64>) -> Option<SpatialContact> {
        let (deflection, rates) = self.press(unknowns)?;
        let inverse = place(&rates).try_inverse()?;
        Some(SpatialContact {
            load: load(unknowns),
            deflection,
            moment_gradient_n: Matrix3::from_columns(&rates.map(|rate| rate.moment)) * inverse,
            force_gradient_n_m: inverse.fixed_rows::<2>(1).into_owned(),
        })
    }
}

fn load(unknowns: Vector3<f64>) -> SpatialLoad {
    SpatialLoad { arc_m: unknowns.x, force_n: Vector3::new(0.0, unknowns.y, unknowns.z) }
}

/// Derivatives of a contact's position by arc length and force: columns in the order of the unknowns.
fn place(rates: &[Rate; 3]) -> Matrix3<f64> {
    Matrix3::from_columns(&rates.map(|rate| rate.point))
}
