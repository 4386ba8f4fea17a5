//! Nonlinear least squares by the Levenberg-Marquardt or the Gauss-Newton method, with any number of unknowns.
//!
//! The cost of a state `x` is half the sum of the squared residuals, `c(x) = r' W r / 2`. About `x` it is approximated
//! by `c + g' d + d' H d / 2` with the gradient `g = J' W r`, the Gauss-Newton curvature `H = J' W J` and the Jacobian
//! `J = dr/dx`. A Levenberg-Marquardt step solves
//!
//! ```text
//! (H + lambda diag H) d = -g
//! ```
//!
//! with the damping `lambda`; it is taken only if the cost itself decreases (Marquardt, "An algorithm for least-squares
//! estimation of nonlinear parameters", SIAM Journal on Applied Mathematics 11(2), 1963; Nocedal and Wright, *Numerical
//! Optimization*, 2006, section 10.3). A Gauss-Newton step is the same with `lambda = 0` and is always taken.
//!
//! A [`Problem`] supplies the cost and its approximation. Costs that grow more slowly than squares enter `H` by the
//! square that touches them from above at the state (iteratively reweighted least squares). A problem given by its
//! residuals implements [`Residuals`] instead:
//!
//! ```
//! use filters::least_squares::{Evaluated, Residuals, Settings, central_jacobian, minimise};
//! use nalgebra::{DMatrix, DVector, dvector};
//!
//! /// Exponential decay `y = a exp(-b t)`, of which three values are given.
//! struct Decay;
//! impl Residuals for Decay {
//!     fn residuals(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
//!         Some(dvector![x[0] - 2.0, x[0] * (-x[1]).exp() - 1.0, x[0] * (-2.0 * x[1]).exp() - 0.5])
//!     }
//!     fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>> {
//!         central_jacobian(self, at, 1e-5)
//!     }
//! }
//!
//! let start = Evaluated::new(&Decay, dvector![1.0, 0.0]).expect("finite residuals");
//! let solution = minimise(&Decay, start, &Settings::default()).expect("finite residuals");
//! assert!((solution.state.x - dvector![2.0, 2_f64.ln()]).norm() < 1e-9);
//! ```

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};

use crate::cholesky;

/// Quadratic approximation `c + g' d + d' H d / 2` of a cost about a state, for a step `d`.
#[derive(Clone, Debug)]
pub struct Quadratic {
    /// Cost `c` of the state itself.
    pub cost: f64,
    /// Gradient `g`.
    pub gradient: DVector<f64>,
    /// Positive semidefinite curvature `H`. Only its lower triangle is read.
    pub curvature: DMatrix<f64>,
}

impl Quadratic {
    /// Covariance `H^-1` of the unknowns at a minimum, for residuals of unit variance or weighted by their inverse
    /// variance. `None` unless `H` is positive definite.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        Some(cholesky(self.curvature.clone())?.inverse())
    }

    /// Step `d` of `(H + lambda D) d = -g` by a Cholesky factorisation, where `D` is the diagonal of `H` with its zeros
    /// replaced by ones (Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978). `None` unless the
    /// matrix is positive definite.
    pub fn damped_step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut damped = self.curvature.clone();
        for i in 0..damped.nrows() {
            let curvature = damped[(i, i)];
            damped[(i, i)] = if curvature == 0.0 { damping } else { curvature * (1.0 + damping) };
        }
        Some(-cholesky(damped)?.solve(&self.gradient))
    }
}

/// States of any type, and the steps between them.
pub trait Moves {
    /// Point at which a cost is evaluated: the unknowns, with any quantities that are computed along with them.
    type State;

    /// The state after a step. `None` if the model is undefined there.
    fn moved(&self, state: &Self::State, step: &DVector<f64>) -> Option<Self::State>;

    /// Step that minimises an approximation with the given damping; by default [`Quadratic::damped_step`].
    fn step(&self, approximation: &Quadratic, damping: f64) -> Option<DVector<f64>> {
        approximation.damped_step(damping)
    }
}

