//! Lines of contacts that are held out together.

use nalgebra::Vector3;

/// Distance of a neighbouring line, relative to that of the nearest one.
const NEIGHBOUR: f64 = 1.5;

/// Indices of each line and its neighbours, from the centres of the lines (m).
pub(super) fn neighbours_of(centers: &[Vector3<f64>]) -> Vec<Vec<usize>> {
    let near = |line: usize| {
        let distances = centers.iter().map(|other| (other - centers[line]).norm()).enumerate();
        let distances: Vec<(usize, f64)> = distances.collect();
        let others = distances.iter().filter(|(other, _)| *other != line);
        let nearest = others.map(|(_, distance)| *distance).fold(f64::INFINITY, f64::min);
        let is_near = |&&(other, distance): &&(usize, f64)| other == line || distance <= NEIGHBOUR * nearest;
        distances.iter().filter(is_near).map(|(other, _)| *other).collect()
    };
    (0..centers.len()).map(near).collect()
}
