"""Sweeps along the surface, with a tilt of the base."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import raised_cosine
from whisker_sim.space.motions.base import SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.space.rotation import Vector, turn
from whisker_sim.whisker import Length, Positive


class Sweep(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="sweep"):
    """Presses to `depth_m`, then moves the base by the vector `stroke_m` of World and back, `strokes` times.

    Along the stroke the base also turns by the rotation vector `tilt_rad` of World, about the point at which the undeflected
    whisker first touches, which moves along.
    """

    depth_m: Length
    stroke_m: Vector
    strokes: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1
    tilt_rad: Vector = (0.0, 0.0, 0.0)
    peak_speed_m_s: Positive = 0.03

    example: ClassVar[dict[str, Any]] = {
        "contact_arc_m": 0.05,
        "depth_m": 0.006,
        "stroke_m": (0.0, 0.0, 0.006),
        "tilt_rad": (0.1, 0.0, 0.05),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any((*self.stroke_m, *self.tilt_rad)):
            raise ValueError("stroke_m: expected a stroke or a tilt, found none")

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the strokes, whose speed counts the turn by its effect on the contact's distance from the root."""
        approach = self.approach(stage)
        stroke_m, tilt_rad = np.array(self.stroke_m), np.array(self.tilt_rad)
        path = SpatialPath(approach.at(-self.clearance_m), stage.timestep_s)
        touch_s = path.touch(approach, self, self.depth_m)
        length_m = float(np.hypot(np.linalg.norm(stroke_m), self.contact_arc_m * np.linalg.norm(tilt_rad)))
        count = path.check(2.0 * length_m / self.peak_speed_m_s / stage.timestep_s, "motion.peak_speed_m_s")
        share = raised_cosine(np.arange(1, count + 1) / count)[:, None]
        there = approach.at(np.full(count, self.depth_m), share * stroke_m, turn(share * tilt_rad))
        back = np.concatenate((there[-2::-1], approach.at(self.depth_m)[None]))
        for _ in range(self.strokes):
            path.add(there, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")
            path.add(back, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")
        return SpatialPlan(approach.rotation, path.poses(), ((touch_s, path.time_s),))
