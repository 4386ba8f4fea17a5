"""Kalman filters of filterpy and a particle filter in NumPy, on the problem that `peers` writes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Estimates:
    """Posterior after each reading: means (steps x 2, m) and covariances (steps x 2 x 2, m^2)."""

    mean_m: Array
    covariance_m2: Array


class Problem:
    """Numbers of the problem as arrays, as defined in `src/problem.rs`."""

    def __init__(self, numbers: dict[str, Any]) -> None:
        steps = numbers["steps"]
        # Matrices are stored by columns.
        self.turn = np.array([step["turn"] for step in steps]).reshape(-1, 2, 2).transpose(0, 2, 1)
        self.shift_m = np.array([step["shift_m"] for step in steps])
        self.reading_n_m = np.array([step["reading_n_m"] for step in steps])
        self.truth_m = np.array(numbers["truth_m"])
        self.variance_n2_m2: float = numbers["variance_n2_m2"]
        self.wander_m2: float = numbers["wander_m2"]
        self.start_m = np.array(numbers["start_m"])
        self.start_m2: float = numbers["start_m2"]
        self.particles: int = numbers["particles"]
        self.resample_share: float = numbers["resample_share"]
        self.spread = {key: numbers[key] for key in ("alpha", "beta", "kappa")}
        self.model = Polynomial(numbers["model"])


class Polynomial:
    """Sensor model in powers of the scaled coordinates, which NumPy evaluates faster than Chebyshev polynomials."""

    def __init__(self, model: dict[str, Any]) -> None:
        count = model["degree"] + 1
        coefficients = np.zeros((count, count))
        coefficients[np.add.outer(np.arange(count), np.arange(count)) < count] = model["coefficients_n_m"]
        powers = np.array([np.pad(chebyshev.cheb2poly(row), (0, count))[:count] for row in np.eye(count)])
        self.coefficients = powers.T @ coefficients @ powers
        self.centre_m, self.scale_m = np.array(model["center_m"]), np.array(model["scale_m"])
        self.exponents = np.arange(count)

    def reading_n_m(self, x: Array) -> float:
        """Reading for one contact."""
        u, v = (x - self.centre_m) / self.scale_m
        return float(u**self.exponents @ self.coefficients @ v**self.exponents)

    def gradient_n(self, x: Array) -> Array:
        """Gradient of the reading, 1 x 2."""
        u, v = (x - self.centre_m) / self.scale_m
        inner = self.exponents[1:]
        slope_u = (inner * u ** (inner - 1)) @ self.coefficients[1:] @ v**self.exponents / self.scale_m[0]
        slope_v = u**self.exponents @ self.coefficients[:, 1:] @ (inner * v ** (inner - 1)) / self.scale_m[1]
        return np.array([[slope_u, slope_v]])


def filterpy_ekf(problem: Problem) -> Estimates:
    """Filterpy's extended Kalman filter."""
    found = ExtendedKalmanFilter(dim_x=2, dim_z=1)
    found.x, found.P = problem.start_m.copy(), np.eye(2) * problem.start_m2
    found.Q, found.R = np.eye(2) * problem.wander_m2, np.array([[problem.variance_n2_m2]])
    model, means, covariances = problem.model, [], []
    for turn, shift_m, reading_n_m in zip(problem.turn, problem.shift_m, problem.reading_n_m, strict=True):
        found.F = turn
        found.predict()
        # Its prediction is linear; the displacement by the motion is added separately.
        found.x = found.x + shift_m
        found.update(np.array([reading_n_m]), model.gradient_n, lambda x: np.array([model.reading_n_m(x)]))
        means.append(found.x)
        covariances.append(found.P)
    return Estimates(np.array(means), np.array(covariances))


def filterpy_ukf(problem: Problem) -> Estimates:
    """Filterpy's unscented Kalman filter."""
    step: list[Any] = [None, None]
    found = UnscentedKalmanFilter(
        dim_x=2,
        dim_z=1,
        dt=1.0,
        fx=lambda x, dt: step[0] @ x + step[1],
        hx=lambda x: np.array([problem.model.reading_n_m(x)]),
        points=MerweScaledSigmaPoints(2, **problem.spread),
    )
    found.x, found.P = problem.start_m.copy(), np.eye(2) * problem.start_m2
    found.Q, found.R = np.eye(2) * problem.wander_m2, np.array([[problem.variance_n2_m2]])
    means, covariances = [], []
    for turn, shift_m, reading_n_m in zip(problem.turn, problem.shift_m, problem.reading_n_m, strict=True):
        step[:] = turn, shift_m
        found.predict()
        found.update(np.array([reading_n_m]))
        means.append(found.x.copy())
        covariances.append(found.P.copy())
    return Estimates(np.array(means), np.array(covariances))


def numpy_particle(problem: Problem, seed: int) -> Estimates:
    """Particle filter on whole arrays with one row per coordinate; all buffers are allocated once."""
    # The fastest of NumPy's generators for normal numbers: 14 us for 2000, instead of 17 us with the default one.
    rng = np.random.Generator(np.random.SFC64(seed))
    count, model = problem.particles, problem.model
    fewest, step_sd_m = problem.resample_share * count, np.sqrt(problem.wander_m2)
    centre_m, scale_m = model.centre_m[:, None], model.scale_m[:, None]
    x = problem.start_m[:, None] + np.sqrt(problem.start_m2) * rng.standard_normal((2, count))
    logs, weights, pointers = np.zeros(count), np.full(count, 1.0 / count), np.arange(count)
    normal, powers = np.empty((2, count)), np.ones((len(model.exponents), 2, count))
    steps = len(problem.reading_n_m)
    means, covariances = np.empty((steps, 2)), np.empty((steps, 2, 2))
    for i in range(steps):
        x = problem.turn[i] @ x
        x += problem.shift_m[i][:, None]
        rng.standard_normal(out=normal)
        normal *= step_sd_m
        x += normal
        np.divide(np.subtract(x, centre_m, out=powers[1]), scale_m, out=powers[1])
        for exponent in model.exponents[2:]:
            np.multiply(powers[exponent - 1], powers[1], out=powers[exponent])
        residual = np.einsum("in,in->n", powers[:, 0], model.coefficients @ powers[:, 1])
        residual -= problem.reading_n_m[i]
        residual *= residual
        residual *= 0.5 / problem.variance_n2_m2
        logs -= residual
        logs -= logs.max()
        np.exp(logs, out=weights)
        weights /= weights.sum()
        means[i] = x @ weights
        apart = x - means[i][:, None]
        covariances[i] = (apart * weights) @ apart.T
        if fewest * (weights @ weights) > 1.0:
            places = np.searchsorted(np.cumsum(weights), (pointers + rng.random()) / count)
            x = x[:, np.minimum(places, count - 1)]
            logs.fill(0.0)
    return Estimates(means, covariances)
