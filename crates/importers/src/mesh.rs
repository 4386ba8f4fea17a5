//! Plane sections of meshes in binary STL.

use std::collections::BTreeMap;
use std::path::Path;

use files::Error;
use files::read_table;

/// Size of the header in bytes: a comment of 80 bytes and the number of triangles.
const HEAD: usize = 84;
/// Size of a triangle in bytes: a normal and three vertices of three `f32` each, and a 16-bit attribute.
const TRIANGLE: usize = 50;

/// Vertices nearer than this are identified, in the mesh's unit.
const SAME: f64 = 1e-4;

/// Corners of a triangle, each with three coordinates.
pub type Triangle = [[f64; 3]; 3];

/// Point in the plane of the section.
type Point = [f64; 2];

/// Outer loop of the section of a mesh with the plane at height `z`, counter-clockwise, with the first point repeated
/// at the end, in the mesh's unit. Empty if the plane does not intersect the mesh.
///
/// # Errors
/// [`Error`] as [`triangles`].
pub(crate) fn section(path: &Path, z: f64) -> Result<Vec<Point>, Error> {
    let edges: Vec<[Point; 2]> = triangles(path)?.iter().filter_map(|corners| cut(corners, z)).collect();
    let outer = loops(&edges).into_iter().max_by(|a, b| area(a).abs().total_cmp(&area(b).abs()));
    let mut outer = outer.unwrap_or_default();
    if area(&outer) < 0.0 {
        outer.reverse();
    }
    Ok(outer)
}

/// Corners of the triangles of a mesh, in its unit.
///
/// # Errors
/// [`Error`] if the file cannot be read, is not a binary STL, or has a coordinate that is not finite.
pub(crate) fn triangles(path: &Path) -> Result<Vec<Triangle>, Error> {
    let bytes = read_table(path)?;
    let count = bytes.get(HEAD - 4..HEAD).map(|field| u32::from_le_bytes(field.try_into().expect("four bytes")));
    let expected = count.map_or(HEAD, |count| HEAD + TRIANGLE * count as usize);
    if bytes.len() != expected || count.is_none() {
        return Err(Error::value(path, "size", bytes.len(), format!("{expected} bytes of a binary STL")));
    }
    let triangles: Vec<Triangle> = bytes[HEAD..].chunks_exact(TRIANGLE).map(corners).collect();
    for (index, corners) in triangles.iter().enumerate() {
        if let Some(found) = corners.iter().flatten().find(|coordinate| !coordinate.is_finite()) {
            return Err(Error::value(path, format!("triangles[{index}]"), found, "finite coordinates"));
        }
    }
    Ok(triangles)
}

fn corners(triangle: &[u8]) -> Triangle {
    let number = |i: usize| {
        let at = 4 * (3 + i);
        f64::from(f32::from_le_bytes(triangle[at..at + 4].try_into().expect("four bytes")))
    };
    std::array::from_fn(|corner| std::array::from_fn(|axis| number(3 * corner + axis)))
}

/// Intersection of a triangle with the plane. A corner in the plane counts as above it, so that adjacent triangles
/// agree.
fn cut(corners: &Triangle, z: f64) -> Option<[Point; 2]> {
    let crossings: Vec<Point> = (0..3)
        .filter_map(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            ((a[2] < z) != (b[2] < z)).then(|| {
                let part = (z - a[2]) / (b[2] - a[2]);
                [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
            })
        })
        .collect();
    crossings.try_into().ok()
}

/// Joins edges to closed loops, each with its first point repeated at the end. Open chains are dropped.
fn loops(edges: &[[Point; 2]]) -> Vec<Vec<Point>> {
    let key = |point: &Point| point.map(|value| (value / SAME).round() as i64);
    let mut at: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
    for (i, edge) in edges.iter().enumerate() {
        edge.iter().for_each(|end| at.entry(key(end)).or_default().push(i));
    }
    let mut used = vec![false; edges.len()];
    let mut loops = Vec::new();
    for start in 0..edges.len() {
        if std::mem::replace(&mut used[start], true) {
            continue;
        }
        let mut line = edges[start].to_vec();
        while let Some(next) = at[&key(&line[line.len() - 1])].iter().copied().find(|&edge| !used[edge]) {
            used[next] = true;
            let [a, b] = edges[next];
            line.push(if key(&a) == key(&line[line.len() - 1]) { b } else { a });
        }
        if line.len() > 3 && key(&line[0]) == key(&line[line.len() - 1]) {
            let first = line[0];
            line.pop();
            line.push(first);
            loops.push(line);
        }
    }
    loops
}

/// Signed area of a closed loop, positive if counter-clockwise.
fn area(line: &[Point]) -> f64 {
    line.windows(2).map(|edge| 0.5 * (edge[0][0] * edge[1][1] - edge[1][0] * edge[0][1])).sum()
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// Square tube without end faces, from z = 0 to 1.
    fn tube() -> Vec<u8> {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        let mut bytes = vec![0u8; 80];
        bytes.extend(8u32.to_le_bytes());
        for i in 0..4 {
            let ([ax, ay], [bx, by]): ([f32; 2], [f32; 2]) = (square[i], square[(i + 1) % 4]);
            let low_high =
                [[[ax, ay, 0.0], [bx, by, 0.0], [bx, by, 1.0]], [[ax, ay, 0.0], [bx, by, 1.0], [ax, ay, 1.0]]];
            for triangle in low_high {
                let numbers = [0.0f32; 3].into_iter().chain(triangle.into_iter().flatten());
                bytes.extend(numbers.flat_map(f32::to_le_bytes).chain([0, 0]));
            }
        }
        bytes
    }

    fn cut_at(bytes: &[u8], z: f64) -> Result<Vec<Point>, Error> {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(bytes).expect("written");
        section(file.path(), z)
    }

    #[test]
    fn verif_section_of_a_tube_is_its_square() {
        let outer = cut_at(&tube(), 0.25).expect("a section");
        assert_eq!(area(&outer), 2.0);
        assert_eq!(outer.first(), outer.last());
        assert!(cut_at(&tube(), 3.0).expect("a mesh").is_empty());
    }

    #[test]
    fn robust_damaged_meshes_are_rejected() {
        let bytes = tube();
        for damaged in [&bytes[..bytes.len() - 1], &bytes[..40]] {
            let message = cut_at(damaged, 0.5).expect_err("damaged").to_string();
            assert!(message.contains("of a binary STL"), "{message}");
        }
        let mut infinite = bytes.clone();
        let at = HEAD + 3 * TRIANGLE + 12;
        infinite[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        let message = cut_at(&infinite, 0.5).expect_err("not finite").to_string();
        assert!(message.contains("triangles[3]: found NaN, expected finite coordinates"), "{message}");
    }
}
