//! What one whisker saw in a trial: the places that it touched, and those where it was.

use whisker::elastica::{Elastica, Load};
use whisker::frames::{Base, Point, World};

use super::MapConfig;
use super::grid::Grid;
use crate::contour::{SurfacePoint, Vertex, surface_points};
use crate::metrics::Trial;
use crate::replay::Replay;

/// Instants between which the whisker's middle moved by less than this share of a cell are one scan.
const SCAN: f64 = 0.5;

/// The wire is drawn by points so many cells apart.
const WIRE_STEP: f64 = 2.0;

/// How far before the contact, in cells, the wire ends for the grid: there it lies along the surface, and its cells belong to both.
const BEFORE_CONTACT: f64 = 2.0;

/// What one whisker saw, by the estimates of one estimator.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Place of the whisker in the recording.
    pub(crate) whisker: usize,
    /// The places that it touched and is sure of.
    pub(crate) points: Vec<Seen>,
    /// Where it was.
    pub(crate) grid: Grid,
}

/// A place that was touched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// What the estimate says.
    pub(crate) point: SurfacePoint,
    /// Time since the start.
    pub(crate) t_s: f64,
}

impl Seen {
    /// The place with its tangent.
    pub(crate) fn vertex(&self) -> Vertex {
        let SurfacePoint { at, covariance_m2, .. } = self.point;
        Vertex { at: Point::from_vector(at), normal_rad: self.point.normal_rad(), covariance_m2, touched: true }
    }
}

impl View {
    /// Collects what the estimates of a trial say. `whisker` is the whisker's place in the recording.
    ///
    /// A point counts if its covariance says that it is sure; nothing else is known of how long an estimator needs. While the
    /// whisker is free, it counts as its rest shape where the reading says that it is: where the rotation of the root moves its tip by less than a cell, so that
    /// neither the ringing after a release nor a touch that was not noticed sweeps anything free.
    pub(crate) fn new(trial: &Trial<'_>, replay: &Replay, whisker: usize, config: &MapConfig) -> anyhow::Result<Self> {
        let instants = &trial.trace.recording.instants;
        let sure = surface_points(trial, &replay.estimates).into_iter().filter(SurfacePoint::is_sure);
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

/// The whisker as it lies in the plane.
struct Wire {
    elastica: Elastica,
    /// The undeflected whisker.
    rest: Vec<Point<Base>>,
    cell_m: f64,
    /// The largest reading of a whisker at rest.
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

    /// The whisker from its root towards the contact; nothing where it cannot touch there.
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
