"""Interface of object shapes: MuJoCo geometry, outline, support point and signed distance.

A shape is a region of the plane in its own frame, bounded by one closed line, which `center_m` and `yaw_rad` place in World. A new
shape subclasses `Shape`, implements its abstract methods in its own frame, and is added to the registry.
"""

from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.whisker import Angle, Coordinate

Array = NDArray[np.float64]

CHORD_ERROR_M = 1e-6
"""Maximum distance between the polyline of an outline and the true outline."""

HALF_HEIGHT_MM = 10.0
"""Half the height of an object. Any value well above the radius of the whisker gives the same contact."""


_GRID = 41
"""Points of a grid over a shape along each axis."""


class Shape(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="shape", kw_only=True):
    """Outline of an object, placed in World."""

    center_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    yaw_rad: Angle = 0.0

    example: ClassVar[dict[str, Any]]
    """Parameters used by the tests of the registry."""

    upright: ClassVar[bool] = True
    """Whether the geoms have the outline as their section at every height, not only in the plane of the whisker."""

    convex: ClassVar[bool] = True
    """Whether the shape is convex: a whisker then touches it in one place, except on a flat or with its concave side."""

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Attributes of the MJCF geoms (mm), in the frame of the shape."""
        raise NotImplementedError

    def local_outline_m(self) -> Array:
        """Vertices (n, 2) of the outline, counter-clockwise, not closed, within `CHORD_ERROR_M`."""
        raise NotImplementedError

    def local_support_m(self, direction: Array) -> Array:
        """The point (2,) of the outline that is farthest along `direction` (2,)."""
        raise NotImplementedError

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points (n, 2) of the outline and signed distances (n,), negative inside, for points (n, 2)."""
        raise NotImplementedError

    def chord_error_m(self) -> float:
        """Maximum distance between the polyline and the true outline; zero for polygons."""
        return CHORD_ERROR_M

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Attributes of the MJCF meshes that `geoms` refers to; none for most shapes."""
        return []

    def thickest_radius_m(self) -> float:
        """Radius of the largest circle inside the shape with its centre on a grid, which contains those of discs and rectangles."""
        vertices = self.local_outline_m()
        x_m, y_m = (np.linspace(low, high, _GRID) for low, high in zip(vertices.min(axis=0), vertices.max(axis=0), strict=True))
        _, distance_m = self.local_closest(np.stack(np.meshgrid(x_m, y_m), axis=-1).reshape(-1, 2))
        return float(np.max(-distance_m))

    def outline_m(self) -> Array:
        """Outline (n + 1, 2) in World, counter-clockwise, closed by repeating the first vertex."""
        vertices = self.to_world(self.local_outline_m())
        return np.concatenate((vertices, vertices[:1]))

    def support_m(self, direction: Array) -> Array:
        """The point (2,) of the outline, in World, that is farthest along `direction` (2,), in World."""
        return self.to_world(self.local_support_m(direction @ self._rotation()))

    def closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points (n, 2) of the outline and signed distances (n,), negative inside, for points (n, 2), all in World."""
        nearest_m, distance_m = self.local_closest((points_m - np.array(self.center_m)) @ self._rotation())
        return self.to_world(nearest_m), distance_m

    def to_world(self, points_m: Array) -> Array:
        """Transforms points (..., 2) from the frame of the shape to World."""
        return points_m @ self._rotation().T + np.array(self.center_m)

    def _rotation(self) -> Array:
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array(((cos, -sin), (sin, cos)))


def mjcf(*numbers: float) -> str:
    """Formats numbers as an MJCF attribute, without loss of precision."""
    return " ".join(repr(float(number)) for number in numbers)
