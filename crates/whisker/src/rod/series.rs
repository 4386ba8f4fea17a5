//! The integration: Taylor series of the spatial equilibrium, summed from the contact back to the root.
//!
//! All right-hand sides are products of series, so that their coefficients follow from recurrences, as in the plane
//! ([`crate::elastica`]). The derivatives with respect to the load are the recurrences of the linearised equations. The products
//! take nearly all of the time and are vectorised: the components of a director, and the derivatives with respect to several
//! parameters, are computed together. Their sums have the same order on every processor, and so have the same bits.

use std::ops::{AddAssign, Mul};

use filters::fearless_simd::f64x4;
use filters::fearless_simd::prelude::*;
use nalgebra::{Matrix3, Vector3};

use crate::taylor::{ORDER, Series, Stretch};

/// Size of the last terms kept: in direction relative to a unit vector, in position relative to the arc length of the contact.
const TOLERANCE: f64 = 1e-16;

/// Maximum number of steps, beyond which a load is refused as unreasonable.
const MOST_STEPS: usize = 2000;

/// Parameter by which the equilibrium is differentiated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Parameter {
    /// The arc length of the contact.
    Arc,
    /// A force that changes by this vector in the frame of the contact.
    Force(Vector3<f64>),
}

impl Parameter {
    /// Derivative of the moment of the section at `position` by the parameter, with the section held fixed.
    pub(super) fn moment(self, position: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Arc => Vector3::zeros(),
            Self::Force(force) => force.cross(&position),
        }
    }
}

/// Section of the wire in the frame of the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Section {
    /// Centre of the section (m).
    pub(super) position: Vector3<f64>,
    /// Directors as columns: the tangent, the left and the upper normal of the material.
    pub(super) directors: Matrix3<f64>,
}

/// Derivative of a [`Section`] by one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SectionRate {
    pub(super) position: Vector3<f64>,
    /// Rotation of the directors in the frame of the contact, as a vector.
    pub(super) rotation: Vector3<f64>,
}

/// Coefficients of the series of a vector, from order 0.
type VectorSeries = [Vector3<f64>; ORDER + 1];

/// Coefficients of the series of up to [`LANES`] vectors, one in each lane.
type LaneSeries<S> = [[f64x4<S>; 3]; ORDER + 1];

/// Number of lanes.
const LANES: usize = 4;

fn sum(series: &VectorSeries, step_m: f64) -> Vector3<f64> {
    series.iter().rev().fold(Vector3::zeros(), |sum, term| sum * step_m + term)
}

/// Components of a vector in the lanes.
#[inline(always)]
fn components<S: Simd>(simd: S, vector: &Vector3<f64>) -> f64x4<S> {
    f64x4::load_array(simd, [vector.x, vector.y, vector.z, 0.0])
}

/// A vector in each lane; zero in the lanes beyond the last.
#[inline(always)]
fn gathered<S: Simd>(simd: S, vectors: impl Iterator<Item = Vector3<f64>>) -> [f64x4<S>; 3] {
    let mut found = [[0.0; LANES]; 3];
    for (lane, vector) in vectors.enumerate() {
        for i in 0..3 {
            found[i][lane] = vector[i];
        }
    }
    [f64x4::load_array(simd, found[0]), f64x4::load_array(simd, found[1]), f64x4::load_array(simd, found[2])]
}

/// The same vector in all lanes.
#[inline(always)]
fn splat<S: Simd>(simd: S, vector: &Vector3<f64>) -> [f64x4<S>; 3] {
    [f64x4::splat(simd, vector.x), f64x4::splat(simd, vector.y), f64x4::splat(simd, vector.z)]
}

/// The same series in all lanes.
#[inline(always)]
fn splat_series<S: Simd>(simd: S, series: &VectorSeries) -> LaneSeries<S> {
    let mut found = zeros(simd);
    for k in 0..=ORDER {
        found[k] = splat(simd, &series[k]);
    }
    found
}

#[inline(always)]
fn zeros<S: Simd>(simd: S) -> LaneSeries<S> {
    [[f64x4::splat(simd, 0.0); 3]; ORDER + 1]
}

