//! Smooth map without mechanics: a penalised tensor-product spline (P-spline; Eilers and Marx, "Flexible smoothing with B-splines
//! and penalties", Statistical Science 11, 1996), one for each bending moment.
//!
//! ```text
//! g(s, a, b) = sum c_ijk B_i(s) B_j(a) B_k(b)    a = u / s^2    b = v / s^2
//! ```
//!
//! `s`, `u` and `v` are the coordinates about the undeflected whisker ([`Around`]), and `B_i` cubic B-splines on uniform knots over
//! the calibrated contacts. At the same moment, contacts are displaced nearly in proportion to `s^2`, so that the calibrated
//! contacts fill the grid of `a` and `b` at every arc length. The penalty is the weighted sum of the squared third differences of
//! the coefficients, with one weight along the whisker and another across it. The weights are those with the smallest errors on
//! lines held out with their neighbours. Generalised cross-validation would choose weights that are too small: it treats the
//! correlated errors of a line as independent.

use std::array;

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::fit::neighbours;
use super::{
    Around, Axis, FittedSpatialModel, SpatialLoaded, SpatialModel, SpatialPrediction, SpatialRegion, SpatialSample,
    check_coefficients,
};
use crate::frames::Base;
use crate::sensor::ModelError;
use crate::sensor::spline::{basis, best_weights};
use crate::settings::typed;
use crate::space::frames::Point;

pub(super) const KIND: &str = "spline";

/// Largest number of knot intervals in one direction.
const MOST_INTERVALS: usize = 6;

/// Smallest arc length in the scale of the displacements (m).
const SHORTEST_M: f64 = 1e-3;

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Knot intervals along the whisker.
    along: usize,
    /// Knot intervals across it, to the left and upwards.
    across: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self { along: 4, across: 3 }
    }
}

/// The knots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Grid {
    /// Number of knot intervals along the whisker, to the left and upwards.
    intervals: [usize; 3],
    /// Ends of the knots in arc length (m) and in both displacements divided by its square (1/m).
    first: [f64; 3],
    last: [f64; 3],
}

/// The fitted splines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    grid: Grid,
    /// `c_ijk` of the moments about y and z, with `i` ascending, within it `j`, within it `k`.
    coefficients_n_m: [Vec<f64>; 2],
}

/// The fitted splines with the axis of their coordinates.
#[derive(Debug)]
struct Spline {
    axis: Axis,
    stored: Stored,
}

/// A position among the knots.
struct Spot {
    /// First of the four splines in each direction.
    first: [usize; 3],
    values: [[f64; 4]; 3],
    /// Derivatives with respect to the coordinates of the grid.
    slopes: [[f64; 4]; 3],
    /// Distance beyond the knots, in the coordinates of the grid.
    beyond: Vector3<f64>,
}

impl Grid {
    /// The grid over the given contacts.
    fn over(contacts: &[Around], Config { along, across }: Config) -> Self {
        let scaled: Vec<Vector3<f64>> = contacts.iter().map(|at| scaled(*at).0).collect();
        let extreme = |pick: fn(f64, f64) -> f64, from: f64| {
            array::from_fn(|axis| scaled.iter().map(|at| at[axis]).fold(from, pick))
        };
        Self {
            intervals: [along, across, across],
            first: extreme(f64::min, f64::INFINITY),
            last: extreme(f64::max, f64::NEG_INFINITY),
        }
    }

    /// Number of splines in each direction.
    fn splines(&self) -> [usize; 3] {
        self.intervals.map(|intervals| intervals + 3)
    }

    fn count(&self) -> usize {
        self.splines().iter().product()
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        let [_, left, up] = self.splines();
        (i * left + j) * up + k
    }

