//! The centre line of the loaded whisker, for drawing and for the detection of further contacts.

use nalgebra::Vector2;

use super::series::{self, Expansion};
use super::{Elastica, Failure, Load, turned};
use crate::RestShape;
use crate::frames::{Base, Point};
use crate::rest::direction;

/// The series of one step of the integration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span {
    around_m: f64,
    from_m: f64,
    expansion: Expansion,
}

/// The centre line of a loaded whisker, as exact as the equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct CenterLine {
    /// From the contact to the root.
    spans: Vec<Span>,
    arc_m: f64,
    contact: Vector2<f64>,
    tangent_rad: f64,
    rest: RestShape,
}

impl Elastica {
    /// The centre line under `load`.
    ///
    /// # Errors
    /// Those of [`Self::deflect`].
    pub fn line(&self, load: Load) -> Result<CenterLine, Failure> {
        let deflection = self.deflect(load)?;
        let mut spans = Vec::new();
        let visit = |around_m, from_m, expansion| spans.push(Span { around_m, from_m, expansion });
        series::root(&self.stretches, self.compliance_coefficient, &load, [], visit).ok_or(load.too_strong())?;
        Ok(CenterLine {
            spans,
            arc_m: load.arc_m,
            contact: deflection.point.vector(),
            tangent_rad: deflection.tangent_rad,
            rest: self.rest.clone(),
        })
    }
}

impl CenterLine {
    /// The point at arc length `arc_m`, from the root (0) to the tip, and the angle of the tangent there.
    pub fn at(&self, arc_m: f64) -> (Point<Base>, f64) {
        // Beyond the contact the whisker keeps its undeflected shape; up to it the series are those of the contact's
        // frame.
        let (offset, angle_rad) = if arc_m >= self.arc_m {
            let turn_rad = -self.rest.tangent_rad(self.arc_m);
            let offset = self.rest.point(arc_m).vector() - self.rest.point(self.arc_m).vector();
            (turned(offset, direction(turn_rad)), self.rest.tangent_rad(arc_m) + turn_rad)
        } else {
            let index = self.spans.partition_point(|span| span.from_m > arc_m).min(self.spans.len() - 1);
            let span = &self.spans[index];
            let state = span.expansion.sum(arc_m - span.around_m);
            (Vector2::new(state.x_m, state.y_m), state.t_rad)
        };
        let point = self.contact + turned(offset, direction(self.tangent_rad));
        (Point::from_vector(point), self.tangent_rad + angle_rad)
    }
}