/// Cost function over states.
pub trait Problem: Moves {
    /// Quadratic approximation of the cost about a state. `None` if the model is undefined there.
    fn approximate(&self, state: &Self::State) -> Option<Quadratic>;

    /// Cost of `state` with the weights that [`Self::approximate`] uses at `current`, by which a step between the two
    /// is accepted or rejected. `None` if the model is undefined at `state`.
    fn cost(&self, state: &Self::State, current: &Self::State) -> Option<f64>;
}

/// Schedule of the damping `lambda`, which is relative to the diagonal of `H`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Damping of the first attempt.
    pub first: f64,
    /// Smallest damping after an accepted step.
    pub lowest: f64,
    /// Smallest damping before it is increased after a rejected step.
    pub restart: f64,
    /// Damping above which no further step is attempted.
    pub highest: f64,
    /// Factor after an accepted step, less than 1.
    pub decrease: f64,
    /// Factor after a rejected step, greater than 1.
    pub increase: f64,
    /// Most attempts in one iteration.
    pub attempts: usize,
}

impl Damping {
    /// Marquardt's schedule: tenfold after a rejected step, a tenth after an accepted one.
    pub const MARQUARDT: Self = Self {
        first: 1e-2,
        lowest: 0.0,
        restart: 0.0,
        highest: 1e8,
        decrease: 0.1,
        increase: 10.0,
        attempts: usize::MAX,
    };
}

/// Method of [`minimise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Undamped steps, each of which is accepted.
    GaussNewton,
    /// Damped steps, accepted if the cost decreases.
    LevenbergMarquardt(Damping),
}

/// Method, iteration limit and convergence criteria of [`minimise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Method.
    pub method: Method,
    /// Most iterations, each with one approximation.
    pub iterations: usize,
    /// Decrease of the cost at which the search has converged, absolute. A tenth of a standard deviation is 0.005.
    pub absolute: f64,
    /// The same relative to the cost; the two are added.
    pub relative: f64,
    /// Norm of a step below which the search has converged.
    pub step: f64,
}

impl Settings {
    /// Levenberg-Marquardt method with Marquardt's schedule, to nearly machine precision.
    pub const DEFAULT: Self = Self {
        method: Method::LevenbergMarquardt(Damping::MARQUARDT),
        iterations: 200,
        absolute: 0.0,
        relative: 1e-15,
        step: 0.0,
    };
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Reason for which a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// A convergence criterion was met.
    Converged,
    /// No attempted step was accepted: the state is a minimum to the accuracy of the cost, or the curvature is singular.
    NoDescent,
    /// The iteration limit was reached.
    IterationLimit,
}

/// Result of [`minimise`].
#[derive(Clone, Debug)]
pub struct Solution<State> {
    /// State of the least cost that was found.
    pub state: State,
    /// Approximation from which the last step started.
    pub approximation: Quadratic,
    /// Reason for which the search ended.
    pub outcome: Outcome,
}

/// Local minimum of a problem's cost, starting from a state. `None` if the model is undefined or its cost not finite at
/// the start, or if an iterate has no approximation.
pub fn minimise<P: Problem>(problem: &P, start: P::State, settings: &Settings) -> Option<Solution<P::State>> {
    let mut search = Minimisation::begin(start, *settings);
    loop {
        let flow = match search.wanted() {
            Wanted::Approximation(state) => {
                let found = problem.approximate(state);
                search.take_approximation(problem, found)?
            }
            Wanted::Cost { state, current } => {
                let found = problem.cost(state, current);
                search.take_cost(problem, found)
            }
        };
        if let ControlFlow::Break(outcome) = flow {
            return Some(Solution { state: search.state, approximation: search.approximation?, outcome });
        }
    }
}

/// Evaluation of the problem that a [`Minimisation`] needs next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted<'a, State> {
    /// Approximation about a state.
    Approximation(&'a State),
    /// Cost of a state to which a step was tried from the current one.
    Cost {
        /// The state.
        state: &'a State,
        /// The current state.
        current: &'a State,
    },
}

