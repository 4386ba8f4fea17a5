//! Tabulated moment of the exact quasi-static whisker as a function of the contact's position.
//!
//! Solving the elastica for a contact takes tens of microseconds ([`Elastica::at_point`]), and a filter evaluates
//! thousands of contacts per second. The map is smooth, so it is solved once on a grid ([`super::polar`]), with its
//! exact gradient, and interpolated ([`super::table`]). The whisker is continued beyond its tip, so that a contact at
//! the tip lies within the grid.

use nalgebra::Vector2;

use super::polar::{Frame, Polar};
use super::table::{Grid, Looked, Table};
use super::{Prediction, Region};
use crate::Whisker;
use crate::elastica::{Elastica, Friction, Load, PointContact};
use crate::frames::{Base, Point};

/// Nodes by distance from the root and by angle.
const NODES: [usize; 2] = [36, 26];

/// The same for the derivatives by mechanical parameters, for which three digits suffice.
const COARSE_NODES: [usize; 2] = [14, 10];

/// Factor of the density of nodes by distance if the pre-curvature jumps: the second derivative of the moment jumps
/// where the contact passes that point.
const DENSER: usize = 3;

/// Extent of the grid beyond the widened domain on each side, relative to the extent of that domain: the root of a fitted
/// whisker may lie elsewhere.
const MARGIN: f64 = 0.04;

/// Number of shorter steps from a node to the next if one step does not lead to a solution.
const SHORTER: i32 = 8;

/// Relative step of the derivatives by mechanical parameters.
const STEP: f64 = 1e-4;

/// A mechanical parameter by which the map is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parameter {
    /// Logarithm of Young's modulus.
    Modulus,
    /// Factor of the pre-curvature.
    CurvatureScale,
    /// Uniform addition to the pre-curvature.
    CurvatureOffset,
}

pub(super) const PARAMETERS: [Parameter; 3] =
    [Parameter::Modulus, Parameter::CurvatureScale, Parameter::CurvatureOffset];

/// The grid over one face's region.
#[derive(Clone, Debug)]
struct Lattice {
    frame: Frame,
    grid: Grid,
}

/// The tabulated map of one face.
#[derive(Clone, Debug)]
pub(super) struct Mechanics {
    lattice: Lattice,
    moment_n_m: Table,
    tangent_rad: Table,
}

/// Derivatives of the map by [`PARAMETERS`], at fixed positions.
#[derive(Clone, Debug)]
pub(super) struct Sensitivities {
    lattice: Lattice,
    tables: [Table; PARAMETERS.len()],
}

impl Lattice {
    fn new(region: &Region<'_>, nodes: [usize; 2]) -> Option<Self> {
        let widened = region.domain.widened(region.whisker.length_m);
        let frame = Frame::new(&Region { domain: &widened, ..*region })?;
        let margin = [0, 1].map(|axis| MARGIN * (frame.last[axis] - frame.first[axis]));
        // A smaller margin towards the root, if the region comes near it.
        let first = [(frame.first[0] - margin[0]).max(0.5 * frame.first[0]), frame.first[1] - margin[1]];
        let last = [0, 1].map(|axis| frame.last[axis] + margin[axis]);
        Some(Self { grid: Grid::new(first, last, nodes), frame })
    }

    fn look(&self, table: &Table, polar: &Polar) -> Looked {
        table.look(&self.grid.place(polar.at))
    }

    fn value(&self, table: &Table, contact: Point<Base>) -> f64 {
        table.value(&self.grid.place(self.frame.polar(contact).at))
    }

