"""Regular polygon."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.polygon import Polygon
from whisker_sim.whisker import Dimension


class RegularPolygon(Polygon, frozen=True, forbid_unknown_fields=True, tag="regular_polygon"):
    """Upright prism over a regular polygon with one corner on the +x axis of its frame."""

    sides: Annotated[int, msgspec.Meta(ge=3, le=360)]
    side_m: Dimension

    example: ClassVar[dict[str, Any]] = {"sides": 8, "side_m": 0.013}

    def vertices(self) -> Array:
        """Corners on the circle of radius side / (2 sin(pi / sides))."""
        angle = 2.0 * np.pi * np.arange(self.sides) / self.sides
        radius_m = 0.5 * self.side_m / np.sin(np.pi / self.sides)
        return radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
