"""Path of the tool between the objects, and its joint trajectory.

The tool passes the objects one after the other at a distance from their outlines, with one side towards them: the array on that
side is dragged along the outline while the other one is free.
"""

from math import ceil
from typing import Annotated, Literal

import msgspec
import numpy as np

from whisker_sim.arm import panda
from whisker_sim.arm.spline import Spline
from whisker_sim.arm.tool import TOOL
from whisker_sim.free_object import FreeObject
from whisker_sim.motions.base import REST_S, raised_cosine
from whisker_sim.shapes import Shape
from whisker_sim.whisker import Angle, Array, Length, Positive

_RAMP_S = 0.5
"""Duration of the acceleration and of the deceleration."""
_WAYPOINT_M = 0.012
"""Distance between the waypoints of a pass."""
_ANGLE_RAD = 1e-3
"""Angle between the directions at which the support points of an outline are sampled."""
_DISTINCT_M = 1e-7
"""Waypoints at a smaller distance coincide, at the junction of two passes."""
_DENSE_M = 1e-4
"""Distance between the points at which the length of the spline is measured."""
_KNOT_S = 0.02
"""Time between the poses of the tool for which the inverse kinematics is solved; joint angles are interpolated by a spline."""

_DAMPING = 1e-3
"""Damping of the inverse kinematics (m, rad): directions with smaller singular values hardly move the arm."""
_STEP_RAD = 0.2
"""Maximum rotation of a joint per iteration, which keeps the iteration within its region of convergence."""
_ITERATIONS = 100
_TOLERANCE = 1e-10
_ELBOW = 2
"""Index of the joint that remains at zero."""


class Pass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A path along an outline, between two directions of its normal in World.

    The tool turns its `side` to the object. If the direction increases, the whiskers trail; if it decreases, they point forward.
    """

    object: str
    side: Literal["left", "right"]
    from_rad: Angle
    to_rad: Angle
    distance_m: Annotated[float, msgspec.Meta(ge=1e-3, le=10.0)]
    """Distance of the tool's axis from the outline."""

    def __post_init__(self) -> None:
        if not abs(self.to_rad - self.from_rad) > _ANGLE_RAD:
            raise ValueError(
                f"to_rad: expected a direction more than {_ANGLE_RAD:g} rad from from_rad = {self.from_rad}, found {self.to_rad}"
            )

    def poses(self, shape: Shape) -> Array:
        """Poses (n, 3) of the tool in World along the pass, about `_WAYPOINT_M` apart: x, y (m), yaw (rad)."""
        angles = np.linspace(self.from_rad, self.to_rad, 2 + int(abs(self.to_rad - self.from_rad) / _ANGLE_RAD))
        normals = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        points_m = np.array([shape.support_m(normal) for normal in normals]) + self.distance_m * normals
        yaw_rad = angles + (0.5 if self.side == "left" else -0.5) * np.pi
        way_m = _path_length_m(points_m)
        at_m = np.linspace(0.0, way_m[-1], 1 + max(1, round(way_m[-1] / _WAYPOINT_M)))
        return np.stack([np.interp(at_m, way_m, values) for values in (*points_m.T, yaw_rad)], axis=-1)


