"""Section of a cup."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.hollow import HollowPolygon, rectangle
from whisker_sim.whisker import Dimension


class Cup(HollowPolygon, frozen=True, forbid_unknown_fields=True, tag="cup"):
    """Upright prism over a U with walls `thickness_m` thick about a cavity `width_m` wide and `depth_m` deep.

    The cavity opens along +y, and the middle of its opening is the origin of the shape's frame.
    """

    width_m: Dimension
    depth_m: Dimension
    thickness_m: Dimension

    example: ClassVar[dict[str, Any]] = {"width_m": 0.016, "depth_m": 0.01, "thickness_m": 0.004, "yaw_rad": 2.8}

    def vertices(self) -> Array:
        """The eight corners."""
        half, bottom, t = 0.5 * self.width_m, -self.depth_m, self.thickness_m
        right = ((half + t, bottom - t), (half + t, 0.0), (half, 0.0), (half, bottom))
        left = ((-half, bottom), (-half, 0.0), (-half - t, 0.0), (-half - t, bottom - t))
        return np.array((*right, *left))

    def parts(self) -> list[Array]:
        """The bottom and the two walls, each with its corners."""
        half, bottom, t = 0.5 * self.width_m, -self.depth_m, self.thickness_m
        return [
            rectangle(-half - t, bottom - t, half + t, bottom),
            rectangle(half, bottom - t, half + t, 0.0),
            rectangle(-half - t, bottom - t, -half, 0.0),
        ]
