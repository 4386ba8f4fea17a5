"""Ground truth: the whisker's centre line from the joint angles, and the point of it nearest to the object.

The centre line is the cubic Hermite curve through the middles of the links, where position and tangent of the chain are those of
the rod (see `model`). It is smooth where the chain has corners, and takes the place of the solver's contact points, which jump
from one capsule to the next.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Array, Whisker

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_TIP_M = 1e-6
"""A contact nearer to the end than this lies at the tip."""


@dataclass(frozen=True)
class CenterLine:
    """Centre lines at n instants, in World, through nodes at equal steps of arc length."""

    points_m: Array
    """Nodes (n, N + 1, 2)."""
    angles_rad: Array
    """Tangent angles (n, N + 1) at the nodes, continuous along the whisker and in time."""
    step_m: float

    @classmethod
    def from_joints(cls, whisker: Whisker, base_pose: Array, rotations_rad: Array) -> "CenterLine":
        """Builds centre lines from base poses (n, 3) and rotations (n, N + 1) of the root and the hinges."""
        nodes_m = np.arange(whisker.segments + 1) * whisker.segment_m
        hinges_m = nodes_m[:-1] + 0.5 * whisker.segment_m
        rest_points_m, rest_angles_rad = whisker.rest_point_m(nodes_m), whisker.rest_angle_rad(nodes_m)
        hinge_points_m = whisker.rest_point_m(hinges_m)
        # Rotation of each link against its undeflected direction; rest vectors turn by it.
        turn_rad = base_pose[:, 2:] + np.cumsum(rotations_rad, axis=1)
        pieces_m = _turned(hinge_points_m - rest_points_m[:-1], turn_rad[:, :-1]) + _turned(
            rest_points_m[1:] - hinge_points_m, turn_rad[:, 1:]
        )
        points_m = base_pose[:, None, :2] + np.concatenate((np.zeros((len(base_pose), 1, 2)), np.cumsum(pieces_m, axis=1)), axis=1)
        return cls(points_m, turn_rad + rest_angles_rad, whisker.segment_m)

    def at(self, arc_m: Array) -> tuple[Array, Array]:
        """Points (n, 2) and tangent angles (n,) at one arc length (n,) for each instant."""
        row = np.arange(len(arc_m))
        left = np.clip((arc_m / self.step_m).astype(int), 0, self.points_m.shape[1] - 2)
        u = arc_m / self.step_m - left
        p0, p1 = self.points_m[row, left], self.points_m[row, left + 1]
        a0, a1 = self.angles_rad[row, left], self.angles_rad[row, left + 1]
        t0 = self.step_m * np.stack((np.cos(a0), np.sin(a0)), axis=-1)
        t1 = self.step_m * np.stack((np.cos(a1), np.sin(a1)), axis=-1)
        u = u[:, None]
        chord = p1 - p0
        point = p0 + u * (t0 + u * (3.0 * chord - 2.0 * t0 - t1 + u * (t0 + t1 - 2.0 * chord)))
        slope = t0 + u * (2.0 * (3.0 * chord - 2.0 * t0 - t1) + 3.0 * u * (t0 + t1 - 2.0 * chord))
        # The angle is measured from the node's, so that it does not wrap.
        cos, sin = np.cos(a0), np.sin(a0)
        along, across = slope[:, 0] * cos + slope[:, 1] * sin, slope[:, 1] * cos - slope[:, 0] * sin
        return point, a0 + np.arctan2(across, along)


@dataclass(frozen=True)
class ContactTruth:
    """Where the whisker is nearest to the object, at n instants, in World."""

    contact_m: Array
    """Points (n, 2) on the centre line."""
    surface_m: Array
    """Points (n, 2) on the object's surface."""
    arc_m: Array
    tangent_rad: Array
    tip: NDArray[np.bool_]


def nearest_contact(line: CenterLine, shape: Shape) -> ContactTruth:
    """Finds the point of each centre line nearest to `shape`: the nearest node, then golden sections down to nanometres."""
    count, nodes, _ = line.points_m.shape
    _, distance_m = shape.closest(line.points_m.reshape(-1, 2))
    node = np.argmin(distance_m.reshape(count, nodes), axis=1)
    low = np.maximum(node - 1, 0) * line.step_m
    high = np.minimum(node + 1, nodes - 1) * line.step_m

    def distance_at(arc_m: Array) -> Array:
        return shape.closest(line.at(arc_m)[0])[1]

    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fa, fb = distance_at(a), distance_at(b)
    while np.max(high - low, initial=0.0) > 1e-9:
        left = fa < fb
        low, high = np.where(left, low, a), np.where(left, b, high)
        probe = np.where(left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value = distance_at(probe)
        a, b = np.where(left, probe, b), np.where(left, a, probe)
        fa, fb = np.where(left, value, fb), np.where(left, fa, value)
    arc_m = 0.5 * (low + high)
    contact_m, tangent_rad = line.at(arc_m)
    surface_m, _ = shape.closest(contact_m)
    return ContactTruth(contact_m, surface_m, arc_m, tangent_rad, arc_m > line.step_m * (nodes - 1) - _TIP_M)


def _turned(vectors_m: Array, angle_rad: Array) -> Array:
    """Vectors (N, 2) turned by the angles (n, N): (n, N, 2)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors_m[:, 0], vectors_m[:, 1]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
