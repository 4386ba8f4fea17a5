"""Base class of `pin` and `circle`."""

import numpy as np

from whisker_sim.shapes.base import CHORD_ERROR_M, HALF_HEIGHT_MM, Array, Shape, mjcf
from whisker_sim.whisker import Dimension


class Round(Shape, frozen=True, forbid_unknown_fields=True):
    """A disc of radius `radius_m`."""

    radius_m: Dimension

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """A vertical capsule, whose section in the plane of the whisker is the circle; capsules collide in closed form."""
        return [{"type": "capsule", "size": mjcf(1e3 * self.radius_m, half_height_mm)}]

    def local_outline_m(self) -> Array:
        """A regular polygon inscribed in the circle; its sagitta r (1 - cos(pi/n)) is the chord error."""
        count = max(16, int(np.ceil(np.pi / np.arccos(1.0 - min(1.0, CHORD_ERROR_M / self.radius_m)))))
        angle = 2.0 * np.pi * np.arange(count) / count
        return self.radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)

    def local_support_m(self, direction: Array) -> Array:
        """End point of the radius along `direction`."""
        return self.radius_m * direction / np.hypot(*direction)

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points and signed distances along the radius through each point."""
        distance_m = np.hypot(points_m[:, 0], points_m[:, 1])
        unit = np.where(distance_m[:, None] > 0.0, points_m / np.maximum(distance_m, 1e-300)[:, None], (1.0, 0.0))
        return self.radius_m * unit, distance_m - self.radius_m
