//! Observations of whiskers in space: touched points and the space that they passed through.
//!
//! Points of one cell are merged, weighted by the inverse of their variance. Estimates of one touch have errors in common; the
//! covariance of a merged point is therefore that of its most certain estimate, not that of a mean of independent ones.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector3};
use whisker::space::frames::Point;
use whisker::space::surface::OrientedPoint;

use super::SpatialEstimateRow;
use super::run::SpatialRunWhisker;
use super::wire::SpatialWire;

/// Edge of the cells in which points are merged.
const CELL_M: f64 = 0.5e-3;

/// Largest standard deviation of a point, the square root of the trace of its covariance. Estimates at the beginning of a touch
/// have larger ones.
const MOST_SD_M: f64 = 1e-3;

/// Edge of the voxels of the occupancy grid.
pub(super) const VOXEL_M: f64 = 2e-3;

/// Displacement of the root, of the tip of the undeflected whisker, or of the contact, from which the space is scanned again, as a
/// share of a voxel's edge.
const SCAN: f64 = 0.25;

/// A point of the touched surface, in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point (m).
    pub at: Vector3<f64>,
    /// Unit normal out of the object.
    pub normal: Vector3<f64>,
    /// Covariance of the point (m2).
    pub covariance_m2: Matrix3<f64>,
    /// Number of estimates that were merged.
    pub estimates: usize,
    /// Index of the object, from 0 in the order of the points.
    pub object: usize,
}

impl SurfacePoint {
    /// Standard deviation (m): square root of the trace of the covariance.
    pub fn sd_m(&self) -> f64 {
        self.covariance_m2.trace().sqrt()
    }
}

/// Cell in which points are merged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell(Index);

/// Index of a cell or voxel.
pub(super) type Index = [i64; 3];

pub(super) fn index(point: Vector3<f64>, edge_m: f64) -> Index {
    [point.x, point.y, point.z].map(|coordinate_m| (coordinate_m / edge_m).floor() as i64)
}

/// Observations of one or several whiskers.
#[derive(Clone, Debug, Default)]
pub struct SpatialView {
    /// Touched points by cell.
    pub(super) cells: BTreeMap<Cell, Merged>,
    /// Voxels through which a whisker passed.
    pub(super) passed: BTreeSet<Index>,
    /// Number of estimates left out: outside the calibrated domain, too uncertain, or in doubt.
    pub(super) left_out: usize,
}

impl SpatialView {
    /// Adds the observations of other whiskers.
    pub fn append(&mut self, other: &Self) {
        for (cell, merged) in &other.cells {
            self.cells.entry(*cell).or_default().merge(merged);
        }
        self.passed.extend(&other.passed);
        self.left_out += other.left_out;
    }

    /// Number of cells and voxels.
    pub fn len(&self) -> usize {
        self.cells.len() + self.passed.len()
    }

    /// Whether nothing has been observed.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Merged points of the surface in the order of their cells. Their objects are told apart later; all have the number 0.
    pub(super) fn points(&self) -> impl Iterator<Item = SurfacePoint> {
        self.cells.values().map(Merged::point)
    }
}

/// Collects the observations of a whisker instant by instant.
#[derive(Clone, Debug)]
pub struct SpatialObserver {
    wire: SpatialWire,
    /// Number of points of the wire in a scan.
    count: usize,
    /// Largest reading at which a whisker counts as undeflected (N m).
    free_n_m: f64,
    /// Number of touches so far, and whether the last instant belongs to one.
    touches: usize,
    is_touching: bool,
    last: Option<Scan>,
}

/// Where the space was scanned.
#[derive(Clone, Copy, Debug)]
struct Scan {
    /// Root and tip of the undeflected whisker in World (m).
    ends: [Vector3<f64>; 2],
    /// The contact in World (m).
    contact: Option<Vector3<f64>>,
}

impl SpatialObserver {
    /// An observer of a whisker.
    ///
    /// # Errors
    /// If the whisker has invalid parameters.
    pub fn new(whisker: &SpatialRunWhisker) -> anyhow::Result<Self> {
        let length_m = whisker.whisker.length_m;
        let count = (2.0 * length_m / VOXEL_M).ceil() as usize + 1;
        let stiffness_n_m_rad = whisker.suspension.yaw_n_m_rad.min(whisker.suspension.pitch_n_m_rad);
        // The root turns so far that the tip of a rigid whisker would move by the edge of a voxel.
        let free_n_m = stiffness_n_m_rad * VOXEL_M / length_m;
        Ok(Self { wire: SpatialWire::new(whisker)?, count, free_n_m, touches: 0, is_touching: false, last: None })
    }

