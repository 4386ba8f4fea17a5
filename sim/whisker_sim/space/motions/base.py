"""Interface of motions in space: a plan of the base's pose.

A motion presses the whisker against the solid along the unit vector `direction` of World. The *advance* of the base along it is
zero at the first touch of the undeflected whisker, whose point at `contact_arc_m` moves along the line through `aim_m`.
"""

from typing import Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, TOUCH_GAP_M, Pieces, raised_cosine
from whisker_sim.space.rotation import (
    Quaternion,
    Vector,
    applied,
    checked_direction,
    checked_quaternion,
    matrix_of,
    unit,
    yaw_pitch_roll,
)
from whisker_sim.space.solids import Solid
from whisker_sim.space.whisker import SpatialWhisker
from whisker_sim.whisker import Array, Coordinate, Length, NotNegative, Positive

_LARGEST_PITCH_RAD = np.radians(80.0)
_SAMPLES = 241
"""Points of the undeflected whisker by which its clearance is found."""
_FAR_M = 1.0
"""Distance before the aim at which the advance begins; doubled, up to `_FARTHEST_M`, while the whisker overlaps the solid."""
_FARTHEST_M = 128.0
_TOUCHING_M = 1e-9
_MARCHES = 2000
_ROOT_SHARE, _TIP_SHARE = 0.03, 0.97


class SpatialPlan(msgspec.Struct, frozen=True):
    """Planned motion of the base."""

    start_rotation: Array
    """Rotation (3, 3) of the base in World at the start."""
    coordinates: Array
    """(n + 1, 6), one row per time step from time zero: position in World (m), then yaw, pitch and roll relative to the start."""
    touching: tuple[tuple[float, float], ...]
    """Intervals (s) in which the whisker is in contact without interruption."""


class SpatialStage(msgspec.Struct, frozen=True):
    """Inputs of a motion."""

    whisker: SpatialWhisker
    solid: Solid
    timestep_s: float
    duration_s: float | None
    rng: np.random.Generator

    def check_arc(self, name: str, arc_m: float) -> None:
        """Raises `ValueError` if the parameter `name` of the motion, an arc length, is beyond the whisker."""
        length_m = self.whisker.whisker.length_m
        if arc_m > length_m:
            raise ValueError(f"motion.{name}: expected at most the length of the whisker, {length_m} m, found {arc_m}")

    def touch_position(self, rotation: Array, arc_m: float, direction: Array, aim_m: Array) -> Array:
        """Position (3,) of the base with the rotation (3, 3) at which the undeflected whisker first touches the solid.

        The base comes along `direction` (3,), so that the whisker's point at `arc_m` passes through `aim_m`. The clearance does not
        decrease faster than the base advances, so that steps of its size do not pass the first touch.

        Raises `ValueError` if the whisker does not touch, or touches with its tip or at its root.
        """
        length_m = self.whisker.whisker.length_m
        arcs_m = np.linspace(0.0, length_m, _SAMPLES)
        whisker_m = applied(rotation, self.whisker.rest_point_m(arcs_m))
        radii_m = self.whisker.whisker.radius_m(arcs_m)
        aimed_m = aim_m - applied(rotation, self.whisker.rest_point_m(arc_m))

        def clearances_m(position_m: Array) -> Array:
            return self.solid.closest(position_m + whisker_m).distance_m - radii_m

        far_m = _FAR_M
        while np.min(clearances_m(aimed_m - far_m * direction)) < 0.0:
            far_m *= 2.0
            if far_m > _FARTHEST_M:
                raise ValueError("motion.direction: expected a whisker outside the solid before it advances, found one inside")
        position_m = aimed_m - far_m * direction
        for _ in range(_MARCHES):
            clearance_m = clearances_m(position_m)
            nearest = int(np.argmin(clearance_m))
            if clearance_m[nearest] < _TOUCHING_M:
                share = arcs_m[nearest] / length_m
                if not _ROOT_SHARE <= share <= _TIP_SHARE:
                    place = "root" if share < _ROOT_SHARE else "tip"
                    raise ValueError(f"motion.direction: expected a touch on the side of the whisker, found one at its {place}")
                return position_m
            position_m = position_m + clearance_m[nearest] * direction
            if clearance_m[nearest] > 2.0 * far_m:
                break
        raise ValueError("motion.direction: the whisker does not meet the solid in this direction")


