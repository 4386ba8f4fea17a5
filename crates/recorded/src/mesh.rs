//! Distance of points from the surface of a mesh.

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
}
