"""Interface of solids: MuJoCo geometry, nearest point, signed distance, feature and normal.

A solid has its own frame, which `center_m` and its rotation place in World. A new solid subclasses `Solid`, or `Axial` if it has an
axis of revolution, implements its abstract methods in its own frame, and is added to the registry.
"""

from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.space.rotation import Quaternion, Vector, checked_direction, checked_quaternion, matrix_of, unit
from whisker_sim.whisker import Array, Coordinate

FACE, EDGE, CORNER = 0, 1, 2
"""Features of a surface: smooth, a line where two smooth parts meet, a point where several lines meet."""


class Nearest(NamedTuple):
    """Points of a surface that are nearest to n points."""

    point_m: Array
    """(n, 3)."""
    distance_m: Array
    """Signed distances (n,), negative inside."""
    feature: NDArray[np.intp]
    """Features (n,) on which the points lie."""


class Solid(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="shape", kw_only=True):
    """A body at rest, placed in World."""

    center_m: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)

    example: ClassVar[dict[str, Any]]
    """Parameters used by the tests of the registry."""

    @property
    def rotation(self) -> Array:
        """Rotation (3, 3) from the frame of the solid to World."""
        return np.eye(3)

    @property
    def sharpest_radius_m(self) -> float:
        """Smallest radius of curvature at which a whisker is expected to touch; zero for edges."""
        return 0.0

    def placed(self, folder: Path) -> "Solid":
        """The solid with the content of its files, whose names are relative to `folder`; itself if it has none.

        Raises `ValueError` if a file is not what it should be.
        """
        return self

    def geoms(self) -> list[dict[str, str]]:
        """Attributes of the MJCF geoms (mm), in the frame of the solid."""
        raise NotImplementedError

    def meshes(self) -> list[dict[str, str]]:
        """Attributes of the MJCF meshes that `geoms` refers to; none for most solids."""
        return []

    def local_closest(self, points_m: Array) -> Nearest:
        """Nearest points of the surface to points (n, 3), in the frame of the solid."""
        raise NotImplementedError

    def wireframe(self) -> list[Array]:
        """Curves (k, 3) of the surface in the frame of the solid, by which pictures show it."""
        raise NotImplementedError

    def thickest_radius_m(self) -> float:
        """Largest distance from the surface of some points inside the solid, which is exact for round solids and boxes."""
        middle_m = np.concatenate(self.wireframe()).mean(axis=0)
        return max(self.sharpest_radius_m, float(np.max(-self.local_closest(np.stack((np.zeros(3), middle_m))).distance_m)))

    def closest(self, points_m: Array) -> Nearest:
        """Nearest points of the surface to points (n, 3), all in World."""
        rotation, center_m = self.rotation, np.array(self.center_m)
        point_m, distance_m, feature = self.local_closest((points_m - center_m) @ rotation)
        return Nearest(point_m @ rotation.T + center_m, distance_m, feature)

    def curves_m(self) -> list[Array]:
        """Curves (k, 3) of the surface in World."""
        return [curve @ self.rotation.T + np.array(self.center_m) for curve in self.wireframe()]


class Oriented(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A solid whose frame is turned by a unit quaternion (w, x, y, z)."""

    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        checked_quaternion("orientation", self.orientation)

    @property
    def rotation(self) -> Array:
        """Rotation (3, 3) from the frame of the solid to World."""
        return matrix_of(self.orientation)


class Axial(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A solid of revolution about the z axis of its frame, which has the direction `axis` in World."""

    axis: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        checked_direction("axis", self.axis)

    @property
    def rotation(self) -> Array:
        """The smallest rotation (3, 3) of the z axis into `axis`; by half a turn about x for the opposite direction."""
        x, y, z = unit(self.axis)
        if z < -1.0 + 1e-12:
            return np.diag((1.0, -1.0, -1.0))
        # With a = (x, y): I + K + K^2 / (1 + z) for the skew matrix K of the axis of rotation z x a.
        return np.array(
            (
                (1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), x),
                (-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), y),
                (-x, -y, z),
            )
        )


def circle(radius_m: float, height_m: float = 0.0, count: int = 72) -> Array:
    """A closed circle (count + 1, 3) about the z axis."""
    angle = 2.0 * np.pi * np.arange(count + 1) / count
    return np.stack((radius_m * np.cos(angle), radius_m * np.sin(angle), np.full_like(angle, height_m)), axis=-1)


def outward(vectors: Array, lengths: Array) -> Array:
    """Vectors (n, k) divided by their lengths (n,); along the first axis where the length is zero."""
    first = np.zeros(vectors.shape[1])
    first[0] = 1.0
    return np.where(lengths[:, None] > 0.0, vectors / np.maximum(lengths, 1e-300)[:, None], first)
