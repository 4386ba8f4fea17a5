//! Expected readings tabulated over the calibrated domain.

use nalgebra::{Matrix2x3, Vector2};

use super::table::{Grid, Table};
use super::{Around, Axis, SpatialPrediction, SpatialRegion};
use crate::frames::Base;
use crate::space::frames::Point;

/// Both bending moments, tabulated for models whose formula takes long to evaluate.
pub(super) struct Tabulated {
    axis: Axis,
    table: Table<2>,
}

impl Tabulated {
    /// Tabulates the moments of contacts (N m), 2x1, which may be computed from the result of a neighbouring contact. `None` if the
    /// moments of a contact do not exist.
    pub(super) fn new<State: Copy + Send>(
        region: &SpatialRegion<'_>,
        readings_n_m: impl Fn(Point<Base>, Option<State>) -> Option<(Vector2<f64>, State)> + Sync,
    ) -> Option<Self> {
        let axis = region.domain.axis(&region.whisker.whisker);
        let at_node = |at: Around, near| readings_n_m(at.contact(&axis), near);
        let table = Table::new(Grid::new(region.domain), at_node)?;
        Some(Self { axis, table })
    }

    /// Expected readings and their derivatives by the contact.
    pub(super) fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        let at = Around::of(&self.axis, contact);
        SpatialPrediction::around(&self.axis, at, self.predict_around(at))
    }

    /// Expected readings (N m), 2x1, and their derivatives by the coordinates about the undeflected whisker (N), 2x3.
    pub(super) fn predict_around(&self, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        let found = self.table.look(at);
        (found.values, found.slopes)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::space::sensor::testing::{evenly_suspended, hook};
    use crate::space::sensor::{Across, SpatialDomain};

    #[test]
    fn verif_predictions_across_the_chord_are_those_of_the_tabulated_function() {
        let whisker = evenly_suspended(hook());
        let domain =
            SpatialDomain { arc_m: vec![0.03, 0.053], directions: 4, away_m: vec![25e-3; 8], across: Across::Chord };
        let axis = domain.axis(&whisker.whisker);
        let exact = |contact: Point<Base>| {
            let [x, y, z] = contact.vector().into();
            Vector2::new((20.0 * y).sin() + x, 30.0 * x * z)
        };
        let region = SpatialRegion { whisker: &whisker, domain: &domain };
        let tabulated = Tabulated::new(&region, |contact, _: Option<()>| Some((exact(contact), ()))).unwrap();
        // The second contact lies beyond the whisker's radius of curvature.
        for at in [Around::new(0.04, 3e-3, -2e-3), Around::new(0.05, 22e-3, 4e-3)] {
            let contact = at.contact(&axis);
            let SpatialPrediction { reading_n_m, gradient_n } = tabulated.predict(contact);
            assert!((reading_n_m - exact(contact)).norm() < 1e-4, "{at:?}: {reading_n_m} {}", exact(contact));
            for entry in 0..3 {
                let step = 1e-6 * Vector3::ith(entry, 1.0);
                let slope = (exact(contact.shifted(step)) - exact(contact.shifted(-step))) / 2e-6;
                assert!((gradient_n.column(entry) - slope).norm() < 2e-2, "{at:?} {entry}: {gradient_n} {slope}");
            }
        }
    }
}
