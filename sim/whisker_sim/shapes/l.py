"""L-shaped section."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.hollow import HollowPolygon, rectangle
from whisker_sim.whisker import Dimension


class L(HollowPolygon, frozen=True, forbid_unknown_fields=True, tag="l"):
    """Upright prism over an L: two arms `thickness_m` thick, whose inner faces reach `x_m` and `y_m` from the inner corner.

    The inner corner is the origin of the shape's frame, and the arms lie along +x and +y.
    """

    x_m: Dimension
    y_m: Dimension
    thickness_m: Dimension

    example: ClassVar[dict[str, Any]] = {"x_m": 0.016, "y_m": 0.012, "thickness_m": 0.006, "yaw_rad": 0.3}

    def vertices(self) -> Array:
        """The six corners."""
        x, y, t = self.x_m, self.y_m, self.thickness_m
        return np.array(((-t, -t), (x, -t), (x, 0.0), (0.0, 0.0), (0.0, y), (-t, y)))

    def parts(self) -> list[Array]:
        """The two arms, each with the corner that joins them."""
        x, y, t = self.x_m, self.y_m, self.thickness_m
        return [rectangle(-t, -t, x, 0.0), rectangle(-t, -t, 0.0, y)]