/// Vector product.
#[inline(always)]
fn cross<S: Simd>(a: &[f64x4<S>; 3], b: &[f64x4<S>; 3]) -> [f64x4<S>; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Term of order `k` of the vector product.
#[inline(always)]
fn cross_term<S: Simd>(simd: S, a: &LaneSeries<S>, b: &LaneSeries<S>, k: usize) -> [f64x4<S>; 3] {
    let zero = f64x4::splat(simd, 0.0);
    let (mut plus, mut minus) = ([zero; 3], [zero; 3]);
    for j in 0..=k {
        let (a, b) = (&a[j], &b[k - j]);
        for i in 0..3 {
            let (l, m) = ((i + 1) % 3, (i + 2) % 3);
            plus[i] += a[l] * b[m];
            minus[i] += a[m] * b[l];
        }
    }
    [plus[0] - minus[0], plus[1] - minus[1], plus[2] - minus[2]]
}

/// Series of the equilibrium around one arc length.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expansion {
    position: VectorSeries,
    /// Directors: tangent, left, up.
    directors: [VectorSeries; 3],
    /// Moment.
    moment: VectorSeries,
}

/// Flexibility of the sections of a stretch: `1 / EI` as a series, and the ratio of the flexibility in twist to that in bending.
struct Flexibility {
    bending: Series,
    terms: usize,
    twist: f64,
}

impl Flexibility {
    /// Term of order `k` of the curvatures about the directors under the moments `about` them.
    #[inline(always)]
    fn curvature<T: Copy + Mul<f64, Output = T> + AddAssign>(
        &self,
        zero: T,
        about: &[[T; 3]; ORDER + 1],
        k: usize,
    ) -> [T; 3] {
        let mut found = [zero; 3];
        for j in 0..self.terms.min(k + 1) {
            for a in 0..3 {
                found[a] += about[k - j][a] * self.bending[j];
            }
        }
        [found[0] * self.twist, found[1], found[2]]
    }
}

impl Expansion {
    fn new(section: &Section, force: Vector3<f64>, curvature_per_m: f64, flexibility: &Flexibility) -> Self {
        filters::vectorised!(simd => Self::around(simd, section, force, curvature_per_m, flexibility))
    }

    /// As [`Self::new`]. Each lane contains one component of the vectors.
    #[inline(always)]
    fn around<S: Simd>(
        simd: S,
        section: &Section,
        force: Vector3<f64>,
        curvature_per_m: f64,
        flexibility: &Flexibility,
    ) -> Self {
        let zero = f64x4::splat(simd, 0.0);
        let none = [Vector3::zeros(); ORDER + 1];
        let mut found = Self { position: none, directors: [none; 3], moment: none };
        let mut directors = [[zero; ORDER + 1]; 3];
        found.position[0] = section.position;
        for (a, director) in section.directors.column_iter().enumerate() {
            found.directors[a][0] = director.into_owned();
            directors[a][0] = components(simd, &found.directors[a][0]);
        }
        let mut moment = [zero; ORDER + 1];
        let (mut about, mut curvatures) = ([[0.0; 3]; ORDER + 1], [[0.0; 3]; ORDER + 1]);
        for k in 0..ORDER {
            let next = 1.0 / (k as f64 + 1.0);
            found.moment[k] = force.cross(&found.position[k]);
            moment[k] = components(simd, &found.moment[k]);
            let mut products = [zero; 3];
            for j in 0..=k {
                for a in 0..3 {
                    products[a] += directors[a][j] * moment[k - j];
                }
            }
            for a in 0..3 {
                about[k][a] = products[a][0] + products[a][1] + products[a][2];
            }
            curvatures[k] = flexibility.curvature(0.0, &about, k);
            if k == 0 {
                curvatures[k][2] += curvature_per_m;
            }
            found.position[k + 1] = found.directors[0][k] * next;
            // Each director turns by the curvatures about the other two.
            let (mut plus, mut minus) = ([zero; 3], [zero; 3]);
            for j in 0..=k {
                for a in 0..3 {
                    let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                    plus[a] += directors[b][k - j] * curvatures[j][c];
                    minus[a] += directors[c][k - j] * curvatures[j][b];
                }
            }
            for a in 0..3 {
                let term = (plus[a] - minus[a]) * next;
                directors[a][k + 1] = term;
                found.directors[a][k + 1] = Vector3::new(term[0], term[1], term[2]);
            }
        }
        found
    }

