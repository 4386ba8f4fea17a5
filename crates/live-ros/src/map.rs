//! Map of the touched objects and of the free space, from the observations of all whiskers.

use bag::messages::{Header, MapMetaData, OccupancyGrid, Pose, Time};
use testbed::map::{FoundObject, Grid, MapConfig, SceneMap, View};

use crate::chain::Plane;
use crate::drawing::{InSpace, Shape};
use crate::mapping::Mapping;

/// Largest number of cells of a published grid.
const MOST_CELLS: i64 = 4_000_000;

/// Colour of the objects.
const OBJECT_COLOR: [f32; 3] = [0.2, 0.6, 1.0];

/// The map at one instant.
#[derive(Clone, Debug)]
pub struct Map {
    /// Occupancy grid. `None` before the first observation, and if it is too large.
    pub grid: Option<OccupancyGrid>,
    /// Outlines of the objects and their bands.
    pub shapes: Vec<Shape>,
    /// Whether the observed cells extend too far for a grid.
    pub is_too_large: bool,
}

/// Settings of the map, and its place.
#[derive(Clone, Debug)]
pub struct Mapper {
    config: MapConfig,
    plane: Plane,
    frame: String,
}

impl Mapper {
    /// The settings of a mapping.
    pub fn new(mapping: &Mapping) -> Self {
        Self { config: mapping.map, plane: mapping.plane.plane(), frame: mapping.fixed_frame.clone() }
    }

    /// Combines the observations of the whiskers at a time (ns), drawn at a height of the plane (m).
    pub fn map(&self, views: &[View], height_m: f64, time_ns: u64) -> Map {
        let in_space = InSpace { rotation: self.plane.rotation, height_m };
        let scene = SceneMap::new(&views.iter().collect::<Vec<_>>(), &self.config);
        let outline =
            |(object, number): (&FoundObject, i32)| in_space.outline("objects", number, &object.contour, OBJECT_COLOR);
        let shapes = scene.objects.iter().zip(0..).flat_map(outline).collect();
        let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: self.frame.clone() };
        let grid = occupancy(&scene.grid, &in_space, header);
        let is_too_large = grid.is_none() && scene.grid.cells().next().is_some();
        Map { grid, shapes, is_too_large }
    }
}

/// The rectangle around the observed cells. `None` without any, and if there are too many.
fn occupancy(grid: &Grid, in_space: &InSpace, header: Header) -> Option<OccupancyGrid> {
    let cell_m = grid.cell_m();
    let place = |of_m: f64| (of_m / cell_m).floor() as i64;
    let cells = || grid.cells().map(|(at, cell)| (place(at.x()), place(at.y()), cell));
    let (first_x, first_y, _) = cells().next()?;
    let bounds = cells().fold([first_x, first_x, first_y, first_y], |[left, right, low, high], (x, y, _)| {
        [left.min(x), right.max(x), low.min(y), high.max(y)]
    });
    let [left, right, low, high] = bounds;
    let (width, height) = (right - left + 1, high - low + 1);
    if width.checked_mul(height).is_none_or(|count| count > MOST_CELLS) {
        return None;
    }
    let mut data = vec![-1_i8; (width * height) as usize];
    for (x, y, cell) in cells() {
        data[((y - low) * width + (x - left)) as usize] = (100.0 * cell.occupied()).round() as i8;
    }
    let origin = Pose {
        position: in_space.point(left as f64 * cell_m, low as f64 * cell_m),
        orientation: in_space.orientation(0.0),
    };
    let info = MapMetaData {
        map_load_time: header.stamp.clone(),
        resolution: cell_m as f32,
        width: width as u32,
        height: height as u32,
        origin,
    };
    Some(OccupancyGrid { header, info, data })
}
