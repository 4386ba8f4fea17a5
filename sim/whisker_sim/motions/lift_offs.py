"""Lift-offs: repeated contacts that end by withdrawal or by slipping off the tip."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, Array, Motion, Path, Plan, Stage, check_ranges
from whisker_sim.whisker import Length, Positive

_EASE = 0.7
"""Share of the depth at the release in the middle of a stroke."""


class LiftOffs(Motion, frozen=True, forbid_unknown_fields=True, tag="lift_offs"):
    """Presses the whisker against the object `strokes` times, each time at another point, depth and speed.

    A stroke presses along the normal of the undeflected whisker, releases partly, and presses again. It ends alternately in two
    ways: the base withdraws along the normal, or pulls the whisker lengthwise along the object until its tip slips off and the
    whisker snaps back. The free time between strokes is often too short for the ringing to decay. Quantities with a minimum and a
    maximum are random: speeds and times log-uniform, arc lengths and depths uniform. If a move is too short for its speed, its peak
    speed is limited by `acceleration_max_m_s2`. The whisker is free for the first `rest_s`, which allows its background noise to be
    measured.
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
        check_ranges(self, "arc_min_m", "depth_min_m", "press_speed_min_m_s", "release_speed_min_m_s", "free_min_s")

    def plan(self, stage: Stage) -> Plan:
        """Plans the strokes."""
        stage.check_arc("arc_max_m", self.arc_max_m)
        arcs_m = stage.rng.uniform(self.arc_min_m, self.arc_max_m, self.strokes)
        depths_m = stage.rng.uniform(self.depth_min_m, self.depth_max_m, self.strokes)
        press_m_s = _log_uniform(stage.rng, self.press_speed_min_m_s, self.press_speed_max_m_s, self.strokes)
        release_m_s = _log_uniform(stage.rng, self.release_speed_min_m_s, self.release_speed_max_m_s, self.strokes)
        free_s = _log_uniform(stage.rng, self.free_min_s, self.free_max_s, self.strokes)
        slips_first = bool(stage.rng.integers(2))

        path = Path(stage.base_pose(arcs_m[0], self.clearance_m), stage.timestep_s)

        def move(target: Array, speed_m_s: float, key: str) -> None:
            # A raised cosine over the distance d with the peak speed v has the peak acceleration pi v^2 / (2 d).
            distance_m = float(np.hypot(*(target - path.end)[:2]))
            limited_m_s = np.sqrt(2.0 / np.pi * self.acceleration_max_m_s2 * distance_m)
            key = f"motion.{key}" if speed_m_s <= limited_m_s else "motion.acceleration_max_m_s2"
            path.move(target, min(speed_m_s, limited_m_s), key)

        path.rest(self.rest_s, "motion.rest_s")
        touching = []
        for stroke, (arc_m, depth_m) in enumerate(zip(arcs_m, depths_m, strict=True)):
            clear = stage.base_pose(arc_m, self.clearance_m)
            pressed = stage.base_pose(arc_m, -depth_m)
            if stroke > 0:
                move(clear, self.press_speed_max_m_s, "press_speed_max_m_s")
            move(pressed, press_m_s[stroke], "press_speed_min_m_s")
            start_s = path.time_s
            move(stage.base_pose(arc_m, -_EASE * depth_m), press_m_s[stroke], "press_speed_min_m_s")
            move(pressed, press_m_s[stroke], "press_speed_min_m_s")
            touching.append((start_s, path.time_s))
            if (stroke % 2 == 0) == slips_first:
                move(self._past_the_tip(stage, depth_m), release_m_s[stroke], "release_speed_min_m_s")
                path.rest(free_s[stroke], "motion.free_max_s")
                move(self._past_the_tip(stage, -self.clearance_m), self.press_speed_max_m_s, "press_speed_max_m_s")
            else:
                move(clear, release_m_s[stroke], "release_speed_min_m_s")
                path.rest(free_s[stroke], "motion.free_max_s")
        return Plan(path.poses(), tuple(touching), may_slip_off=True)

    def _past_the_tip(self, stage: Stage, depth_m: float) -> Array:
        """Pose for which the undeflected tip faces the object at a depth, withdrawn by `past_tip_m` along its tangent."""
        tip_m = stage.whisker.length_m
        tangent_rad = float(stage.whisker.rest_angle_rad(tip_m))
        back_m = self.past_tip_m * np.array((np.cos(tangent_rad), np.sin(tangent_rad), 0.0))
        return stage.base_pose(tip_m, -depth_m) - back_m


def _log_uniform(rng: np.random.Generator, low: float, high: float, count: int) -> Array:
    """Log-uniform random numbers (count,) between two bounds."""
    return low * (high / low) ** rng.random(count)
