"""Stadium: two semicircles joined by straight segments."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import CHORD_ERROR_M, HALF_HEIGHT_MM, Array, Shape, mjcf
from whisker_sim.whisker import Dimension


class Stadium(Shape, frozen=True, forbid_unknown_fields=True, tag="stadium"):
    """Upright body with the section of a flat bottle: all points within `radius_m` of a segment `flat_m` long on the x axis."""

    flat_m: Dimension
    radius_m: Dimension

    example: ClassVar[dict[str, Any]] = {"flat_m": 0.014, "radius_m": 0.01, "yaw_rad": 0.4}

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """A capsule at either end and a box between them; both collide with capsules in closed form."""
        half_flat_mm, radius_mm = 500.0 * self.flat_m, 1e3 * self.radius_m
        ends = [
            {"type": "capsule", "pos": mjcf(x_mm, 0.0, 0.0), "size": mjcf(radius_mm, half_height_mm)}
            for x_mm in (-half_flat_mm, half_flat_mm)
        ]
        return [*ends, {"type": "box", "size": mjcf(half_flat_mm, radius_mm, half_height_mm)}]

    def local_outline_m(self) -> Array:
        """Half of a regular polygon inscribed in the circle at either end; its sagitta r (1 - cos(pi/n)) is the chord error."""
        half = max(8, int(np.ceil(0.5 * np.pi / np.arccos(1.0 - min(1.0, CHORD_ERROR_M / self.radius_m)))))
        angle = np.pi * (np.arange(half + 1) / half - 0.5)
        right = self.radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1) + (0.5 * self.flat_m, 0.0)
        return np.concatenate((right, -right))

    def local_support_m(self, direction: Array) -> Array:
        """End point of the radius along `direction` about the farther end of the segment."""
        return self.radius_m * direction / np.hypot(*direction) + np.array((np.copysign(0.5 * self.flat_m, direction[0]), 0.0))

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points and signed distances along the radius from the nearest point of the segment."""
        spine_m = np.stack((np.clip(points_m[:, 0], -0.5 * self.flat_m, 0.5 * self.flat_m), np.zeros(len(points_m))), axis=-1)
        offset_m = points_m - spine_m
        distance_m = np.hypot(*offset_m.T)
        unit = np.where(distance_m[:, None] > 0.0, offset_m / np.maximum(distance_m, 1e-300)[:, None], (0.0, 1.0))
        return spine_m + self.radius_m * unit, distance_m - self.radius_m
