//! Observations of one whisker in a trial: touched points and swept cells.

use trace::Instant;
use whisker::elastica::{Elastica, Load};
use whisker::estimators::{Estimate, Knowledge};
use whisker::frames::{Base, Point, World};

use super::MapConfig;
use super::grid::Grid;
use crate::contour::{SurfacePoint, SurfacePoints, Vertex};
use crate::metrics::Trial;
use crate::replay::Replay;

/// Largest standard deviation of the position of a point that contributes to a map.
const MOST_SD_M: f64 = 1e-3;

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
    /// Number of further ones that are left out because the models were in doubt or a second contact had taken load.
    pub left_out: usize,
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
    pub fn new(trial: &Trial<'_>, replay: &Replay, whisker: usize, config: &MapConfig) -> anyhow::Result<Self> {
        let mut observer = Observer::new(trial.knowledge, whisker, config)?;
        let rows = trial.trace.recording.instants.iter().zip(trial.readings_n_m).zip(&replay.estimates);
        rows.for_each(|((known, &reading_n_m), estimate)| {
            observer.observe(trial.knowledge, known, reading_n_m, estimate.as_ref());
        });
        Ok(observer.view)
    }

    /// Drops the points of the oldest touches until at most `most` points are left. The grid keeps its cells.
    pub fn limit(&mut self, most: usize) {
        let mut left = self.points.len();
        let mut touches = self.points.chunk_by(|a, b| a.point.touch == b.point.touch).peekable();
        while left > most
            && let Some(touch) = touches.next()
        {
            // Of a single touch, the later half remains.
            left -= if touches.peek().is_some() { touch.len() } else { touch.len().div_ceil(2) };
        }
        self.points.drain(..self.points.len() - left);
    }
}

/// Collects the observations of a whisker instant by instant.
///
/// A point counts if its covariance is small enough and the estimate is not in doubt: neither by its models nor because a second
/// contact has taken load. No settling time is assumed. A free whisker has its rest shape
/// only if the reading implies a tip displacement below a cell, so that neither ringing after a release nor an
/// undetected touch sweeps cells.
pub struct Observer {
    view: View,
    surface: SurfacePoints,
    wire: Wire,
    /// Midpoint of the whisker at the last scan.
    last: Option<Point<World>>,
}

impl Observer {
    /// An observer without observations. `whisker` is the index of the whisker.
    ///
    /// # Errors
    /// If the whisker's shape cannot be computed.
    pub fn new(knowledge: &Knowledge, whisker: usize, config: &MapConfig) -> anyhow::Result<Self> {
        let view = View { whisker, points: Vec::new(), left_out: 0, grid: Grid::new(config.cell_m) };
        let wire = Wire::new(knowledge, config.cell_m)?;
        Ok(Self { view, surface: SurfacePoints::default(), wire, last: None })
    }

    /// Takes the next instant with its reading and estimate. Returns the surface point, if there is one that counts.
    pub fn observe(
        &mut self,
        knowledge: &Knowledge,
        known: &Instant,
        reading_n_m: f64,
        estimate: Option<&Estimate>,
    ) -> Option<SurfacePoint> {
        let found = self.surface.next(knowledge, known, reading_n_m, estimate);
        let sure = found.filter(|point| point.is_sure(MOST_SD_M));
        let point = sure.filter(|point| !point.is_second && !point.is_doubtful);
        self.view.left_out += usize::from(sure.is_some() && point.is_none());
        self.view.points.extend(point.map(|point| Seen { point, t_s: known.t_s }));
        let middle = known.base.apply(knowledge.rest.point(0.5 * knowledge.rest.length_m()));
        if self.last.is_some_and(|last| last.distance(&middle) < SCAN * self.wire.cell_m) {
            return point;
        }
        let line = match (estimate, point) {
            (Some(estimate), Some(_)) => self.wire.bent(estimate.contact),
            (None, _) if self.wire.is_at_rest(reading_n_m) => Some(self.wire.rest.clone()),
            _ => None,
        };
        let Some(line) = line else { return point };
        self.last = Some(middle);
        let line: Vec<Point<World>> = line.into_iter().map(|at| known.base.apply(at)).collect();
        self.view.grid.scan(&line, point.map(|point| Point::from_vector(point.at)));
        point
    }

    /// Observations so far.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Observations so far, to be limited.
    pub fn view_mut(&mut self) -> &mut View {
        &mut self.view
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
    fn new(knowledge: &Knowledge, cell_m: f64) -> anyhow::Result<Self> {
        let Knowledge { whisker, rest, .. } = knowledge;
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
