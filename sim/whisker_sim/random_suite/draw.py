"""Random numbers of the suite's quantities."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")

Draw = Callable[[np.random.Generator], T]
"""A function that draws a value."""


def uniform(rng: np.random.Generator, low: float, high: float, digits: int = 6) -> float:
    """A number between two bounds, with few digits so that scenes stay readable."""
    return round(float(rng.uniform(low, high)), digits)


def log_uniform(rng: np.random.Generator, low: float, high: float, digits: int = 6) -> float:
    """A number between two positive bounds, uniform in its logarithm."""
    return round(float(low * (high / low) ** rng.random()), digits)


def signed(rng: np.random.Generator, low: float, high: float, digits: int = 6) -> float:
    """A number of either sign, whose size is log-uniform between two bounds."""
    return log_uniform(rng, low, high, digits) * float(rng.choice((-1.0, 1.0)))


def weighted(rng: np.random.Generator, rows: Sequence[tuple[float, T]]) -> T:
    """One of some rows, with probabilities in proportion to their weights."""
    weights = np.array([weight for weight, _ in rows])
    return rows[int(rng.choice(len(rows), p=weights / weights.sum()))][1]
