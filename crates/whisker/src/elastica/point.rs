//! The contact at a known point: the inverse of the forward map.

use nalgebra::{Matrix2, Vector2};

use super::newton::{self, Equations};
use super::{Deflection, Elastica, Failure, Load, Parameter, Rate, finite, side};
use crate::face::Face;
use crate::frames::{Base, Point};
use crate::rest::direction;

/// Friction at a contact on the side of the whisker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Ratio of friction to normal force, the tangent of the force's angle to the normal: positive if the friction on
    /// the whisker is towards its tip.
    pub ratio: f64,
}

impl Friction {
    /// No friction.
    pub const NONE: Self = Self { face: Face::Left, ratio: 0.0 };

    /// Force along the whisker per force to its left.
    fn along(self) -> f64 {
        -side(self.face) * self.ratio
    }
}

/// A contact on the side of the whisker, and its derivatives by its position and by the ratio of friction to normal
/// force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointContact {
    /// Load on the whisker.
    pub load: Load,
    /// Deflection of the whisker.
    pub deflection: Deflection,
    /// Derivatives of the moment by the contact's coordinates in Base, in N (N m per m).
    pub moment_gradient_n: Vector2<f64>,
    /// Derivatives of the force across the whisker by the contact's coordinates in Base, in N per m.
    pub force_gradient_n_m: Vector2<f64>,
    /// Derivatives of the tangent's angle at the contact by the contact's coordinates in Base.
    pub tangent_gradient_rad_m: Vector2<f64>,
    /// Derivatives of the contact's arc length by its coordinates in Base.
    pub arc_gradient: Vector2<f64>,
    /// Derivative of the moment by the ratio of friction to normal force, at a fixed position.
    pub moment_by_friction_n_m: f64,
    /// Derivative of the tangent's angle by the ratio, at a fixed position.
    pub tangent_by_friction_rad: f64,
    /// Derivative of the contact's arc length by the ratio, at a fixed position.
    pub arc_by_friction_m: f64,
}

/// Derivatives of a contact's position by arc length and force: columns in the order of the unknowns.
fn place(rates: &[Rate; 2]) -> Matrix2<f64> {
    Matrix2::from_columns(&[rates[0].point, rates[1].point])
}

impl Elastica {
    /// The contact whose centre line passes through `point`, with a force across the whisker.
    ///
    /// Of several, the one reached from the undeflected whisker when the point turns about the root from there to its
    /// place, which for a whisker much stiffer than its root is the rotation of the root.
    ///
    /// # Errors
    /// [`Failure::OutOfReach`] or [`Failure::SlippedOff`] if the whisker does not reach the point, [`Failure::Buckled`] if
    /// it snaps before, [`Failure::NotFinite`].
    pub fn at_point(&self, point: Point<Base>) -> Result<PointContact, Failure> {
        self.at_point_with_friction(point, Friction::NONE)
    }

    /// As [`Self::at_point`], with friction.
    ///
    /// # Errors
    /// Those of [`Self::at_point`].
    pub fn at_point_with_friction(&self, point: Point<Base>, friction: Friction) -> Result<PointContact, Failure> {
        finite("friction.ratio", friction.ratio)?;
        finite("point.x", point.x())?;
        finite("point.y", point.y())?;
        newton::within_reach(point.vector().norm(), self.length_m)?;
        self.point_contact(self.follow_to(point.vector(), friction)?, friction)
    }

    /// As [`Self::at_point`] on the whisker continued beyond its tip; `near` selects the solution if it leads to one.
    pub(crate) fn continued_at_point(
        &self,
        point: Point<Base>,
        near: Option<&Load>,
        friction: Friction,
    ) -> Option<PointContact> {
        let goal = point.vector();
        let unknowns = match near {
            Some(near) => self.pass_through(goal, Vector2::new(near.arc_m, near.left_n), friction),
            None => {
                newton::within_reach(goal.norm(), newton::BEYOND * self.length_m).ok()?;
                self.follow_to(goal, friction).ok()
            }
        };
        self.contact_of(unknowns?, friction)
    }

    /// The point of the undeflected whisker at this distance from the root, or its tip if it does not reach so far.
    pub(crate) fn rest_at_radius(&self, radius_m: f64) -> Point<Base> {
        self.rest.point(self.rest.arc_at_radius(radius_m))
    }

    /// The equilibrium under a force across the whisker, which may be continued beyond its tip.
    pub(crate) fn continued_deflect(&self, load: &Load) -> Option<Deflection> {
        self.respond(*load, []).map(|(deflection, [])| deflection)
    }

