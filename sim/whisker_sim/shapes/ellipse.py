"""Ellipse."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import CHORD_ERROR_M, HALF_HEIGHT_MM, Array, Shape, mjcf
from whisker_sim.whisker import Dimension


class Ellipse(Shape, frozen=True, forbid_unknown_fields=True, tag="ellipse"):
    """Upright body with an elliptic section; its semi-axes are along the axes of its frame."""

    semi_x_m: Dimension
    semi_y_m: Dimension

    upright: ClassVar[bool] = False
    example: ClassVar[dict[str, Any]] = {"semi_x_m": 0.02, "semi_y_m": 0.012, "yaw_rad": 0.4}

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """An ellipsoid whose section in the plane of the whisker is the ellipse."""
        return [{"type": "ellipsoid", "size": mjcf(1e3 * self.semi_x_m, 1e3 * self.semi_y_m, half_height_mm)}]

    def local_outline_m(self) -> Array:
        """Points at equal steps of the parameter t of (a cos t, b sin t).

        The sagitta of a step h is max(a, b) h^2 / 8 at most, because the second derivative with respect to t is max(a, b) at most.
        """
        step = np.sqrt(8.0 * CHORD_ERROR_M / max(self.semi_x_m, self.semi_y_m))
        count = max(16, int(np.ceil(2.0 * np.pi / step)))
        t = 2.0 * np.pi * np.arange(count) / count
        return np.stack((self.semi_x_m * np.cos(t), self.semi_y_m * np.sin(t)), axis=-1)

    def local_support_m(self, direction: Array) -> Array:
        """(a^2 nx, b^2 ny) / sqrt(a^2 nx^2 + b^2 ny^2)."""
        scaled = np.array((self.semi_x_m, self.semi_y_m)) * direction
        return np.array((self.semi_x_m, self.semi_y_m)) * scaled / np.hypot(*scaled)

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points by bisection for the Lagrange multiplier.

        Eberly, "Distance from a point to an ellipse": in the first quadrant and with a >= b, the nearest point is
        (a^2 x / (t + a^2), b^2 y / (t + b^2)), where t is the only root above -b^2 of
        (a x / (t + a^2))^2 + (b y / (t + b^2))^2 = 1.
        """
        swap = self.semi_x_m < self.semi_y_m
        a, b = max(self.semi_x_m, self.semi_y_m), min(self.semi_x_m, self.semi_y_m)
        folded = np.abs(points_m[:, ::-1] if swap else points_m)
        x, y = folded[:, 0], np.maximum(folded[:, 1], 1e-15)
        # Lower bound: one term alone equals one. Upper bound: the sum of the terms is at most one.
        low = -b * b + b * y
        high = -b * b + np.hypot(a * x, b * y)
        for _ in range(80):
            middle = 0.5 * (low + high)
            outside = (a * x / (middle + a * a)) ** 2 + (b * y / (middle + b * b)) ** 2 > 1.0
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        t = 0.5 * (low + high)
        nearest = np.stack((a * a * x / (t + a * a), b * b * y / (t + b * b)), axis=-1)
        nearest = np.copysign(nearest[:, ::-1] if swap else nearest, points_m)
        distance_m = np.hypot(*(points_m - nearest).T)
        inside = (points_m[:, 0] / self.semi_x_m) ** 2 + (points_m[:, 1] / self.semi_y_m) ** 2 < 1.0
        return nearest, np.where(inside, -1.0, 1.0) * distance_m
