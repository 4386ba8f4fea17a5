//! The centre line of the loaded whisker in space, for drawing.

use nalgebra::{Matrix3, Vector3};

use super::series::{self, Expansion};
use super::{Failure, Rod, SpatialLoad};
use crate::RestShape;
use crate::rest::direction;

/// The series of one step of the integration.
#[derive(Clone, Debug, PartialEq)]
struct Span {
    around_m: f64,
    from_m: f64,
    expansion: Expansion,
}

/// The centre line of a loaded whisker in space, as exact as the equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialLine {
    /// From the contact to the root.
    spans: Vec<Span>,
    arc_m: f64,
    contact: Vector3<f64>,
    /// From the frame of the contact to Base.
    directors: Matrix3<f64>,
    rest: RestShape,
}

impl Rod {
    /// The centre line under `load`.
    ///
    /// # Errors
    /// Those of [`Self::deflect`].
    pub fn line(&self, load: SpatialLoad) -> Result<SpatialLine, Failure> {
        let deflection = self.deflect(load)?;
        let SpatialLoad { arc_m, force_n } = load;
        let mut spans = Vec::new();
        let visit = |around_m, from_m, expansion| spans.push(Span { around_m, from_m, expansion });
        series::root(&self.stretches, self.compliance_coefficient, self.twist, arc_m, force_n, [], visit)
            .ok_or(Failure::TooStrong { force_n: force_n.norm(), arc_m })?;
        let (contact, directors) = (deflection.point, deflection.directors);
        Ok(SpatialLine { spans, arc_m, contact, directors, rest: self.rest.clone() })
    }
}

impl SpatialLine {
    /// The point (m, in Base) at arc length `arc_m`, from the root (0) to the tip.
    pub fn at(&self, arc_m: f64) -> Vector3<f64> {
        // Beyond the contact the whisker keeps its undeflected shape; up to it the series are those of the contact's frame.
        let offset = if arc_m >= self.arc_m {
            let away = self.rest.point(arc_m).vector() - self.rest.point(self.arc_m).vector();
            let along = direction(self.rest.tangent_rad(self.arc_m));
            Vector3::new(along.dot(&away), along.perp(&away), 0.0)
        } else {
            let index = self.spans.partition_point(|span| span.from_m > arc_m).min(self.spans.len() - 1);
            let span = &self.spans[index];
            span.expansion.section(arc_m - span.around_m).position
        };
        self.contact + self.directors * offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Whisker;
    use crate::elastica::{Elastica, Load};

    const COUNT: usize = 400;

    fn points(line: &SpatialLine, length_m: f64) -> Vec<Vector3<f64>> {
        (0..=COUNT).map(|i| line.at(length_m * i as f64 / COUNT as f64)).collect()
    }

    #[test]
    fn verif_the_line_has_the_length_of_the_wire_and_runs_from_the_root_through_the_contact() {
        for whisker in [Whisker::straight(), Whisker::curved()] {
            let rod = Rod::round(&whisker, 0.33).unwrap();
            let load = SpatialLoad { arc_m: 0.05, force_n: Vector3::new(0.0, -0.01, 0.006) };
            let line = rod.line(load).unwrap();
            assert!(line.at(0.0).norm() < 1e-12 && (line.at(0.05) - rod.deflect(load).unwrap().point).norm() < 1e-12);
            assert!((line.at(0.05 - 1e-12) - line.at(0.05 + 1e-12)).norm() < 1e-11, "it jumps at the contact");
            let chords = points(&line, whisker.length_m).windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum::<f64>();
            assert!((chords / whisker.length_m - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn verif_a_load_in_the_plane_gives_the_planar_line() {
        let whisker = Whisker::curved();
        let line = Rod::round(&whisker, 0.33)
            .unwrap()
            .line(SpatialLoad { arc_m: 0.06, force_n: Vector3::new(0.0, 0.008, 0.0) });
        let planar = Elastica::new(&whisker)
            .unwrap()
            .line(Load { arc_m: 0.06, along_n: 0.0, left_n: 0.008, couple_n_m: 0.0 })
            .unwrap();
        for (i, point) in points(&line.unwrap(), whisker.length_m).iter().enumerate() {
            let expected = planar.at(whisker.length_m * i as f64 / COUNT as f64).0.vector().push(0.0);
            assert!((point - expected).norm() < 1e-12, "{point} instead of {expected}");
        }
    }
}