    fn spot(&self, at: Vector3<f64>) -> Spot {
        let (mut first, mut values, mut slopes, mut beyond) = ([0; 3], [[0.0; 4]; 3], [[0.0; 4]; 3], Vector3::zeros());
        for axis in 0..3 {
            let intervals = self.intervals[axis];
            let per_unit = intervals as f64 / (self.last[axis] - self.first[axis]);
            let held = at[axis].clamp(self.first[axis], self.last[axis]);
            let position = (held - self.first[axis]) * per_unit;
            first[axis] = (position as usize).min(intervals - 1);
            let (of_splines, steep) = basis(position - first[axis] as f64);
            (values[axis], slopes[axis]) = (of_splines, steep.map(|slope| slope * per_unit));
            beyond[axis] = at[axis] - held;
        }
        Spot { first, values, slopes, beyond }
    }

    /// Indices of the splines that differ from zero at a position, each with its place among the four of each direction.
    fn near(&self, spot: &Spot) -> impl Iterator<Item = (usize, [usize; 3])> {
        let start = spot.first;
        let places = (0..4).flat_map(|i| (0..4).flat_map(move |j| (0..4).map(move |k| [i, j, k])));
        places.map(move |place| (self.index(array::from_fn(|axis| start[axis] + place[axis])), place))
    }

    /// Sum of the squared third differences of the coefficients in some directions, as a matrix.
    fn roughness(&self, directions: &[usize]) -> DMatrix<f64> {
        let splines = self.splines();
        let mut rough = DMatrix::zeros(self.count(), self.count());
        let [along, left, up] = splines;
        let all = (0..along).flat_map(|i| (0..left).flat_map(move |j| (0..up).map(move |k| [i, j, k])));
        for (place, direction) in all.flat_map(|place| directions.iter().map(move |direction| (place, *direction))) {
            if place[direction] + 3 >= splines[direction] {
                continue;
            }
            let indices: [usize; 4] = array::from_fn(|step| {
                let mut later = place;
                later[direction] += step;
                self.index(later)
            });
            for (row, factor) in indices.into_iter().zip([-1.0, 3.0, -3.0, 1.0]) {
                for (column, other) in indices.into_iter().zip([-1.0, 3.0, -3.0, 1.0]) {
                    rough[(row, column)] += factor * other;
                }
            }
        }
        rough
    }
}

/// Coordinates of the grid at a contact, and their derivatives with respect to its coordinates about the whisker.
fn scaled(at: Around) -> (Vector3<f64>, Matrix3<f64>) {
    let Around { along_m, left_m, up_m } = at;
    let s = along_m.max(SHORTEST_M);
    let (a, b) = (left_m / (s * s), up_m / (s * s));
    let by_along = if along_m >= s { -2.0 / s } else { 0.0 };
    let slopes = Matrix3::new(1.0, 0.0, 0.0, by_along * a, 1.0 / (s * s), 0.0, by_along * b, 0.0, 1.0 / (s * s));
    (Vector3::new(along_m, a, b), slopes)
}

/// A sample among the knots.
struct Row {
    /// Indices of the products of splines that differ from zero, with their values.
    near: Vec<(usize, f64)>,
    reading_n_m: Vector2<f64>,
    count: f64,
}

impl Row {
    fn new(grid: &Grid, axis: &Axis, sample: &SpatialSample) -> Self {
        let spot = grid.spot(scaled(Around::of(axis, sample.contact)).0);
        let value = |place: [usize; 3]| (0..3).map(|axis| spot.values[axis][place[axis]]).product();
        let near = grid.near(&spot).map(|(index, place)| (index, value(place))).collect();
        Self { near, reading_n_m: sample.reading_n_m, count: sample.count }
    }

    fn predict(&self, coefficients_n_m: &[DVector<f64>; 2]) -> Vector2<f64> {
        let of_channel = |channel: &DVector<f64>| self.near.iter().map(|(index, value)| channel[*index] * value).sum();
        Vector2::from(coefficients_n_m.each_ref().map(of_channel))
    }
}

/// Sums over samples that determine the coefficients: `X'X`, and `X'y` of both moments.
#[derive(Clone)]
struct Sums {
    products: DMatrix<f64>,
    by_reading: [DVector<f64>; 2],
}

