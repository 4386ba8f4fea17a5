//! Triangle meshes of the surfaces of a map ([`whisker::space::surface`]).

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use nalgebra::Vector3;
use whisker::space::frames::Point;
use whisker::space::surface::{ImplicitSurface, LENGTHS_M, OrientedPoint, ProjectedPoint};

use super::solid::Solid;
use crate::statistics;

/// Largest standard deviation of a vertex, and of one whose distance counts.
const MOST_SD_M: f64 = 1e-3;
const CERTAIN_SD_M: f64 = 0.1e-3;

/// Edge of the grid on which triangles are formed, doubled until there are at most [`MOST_NODES`], and the number of nodes on each
/// side of a point, along each axis, that have a value.
const GRID_M: f64 = 0.5e-3;
const MOST_NODES: f64 = (1_u32 << 20) as f64;
const REACH: f64 = 8.0;

/// A vertex of a mesh, in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Its point of the surface, with normal and standard deviation.
    pub on: ProjectedPoint,
    /// Index of the object.
    pub object: usize,
}

/// Triangle mesh of the surfaces of all objects of a map, where their standard deviation is small.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceMesh {
    /// The vertices.
    pub vertices: Vec<Vertex>,
    /// Indices of three vertices each, counter-clockwise from outside of the object.
    pub triangles: Vec<[u32; 3]>,
}

/// Distances of a mesh from the true solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceScore {
    /// Mean distance of the vertices with a standard deviation of at most 0.1 mm (m). `None` without such vertices.
    pub mean_m: Option<f64>,
    /// Share of all vertices whose distance is at most 1.96 standard deviations. `None` without vertices.
    pub coverage: Option<f64>,
}

impl SurfaceMesh {
    /// The mesh of some objects, from the points of each.
    pub fn new(objects: &[Vec<OrientedPoint>]) -> Self {
        let mut mesh = Self::default();
        for (object, points) in objects.iter().enumerate() {
            if let Some(surface) = ImplicitSurface::fit(points, &LENGTHS_M) {
                mesh.add(object, &surface, points);
            }
        }
        mesh
    }

    /// Area of all triangles (m2).
    pub fn area_m2(&self) -> f64 {
        self.area_up_to_m2(f64::INFINITY)
    }

    /// Area of the triangles whose vertices have a standard deviation of at most 0.1 mm (m2).
    pub fn certain_area_m2(&self) -> f64 {
        self.area_up_to_m2(CERTAIN_SD_M)
    }

    /// Area of the triangles whose vertices have at most this standard deviation.
    fn area_up_to_m2(&self, sd_m: f64) -> f64 {
        let corners = self.triangles.iter().map(|corners| corners.map(|corner| self.vertices[corner as usize].on));
        let certain = corners.filter(|corners| corners.iter().all(|corner| corner.sd_m <= sd_m));
        let area = |corners: [ProjectedPoint; 3]| {
            let [a, b, c] = corners.map(|corner| corner.at.vector());
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        certain.map(area).sum()
    }

    /// Distances from a solid, without alignment.
    pub fn score(&self, solid: &Solid) -> SurfaceScore {
        let vertices = self.vertices.iter().map(|vertex| vertex.on);
        let away: Vec<(f64, f64)> = vertices.map(|on| (solid.distance_m(on.at.vector()), on.sd_m)).collect();
        let certain = away.iter().filter(|(_, sd_m)| *sd_m <= CERTAIN_SD_M);
        let is_within = |(distance_m, sd_m): &(f64, f64)| f64::from(*distance_m <= statistics::NORMAL_95 * sd_m);
        SurfaceScore {
            mean_m: statistics::mean(certain.map(|(distance_m, _)| *distance_m)),
            coverage: statistics::mean(away.iter().map(is_within)),
        }
    }

    /// Adds the zero level of a surface near points.
    fn add(&mut self, object: usize, surface: &ImplicitSurface, points: &[OrientedPoint]) {
        let Some(grid) = Grid::around(points) else { return };
        let shape = RuntimeShape::<u32, 3>::new(grid.nodes);
        // A vertex beside a node without a value has no finite coordinates, and is left out.
        let mut values = vec![f32::NAN; shape.usize()];
        for node in points.iter().flat_map(|point| grid.around_point(point)) {
            let value = &mut values[shape.linearize(node) as usize];
            if value.is_nan() {
                let at = Point::from_vector(grid.place(node.map(f64::from)));
                *value = (surface.value_m(at) / grid.edge_m) as f32;
            }
        }
        let mut found = SurfaceNetsBuffer::default();
        surface_nets(&values, &shape, [0; 3], grid.nodes.map(|count| count - 1), &mut found);
        let index_of: Vec<Option<u32>> = found
            .positions
            .iter()
            .map(|position| {
                let start = grid.place(position.map(f64::from));
                let on = surface.project(Point::from_vector(start))?;
                if on.sd_m > MOST_SD_M || (on.at.vector() - start).norm() > grid.edge_m {
                    return None;
                }
                self.vertices.push(Vertex { on, object });
                Some(self.vertices.len() as u32 - 1)
            })
            .collect();
        let triangles = found.indices.chunks_exact(3).filter_map(|corners| {
            let [a, b, c] = [corners[0], corners[1], corners[2]].map(|corner| index_of[corner as usize]);
            Some([a?, b?, c?])
        });
        self.triangles.extend(triangles);
    }
}

/// A grid of nodes in World.
struct Grid {
    first_m: Vector3<f64>,
    edge_m: f64,
    nodes: [u32; 3],
}

impl Grid {
    /// The grid around some points. `None` without points.
    fn around(points: &[OrientedPoint]) -> Option<Self> {
        let places = || points.iter().map(|point| point.at.vector());
        let (low, high) = (places().reduce(|a, b| a.inf(&b))?, places().reduce(|a, b| a.sup(&b))?);
        let mut edge_m = GRID_M;
        loop {
            let nodes = ((high - low) / edge_m).map(|count| count.ceil() + 2.0 * REACH + 1.0);
            if nodes.product() <= MOST_NODES {
                let first_m = low - Vector3::repeat(REACH * edge_m);
                return Some(Self { first_m, edge_m, nodes: nodes.map(|count| count as u32).into() });
            }
            edge_m *= 2.0;
        }
    }

