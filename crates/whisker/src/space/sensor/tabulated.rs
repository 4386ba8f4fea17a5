//! Expected readings tabulated over the calibrated domain.

use nalgebra::{Matrix2x3, Vector2};

use super::table::{Grid, Table};
use super::{Around, Axis, SpatialPrediction, SpatialRegion};
use crate::frames::Base;
use crate::space::frames::Point;

/// Both bending moments as a table, for models whose formula takes long.
pub(super) struct Tabulated {
    axis: Axis,
    table: Table<2>,
}

impl Tabulated {
    /// Tabulates the moments of contacts (N m), 2x1, which may be computed from the result of a neighbouring contact. `None` if a
    /// contact has none.
    pub(super) fn new<State: Copy>(
        region: &SpatialRegion<'_>,
        mut readings_n_m: impl FnMut(Point<Base>, Option<State>) -> Option<(Vector2<f64>, State)>,
    ) -> Option<Self> {
        let axis = region.domain.axis(&region.whisker.whisker);
        let at_node = |at: Around, near| readings_n_m(at.contact(&axis), near);
        let table = Table::new(Grid::new(region.domain), at_node)?;
        Some(Self { axis, table })
    }

    /// Expected readings and their derivatives by the contact.
    pub(super) fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        let at = Around::of(&self.axis, contact);
        let found = self.table.look(at);
        // Singular only at the whisker's centre of curvature, where the coordinates are not defined.
        let inverse = at.contact_with_jacobian(&self.axis).1.try_inverse().unwrap_or_default();
        SpatialPrediction { reading_n_m: found.values, gradient_n: found.slopes * inverse }
    }

    /// Expected readings (N m), 2x1, and their derivatives by the coordinates about the undeflected whisker (N), 2x3.
    pub(super) fn predict_around(&self, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        let found = self.table.look(at);
        (found.values, found.slopes)
    }
}
