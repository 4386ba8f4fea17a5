"""Convex polyhedron: its checks, nearest points and features. Scenes name it by the file of a mesh (`mesh.py`)."""

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.base import CORNER, EDGE, FACE, Nearest, Oriented
from whisker_sim.whisker import Array

_ON_PLANE = 1e-5
"""Largest distance of a vertex from a plane that counts as on it, relative to the size of the mesh (files have six digits)."""
_FLAT = 1e-4
"""Largest sine of the angle between the normals of two triangles of one flat face."""
_ON_EDGE = 1e-9
SIZES_M = (1e-3, 2.0)
"""Smallest and largest extent of a mesh. Others are most likely given in another unit than the scene states."""
MOST_TRIANGLES = 5000


class Polyhedron(Oriented, frozen=True, forbid_unknown_fields=True, tag="polyhedron", kw_only=True):
    """Closed convex polyhedron of triangles, with vertices in its own frame."""

    vertices_m: tuple[tuple[float, float, float], ...]
    triangles: tuple[tuple[int, int, int], ...]
    """Indices of vertices, counter-clockwise as seen from outside."""

    def geoms(self) -> list[dict[str, str]]:
        """A convex mesh."""
        return [{"type": "mesh", "mesh": "polyhedron"}]

    def meshes(self) -> list[dict[str, str]]:
        """Its vertices (mm)."""
        vertices = " ".join(mjcf(*1e3 * np.array(vertex)) for vertex in self.vertices_m)
        return [{"name": "polyhedron", "vertex": vertices, "inertia": "convex"}]

    def local_closest(self, points_m: Array) -> Nearest:
        """Nearest points over all triangles; a point is inside if it is below every plane."""
        corners = np.array(self.vertices_m)[np.array(self.triangles)]
        normals = _normals(corners)
        inside = np.all((points_m @ normals.T - np.sum(corners[:, 0] * normals, axis=1)) < 0.0, axis=1)
        nearest_m, squared = np.zeros_like(points_m), np.full(len(points_m), np.inf)
        for triangle, normal in zip(corners, normals, strict=True):
            candidate_m = _onto_triangle(points_m, triangle, normal)
            apart = np.sum((points_m - candidate_m) ** 2, axis=1)
            nearer = apart < squared
            squared[nearer], nearest_m[nearer] = apart[nearer], candidate_m[nearer]
        distance_m = np.where(inside, -1.0, 1.0) * np.sqrt(squared)
        return Nearest(nearest_m, distance_m, self._features(nearest_m, corners, normals))

    def _features(self, points_m: Array, corners: Array, normals: Array) -> NDArray[np.intp]:
        """Features of points (n, 3) of the surface: by the number of differently inclined faces that contain them."""
        size_m = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        heights_m = points_m @ normals.T - np.sum(corners[:, 0] * normals, axis=1)
        on_plane = np.abs(heights_m) < _ON_EDGE * max(size_m, 1.0)
        feature = np.full(len(points_m), FACE)
        for row in np.flatnonzero(np.sum(on_plane, axis=1) > 1):
            around = normals[on_plane[row]]
            distinct = around[:1]
            for normal in around[1:]:
                if np.min(np.linalg.norm(distinct - normal, axis=1)) > _FLAT:
                    distinct = np.concatenate((distinct, normal[None]))
            feature[row] = (FACE, EDGE, CORNER)[min(len(distinct), 3) - 1]
        return feature

    def wireframe(self) -> list[Array]:
        """Edges between faces of different inclination."""
        vertices, triangles = np.array(self.vertices_m), np.array(self.triangles)
        normals = _normals(vertices[triangles])
        beside: dict[tuple[int, int], list[int]] = {}
        for index, triangle in enumerate(self.triangles):
            for a, b in zip(triangle, np.roll(triangle, -1).tolist(), strict=True):
                beside.setdefault((min(a, b), max(a, b)), []).append(index)
        sharp = [edge for edge, (a, b) in beside.items() if np.linalg.norm(np.cross(normals[a], normals[b])) > _FLAT]
        return [vertices[list(edge)] for edge in sharp]


def checked_polyhedron(vertices_m: Array, triangles: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """Vertices and triangles of a closed convex polyhedron with its surface outwards.

    Equal vertices are merged, and triangles without area left out. Raises `ValueError` if the size, the number of triangles, the
    closure or the convexity are not those of a solid that can be simulated.
    """
    if len(triangles) > MOST_TRIANGLES:
        raise ValueError(f"expected at most {MOST_TRIANGLES} triangles, found {len(triangles)}")
    if len(triangles) < 4:
        raise ValueError(f"expected a closed surface of at least 4 triangles, found {len(triangles)}")
    size_m = float(np.ptp(vertices_m, axis=0).max())
    if not SIZES_M[0] <= size_m <= SIZES_M[1]:
        raise ValueError(
            f"expected an extent of {SIZES_M[0]} to {SIZES_M[1]} m, found {size_m:.3g} m; "
            "`unit_m` states the length of the file's unit"
        )
    merged, index = np.unique(np.round(vertices_m / (_ON_PLANE * size_m)), axis=0, return_inverse=True)
    first = np.array([np.argmax(index.ravel() == number) for number in range(len(merged))])
    vertices_m, triangles = vertices_m[first], index.ravel()[triangles]
    different = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles = triangles[different]
    _check_closed(triangles)
    corners = vertices_m[triangles]
    volume_m3 = float(np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2]))) / 6.0
    if volume_m3 < 0.0:
        triangles, corners = triangles[:, ::-1], corners[:, ::-1]
    normals = _normals(corners)
    heights_m = vertices_m @ normals.T - np.sum(corners[:, 0] * normals, axis=1)
    highest = np.unravel_index(int(np.argmax(heights_m)), heights_m.shape)
    if heights_m[highest] > 10.0 * _ON_PLANE * size_m:
        raise ValueError(
            f"expected a convex surface, found a vertex {1e3 * heights_m[highest]:.3g} mm in front of triangle {highest[1] + 1}; "
            "its convex hull would be another solid"
        )
    return vertices_m, triangles


def _check_closed(triangles: NDArray[np.intp]) -> None:
    edges: dict[tuple[int, int], int] = {}
    for triangle in triangles.tolist():
        for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if (a, b) in edges:
                raise ValueError("expected triangles with one sense of rotation, found an edge used twice in one sense")
            edges[a, b] = 1
    open_edges = sum((b, a) not in edges for a, b in edges)
    if open_edges:
        raise ValueError(f"expected a closed surface, found {open_edges} edges of only one triangle")


def _normals(corners: Array) -> Array:
    """Unit normals (m, 3) of triangles (m, 3, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _onto_triangle(points_m: Array, triangle: Array, normal: Array) -> Array:
    """Nearest points (n, 3) of a triangle (3, 3): the foot of the perpendicular if it is within, else that on an edge."""
    foot_m = points_m - ((points_m - triangle[0]) @ normal)[:, None] * normal
    nearest_m, squared = foot_m.copy(), np.full(len(points_m), np.inf)
    within = np.ones(len(points_m), dtype=bool)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        along = triangle[b] - triangle[a]
        within &= (foot_m - triangle[a]) @ np.cross(normal, along) >= 0.0
        share = np.clip((points_m - triangle[a]) @ along / (along @ along), 0.0, 1.0)
        candidate_m = triangle[a] + share[:, None] * along
        apart = np.sum((points_m - candidate_m) ** 2, axis=1)
        nearer = apart < squared
        squared[nearer], nearest_m[nearer] = apart[nearer], candidate_m[nearer]
    return np.where(within[:, None], foot_m, nearest_m)
