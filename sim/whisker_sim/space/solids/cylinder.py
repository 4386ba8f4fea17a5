"""Cylinder."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.turned import Turned
from whisker_sim.whisker import Array, Dimension


class Cylinder(Turned, frozen=True, forbid_unknown_fields=True, tag="cylinder"):
    """Cylinder along `axis` with flat ends, whose rims are edges."""

    radius_m: Dimension
    length_m: Dimension = 0.2

    example: ClassVar[dict[str, Any]] = {"radius_m": 0.015, "axis": (0.0, 0.5, 1.0)}

    @property
    def sharpest_radius_m(self) -> float:
        """That of the side."""
        return self.radius_m

    def geoms(self) -> list[dict[str, str]]:
        """A cylinder."""
        return [{"type": "cylinder", "size": mjcf(1e3 * self.radius_m, 500.0 * self.length_m)}]

    def profile(self) -> Array:
        """Lower end, side, upper end."""
        half_m = 0.5 * self.length_m
        return np.array(((0.0, -half_m), (self.radius_m, -half_m), (self.radius_m, half_m), (0.0, half_m)))
