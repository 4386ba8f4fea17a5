"""Lift-offs: the whisker touches the object again and again, and leaves it now by withdrawal, now past its tip."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, Array, Motion, Path, Plan, Stage
from whisker_sim.whisker import Length, Positive

_EASE = 0.7
"""Share of the depth to which the pressure eases in the middle of a stroke."""


class LiftOffs(Motion, frozen=True, forbid_unknown_fields=True, tag="lift_offs"):
    """Presses the whisker to the object `strokes` times, each at a place, to a depth and with speeds of its own.

    A stroke presses along the normal of the undeflected whisker, eases, and presses again. Strokes leave the object by turns in two
    ways: the base withdraws along the normal, or draws the whisker lengthwise along the object until its tip slips off and it snaps
    back. Between strokes it stays clear for a time that is often too short for the ringing to die. Everything with a minimum and a
    maximum is drawn between them: speeds and times so that every factor is as likely, places and depths evenly. A move too short
    for its speed is made as fast as `acceleration_max_m_s2` allows. At first the whisker stays free for `rest_s`, in which its
    unrest shows.
    """

    strokes: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    arc_min_m: Length
    arc_max_m: Length
    depth_min_m: Length = 3e-3
    depth_max_m: Length = 10e-3
    press_speed_min_m_s: Positive = 0.03
    press_speed_max_m_s: Positive = 0.1
    release_speed_min_m_s: Positive = 0.03
    release_speed_max_m_s: Positive = 0.12
    free_min_s: Positive = 0.1
    free_max_s: Positive = 1.0
    clearance_m: Length = 4e-3
    past_tip_m: Length = 3e-3
    acceleration_max_m_s2: Positive = 0.3
    rest_s: Annotated[float, msgspec.Meta(ge=REST_S)] = 1.0

    example: ClassVar[dict[str, Any]] = {"strokes": 2, "arc_min_m": 0.05, "arc_max_m": 0.055, "depth_max_m": 0.005}

    def __post_init__(self) -> None:
        for quantity in ("arc_min_m", "depth_min_m", "press_speed_min_m_s", "release_speed_min_m_s", "free_min_s"):
            low, largest = getattr(self, quantity), quantity.replace("_min_", "_max_")
            if low > getattr(self, largest):
                raise ValueError(f"{largest}: expected at least {quantity} = {low}, found {getattr(self, largest)}")

    def plan(self, stage: Stage) -> Plan:
        """Plans the strokes."""
        if self.arc_max_m >= stage.whisker.length_m:
            raise ValueError(
                f"motion.arc_max_m: expected less than the whisker's length {stage.whisker.length_m}, found {self.arc_max_m}"
            )
        arcs_m = stage.rng.uniform(self.arc_min_m, self.arc_max_m, self.strokes)
        depths_m = stage.rng.uniform(self.depth_min_m, self.depth_max_m, self.strokes)
        press_m_s = _any_factor(stage.rng, self.press_speed_min_m_s, self.press_speed_max_m_s, self.strokes)
        release_m_s = _any_factor(stage.rng, self.release_speed_min_m_s, self.release_speed_max_m_s, self.strokes)
        free_s = _any_factor(stage.rng, self.free_min_s, self.free_max_s, self.strokes)
        slips_first = bool(stage.rng.integers(2))

        path = Path(stage.base_pose(arcs_m[0], self.clearance_m), stage.timestep_s)

        def move(target: Array, speed_m_s: float) -> None:
            # A raised cosine over the distance d with the peak speed v has the peak acceleration pi v^2 / (2 d).
            distance_m = float(np.hypot(*(target - path.end)[:2]))
            path.move(target, min(speed_m_s, np.sqrt(2.0 / np.pi * self.acceleration_max_m_s2 * distance_m)))

        path.rest(self.rest_s)
        touching = []
        for stroke, (arc_m, depth_m) in enumerate(zip(arcs_m, depths_m, strict=True)):
            clear = stage.base_pose(arc_m, self.clearance_m)
            pressed = stage.base_pose(arc_m, -depth_m)
            if stroke > 0:
                move(clear, self.press_speed_max_m_s)
            move(pressed, press_m_s[stroke])
            start_s = path.time_s
            move(stage.base_pose(arc_m, -_EASE * depth_m), press_m_s[stroke])
            move(pressed, press_m_s[stroke])
            touching.append((start_s, path.time_s))
            if (stroke % 2 == 0) == slips_first:
                move(self._past_the_tip(stage, depth_m), release_m_s[stroke])
                path.rest(free_s[stroke])
                move(self._past_the_tip(stage, -self.clearance_m), self.press_speed_max_m_s)
            else:
                move(clear, release_m_s[stroke])
                path.rest(free_s[stroke])
        return Plan(path.poses(), tuple(touching), may_slip_off=True)

    def _past_the_tip(self, stage: Stage, depth_m: float) -> Array:
        """The pose in which the undeflected tip faces the object to a depth, drawn back by `past_tip_m` along its tangent."""
        tip_m = stage.whisker.length_m
        tangent_rad = float(stage.whisker.rest_angle_rad(tip_m))
        back_m = self.past_tip_m * np.array((np.cos(tangent_rad), np.sin(tangent_rad), 0.0))
        return stage.base_pose(tip_m, -depth_m) - back_m


def _any_factor(rng: np.random.Generator, low: float, high: float, count: int) -> Array:
    """Random numbers (count,) between two bounds, with a logarithm that is evenly distributed."""
    return low * (high / low) ** rng.random(count)