    /// The values of `solved` at the elastica's solution for each node. At a node out of the whisker's reach, the last
    /// value within reach is extrapolated: `beyond` does so over an angle.
    fn solve<Node: Copy>(
        &self,
        elastica: &Elastica,
        solved: impl Fn(&Polar, &PointContact) -> Option<Node>,
        beyond: impl Fn(&Node, f64) -> Node,
    ) -> Option<Vec<Node>> {
        let angles: Vec<f64> = self.grid.axis(1).collect();
        let mut nodes = Vec::with_capacity(self.grid.count());
        for r_m in self.grid.axis(0) {
            let at = |angle_rad: f64, near: Option<&Load>| {
                let contact = self.frame.contact([r_m, angle_rad]);
                let found = elastica.continued_at_point(contact, near, Friction::NONE)?;
                Some((solved(&self.frame.polar(contact), &found)?, found.load))
            };
            // From the node nearest to the undeflected whisker to either side; each solution is the initial guess of
            // the next.
            let [_, rest_rad] = self.frame.polar(elastica.rest_at_radius(r_m)).at;
            let distance = |j: &usize| (angles[*j] - rest_rad).abs();
            let start = (0..angles.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            let first = at(angles[start], None)?;
            let mut column = vec![first.0; angles.len()];
            let mut walk = |way: &mut dyn Iterator<Item = usize>| {
                let (mut last, mut last_rad) = (first, angles[start]);
                let mut is_reached = true;
                for j in way {
                    let stride = || {
                        let part = |i: i32| last_rad + (angles[j] - last_rad) * f64::from(i) / f64::from(SHORTER);
                        (1..=SHORTER).try_fold(last, |state, i| at(part(i), Some(&state.1)))
                    };
                    let next = if is_reached { at(angles[j], Some(&last.1)).or_else(stride) } else { None };
                    match next {
                        Some(next) => (last, last_rad) = (next, angles[j]),
                        None => is_reached = false,
                    }
                    column[j] = if is_reached { last.0 } else { beyond(&last.0, angles[j] - last_rad) };
                }
            };
            walk(&mut (0..start).rev());
            walk(&mut (start + 1..angles.len()));
            nodes.extend(column);
        }
        Some(nodes)
    }
}

impl Mechanics {
    /// The map of `whisker` over the region, whose own whisker defines the coordinates only. `None` if the whisker has
    /// no equilibrium beside its undeflected shape.
    pub(super) fn new(region: &Region<'_>, whisker: &Whisker) -> Option<Self> {
        let jumps = whisker.curvature.windows(2).any(|pair| pair[0].curvature_per_m != pair[1].curvature_per_m);
        Self::on_grid(region, whisker, if jumps { [DENSER * NODES[0], NODES[1]] } else { NODES })
    }

    /// A coarser map for a search.
    pub(super) fn rough(region: &Region<'_>, whisker: &Whisker) -> Option<Self> {
        Self::on_grid(region, whisker, NODES)
    }

    fn on_grid(region: &Region<'_>, whisker: &Whisker, nodes: [usize; 2]) -> Option<Self> {
        let lattice = Lattice::new(region, nodes)?;
        let nodes = lattice.solve(
            &Elastica::new(whisker).ok()?,
            |polar, found| {
                let deflection = &found.deflection;
                Some([
                    Looked { value: deflection.moment_n_m, gradient: polar.by_coordinates(found.moment_gradient_n) },
                    Looked {
                        value: deflection.tangent_rad,
                        gradient: polar.by_coordinates(found.tangent_gradient_rad_m),
                    },
                ])
            },
            |node, angle_rad| node.map(|f| Looked { value: f.value + f.gradient.y * angle_rad, ..f }),
        )?;
        let table = |quantity: usize| {
            let (values, slopes): (Vec<f64>, Vec<Vector2<f64>>) =
                nodes.iter().map(|node| (node[quantity].value, node[quantity].gradient)).unzip();
            Table::new(lattice.grid, &values, Some(&slopes))
        };
        Some(Self { moment_n_m: table(0), tangent_rad: table(1), lattice })
    }

    /// Moment of a contact and its gradient.
    pub(super) fn predict(&self, contact: Point<Base>) -> Prediction {
        let polar = self.lattice.frame.polar(contact);
        let found = self.lattice.look(&self.moment_n_m, &polar);
        Prediction { reading_n_m: found.value, gradient_n: polar.by_place(found.gradient) }
    }

