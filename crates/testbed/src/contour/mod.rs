//! Object outlines estimated from contacts, with uncertainty bands, and their comparison with the true outline.
//!
//! The surface points of all contacts and strokes are merged into one [`Contour`] (`merge`), unless the estimator has
//! an outline of its own. A contour is compared with the true outline without alignment (`compare`). If it is round, a
//! circle is fitted to it (`circle`).

mod circle;
mod compare;
mod merge;
mod stretch;
mod strokes;
mod swept;
mod vertex;

pub use circle::{Circle, true_circle};
pub use compare::{Comparison, Touched};
pub use stretch::touched_stretch;
pub use strokes::second_stroke;
pub use swept::Swept;
pub(crate) use vertex::direction;
pub use vertex::{Contour, Vertex};

use filters::product;
use nalgebra::{Matrix2, Vector2};
use trace::{Instant, Recording};
use whisker::estimators::{CarriedOutline, Estimate, Knowledge, OutlinePoint};
use whisker::frames::{Base, Point, Pose, World};

impl Contour {
    /// Outline estimated in a trial. `None` if there is none.
    ///
    /// If the estimates are contacts on an outline that the estimator carries, its final state is used. Otherwise the surface
    /// points of all contacts from the row `since` on are merged, each touch after a settling time, without those at instants at
    /// which a second contact had taken load: the reading is then that of two contacts. If fewer than a fifth of them are certain
    /// enough, the outline carried by a less probable candidate is used instead.
    pub fn found(
        recording: &Recording,
        outline: Option<&CarriedOutline>,
        points: &[SurfacePoint],
        since: usize,
    ) -> Option<Self> {
        let carried = || Self::carried(&recording.instants.first()?.base, &outline?.points);
        if outline.is_some_and(|outline| outline.leads) {
            return carried();
        }
        let counts =
            |point: &&SurfacePoint| point.row >= since && point.since_touch_s >= SETTLING_S && !point.is_second;
        let counting: Vec<_> = points.iter().filter(counts).collect();
        let merged = || Self::merged(counting.iter().copied());
        if most_are_uncertain(&counting) { carried().or_else(merged) } else { merged().or_else(carried) }
    }

    /// Outline of an estimator (in Start), transformed to World by the pose of the base at the start of its samples,
    /// counter-clockwise. `None` if all of its points are too uncertain.
    pub fn carried(start: &Pose<Base, World>, outline: &[OutlinePoint]) -> Option<Self> {
        let vertex = |point: &OutlinePoint| {
            let normal = start.rotation() * point.normal;
            Vertex {
                at: start.apply(Point::from_vector(point.surface.vector())),
                normal_rad: normal.y.atan2(normal.x),
                covariance_m2: Some(start.turn(point.covariance_m2)),
                touched: true,
            }
        };
        let vertices: Vec<Vertex> =
            outline.iter().map(vertex).filter(|vertex| vertex.sd_m().is_some_and(|sd_m| sd_m <= MOST_SD_M)).collect();
        (!vertices.is_empty()).then_some(Self { vertices })
    }

    /// Outline of a convex object through surface points of one or several whiskers. `None` if no point is usable.
    pub(crate) fn merged<'a>(points: impl IntoIterator<Item = &'a SurfacePoint>) -> Option<Self> {
        merge::merged(points)
    }
}

/// Surface point computed from one estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Row of the trace.
    pub row: usize,
    /// Row of the start of the touch.
    pub(crate) touch: usize,
    /// Time since the start of the touch.
    pub(crate) since_touch_s: f64,
    /// Position on the surface, in World.
    pub at: Vector2<f64>,
    /// Unit outward normal in World, from the object to the whisker.
    pub normal: Vector2<f64>,
    /// Covariance of the position in World, if stated.
    pub covariance_m2: Option<Matrix2<f64>>,
    /// Whether the estimate is that of an instant at which a second contact had taken load.
    pub(crate) is_second: bool,
    /// Whether its models were in doubt.
    pub(crate) is_doubtful: bool,
}

impl SurfacePoint {
    /// Direction of the outward normal.
    pub fn normal_rad(&self) -> f64 {
        self.normal.y.atan2(self.normal.x)
    }

