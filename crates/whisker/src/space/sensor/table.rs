//! Tabulated smooth functions of the coordinates about a whisker.
//!
//! The table spans the calibrated domain in the coordinates `ln s`, `u / a(s)` and `v / a(s)`, with the arc length `s`, the
//! displacements `u` to the left and `v` upwards, and an extent `a(s) = c s^k`: the readings are nearly powers of `s` and nearly
//! linear in the displacements. Between the nodes the function is the cubic polynomial through the four nearest nodes along each
//! axis, whose error decreases with the fourth power of the pitch. Beyond the table it is that of the nearest cell, and below a
//! tenth of the first arc length that at this tenth.

use std::sync::Mutex;
use std::thread;

use filters::fearless_simd::f64x8;
use filters::fearless_simd::prelude::*;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{Around, SpatialDomain};

/// Nodes along the whisker and across. Stored calibrations depend on them, on the margin and on the exponents (`log_sds` of a
/// Gaussian process).
const NODES: [usize; 3] = [19, 13, 13];

/// Numbers that are computed together.
const WIDTH: usize = 8;

/// Extent of the table across the whisker, relative to the calibrated domain.
const MARGIN: f64 = 1.05;

/// Exponents `k` of the extent.
const EXPONENTS: [f64; 7] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0];

/// The grid of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Grid {
    first_m: f64,
    /// Difference of `ln s` of neighbouring nodes.
    pitch: f64,
    /// `c` and `k` of the extent.
    extent: (f64, f64),
}

/// Values and derivatives of a function at a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Looked<const C: usize> {
    pub(crate) values: SVector<f64, C>,
    /// Derivatives by the coordinates about the whisker, one row per value.
    pub(crate) slopes: SMatrix<f64, C, 3>,
}

/// A function with `C` values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table<const C: usize> {
    grid: Grid,
    nodes: Vec<[f64; C]>,
}

impl Grid {
    /// Number of nodes.
    pub(crate) const COUNT: usize = NODES[0] * NODES[1] * NODES[2];

    /// The grid around a calibrated domain: of the extents that contain it, the one that exceeds it least.
    pub(crate) fn new(domain: &SpatialDomain) -> Self {
        let (first_m, last_m) = domain.tabulated_range_m();
        let node = |i: usize| (domain.arc_m[i].max(first_m), domain.most_at_node_m(i));
        let fitted = |k: f64| {
            let c = (0..domain.arc_m.len()).map(|i| node(i).1 / node(i).0.powf(k)).fold(0.0, f64::max);
            let excess = (0..domain.arc_m.len()).map(|i| c * node(i).0.powf(k)).sum::<f64>();
            (excess, (c, k))
        };
        let fits = EXPONENTS.map(fitted);
        let (_, (c, k)) = fits.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are exponents");
        Self { first_m, pitch: (last_m / first_m).ln() / (NODES[0] - 1) as f64, extent: (MARGIN * c, k) }
    }

    /// Arc length below which the function is that at this one.
    fn least_m(&self) -> f64 {
        0.1 * self.first_m
    }

    /// `a(s)` and its derivative.
    fn extent_m(&self, along_m: f64) -> (f64, f64) {
        let (c, k) = self.extent;
        let least_m = self.least_m();
        let value = c * along_m.max(least_m).powf(k);
        (value, if along_m > least_m { k * value / along_m } else { 0.0 })
    }

    /// Coordinates of the node with these indices.
    fn node(&self, index: [usize; 3]) -> Around {
        let along_m = self.first_m * (index[0] as f64 * self.pitch).exp();
        let across = |axis: usize| 2.0 * index[axis] as f64 / (NODES[axis] - 1) as f64 - 1.0;
        let extent_m = self.extent_m(along_m).0;
        Around::new(along_m, across(1) * extent_m, across(2) * extent_m)
    }

    /// Coordinates of all nodes, ascending along the whisker, then to the left, then upwards.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = Around> {
        indices().map(|index| self.node(index))
    }
}

