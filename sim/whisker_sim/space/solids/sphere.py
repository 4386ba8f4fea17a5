"""Sphere."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.base import FACE, Nearest, Solid, circle, outward
from whisker_sim.whisker import Array, Dimension


class Sphere(Solid, frozen=True, forbid_unknown_fields=True, tag="sphere"):
    """Sphere of radius `radius_m`."""

    radius_m: Dimension

    example: ClassVar[dict[str, Any]] = {"radius_m": 0.02}

    @property
    def sharpest_radius_m(self) -> float:
        """That of the sphere."""
        return self.radius_m

    def geoms(self) -> list[dict[str, str]]:
        """A sphere, whose collision with capsules has a closed form."""
        return [{"type": "sphere", "size": mjcf(1e3 * self.radius_m)}]

    def local_closest(self, points_m: Array) -> Nearest:
        """Along the radius through each point."""
        distance_m = np.linalg.norm(points_m, axis=1)
        point_m = self.radius_m * outward(points_m, distance_m)
        return Nearest(point_m, distance_m - self.radius_m, np.full(len(points_m), FACE))

    def wireframe(self) -> list[Array]:
        """Circles of latitude, and meridians."""
        flat = circle(self.radius_m)
        levels = [circle(self.radius_m * np.cos(a), self.radius_m * np.sin(a)) for a in np.radians((-60, -30, 0, 30, 60))]
        turned = [np.stack((np.cos(a) * flat[:, 0], np.sin(a) * flat[:, 0], flat[:, 1]), axis=-1) for a in np.radians((0, 60, 120))]
        return [*levels, *turned]
