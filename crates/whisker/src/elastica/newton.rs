//! Newton's iteration and continuation from the undeflected whisker, common to the inverse maps.

use nalgebra::{Const, DimMin, SMatrix, SVector};

use super::Failure;

/// Residual, relative to the whisker's length, below which one more step is the last: it squares the residual.
const NEARLY: f64 = 1e-9;

/// Maximum number of iterations; sufficiently small steps converge in three to five.
const MOST_ITERATIONS: usize = 12;

/// Smallest step of the continuation, as a share.
const SHORTEST: f64 = 1.0 / 4096.0;

/// Largest distance by which an iteration may pass the tip, in lengths of the whisker.
pub(crate) const BEYOND: f64 = 1.5;

/// Relative rounding error of a contact at the tip.
const ROUNDING: f64 = 1e-12;

/// Whether an iteration may go on with this arc length of the contact.
pub(crate) fn may_continue(arc_m: f64, length_m: f64) -> bool {
    arc_m > 0.0 && arc_m < BEYOND * length_m
}

/// Rejects a point that no shape of the whisker reaches, before small steps of a continuation are spent on it.
///
/// # Errors
/// [`Failure::OutOfReach`] if the point is farther from the root than the whisker is long, up to rounding.
pub(crate) fn within_reach(distance_m: f64, length_m: f64) -> Result<(), Failure> {
    if distance_m <= length_m * (1.0 + ROUNDING) { Ok(()) } else { Err(Failure::OutOfReach { distance_m, length_m }) }
}

/// Reason for which a continuation ended at the share `reached` of its way with a contact at `arc_m`.
pub(crate) fn lost(reached: f64, arc_m: f64, length_m: f64) -> Failure {
    if arc_m > 0.999 * length_m { Failure::SlippedOff { reached } } else { Failure::Buckled { reached } }
}

/// The arc length of a contact that was found, on the whisker: one at the tip may lie beyond it by rounding.
pub(crate) fn up_to_the_tip(arc_m: f64, length_m: f64) -> Result<f64, Failure> {
    let is_on = arc_m <= length_m * (1.0 + ROUNDING);
    if is_on { Ok(arc_m.min(length_m)) } else { Err(Failure::SlippedOff { reached: 1.0 }) }
}

/// Residual (in metres) and its derivatives by the unknowns.
pub(crate) struct Equations<const N: usize> {
    pub(crate) residual_m: SVector<f64, N>,
    pub(crate) jacobian: SMatrix<f64, N, N>,
}

/// Solves equations from an initial guess. `None` if the iteration does not converge, or converges to a solution
/// beyond a fold, where the determinant is negative: from the undeflected whisker, where it is positive, it can be
/// reached by a snap only.
pub(crate) fn solve<const N: usize>(
    mut unknowns: SVector<f64, N>,
    length_m: f64,
    mut equations: impl FnMut(SVector<f64, N>) -> Option<Equations<N>>,
) -> Option<SVector<f64, N>>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    let mut last = f64::INFINITY;
    for iteration in 0..MOST_ITERATIONS {
        let Equations { residual_m, jacobian } = equations(unknowns)?;
        let size = residual_m.norm() / length_m;
        // The first step may overshoot; after it, a residual that does not decrease does not lead to a solution.
        if !size.is_finite() || (iteration > 1 && size > NEARLY && size > 0.5 * last) {
            return None;
        }
        let determinant = jacobian.determinant();
        let step = jacobian.try_inverse()? * residual_m;
        unknowns -= step;
        if size < NEARLY {
            return (determinant > 0.0).then_some(unknowns);
        }
        last = size;
    }
    None
}

/// Continues a solution from the undeflected whisker (share 0) to the wanted state (share 1), in one step if that
/// converges, else in smaller ones.
///
/// # Errors
/// The largest share that was reached, and its solution.
pub(crate) fn follow<S: Copy>(start: S, mut solve: impl FnMut(f64, S) -> Option<S>) -> Result<S, (f64, S)> {
    let (mut reached, mut state, mut stride) = (0.0, start, 1.0_f64);
    while reached < 1.0 {
        let share = (reached + stride).min(1.0);
        if let Some(next) = solve(share, state) {
            (reached, state, stride) = (share, next, 2.0 * stride);
        } else if stride > SHORTEST {
            stride *= 0.25;
        } else {
            return Err((reached, state));
        }
    }
    Ok(state)
}
