"""Base class of the polygons, whose geometry follows from their vertices."""

import numpy as np

from whisker_sim.shapes.base import HALF_HEIGHT_MM, Array, Shape, mjcf


class Polygon(Shape, frozen=True, forbid_unknown_fields=True):
    """A convex polygon; subclasses define its vertices, counter-clockwise."""

    def vertices(self) -> Array:
        """Vertices (n, 2) in the shape's frame, counter-clockwise."""
        raise NotImplementedError

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """An upright prism, as a convex mesh."""
        return [{"type": "mesh", "mesh": "prism"}]

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Vertices of the prism (mm)."""
        corners_mm = 1e3 * self.vertices()
        prism = [mjcf(x, y, z) for z in (-half_height_mm, half_height_mm) for x, y in corners_mm]
        return [{"name": "prism", "vertex": " ".join(prism), "inertia": "convex"}]

    def chord_error_m(self) -> float:
        """Zero, because the polyline is the outline."""
        return 0.0

    def local_outline_m(self) -> Array:
        """The vertices."""
        return self.vertices()

    def local_support_m(self, direction: Array) -> Array:
        """The vertex that is farthest along `direction`."""
        vertices = self.vertices()
        return vertices[np.argmax(vertices @ direction)]

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest point over all edges; a point is inside if it is to the left of every edge."""
        x, y = points_m.T
        nearest_m, nearest_squared = np.empty_like(points_m), np.full(len(points_m), np.inf)
        inside = np.ones(len(points_m), dtype=bool)
        start = self.vertices()
        # One edge at a time: the arrays are then small and contiguous, which reduces the time to a fifth.
        for (start_x, start_y), (edge_x, edge_y) in zip(start, np.roll(start, -1, axis=0) - start, strict=True):
            to_x, to_y = x - start_x, y - start_y
            inside &= edge_x * to_y - edge_y * to_x > 0.0
            share = np.clip((to_x * edge_x + to_y * edge_y) / (edge_x**2 + edge_y**2), 0.0, 1.0)
            from_x, from_y = to_x - share * edge_x, to_y - share * edge_y
            squared = from_x**2 + from_y**2
            nearer = squared < nearest_squared
            np.copyto(nearest_squared, squared, where=nearer)
            np.copyto(nearest_m[:, 0], start_x + share * edge_x, where=nearer)
            np.copyto(nearest_m[:, 1], start_y + share * edge_y, where=nearer)
        return nearest_m, np.where(inside, -1.0, 1.0) * np.sqrt(nearest_squared)
