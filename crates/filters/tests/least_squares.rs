//! Exam of the least-squares solver: problems with known solutions, each under several settings.

use filters::least_squares::{
    Damping, Evaluated, Method, Moves, Outcome, Problem, Quadratic, Residuals, Settings, central_jacobian, minimise,
};
use nalgebra::{DMatrix, DVector, dvector};

/// A problem given by its residuals as a closure, with a Jacobian by central differences.
struct Closure<F>(F);

impl<F: Fn(&DVector<f64>) -> DVector<f64>> Residuals for Closure<F> {
    fn residuals(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        Some((self.0)(x)).filter(|residuals| residuals.iter().all(|residual| residual.is_finite()))
    }

    fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>> {
        central_jacobian(self, at, 1e-6)
    }
}

type Function = fn(&DVector<f64>) -> DVector<f64>;

/// A problem of the exam.
struct Case {
    name: &'static str,
    residuals: Function,
    start: &'static [f64],
    /// Unknowns at the minimum; those that the residuals do not determine are left out at the end.
    solution: &'static [f64],
    /// Half the sum of the squared residuals at the minimum.
    cost: f64,
    /// Largest relative error of the unknowns.
    tolerance: f64,
}

const CASES: &[Case] = &[
    Case { name: "linear", residuals: line, start: &[0.0, 0.0], solution: &[1.1, 0.9], cost: 0.03, tolerance: 1e-9 },
    Case {
        name: "Rosenbrock",
        residuals: rosenbrock,
        start: &[-1.2, 1.0],
        solution: &[1.0, 1.0],
        cost: 0.0,
        tolerance: 1e-6,
    },
    Case {
        name: "Misra1a, first start",
        residuals: misra,
        start: &[500.0, 1e-4 * MISRA_SCALE],
        solution: &[238.942_129_18, 5.501_564_318_1e-4 * MISRA_SCALE],
        cost: 0.5 * 0.124_551_388_94,
        tolerance: 1e-6,
    },
    Case {
        name: "Misra1a, second start",
        residuals: misra,
        start: &[250.0, 5e-4 * MISRA_SCALE],
        solution: &[238.942_129_18, 5.501_564_318_1e-4 * MISRA_SCALE],
        cost: 0.5 * 0.124_551_388_94,
        tolerance: 1e-6,
    },
    Case {
        name: "circle",
        residuals: circle,
        start: &[0.5, 0.5, 0.5],
        solution: &[1.0, -2.0, 3.0],
        cost: 0.0,
        tolerance: 1e-8,
    },
    Case {
        name: "rank-deficient at the start",
        residuals: saddle,
        start: &[0.0, 0.3],
        solution: &[1.0, 2.0],
        cost: 0.0,
        tolerance: 1e-6,
    },
    Case {
        name: "unknown without influence",
        residuals: ignored,
        start: &[0.0, 7.0],
        solution: &[2.0, 7.0],
        cost: 0.0,
        tolerance: 1e-8,
    },
    Case {
        name: "start at the solution",
        residuals: rosenbrock,
        start: &[1.0, 1.0],
        solution: &[1.0, 1.0],
        cost: 0.0,
        tolerance: 0.0,
    },
    Case {
        name: "undefined beyond a boundary",
        residuals: logarithm,
        start: &[5.0],
        solution: &[1.0],
        cost: 0.0,
        tolerance: 1e-8,
    },
];

/// Straight line through the points (0, 1), (1, 2.2), (2, 2.8), (3, 3.8).
fn line(x: &DVector<f64>) -> DVector<f64> {
    DVector::from_fn(4, |i, _| x[0] + x[1] * i as f64 - [1.0, 2.2, 2.8, 3.8][i])
}

/// Rosenbrock's function as two residuals (Moré, Garbow and Hillstrom, "Testing unconstrained optimization software",
/// 1981, problem 1).
fn rosenbrock(x: &DVector<f64>) -> DVector<f64> {
    dvector![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]
}

/// Scale of the second unknown of Misra1a, by which it is of order one.
const MISRA_SCALE: f64 = 1e3;

