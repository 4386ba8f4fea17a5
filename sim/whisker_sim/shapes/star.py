"""Star."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.hollow import HollowPolygon
from whisker_sim.whisker import Dimension


class Star(HollowPolygon, frozen=True, forbid_unknown_fields=True, tag="star"):
    """Upright prism over a regular star with tips at `outer_m` and notches at `inner_m` from its centre.

    One tip is on the x axis.
    """

    points: Annotated[int, msgspec.Meta(ge=3, le=24)]
    outer_m: Dimension
    inner_m: Dimension

    example: ClassVar[dict[str, Any]] = {"points": 5, "outer_m": 0.02, "inner_m": 0.011, "yaw_rad": -1.5}

    def __post_init__(self) -> None:
        most_m = self.outer_m * np.cos(np.pi / self.points)
        if self.inner_m >= most_m:
            raise ValueError(f"inner_m: expected less than {most_m:.6g}, beyond which there are no notches, found {self.inner_m}")

    def vertices(self) -> Array:
        """Tips and notches in turn."""
        angle = np.pi * np.arange(2 * self.points) / self.points
        radius_m = np.where(np.arange(2 * self.points) % 2 == 0, self.outer_m, self.inner_m)
        return radius_m[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)

    def parts(self) -> list[Array]:
        """A kite from the centre to each tip."""
        vertices = self.vertices()
        return [np.array((np.zeros(2), vertices[i - 1], vertices[i], vertices[i + 1])) for i in range(0, 2 * self.points, 2)]