/// [`minimise`] for callers that evaluate the problem themselves, for example some of the residuals per call. The caller
/// computes the evaluation that [`wanted`](Self::wanted) returns and passes it to
/// [`take_approximation`](Self::take_approximation) or [`take_cost`](Self::take_cost), until one of them breaks.
#[derive(Clone, Debug)]
pub struct Minimisation<State> {
    /// State of the least cost that was found.
    pub state: State,
    /// Approximation about the state from which steps are tried. `None` at first.
    approximation: Option<Quadratic>,
    settings: Settings,
    damping: f64,
    iterations: usize,
    tried: Option<Tried<State>>,
}

/// State after a trial step, whose cost has not been evaluated yet.
#[derive(Clone, Debug)]
struct Tried<State> {
    state: State,
    step_norm: f64,
    /// Number of attempts so far.
    attempts: usize,
}

impl<State> Minimisation<State> {
    /// Starts from a state.
    pub fn begin(start: State, settings: Settings) -> Self {
        let damping = match settings.method {
            Method::GaussNewton => 0.0,
            Method::LevenbergMarquardt(schedule) => schedule.first,
        };
        Self { state: start, approximation: None, settings, damping, iterations: 0, tried: None }
    }

    /// The evaluation that is needed next.
    pub fn wanted(&self) -> Wanted<'_, State> {
        match &self.tried {
            Some(Tried { state, .. }) => Wanted::Cost { state, current: &self.state },
            None => Wanted::Approximation(&self.state),
        }
    }

    /// Takes the wanted approximation. Breaks with the reason if the search has ended, after which it must not be continued.
    /// `None` if the state has no approximation, or at the start no finite cost.
    pub fn take_approximation(
        &mut self,
        states: &impl Moves<State = State>,
        found: Option<Quadratic>,
    ) -> Option<ControlFlow<Outcome>> {
        debug_assert!(self.tried.is_none(), "a cost is wanted");
        self.approximation = Some(found.filter(|here| self.approximation.is_some() || here.cost.is_finite())?);
        if self.iterations == self.settings.iterations {
            return Some(ControlFlow::Break(Outcome::IterationLimit));
        }
        self.iterations += 1;
        Some(match self.settings.method {
            Method::GaussNewton => match self.after_step(states) {
                Some((state, step_norm)) => self.accept(state, step_norm, None),
                None => ControlFlow::Break(Outcome::NoDescent),
            },
            Method::LevenbergMarquardt(schedule) => self.attempt(states, &schedule, 0),
        })
    }

    /// Takes the wanted cost, `None` if it is undefined. Breaks with the reason if the search has ended, after which it must not
    /// be continued, and if no cost is wanted.
    pub fn take_cost(&mut self, states: &impl Moves<State = State>, found: Option<f64>) -> ControlFlow<Outcome> {
        let (Some(tried), Some(here), Method::LevenbergMarquardt(schedule)) =
            (self.tried.take(), &self.approximation, self.settings.method)
        else {
            debug_assert!(false, "an approximation is wanted");
            return ControlFlow::Break(Outcome::NoDescent);
        };
        if let Some(cost) = found.filter(|&cost| cost < here.cost) {
            let descent = here.cost - cost;
            self.damping = (self.damping * schedule.decrease).max(schedule.lowest);
            return self.accept(tried.state, tried.step_norm, Some(descent));
        }
        if !self.raise_damping(&schedule) {
            return ControlFlow::Break(Outcome::NoDescent);
        }
        self.attempt(states, &schedule, tried.attempts)
    }

    /// Moves to a state whose cost, if it was computed, is less by `descent`.
    fn accept(&mut self, state: State, step_norm: f64, descent: Option<f64>) -> ControlFlow<Outcome> {
        self.state = state;
        let cost = self.approximation.as_ref().map_or(0.0, |here| here.cost);
        let enough = self.settings.absolute + self.settings.relative * cost;
        if step_norm < self.settings.step || descent.is_some_and(|descent| descent <= enough) {
            return ControlFlow::Break(Outcome::Converged);
        }
        if self.iterations == self.settings.iterations {
            return ControlFlow::Break(Outcome::IterationLimit);
        }
        ControlFlow::Continue(())
    }

    /// State after a step with the present damping, and the length of the step. `None` if there is none.
    fn after_step(&self, states: &impl Moves<State = State>) -> Option<(State, f64)> {
        let step = states.step(self.approximation.as_ref()?, self.damping)?;
        Some((states.moved(&self.state, &step)?, step.norm()))
    }

    /// Tries a step after a number of failed attempts, with more damping as long as there is none.
    fn attempt(
        &mut self,
        states: &impl Moves<State = State>,
        schedule: &Damping,
        failed: usize,
    ) -> ControlFlow<Outcome> {
        for attempts in failed..schedule.attempts {
            if let Some((state, step_norm)) = self.after_step(states) {
                self.tried = Some(Tried { state, step_norm, attempts: attempts + 1 });
                return ControlFlow::Continue(());
            }
            if !self.raise_damping(schedule) {
                break;
            }
        }
        ControlFlow::Break(Outcome::NoDescent)
    }

    /// Raises the damping. Returns whether it may be that large.
    fn raise_damping(&mut self, schedule: &Damping) -> bool {
        self.damping = schedule.increase * self.damping.max(schedule.restart);
        self.damping <= schedule.highest
    }
}