class Passage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Path of the tool: strokes from rest to rest, each a sequence of passes joined by a spline.

    A stroke begins and ends with a straight lead, on which the tool approaches the first object and leaves the last one. Between
    strokes the tool moves straight.
    """

    strokes: Annotated[tuple[Annotated[tuple[Pass, ...], msgspec.Meta(min_length=1)], ...], msgspec.Meta(min_length=1)]
    height_m: Length
    """Height of the middle whiskers above the table."""
    speed_m_s: Positive = 0.04
    lead_m: Length = 0.07
    """Length of the straight lead at either end of a stroke."""

    def poses(self, objects: dict[str, FreeObject], longest_s: float) -> tuple[Array, Array]:
        """Times (n,), `_KNOT_S` apart, and poses (n, 3) of the tool in World: x, y (m), yaw (rad). It rests for the first `REST_S`.

        Raises `ValueError` if a pass names an unknown object, or the path takes more than `longest_s`.
        """
        strokes = [self._waypoints(stroke, objects) for stroke in self.strokes]
        legs = [strokes[0]]
        for stroke in strokes[1:]:
            stroke[:, 2] -= 2.0 * np.pi * np.round((stroke[0, 2] - legs[-1][-1, 2]) / (2.0 * np.pi))
            between = _distinct(np.stack((legs[-1][-1], stroke[0])))
            legs += [between, stroke] if len(between) > 1 else [stroke]
        poses, left_s = [np.repeat(strokes[0][:1], 1 + ceil(REST_S / _KNOT_S), axis=0)], longest_s - REST_S
        for leg in legs:
            poses.append(self._moved_along(leg, left_s))
            left_s -= _KNOT_S * len(poses[-1])
        poses = np.concatenate(poses)
        return _KNOT_S * np.arange(len(poses)), poses

    def _waypoints(self, stroke: tuple[Pass, ...], objects: dict[str, FreeObject]) -> Array:
        """Poses (n, 3) through which a stroke leads."""
        poses = []
        for one in stroke:
            if one.object not in objects:
                raise ValueError(f"path.strokes: expected passes of {', '.join(objects)}, found one of '{one.object}'")
            poses.append(one.poses(objects[one.object].object))
        poses = _distinct(np.concatenate(poses))
        poses[:, 2] = np.unwrap(poses[:, 2])
        shares = np.linspace(0.0, 1.0, 1 + max(1, round(self.lead_m / _WAYPOINT_M)))[1:, None]
        leads = []
        for end, inner in ((poses[0], poses[1]), (poses[-1], poses[-2])):
            away = (end - inner)[:2] / np.hypot(*(end - inner)[:2])
            leads.append(end + shares * np.append(self.lead_m * away, 0.0))
        return _distinct(np.concatenate((leads[0][::-1], poses, leads[1])))

    def _moved_along(self, waypoints: Array, longest_s: float) -> Array:
        """Poses (n, 3), `_KNOT_S` apart, along the path through `waypoints` (m, 3) from rest to rest, within `longest_s`."""
        knots = _path_length_m(waypoints)
        spline = Spline(knots, waypoints)
        dense = np.linspace(0.0, knots[-1], 2 + int(knots[-1] / _DENSE_M))
        way_m = _path_length_m(spline(dense))
        # Each ramp covers half of the distance at full speed; a short path is passed at a lower speed.
        speed_m_s = min(self.speed_m_s, way_m[-1] / _RAMP_S)
        if way_m[-1] > speed_m_s * (longest_s - _RAMP_S):
            raise ValueError(
                f"path.speed_m_s: expected {way_m[-1]:.3g} m to take no more than the {longest_s:.4g} s that are left of the "
                f"longest plan, found {speed_m_s:.3g} m/s"
            )
        duration_s = way_m[-1] / speed_m_s + _RAMP_S
        time_s = _KNOT_S * np.arange(1, 1 + ceil(duration_s / _KNOT_S))
        passed_m = speed_m_s * (_ramp_s(time_s) - _ramp_s(time_s - duration_s + _RAMP_S))
        return spline(np.interp(passed_m, way_m, dense))


def _ramp_s(time_s: Array) -> Array:
    """Time integral of a speed that increases to one within `_RAMP_S` as a raised cosine."""
    return _RAMP_S * raised_cosine(0.5 * np.clip(time_s / _RAMP_S, 0.0, 1.0)) + np.maximum(time_s - _RAMP_S, 0.0)


def joint_trajectory(base: Array, height_m: float, time_s: Array, poses: Array) -> Spline:
    """Joint angles over time that move the tool through `poses` (n, 3) at `time_s` (n,).

    `base` (4, 4) is the pose of the arm's base in World. The redundant degree of freedom keeps the third joint at zero, so that the
    elbow remains in the vertical plane through shoulder and wrist.

    Raises `ValueError` if a pose is out of reach, or a limit of a joint's angle or speed is exceeded.
    """
    into_base = np.linalg.inv(base)
    q_rad, angles_rad = panda.READY_RAD, []
    for at_s, (x_m, y_m, yaw_rad) in zip(time_s, poses, strict=True):
        target = into_base @ panda.translation((x_m, y_m, height_m)) @ panda.rotation_z(yaw_rad)
        q_rad, place = _solve(target, q_rad), f"at ({x_m:.3f}, {y_m:.3f}) m, at {at_s:.2f} s"
        if q_rad is None:
            raise ValueError(f"path: expected a way within the arm's reach, found none to the tool's place {place}")
        if np.any(beyond := (q_rad < panda.LOWER_RAD) | (q_rad > panda.UPPER_RAD)):
            joint = int(np.argmax(beyond))
            raise ValueError(
                f"path: expected joint {joint + 1} between {panda.LOWER_RAD[joint]} and {panda.UPPER_RAD[joint]} rad, "
                f"found {q_rad[joint]:.4f} rad with the tool {place}"
            )
        angles_rad.append(q_rad)
    trajectory = Spline(time_s, np.array(angles_rad))
    speed_rad_s = np.max(np.abs(trajectory.slope(time_s)), axis=0)
    if np.any(speed_rad_s > panda.SPEED_RAD_S):
        joint = int(np.argmax(speed_rad_s / panda.SPEED_RAD_S))
        raise ValueError(
            f"path.speed_m_s: expected joint {joint + 1} to turn by at most {panda.SPEED_RAD_S[joint]} rad/s, "
            f"found {speed_rad_s[joint]:.3g} rad/s"
        )
    return trajectory


def _solve(target: Array, q_rad: Array) -> Array | None:
    """Joint angles (7,) near `q_rad` with the tool at `target`, regardless of limits; `None` if there are none.

    Damped least squares (C. W. Wampler, "Manipulator inverse kinematic solutions based on vector formulations and damped
    least-squares methods", IEEE Trans. SMC 16(1), 1986).
    """
    for _ in range(_ITERATIONS):
        pose = panda.tool_pose(q_rad, TOOL)
        back = pose[:3, :3].T
        turn = back @ target[:3, :3]
        # The skew-symmetric part of a small rotation is its rotation vector.
        turn_rad = 0.5 * np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]))
        miss = np.concatenate((back @ (target[:3, 3] - pose[:3, 3]), turn_rad, [-q_rad[_ELBOW]]))
        if np.max(np.abs(miss)) < _TOLERANCE:
            return q_rad
        task = np.vstack((panda.body_jacobian(q_rad, TOOL), np.eye(panda.JOINTS)[_ELBOW]))
        step_rad = task.T @ np.linalg.solve(task @ task.T + _DAMPING**2 * np.eye(len(task)), miss)
        q_rad = q_rad + step_rad * min(1.0, _STEP_RAD / np.max(np.abs(step_rad)))
    return None


def displaced(q_rad: Array, displacement_m: Array, yaw_rad: Array) -> Array:
    """Joint angles (n, 7) with the tool displaced by `displacement_m` (n, 2) along x and y of World, to first order.

    `yaw_rad` (n,) is that of the tool. The solution has the minimum norm of the joint displacements.
    """
    jacobian = panda.body_jacobian(q_rad, TOOL)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x_m, y_m = displacement_m.T
    wanted = np.zeros((len(q_rad), 6, 1))
    wanted[:, 0, 0], wanted[:, 1, 0] = cos * x_m + sin * y_m, cos * y_m - sin * x_m
    back = jacobian.swapaxes(-1, -2)
    return q_rad + (back @ np.linalg.solve(jacobian @ back, wanted))[..., 0]


def _distinct(poses: Array) -> Array:
    """The poses (n, 3) whose positions differ from the preceding one."""
    return poses[np.append(True, np.hypot(*np.diff(poses[:, :2], axis=0).T) > _DISTINCT_M)]


def _path_length_m(poses: Array) -> Array:
    """Path length (n,) in the plane along the polyline through `poses` (n, 2 or 3), from its start to each pose."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
