"""Base class of polygons that are not convex: unions of convex parts."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes.base import HALF_HEIGHT_MM, Array, mjcf
from whisker_sim.shapes.polygon import Polygon


class HollowPolygon(Polygon, frozen=True, forbid_unknown_fields=True):
    """A polygon without holes; subclasses define its vertices, counter-clockwise, and convex polygons whose union it is.

    MuJoCo collides convex meshes only, one of each part. Parts may overlap.
    """

    convex: ClassVar[bool] = False

    def parts(self) -> list[Array]:
        """Vertices (n, 2) of each convex part in the shape's frame."""
        raise NotImplementedError

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """An upright prism over each part, as a convex mesh."""
        return [{"type": "mesh", "mesh": f"prism_{index}"} for index in range(len(self.parts()))]

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Vertices of the prisms (mm)."""
        return [
            {"name": f"prism_{index}", "vertex": _prism(1e3 * part, half_height_mm), "inertia": "convex"}
            for index, part in enumerate(self.parts())
        ]

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest point over all edges; a point is inside if a ray along +x crosses the outline an odd number of times."""
        nearest_m, distance_m = super().local_closest(points_m)
        return nearest_m, np.where(self._contains(points_m), -1.0, 1.0) * np.abs(distance_m)

    def _contains(self, points_m: Array) -> NDArray[np.bool_]:
        """Whether the points (n, 2) are inside (n,)."""
        x, y = points_m.T
        inside = np.zeros(len(points_m), dtype=bool)
        start = self.vertices()
        for (start_x, start_y), (end_x, end_y) in zip(start, np.roll(start, -1, axis=0), strict=True):
            if start_y == end_y:
                continue
            crosses = (start_y > y) != (end_y > y)
            inside ^= crosses & (x < start_x + (y - start_y) / (end_y - start_y) * (end_x - start_x))
        return inside


def rectangle(left_m: float, bottom_m: float, right_m: float, top_m: float) -> Array:
    """Vertices (4, 2) of an upright rectangle, counter-clockwise."""
    return np.array(((left_m, bottom_m), (right_m, bottom_m), (right_m, top_m), (left_m, top_m)))


def _prism(corners_mm: Array, half_height_mm: float) -> str:
    return " ".join(mjcf(x, y, z) for z in (-half_height_mm, half_height_mm) for x, y in corners_mm)
