"""Arbitrary convex polygon."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.shapes.base import Array
from whisker_sim.shapes.polygon import Polygon
from whisker_sim.whisker import LEAST_DIMENSION_M, Coordinate


class ConvexPolygon(Polygon, frozen=True, forbid_unknown_fields=True, tag="convex_polygon"):
    """Upright prism over a convex polygon, vertices counter-clockwise."""

    vertices_m: Annotated[tuple[tuple[Coordinate, Coordinate], ...], msgspec.Meta(min_length=3, max_length=360)]

    example: ClassVar[dict[str, Any]] = {"vertices_m": ((-0.01, -0.01), (0.012, -0.008), (0.009, 0.011), (-0.004, 0.013))}

    def __post_init__(self) -> None:
        edge = np.roll(self.vertices(), -1, axis=0) - self.vertices()
        after = np.roll(edge, -1, axis=0)
        turn_m2 = edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]
        if np.any(turn_m2 <= 0.0):
            corner = (int(np.argmax(turn_m2 <= 0.0)) + 1) % len(self.vertices_m)
            raise ValueError(f"vertices_m: expected a left turn at every vertex, found none at vertex {corner}")
        turns = np.sum(np.arctan2(turn_m2, np.sum(edge * after, axis=1))) / (2.0 * np.pi)
        if round(turns) != 1:
            raise ValueError(f"vertices_m: expected an outline that runs round once, found {round(turns)} times")
        # The narrowest breadth of a convex polygon is that across one of its edges.
        across_m = (edge[:, :1] * self.vertices()[:, 1] - edge[:, 1:] * self.vertices()[:, 0]) / np.hypot(*edge.T)[:, None]
        breadth_m = float(np.min(np.ptp(across_m, axis=1)))
        if breadth_m < LEAST_DIMENSION_M:
            raise ValueError(f"vertices_m: expected an outline at least {LEAST_DIMENSION_M:g} m broad, found {breadth_m:.3g} m")

    def vertices(self) -> Array:
        """The given vertices."""
        return np.array(self.vertices_m)
