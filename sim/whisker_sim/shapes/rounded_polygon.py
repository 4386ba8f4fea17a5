"""Convex polygon with rounded corners."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.shapes.base import CHORD_ERROR_M, HALF_HEIGHT_MM, Array, Shape, mjcf
from whisker_sim.shapes.convex_polygon import ConvexPolygon
from whisker_sim.whisker import Coordinate, Dimension


class RoundedPolygon(Shape, frozen=True, forbid_unknown_fields=True, tag="rounded_polygon"):
    """Upright body of all points within `radius_m` of a convex polygon, vertices counter-clockwise."""

    vertices_m: Annotated[tuple[tuple[Coordinate, Coordinate], ...], msgspec.Meta(min_length=3, max_length=360)]
    radius_m: Dimension

    example: ClassVar[dict[str, Any]] = {**ConvexPolygon.example, "radius_m": 0.003}

    def __post_init__(self) -> None:
        self._core()

    def _core(self) -> ConvexPolygon:
        """The polygon; raises `ValueError` if it is not convex."""
        return ConvexPolygon(vertices_m=self.vertices_m)

    def _normals_rad(self) -> Array:
        """Directions (n,) of the outward normals of the edges, increasing; the i-th edge leads from vertex i to vertex i + 1."""
        edge = np.roll(self._core().vertices(), -1, axis=0) - self._core().vertices()
        return np.unwrap(np.arctan2(-edge[:, 0], edge[:, 1]))

    def geoms(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """A capsule at each vertex, and the prism over the edges moved outwards by the radius."""
        capsules = [
            {"type": "capsule", "pos": mjcf(1e3 * x, 1e3 * y, 0.0), "size": mjcf(1e3 * self.radius_m, half_height_mm)}
            for x, y in self.vertices_m
        ]
        return [*capsules, {"type": "mesh", "mesh": "prism"}]

    def meshes(self, half_height_mm: float = HALF_HEIGHT_MM) -> list[dict[str, str]]:
        """Vertices of the prism (mm): the ends of the moved edges."""
        angle, corners = self._normals_rad(), self._core().vertices()
        outward_m = self.radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        ends_mm = 1e3 * np.concatenate((corners + outward_m, np.roll(corners, -1, axis=0) + outward_m))
        prism = [mjcf(x, y, z) for z in (-half_height_mm, half_height_mm) for x, y in ends_mm]
        return [{"name": "prism", "vertex": " ".join(prism), "inertia": "convex"}]

    def local_outline_m(self) -> Array:
        """Arcs about the vertices between the normals of their edges; the sagitta r (1 - cos(step / 2)) is the chord error."""
        angle = self._normals_rad()
        before = np.concatenate((angle[-1:] - 2.0 * np.pi, angle[:-1]))
        longest_rad = 2.0 * np.arccos(1.0 - min(1.0, CHORD_ERROR_M / self.radius_m))
        pieces = []
        for vertex, start, end in zip(self._core().vertices(), before, angle, strict=True):
            steps = max(1, int(np.ceil((end - start) / longest_rad)))
            turn = np.linspace(start, end, steps + 1)
            pieces.append(vertex + self.radius_m * np.stack((np.cos(turn), np.sin(turn)), axis=-1))
        return np.concatenate(pieces)

    def local_support_m(self, direction: Array) -> Array:
        """End point of the radius along `direction` about the vertex that is farthest along it."""
        return self._core().local_support_m(direction) + self.radius_m * direction / np.hypot(*direction)

    def local_closest(self, points_m: Array) -> tuple[Array, Array]:
        """Nearest points and signed distances along the normal through the nearest point of the polygon, for points outside of it.

        Inside the polygon the nearest edge of the moved ones is that of the nearest edge, and the distance is larger by the radius.
        """
        nearest_m, distance_m = self._core().local_closest(points_m)
        away = (points_m - nearest_m) / np.where(distance_m == 0.0, 1.0, distance_m)[:, None]
        return nearest_m + self.radius_m * away, distance_m - self.radius_m