/// Indices of all nodes, in the order of [`Grid::nodes`].
fn indices() -> impl Iterator<Item = [usize; 3]> {
    let [along, columns, depth] = NODES;
    (0..along).flat_map(move |i| (0..columns).flat_map(move |j| (0..depth).map(move |k| [i, j, k])))
}

/// Order in which the nodes across the whisker are computed: from the middle outwards, so that each has a computed neighbour
/// nearer to the undeflected whisker.
fn outwards() -> Vec<[usize; 2]> {
    let middle = |i: usize, axis: usize| i.abs_diff(NODES[axis] / 2);
    let mut order: Vec<[usize; 2]> = (0..NODES[1]).flat_map(|j| (0..NODES[2]).map(move |k| [j, k])).collect();
    order.sort_by_key(|&[j, k]| (middle(j, 1).pow(2) + middle(k, 2).pow(2), j, k));
    order
}

/// Values at the nodes of one arc length, given those of the middle node. `None` if there are none somewhere.
fn slice<const C: usize, State: Copy>(
    order: &[[usize; 2]],
    middle: (SVector<f64, C>, State),
    values: impl Fn([usize; 2], State) -> Option<(SVector<f64, C>, State)>,
) -> Option<Vec<[f64; C]>> {
    let inwards = |i: usize, axis: usize| {
        let middle = NODES[axis] / 2;
        i - usize::from(i > middle) + usize::from(i < middle)
    };
    let mut found = vec![middle; NODES[1] * NODES[2]];
    // The first is the middle node.
    for &[j, k] in &order[1..] {
        let (_, near) = found[inwards(j, 1) * NODES[2] + inwards(k, 2)];
        found[j * NODES[2] + k] = values([j, k], near)?;
    }
    Some(found.into_iter().map(|(value, _)| value.into()).collect())
}

impl<const C: usize> Table<C> {
    /// Tabulates `values`, which may be computed from the result of a neighbouring node, with a thread per processor. `None` if it
    /// has no values somewhere.
    pub(crate) fn new<State: Copy + Send>(
        grid: Grid,
        values: impl Fn(Around, Option<State>) -> Option<(SVector<f64, C>, State)> + Sync,
    ) -> Option<Self> {
        // Of the nodes at one arc length, only the middle one depends on those at another.
        let mut middles = Vec::with_capacity(NODES[0]);
        let mut along: Option<State> = None;
        for i in 0..NODES[0] {
            let middle = values(grid.node([i, NODES[1] / 2, NODES[2] / 2]), along)?;
            along = Some(middle.1);
            middles.push(middle);
        }
        let order = outwards();
        let mut slices = vec![None; NODES[0]];
        let rest = Mutex::new(slices.iter_mut().zip(middles).enumerate());
        let next = || rest.lock().expect("no thread panics while it holds the lock").next();
        let work = || {
            while let Some((i, (nodes, middle))) = next() {
                *nodes = slice(&order, middle, |[j, k], near| values(grid.node([i, j, k]), Some(near)));
            }
        };
        thread::scope(|scope| {
            for _ in 1..thread::available_parallelism().map_or(1, usize::from).min(NODES[0]) {
                // Without a further thread, this one does the work.
                let _ = thread::Builder::new().spawn_scoped(scope, work);
            }
            work();
        });
        let nodes = slices.into_iter().collect::<Option<Vec<_>>>()?.concat();
        Some(Self { grid, nodes })
    }

    /// The table with these values at [`Grid::nodes`]. `None` if there is not one value per node.
    pub(crate) fn of_nodes(grid: Grid, nodes: Vec<[f64; C]>) -> Option<Self> {
        (nodes.len() == Grid::COUNT).then_some(Self { grid, nodes })
    }

