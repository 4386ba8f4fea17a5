"""Cone, also cut off."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.turned import Turned
from whisker_sim.whisker import Array, Dimension, NotNegativeLength

_SIDES = 360


class Cone(Turned, frozen=True, forbid_unknown_fields=True, tag="cone"):
    """Cone along `axis`, from the radius `radius_m` at its lower end to `top_radius_m` at its upper end.

    MuJoCo's geometry is a pyramid of 360 sides inside the cone, lower than it by at most 4e-5 of the radius.
    """

    radius_m: Dimension
    length_m: Dimension
    top_radius_m: NotNegativeLength = 0.0

    example: ClassVar[dict[str, Any]] = {"radius_m": 0.02, "length_m": 0.06}

    def geoms(self) -> list[dict[str, str]]:
        """A convex mesh."""
        return [{"type": "mesh", "mesh": "cone"}]

    def meshes(self) -> list[dict[str, str]]:
        """Vertices of the pyramid (mm)."""
        angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        half_mm = 500.0 * self.length_m
        vertices = []
        for radius_m, height_mm in ((self.radius_m, -half_mm), (self.top_radius_m, half_mm)):
            around = angle if radius_m > 0.0 else angle[:1]
            vertices += [mjcf(1e3 * radius_m * np.cos(a), 1e3 * radius_m * np.sin(a), height_mm) for a in around]
        return [{"name": "cone", "vertex": " ".join(vertices), "inertia": "convex"}]

    def profile(self) -> Array:
        """Lower end, side, upper end."""
        half_m = 0.5 * self.length_m
        top = [(self.top_radius_m, half_m)] if self.top_radius_m > 0.0 else []
        return np.array(((0.0, -half_m), (self.radius_m, -half_m), *top, (0.0, half_m)))

    def apexes(self) -> list[Array]:
        """The apex, unless the cone is cut off."""
        return [] if self.top_radius_m > 0.0 else [self.profile()[-1]]