    /// Arc length and force of the contact that is reached from the undeflected whisker.
    fn follow_to(&self, goal: Vector2<f64>, friction: Friction) -> Result<Vector2<f64>, Failure> {
        let radius_m = goal.norm();
        let arc_m = self.rest.arc_at_radius(radius_m);
        let start = self.rest.point(arc_m).vector();
        let (from_m, from_rad) = (start.norm(), start.y.atan2(start.x));
        // Left and right are those of the undeflected whisker: the shorter rotation.
        let turn_rad = (start.x * goal.y - start.y * goal.x).atan2(start.dot(&goal));
        let way = |share: f64| {
            // Ends exactly at the point, which sine and cosine would miss by rounding.
            if share == 1.0 {
                goal
            } else {
                direction(from_rad + share * turn_rad) * (from_m + share * (radius_m - from_m))
            }
        };
        let unknowns =
            newton::follow(Vector2::new(arc_m, 0.0), |share, guess| self.pass_through(way(share), guess, friction));
        unknowns.map_err(|(reached, last)| newton::lost(reached, last.x, self.length_m))
    }

    /// As [`Self::at_point`], starting from a nearby contact, such as that of the last sample, which selects the
    /// solution.
    ///
    /// # Errors
    /// Those of [`Self::at_point`], which is used if the nearby contact does not lead to a solution.
    pub fn at_point_near(&self, point: Point<Base>, near: &Load) -> Result<PointContact, Failure> {
        finite("point.x", point.x())?;
        finite("point.y", point.y())?;
        match self.pass_through(point.vector(), Vector2::new(near.arc_m, near.left_n), Friction::NONE) {
            Some(unknowns) => self.point_contact(unknowns, Friction::NONE),
            None => self.at_point(point),
        }
    }

    fn pass_through(&self, goal: Vector2<f64>, guess: Vector2<f64>, friction: Friction) -> Option<Vector2<f64>> {
        newton::solve(guess, self.length_m, |unknowns| {
            let (deflection, rates) = self.press(unknowns, friction)?;
            Some(Equations { residual_m: deflection.point.vector() - goal, jacobian: place(&rates) })
        })
    }

    /// The load of the unknowns, and the parameters of the derivatives by them.
    fn load(&self, unknowns: Vector2<f64>, friction: Friction) -> (Load, [Parameter; 2]) {
        let (arc_m, left_n) = (unknowns.x, unknowns.y);
        let (along, lever_m) = (friction.along(), friction.ratio * self.radius_m(arc_m));
        let load = Load { arc_m, along_n: along * left_n, left_n, couple_n_m: lever_m * left_n };
        let by_arc = Parameter::Arc { couple: friction.ratio * self.radius_slope() * left_n };
        (load, [by_arc, Parameter::Load { along, left: 1.0, couple: lever_m }])
    }

    fn press(&self, unknowns: Vector2<f64>, friction: Friction) -> Option<(Deflection, [Rate; 2])> {
        let arc_m = unknowns.x;
        if !newton::may_continue(arc_m, self.length_m) {
            return None;
        }
        let (load, by) = self.load(unknowns, friction);
        self.respond(load, by)
    }

    fn point_contact(&self, unknowns: Vector2<f64>, friction: Friction) -> Result<PointContact, Failure> {
        let arc_m = newton::up_to_the_tip(unknowns.x, self.length_m)?;
        self.contact_of(Vector2::new(arc_m, unknowns.y), friction).ok_or(Failure::Buckled { reached: 1.0 })
    }

    fn contact_of(&self, unknowns: Vector2<f64>, friction: Friction) -> Option<PointContact> {
        if !newton::may_continue(unknowns.x, self.length_m) {
            return None;
        }
        let (load, [by_arc, by_force]) = self.load(unknowns, friction);
        let by_friction = Parameter::Load {
            along: -side(friction.face) * load.left_n,
            left: 0.0,
            couple: self.radius_m(load.arc_m) * load.left_n,
        };
        let (deflection, [arc, force, rubbing]) = self.respond(load, [by_arc, by_force, by_friction])?;
        let rates = [arc, force];
        let inverse = place(&rates).try_inverse()?;
        // Changes of the unknowns with the ratio that keep the position.
        let kept = -(inverse * rubbing.point);
        let gradient = |by_arc: f64, by_force: f64| inverse.tr_mul(&Vector2::new(by_arc, by_force));
        Some(PointContact {
            load,
            deflection,
            moment_gradient_n: gradient(rates[0].moment, rates[1].moment),
            force_gradient_n_m: gradient(0.0, 1.0),
            tangent_gradient_rad_m: gradient(rates[0].tangent, rates[1].tangent),
            arc_gradient: gradient(1.0, 0.0),
            moment_by_friction_n_m: rubbing.moment + kept.dot(&Vector2::new(arc.moment, force.moment)),
            tangent_by_friction_rad: rubbing.tangent + kept.dot(&Vector2::new(arc.tangent, force.tangent)),
            arc_by_friction_m: kept.x,
        })
    }
}