    /// The function at a contact.
    pub(crate) fn look(&self, at: Around) -> Looked<C> {
        let (extent_m, growth) = self.grid.extent_m(at.along_m);
        let half = [NODES[1], NODES[2]].map(|nodes| 0.5 * (nodes - 1) as f64);
        let held_m = at.along_m.max(self.grid.least_m());
        let along = (held_m / self.grid.first_m).ln() / self.grid.pitch;
        let (left, up) = (at.left_m / extent_m, at.up_m / extent_m);
        let [u, v, w] = [
            stencil(along, NODES[0]),
            stencil((left + 1.0) * half[0], NODES[1]),
            stencil((up + 1.0) * half[1], NODES[2]),
        ];
        let corner = |i: usize, j: usize| ((u.first + i) * NODES[1] + v.first + j) * NODES[2] + w.first;
        let nodes = self.nodes.as_slice();
        let [levels, by_u, by_v] = filters::vectorised!(simd => contracted(simd, nodes, corner, (&u, &v)));
        let along_w = |nodes: &[[f64; C]; 4], weights: &[f64; 4]| {
            SVector::from_fn(|c, _| (0..4).map(|k| nodes[k][c] * weights[k]).sum::<f64>())
        };
        let values = along_w(&levels, &w.weights);
        // From the coordinates of the grid, in nodes, to those about the whisker.
        let shrink = growth / extent_m;
        let by_along = if at.along_m < held_m { 0.0 } else { 1.0 / (self.grid.pitch * held_m) };
        let by_w = along_w(&levels, &w.slopes);
        let by_grid =
            SMatrix::<f64, C, 3>::from_columns(&[along_w(&by_u, &w.weights), along_w(&by_v, &w.weights), by_w]);
        let of_coordinates = Matrix3::from_rows(&[
            Vector3::new(by_along, 0.0, 0.0).transpose(),
            (Vector3::new(-left * shrink, 1.0 / extent_m, 0.0) * half[0]).transpose(),
            (Vector3::new(-up * shrink, 0.0, 1.0 / extent_m) * half[1]).transpose(),
        ]);
        Looked { values, slopes: by_grid * of_coordinates }
    }
}

/// Sums over two axes of four nodes each: of the values, of their derivatives along the first axis and of those along the second.
/// `corner` is the index of the first of four nodes along the third axis, which are consecutive.
#[inline(always)]
fn contracted<S: Simd, const C: usize>(
    simd: S,
    nodes: &[[f64; C]],
    corner: impl Fn(usize, usize) -> usize,
    (u, v): (&Stencil, &Stencil),
) -> [[[f64; C]; 4]; 3] {
    const { assert!(C.is_multiple_of(2), "four nodes fill whole vectors") };
    let mut found = [[[0.0; C]; 4]; 3];
    let nodes = nodes.as_flattened();
    let zero = f64x8::splat(simd, 0.0);
    for first in (0..4 * C).step_by(WIDTH) {
        let (mut levels, mut by_u, mut by_v) = (zero, zero, zero);
        for j in 0..4 {
            let (mut level, mut slope) = (zero, zero);
            for i in 0..4 {
                let start = corner(i, j) * C + first;
                let row = f64x8::from_slice(simd, &nodes[start..start + WIDTH]);
                level += row * u.weights[i];
                slope += row * u.slopes[i];
            }
            levels += level * v.weights[j];
            by_u += slope * v.weights[j];
            by_v += level * v.slopes[j];
        }
        let [of_levels, of_u, of_v] = &mut found;
        levels.store_slice(&mut of_levels.as_flattened_mut()[first..first + WIDTH]);
        by_u.store_slice(&mut of_u.as_flattened_mut()[first..first + WIDTH]);
        by_v.store_slice(&mut of_v.as_flattened_mut()[first..first + WIDTH]);
    }
    found
}

/// Four neighbouring nodes with the weights of their values, and the derivatives of the weights by the position.
struct Stencil {
    first: usize,
    weights: [f64; 4],
    slopes: [f64; 4],
}