/// Misra1a of the NIST Statistical Reference Datasets: `y = b1 (1 - exp(-b2 x))`, with the certified parameters and
/// residual sum of squares.
fn misra(b: &DVector<f64>) -> DVector<f64> {
    const DATA: [(f64, f64); 14] = [
        (10.07, 77.6),
        (14.73, 114.9),
        (17.94, 141.1),
        (23.93, 190.8),
        (29.61, 239.9),
        (35.18, 289.0),
        (40.02, 332.8),
        (44.82, 378.4),
        (50.76, 434.8),
        (55.05, 477.3),
        (61.01, 536.8),
        (66.40, 593.1),
        (75.47, 689.1),
        (81.78, 760.0),
    ];
    DVector::from_fn(DATA.len(), |i, _| b[0] * (1.0 - (-b[1] / MISRA_SCALE * DATA[i].1).exp()) - DATA[i].0)
}

/// Distances of seven points on an arc from the circle `(x, y, radius)`.
fn circle(x: &DVector<f64>) -> DVector<f64> {
    DVector::from_fn(7, |i, _| {
        let (sin, cos) = (0.3 * i as f64).sin_cos();
        (1.0 + 3.0 * cos - x[0]).hypot(-2.0 + 3.0 * sin - x[1]) - x[2]
    })
}

/// Residuals `x^2 + x - 2` and `x y - 2`: at `x = 0` they do not depend on `y`.
fn saddle(x: &DVector<f64>) -> DVector<f64> {
    dvector![x[0] * x[0] + x[0] - 2.0, x[0] * x[1] - 2.0]
}

/// Residuals of the first unknown only.
fn ignored(x: &DVector<f64>) -> DVector<f64> {
    dvector![x[0] - 2.0, 0.5 * (x[0] - 2.0)]
}

/// Not a number for `x <= 0`, where a Gauss-Newton step from the start leads.
fn logarithm(x: &DVector<f64>) -> DVector<f64> {
    dvector![x[0].ln()]
}

