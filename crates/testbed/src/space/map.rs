//! Maps in space: the surface that whiskers touched, as points with their uncertainty and as a mesh, and the space that they
//! passed through.

use std::collections::BTreeMap;

use whisker::space::surface::OrientedPoint;

use super::SpatialEstimateRow;
use super::rows::{Occupancy, VoxelRow};
use super::run::SpatialRunWhisker;
use super::solid::Solid;
use super::surface::SurfaceMesh;
pub use super::view::SurfacePoint;
use super::view::{Cell, Index, SpatialObserver, SpatialView, VOXEL_M, index};

/// Smallest distance between the points of two objects.
const GAP_M: f64 = 10e-3;

/// Standard deviations at the ends of the colour scale, which is logarithmic.
const COLOUR_ENDS_M: [f64; 2] = [10e-6, 1e-3];

/// Colours from the smallest to the largest standard deviation: the scale viridis of matplotlib, whose lightness rises evenly.
const COLOURS: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// Estimates of one sweep.
#[derive(Clone, Copy, Debug)]
pub struct Sweep<'a> {
    /// The whisker.
    pub whisker: &'a SpatialRunWhisker,
    /// Estimates in the order of time.
    pub rows: &'a [SpatialEstimateRow],
}

/// Map of the sweeps over one scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SpatialMap {
    /// Points of the surface, in the order of their cells.
    pub points: Vec<SurfacePoint>,
    /// Number of estimates left out: outside the calibrated domain, with a larger standard deviation than 1 mm, or in doubt.
    pub left_out: usize,
    /// Voxels that were observed, in order.
    pub voxels: Vec<VoxelRow>,
    /// The surfaces of the objects, from the estimates that were not left out and state the uncertainty of their normal.
    pub surface: SurfaceMesh,
}

