//! Observations of one whisker in a trial: touched points and swept cells.

use whisker::elastica::{Elastica, Load};
use whisker::frames::{Base, Point, World};

use super::MapConfig;
use super::grid::Grid;
use crate::contour::{SurfacePoint, Vertex};
use crate::metrics::Trial;
use crate::replay::Replay;

/// Minimum displacement of the whisker's midpoint between scans, as a fraction of a cell.
const SCAN: f64 = 0.5;

/// Distance between the sampled points of the wire, in cells.
const WIRE_STEP: f64 = 2.0;

/// Distance before the contact, in cells, at which the wire ends in a scan. Near the contact the wire lies along the
/// surface, so that its cells belong to both.
const BEFORE_CONTACT: f64 = 2.0;

/// Observations of one whisker with one estimator.
#[derive(Clone, Debug)]
pub struct View {
    /// Index of the whisker in the recording.
    pub whisker: usize,
    /// Touched points with a sufficiently small covariance.
    pub points: Vec<Seen>,
    /// Occupancy grid of this whisker.
    pub grid: Grid,
}

/// Touched point.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Surface point of the estimate.
    pub point: SurfacePoint,
    /// Time since the start of the recording.
    pub t_s: f64,
}

impl Seen {
    /// Vertex at the point, with its normal.
    pub fn vertex(&self) -> Vertex {
        let SurfacePoint { at, covariance_m2, .. } = self.point;
        Vertex { at: Point::from_vector(at), normal_rad: self.point.normal_rad(), covariance_m2, touched: true }
    }
}

impl View {
    /// Collects the observations of a trial. `whisker` is the index of the whisker in the recording.
    ///
    /// A point counts if its covariance is small enough; no settling time is assumed. A free whisker has its rest shape
    /// only if the reading implies a tip displacement below a cell, so that neither ringing after a release nor an
    /// undetected touch sweeps cells.
    pub fn new(trial: &Trial<'_>, replay: &Replay, whisker: usize, config: &MapConfig) -> anyhow::Result<Self> {
        let instants = &trial.trace.recording.instants;
        let sure = trial.surface_points(replay).into_iter().filter(SurfacePoint::is_sure);
        let points: Vec<Seen> = sure.map(|point| Seen { point, t_s: instants[point.row].t_s }).collect();
        let wire = Wire::new(trial, config.cell_m)?;
        let mut grid = Grid::new(config.cell_m);
        let mut touched = points.iter().peekable();
        let mut last: Option<Point<World>> = None;
        for (row, known) in instants.iter().enumerate() {
            let point = touched.next_if(|seen| seen.point.row == row);
            let middle = known.base.apply(trial.knowledge.rest.point(0.5 * trial.knowledge.rest.length_m()));
            if last.is_some_and(|last| last.distance(&middle) < SCAN * config.cell_m) {
                continue;
            }
            let line = match (&replay.estimates[row], point) {
                (Some(estimate), Some(_)) => wire.bent(estimate.contact),
                (None, _) if wire.is_at_rest(trial.readings_n_m[row]) => Some(wire.rest.clone()),
                _ => None,
            };
            let Some(line) = line else { continue };
            last = Some(middle);
            let line: Vec<Point<World>> = line.into_iter().map(|at| known.base.apply(at)).collect();
            grid.scan(&line, point.map(|seen| Point::from_vector(seen.point.at)));
        }
        Ok(Self { whisker, points, grid })
    }
}

/// Shape of the whisker in the plane.
struct Wire {
    elastica: Elastica,
    /// Undeflected whisker.
    rest: Vec<Point<Base>>,
    cell_m: f64,
    /// Largest magnitude of the reading of a whisker at rest.
    most_n_m: f64,
}

impl Wire {
    fn new(trial: &Trial<'_>, cell_m: f64) -> anyhow::Result<Self> {
        let whisker = &trial.knowledge.whisker;
        let rest = &trial.knowledge.rest;
        Ok(Self {
            elastica: Elastica::new(whisker)?,
            rest: arcs(rest.length_m(), cell_m).map(|arc_m| rest.point(arc_m)).collect(),
            cell_m,
            most_n_m: whisker.root_stiffness_n_m_rad * cell_m / whisker.length_m,
        })
    }

    fn is_at_rest(&self, reading_n_m: f64) -> bool {
        reading_n_m.abs() <= self.most_n_m
    }

    /// Shape of the whisker from the root towards the contact. `None` if the contact is not reachable.
    fn bent(&self, contact: Point<Base>) -> Option<Vec<Point<Base>>> {
        let load: Load = self.elastica.at_point(contact).ok()?.load;
        let line = self.elastica.line(load).ok()?;
        let end_m = load.arc_m - BEFORE_CONTACT * self.cell_m;
        (end_m > 0.0).then(|| arcs(end_m, self.cell_m).map(|arc_m| line.at(arc_m).0).collect())
    }
}

/// Arc lengths from the root to an end.
fn arcs(end_m: f64, cell_m: f64) -> impl Iterator<Item = f64> {
    let steps = (end_m / (WIRE_STEP * cell_m)).ceil().max(1.0) as u32;
    (0..=steps).map(move |step| end_m * f64::from(step) / f64::from(steps))
}
