//! Tabulated smooth functions of two coordinates.
//!
//! Between the nodes of an even grid the function is the bicubic Hermite polynomial of the values, the slopes and the
//! mixed derivatives at the four surrounding nodes: with the pitch `h` the error of the value is `h^4 / 384` times the
//! fourth derivative, and value and gradient are continuous. Beyond the grid it is extrapolated linearly.

use nalgebra::Vector2;

/// An even grid over a rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    first: [f64; 2],
    pitch: [f64; 2],
    nodes: [usize; 2],
}

/// A position in a grid: the cell and the position within it, in pitches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    node: usize,
    part: [f64; 2],
    /// Distance beyond the grid, in pitches.
    beyond: Vector2<f64>,
}

/// Weights of value and slope at the two ends of a pitch.
#[inline]
fn weights(t: f64) -> [[f64; 2]; 2] {
    let r = 1.0 - t;
    [[(1.0 + 2.0 * t) * r * r, t * r * r], [t * t * (1.0 + 2.0 * r), -t * t * r]]
}

/// Their derivatives by the position.
#[inline]
fn weight_slopes(t: f64) -> [[f64; 2]; 2] {
    let r = 1.0 - t;
    [[-6.0 * t * r, r * (r - 2.0 * t)], [6.0 * t * r, t * (t - 2.0 * r)]]
}

/// A function with its derivatives by the two coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Looked {
    pub(super) value: f64,
    pub(super) gradient: Vector2<f64>,
}

/// A function on a grid.
#[derive(Clone, Debug)]
pub(super) struct Table {
    grid: Grid,
    /// Value, slopes and mixed derivative at each node, by pitches.
    nodes: Vec<[f64; 4]>,
}

impl Grid {
    /// A grid of `nodes` between two corners.
    pub(super) fn new(first: [f64; 2], last: [f64; 2], nodes: [usize; 2]) -> Self {
        let pitch = [0, 1].map(|axis| (last[axis] - first[axis]) / (nodes[axis] - 1) as f64);
        Self { first, pitch, nodes }
    }

    /// Values of a coordinate at its nodes.
    pub(super) fn axis(&self, axis: usize) -> impl ExactSizeIterator<Item = f64> + use<> {
        let (first, pitch) = (self.first[axis], self.pitch[axis]);
        (0..self.nodes[axis]).map(move |node| first + node as f64 * pitch)
    }

    /// Number of nodes.
    pub(super) fn count(&self) -> usize {
        self.nodes[0] * self.nodes[1]
    }

    /// The position of a pair of coordinates.
    pub(super) fn place(&self, at: [f64; 2]) -> Place {
        let mut cell = [0; 2];
        let mut part = [0.0; 2];
        let mut beyond = Vector2::zeros();
        for axis in 0..2 {
            let last = self.nodes[axis] - 1;
            let position = (at[axis] - self.first[axis]) / self.pitch[axis];
            let held = position.clamp(0.0, last as f64);
            cell[axis] = (held as u32 as usize).min(last - 1);
            part[axis] = held - cell[axis] as f64;
            beyond[axis] = position - held;
        }
        Place { node: cell[0] * self.nodes[1] + cell[1], part, beyond }
    }
}

/// Derivative by node number at each of some evenly spaced values, of second order; one-sided at the ends.
fn differences(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    (0..=last)
        .map(|i| {
            if last < 2 {
                values[last] - values[0]
            } else if i == 0 {
                -1.5 * values[0] + 2.0 * values[1] - 0.5 * values[2]
            } else if i == last {
                1.5 * values[last] - 2.0 * values[last - 1] + 0.5 * values[last - 2]
            } else {
                0.5 * (values[i + 1] - values[i - 1])
            }
        })
        .collect()
}

impl Table {
    /// The function with these values and slopes at the nodes; the second coordinate varies fastest. Without `slopes`,
    /// differences of the values are used.
    pub(super) fn new(grid: Grid, values: &[f64], slopes: Option<&[Vector2<f64>]>) -> Self {
        let along = |values: &[f64], axis: usize| -> Vec<f64> {
            let [rows, columns] = grid.nodes;
            let mut slopes = vec![0.0; values.len()];
            let (lines, length, stride, step) =
                if axis == 0 { (columns, rows, 1, columns) } else { (rows, columns, columns, 1) };
            for line in 0..lines {
                let index = |i: usize| line * stride + i * step;
                let of_line: Vec<f64> = (0..length).map(|i| values[index(i)]).collect();
                for (i, slope) in differences(&of_line).into_iter().enumerate() {
                    slopes[index(i)] = slope;
                }
            }
            slopes
        };
        let by = |axis: usize| match slopes {
            Some(slopes) => slopes.iter().map(|slope| slope[axis] * grid.pitch[axis]).collect(),
            None => along(values, axis),
        };
        let (first, second) = (by(0), by(1));
        // Differences of each slope along the other coordinate, equally accurate; the mean is used.
        let (one, other) = (along(&first, 1), along(&second, 0));
        let node = |i: usize| [values[i], first[i], second[i], 0.5 * (one[i] + other[i])];
        Self { grid, nodes: (0..values.len()).map(node).collect() }
    }