    /// Moment of a contact.
    pub(super) fn moment_n_m(&self, contact: Point<Base>) -> f64 {
        self.lattice.value(&self.moment_n_m, contact)
    }

    /// Tangent angle of the whisker at a contact.
    pub(super) fn tangent_rad(&self, contact: Point<Base>) -> f64 {
        self.lattice.value(&self.tangent_rad, contact)
    }
}

impl Sensitivities {
    /// The derivatives of [`Mechanics::new`]. Of the moment `M(a, F)` at the place `p(a, F)`, at a fixed place: `dM =
    /// M_c - grad M . p_c` by the parameter `c`, with `M_c` and `p_c` at fixed arc length and force.
    pub(super) fn new(region: &Region<'_>, whisker: &Whisker) -> Option<Self> {
        let lattice = Lattice::new(region, COARSE_NODES)?;
        let mut pairs = Vec::new();
        for parameter in PARAMETERS {
            let step = parameter.step(whisker);
            let stepped = |step: f64| Elastica::new(&parameter.changed(whisker, step)).ok();
            pairs.push((2.0 * step, stepped(step)?, stepped(-step)?));
        }
        let nodes = lattice.solve(
            &Elastica::new(whisker).ok()?,
            |_, found| {
                let mut rates = [0.0; PARAMETERS.len()];
                for (rate, (width, more, less)) in rates.iter_mut().zip(&pairs) {
                    let (more, less) = (more.continued_deflect(&found.load)?, less.continued_deflect(&found.load)?);
                    let shift = more.point.vector() - less.point.vector();
                    *rate = (more.moment_n_m - less.moment_n_m - found.moment_gradient_n.dot(&shift)) / width;
                }
                Some(rates)
            },
            |node, _| *node,
        )?;
        let table = |i: usize| {
            let values: Vec<f64> = nodes.iter().map(|node| node[i]).collect();
            Table::new(lattice.grid, &values, None)
        };
        Some(Self { tables: [0, 1, 2].map(table), lattice })
    }

    /// The derivatives at a contact.
    pub(super) fn at(&self, contact: Point<Base>) -> [f64; PARAMETERS.len()] {
        self.tables.each_ref().map(|table| self.lattice.value(table, contact))
    }
}

impl Parameter {
    /// The whisker with this parameter changed by `step`.
    pub(super) fn changed(self, whisker: &Whisker, step: f64) -> Whisker {
        let mut whisker = whisker.clone();
        for piece in &mut whisker.curvature {
            match self {
                Self::Modulus => {}
                Self::CurvatureScale => piece.curvature_per_m *= 1.0 + step,
                Self::CurvatureOffset => piece.curvature_per_m += step,
            }
        }
        if self == Self::Modulus {
            whisker.youngs_modulus_pa *= step.exp();
        }
        whisker
    }

