"""Base class of the solids that a convex polygon describes by its revolution: cylinder and cone."""

from itertools import pairwise

import numpy as np

from whisker_sim.space.solids.base import CORNER, EDGE, FACE, Axial, Nearest, circle
from whisker_sim.whisker import Array

_ON_VERTEX_M = 1e-9
"""A nearest point within this distance of a vertex of the profile lies on the rim."""


class Turned(Axial, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A solid of revolution; subclasses define its profile."""

    def profile(self) -> Array:
        """Vertices (k, 2) of the profile from the lower to the upper end: distance from the axis, and height."""
        raise NotImplementedError

    def local_closest(self, points_m: Array) -> Nearest:
        """Nearest points over all pieces of the profile, in the half-plane of each point."""
        profile = self.profile()
        distance_m, height_m = np.hypot(points_m[:, 0], points_m[:, 1]), points_m[:, 2]
        nearest_m, squared = np.zeros((len(points_m), 2)), np.full(len(points_m), np.inf)
        inside = np.ones(len(points_m), dtype=bool)
        at = np.stack((distance_m, height_m), axis=-1)
        for start, end in pairwise(profile):
            along, to = end - start, at - start
            inside &= along[0] * to[:, 1] - along[1] * to[:, 0] > 0.0
            share = np.clip(to @ along / (along @ along), 0.0, 1.0)
            candidate_m = start + share[:, None] * along
            apart = np.sum((at - candidate_m) ** 2, axis=1)
            nearer = apart < squared
            squared[nearer], nearest_m[nearer] = apart[nearer], candidate_m[nearer]
        feature = np.full(len(points_m), FACE)
        for vertex in profile[1:-1]:
            feature[np.linalg.norm(nearest_m - vertex, axis=1) < _ON_VERTEX_M] = EDGE
        for vertex in self.apexes():
            feature[np.linalg.norm(nearest_m - vertex, axis=1) < _ON_VERTEX_M] = CORNER
        direction = np.where(distance_m[:, None] > 0.0, points_m[:, :2] / np.maximum(distance_m, 1e-300)[:, None], (1.0, 0.0))
        point_m = np.concatenate((nearest_m[:, :1] * direction, nearest_m[:, 1:]), axis=1)
        return Nearest(point_m, np.where(inside, -1.0, 1.0) * np.sqrt(squared), feature)

    def apexes(self) -> list[Array]:
        """Vertices of the profile on the axis that are corners of the solid."""
        return []

    def wireframe(self) -> list[Array]:
        """Rims, circles between them, and eight lines along the profile."""
        profile = self.profile()
        shares = np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(profile)])
        angles = np.arange(8) * np.pi / 4.0
        lines = [np.stack((np.cos(a) * profile[:, 0], np.sin(a) * profile[:, 0], profile[:, 1]), axis=-1) for a in angles]
        return [*lines, *(circle(float(r), float(z)) for r, z in shares if r > 0.0)]