/// Schedules from nearly undamped to strongly damped.
fn schedules() -> [(&'static str, Damping); 3] {
    let nearly_undamped =
        Damping { first: 1e-9, lowest: 1e-9, decrease: 0.01, increase: 20.0, attempts: 12, ..Damping::MARQUARDT };
    let strong = Damping { first: 10.0, decrease: 0.5, increase: 3.0, restart: 1e-3, ..Damping::MARQUARDT };
    [("Marquardt", Damping::MARQUARDT), ("nearly undamped", nearly_undamped), ("strong", strong)]
}

fn settings(damping: Damping) -> Settings {
    Settings { method: Method::LevenbergMarquardt(damping), iterations: 500, ..Settings::default() }
}

#[test]
fn val_every_schedule_finds_the_known_minimum_of_every_problem() {
    for case in CASES {
        for (schedule, damping) in schedules() {
            let name = format!("{}, {schedule}", case.name);
            let problem = Closure(case.residuals);
            let start = Evaluated::new(&problem, DVector::from_column_slice(case.start)).expect("a finite start");
            let initial = start.cost();
            let solution = minimise(&problem, start, &settings(damping)).expect("a finite start");
            assert_ne!(solution.outcome, Outcome::IterationLimit, "{name}");
            for (found, expected) in solution.state.x.iter().zip(case.solution) {
                let error = (found - expected).abs();
                assert!(error <= case.tolerance * expected.abs(), "{name}: found {}", solution.state.x);
            }
            let cost = solution.state.cost();
            assert!(cost <= initial && (cost - case.cost).abs() < 1e-9, "{name}: cost {cost}");
        }
    }
}

#[test]
fn val_gauss_newton_finds_the_known_minimum_of_nearly_linear_problems() {
    let settings = Settings { method: Method::GaussNewton, iterations: 50, absolute: 0.0, relative: 0.0, step: 1e-5 };
    for case in CASES.iter().filter(|case| ["linear", "circle", "Misra1a, second start"].contains(&case.name)) {
        let problem = Closure(case.residuals);
        let start = Evaluated::new(&problem, DVector::from_column_slice(case.start)).expect("a finite start");
        let solution = minimise(&problem, start, &settings).expect("a finite start");
        assert_eq!(solution.outcome, Outcome::Converged, "{}", case.name);
        for (found, expected) in solution.state.x.iter().zip(case.solution) {
            let error = (found - expected).abs();
            assert!(error <= case.tolerance * expected.abs(), "{}: found {}", case.name, solution.state.x);
        }
    }
}

#[test]
fn val_covariance_of_a_straight_line_is_that_of_linear_regression() {
    let problem = Closure(line);
    let start = Evaluated::new(&problem, dvector![0.0, 0.0]).expect("a finite start");
    let solution = minimise(&problem, start, &Settings::default()).expect("a finite start");
    // For unit variance and abscissas 0, 1, 2, 3: sum of squares about their mean 5, mean 1.5.
    let expected = DMatrix::from_row_slice(2, 2, &[0.25 + 1.5 * 1.5 / 5.0, -1.5 / 5.0, -1.5 / 5.0, 1.0 / 5.0]);
    let covariance = solution.approximation.covariance().expect("a positive definite curvature");
    assert!((covariance - expected).norm() < 1e-8);
}

#[test]
fn verif_the_cost_never_increases_from_one_iteration_to_the_next() {
    let problem = Closure(rosenbrock);
    let mut last = f64::INFINITY;
    for iterations in 0..20 {
        let start = Evaluated::new(&problem, dvector![-1.2, 1.0]).expect("a finite start");
        let settings = Settings { iterations, relative: 0.0, ..Settings::default() };
        let solution = minimise(&problem, start, &settings).expect("a finite start");
        let cost = solution.state.cost();
        assert!(cost <= last);
        last = cost;
    }
}

#[test]
fn verif_outcomes_are_distinguished() {
    let problem = Closure(rosenbrock);
    let outcome = |x: DVector<f64>, settings: &Settings| {
        let start = Evaluated::new(&problem, x).expect("a finite start");
        minimise(&problem, start, settings).expect("a finite start").outcome
    };
    let default = Settings::default();
    assert_eq!(outcome(dvector![-1.2, 1.0], &Settings { absolute: 1e-3, ..default }), Outcome::Converged);
    assert_eq!(outcome(dvector![1.0, 1.0], &default), Outcome::NoDescent);
    assert_eq!(outcome(dvector![-1.2, 1.0], &Settings { iterations: 2, ..default }), Outcome::IterationLimit);
}

#[test]
fn robust_an_undefined_start_has_no_solution() {
    assert_eq!(Evaluated::new(&Closure(logarithm), dvector![-1.0]), None);
    let undefined = Evaluated { x: dvector![-1.0], residuals: dvector![f64::NAN] };
    assert!(minimise(&Closure(logarithm), undefined, &Settings::default()).is_none());
}

#[test]
fn robust_a_singular_curvature_ends_gauss_newton_at_the_start() {
    let problem = Closure(ignored);
    let start = Evaluated::new(&problem, dvector![0.0, 7.0]).expect("a finite start");
    let settings = Settings { method: Method::GaussNewton, ..Settings::default() };
    let solution = minimise(&problem, start, &settings).expect("a finite start");
    assert_eq!((solution.outcome, solution.state.x), (Outcome::NoDescent, dvector![0.0, 7.0]));
}

/// Weighted mean with weights that depend on the state: the Cauchy cost by iteratively reweighted least squares.
struct Reweighted;

impl Reweighted {
    const READINGS: [f64; 5] = [0.9, 1.0, 1.1, 1.05, 40.0];
}

impl Moves for Reweighted {
    type State = f64;

    fn moved(&self, x: &f64, step: &DVector<f64>) -> Option<f64> {
        Some(x + step[0])
    }
}

impl Problem for Reweighted {
    fn approximate(&self, x: &f64) -> Option<Quadratic> {
        let weight = |reading: f64| 1.0 / (1.0 + (x - reading).powi(2));
        let gradient = Self::READINGS.iter().map(|&reading| weight(reading) * (x - reading)).sum();
        let curvature = Self::READINGS.iter().map(|&reading| weight(reading)).sum();
        Some(Quadratic {
            cost: self.cost(x, x)?,
            gradient: dvector![gradient],
            curvature: DMatrix::from_element(1, 1, curvature),
        })
    }

    fn cost(&self, x: &f64, _: &f64) -> Option<f64> {
        Some(0.5 * Self::READINGS.iter().map(|reading| (1.0 + (x - reading).powi(2)).ln()).sum::<f64>())
    }
}

#[test]
fn val_a_robust_cost_is_minimised_by_reweighting() {
    let solution = minimise(&Reweighted, 8.0, &Settings::default()).expect("a finite cost");
    // Minimum by a fine grid.
    let cost = |x: f64| Reweighted.cost(&x, &x).expect("a cost");
    let best = (0..400_000).map(|i| 1e-4 * f64::from(i)).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    assert!((solution.state - best.expect("a grid")).abs() < 1e-4, "{}", solution.state);
}
