//! The integration: Taylor series of the spatial equilibrium, summed from the contact back to the root.
//!
//! All right-hand sides are products of series, so that their coefficients follow from recurrences, as in the plane
//! ([`crate::elastica`]). The derivatives with respect to the load are the recurrences of the linearised equations.

use nalgebra::{Matrix3, Vector3};

use crate::taylor::{ORDER, Series, Stretch, horner, product};

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

/// Series of a vector.
type VectorSeries = [Series; 3];

const NONE: VectorSeries = [[0.0; ORDER + 1]; 3];

fn constant(vector: Vector3<f64>) -> VectorSeries {
    let mut series = NONE;
    put(&mut series, 0, vector);
    series
}

/// Term of order `k`.
fn term(series: &VectorSeries, k: usize) -> Vector3<f64> {
    Vector3::from_fn(|i, _| series[i][k])
}

fn put(series: &mut VectorSeries, k: usize, term: Vector3<f64>) {
    for (series, value) in series.iter_mut().zip(term.iter()) {
        series[k] = *value;
    }
}

fn sum(series: &VectorSeries, step_m: f64) -> Vector3<f64> {
    Vector3::from_fn(|i, _| horner(&series[i], step_m))
}

/// Term of order `k` of the scalar product.
fn dot(a: &VectorSeries, b: &VectorSeries, k: usize) -> f64 {
    a.iter().zip(b).map(|(a, b)| product(a, b, k)).sum()
}

/// Term of order `k` of the vector product.
fn cross(a: &VectorSeries, b: &VectorSeries, k: usize) -> Vector3<f64> {
    Vector3::from_fn(|i, _| {
        let (j, l) = ((i + 1) % 3, (i + 2) % 3);
        product(&a[j], &b[l], k) - product(&a[l], &b[j], k)
    })
}

/// Term of order `k` of the product of a scalar and a vector.
fn scaled(a: &Series, b: &VectorSeries, k: usize) -> Vector3<f64> {
    Vector3::from_fn(|i, _| product(a, &b[i], k))
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
    fn curvature(&self, about: &VectorSeries, k: usize) -> Vector3<f64> {
        Vector3::from_fn(|i, _| {
            let bending: f64 = (0..self.terms.min(k + 1)).map(|j| self.bending[j] * about[i][k - j]).sum();
            if i == 0 { self.twist * bending } else { bending }
        })
    }
}

impl Expansion {
    fn new(section: &Section, force: Vector3<f64>, curvature_per_m: f64, flexibility: &Flexibility) -> Self {
        let mut position = constant(section.position);
        let mut directors = [0, 1, 2].map(|i| constant(section.directors.column(i).into_owned()));
        let (mut moment, mut about, mut curvatures) = (NONE, NONE, NONE);
        for k in 0..ORDER {
            let next = 1.0 / (k as f64 + 1.0);
            put(&mut moment, k, force.cross(&term(&position, k)));
            put(&mut about, k, Vector3::from_fn(|a, _| dot(&directors[a], &moment, k)));
            let mut curvature = flexibility.curvature(&about, k);
            if k == 0 {
                curvature.z += curvature_per_m;
            }
            put(&mut curvatures, k, curvature);
            put(&mut position, k + 1, term(&directors[0], k) * next);
            // Each director turns by the curvatures about the other two.
            for a in 0..3 {
                let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                let turn = scaled(&curvatures[c], &directors[b], k) - scaled(&curvatures[b], &directors[c], k);
                put(&mut directors[a], k + 1, turn * next);
            }
        }
        Self { position, directors, moment }
    }

    /// Step at which the last terms have the size of the tolerance. The last three, since every second term of a symmetric state
    /// is zero.
    fn step_m(&self, arc_m: f64) -> f64 {
        let step = |order: usize| {
            let directions = self.directors.iter().flatten().map(|series| series[order].abs());
            let positions = self.position.iter().map(|series| series[order].abs() / arc_m);
            let size = directions.chain(positions).fold(0.0, f64::max);
            (TOLERANCE / size).powf(1.0 / order as f64)
        };
        step(ORDER - 2).min(step(ORDER - 1)).min(step(ORDER))
    }

    /// The section at a distance from the centre of the expansion along the wire.
    pub(super) fn section(&self, step_m: f64) -> Section {
        let columns = [0, 1, 2].map(|i| sum(&self.directors[i], step_m));
        Section { position: sum(&self.position, step_m), directors: Matrix3::from_columns(&columns) }
    }

    /// Derivative of the section at `step_m` by a parameter, from that at the centre of the expansion.
    fn rate(
        &self,
        rate: &SectionRate,
        force: Vector3<f64>,
        by: Parameter,
        flexibility: &Flexibility,
        step_m: f64,
    ) -> SectionRate {
        let (mut position, mut rotation) = (constant(rate.position), constant(rate.rotation));
        let (mut moment, mut about, mut curvatures) = (NONE, NONE, NONE);
        for k in 0..ORDER {
            let next = 1.0 / (k as f64 + 1.0);
            // The change of the moment as seen from the turned section.
            let change = force.cross(&term(&position, k)) + by.moment(term(&self.position, k));
            put(&mut moment, k, change + cross(&self.moment, &rotation, k));
            put(&mut about, k, Vector3::from_fn(|a, _| dot(&self.directors[a], &moment, k)));
            put(&mut curvatures, k, flexibility.curvature(&about, k));
            put(&mut position, k + 1, cross(&rotation, &self.directors[0], k) * next);
            let turns = curvatures.iter().zip(&self.directors).map(|(by, director)| scaled(by, director, k));
            put(&mut rotation, k + 1, turns.sum::<Vector3<f64>>() * next);
        }
        SectionRate { position: sum(&position, step_m), rotation: sum(&rotation, step_m) }
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
            for (rate, by) in rates.iter_mut().zip(parameters) {
                *rate = line.rate(rate, force, by, &flexibility, along_m);
            }
            section = line.section(along_m);
            visit(s_m, end_m, line);
            s_m = end_m;
        }
    }
    Some((section, rates))
}