    /// Adds the next instant to a view. Returns the touched point and its cell, if the estimate enters the map and states the
    /// uncertainty of its normal. Estimates between two instants without one are those of one touch.
    pub fn observe(&mut self, row: &SpatialEstimateRow, view: &mut SpatialView) -> Option<(Cell, OrientedPoint)> {
        let is_touching = row.contact_m().is_some();
        self.touches += usize::from(is_touching && !self.is_touching);
        self.is_touching = is_touching;
        let surface = surface_of(row);
        view.left_out += usize::from(is_touching && surface.is_none());
        self.scan(row, surface.is_some(), view);
        let (at, normal, covariance_m2) = surface?;
        let cell = Cell(index(at, CELL_M));
        view.cells.entry(cell).or_default().add(at, normal, covariance_m2);
        let (at, normal_sd_rad) = (Point::from_vector(at), row.normal_sd_rad?);
        Some((cell, OrientedPoint { at, normal, covariance_m2, normal_sd_rad, touch: self.touches }))
    }

    /// The whisker.
    pub fn wire(&self) -> &SpatialWire {
        &self.wire
    }

    /// Number of touches so far.
    pub fn touches(&self) -> usize {
        self.touches
    }

    /// Marks the voxels through which the whisker passes as free, where its shape is known: deflected through an estimate that
    /// enters the map, or undeflected while there is no estimate and the readings are small. Without an estimate a large reading
    /// means that the whisker touches in an unknown place. Instants at which none of root, undeflected tip and
    /// contact has moved by [`SCAN`] voxels since the last scan are left out, to bound the work.
    fn scan(&mut self, row: &SpatialEstimateRow, is_certain: bool, view: &mut SpatialView) {
        let contact = row.contact_m();
        let is_known = if contact.is_some() { is_certain } else { row.reading_n_m() <= self.free_n_m };
        if !is_known {
            return;
        }
        let ends = self.wire.ends_m(row);
        let is_near = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() < SCAN * VOXEL_M;
        let is_as_before = self.last.as_ref().is_some_and(|last| {
            let is_same_contact = match (&contact, &last.contact) {
                (Some(contact), Some(last)) => is_near(contact, last),
                (contact, last) => contact.is_none() && last.is_none(),
            };
            is_same_contact && ends.iter().zip(&last.ends).all(|(end, last)| is_near(end, last))
        });
        if is_as_before {
            return;
        }
        self.last = Some(Scan { ends, contact });
        // An estimate out of reach has no shape.
        let Some(points) = self.wire.points_m(row, contact, self.count) else { return };
        view.passed.extend(points.into_iter().map(|point| index(point, VOXEL_M)));
    }
}

/// Points of one cell.
#[derive(Clone, Debug, Default)]
pub(super) struct Merged {
    weight: f64,
    at: Vector3<f64>,
    normal: Vector3<f64>,
    surest_m2: Option<Matrix3<f64>>,
    estimates: usize,
}

impl Merged {
    /// Adds a point.
    fn add(&mut self, at: Vector3<f64>, normal: Vector3<f64>, covariance_m2: Matrix3<f64>) {
        let weight = 1.0 / covariance_m2.trace().max(f64::MIN_POSITIVE);
        self.weight += weight;
        self.at += weight * at;
        self.normal += weight * normal;
        self.estimates += 1;
        self.keep_surest(Some(covariance_m2));
    }

    /// Adds the points of the same cell from other whiskers.
    fn merge(&mut self, other: &Self) {
        self.weight += other.weight;
        self.at += other.at;
        self.normal += other.normal;
        self.estimates += other.estimates;
        self.keep_surest(other.surest_m2);
    }

    fn keep_surest(&mut self, covariance_m2: Option<Matrix3<f64>>) {
        let variance_m2 = |of: &Option<Matrix3<f64>>| of.map_or(f64::INFINITY, |of| of.trace());
        if variance_m2(&covariance_m2) < variance_m2(&self.surest_m2) {
            self.surest_m2 = covariance_m2;
        }
    }

    fn point(&self) -> SurfacePoint {
        SurfacePoint {
            at: self.at / self.weight,
            normal: self.normal.try_normalize(0.0).unwrap_or_default(),
            covariance_m2: self.surest_m2.unwrap_or_default(),
            estimates: self.estimates,
            object: 0,
        }
    }
}

/// Point of the surface, normal and covariance of an estimate that enters a map: one within the calibrated domain, and certain
/// enough, without `model_doubtful`.
fn surface_of(row: &SpatialEstimateRow) -> Option<(Vector3<f64>, Vector3<f64>, Matrix3<f64>)> {
    let (at, normal, covariance_m2) = (row.surface_m()?, row.normal()?, row.covariance_m2()?);
    let is_trusted = row.calibrated == Some(true) && row.model_doubtful != Some(true);
    (is_trusted && covariance_m2.trace().sqrt() <= MOST_SD_M).then_some((at, normal, covariance_m2))
}
