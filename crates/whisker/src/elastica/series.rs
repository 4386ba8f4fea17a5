//! The integration: Taylor series of the equilibrium, summed from the contact back to the root.
//!
//! All derivatives at a point follow from recurrences, since the curvature `q = kappa0 + C m` is a product of series
//! and `(cos t)' = -q sin t`, `(sin t)' = q cos t` ([`crate::taylor`]). Derivatives with respect to the load are those
//! of the recurrences themselves.

use super::Load;
use crate::taylor::{ORDER, Series, Stretch, horner, product};

/// Size of the last terms kept: in angle in radians, in position relative to the arc length of the contact.
const TOLERANCE: f64 = 1e-16;

/// Maximum number of steps, beyond which a load is refused as unreasonable.
const MOST_STEPS: usize = 2000;

/// Parameter by which the equilibrium is differentiated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Parameter {
    /// The arc length of the contact, with which the couple changes at this rate.
    Arc { couple: f64 },
    /// A load that changes by these components: force along the tangent and to its left, and couple.
    Load { along: f64, left: f64, couple: f64 },
}

impl Parameter {
    /// Derivative of the moment of the section at `x, y` by the parameter, with the section held fixed.
    pub(super) fn moment(self, x: f64, y: f64) -> f64 {
        self.force(x, y) + self.couple()
    }

    /// Part of the force in [`Self::moment`].
    fn force(self, x: f64, y: f64) -> f64 {
        match self {
            Self::Arc { .. } => 0.0,
            Self::Load { along, left, .. } => y * along - x * left,
        }
    }

    /// Part of the couple in [`Self::moment`].
    fn couple(self) -> f64 {
        match self {
            Self::Arc { couple } | Self::Load { couple, .. } => couple,
        }
    }
}

/// Position and tangent angle in the contact's frame, or their derivatives by one parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct State {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) t_rad: f64,
}

/// The series of a [`State`] around one arc length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Expansion {
    x: Series,
    y: Series,
    t: Series,
}

impl Expansion {
    fn at(state: State) -> Self {
        let mut expansion = Self { x: [0.0; ORDER + 1], y: [0.0; ORDER + 1], t: [0.0; ORDER + 1] };
        (expansion.x[0], expansion.y[0], expansion.t[0]) = (state.x_m, state.y_m, state.t_rad);
        expansion
    }

    /// The state at the distance `step_m`.
    pub(super) fn sum(&self, step_m: f64) -> State {
        State { x_m: horner(&self.x, step_m), y_m: horner(&self.y, step_m), t_rad: horner(&self.t, step_m) }
    }

    /// The step at which the last terms have the size of the tolerance. The last three, since every second term of a
    /// symmetric state is zero.
    fn step_m(&self, arc_m: f64) -> f64 {
        let step = |order: usize| {
            let size = self.t[order].abs().max(self.x[order].abs() / arc_m).max(self.y[order].abs() / arc_m);
            (TOLERANCE / size).powf(1.0 / order as f64)
        };
        step(ORDER - 2).min(step(ORDER - 1)).min(step(ORDER))
    }
}

/// The state at the root under `load`, and its derivatives by `parameters`.
///
/// `compliance_coefficient` is `64 / (pi E)`, so that `1 / EI` is this over the fourth power of the diameter. The last
/// stretch has no end. `visit` is called for each step with the arc length of the expansion, the one at its end, and
/// the series. `None` if the load is unreasonably large.
pub(super) fn root<const N: usize>(
    stretches: &[Stretch],
    compliance_coefficient: f64,
    load: &Load,
    parameters: [Parameter; N],
    mut visit: impl FnMut(f64, f64, Expansion),
) -> Option<(State, [State; N])> {
    let mut s_m = load.arc_m;
    let first = stretches.partition_point(|stretch| stretch.start_m < s_m).max(1);
    // At the contact the moment is the couple. If the contact moves along the wire, the state at a fixed arc length moves
    // in the opposite direction.
    let (softness, _) = stretches[first - 1].compliance(compliance_coefficient, s_m);
    let curvature_per_m = stretches[first - 1].curvature_per_m + softness[0] * load.couple_n_m;
    let start = State { x_m: -1.0, y_m: 0.0, t_rad: -curvature_per_m };
    let mut state = State::default();
    let mut rates = parameters.map(|by| match by {
        Parameter::Arc { .. } => start,
        Parameter::Load { .. } => State::default(),
    });
    let mut steps = 0;
    for stretch in stretches[..first].iter().rev() {
        while s_m > stretch.start_m {
            steps += 1;
            if steps > MOST_STEPS {
                return None;
            }
            let (stiffness, terms) = stretch.compliance(compliance_coefficient, s_m);
            let curvature = |moment: &Series, k: usize| -> f64 {
                (0..terms.min(k + 1)).map(|j| stiffness[j] * moment[k - j]).sum()
            };

            let mut line = Expansion::at(state);
            let (mut cos, mut sin, mut moment, mut q) =
                ([0.0; ORDER + 1], [0.0; ORDER + 1], [0.0; ORDER + 1], [0.0; ORDER + 1]);
            (sin[0], cos[0]) = state.t_rad.sin_cos();
            for k in 0..ORDER {
                let next = 1.0 / (k as f64 + 1.0);
                moment[k] = line.y[k] * load.along_n - line.x[k] * load.left_n;
                if k == 0 {
                    moment[k] += load.couple_n_m;
                }
                q[k] = curvature(&moment, k) + if k == 0 { stretch.curvature_per_m } else { 0.0 };
                line.x[k + 1] = cos[k] * next;
                line.y[k + 1] = sin[k] * next;
                line.t[k + 1] = q[k] * next;
                cos[k + 1] = -product(&q, &sin, k) * next;
                sin[k + 1] = product(&q, &cos, k) * next;
            }
            let step_m = line.step_m(load.arc_m);
            if step_m <= 0.0 || step_m.is_nan() {
                return None;
            }
            let end_m = (s_m - step_m).max(stretch.start_m);
            let along_m = end_m - s_m;
            for (rate, by) in rates.iter_mut().zip(parameters) {
                let mut line_rate = Expansion::at(*rate);
                for k in 0..ORDER {
                    let next = 1.0 / (k as f64 + 1.0);
                    moment[k] =
                        line_rate.y[k] * load.along_n - line_rate.x[k] * load.left_n + by.force(line.x[k], line.y[k]);
                    if k == 0 {
                        moment[k] += by.couple();
                    }
                    line_rate.x[k + 1] = -product(&sin, &line_rate.t, k) * next;
                    line_rate.y[k + 1] = product(&cos, &line_rate.t, k) * next;
                    line_rate.t[k + 1] = curvature(&moment, k) * next;
                }
                *rate = line_rate.sum(along_m);
            }
            visit(s_m, end_m, line);
            state = line.sum(along_m);
            s_m = end_m;
        }
    }
    Some((state, rates))
}