    /// Whether the position has at most this standard deviation in every direction. Points without a covariance qualify, whatever
    /// the signals of doubt.
    pub(crate) fn is_sure(&self, most_sd_m: f64) -> bool {
        self.covariance_m2.is_none_or(|covariance| {
            // Larger eigenvalue.
            let half_apart = 0.5 * (covariance.m11 - covariance.m22);
            let largest_m2 = 0.5 * covariance.trace() + (half_apart.powi(2) + covariance.m12.powi(2)).sqrt();
            largest_m2 <= most_sd_m * most_sd_m
        })
    }
}

/// Largest standard deviation of the position of a point that contributes to an outline. Maps, which have more touches, are
/// stricter.
const MOST_SD_M: f64 = 2e-3;

/// Share of surface points with a standard deviation of at most [`MOST_SD_M`] below which the outline carried by a candidate is
/// used instead of one merged from the points.
const LEAST_SURE: f64 = 0.2;

/// Whether fewer than [`LEAST_SURE`] of the points are certain enough.
fn most_are_uncertain(points: &[&SurfacePoint]) -> bool {
    let sure = points.iter().filter(|point| point.is_sure(MOST_SD_M)).count();
    (sure as f64) < LEAST_SURE * points.len() as f64
}

/// Settling time after a touch, during which estimates do not contribute to the outline.
const SETTLING_S: f64 = 1.0;

/// Surface points of the estimates, in World. Estimates flagged as outside of the calibrated domain or at the tip are
/// excluded, and so are diverged ones, whose contact is farther from the root than the whisker is long.
pub fn surface_points(
    recording: &Recording,
    knowledge: &Knowledge,
    readings_n_m: &[f64],
    estimates: &[Option<Estimate>],
) -> Vec<SurfacePoint> {
    let mut surface = SurfacePoints::default();
    let rows = recording.instants.iter().zip(readings_n_m).zip(estimates);
    rows.filter_map(|((known, &reading_n_m), estimate)| surface.next(knowledge, known, reading_n_m, estimate.as_ref()))
        .collect()
}

/// Converts estimates to surface points one by one, in order of time.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurfacePoints {
    /// Number of instants so far.
    rows: usize,
    /// Row and time of the start of the present touch.
    begun: Option<(usize, f64)>,
}

impl SurfacePoints {
    /// Surface point of the estimate of the next instant. `None` without an estimate and for those that
    /// [`surface_points`] excludes.
    pub fn next(
        &mut self,
        knowledge: &Knowledge,
        known: &Instant,
        reading_n_m: f64,
        estimate: Option<&Estimate>,
    ) -> Option<SurfacePoint> {
        let row = self.rows;
        self.rows += 1;
        let Some(estimate) = estimate else {
            self.begun = None;
            return None;
        };
        let (touch, touch_s) = *self.begun.get_or_insert((row, known.t_s));
        let is_on_whisker = estimate.contact.vector().norm() <= knowledge.whisker.length_m;
        if !estimate.calibrated || estimate.at_tip || !is_on_whisker {
            return None;
        }
        let tangent = direction(knowledge.tangent_rad(estimate, reading_n_m));
        let outward = Vector2::new(-tangent.y, tangent.x) * estimate.face.away_sign();
        Some(SurfacePoint {
            row,
            touch,
            since_touch_s: known.t_s - touch_s,
            at: known.base.apply(knowledge.surface_beside(estimate, tangent)).vector(),
            normal: product(&known.base.rotation(), &outward),
            covariance_m2: estimate.covariance_m2.map(|covariance| known.base.turn(covariance)),
            is_second: estimate.second_contact,
            is_doubtful: estimate.model_doubtful,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_an_outline_through_the_points_needs_a_fifth_of_them_certain() {
        let point = |sd_m: f64| SurfacePoint {
            row: 0,
            touch: 0,
            since_touch_s: 2.0,
            at: Vector2::zeros(),
            normal: Vector2::x(),
            covariance_m2: Some(Matrix2::new(1e-8, 0.0, 0.0, sd_m * sd_m)),
            is_second: false,
            is_doubtful: false,
        };
        let (sure, unsure) = (point(1.9e-3), point(2.1e-3));
        let of = |count: usize| [vec![&sure; count], vec![&unsure; 10]].concat();
        assert!(most_are_uncertain(&of(2)) && !most_are_uncertain(&of(3)));
        assert!(!most_are_uncertain(&[]));
        let unstated = SurfacePoint { covariance_m2: None, ..unsure };
        assert!(!most_are_uncertain(&[&unstated]));
    }
}