class SpatialMotion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """A motion of the base in space. The whisker is free and at rest for the first `REST_S`."""

    contact_arc_m: Length
    direction: Vector = (0.0, 1.0, 0.0)
    """Direction in World in which the base advances; it is scaled to the length 1."""
    aim_m: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Point of World towards which the whisker's point at `contact_arc_m` moves; by default the centre of the solid."""
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation from Base to World at the start, as a unit quaternion (w, x, y, z)."""
    clearance_m: Length = 1.5e-3
    touch_speed_m_s: Positive = 0.01
    dwell_s: NotNegative = 1.0
    """Duration of the rest after each press, stroke or spiral, in which the ringing along the surface decays."""

    needs_duration: ClassVar[bool] = False
    """Whether the scene must state `duration_s`; other motions end by themselves."""
    example: ClassVar[dict[str, Any]]
    """Parameters used by the tests of the registry."""

    def __post_init__(self) -> None:
        checked_direction("direction", self.direction)
        checked_quaternion("orientation", self.orientation)

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the motion; raises `ValueError` if the geometry of the scene does not allow it."""
        raise NotImplementedError

    def approach(self, stage: SpatialStage) -> "Approach":
        """The approach to the first touch; raises `ValueError` if the whisker does not touch the solid."""
        stage.check_arc("contact_arc_m", self.contact_arc_m)
        return Approach.planned(self, stage)


class Approach:
    """Position of the base at the first touch, and coordinates of the base relative to it."""

    def __init__(self, rotation: Array, direction: Array, touch_m: Array, contact_m: Array) -> None:
        self.rotation, self.direction, self.touch_m, self.contact_m = rotation, direction, touch_m, contact_m

    @classmethod
    def planned(cls, motion: SpatialMotion, stage: SpatialStage) -> "Approach":
        """The approach of `motion`."""
        rotation, direction = matrix_of(motion.orientation), unit(motion.direction)
        aim_m = np.array(stage.solid.center_m if motion.aim_m is None else motion.aim_m)
        touch_m = stage.touch_position(rotation, motion.contact_arc_m, direction, aim_m)
        contact_m = touch_m + applied(rotation, stage.whisker.rest_point_m(motion.contact_arc_m))
        return cls(rotation, direction, touch_m, contact_m)

    def at(self, advance_m: Array | float, aside_m: Array | float = 0.0, turned: Array | None = None) -> Array:
        """Coordinates (..., 6) for the advance (...), displaced by the vectors `aside_m` (..., 3) of World.

        The rotations `turned` (..., 3, 3) in World turn the base about the contact of the undeflected whisker at the first touch.
        """
        moved_m = np.asarray(advance_m)[..., None] * self.direction + aside_m
        if turned is None:
            position_m = self.touch_m + moved_m
            return np.concatenate((position_m, np.zeros_like(position_m)), axis=-1)
        position_m = self.contact_m + applied(turned, self.touch_m - self.contact_m) + moved_m
        return self.posed(position_m, self.rotation.T @ turned @ self.rotation)

    def posed(self, position_m: Array, relative: Array) -> Array:
        """Coordinates (..., 6) at the positions (..., 3) in World, turned by `relative` (..., 3, 3) from the start."""
        return np.concatenate((position_m, _angles(relative)), axis=-1)


def _angles(rotation: Array) -> Array:
    angles_rad = yaw_pitch_roll(rotation)
    steepest_rad = float(np.max(np.abs(angles_rad[..., 1])))
    if steepest_rad > _LARGEST_PITCH_RAD:
        raise ValueError(
            f"motion: expected the base to pitch by at most {np.degrees(_LARGEST_PITCH_RAD):.0f} degrees from its start, "
            f"found {np.degrees(steepest_rad):.0f}"
        )
    return angles_rad


class SpatialPath(Pieces):
    """Sequence of straight moves of the base's coordinates (6,) with raised-cosine speed."""

    def move(self, target: Array, peak_speed_m_s: float, key: str, turning_m: float = 0.0) -> None:
        """Adds a straight move to `target` that reaches `peak_speed_m_s`; a turn counts as the angle times `turning_m`."""
        change = target - self.end
        distance_m = float(np.hypot(np.linalg.norm(change[:3]), turning_m * np.linalg.norm(change[3:])))
        count = self.check(2.0 * distance_m / peak_speed_m_s / self._timestep_s, key)
        if count > 0:
            share = raised_cosine(np.arange(1, count + 1) / count)
            self.add(self.end + share[:, None] * change, key)

    def touch(self, approach: Approach, motion: SpatialMotion, depth_m: float) -> float:
        """Adds the rest, the approach and the first press to `depth_m`; returns the time from which the whisker is in contact."""
        self.rest(REST_S)
        self.move(approach.at(-TOUCH_GAP_M), motion.touch_speed_m_s, "motion.touch_speed_m_s")
        self.move(approach.at(depth_m), motion.touch_speed_m_s, "motion.touch_speed_m_s")
        touch_s = self.time_s
        self.rest(motion.dwell_s, "motion.dwell_s")
        return touch_s
