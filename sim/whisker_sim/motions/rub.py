"""Rub: the whisker is pressed against an object and moved lengthwise over it, with reversals."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, TOUCH_GAP_M, Array, Motion, Path, Plan, Stage
from whisker_sim.whisker import Angle, Length, NotNegative, NotNegativeLength, Positive


class Rub(Motion, frozen=True, forbid_unknown_fields=True, tag="rub"):
    """Presses the whisker against the object, moves it lengthwise to both sides, and releases it, `strokes` times.

    The press moves the base by `press_m` from the depth `touch_depth_m`, in the direction of the normal of the undeflected whisker
    at `contact_arc_m`, turned by `oblique_rad` towards the tip. Then the base moves along the tangent there, by `along_m` towards
    the tip, by twice that towards the root, and back. The release is the reversed press, so that the contact lasts from the first
    touch on. Every move begins and ends at rest, and is followed by a rest of `dwell_s`.
    """

    contact_arc_m: Length
    press_m: Length
    along_m: NotNegativeLength = 0.0
    oblique_rad: Annotated[float, msgspec.Meta(ge=-1.4, le=1.4)] = 0.0
    strokes: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 2
    peak_speed_m_s: Positive = 0.035
    dwell_s: NotNegative = 0.0
    clearance_m: Length = 1.5e-3
    touch_depth_m: Length = 1e-3
    touch_speed_m_s: Positive = 0.01
    yaw_rad: Angle = 0.0

    example: ClassVar[dict[str, Any]] = {"contact_arc_m": 0.05, "press_m": 0.005, "along_m": 0.002, "strokes": 1}

    def plan(self, stage: Stage) -> Plan:
        """Plans the strokes."""
        stage.check_arc("contact_arc_m", self.contact_arc_m)
        touched = stage.base_pose(self.contact_arc_m, -self.touch_depth_m, self.yaw_rad)
        tangent_rad = self.yaw_rad + float(stage.whisker.rest_angle_rad(self.contact_arc_m))
        tangent = np.array((np.cos(tangent_rad), np.sin(tangent_rad), 0.0))
        normal = stage.face * np.array((-tangent[1], tangent[0], 0.0))
        pressed = touched + self.press_m * (np.cos(self.oblique_rad) * normal + np.sin(self.oblique_rad) * tangent)

        path = Path(touched - (self.touch_depth_m + self.clearance_m) * normal, stage.timestep_s)
        path.rest(REST_S)
        path.move(touched - (self.touch_depth_m + TOUCH_GAP_M) * normal, self.touch_speed_m_s, "motion.touch_speed_m_s")
        path.move(touched, self.touch_speed_m_s, "motion.touch_speed_m_s")
        touch_s = path.time_s

        def move(target: Array) -> None:
            path.move(target, self.peak_speed_m_s, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")

        for _ in range(self.strokes):
            move(pressed)
            if self.along_m > 0.0:
                move(pressed + self.along_m * tangent)
                move(pressed - self.along_m * tangent)
                move(pressed)
            move(touched)
        return Plan(path.poses(), ((touch_s, path.time_s),))
