"""Ground truth in space: the centre line that follows from the joint angles, and its contact with the solid.

As in the plane (`whisker_sim.truth`), the centre line is the cubic Hermite curve through the middles of the links, and the contact
is at the minimum of the clearance dist(P(s)) - r(s), where t . n - r' vanishes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from whisker_sim.space.rotation import about, unit
from whisker_sim.space.solids import Solid
from whisker_sim.space.whisker import ROOT_ORDER, SpatialWhisker, hinge_order
from whisker_sim.truth import TIP_M, zero_of_slope
from whisker_sim.whisker import Array

_POINTS_AT_ONCE = 20_000


@dataclass(frozen=True)
class CenterCurve:
    """Centre lines at n instants, in World, through nodes at equal steps of arc length."""

    points_m: Array
    """Nodes (n, N + 1, 3)."""
    tangents: Array
    """Unit tangents (n, N + 1, 3) at the nodes."""
    step_m: float
    radius_slope: float
    """Derivative of the whisker's radius with respect to arc length."""

    @classmethod
    def from_joints(cls, whisker: SpatialWhisker, position_m: Array, rotation: Array, joints_rad: Array) -> "CenterCurve":
        """Centre lines for positions (n, 3) and rotations (n, 3, 3) of the base and joint angles (n, 3 N + 3)."""
        nodes_m, frames = whisker.rest_point_m(whisker.node_arcs_m), whisker.rest_frame(whisker.node_arcs_m)
        hinges_m, hinge_frames = whisker.rest_point_m(whisker.hinge_arcs_m), whisker.rest_frame(whisker.hinge_arcs_m)
        angles = joints_rad.reshape(len(joints_rad), -1, 3)
        links = whisker.whisker.segments
        points_m, tangents = np.empty((len(angles), links + 1, 3)), np.empty((len(angles), links + 1, 3))
        link = rotation @ _joined(angles[:, 0], ROOT_ORDER)
        points_m[:, 0], tangents[:, 0] = position_m, link[:, :, 0]
        for hinge in range(links):
            place_m = points_m[:, hinge] + link @ (frames[hinge].T @ (hinges_m[hinge] - nodes_m[hinge]))
            at_hinge = link @ (frames[hinge].T @ hinge_frames[hinge])
            link = at_hinge @ _joined(angles[:, hinge + 1], hinge_order(hinge)) @ (hinge_frames[hinge].T @ frames[hinge + 1])
            points_m[:, hinge + 1] = place_m + link @ (frames[hinge + 1].T @ (nodes_m[hinge + 1] - hinges_m[hinge]))
            tangents[:, hinge + 1] = link[:, :, 0]
        return cls(points_m, tangents, whisker.whisker.segment_m, whisker.whisker.radius_slope)

    def at(self, arc_m: Array, rows: NDArray[np.intp] | None = None) -> tuple[Array, Array]:
        """Points and unit tangents (k, 3) at the arc lengths `arc_m` (k,) and instants `rows` (k,), by default all."""
        row = np.arange(len(arc_m)) if rows is None else rows
        left = np.clip((arc_m / self.step_m).astype(int), 0, self.points_m.shape[1] - 2)
        u = (arc_m / self.step_m - left)[:, None]
        p0, p1 = self.points_m[row, left], self.points_m[row, left + 1]
        t0, t1 = self.step_m * self.tangents[row, left], self.step_m * self.tangents[row, left + 1]
        chord = p1 - p0
        point = p0 + u * (t0 + u * (3.0 * chord - 2.0 * t0 - t1 + u * (t0 + t1 - 2.0 * chord)))
        slope = t0 + u * (2.0 * (3.0 * chord - 2.0 * t0 - t1) + 3.0 * u * (t0 + t1 - 2.0 * chord))
        return point, unit(slope)


def _joined(angles_rad: Array, order: tuple[int, int, int]) -> Array:
    """Rotations (n, 3, 3) of three joints in series with the angles (n, 3)."""
    first, second, third = (about(axis, angles_rad[:, index]) for index, axis in enumerate(order))
    return first @ second @ third


@dataclass(frozen=True)
class SpatialContactTruth:
    """Points at which the surface of the whisker is nearest to the solid at n instants, in World."""

    contact_m: Array
    """Points (n, 3) on the centre line."""
    surface_m: Array
    """Points (n, 3) on the surface of the solid."""
    normal: Array
    """Unit normals (n, 3) of the contact, out of the solid: from the surface point to the contact."""
    arc_m: Array
    tangent: Array
    """Unit tangents (n, 3) of the centre line, towards the tip."""
    feature: NDArray[np.intp]
    """Features (n,) of the solid, by their numbers in `solids.base`."""
    tip: NDArray[np.bool_]


def nearest_contact(line: CenterCurve, solid: Solid) -> SpatialContactTruth:
    """Finds the point of each centre line at which the surface of the whisker is nearest to `solid`.

    The zero of the derivative of the clearance is sought between the neighbours of the nearest node.
    """
    count, nodes, _ = line.points_m.shape
    distance_m = distances_m(solid, line.points_m.reshape(-1, 3)).reshape(count, nodes)
    node = np.argmin(distance_m - line.radius_slope * line.step_m * np.arange(nodes), axis=1)
    low, high = np.maximum(node - 1, 0) * line.step_m, np.minimum(node + 1, nodes - 1) * line.step_m

    def slope_at(rows: NDArray[np.intp], arc_m: Array) -> Array:
        point_m, tangent = line.at(arc_m, rows)
        nearest = solid.closest(point_m)
        away = (point_m - nearest.point_m) / nearest.distance_m[:, None]
        return np.sum(away * tangent, axis=1) - line.radius_slope

    arc_m = zero_of_slope(slope_at, node * line.step_m, low, high)
    contact_m, tangent = line.at(arc_m)
    nearest = solid.closest(contact_m)
    normal = (contact_m - nearest.point_m) / nearest.distance_m[:, None]
    tip = arc_m > line.step_m * (nodes - 1) - TIP_M
    return SpatialContactTruth(contact_m, nearest.point_m, normal, arc_m, tangent, nearest.feature, tip)


def distances_m(solid: Solid, points_m: Array) -> Array:
    """Signed distances (n,) of points (n, 3) from the solid, in portions that fit into memory."""
    portions = [points_m[start : start + _POINTS_AT_ONCE] for start in range(0, len(points_m), _POINTS_AT_ONCE)]
    return np.concatenate([solid.closest(portion).distance_m for portion in portions])


def root_moment_n_m(whisker: SpatialWhisker, root_rad: Array) -> Array:
    """Moments (n, 3) in Base that the springs of the root carry at the angles (n, 3): yaw, pitch, twist.

    The components of the moment along the axes of the springs, which the earlier angles of the series have turned, are stiffness
    times angle.
    """
    yaw = about(2, root_rad[:, 0])
    pitched = yaw @ about(1, root_rad[:, 1])
    axes = np.stack((np.broadcast_to((0.0, 0.0, 1.0), yaw[:, 2].shape), yaw[:, :, 1], pitched[:, :, 0]), axis=1)
    stiffness = whisker.root_stiffness_n_m_rad[list(ROOT_ORDER)]
    return np.linalg.solve(axes, (stiffness * root_rad)[:, :, None])[:, :, 0]


def root_frame(root_rad: Array) -> Array:
    """Rotations (n, 3, 3) of the turned root relative to Base."""
    return _joined(root_rad, ROOT_ORDER)
