//! Distances of points from a mesh, and the extent of the part of its surface that they lie on.

use std::collections::BTreeMap;

use importers::Triangle;
use nalgebra::Vector3;

/// Distance of a point from the nearest triangle (m).
pub fn distance_m(point: &Vector3<f64>, mesh: &[Triangle]) -> f64 {
    (nearest(point, mesh) - point).norm()
}

/// Nearest point of a mesh. The point itself if the mesh is empty.
pub fn nearest(point: &Vector3<f64>, mesh: &[Triangle]) -> Vector3<f64> {
    let on = mesh.iter().map(|corners| on_triangle(point, &corners.map(Vector3::from)));
    on.min_by(|a, b| (a - point).norm_squared().total_cmp(&(b - point).norm_squared())).unwrap_or(*point)
}

/// Distance of a point from the nearest vertex (m): at least that from the surface, and larger where triangles are large.
pub fn vertex_distance_m(point: &Vector3<f64>, mesh: &[Triangle]) -> f64 {
    let square = |corner: &[f64; 3]| (Vector3::from(*corner) - point).norm_squared();
    mesh.iter().flatten().map(square).fold(f64::INFINITY, f64::min).sqrt()
}

/// A plane of triangles of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit normal, by the order of the corners.
    pub normal: Vector3<f64>,
    /// Distance of the plane from the origin along the normal (m).
    pub offset_m: f64,
}

impl Face {
    /// Largest difference of normals (1), and of offsets (m), of triangles of one plane.
    const SAME: [f64; 2] = [1e-3, 1e-5];

    /// The plane of the triangle that is nearest to a point, and the distance from this triangle (m). Triangles without area
    /// have no plane and are not considered; `None` if there are no others.
    pub fn nearest(point: &Vector3<f64>, mesh: &[Triangle]) -> Option<(Self, f64)> {
        let of_triangle = |corners: &Triangle| {
            let corners = corners.map(Vector3::from);
            let normal = normal(&corners)?;
            Some((Self { normal, offset_m: normal.dot(&corners[0]) }, (on_triangle(point, &corners) - point).norm()))
        };
        mesh.iter().filter_map(of_triangle).min_by(|(_, a_m), (_, b_m)| a_m.total_cmp(b_m))
    }

    /// Whether both are the same plane.
    pub fn is(&self, other: &Self) -> bool {
        (self.normal - other.normal).norm() < Self::SAME[0] && (self.offset_m - other.offset_m).abs() < Self::SAME[1]
    }
}

/// Unit normal of a triangle by the order of its corners. `None` if they lie on a line, to rounding.
fn normal([a, b, c]: &[Vector3<f64>; 3]) -> Option<Vector3<f64>> {
    const ROUNDING: f64 = 1e-12;
    let (ab, ac) = (b - a, c - a);
    ab.cross(&ac).try_normalize(ROUNDING * ab.norm() * ac.norm())
}

/// Edge of the cells in which points of the surface count as one (m).
pub const CELL_M: f64 = 0.5e-3;

/// Distance of two neighbouring cells beyond which the surface between them is not covered (m).
const GAP_M: f64 = 2e-3;

/// Length of the part of the surface that the nearest points of some contacts cover (m): the points are averaged in cells of
/// [`CELL_M`], and the cells connected by the shortest tree, without connections longer than 2 mm. A contact that moves to and fro
/// at one place has no extent, and an error away from the surface adds none.
pub fn extent_m(contacts: &[Vector3<f64>], mesh: &[Triangle]) -> f64 {
    let mut cells: BTreeMap<[i64; 3], (Vector3<f64>, f64)> = BTreeMap::new();
    for contact in contacts {
        let point = nearest(contact, mesh);
        let of_cell = cells.entry(point.map(|m| (m / CELL_M).floor() as i64).into()).or_default();
        (of_cell.0, of_cell.1) = (of_cell.0 + point, of_cell.1 + 1.0);
    }
    let mut far: Vec<(Vector3<f64>, f64)> =
        cells.into_values().map(|(sum, count)| (sum / count, f64::INFINITY)).collect();
    // Prim's algorithm: the second number of a cell is its distance from the tree.
    let mut length_m = 0.0;
    let Some((mut last, _)) = far.pop() else { return length_m };
    while !far.is_empty() {
        for (center, distance_m) in &mut far {
            *distance_m = distance_m.min((*center - last).norm());
        }
        let next = far.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(index, _)| index);
        let (center, distance_m) = far.swap_remove(next.expect("a cell"));
        last = center;
        if distance_m <= GAP_M {
            length_m += distance_m;
        }
    }
    length_m
}

