"""What every motion gives, and what it may know: a plan of the base's pose, made from the undeflected geometry.

The base is placed by the *gap*: the distance between the undeflected whisker's surface and the object, along the whisker's
normal on the object's side; negative where the object has pushed the whisker aside.
"""

from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Whisker

Array = NDArray[np.float64]

REST_S = 0.15
"""Time for which the base stands still, and the whisker is free, at the start of every trace."""

TOUCH_GAP_M = 0.05e-3
"""Gap to which a trial's approach is quick. From there it starts anew from rest, so that the first touch is a gentle one."""


MAX_STEPS = 10_000_000
"""Longest plan: beyond it a scene is rather a slip of the pen, and would not fit into memory."""


class Stage(msgspec.Struct, frozen=True):
    """Where a motion takes place."""

    whisker: Whisker
    shape: Shape
    face: int
    """+1 where the object lies on the whisker's left, -1 on its right."""
    timestep_s: float
    duration_s: float | None
    rng: np.random.Generator

    def base_pose(self, arc_m: float, gap_m: float, yaw_rad: float = 0.0) -> Array:
        """Pose (x, y, yaw) of the base in World at which the undeflected whisker faces the object at `arc_m` with `gap_m`."""
        tangent_rad = yaw_rad + float(self.whisker.rest_angle_rad(arc_m))
        normal = self.face * np.array((-np.sin(tangent_rad), np.cos(tangent_rad)))
        point_m = self.shape.support_m(-normal) - (gap_m + float(self.whisker.radius_m(arc_m))) * normal
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        rest = self.whisker.rest_point_m(arc_m)
        return np.array((point_m[0] - cos * rest[0] + sin * rest[1], point_m[1] - sin * rest[0] - cos * rest[1], yaw_rad))

    def rest_gap_m(self, poses: Array) -> Array:
        """Gap (n,) between the undeflected whisker and the object for base poses (n, 3).

        Each vertex of the outline is dropped on the nearest of a dense set of points of the whisker, along that point's normal.
        """
        arc_m = np.linspace(0.0, self.whisker.length_m, 161)
        curve = self.whisker.rest_point_m(arc_m)
        angle = self.whisker.rest_angle_rad(arc_m)
        normal = self.face * np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
        curve_squared, twice_curve = np.sum(curve**2, axis=1), 2.0 * curve.T
        outline = self.shape.outline_m()[:-1]
        gap_m = np.empty(len(poses))
        for index, (x, y, yaw) in enumerate(poses):
            cos, sin = np.cos(yaw), np.sin(yaw)
            local = (outline - (x, y)) @ np.array(((cos, -sin), (sin, cos)))
            # Squared distances but for what is the same for every point of the curve.
            nearest = np.argmin(curve_squared - local @ twice_curve, axis=1)
            height = np.sum((local - curve[nearest]) * normal[nearest], axis=1) - self.whisker.radius_m(arc_m[nearest])
            gap_m[index] = np.min(height)
        return gap_m


class Plan(msgspec.Struct, frozen=True):
    """A motion, planned: the commanded pose at every step and what it promises about the contact."""

    poses: Array
    """Poses (n + 1, 3) of the base in World, one a time step, the first at time zero: x, y in metres, yaw in radians."""
    touching: tuple[tuple[float, float], ...]
    """Spans of time, in seconds, in which the contact must not break."""
    may_slip_off: bool = False
    """Whether the contact may reach the tip outside these spans, to slip off it."""


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """A motion of the base. It starts with the whisker free and at rest for `REST_S`."""

    needs_duration: ClassVar[bool] = False
    """Whether the scene has to give `duration_s`; other motions end by themselves."""
    example: ClassVar[dict[str, Any]]
    """Parameters with which the tests examine the motion."""

    def plan(self, stage: Stage) -> Plan:
        """Plans the motion; raises `ValueError` where the scene's geometry does not allow it."""
        raise NotImplementedError


class Path:
    """Builds a plan from straight moves with raised-cosine speed, which keeps velocity and acceleration continuous."""

    def __init__(self, start: Array, timestep_s: float) -> None:
        self._timestep_s = timestep_s
        self._poses = [start[None, :]]

    @property
    def end(self) -> Array:
        """The last pose."""
        return self._poses[-1][-1]

    @property
    def time_s(self) -> float:
        """Time of the last pose."""
        return (sum(len(piece) for piece in self._poses) - 1) * self._timestep_s

    def rest(self, duration_s: float) -> None:
        """Stands still."""
        count = round(duration_s / self._timestep_s)
        if count > 0:
            self._poses.append(np.repeat(self.end[None, :], count, axis=0))

    def move(self, target: Array, peak_speed_m_s: float) -> None:
        """Moves straight to the pose `target`; the speed rises to `peak_speed_m_s` and falls again as a raised cosine."""
        distance_m = float(np.hypot(*(target - self.end)[:2]))
        count = check_steps(2.0 * distance_m / peak_speed_m_s / self._timestep_s)
        if count > 0:
            self.follow(target, raised_cosine(np.arange(1, count + 1) / count))

    def follow(self, target: Array, share: Array) -> None:
        """Moves straight to the pose `target`, having covered the shares (n,) of the way at the next n time steps."""
        self._poses.append(self.end + share[:, None] * (target - self.end))

    def poses(self) -> Array:
        """All poses (n, 3)."""
        return np.concatenate(self._poses)


def check_steps(steps: float) -> int:
    """`steps` rounded up; raises `ValueError` beyond `MAX_STEPS`."""
    if steps > MAX_STEPS:
        raise ValueError(f"motion: expected at most {MAX_STEPS} time steps, found {steps:.3g}")
    return int(np.ceil(steps))


def raised_cosine(time: Array) -> Array:
    """Way covered at the share `time` (0 to 1) of a move whose speed is a raised cosine: t - sin(2 pi t) / (2 pi)."""
    time = np.clip(time, 0.0, 1.0)
    return time - np.sin(2.0 * np.pi * time) / (2.0 * np.pi)