impl Sums {
    fn of<'a>(count: usize, rows: impl Iterator<Item = &'a Row>) -> Self {
        let by_reading = array::from_fn(|_| DVector::zeros(count));
        let mut sums = Self { products: DMatrix::zeros(count, count), by_reading };
        for Row { near, reading_n_m, count } in rows {
            for &(row, value) in near {
                for &(column, other) in near {
                    sums.products[(row, column)] += count * value * other;
                }
                for channel in 0..2 {
                    sums.by_reading[channel][row] += count * value * reading_n_m[channel];
                }
            }
        }
        sums
    }

    /// The sums without those of some of the samples.
    fn without(&self, other: &Self) -> Self {
        Self {
            products: &self.products - &other.products,
            by_reading: array::from_fn(|channel| &self.by_reading[channel] - &other.by_reading[channel]),
        }
    }

    /// Coefficients of both moments under a penalty. `None` if they are not determined.
    fn coefficients(&self, penalty: &DMatrix<f64>) -> Option<[DVector<f64>; 2]> {
        let factor = filters::cholesky(&self.products + penalty)?;
        Some(self.by_reading.each_ref().map(|by_reading| factor.solve(by_reading)))
    }
}

/// The samples of each line, and the sums of those that do not belong to it or its neighbours.
struct HeldOut {
    lines: Vec<Vec<Row>>,
    training: Vec<Sums>,
}

impl HeldOut {
    /// Sum of the squared errors of both moments on held-out lines under a penalty.
    fn squares(&self, penalty: &DMatrix<f64>) -> Option<f64> {
        let mut squares = 0.0;
        for (line, training) in self.lines.iter().zip(&self.training) {
            let coefficients_n_m = training.coefficients(penalty)?;
            let error = |row: &Row| row.count * (row.predict(&coefficients_n_m) - row.reading_n_m).norm_squared();
            squares += line.iter().map(error).sum::<f64>();
        }
        Some(squares)
    }
}

/// Penalties along the whisker and across it.
struct Penalties {
    parts: [DMatrix<f64>; 2],
    scale: f64,
}

impl Penalties {
    fn new(grid: &Grid, samples: f64) -> Self {
        Self { parts: [grid.roughness(&[0]), grid.roughness(&[1, 2])], scale: samples / grid.count() as f64 }
    }

    fn with(&self, powers: [i32; 2]) -> DMatrix<f64> {
        let [along, across] = powers.map(|power| self.scale * 10_f64.powi(power));
        &self.parts[0] * along + &self.parts[1] * across
    }

    /// The penalty with the smallest errors on held-out lines.
    fn best(&self, heldout: &HeldOut) -> Option<DMatrix<f64>> {
        let (powers, ()) = best_weights(|powers| Some((heldout.squares(&self.with(powers))?, ())))?;
        Some(self.with(powers))
    }
}

