//! The map of a scene: what several whiskers, side by side, found of several objects.
//!
//! Each whisker of a recording is an estimator of its own, and none knows of the others; what they say is in one frame, World, and so can be put together. The map holds the
//! contact points of all whiskers, told apart by object (`gating`), the outline of each with its uncertainty ([`Contour`], as it is merged from the strokes of one whisker), the circle
//! through it where it is round by the data ([`Circle::round`]), and an occupancy grid (`grid`). Nothing of the truth goes into it; the judge (`judge`) lays it beside the truth afterwards,
//! which it looks up by whisker and row.

mod gating;
mod grid;
mod judge;
mod view;

use anyhow::bail;
use serde::{Deserialize, Serialize};

pub use crate::contour::true_circle;
use crate::contour::{Circle, Contour, Vertex};
use grid::Grid;
pub(crate) use judge::{Judged, Truths, judged};
pub(crate) use view::{Seen, View};

/// Settings of the map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapConfig {
    /// Side of a cell of the occupancy grid.
    pub cell_m: f64,
    /// Fewest points of a touch that tells of an object.
    pub least_points: usize,
}

impl Default for MapConfig {
    fn default() -> Self {
        Self { cell_m: 2e-3, least_points: 10 }
    }
}

impl MapConfig {
    /// Checks the settings.
    ///
    /// # Errors
    /// If one is out of range.
    pub fn validate(&self) -> anyhow::Result<()> {
        if !(2e-4..=2e-2).contains(&self.cell_m) {
            bail!("map: cell_m: found {}, expected 0.0002 to 0.02", self.cell_m);
        }
        if self.least_points == 0 {
            bail!("map: least_points: found 0, expected at least 1");
        }
        Ok(())
    }
}

/// Cells around an open one that must be free, too: a surface with its errors is no farther away.
const MARGIN: i32 = 2;

/// Most tangents of an object by which its points are judged.
const TANGENTS: usize = 200;

/// An object as it was found.
#[derive(Clone, Debug)]
pub(crate) struct FoundObject {
    /// Its points: place of the whisker in the recording, and what it saw.
    pub(crate) points: Vec<(usize, Seen)>,
    /// Its outline.
    pub(crate) contour: Contour,
    /// The circle of which the outline is an arc, where it is round.
    pub(crate) circle: Option<Circle>,
}

/// The map of a scene.
#[derive(Clone, Debug)]
pub(crate) struct SceneMap {
    /// The objects, those that were touched most first.
    pub(crate) objects: Vec<FoundObject>,
    /// What is free and what is not.
    pub(crate) grid: Grid,
}

impl SceneMap {
    /// Puts what the whiskers of a recording saw together.
    pub(crate) fn new(views: &[&View], config: &MapConfig) -> Self {
        let mut grid = Grid::new(config.cell_m);
        views.iter().for_each(|view| grid.add(&view.grid));
        let mut touches: Vec<(Vec<(usize, Seen)>, Contour)> = Vec::new();
        for view in views {
            for touch in view.points.chunk_by(|a, b| a.point.touch == b.point.touch) {
                if touch.len() >= config.least_points
                    && let Some(contour) = merged(touch.iter())
                {
                    touches.push((touch.iter().map(|seen| (view.whisker, *seen)).collect(), contour));
                }
            }
        }
        let places: Vec<_> = touches.iter().map(|(_, contour)| contour.vertices.clone()).collect();
        let mut objects: Vec<FoundObject> = gating::objects(&places, &grid.open(MARGIN))
            .into_iter()
            .filter_map(|members| {
                let mut points: Vec<(usize, Seen)> =
                    members.into_iter().flat_map(|touch| touches[touch].0.iter().copied()).collect();
                let every = points.len().div_ceil(TANGENTS).max(1);
                let tangents: Vec<Vertex> = points.iter().step_by(every).map(|(_, seen)| seen.vertex()).collect();
                points.retain(|(_, seen)| gating::is_behind(&seen.vertex(), &tangents));
                let contour = merged(points.iter().map(|(_, seen)| seen))?;
                let circle = Circle::round(&contour);
                Some(FoundObject { points, contour, circle })
            })
            .collect();
        objects.sort_by_key(|object| std::cmp::Reverse(object.points.len()));
        Self { objects, grid }
    }
}

fn merged<'a>(seen: impl Iterator<Item = &'a Seen>) -> Option<Contour> {
    Contour::merged(seen.map(|seen| &seen.point))
}
