"""Pushes in any direction."""

from typing import Annotated, Any, ClassVar

import msgspec

from whisker_sim.space.motions.base import SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.whisker import Length, Positive


class Push(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="push"):
    """Advances along `direction` from `touch_depth_m` to `depth_m` and back, `pushes` times."""

    depth_m: Length
    pushes: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1
    touch_depth_m: Length = 1e-3
    peak_speed_m_s: Positive = 0.03

    example: ClassVar[dict[str, Any]] = {"contact_arc_m": 0.05, "depth_m": 0.01}

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the pushes."""
        approach = self.approach(stage)
        path = SpatialPath(approach.at(-self.clearance_m), stage.timestep_s)
        touch_s = path.touch(approach, self, self.touch_depth_m)
        for _ in range(self.pushes):
            path.move(approach.at(self.depth_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")
            path.move(approach.at(self.touch_depth_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
        return SpatialPlan(approach.rotation, path.poses(), ((touch_s, path.time_s),))
