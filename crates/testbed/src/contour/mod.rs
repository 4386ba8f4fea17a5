//! The outline of an object as an estimator found it, with an uncertainty band, and how far it lies from the truth.
//!
//! The surface points of many contacts and strokes become one [`Contour`] (`merge`), unless the estimator carries an outline of its own. It is compared
//! with the true outline without being aligned to it (`compare`). A round object's radius follows from it (`circle`).

mod circle;
mod compare;
mod merge;
mod stretch;
mod strokes;
mod vertex;

pub use circle::{Circle, true_circle};
pub use compare::{Comparison, Touched};
pub use stretch::touched_stretch;
pub use strokes::second_stroke;
pub(crate) use vertex::direction;
pub use vertex::{Contour, Vertex};

use filters::product;
use nalgebra::{Matrix2, Vector2};
use whisker::estimators::{Estimate, OutlinePoint};
use whisker::frames::{Point, World};

use crate::metrics::Trial;
use crate::replay::Replay;

impl Contour {
    /// The outline that an estimator found in a trial; nothing where it found none. `said` is what its estimates say of the surface.
    ///
    /// This is the one place that decides where an outline comes from: from the estimator where it carries one, as it is at the end; otherwise the surface
    /// points of all contacts from the row `since` on, merged.
    pub fn found(trial: &Trial<'_>, replay: &Replay, said: &[SurfacePoint], since: usize) -> Option<Self> {
        match &replay.outline {
            Some(outline) => carried(trial, outline),
            None => {
                let counts = |point: &&SurfacePoint| point.row >= since && point.since_touch_s >= SETTLING_S;
                Self::merged(said.iter().filter(counts))
            }
        }
    }

    /// The outline of a convex object through surface points, of one whisker or of several; nothing where none says where it is.
    pub(crate) fn merged<'a>(points: impl IntoIterator<Item = &'a SurfacePoint>) -> Option<Self> {
        merge::merged(points)
    }
}

/// The outline that an estimator carries, in World and counter-clockwise; nothing of it is left where none of it is sure.
fn carried(trial: &Trial<'_>, outline: &[OutlinePoint]) -> Option<Contour> {
    let start = trial.trace.recording.instants.first()?.base;
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
    (!vertices.is_empty()).then_some(Contour { vertices })
}

/// What one estimate says of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Row of the trace.
    pub(crate) row: usize,
    /// Row at which the touch began.
    pub(crate) touch: usize,
    /// Time since then.
    pub(crate) since_touch_s: f64,
    /// Where the surface is, in World.
    pub(crate) at: Vector2<f64>,
    /// Outward normal in World, a unit vector: from the object to the whisker.
    pub(crate) normal: Vector2<f64>,
    /// Covariance, where stated.
    pub(crate) covariance_m2: Option<Matrix2<f64>>,
}

impl SurfacePoint {
    /// Direction of the outward normal.
    pub(crate) fn normal_rad(&self) -> f64 {
        self.normal.y.atan2(self.normal.x)
    }

    /// Whether its place is sure enough to say where the outline is, in every direction; one that states nothing counts as sure.
    pub(crate) fn is_sure(&self) -> bool {
        self.covariance_m2.is_none_or(|covariance| {
            // The larger eigenvalue.
            let half_apart = 0.5 * (covariance.m11 - covariance.m22);
            let largest_m2 = 0.5 * covariance.trace() + (half_apart.powi(2) + covariance.m12.powi(2)).sqrt();
            largest_m2 <= MOST_SD_M * MOST_SD_M
        })
    }
}

/// A point whose place is less sure than this does not say where the outline is.
const MOST_SD_M: f64 = 1e-3;

/// After a touch an estimator has so long to find the contact before what it says counts as outline.
const SETTLING_S: f64 = 1.0;

/// The surface points in World that an estimator stands for: not where it says itself that its sensor model does not hold, beyond the
/// calibrated region or at the tip, and not farther from the root than the whisker is long, as filters that have run away say.
pub fn surface_points(trial: &Trial<'_>, estimates: &[Option<Estimate>]) -> Vec<SurfacePoint> {
    let instants = &trial.trace.recording.instants;
    let mut points = Vec::with_capacity(estimates.len());
    let mut begun = None;
    for (row, ((known, &reading_n_m), estimate)) in instants.iter().zip(trial.readings_n_m).zip(estimates).enumerate() {
        let Some(estimate) = estimate else {
            begun = None;
            continue;
        };
        let touch = *begun.get_or_insert(row);
        let is_on_whisker = estimate.contact.vector().norm() <= trial.knowledge.whisker.length_m;
        if !estimate.calibrated || estimate.at_tip || !is_on_whisker {
            continue;
        }
        let tangent = direction(trial.knowledge.tangent_rad(estimate, reading_n_m));
        let outward = Vector2::new(-tangent.y, tangent.x) * estimate.face.away_sign();
        points.push(SurfacePoint {
            row,
            touch,
            since_touch_s: known.t_s - instants[touch].t_s,
            at: known.base.apply(trial.knowledge.surface_beside(estimate, tangent)).vector(),
            normal: product(&known.base.rotation(), &outward),
            covariance_m2: estimate.covariance_m2.map(|covariance| known.base.turn(covariance)),
        });
    }
    points
}
