"""Stairs."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.hollow import HollowPolygon, rectangle
from whisker_sim.whisker import Dimension


class Step(HollowPolygon, frozen=True, forbid_unknown_fields=True, tag="step"):
    """Upright prism over stairs of `levels` treads, each `tread_m` wide, that rise by `rise_m` from each to the next along -x.

    The lowest outer corner is the origin of the shape's frame; the solid is above the x axis.
    """

    tread_m: Dimension
    rise_m: Dimension
    levels: Annotated[int, msgspec.Meta(ge=2, le=20)] = 2

    example: ClassVar[dict[str, Any]] = {"tread_m": 0.012, "rise_m": 0.005, "yaw_rad": 2.9}

    def vertices(self) -> Array:
        """The corners of the treads, from the lowest to the highest, and the two at the bottom."""
        level = np.arange(self.levels)
        outer = np.stack((-self.tread_m * level, self.rise_m * (level + 1)), axis=-1)
        inner = outer - (self.tread_m, 0.0)
        treads = np.stack((outer, inner), axis=1).reshape(-1, 2)
        return np.concatenate((((0.0, 0.0),), treads, ((-self.tread_m * self.levels, 0.0),)))

    def parts(self) -> list[Array]:
        """A block under each tread, as far as the back."""
        back_m = -self.tread_m * self.levels
        return [rectangle(back_m, 0.0, -self.tread_m * level, self.rise_m * (level + 1)) for level in range(self.levels)]