    /// The value alone of [`Self::look`], bit by bit.
    pub(super) fn value(&self, place: &Place) -> f64 {
        if place.beyond != Vector2::zeros() {
            return self.look(place).value;
        }
        let [u, v] = place.part.map(weights);
        let mut value = 0.0;
        for (i, u) in u.iter().enumerate() {
            for (j, v) in v.iter().enumerate() {
                let [f, f_u, f_v, f_uv] = self.nodes[place.node + i * self.grid.nodes[1] + j];
                let (level, steep) = (f * v[0] + f_v * v[1], f_u * v[0] + f_uv * v[1]);
                value += u[0] * level + u[1] * steep;
            }
        }
        value
    }

    /// The function at a position in its grid.
    pub(super) fn look(&self, place: &Place) -> Looked {
        let [u, v] = place.part.map(weights);
        let [du, dv] = place.part.map(weight_slopes);
        let (mut value, mut gradient) = (0.0, Vector2::zeros());
        for i in 0..2 {
            for j in 0..2 {
                let [f, f_u, f_v, f_uv] = self.nodes[place.node + i * self.grid.nodes[1] + j];
                let (level, steep) = (f * v[j][0] + f_v * v[j][1], f_u * v[j][0] + f_uv * v[j][1]);
                value += u[i][0] * level + u[i][1] * steep;
                gradient.x += du[i][0] * level + du[i][1] * steep;
                gradient.y += u[i][0] * (f * dv[j][0] + f_v * dv[j][1]) + u[i][1] * (f_u * dv[j][0] + f_uv * dv[j][1]);
            }
        }
        let [pitch_u, pitch_v] = self.grid.pitch;
        Looked {
            value: value + gradient.dot(&place.beyond),
            gradient: Vector2::new(gradient.x / pitch_u, gradient.y / pitch_v),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_value_alone_is_that_with_the_gradient() {
        let (grid, table) = table(9, true);
        for i in 0..40 {
            let at = [0.3 + 0.06 * f64::from(i), -1.1 + 0.058 * f64::from(i)];
            let place = grid.place(at);
            assert_eq!(table.value(&place), table.look(&place).value, "{at:?}");
        }
    }

    fn table(nodes: usize, with_slopes: bool) -> (Grid, Table) {
        let grid = Grid::new([0.5, -1.0], [2.5, 1.0], [nodes, nodes]);
        let (mut values, mut slopes) = (Vec::new(), Vec::new());
        for u in grid.axis(0) {
            for v in grid.axis(1) {
                values.push((u * v).sin());
                slopes.push(Vector2::new(v, u) * (u * v).cos());
            }
        }
        let table = Table::new(grid, &values, with_slopes.then_some(&slopes[..]));
        (grid, table)
    }

    fn worst(nodes: usize, with_slopes: bool) -> (f64, f64) {
        let (grid, table) = table(nodes, with_slopes);
        let places =
            (0..=90).flat_map(|i| (0..=90).map(move |j| (0.5 + f64::from(i) / 45.0, -1.0 + f64::from(j) / 45.0)));
        places.fold((0.0, 0.0), |(value, gradient): (f64, f64), (u, v)| {
            let found = table.look(&grid.place([u, v]));
            let slope = Vector2::new(v, u) * (u * v).cos();
            (value.max((found.value - (u * v).sin()).abs()), gradient.max((found.gradient - slope).norm()))
        })
    }

    #[test]
    fn val_order_of_the_interpolation() {
        let (coarse, fine) = (worst(11, true), worst(41, true));
        assert!(coarse.0 / fine.0 > 100.0 && coarse.1 / fine.1 > 25.0, "{coarse:?} {fine:?}");
        assert!(worst(41, false).0 < 1e-4);
    }

    #[test]
    fn verif_extrapolates_linearly() {
        let (grid, table) = table(21, true);
        let edge = table.look(&grid.place([2.5, 0.3]));
        let beyond = table.look(&grid.place([2.7, 0.3]));
        assert!((beyond.value - edge.value - 0.2 * edge.gradient.x).abs() < 1e-12);
        assert_eq!(beyond.gradient, edge.gradient);
    }
}