    fn step(self, whisker: &Whisker) -> f64 {
        match self {
            Self::Modulus | Self::CurvatureScale => STEP,
            Self::CurvatureOffset => STEP / whisker.length_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Curvature;
    use crate::sensor::{Domain, Face};

    fn whisker(curvature: &[Curvature]) -> Whisker {
        let tapered = Whisker { tip_diameter_m: 0.2e-3, damping_s: 0.0, ..Whisker::straight() };
        tapered.named("tabulated").with_curvature(curvature)
    }

    fn domain(whisker: &Whisker) -> Domain {
        let arc_m: Vec<f64> = (0..17).map(|i| whisker.length_m * (0.2 + 0.75 * f64::from(i) / 16.0)).collect();
        let upper_m = arc_m.iter().map(|arc_m| 0.25 * arc_m).collect();
        Domain::new(arc_m.clone(), vec![0.0; arc_m.len()], upper_m)
    }

    /// Whiskers with the errors that their tables may have: of the moment, relative to the largest, and of the tangent,
    /// in radians. Where the curvature jumps, so do the second derivative of the moment and the first of the tangent.
    fn cases() -> [(Whisker, Face, [f64; 2]); 4] {
        let arc = Curvature::new;
        [
            (whisker(&[arc(0.08, 0.0)]), Face::Left, [1e-7, 1e-6]),
            (whisker(&[arc(0.08, 12.5)]), Face::Left, [1e-7, 1e-6]),
            (whisker(&[arc(0.08, 12.5)]), Face::Right, [1e-7, 1e-6]),
            (whisker(&[arc(0.02, 0.0), arc(0.03, 50.0)]), Face::Right, [2e-5, 5e-3]),
        ]
    }

    /// Calls `check` with contacts all over the region and their exact solutions.
    fn everywhere(region: &Region<'_>, mut check: impl FnMut(Point<Base>, &PointContact)) {
        let elastica = Elastica::new(region.whisker).unwrap();
        let rest = region.whisker.rest_shape();
        let (low, high) = region.domain.arc_range_m();
        for i in 0..=50 {
            let arc_m = low + (high - low) * f64::from(i) / 50.0;
            let (lower, upper) = region.domain.away_range_m(arc_m);
            for j in 0..=20 {
                let away_m = lower + (upper - lower) * f64::from(j) / 20.0;
                let contact = rest.beside(arc_m, away_m * region.face.away_sign());
                if let Ok(exact) = elastica.at_point(contact) {
                    check(contact, &exact);
                }
            }
        }
    }

    #[test]
    fn val_table_agrees_with_the_elastica() {
        for (whisker, face, [most, most_rad]) in cases() {
            let domain = domain(&whisker);
            let region = Region { whisker: &whisker, face, domain: &domain };
            let mechanics = Mechanics::new(&region, &whisker).unwrap();
            let (mut largest, mut worst, mut worst_gradient, mut worst_rad) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
            everywhere(&region, |contact, exact| {
                let found = mechanics.predict(contact);
                largest = largest.max(exact.deflection.moment_n_m.abs());
                worst = worst.max((found.reading_n_m - exact.deflection.moment_n_m).abs());
                let miss = (found.gradient_n - exact.moment_gradient_n).norm() / exact.moment_gradient_n.norm();
                worst_gradient = worst_gradient.max(miss);
                worst_rad = worst_rad.max((mechanics.tangent_rad(contact) - exact.deflection.tangent_rad).abs());
            });
            let found = (worst / largest, worst_gradient, worst_rad);
            assert!(found.0 < most && found.1 < 100.0 * most && found.2 < most_rad, "{face:?}: {found:?}");
        }
    }

    #[test]
    fn verif_sensitivities_are_those_of_the_elastica() {
        for (whisker, face, _) in cases() {
            let domain = domain(&whisker);
            let region = Region { whisker: &whisker, face, domain: &domain };
            let sensitivities = Sensitivities::new(&region, &whisker).unwrap();
            for (i, parameter) in PARAMETERS.into_iter().enumerate() {
                let step = parameter.step(&whisker);
                let [more, less] = [step, -step].map(|step| Elastica::new(&parameter.changed(&whisker, step)).unwrap());
                let (mut largest, mut worst) = (0.0_f64, 0.0_f64);
                everywhere(&region, |contact, exact| {
                    let moment = |elastica: &Elastica| {
                        elastica.at_point_near(contact, &exact.load).map(|it| it.deflection.moment_n_m)
                    };
                    if let (Ok(more), Ok(less)) = (moment(&more), moment(&less)) {
                        let expected = (more - less) / (2.0 * step);
                        largest = largest.max(expected.abs());
                        worst = worst.max((sensitivities.at(contact)[i] - expected).abs());
                    }
                });
                assert!(worst <= 0.02 * largest, "{face:?} {parameter:?}: {worst} of {largest}");
            }
        }
    }
}
