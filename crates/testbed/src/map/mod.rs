//! Map of a scene with several objects, from the estimates of several whiskers.
//!
//! Each whisker of a recording has its own estimator, without knowledge of the others; their estimates have the common
//! frame World. The map contains the contact points of all whiskers, grouped into objects (`gating`); the outline of
//! each object with its uncertainty ([`Contour`]); a circle if the outline is round ([`Circle::round`]); and an
//! occupancy grid (`grid`). It is built without ground truth.

mod gating;
mod grid;
mod view;

use anyhow::bail;
use serde::{Deserialize, Serialize};
use strict_json::shown_number;

pub use crate::contour::true_circle;
use crate::contour::{Circle, Contour, Vertex};
pub use grid::{Cell, Grid};
pub use view::{Observer, Seen, View};

/// Settings of the map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapConfig {
    /// Side length of a cell of the occupancy grid.
    pub cell_m: f64,
    /// Minimum number of points of a touch that contributes to objects.
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
            bail!("cell_m: found {}, expected 0.0002 to 0.02", shown_number(self.cell_m));
        }
        if self.least_points == 0 {
            bail!("least_points: found 0, expected at least 1");
        }
        Ok(())
    }
}

/// Margin in cells around an open cell that must be free too; it exceeds the position error of a surface.
const MARGIN: i32 = 2;

/// Maximum number of tangents of an object against which its points are checked.
const TANGENTS: usize = 200;

/// Detected object.
#[derive(Clone, Debug)]
pub struct FoundObject {
    /// Points with the index of their whisker in the recording.
    pub points: Vec<(usize, Seen)>,
    /// Outline.
    pub contour: Contour,
    /// Circle fitted to the outline, if it is round.
    pub circle: Option<Circle>,
}

/// Map of a scene.
#[derive(Clone, Debug)]
pub struct SceneMap {
    /// Objects, in descending order of the number of points.
    pub objects: Vec<FoundObject>,
    /// Occupancy grid.
    pub grid: Grid,
}

impl SceneMap {
    /// Combines the observations of a recording's whiskers.
    pub fn new(views: &[&View], config: &MapConfig) -> Self {
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
