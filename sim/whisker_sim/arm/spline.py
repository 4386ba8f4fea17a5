"""Natural cubic splines of any dimension."""

import numpy as np

from whisker_sim.whisker import Array


class Spline:
    """The natural cubic spline through `values` (n, m) at the ascending `knots` (n,), twice continuously differentiable.

    With the second derivatives M_i at the knots and the steps h_i, h_{i-1} M_{i-1} + 2 (h_{i-1} + h_i) M_i + h_i M_{i+1} =
    6 (slope_i - slope_{i-1}), and M is zero at both ends.
    """

    def __init__(self, knots: Array, values: Array) -> None:
        self._knots, self._values = knots, values
        step = np.diff(knots)
        slope = np.diff(values, axis=0) / step[:, None]
        diagonal, right = 2.0 * (step[:-1] + step[1:]), 6.0 * np.diff(slope, axis=0)
        # The matrix is tridiagonal and diagonally dominant: elimination needs no pivoting.
        for row in range(1, len(diagonal)):
            share = step[row] / diagonal[row - 1]
            diagonal[row] -= share * step[row]
            right[row] -= share * right[row - 1]
        self._bend = np.zeros_like(values)
        for row in range(len(diagonal) - 1, -1, -1):
            self._bend[row + 1] = (right[row] - step[row + 1] * self._bend[row + 2]) / diagonal[row]

    def __call__(self, at: Array) -> Array:
        """Values (k, m) at `at` (k,)."""
        left, step, u = self._place(at)
        before, after = self._values[left], self._values[left + 1]
        bend, next_bend = self._bend[left], self._bend[left + 1]
        v = 1.0 - u
        return v * before + u * after + step**2 / 6.0 * ((v**3 - v) * bend + (u**3 - u) * next_bend)

    def slope(self, at: Array) -> Array:
        """First derivatives (k, m) at `at` (k,)."""
        left, step, u = self._place(at)
        chord = (self._values[left + 1] - self._values[left]) / step
        bend, next_bend = self._bend[left], self._bend[left + 1]
        return chord + step / 6.0 * ((1.0 - 3.0 * (1.0 - u) ** 2) * bend + (3.0 * u**2 - 1.0) * next_bend)

    def _place(self, at: Array) -> tuple[Array, Array, Array]:
        """Index of the knot before each of `at`, the step to the next knot, and the normalised position within it."""
        left = np.clip(np.searchsorted(self._knots, at, side="right") - 1, 0, len(self._knots) - 2)
        step = self._knots[left + 1] - self._knots[left]
        return left, step[:, None], ((at - self._knots[left]) / step)[:, None]
