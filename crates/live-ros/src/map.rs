//! Map of the touched objects and of the free space, from the observations of all whiskers.

use bag::messages::{AnyMessage, Header, MapMetaData, OccupancyGrid, PointCloud2, PointField, Pose, Time, point_field};
use bag::topics;
use testbed::map::{FoundObject, Grid, MapConfig, SceneMap, View};
use testbed::space::map::{SpatialMap, SurfacePoint};
use testbed::space::rows::{Occupancy, VoxelRow};
use testbed::space::view::SpatialView;
use testbed::statistics;

use crate::chain::Plane;
use crate::drawing::{PlacedPlane, Shape};
use crate::mapping::Mapping;

/// Largest number of cells of a published grid.
const MOST_CELLS: i64 = 4_000_000;

/// Largest number of cells and voxels of a published map in space, over all whiskers. A whisker that exceeds it adds no further
/// observations, which limits the memory.
pub(crate) const MOST_ENTRIES: usize = 250_000;

/// Colour of the objects.
const OBJECT_COLOR: [f32; 3] = [0.2, 0.6, 1.0];

/// Observations of a whisker for the map.
#[derive(Clone, Debug)]
pub enum Observed {
    /// Observations of a planar estimator.
    InPlane {
        /// The observations.
        view: View,
        /// Height of the plane above the origin of the fixed frame, along its normal (m). `None` before the first used pose.
        height_m: Option<f64>,
    },
    /// Observations of an estimator in space.
    InSpace(SpatialView),
}

/// The map at one instant.
#[derive(Clone, Debug)]
pub struct Map {
    /// Layers of the map, each with the last part of its topic's name. In the plane: the occupancy grid; empty before the first
    /// observation, and if the grid is too large. In space: touched points and voxels, which may be empty.
    pub layers: Vec<(&'static str, AnyMessage)>,
    /// In the plane, outlines of the objects and their bands.
    pub shapes: Vec<Shape>,
    /// Whether the observed cells extend too far for a map.
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

    /// Combines the observations of the whiskers at a time (ns). Those of whiskers in the plane are drawn at the mean height of
    /// their planes.
    pub fn map(&self, observed: Vec<Observed>, time_ns: u64) -> Map {
        let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: self.frame.clone() };
        let (mut views, mut heights_m, mut in_space) = (Vec::new(), Vec::new(), None::<SpatialView>);
        for of_whisker in observed {
            match of_whisker {
                Observed::InPlane { view, height_m } => {
                    views.push(view);
                    heights_m.extend(height_m);
                }
                Observed::InSpace(view) => match &mut in_space {
                    Some(of_all) => of_all.append(&view),
                    None => in_space = Some(view),
                },
            }
        }
        match in_space {
            Some(view) if view.len() > MOST_ENTRIES => {
                Map { layers: Vec::new(), shapes: Vec::new(), is_too_large: true }
            }
            Some(view) => in_space_map(&SpatialMap::of(&view), &header),
            None => {
                self.in_plane(&views.iter().collect::<Vec<_>>(), statistics::mean(heights_m).unwrap_or(0.0), header)
            }
        }
    }

    fn in_plane(&self, views: &[&View], height_m: f64, header: Header) -> Map {
        let placed = PlacedPlane { rotation: self.plane.rotation, height_m };
        let scene = SceneMap::new(views, &self.config);
        let outline =
            |(object, number): (&FoundObject, i32)| placed.outline("objects", number, &object.contour, OBJECT_COLOR);
        let shapes = scene.objects.iter().zip(0..).flat_map(outline).collect();
        let grid = occupancy(&scene.grid, &placed, header);
        let is_too_large = grid.is_none() && scene.grid.cells().next().is_some();
        let layers = grid.into_iter().map(|grid| (topics::MAP, AnyMessage::OccupancyGrid(grid))).collect();
        Map { layers, shapes, is_too_large }
    }
}

/// The map in space as clouds of points.
fn in_space_map(map: &SpatialMap, header: &Header) -> Map {
    let touched = |point: &SurfacePoint| {
        let (at, normal) = (point.at, point.normal);
        [at.x, at.y, at.z, normal.x, normal.y, normal.z, point.sd_m(), point.object as f64]
    };
    let seen = |voxel: &VoxelRow| {
        let occupied = if voxel.state == Occupancy::Occupied { 1.0 } else { 0.0 };
        [voxel.x_m, voxel.y_m, voxel.z_m, occupied]
    };
    let points = cloud(header, &POINT_FIELDS, map.points.iter().map(touched));
    let voxels = cloud(header, &VOXEL_FIELDS, map.voxels.iter().map(seen));
    let layers = [(topics::MAP_POINTS, points), (topics::MAP_VOXELS, voxels)];
    Map {
        layers: layers.map(|(topic, cloud)| (topic, AnyMessage::PointCloud2(cloud))).into(),
        shapes: Vec::new(),
        is_too_large: false,
    }
}

/// Fields of the points: coordinates and standard deviation in m, components of the unit normal, number of the object.
const POINT_FIELDS: [&str; 8] = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "sd", "object"];
/// Fields of the voxels: coordinates of the centre in m, 1 if occupied or 0 if free.
const VOXEL_FIELDS: [&str; 4] = ["x", "y", "z", "occupied"];

/// Points with these fields, as single-precision numbers.
fn cloud<const N: usize>(header: &Header, names: &[&str; N], points: impl Iterator<Item = [f64; N]>) -> PointCloud2 {
    const BYTES: u32 = size_of::<f32>() as u32;
    let field = |(&name, place): (&&str, u32)| PointField {
        name: name.into(),
        offset: BYTES * place,
        datatype: point_field::FLOAT32,
        count: 1,
    };
    let data: Vec<u8> = points.flatten().flat_map(|value| (value as f32).to_le_bytes()).collect();
    let point_step = BYTES * N as u32;
    PointCloud2 {
        header: header.clone(),
        height: 1,
        width: data.len() as u32 / point_step,
        fields: names.iter().zip(0..).map(field).collect(),
        is_bigendian: false,
        point_step,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

/// The rectangle around the observed cells. `None` without any, and if there are too many.
fn occupancy(grid: &Grid, placed: &PlacedPlane, header: Header) -> Option<OccupancyGrid> {
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
        position: placed.point(left as f64 * cell_m, low as f64 * cell_m),
        orientation: placed.orientation(0.0),
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
