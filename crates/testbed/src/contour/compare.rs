//! A contour beside the true outline, unaligned.

use nalgebra::Vector2;
use trace::Outline;
use whisker::frames::{Point, World};

use super::{Contour, Vertex, touched_stretch};
use crate::statistics::{mean, quantile};

/// Both outlines are compared at points no farther apart than this.
const STEP_M: f64 = 1e-4;

/// How far a contour lies from the true outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean distance of the contour's points from the true outline.
    pub mean_m: f64,
    /// 95th percentile of those distances.
    pub p95_m: f64,
    /// The largest of those distances and of the distances of the touched part of the true outline from the contour; nothing where it is not known what
    /// was touched.
    pub hausdorff_m: Option<f64>,
    /// Share of the contour's points whose 95 % band reaches the true outline; nothing where the contour has none.
    pub band_coverage: Option<f64>,
}

impl Comparison {
    /// Lays a contour beside the true outline, of which `touched` are the places that were truly touched.
    pub fn new(contour: &Contour, outline: &Outline, touched: &[Point<World>]) -> Self {
        let points = sampled(contour);
        let distances_m: Vec<f64> = points.iter().map(|point| outline.distance_m(point.at)).collect();
        let covered: Option<Vec<f64>> = points
            .iter()
            .zip(&distances_m)
            .map(|(p, &m)| p.half_band_m().map(|half_m| f64::from(m <= half_m)))
            .collect();
        let worst_m = |distances_m: &[f64]| distances_m.iter().copied().reduce(f64::max);
        let plain = |point: &Point<World>| (point.x(), point.y());
        let true_outline: Vec<(f64, f64)> = outline.vertices().iter().map(plain).collect();
        let stretch = touched_stretch(&true_outline, touched.iter().map(plain));
        let missed_m: Vec<f64> = along(&stretch).map(|at| contour.distance_m(at)).collect();
        Self {
            mean_m: mean(distances_m.iter().copied()).unwrap_or_default(),
            p95_m: quantile(&distances_m, 0.95).unwrap_or_default(),
            hausdorff_m: worst_m(&missed_m).zip(worst_m(&distances_m)).map(|(missed_m, off_m)| missed_m.max(off_m)),
            band_coverage: covered.and_then(mean),
        }
    }
}

impl Contour {
    /// Distance from a point to the contour.
    fn distance_m(&self, point: Vector2<f64>) -> f64 {
        let at = |vertex: &Vertex| (vertex.at.vector() - point).norm();
        let vertices = self.vertices.iter().map(at);
        let edges = self.vertices.windows(2).map(|edge| {
            let (a, b) = (edge[0].at.vector(), edge[1].at.vector());
            let way = b - a;
            let part = ((point - a).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            (a + way * part - point).norm()
        });
        vertices.chain(edges).fold(f64::INFINITY, f64::min)
    }
}

/// The contour's vertices with points between them, each with a band between those of its neighbours.
fn sampled(contour: &Contour) -> Vec<Vertex> {
    let between = contour.vertices.windows(2).flat_map(|edge| {
        let (from, to) = (edge[0], edge[1]);
        parts(from.at.distance(&to.at)).map(move |part| Vertex {
            at: from.at.shifted((to.at.vector() - from.at.vector()) * part),
            normal_rad: from.normal_rad,
            sd_m: from.sd_m.zip(to.sd_m).map(|(from_m, to_m)| from_m + part * (to_m - from_m)),
            touched: from.touched && to.touched,
        })
    });
    between.chain(contour.vertices.last().copied()).collect()
}

/// Points along a line.
fn along(line: &[(f64, f64)]) -> impl Iterator<Item = Vector2<f64>> {
    let at = |&(x, y): &(f64, f64)| Vector2::new(x, y);
    let between = line.windows(2).flat_map(move |edge| {
        let (from, to) = (at(&edge[0]), at(&edge[1]));
        parts((to - from).norm()).map(move |part| from + (to - from) * part)
    });
    between.chain(line.last().map(at))
}

/// Where an edge is sampled, from its beginning to before its end.
fn parts(length_m: f64) -> impl Iterator<Item = f64> {
    let count = (length_m / STEP_M).ceil().max(1.0);
    (0..count as usize).map(move |i| i as f64 / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contour(points: &[(f64, f64)], sd_m: Option<f64>) -> Contour {
        let vertex = |&(x, y): &(f64, f64)| Vertex { at: Point::new(x, y), normal_rad: 0.0, sd_m, touched: true };
        Contour { vertices: points.iter().map(vertex).collect() }
    }

    fn square() -> Outline {
        let corners = [(0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.01), (0.0, 0.0)];
        Outline::new(corners.iter().map(|&(x, y)| Point::new(x, y)).collect()).expect("closed")
    }

    #[test]
    fn val_a_line_beside_a_face() {
        let touched = [Point::new(0.002, 0.0), Point::new(0.008, 0.0)];
        // Half a millimetre below the face, and shorter than what was touched by a millimetre at one end.
        let beside = contour(&[(0.002, -5e-4), (0.007, -5e-4)], Some(3e-4));
        let found = Comparison::new(&beside, &square(), &touched);
        assert!((found.mean_m - 5e-4).abs() < 1e-12 && (found.p95_m - 5e-4).abs() < 1e-12);
        assert!((found.hausdorff_m.expect("touched") - 1e-3f64.hypot(5e-4)).abs() < 1e-12);
        assert_eq!(found.band_coverage, Some(1.0));
        let narrow = contour(&[(0.002, -5e-4), (0.007, -5e-4)], Some(2e-4));
        assert_eq!(Comparison::new(&narrow, &square(), &touched).band_coverage, Some(0.0));
    }

    #[test]
    fn verif_what_is_not_known_is_not_stated() {
        let found = Comparison::new(&contour(&[(0.005, 1e-4)], None), &square(), &[]);
        assert!((found.mean_m - 1e-4).abs() < 1e-12);
        assert_eq!((found.hausdorff_m, found.band_coverage), (None, None));
    }
}
