"""Rectangle."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import HALF_HEIGHT_MM, Array, mjcf
from whisker_sim.shapes.polygon import Polygon
from whisker_sim.whisker import Dimension


class Rectangle(Polygon, frozen=True, forbid_unknown_fields=True, tag="rectangle"):
    """Upright block; its sides are along the axes of its frame."""

    width_m: Dimension
    height_m: Dimension

    example: ClassVar[dict[str, Any]] = {"width_m": 0.03, "height_m": 0.02, "yaw_rad": 0.3}

    def vertices(self) -> Array:
        """The four corners."""
        x, y = 0.5 * self.width_m, 0.5 * self.height_m
        return np.array(((-x, -y), (x, -y), (x, y), (-x, y)))

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """A box, whose collision with capsules has a closed form, in contrast to that of a mesh."""
        return [{"type": "box", "size": mjcf(500.0 * self.width_m, 500.0 * self.height_m, half_height_mm)}]

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """None."""
        return []