    /// Step at which the last terms have the size of the tolerance. The last three, since every second term of a symmetric state
    /// is zero.
    fn step_m(&self, arc_m: f64) -> f64 {
        let step = |order: usize| {
            let directions = self.directors.iter().map(|series| series[order].amax()).fold(0.0, f64::max);
            let size = directions.max(self.position[order].amax() / arc_m);
            (TOLERANCE / size).powf(1.0 / order as f64)
        };
        step(ORDER - 2).min(step(ORDER - 1)).min(step(ORDER))
    }

    /// The section at a distance from the centre of the expansion along the wire.
    pub(super) fn section(&self, step_m: f64) -> Section {
        let columns = [0, 1, 2].map(|i| sum(&self.directors[i], step_m));
        Section { position: sum(&self.position, step_m), directors: Matrix3::from_columns(&columns) }
    }

    /// Replaces the derivatives of the section at the centre of the expansion, one for each parameter, with those of the section at
    /// `step_m`.
    fn propagate(
        &self,
        rates: &mut [SectionRate],
        force: Vector3<f64>,
        parameters: &[Parameter],
        flexibility: &Flexibility,
        step_m: f64,
    ) {
        for (rates, parameters) in rates.chunks_mut(LANES).zip(parameters.chunks(LANES)) {
            filters::vectorised!(simd => self.propagate_by(simd, rates, force, parameters, flexibility, step_m));
        }
    }

    /// As [`Self::propagate`]. Each lane contains the derivatives with respect to one parameter.
    #[inline(always)]
    fn propagate_by<S: Simd>(
        &self,
        simd: S,
        rates: &mut [SectionRate],
        force: Vector3<f64>,
        parameters: &[Parameter],
        flexibility: &Flexibility,
        step_m: f64,
    ) {
        let zero = f64x4::splat(simd, 0.0);
        let of_moment = splat_series(simd, &self.moment);
        let [tangent, left, up] = &self.directors;
        let directors = [splat_series(simd, tangent), splat_series(simd, left), splat_series(simd, up)];
        let of_force = splat(simd, &force);
        let (mut position, mut rotation) = (zeros(simd), zeros(simd));
        position[0] = gathered(simd, rates.iter().map(|rate| rate.position));
        rotation[0] = gathered(simd, rates.iter().map(|rate| rate.rotation));
        let (mut moment, mut about, mut curvatures) = (zeros(simd), zeros(simd), zeros(simd));
        for k in 0..ORDER {
            let next = 1.0 / (k as f64 + 1.0);
            // The change of the moment as seen from the turned section.
            let by_position = cross(&of_force, &position[k]);
            let by_parameter = gathered(simd, parameters.iter().map(|by| by.moment(self.position[k])));
            let by_rotation = cross_term(simd, &of_moment, &rotation, k);
            for i in 0..3 {
                moment[k][i] = by_position[i] + by_parameter[i] + by_rotation[i];
            }
            let mut products = [[zero; 3]; 3];
            for j in 0..=k {
                for a in 0..3 {
                    for i in 0..3 {
                        products[a][i] += directors[a][j][i] * moment[k - j][i];
                    }
                }
            }
            for a in 0..3 {
                about[k][a] = products[a][0] + products[a][1] + products[a][2];
            }
            curvatures[k] = flexibility.curvature(zero, &about, k);
            let moved = cross_term(simd, &rotation, &directors[0], k);
            let mut turns = [[zero; 3]; 3];
            for j in 0..=k {
                for a in 0..3 {
                    for i in 0..3 {
                        turns[a][i] += curvatures[j][a] * directors[a][k - j][i];
                    }
                }
            }
            for i in 0..3 {
                position[k + 1][i] = moved[i] * next;
                rotation[k + 1][i] = (turns[0][i] + turns[1][i] + turns[2][i]) * next;
            }
        }
        let (mut positions, mut rotations) = ([zero; 3], [zero; 3]);
        for k in (0..=ORDER).rev() {
            for i in 0..3 {
                positions[i] = positions[i] * step_m + position[k][i];
                rotations[i] = rotations[i] * step_m + rotation[k][i];
            }
        }
        for (lane, rate) in rates.iter_mut().enumerate() {
            let of_lane = |vectors: &[f64x4<S>; 3]| Vector3::new(vectors[0][lane], vectors[1][lane], vectors[2][lane]);
            *rate = SectionRate { position: of_lane(&positions), rotation: of_lane(&rotations) };
        }
    }
}

