"""Two discs side by side."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import CHORD_ERROR_M, HALF_HEIGHT_MM, Array, Shape, mjcf
from whisker_sim.whisker import Dimension


class Discs(Shape, frozen=True, forbid_unknown_fields=True, tag="discs"):
    """Upright body with the section of two overlapping discs of radius `radius_m`, `distance_m` apart on the x axis.

    With overlap the outline is one closed line, with a cusp on either side.
    """

    radius_m: Dimension
    distance_m: Dimension

    convex: ClassVar[bool] = False
    example: ClassVar[dict[str, Any]] = {"radius_m": 0.008, "distance_m": 0.015, "yaw_rad": 0.2}

    def __post_init__(self) -> None:
        if self.distance_m >= 2.0 * self.radius_m:
            raise ValueError(f"distance_m: expected less than 2 radius_m = {2.0 * self.radius_m}, found {self.distance_m}")

    def _centers_m(self) -> Array:
        return np.array(((0.5 * self.distance_m, 0.0), (-0.5 * self.distance_m, 0.0)))

    def _cusp_m(self) -> float:
        """Height of the cusps over the line of the centres."""
        return float(np.sqrt(self.radius_m**2 - 0.25 * self.distance_m**2))

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Two vertical capsules, as of a circle."""
        size = mjcf(1e3 * self.radius_m, half_height_mm)
        return [{"type": "capsule", "pos": mjcf(1e3 * x_m, 0.0, 0.0), "size": size} for x_m, _ in self._centers_m()]

    def local_outline_m(self) -> Array:
        """The arc of each disc between the cusps; the sagitta r (1 - cos(step / 2)) of its chords is the chord error."""
        half_rad = np.pi - np.arctan2(self._cusp_m(), 0.5 * self.distance_m)
        longest_rad = 2.0 * np.arccos(1.0 - min(1.0, CHORD_ERROR_M / self.radius_m))
        angle = np.linspace(-half_rad, half_rad, max(16, int(np.ceil(2.0 * half_rad / longest_rad)) + 1))[:-1]
        arc_m = self.radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        return np.concatenate([sign * (arc_m + self._centers_m()[0]) for sign in (1.0, -1.0)])

    def local_support_m(self, direction: Array) -> Array:
        """End point of the radius along `direction` about the farther centre."""
        return self.radius_m * direction / np.hypot(*direction) + np.array((np.copysign(0.5 * self.distance_m, direction[0]), 0.0))

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest of the nearest points of both circles outside of the other disc, and of the cusps."""
        inside = np.zeros(len(points_m), dtype=bool)
        cusp_m = np.stack((np.zeros(len(points_m)), np.copysign(self._cusp_m(), points_m[:, 1])), axis=-1)
        nearest_m, nearest = cusp_m, np.hypot(*(points_m - cusp_m).T)
        for center_m in self._centers_m():
            offset_m = points_m - center_m
            from_center_m = np.hypot(*offset_m.T)
            inside |= from_center_m < self.radius_m
            unit = np.where(from_center_m[:, None] > 0.0, offset_m / np.maximum(from_center_m, 1e-300)[:, None], (1.0, 0.0))
            circle_m = center_m + self.radius_m * unit
            outer = circle_m[:, 0] * center_m[0] >= 0.0
            away = np.abs(from_center_m - self.radius_m)
            nearer = outer & (away < nearest)
            nearest = np.where(nearer, away, nearest)
            nearest_m = np.where(nearer[:, None], circle_m, nearest_m)
        return nearest_m, np.where(inside, -1.0, 1.0) * nearest
