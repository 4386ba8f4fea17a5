"""Lateral sweep: the whisker is dragged back and forth over an object."""

from typing import Annotated, Any, ClassVar

import msgspec

from whisker_sim.motions.base import REST_S, TOUCH_GAP_M, Array, Motion, Path, Plan, Stage
from whisker_sim.whisker import Angle, Length, Positive


class LateralSweep(Motion, frozen=True, forbid_unknown_fields=True, tag="lateral_sweep"):
    """Moves into the object along the normal of the whisker at `contact_arc_m`, then back and forth `strokes` times.

    The depth of the strokes is between `touch_depth_m` and `stroke_m` more, so that the contact lasts from the first touch on.
    """

    contact_arc_m: Length
    stroke_m: Length
    strokes: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 3
    peak_speed_m_s: Positive = 0.035
    clearance_m: Length = 1.5e-3
    touch_depth_m: Length = 1e-3
    touch_speed_m_s: Positive = 0.01
    yaw_rad: Angle = 0.0

    example: ClassVar[dict[str, Any]] = {"contact_arc_m": 0.05, "stroke_m": 0.006, "strokes": 1}

    def plan(self, stage: Stage) -> Plan:
        """Plans the strokes."""
        stage.check_arc("contact_arc_m", self.contact_arc_m)

        def at(gap_m: float) -> Array:
            return stage.base_pose(self.contact_arc_m, gap_m, self.yaw_rad)

        path = Path(at(self.clearance_m), stage.timestep_s)
        path.rest(REST_S)
        path.move(at(TOUCH_GAP_M), self.touch_speed_m_s, "motion.touch_speed_m_s")
        path.move(at(-self.touch_depth_m), self.touch_speed_m_s, "motion.touch_speed_m_s")
        touch_s = path.time_s
        for _ in range(self.strokes):
            path.move(at(-self.touch_depth_m - self.stroke_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
            path.move(at(-self.touch_depth_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
        return Plan(path.poses(), ((touch_s, path.time_s),))