impl SpatialModel for Spline {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        let at = Around::of(&self.axis, contact);
        SpatialPrediction::around(&self.axis, at, self.predict_around(&self.axis, at))
    }

    fn predict_around(&self, _: &Axis, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        let Stored { grid, coefficients_n_m, .. } = &self.stored;
        let (scaled, jacobian) = scaled(at);
        let spot = grid.spot(scaled);
        let (mut reading_n_m, mut slopes) = (Vector2::zeros(), Matrix2x3::zeros());
        for (index, [i, j, k]) in grid.near(&spot) {
            let by_channel = Vector2::new(coefficients_n_m[0][index], coefficients_n_m[1][index]);
            let ([x, y, z], [dx, dy, dz]) = (
                [spot.values[0][i], spot.values[1][j], spot.values[2][k]],
                [spot.slopes[0][i], spot.slopes[1][j], spot.slopes[2][k]],
            );
            reading_n_m += by_channel * (x * y * z);
            slopes += by_channel * Vector3::new(dx * y * z, x * dy * z, x * y * dz).transpose();
        }
        (reading_n_m + slopes * spot.beyond, slopes * jacobian)
    }

    fn to_json(&self) -> Value {
        serde_json::to_value(&self.stored).expect("numbers and names serialise")
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

/// A simulated whisker is described by its mechanics.
pub(super) fn candidates(real_sensor: bool) -> Vec<Value> {
    if real_sensor { vec![json!({})] } else { Vec::new() }
}

pub(super) fn fit(
    region: &SpatialRegion<'_>,
    lines: &[Vec<SpatialSample>],
    config: &Value,
) -> Result<FittedSpatialModel, ModelError> {
    let config = typed::<Config>(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    for (name, found) in [("along", config.along), ("across", config.across)] {
        if !(1..=MOST_INTERVALS).contains(&found) {
            return Err(ModelError::Data(format!(
                "`{name}`: found {found} knot intervals, expected 1 to {MOST_INTERVALS}"
            )));
        }
    }
    let axis = region.domain.axis(&region.whisker.whisker);
    let contacts: Vec<Around> = lines.iter().flatten().map(|sample| Around::of(&axis, sample.contact)).collect();
    let grid = Grid::over(&contacts, config);
    let count = grid.count();
    let of_line = |line: &Vec<SpatialSample>| line.iter().map(|sample| Row::new(&grid, &axis, sample)).collect();
    let rows: Vec<Vec<Row>> = lines.iter().map(of_line).collect();
    let by_line: Vec<Sums> = rows.iter().map(|line| Sums::of(count, line.iter())).collect();
    let all = Sums::of(count, rows.iter().flatten());
    let without =
        move |heldout: &[usize]| heldout.iter().fold(all.clone(), |sums, other| sums.without(&by_line[*other]));
    let training = neighbours(lines).iter().map(|heldout| without(heldout)).collect();

    let penalties = Penalties::new(&grid, lines.iter().flatten().map(|sample| sample.count).sum());
    let undetermined = move || {
        let found = contacts.len();
        ModelError::Data(format!(
            "the calibration's {found} contacts do not determine the {count} coefficients of a spline: expected more lines of \
            contacts, or fewer knot intervals (`along`, `across`)"
        ))
    };
    let heldout = HeldOut { lines: rows, training };
    let penalty = penalties.best(&heldout).ok_or_else(&undetermined)?;
    let coefficients_n_m = without(&[]).coefficients(&penalty).ok_or_else(&undetermined)?;
    let stored = Stored {
        kind: KIND.into(),
        grid,
        coefficients_n_m: coefficients_n_m.map(|of_channel| of_channel.as_slice().to_vec()),
    };
    let HeldOut { lines, .. } = heldout;
    let predictions = move |line: usize, others: &[usize]| {
        let coefficients_n_m = without(others).coefficients(&penalty).ok_or_else(&undetermined)?;
        Ok(lines[line].iter().map(|row| row.predict(&coefficients_n_m)).collect())
    };
    Ok(FittedSpatialModel {
        model: Box::new(Spline { axis, stored }),
        without: Box::new(predictions),
        correlations: None,
    })
}

pub(super) fn load(region: &SpatialRegion<'_>, value: &Value) -> SpatialLoaded {
    let stored: Stored = typed(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    let Grid { intervals, first, last } = &stored.grid;
    let is_range = |axis: usize| first[axis].is_finite() && last[axis].is_finite() && first[axis] < last[axis];
    if !(intervals.iter().all(|found| (1..=MOST_INTERVALS).contains(found)) && (0..3).all(is_range)) {
        return Err(ModelError::Data(format!(
            "`grid`: found the intervals {intervals:?} from {first:?} to {last:?}, expected 1 to {MOST_INTERVALS} intervals in each \
            direction, between finite ends of which the first is less than the last"
        )));
    }
    check_coefficients(&stored.coefficients_n_m, stored.grid.count())?;
    Ok(Box::new(Spline { axis: region.domain.axis(&region.whisker.whisker), stored }))
}
