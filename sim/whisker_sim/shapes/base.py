"""What every object shape gives: MuJoCo geometry, outline, support point and signed distance.

A shape is a convex region of the plane, given in its own frame; `center_m` and `yaw_rad` place that frame in World. A new shape
subclasses `Shape`, implements the methods marked below in its own frame, and gets a row in the registry.
"""

from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.whisker import Coordinate

Array = NDArray[np.float64]

CHORD_ERROR_M = 1e-6
"""Largest distance of an outline's polyline from the true outline."""

HALF_HEIGHT_MM = 10.0
"""Half of an object's extent out of the whisker's plane; any value well above the whisker's radius gives the same contact."""


class Shape(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="shape", kw_only=True):
    """An object's outline, placed in World."""

    center_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    yaw_rad: float = 0.0

    example: ClassVar[dict[str, Any]]
    """Parameters with which the tests examine the shape."""

    upright: ClassVar[bool] = True
    """Whether the geoms have the outline as their section at every height, not in the whisker's plane alone."""

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Attributes of the MJCF geoms, in millimetres, in the shape's frame."""
        raise NotImplementedError

    def local_outline_m(self) -> Array:
        """Vertices (n, 2) of the outline, counter-clockwise, not closed, within `CHORD_ERROR_M`."""
        raise NotImplementedError

    def local_support_m(self, direction: Array) -> Array:
        """The outline's point (2,) that lies farthest along `direction` (2,)."""
        raise NotImplementedError

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """For points (n, 2): the outline's nearest points (n, 2) and the signed distances (n,), negative inside."""
        raise NotImplementedError

    def chord_error_m(self) -> float:
        """Largest distance of the polyline from the true outline; polygons override it with zero."""
        return CHORD_ERROR_M

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Attributes of the MJCF meshes that `geoms` refers to; most shapes need none."""
        return []

    def outline_m(self) -> Array:
        """Outline (n + 1, 2) in World, counter-clockwise, closed by repeating the first vertex."""
        vertices = self.to_world(self.local_outline_m())
        return np.concatenate((vertices, vertices[:1]))

    def support_m(self, direction: Array) -> Array:
        """The outline's point (2,) in World that lies farthest along `direction` (2,), in World."""
        return self.to_world(self.local_support_m(direction @ self._rotation()))

    def closest(self, points_m: Array) -> tuple[Array, Array]:
        """For points (n, 2) in World: the outline's nearest points (n, 2) and the signed distances (n,), negative inside."""
        nearest_m, distance_m = self.local_closest((points_m - np.array(self.center_m)) @ self._rotation())
        return self.to_world(nearest_m), distance_m

    def to_world(self, points_m: Array) -> Array:
        """Points (..., 2) of the shape's frame in World."""
        return points_m @ self._rotation().T + np.array(self.center_m)

    def _rotation(self) -> Array:
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array(((cos, -sin), (sin, cos)))


def mjcf(*numbers: float) -> str:
    """Numbers as an MJCF attribute, without loss."""
    return " ".join(repr(float(number)) for number in numbers)