/// Nearest point of a triangle, by the Voronoi regions of its features (Ericson, "Real-Time Collision Detection", 2005,
/// section 5.1.5).
fn on_triangle(p: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> Vector3<f64> {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let total = va + vb + vc;
    if total == 0.0 { *a } else { a + ab * (vb / total) + ac * (vc / total) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_distances_to_face_edge_and_corner() {
        let mesh: [Triangle; 1] = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
        for (point, expected) in [
            ([0.2, 0.2, 0.5], 0.5),
            ([0.5, -0.3, 0.4], 0.5),
            ([2.0, 0.0, 0.0], 1.0),
            ([0.25, 0.25, 0.0], 0.0),
            ([1.0, 1.0, 0.0], 0.5_f64.sqrt()),
        ] {
            assert!((distance_m(&Vector3::from(point), &mesh) - expected).abs() < 1e-12, "{point:?}");
        }
    }

    /// A square of 40 mm in the plane of x and z.
    const SQUARE: [Triangle; 2] = [
        [[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.04, 0.0, 0.04]],
        [[0.0, 0.0, 0.0], [0.04, 0.0, 0.04], [0.0, 0.0, 0.04]],
    ];

    #[test]
    fn verif_jitter_has_no_extent() {
        let at = |x_m: f64, row: usize| Vector3::new(x_m, if row.is_multiple_of(2) { 1e-3 } else { -1e-3 }, 0.02);
        let still: Vec<_> = (0..200).map(|row| at(0.0101 + 0.1e-3 * (row % 3) as f64, row)).collect();
        assert!(extent_m(&still, &SQUARE) < CELL_M, "{}", extent_m(&still, &SQUARE));
        let moved: Vec<_> =
            (0..200).map(|row| at(0.005 + 0.1e-3 * row as f64 + 0.2e-3 * (row % 2) as f64, row)).collect();
        assert!((extent_m(&moved, &SQUARE) - 0.02).abs() < 2.0 * CELL_M, "{}", extent_m(&moved, &SQUARE));
        // Two parts of 5 mm, 10 mm apart.
        let parts: Vec<_> =
            (0..100).map(|row| at(1e-4 * row as f64 + if row < 50 { 0.0 } else { 0.01 }, row)).collect();
        assert!((extent_m(&parts, &SQUARE) - 0.01).abs() < 2.0 * CELL_M, "{}", extent_m(&parts, &SQUARE));
        assert_eq!(extent_m(&[], &SQUARE), 0.0);
    }

    #[test]
    fn verif_vertices_are_farther_than_the_surface() {
        let point = Vector3::new(0.02, 1e-3, 0.01);
        assert!((distance_m(&point, &SQUARE) - 1e-3).abs() < 1e-15);
        assert!((vertex_distance_m(&point, &SQUARE) - (0.02_f64.powi(2) + 1e-6 + 1e-4).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn verif_triangles_of_one_plane_are_one_face() {
        let of = |x: f64, z: f64| Face::nearest(&Vector3::new(x, 1e-3, z), &SQUARE).expect("a face").0;
        assert!(of(0.03, 0.01).is(&of(0.01, 0.03)));
        let flipped = SQUARE.map(|[a, b, c]| [a, c, b]);
        assert!(!Face::nearest(&Vector3::new(0.03, 0.0, 0.01), &flipped).expect("a face").0.is(&of(0.03, 0.01)));
    }

    #[test]
    fn verif_triangles_without_area_have_no_face() {
        let line: Triangle = [[0.0, 1e-3, 0.0], [0.02, 1e-3, 0.02], [0.06, 1e-3, 0.06]];
        let point = Vector3::new(0.03, 1.2e-3, 0.01);
        let expected = Face::nearest(&point, &SQUARE).expect("a face");
        assert!((expected.1 - 1.2e-3).abs() < 1e-15);
        assert_eq!(Face::nearest(&point, &[line, SQUARE[0], SQUARE[1]]), Some(expected));
        assert_eq!(Face::nearest(&point, &[line]), None);
        assert_eq!(Face::nearest(&point, &[[[0.0; 3]; 3]]), None);
        assert_eq!(Face::nearest(&point, &[]), None);
    }
}