impl SpatialMap {
    /// The map of some sweeps.
    ///
    /// # Errors
    /// If a whisker has invalid parameters.
    pub fn new(sweeps: &[Sweep<'_>]) -> anyhow::Result<Self> {
        let (mut view, mut oriented, mut touches) = (SpatialView::default(), Vec::new(), 0);
        for sweep in sweeps {
            let mut observer = SpatialObserver::new(sweep.whisker)?;
            let found = sweep.rows.iter().filter_map(|row| observer.observe(row, &mut view));
            oriented.extend(found.map(|(cell, of)| (cell, OrientedPoint { touch: touches + of.touch, ..of })));
            touches += observer.touches();
        }
        let map = Self::of(&view);
        let object_of: BTreeMap<Cell, usize> =
            view.cells.keys().copied().zip(map.points.iter().map(|point| point.object)).collect();
        let mut objects = vec![Vec::new(); map.objects()];
        oriented.into_iter().for_each(|(cell, point)| objects[object_of[&cell]].push(point));
        Ok(Self { surface: SurfaceMesh::new(&objects), ..map })
    }

    /// The map of some observations, without the surfaces, which take seconds to compute.
    pub fn of(view: &SpatialView) -> Self {
        let mut points: Vec<SurfacePoint> = view.points().collect();
        tell_apart(&mut points);
        let mut voxels: BTreeMap<Index, Occupancy> = view.passed.iter().map(|at| (*at, Occupancy::Free)).collect();
        voxels.extend(points.iter().map(|point| (index(point.at, VOXEL_M), Occupancy::Occupied)));
        let center = |at: i64| VOXEL_M * (at as f64 + 0.5);
        let row =
            |([x, y, z], state): (Index, Occupancy)| VoxelRow { x_m: center(x), y_m: center(y), z_m: center(z), state };
        let voxels = voxels.into_iter().map(row).collect();
        Self { points, left_out: view.left_out, voxels, surface: SurfaceMesh::default() }
    }

    /// Number of objects.
    pub fn objects(&self) -> usize {
        self.points.iter().map(|point| point.object + 1).max().unwrap_or(0)
    }

    /// Distances of the points from a solid (m), ascending.
    pub fn distances_m(&self, solid: &Solid) -> Vec<f64> {
        let mut distances: Vec<f64> = self.points.iter().map(|point| solid.distance_m(point.at)).collect();
        distances.sort_by(f64::total_cmp);
        distances
    }
}

/// Colour of a standard deviation: red, green, blue.
pub(super) fn colour(sd_m: f64) -> [u8; 3] {
    let [least, most] = COLOUR_ENDS_M;
    let share = ((sd_m / least).ln() / (most / least).ln()).clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let step = (share.floor() as usize).min(COLOURS.len() - 2);
    let between = share - step as f64;
    std::array::from_fn(|i| (COLOURS[step][i] + between * (COLOURS[step + 1][i] - COLOURS[step][i])).round() as u8)
}

/// Numbers the objects: points belong to one object if a chain of points with smaller steps than the gap connects them.
fn tell_apart(points: &mut [SurfacePoint]) {
    let mut left: Vec<usize> = (0..points.len()).collect();
    let mut object = 0;
    while let Some(first) = left.first().copied() {
        let mut open = vec![first];
        left.remove(0);
        while let Some(place) = open.pop() {
            points[place].object = object;
            let at = points[place].at;
            // A point that is reached is not compared again, so that maps of many points remain fast.
            left.retain(|&other| {
                let is_reached = (points[other].at - at).norm() < GAP_M;
                if is_reached {
                    open.push(other);
                }
                !is_reached
            });
        }
        object += 1;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use trace::StatedSuspension;
    use whisker::Whisker;

    use super::super::surface::Vertex;
    use super::*;

    fn whisker() -> SpatialRunWhisker {
        let stiffness = 1.7e-4;
        let suspension =
            StatedSuspension { yaw_n_m_rad: stiffness, pitch_n_m_rad: stiffness, twist_n_m_rad: stiffness };
        SpatialRunWhisker { whisker: Whisker::straight(), suspension, poisson_ratio: 0.33 }
    }

    fn row(contact: Option<[f64; 3]>, sd_m: f64) -> SpatialEstimateRow {
        let of = |axis: usize| contact.map(|at| at[axis]);
        let known = |value: f64| contact.map(|_| value);
        SpatialEstimateRow {
            base_qw: 1.0,
            contact_x_m: of(0),
            contact_y_m: of(1),
            contact_z_m: of(2),
            surface_x_m: of(0),
            surface_y_m: of(1),
            surface_z_m: of(2),
            cov_xx_m2: known(sd_m * sd_m),
            cov_xy_m2: known(0.0),
            cov_xz_m2: known(0.0),
            cov_yy_m2: known(0.0),
            cov_yz_m2: known(0.0),
            cov_zz_m2: known(0.0),
            normal_x: known(0.0),
            normal_y: known(1.0),
            normal_z: known(0.0),
            normal_sd_rad: known(5e-3),
            calibrated: contact.map(|_| true),
            ..SpatialEstimateRow::default()
        }
    }

    fn map(rows: &[SpatialEstimateRow]) -> SpatialMap {
        SpatialMap::new(&[Sweep { whisker: &whisker(), rows }]).unwrap()
    }

    #[test]
    fn verif_estimates_of_a_cell_are_merged_and_keep_the_smallest_covariance() {
        let at = [0.06002, -0.00498, 0.00102];
        let beside = [0.06012, -0.00498, 0.00102];
        let in_doubt = SpatialEstimateRow { model_doubtful: Some(true), ..row(Some(beside), 1e-4) };
        let found = map(&[row(Some(at), 1e-4), row(Some(beside), 2e-4), row(Some(beside), 2e-3), in_doubt]);
        let [point] = found.points[..] else { panic!("{:?}", found.points) };
        assert_eq!((point.estimates, found.left_out, found.objects()), (2, 2, 1));
        assert!((point.at.x - (4.0 * at[0] + beside[0]) / 5.0).abs() < 1e-12);
        assert!((point.sd_m() - 1e-4).abs() < 1e-12, "not smaller than that of the best estimate");
    }

    #[test]
    fn verif_objects_are_told_apart_and_swept_voxels_are_free() {
        let found = map(&[row(None, 0.0), row(Some([0.06, -0.005, 0.0]), 1e-4), row(Some([0.05, 0.02, 0.0]), 1e-4)]);
        assert_eq!(found.objects(), 2);
        let state = |at: [f64; 3]| {
            let is_here = |voxel: &&VoxelRow| {
                let apart = Vector3::new(voxel.x_m, voxel.y_m, voxel.z_m) - Vector3::from(at);
                apart.amax() <= 0.5 * VOXEL_M
            };
            found.voxels.iter().find(is_here).map(|voxel| voxel.state)
        };
        assert_eq!(state([0.0405, 0.0005, 0.0005]), Some(Occupancy::Free), "the free whisker lies along x");
        assert_eq!(state([0.0605, -0.0045, 0.0005]), Some(Occupancy::Occupied));
        assert_eq!(state([0.04, 0.04, 0.04]), None);
    }

    #[test]
    fn regress_space_is_not_free_where_the_shape_of_the_whisker_is_unknown() {
        let touching = SpatialEstimateRow { moment_z_n_m: -2e-5, ..row(None, 0.0) };
        let unsure = SpatialEstimateRow { moment_z_n_m: -1e-5, ..row(Some([0.06, -0.005, 0.0]), 2e-3) };
        assert!(map(&[touching.clone(), unsure]).voxels.is_empty());
        let free = SpatialEstimateRow { moment_z_n_m: -5e-7, ..row(None, 0.0) };
        assert!(!map(&[touching, free]).voxels.is_empty());
    }

    #[test]
    fn verif_each_object_has_a_surface_through_its_contacts() {
        // Two strokes along x, and one over another object, all facing along y.
        let stroke = |y_m: f64, z_m: f64| (0..40).map(move |i| row(Some([0.05 + 3e-4 * f64::from(i), y_m, z_m]), 1e-5));
        let free = || std::iter::once(row(None, 0.0));
        let rows: Vec<SpatialEstimateRow> =
            stroke(0.0, 0.0).chain(free()).chain(stroke(0.0, 3e-3)).chain(free()).chain(stroke(0.03, 0.0)).collect();
        let found = map(&rows);
        assert_eq!(found.objects(), 2);
        let vertices = &found.surface.vertices;
        for (object, y_m) in [(0, 0.0), (1, 0.03)] {
            let of_object: Vec<_> = vertices.iter().filter(|vertex| vertex.object == object).collect();
            assert!(of_object.len() > 20, "{object}: {}", of_object.len());
            assert!(of_object.iter().all(|vertex| (vertex.on.at.vector().y - y_m).abs() < 50e-6));
        }
        let between = |vertex: &&Vertex| {
            let at = vertex.on.at.vector();
            (0.051..0.061).contains(&at.x) && (1e-3..2e-3).contains(&at.z)
        };
        assert!(vertices.iter().filter(between).all(|vertex| vertex.on.sd_m < 50e-6), "enclosed by strokes");
        let orientation = [1.0, 0.0, 0.0, 0.0];
        let flat = Solid::Box { size_m: [0.1, 0.1, 0.1], center_m: [0.05, -0.05, 0.0], orientation };
        let score = map(&rows[..81]).surface.score(&flat);
        assert!(score.mean_m.unwrap() < 20e-6 && score.coverage == Some(1.0), "{score:?}");
        let unstated: Vec<_> =
            rows.iter().map(|row| SpatialEstimateRow { normal_sd_rad: None, ..row.clone() }).collect();
        assert!(map(&unstated).surface.vertices.is_empty(), "without certainty of the normals there is no surface");
    }

    #[test]
    fn verif_distances_are_those_from_the_solid() {
        let found = map(&[row(Some([0.06, -0.005, 0.0]), 1e-4)]);
        let solid = Solid::Sphere { radius_m: 0.01, center_m: [0.06, -0.016, 0.0] };
        assert!((found.distances_m(&solid)[0] - 0.001).abs() < 1e-12);
    }
}
