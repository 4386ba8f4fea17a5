"""Geometry that the polygons share: all of it follows from the vertices."""

import numpy as np

from whisker_sim.shapes.base import HALF_HEIGHT_MM, Array, Shape, mjcf


class Polygon(Shape, frozen=True, forbid_unknown_fields=True):
    """A convex polygon; a subclass gives its vertices, counter-clockwise."""

    def vertices(self) -> Array:
        """Vertices (n, 2) in the shape's frame, counter-clockwise."""
        raise NotImplementedError

    def geoms(self) -> list[dict[str, str]]:
        """An upright prism, as a convex mesh."""
        return [{"type": "mesh", "mesh": "prism"}]

    def meshes(self) -> list[dict[str, str]]:
        """The prism's vertices, in millimetres."""
        corners_mm = 1e3 * self.vertices()
        prism = [mjcf(x, y, z) for z in (-HALF_HEIGHT_MM, HALF_HEIGHT_MM) for x, y in corners_mm]
        return [{"name": "prism", "vertex": " ".join(prism), "inertia": "convex"}]

    def chord_error_m(self) -> float:
        """Zero: the polyline is the outline."""
        return 0.0

    def local_outline_m(self) -> Array:
        """The vertices."""
        return self.vertices()

    def local_support_m(self, direction: Array) -> Array:
        """The vertex farthest along `direction`."""
        vertices = self.vertices()
        return vertices[np.argmax(vertices @ direction)]

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest point over all edges; a point is inside where it lies to the left of every edge."""
        start = self.vertices()
        edge = np.roll(start, -1, axis=0) - start
        offset = points_m[:, None, :] - start
        share = np.clip(np.sum(offset * edge, axis=-1) / np.sum(edge * edge, axis=-1), 0.0, 1.0)
        foot = start + share[..., None] * edge
        distance_m = np.hypot(points_m[:, None, 0] - foot[..., 0], points_m[:, None, 1] - foot[..., 1])
        nearest = np.argmin(distance_m, axis=1)
        row = np.arange(len(points_m))
        inside = np.all(edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] > 0.0, axis=1)
        return foot[row, nearest], np.where(inside, -1.0, 1.0) * distance_m[row, nearest]
