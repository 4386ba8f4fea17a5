//! Robust nonlinear least squares with any number of unknowns, by Gauss and Newton's method with the damping of Levenberg and Marquardt
//! (Nocedal and Wright, *Numerical Optimization*, 2006, section 10.3).
//!
//! A [`Problem`] states a cost, half the sum of squares of what deviates, and its quadratic approximation about a state. Costs that grow more slowly than
//! squares enter by the square that touches them from above at the state (iteratively reweighted least squares); since every step is tested
//! by the cost itself, no step makes the state less probable.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A quadratic approximation `c + g' x + x' H x / 2` of a cost about a state.
#[derive(Clone, Debug)]
pub struct Quadratic {
    /// The cost `c`, that of the state itself.
    pub cost: f64,
    /// Gradient `g`.
    pub gradient: DVector<f64>,
    /// Positive definite curvature `H`, of which the lower triangle counts.
    pub curvature: DMatrix<f64>,
}

/// What is to be minimised.
pub trait Problem {
    /// What is sought.
    type State: Clone;

    /// Cost of a state; nothing where the model has no answer.
    fn cost(&self, state: &Self::State) -> Option<f64>;

    /// The cost's approximation about a state.
    fn approximate(&self, state: &Self::State) -> Option<Quadratic>;

    /// The state moved by a step.
    fn moved(&self, state: &Self::State, step: &DVector<f64>) -> Self::State;
}

/// How the search goes on and when it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Most approximations.
    pub iterations: usize,
    /// Descent that is too small to matter; a tenth of a standard deviation is 0.005.
    pub tolerance: f64,
}

/// Tries at one approximation before it counts as the minimum.
const TRIES: usize = 10;

/// Damping, relative to the curvature's diagonal, and how it changes after a step that descends and after one that does not. It begins with next to
/// none: where a prior ties many unknowns to one another, the diagonal is far larger than the curvature for all of them together.
const FIRST_DAMPING: f64 = 1e-9;
const EASE: f64 = 0.01;
const HARDEN: f64 = 20.0;

/// The state to which a search descends; nothing where the model has no answer at the first.
pub fn descend<P: Problem>(problem: &P, from: P::State, search: &Search) -> Option<P::State> {
    let (mut state, mut damping) = (from, FIRST_DAMPING);
    for _ in 0..search.iterations {
        let here = problem.approximate(&state)?;
        let lower = (0..TRIES).find_map(|_| {
            let found = damped(&here, damping).and_then(|factor| {
                let moved = problem.moved(&state, &-factor.solve(&here.gradient));
                problem.cost(&moved).filter(|&cost| cost < here.cost).map(|cost| (moved, cost))
            });
            damping = FIRST_DAMPING.max(damping * if found.is_some() { EASE } else { HARDEN });
            found
        });
        let Some((moved, cost)) = lower else { break };
        state = moved;
        if here.cost - cost < search.tolerance {
            break;
        }
    }
    Some(state)
}

/// The curvature's factor with its diagonal raised.
fn damped(here: &Quadratic, damping: f64) -> Option<Cholesky<f64, Dyn>> {
    let mut curvature = here.curvature.clone();
    for i in 0..curvature.nrows() {
        curvature[(i, i)] *= 1.0 + damping;
    }
    curvature.cholesky()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector2, dmatrix, dvector};

    use super::*;

    /// Rosenbrock's banana: half the sum of squares of `10 (y - x^2)` and `1 - x`.
    struct Banana;

    impl Problem for Banana {
        type State = Vector2<f64>;

        fn cost(&self, at: &Vector2<f64>) -> Option<f64> {
            Some(0.5 * (100.0 * (at.y - at.x * at.x).powi(2) + (1.0 - at.x).powi(2)))
        }

        fn approximate(&self, at: &Vector2<f64>) -> Option<Quadratic> {
            let jacobian = dmatrix![-20.0 * at.x, 10.0; -1.0, 0.0];
            let residual = dvector![10.0 * (at.y - at.x * at.x), 1.0 - at.x];
            let gradient = jacobian.transpose() * residual;
            Some(Quadratic { cost: self.cost(at)?, gradient, curvature: jacobian.transpose() * jacobian })
        }

        fn moved(&self, at: &Vector2<f64>, step: &DVector<f64>) -> Vector2<f64> {
            at + Vector2::new(step[0], step[1])
        }
    }

    #[test]
    fn val_minimum_of_the_banana() {
        let found = descend(&Banana, Vector2::new(-1.2, 1.0), &Search { iterations: 100, tolerance: 1e-20 }).unwrap();
        assert!((found - Vector2::new(1.0, 1.0)).norm() < 1e-6, "{found}");
    }

    #[test]
    fn verif_no_step_climbs() {
        let mut last = f64::INFINITY;
        for iterations in 0..20 {
            let found = descend(&Banana, Vector2::new(-1.2, 1.0), &Search { iterations, tolerance: 0.0 }).unwrap();
            let cost = Banana.cost(&found).unwrap();
            assert!(cost <= last);
            last = cost;
        }
    }
}
