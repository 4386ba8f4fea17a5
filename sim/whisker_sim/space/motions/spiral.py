"""Spirals about the direction of the push."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.space.motions.base import SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.space.rotation import unit
from whisker_sim.whisker import Array, Length, Positive


class Spiral(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="spiral"):
    """Presses to `depth_m`, then moves on a spiral across `direction` out to `radius_m` in `turns` turns, and back."""

    depth_m: Length
    radius_m: Length
    turns: Positive = 3.0
    peak_speed_m_s: Positive = 0.03

    example: ClassVar[dict[str, Any]] = {"contact_arc_m": 0.05, "depth_m": 0.008, "radius_m": 0.004, "turns": 2.0}

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the spiral, whose radius grows and shrinks as sin^2 of the time, so that the velocity begins at zero."""
        approach = self.approach(stage)
        path = SpatialPath(approach.at(-self.clearance_m), stage.timestep_s)
        touch_s = path.touch(approach, self, self.depth_m)
        # The speed is largest where the radius is, after half of the time.
        duration_s = 4.0 * np.pi * self.turns * self.radius_m / self.peak_speed_m_s
        count = path.check(duration_s / stage.timestep_s, "motion.peak_speed_m_s")
        time = np.arange(1, count + 1) / count
        radius_m, angle_rad = self.radius_m * np.sin(np.pi * time) ** 2, 4.0 * np.pi * self.turns * time
        first, second = _across(approach.direction)
        aside_m = (radius_m * np.cos(angle_rad))[:, None] * first + (radius_m * np.sin(angle_rad))[:, None] * second
        path.add(approach.at(np.full(count, self.depth_m), aside_m), "motion.peak_speed_m_s")
        path.rest(self.dwell_s, "motion.dwell_s")
        return SpatialPlan(approach.rotation, path.poses(), ((touch_s, path.time_s),))


def _across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) that are perpendicular to `direction` and to each other."""
    smallest = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = unit(np.cross(direction, smallest))
    return first, np.cross(direction, first)