/// Least-squares problem given by its residuals, in units of their standard deviations.
pub trait Residuals {
    /// Residuals at the unknowns `x`. `None` if the model is undefined there.
    fn residuals(&self, x: &DVector<f64>) -> Option<DVector<f64>>;

    /// Jacobian `J = dr/dx`, one row per residual; [`central_jacobian`] and [`forward_jacobian`] approximate it.
    fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>>;
}

/// Unknowns and the residuals at them.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    /// Unknowns.
    pub x: DVector<f64>,
    /// Residuals.
    pub residuals: DVector<f64>,
}

impl Evaluated {
    /// Evaluates the residuals at `x`. `None` if the model is undefined there.
    pub fn new(problem: &impl Residuals, x: DVector<f64>) -> Option<Self> {
        problem.residuals(&x).map(|residuals| Self { x, residuals })
    }

    /// Half the sum of the squared residuals.
    pub fn cost(&self) -> f64 {
        0.5 * self.residuals.norm_squared()
    }
}

impl<P: Residuals> Moves for P {
    type State = Evaluated;

    fn moved(&self, at: &Evaluated, step: &DVector<f64>) -> Option<Evaluated> {
        Evaluated::new(self, &at.x + step)
    }
}

impl<P: Residuals> Problem for P {
    fn approximate(&self, at: &Evaluated) -> Option<Quadratic> {
        let jacobian = self.jacobian(at)?;
        let (gradient, curvature) = (jacobian.tr_mul(&at.residuals), jacobian.tr_mul(&jacobian));
        Some(Quadratic { cost: at.cost(), gradient, curvature })
    }

    fn cost(&self, at: &Evaluated, _: &Evaluated) -> Option<f64> {
        Some(at.cost())
    }
}

/// Jacobian by forward differences with an absolute step: one evaluation per unknown, error of first order in the step.
pub fn forward_jacobian(problem: &impl Residuals, at: &Evaluated, step: f64) -> Option<DMatrix<f64>> {
    columns(at, |i| Some((problem.residuals(&shifted(at, i, step))? - &at.residuals) / step))
}

/// Jacobian by central differences with an absolute step: two evaluations per unknown, error of second order in the step.
pub fn central_jacobian(problem: &impl Residuals, at: &Evaluated, step: f64) -> Option<DMatrix<f64>> {
    columns(at, |i| {
        let (high, low) = (problem.residuals(&shifted(at, i, step))?, problem.residuals(&shifted(at, i, -step))?);
        Some((high - low) / (2.0 * step))
    })
}

fn columns(at: &Evaluated, column: impl FnMut(usize) -> Option<DVector<f64>>) -> Option<DMatrix<f64>> {
    Some(DMatrix::from_columns(&(0..at.x.len()).map(column).collect::<Option<Vec<_>>>()?))
}

/// The unknowns with the `i`-th shifted.
fn shifted(at: &Evaluated, i: usize, step: f64) -> DVector<f64> {
    let mut x = at.x.clone();
    x[i] += step;
    x
}
