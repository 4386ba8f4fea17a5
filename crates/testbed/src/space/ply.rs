//! Maps in the format PLY (ASCII), which MeshLab, CloudCompare, Blender and Open3D open.

use std::fmt::Write;
use std::path::Path;

use files::read_table;
use nalgebra::Vector3;
use whisker::space::frames::Point;
use whisker::space::surface::ProjectedPoint;

use super::map::{SpatialMap, colour};
use super::surface::{SurfaceMesh, Vertex};

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

/// Largest magnitude of a number that is read. Numbers up to it are unchanged when they are rounded, written and read again.
const LARGEST: f64 = 1e9;

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
        let of_vertices = self.vertices.iter().map(|vertex| {
            format!("{} {}", place(vertex.on.at.vector(), vertex.on.normal, vertex.on.sd_m), vertex.object)
        });
        let of_faces = self.triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}"));
        file(&surface_elements(self.vertices.len(), self.triangles.len()), of_vertices.chain(of_faces))
    }

    /// Reads a surface that [`SurfaceMesh::to_ply`] has written, with its rounding.
    ///
    /// # Errors
    /// [`files::Error`] with the line if the file cannot be read or has another form.
    pub fn read_ply(path: &Path) -> Result<Self, files::Error> {
        let bytes = read_table(path)?;
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = Lines { path, lines: text.lines(), number: 0 };
        let count = |of: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix("element ")?.strip_prefix(of))?;
            line.trim().parse::<usize>().ok()
        };
        let (vertices, triangles) = (count("vertex").unwrap_or(0), count("face").unwrap_or(0));
        file(&surface_elements(vertices, triangles), []).lines().try_for_each(|expected| lines.expect(expected))?;
        let mesh = Self {
            vertices: (0..vertices).map(|_| lines.vertex()).collect::<Result<_, _>>()?,
            triangles: (0..triangles).map(|_| lines.corners(vertices)).collect::<Result<_, _>>()?,
        };
        if let Some(surplus) = lines.lines.next() {
            lines.number += 1;
            return Err(lines.error(surplus, "the end of the file"));
        }
        Ok(mesh)
    }
}

/// The header's description of a surface.
fn surface_elements(vertices: usize, triangles: usize) -> String {
    element("vertex", vertices, PLACE.into_iter().chain(["uint object"]))
        + &element("face", triangles, ["list uchar uint vertex_indices"])
}

/// Lines of a file that is read.
struct Lines<'a> {
    path: &'a Path,
    lines: std::str::Lines<'a>,
    /// Number of the last line.
    number: u64,
}

impl<'a> Lines<'a> {
    /// Checks that the next line has this text.
    fn expect(&mut self, expected: &str) -> Result<(), files::Error> {
        let found = self.next();
        if found == expected { Ok(()) } else { Err(self.error(found, &format!("`{expected}`"))) }
    }

    /// The vertex of the next line. Its colour is that of its standard deviation.
    fn vertex(&mut self) -> Result<Vertex, files::Error> {
        let line = self.next();
        let numbers: Option<Vec<f64>> = line.split(' ').map(|word| word.parse().ok()).collect();
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.abs() <= LARGEST));
        let numbers: Option<[f64; 11]> = numbers.and_then(|numbers| numbers.try_into().ok());
        let Some([x, y, z, nx, ny, nz, _, _, _, sd_m, object]) = numbers else {
            return Err(self.error(line, "11 numbers of a magnitude of at most 1e9"));
        };
        if !(sd_m >= 0.0 && object >= 0.0 && object.fract() == 0.0) {
            return Err(self.error(line, "a standard deviation of at least 0 and the number of an object at the end"));
        }
        let (at, normal) = (Point::from_vector(Vector3::new(x, y, z)), Vector3::new(nx, ny, nz));
        Ok(Vertex { on: ProjectedPoint { at, normal, sd_m }, object: object as usize })
    }

    /// The indices of the corners of a triangle in the next line, less than `vertices`.
    fn corners(&mut self, vertices: usize) -> Result<[u32; 3], files::Error> {
        let line = self.next();
        let numbers: Option<Vec<u32>> = line.split(' ').map(|word| word.parse().ok()).collect();
        let corners = numbers.and_then(|numbers| match numbers[..] {
            [3, a, b, c] => Some([a, b, c]),
            _ => None,
        });
        let corners = corners.filter(|corners| corners.iter().all(|corner| (*corner as usize) < vertices));
        corners.ok_or_else(|| self.error(line, &format!("3 and three whole numbers below {vertices}")))
    }

    /// The next line; empty after the last one.
    fn next(&mut self) -> &'a str {
        self.number += 1;
        self.lines.next().unwrap_or_default()
    }

    fn error(&self, found: &str, expected: &str) -> files::Error {
        files::Error::Table {
            path: self.path.into(),
            line: self.number,
            place: "row".into(),
            found: if found.is_empty() { "no row".into() } else { format!("`{found}`") },
            expected: expected.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use nalgebra::Matrix3;

    use super::super::map::SurfacePoint;
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("surface.ply");
        fs::write(&path, &text).unwrap();
        assert_eq!(SurfaceMesh::read_ply(&path).unwrap(), mesh);
    }

    #[test]
    fn robust_another_file_is_no_surface() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("surface.ply");
        let refused = |text: &str| {
            fs::write(&path, text).unwrap();
            SurfaceMesh::read_ply(&path).unwrap_err().to_string()
        };
        assert!(refused("").ends_with("surface.ply:1: row: found no row, expected `ply`"));
        let text = SurfaceMesh::default().to_ply();
        assert!(
            refused(&text.replace("float sd_m", "float error"))
                .ends_with("found `property float error`, expected `property float sd_m`")
        );
        let short = text.replace("element vertex 0", "element vertex 1");
        assert!(
            refused(&short).ends_with("row: found no row, expected 11 numbers of a magnitude of at most 1e9"),
            "{}",
            refused(&short)
        );
        let one = short + "0 0 0 0 1 0 68 1 84 nan 0\n";
        assert!(
            refused(&one).ends_with("84 nan 0`, expected 11 numbers of a magnitude of at most 1e9"),
            "{}",
            refused(&one)
        );
        for (end, words) in [
            ("1e300 0", "expected 11 numbers of a magnitude of at most 1e9"),
            ("-1e-5 0", "expected a standard deviation of at least 0"),
            ("1e-5 0.5", "the number of an object at the end"),
            ("1e-5 -1", "the number of an object at the end"),
        ] {
            let message = refused(&one.replace("nan 0", end));
            assert!(message.contains(words), "{message}");
        }
        let beyond = one.replace("nan", "1e-5").replace("element face 0", "element face 1") + "3 0 0 1\n";
        for face in ["3 0 0 1", "4 0 0 0", "3 0 0 -1", "3 0 0 0.5"] {
            let message = refused(&beyond.replace("3 0 0 1", face));
            assert!(
                message.ends_with(&format!("found `{face}`, expected 3 and three whole numbers below 1")),
                "{message}"
            );
        }
        let surplus = beyond.replace("3 0 0 1", "3 0 0 0") + "0\n";
        assert!(refused(&surplus).ends_with("row: found `0`, expected the end of the file"));
    }
}
