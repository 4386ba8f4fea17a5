"""Thin rod with round ends."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.base import FACE, Axial, Nearest, circle, outward
from whisker_sim.whisker import Array, Dimension


class ThinRod(Axial, frozen=True, forbid_unknown_fields=True, tag="pin"):
    """Thin rod along `axis`, by default 1 mm in diameter, with hemispheres at its ends."""

    radius_m: Dimension = 0.5e-3
    length_m: Dimension = 0.2
    """Distance between the centres of the hemispheres."""

    example: ClassVar[dict[str, Any]] = {"axis": (0.3, -0.2, 1.0)}

    @property
    def sharpest_radius_m(self) -> float:
        """That of the rod."""
        return self.radius_m

    def geoms(self) -> list[dict[str, str]]:
        """A capsule, whose collision with capsules has a closed form."""
        return [{"type": "capsule", "size": mjcf(1e3 * self.radius_m, 500.0 * self.length_m)}]

    def local_closest(self, points_m: Array) -> Nearest:
        """Along the perpendicular to the axis, or to the centre of the nearer hemisphere."""
        half_m = 0.5 * self.length_m
        axis_m = np.zeros_like(points_m)
        axis_m[:, 2] = np.clip(points_m[:, 2], -half_m, half_m)
        offset_m = points_m - axis_m
        distance_m = np.linalg.norm(offset_m, axis=1)
        point_m = axis_m + self.radius_m * outward(offset_m, distance_m)
        return Nearest(point_m, distance_m - self.radius_m, np.full(len(points_m), FACE))

    def wireframe(self) -> list[Array]:
        """Four lines, and circles along the rod."""
        half_m = 0.5 * self.length_m
        heights_m = np.linspace(-half_m, half_m, 5)
        lines = [
            np.array(((x, y, -half_m), (x, y, half_m))) for x, y in self.radius_m * np.array(((1, 0), (0, 1), (-1, 0), (0, -1)))
        ]
        return [*lines, *(circle(self.radius_m, height_m, 24) for height_m in heights_m)]