/// The cubic polynomial through four of `nodes` nodes at a position (Lagrange).
fn stencil(position: f64, nodes: usize) -> Stencil {
    let first = (position.floor() - 1.0).clamp(0.0, (nodes - 4) as f64) as usize;
    let t = position - first as f64;
    let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
    Stencil {
        first,
        weights: [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0],
        slopes: [
            -(b * c + b * d + c * d) / 6.0,
            (a * c + a * d + c * d) / 2.0,
            -(a * b + a * d + b * d) / 2.0,
            (a * b + a * c + b * c) / 6.0,
        ],
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::space::sensor::Across;

    #[test]
    fn regress_below_the_least_arc_length_the_function_is_constant_along_the_whisker() {
        let domain =
            SpatialDomain { arc_m: vec![0.03, 0.06], directions: 4, away_m: vec![2e-3; 8], across: Across::Normal };
        let table =
            Table::new(Grid::new(&domain), |at, _: Option<()>| Some((Vector2::new(at.along_m, 1.0), ()))).unwrap();
        let [near, nearer] = [2e-3, 1e-3].map(|along_m| table.look(Around::new(along_m, 1e-3, 0.0)));
        assert!((near.values - nearer.values).norm() < 1e-15 && near.slopes.column(0).norm() == 0.0, "{}", near.slopes);
    }

    #[test]
    fn verif_nodes_are_in_the_order_of_a_table() {
        let domain =
            SpatialDomain { arc_m: vec![0.03, 0.06], directions: 4, away_m: vec![2e-3; 8], across: Across::Normal };
        let value = |at: Around| Vector2::new(at.along_m + 10.0 * at.left_m, 100.0 * at.up_m);
        let grid = Grid::new(&domain);
        let computed = Table::new(grid, |at, _: Option<()>| Some((value(at), ())));
        let listed = Table::of_nodes(grid, grid.nodes().map(|at| value(at).into()).collect());
        assert!(computed.is_some() && computed == listed);
        assert_eq!(Table::<2>::of_nodes(grid, Vec::new()), None);
    }

    #[test]
    fn verif_a_node_is_computed_from_its_neighbour_nearer_to_the_middle() {
        let domain =
            SpatialDomain { arc_m: vec![0.03, 0.06], directions: 4, away_m: vec![2e-3; 8], across: Across::Normal };
        let grid = Grid::new(&domain);
        // The number of nodes on the way from the first one.
        let steps = |_: Around, near: Option<f64>| {
            let steps = near.map_or(0.0, |steps| steps + 1.0);
            Some((Vector2::new(steps, 0.0), steps))
        };
        let table = Table::new(grid, steps).unwrap();
        let away = |index: usize, axis: usize| index.abs_diff(NODES[axis] / 2);
        let expected = |[i, j, k]: [usize; 3]| [(i + away(j, 1).max(away(k, 2))) as f64, 0.0];
        assert_eq!(table.nodes, indices().map(expected).collect::<Vec<_>>());
        let ends = |at: Around, _: Option<()>| (at.left_m < 1.9e-3).then_some((Vector2::zeros(), ()));
        assert_eq!(Table::new(grid, ends), None);
    }

    #[test]
    fn val_values_and_slopes_of_a_smooth_function() {
        let domain = SpatialDomain {
            arc_m: vec![0.03, 0.045, 0.06],
            directions: 4,
            away_m: vec![2e-3, 1e-3, 1.5e-3, 2e-3, 4e-3, 3e-3, 4e-3, 4e-3, 7e-3, 6e-3, 5e-3, 7e-3],
            across: Across::Normal,
        };
        let exact = |at: Around| {
            let (u, v) = (at.left_m / at.along_m, at.up_m / at.along_m);
            Vector2::new((8.0 * u + 3.0 * v).sin() / at.along_m, u * u * v * 300.0)
        };
        let table = Table::new(Grid::new(&domain), |at, _: Option<()>| Some((exact(at), ()))).unwrap();
        for at in
            [Around::new(0.0311, 1.5e-3, -0.5e-3), Around::new(0.052, -2.1e-3, 3.3e-3), Around::new(0.0599, 0.0, -4e-3)]
        {
            let found = table.look(at);
            assert!((found.values - exact(at)).norm() < 2e-3, "{at:?}: {} {}", found.values, exact(at));
            for axis in 0..3 {
                let step = 1e-7 * Vector3::ith(axis, 1.0);
                let [after, before] =
                    [at.vector() + step, at.vector() - step].map(|x| table.look(Around::of_state(&x)).values);
                let slope = found.slopes.column(axis);
                assert!(((after - before) / 2e-7 - slope).norm() < 1e-4 * (1.0 + slope.norm()), "{at:?} {axis}");
            }
        }
    }
}