/// Section at the root under a force at the arc length `arc_m`, and its derivatives by `parameters`.
///
/// The frame of the contact has its origin at the contact, +x along the tangent, and the directors as axes. `force` is
/// in that frame (N). `twist` is the ratio of the flexibility in twist to that in bending, `EI / GJ`. The last stretch
/// has no end. `visit` is called for each step with the arc length about which the series are expanded, that at which the step
/// ends, and the series. `None` if the load is unreasonably large.
pub(super) fn root<const N: usize>(
    stretches: &[Stretch],
    compliance_coefficient: f64,
    twist: f64,
    arc_m: f64,
    force: Vector3<f64>,
    parameters: [Parameter; N],
    mut visit: impl FnMut(f64, f64, Expansion),
) -> Option<(Section, [SectionRate; N])> {
    let mut s_m = arc_m;
    let first = stretches.partition_point(|stretch| stretch.start_m < s_m).max(1);
    let mut section = Section { position: Vector3::zeros(), directors: Matrix3::identity() };
    // At the contact the moment is zero. If the contact moves along the wire, the section at a fixed arc length moves
    // in the opposite direction.
    let opposite = SectionRate {
        position: -Vector3::x(),
        rotation: Vector3::new(0.0, 0.0, -stretches[first - 1].curvature_per_m),
    };
    let still = SectionRate { position: Vector3::zeros(), rotation: Vector3::zeros() };
    let mut rates = parameters.map(|by| if by == Parameter::Arc { opposite } else { still });
    let mut steps = 0;
    for stretch in stretches[..first].iter().rev() {
        while s_m > stretch.start_m {
            steps += 1;
            if steps > MOST_STEPS {
                return None;
            }
            let (bending, terms) = stretch.compliance(compliance_coefficient, s_m);
            let flexibility = Flexibility { bending, terms, twist };
            let line = Expansion::new(&section, force, stretch.curvature_per_m, &flexibility);
            let step_m = line.step_m(arc_m);
            if step_m <= 0.0 || step_m.is_nan() {
                return None;
            }
            let end_m = (s_m - step_m).max(stretch.start_m);
            let along_m = end_m - s_m;
            line.propagate(&mut rates, force, &parameters, &flexibility, along_m);
            section = line.section(along_m);
            visit(s_m, end_m, line);
            s_m = end_m;
        }
    }
    Some((section, rates))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::Whisker;

    #[test]
    fn verif_derivatives_do_not_depend_on_those_computed_with_them() {
        let whisker = Whisker::curved();
        let (stretches, coefficient) = (Stretch::of(&whisker), 64.0 / (PI * whisker.youngs_modulus_pa));
        let force = Vector3::new(0.0, 4e-3, -3e-3);
        // More parameters than lanes.
        let forces = [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(1.0, 2.0, -1.0)].map(Parameter::Force);
        let [x, y, z, mixed] = forces;
        let (section, rates) =
            root(&stretches, coefficient, 1.33, 0.05, force, [x, y, z, mixed, Parameter::Arc], |_, _, _| {}).unwrap();
        for (by, rate) in [x, y, z, mixed, Parameter::Arc].into_iter().zip(rates) {
            let alone = root(&stretches, coefficient, 1.33, 0.05, force, [by], |_, _, _| {}).unwrap();
            assert_eq!(alone, (section, [rate]), "{by:?}");
        }
        let sum = rates[0].rotation + 2.0 * rates[1].rotation - rates[2].rotation;
        assert!((rates[3].rotation - sum).norm() < 1e-12 * sum.norm());
    }
}
