"""Interface of motions: a plan of the base's pose from the undeflected geometry.

The base is positioned by the *gap*: the distance between the surface of the undeflected whisker and the object, along the normal
of the whisker on the object's side. It is negative if the object deflects the whisker.
"""

from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Whisker

Array = NDArray[np.float64]

REST_S = 0.15
"""Duration of the rest at the start of every trace, during which the whisker is free."""

TOUCH_GAP_M = 0.05e-3
"""Gap at which the fast approach of a trial ends. It continues from rest, so that the first contact is gentle."""


MAX_STEPS = 10_000_000
"""Maximum length of a plan; a longer one would not fit into memory and is most likely a typing error."""


class Stage(msgspec.Struct, frozen=True):
    """Inputs of a motion."""

    whisker: Whisker
    shape: Shape
    face: int
    """+1 if the object is on the left of the whisker, -1 if it is on the right."""
    timestep_s: float
    duration_s: float | None
    rng: np.random.Generator

    def base_pose(self, arc_m: float, gap_m: float, yaw_rad: float = 0.0) -> Array:
        """Pose (x, y, yaw) of the base in World for which the undeflected whisker faces the object at `arc_m` with `gap_m`."""
        tangent_rad = yaw_rad + float(self.whisker.rest_angle_rad(arc_m))
        normal = self.face * np.array((-np.sin(tangent_rad), np.cos(tangent_rad)))
        point_m = self.shape.support_m(-normal) - (gap_m + float(self.whisker.radius_m(arc_m))) * normal
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        rest = self.whisker.rest_point_m(arc_m)
        return np.array((point_m[0] - cos * rest[0] + sin * rest[1], point_m[1] - sin * rest[0] - cos * rest[1], yaw_rad))

    def rest_gap_m(self, poses: Array) -> Array:
        """Gap (n,) between the undeflected whisker and the object for base poses (n, 3).

        Each vertex of the outline is projected onto the normal of the nearest of a dense set of points of the whisker.
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
            # Squared distances up to a term that is the same for all points of the curve.
            nearest = np.argmin(curve_squared - local @ twice_curve, axis=1)
            height = np.sum((local - curve[nearest]) * normal[nearest], axis=1) - self.whisker.radius_m(arc_m[nearest])
            gap_m[index] = np.min(height)
        return gap_m

    def check_arc(self, key: str, arc_m: float) -> None:
        """Raises `ValueError` if the arc length `arc_m`, the motion's parameter `key`, is not on the whisker."""
        if arc_m >= self.whisker.length_m:
            raise ValueError(f"motion.{key}: expected less than the whisker's length {self.whisker.length_m}, found {arc_m}")


class Plan(msgspec.Struct, frozen=True):
    """A planned motion: the commanded pose at every step and the guaranteed contact."""

    poses: Array
    """Poses (n + 1, 3) of the base in World, one per time step from time zero: x, y (m), yaw (rad)."""
    touching: tuple[tuple[float, float], ...]
    """Time intervals (s) during which the contact must not break."""
    may_slip_off: bool = False
    """Whether the contact may reach the tip outside these intervals, in order to slip off it."""


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """A motion of the base. The whisker is free and at rest for the first `REST_S`."""

    needs_duration: ClassVar[bool] = False
    """Whether the scene must state `duration_s`; other motions end by themselves."""
    example: ClassVar[dict[str, Any]]
    """Parameters used by the tests of the registry."""

    def plan(self, stage: Stage) -> Plan:
        """Plans the motion; raises `ValueError` if the geometry of the scene does not allow it."""
        raise NotImplementedError


class Pieces:
    """Poses, one per time step, that are added piece by piece; together they take at most `MAX_STEPS`.

    What adds a piece takes the key of the scene that determines its duration, and raises `ValueError` with this key if the piece
    makes the plan too long.
    """

    def __init__(self, start: Array, timestep_s: float) -> None:
        self._timestep_s = timestep_s
        self._pieces = [start[None, :]]
        self._steps = 0

    @property
    def end(self) -> Array:
        """The last pose."""
        return self._pieces[-1][-1]

    @property
    def time_s(self) -> float:
        """Time of the last pose."""
        return self._steps * self._timestep_s

    def rest(self, duration_s: float, key: str = "motion") -> None:
        """Adds a rest."""
        steps = duration_s / self._timestep_s
        self.check(steps, key)
        count = round(steps)
        if count > 0:
            self.add(np.repeat(self.end[None, :], count, axis=0), key)

    def add(self, piece: Array, key: str) -> None:
        """Adds the poses of the next time steps."""
        self.check(len(piece), key)
        self._pieces.append(piece)
        self._steps += len(piece)

    def check(self, steps: float, key: str) -> int:
        """`steps` rounded up; raises `ValueError` if the plan has no room for so many."""
        check_steps(self._steps + steps, key)
        return int(np.ceil(steps))

    def poses(self) -> Array:
        """All poses (n, k)."""
        return np.concatenate(self._pieces)


class Path(Pieces):
    """Sequence of straight moves with raised-cosine speed, whose velocity and acceleration are continuous."""

    def move(self, target: Array, peak_speed_m_s: float, key: str = "motion") -> None:
        """Adds a straight move to the pose `target`, with a raised-cosine speed profile that reaches `peak_speed_m_s`."""
        distance_m = float(np.hypot(*(target - self.end)[:2]))
        count = self.check(2.0 * distance_m / peak_speed_m_s / self._timestep_s, key)
        if count > 0:
            self.follow(target, raised_cosine(np.arange(1, count + 1) / count), key)

    def follow(self, target: Array, share: Array, key: str) -> None:
        """Adds a straight move to the pose `target` that has covered the shares (n,) of the distance at the next n time steps."""
        self.add(self.end + share[:, None] * (target - self.end), key)


def check_ranges(motion: Motion, *lowest: str) -> None:
    """Raises `ValueError` if a parameter named in `lowest`, with `_min_` in its name, exceeds the one with `_max_` in its place."""
    for low in lowest:
        high = low.replace("_min_", "_max_")
        if getattr(motion, low) > getattr(motion, high):
            raise ValueError(f"{high}: expected at least {low} = {getattr(motion, low)}, found {getattr(motion, high)}")


def check_steps(steps: float, key: str) -> int:
    """`steps` rounded up; raises `ValueError` with the key of the scene that determines them above `MAX_STEPS`."""
    if steps > MAX_STEPS:
        raise ValueError(f"{key}: expected at most {MAX_STEPS} time steps of the whole motion, found {steps:.8g}")
    return int(np.ceil(steps))


def raised_cosine(time: Array) -> Array:
    """Covered share of a move with raised-cosine speed at the share `time` (0 to 1): t - sin(2 pi t) / (2 pi)."""
    time = np.clip(time, 0.0, 1.0)
    return time - np.sin(2.0 * np.pi * time) / (2.0 * np.pi)
