"""Torus."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.base import FACE, Axial, Nearest, circle, outward
from whisker_sim.whisker import Array, Dimension

_PIECES = 2880


class Torus(Axial, frozen=True, forbid_unknown_fields=True, tag="torus"):
    """Torus about `axis`: a tube of radius `tube_m` along a circle of radius `radius_m`.

    MuJoCo's geometry is a ring of 2880 capsules along the tangents of the circle. Its tube is within 1e-6 of `radius_m`, and
    inclined by at most a sixteenth of a degree.
    """

    radius_m: Dimension
    tube_m: Dimension

    example: ClassVar[dict[str, Any]] = {"radius_m": 0.02, "tube_m": 0.005}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tube_m >= self.radius_m:
            raise ValueError(f"tube_m: expected less than radius_m = {self.radius_m}, found {self.tube_m}")

    @property
    def sharpest_radius_m(self) -> float:
        """That of the tube."""
        return self.tube_m

    def geoms(self) -> list[dict[str, str]]:
        """Capsules, whose collision with capsules has a closed form."""
        angle = 2.0 * np.pi * np.arange(_PIECES) / _PIECES
        half_mm = 1e3 * self.radius_m * np.tan(np.pi / _PIECES)
        along = np.stack((-np.sin(angle), np.cos(angle), 0.0 * angle), axis=-1)
        middle_mm = 1e3 * self.radius_m * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=-1)
        ends_mm = np.concatenate((middle_mm - half_mm * along, middle_mm + half_mm * along), axis=1)
        return [{"type": "capsule", "fromto": mjcf(*ends), "size": mjcf(1e3 * self.tube_m)} for ends in ends_mm]

    def local_closest(self, points_m: Array) -> Nearest:
        """Along the line from the nearest point of the circle."""
        flat = points_m * (1.0, 1.0, 0.0)
        ring_m = self.radius_m * outward(flat, np.linalg.norm(flat, axis=1))
        offset_m = points_m - ring_m
        distance_m = np.linalg.norm(offset_m, axis=1)
        point_m = ring_m + self.tube_m * outward(offset_m, distance_m)
        return Nearest(point_m, distance_m - self.tube_m, np.full(len(points_m), FACE))

    def wireframe(self) -> list[Array]:
        """Circles about the axis, and around the tube."""
        around = [circle(self.radius_m + self.tube_m * np.cos(a), self.tube_m * np.sin(a)) for a in np.radians((0, 90, 180, 270))]
        section = circle(self.tube_m, count=24) + np.array((self.radius_m, 0.0, 0.0))
        for angle in np.radians(np.arange(0, 360, 30)):
            tube = np.stack((np.cos(angle) * section[:, 0], np.sin(angle) * section[:, 0], section[:, 1]), axis=-1)
            around.append(tube)
        return around