    /// The nodes on each side of a point, along each axis.
    fn around_point(&self, point: &OrientedPoint) -> impl Iterator<Item = [u32; 3]> {
        let place: [f64; 3] = ((point.at.vector() - self.first_m) / self.edge_m).into();
        let reach = REACH as u32;
        let [xs, ys, zs] = std::array::from_fn(|axis| {
            let node = place[axis].round() as u32;
            node.saturating_sub(reach)..=(node + reach).min(self.nodes[axis] - 1)
        });
        xs.flat_map(move |x| {
            let zs = zs.clone();
            ys.clone().flat_map(move |y| zs.clone().map(move |z| [x, y, z]))
        })
    }

    /// The point with these coordinates in edges of the grid.
    fn place(&self, coordinates: [f64; 3]) -> Vector3<f64> {
        self.first_m + Vector3::from(coordinates) * self.edge_m
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const RADIUS_M: f64 = 0.015;
    const CENTER_M: [f64; 3] = [0.2, -0.1, 0.05];

    /// Contacts of a touch along a circle of latitude of a sphere.
    fn along_a_circle(polar_rad: f64, touch: usize, sd_m: f64) -> Vec<OrientedPoint> {
        let contact = |i: i32| {
            let azimuth = 0.02 * f64::from(i);
            let normal =
                Vector3::new(polar_rad.sin() * azimuth.cos(), polar_rad.sin() * azimuth.sin(), polar_rad.cos());
            let at = Point::from_vector(Vector3::from(CENTER_M) + RADIUS_M * normal);
            let covariance_m2 = normal * normal.transpose() * sd_m * sd_m;
            OrientedPoint { at, normal, covariance_m2, normal_sd_rad: 5e-3, touch }
        };
        (0..100).map(contact).collect()
    }

    fn on_sphere() -> Vec<OrientedPoint> {
        [0.5, 0.7, 0.9].into_iter().enumerate().flat_map(|(touch, polar)| along_a_circle(polar, touch, 10e-6)).collect()
    }

    #[test]
    fn verif_the_mesh_of_a_sphere_lies_on_it_and_faces_outwards() {
        let mesh = SurfaceMesh::new(&[Vec::new(), on_sphere()]);
        let score = mesh.score(&Solid::Sphere { radius_m: RADIUS_M, center_m: CENTER_M });
        assert!(score.mean_m.unwrap() < 20e-6 && score.coverage.unwrap() > 0.95, "{score:?}");
        // The band between the circles, and a margin of some millimetres.
        let between_m2 = 2.0 * RADIUS_M * RADIUS_M * (0.5_f64.cos() - 0.9_f64.cos());
        assert!((1.0..4.0).contains(&(mesh.area_m2() / between_m2)), "{}", mesh.area_m2() / between_m2);
        assert!((0.3..0.9).contains(&(mesh.certain_area_m2() / mesh.area_m2())), "{}", mesh.certain_area_m2());
        let mut edges: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|corner| mesh.vertices[corner as usize]);
            let across = (b.on.at.vector() - a.on.at.vector()).cross(&(c.on.at.vector() - a.on.at.vector()));
            assert!(across.dot(&a.on.normal) > 0.0, "counter-clockwise from outside");
            for [from, to] in [[corners[0], corners[1]], [corners[1], corners[2]], [corners[2], corners[0]]] {
                *edges.entry((from, to)).or_default() += 1;
            }
        }
        assert!(edges.values().all(|count| *count == 1), "no two triangles have an edge in the same direction");
        assert!(mesh.vertices.iter().all(|vertex| vertex.object == 1 && vertex.on.sd_m <= MOST_SD_M));
    }

    #[test]
    fn verif_where_the_points_are_uncertain_there_is_no_surface() {
        let points = along_a_circle(0.7, 0, 2.0 * MOST_SD_M);
        let mesh = SurfaceMesh::new(&[points]);
        assert!(mesh.triangles.is_empty() && mesh.area_m2() == 0.0 && mesh.certain_area_m2() == 0.0);
        let score = mesh.score(&Solid::Sphere { radius_m: RADIUS_M, center_m: CENTER_M });
        assert_eq!(score, SurfaceScore { mean_m: None, coverage: None });
    }
}
