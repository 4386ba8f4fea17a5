//! Maps in the format PLY (ASCII), which MeshLab, CloudCompare, Blender and Open3D open.

use std::fmt::Write;

use nalgebra::Vector3;

use super::map::{SpatialMap, colour};
use super::surface::SurfaceMesh;

/// Properties of a place with its normal and its standard deviation, which its colour shows.
const PLACE: [&str; 10] = [
    "double x",
    "double y",
    "double z",
    "float nx",
    "float ny",
    "float nz",
    "uchar red",
    "uchar green",
    "uchar blue",
    "float sd_m",
];

/// Values of the properties [`PLACE`].
fn place(at: Vector3<f64>, normal: Vector3<f64>, sd_m: f64) -> String {
    let [red, green, blue] = colour(sd_m);
    format!(
        "{:.9} {:.9} {:.9} {:.6} {:.6} {:.6} {red} {green} {blue} {sd_m:.3e}",
        at.x, at.y, at.z, normal.x, normal.y, normal.z
    )
}

/// Lines of the header that describe an element.
fn element(name: &str, count: usize, properties: impl IntoIterator<Item = &'static str>) -> String {
    let mut text = format!("element {name} {count}\n");
    text.extend(properties.into_iter().map(|property| format!("property {property}\n")));
    text
}

/// A file of these elements and rows.
fn file(elements: &str, rows: impl IntoIterator<Item = String>) -> String {
    let mut text = format!("ply\nformat ascii 1.0\n{elements}end_header\n");
    for row in rows {
        writeln!(text, "{row}").expect("text grows");
    }
    text
}

impl SpatialMap {
    /// The points: coordinates (m), normal, colour by the standard deviation (10 um blue to 1 mm yellow, logarithmic), standard
    /// deviation (m), number of estimates and index of the object.
    pub fn to_ply(&self) -> String {
        let properties = PLACE.into_iter().chain(["uint estimates", "uint object"]);
        let rows = self.points.iter().map(|point| {
            format!("{} {} {}", place(point.at, point.normal, point.sd_m()), point.estimates, point.object)
        });
        file(&element("vertex", self.points.len(), properties), rows)
    }
}

impl SurfaceMesh {
    /// The triangles, with vertices as in [`SpatialMap::to_ply`]; the standard deviation is that along the normal.
    pub fn to_ply(&self) -> String {
        let vertices = element("vertex", self.vertices.len(), PLACE.into_iter().chain(["uint object"]));
        let faces = element("face", self.triangles.len(), ["list uchar uint vertex_indices"]);
        let of_vertices = self.vertices.iter().map(|vertex| {
            format!("{} {}", place(vertex.on.at.vector(), vertex.on.normal, vertex.on.sd_m), vertex.object)
        });
        let of_faces = self.triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}"));
        file(&(vertices + &faces), of_vertices.chain(of_faces))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;
    use whisker::space::frames::Point;
    use whisker::space::surface::ProjectedPoint;

    use super::super::map::SurfacePoint;
    use super::super::surface::Vertex;
    use super::*;

    /// Lines of the header, and rows.
    fn parts(text: &str) -> (Vec<&str>, Vec<&str>) {
        let mut lines = text.lines();
        (lines.by_ref().take_while(|line| *line != "end_header").collect(), lines.collect())
    }

    #[test]
    fn verif_points_are_written_with_colours_of_their_uncertainty() {
        let point = |sd_m: f64| SurfacePoint {
            at: Vector3::new(0.06, -0.005, 0.0),
            normal: Vector3::y(),
            covariance_m2: Matrix3::identity() * (sd_m * sd_m / 3.0),
            estimates: 3,
            object: 1,
        };
        let text = SpatialMap { points: vec![point(1e-5), point(1e-3)], ..SpatialMap::default() }.to_ply();
        let (header, rows) = parts(&text);
        assert_eq!(header[..4], ["ply", "format ascii 1.0", "element vertex 2", "property double x"]);
        assert_eq!(header.len(), 3 + rows[0].split(' ').count());
        assert_eq!(
            rows,
            [
                "0.060000000 -0.005000000 0.000000000 0.000000 1.000000 0.000000 68 1 84 1.000e-5 3 1",
                "0.060000000 -0.005000000 0.000000000 0.000000 1.000000 0.000000 253 231 37 1.000e-3 3 1",
            ]
        );
    }

    #[test]
    fn verif_a_surface_is_written_with_its_triangles() {
        let vertex = |x_m: f64| Vertex {
            on: ProjectedPoint { at: Point::new(x_m, 0.0, 0.0), normal: Vector3::y(), sd_m: 1e-5 },
            object: 0,
        };
        let mesh = SurfaceMesh { vertices: [0.0, 0.1, 0.2].map(vertex).to_vec(), triangles: vec![[0, 2, 1]] };
        let text = mesh.to_ply();
        let (header, rows) = parts(&text);
        assert_eq!(header[header.len() - 2..], ["element face 1", "property list uchar uint vertex_indices"]);
        assert_eq!(rows[3..], ["3 0 2 1"]);
        assert_eq!(rows[1], "0.100000000 0.000000000 0.000000000 0.000000 1.000000 0.000000 68 1 84 1.000e-5 0");
    }
}
