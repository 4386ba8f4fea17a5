"""Box."""

from itertools import product
from typing import Any, ClassVar

import numpy as np

from whisker_sim.shapes.base import mjcf
from whisker_sim.space.solids.base import Nearest, Oriented
from whisker_sim.whisker import Array, Dimension


class Box(Oriented, frozen=True, forbid_unknown_fields=True, tag="box"):
    """Box with the edge lengths `size_m` along the axes of its frame."""

    size_m: tuple[Dimension, Dimension, Dimension]

    example: ClassVar[dict[str, Any]] = {"size_m": (0.03, 0.02, 0.05), "orientation": (0.8, 0.0, 0.6, 0.0)}

    def geoms(self) -> list[dict[str, str]]:
        """A convex mesh: MuJoCo's closed form for capsules and boxes turns the force on an edge by up to a degree."""
        return [{"type": "mesh", "mesh": "box"}]

    def meshes(self) -> list[dict[str, str]]:
        """The eight corners (mm)."""
        half_mm = 500.0 * np.array(self.size_m)
        corners = [mjcf(*half_mm * np.array(signs)) for signs in product((-1.0, 1.0), repeat=3)]
        return [{"name": "box", "vertex": " ".join(corners), "inertia": "convex"}]

    def local_closest(self, points_m: Array) -> Nearest:
        """Each coordinate is limited to the box; from inside, the nearest face is taken."""
        half_m = 0.5 * np.array(self.size_m)
        limited = np.clip(points_m, -half_m, half_m)
        outside = np.any(np.abs(points_m) > half_m, axis=1)
        depth_m = half_m - np.abs(points_m)
        axis = np.argmin(depth_m, axis=1)
        rows = np.arange(len(points_m))
        onto = points_m.copy()
        onto[rows, axis] = np.where(points_m[rows, axis] < 0.0, -half_m[axis], half_m[axis])
        distance_m = np.where(outside, np.linalg.norm(points_m - limited, axis=1), -depth_m[rows, axis])
        feature = np.where(outside, np.maximum(np.sum(np.abs(points_m) > half_m, axis=1), 1) - 1, 0)
        return Nearest(np.where(outside[:, None], limited, onto), distance_m, feature)

    def wireframe(self) -> list[Array]:
        """The twelve edges."""
        half_m = 0.5 * np.array(self.size_m)
        edges = []
        for axis in range(3):
            for signs in product((-1.0, 1.0), repeat=2):
                ends = np.array([np.insert(signs, axis, end) for end in (-1.0, 1.0)])
                edges.append(ends * half_m)
        return edges
