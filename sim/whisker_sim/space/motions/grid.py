"""Grid of contacts in space, for calibration."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.space.motions.base import REST_S, TOUCH_GAP_M, Approach, SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.space.rotation import about, matrix_of, unit
from whisker_sim.whisker import Array, Length, Positive

_TURN_SPEED_M_S = 0.2


class SpatialGrid(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="grid"):
    """Presses at `arcs` arc lengths from `contact_arc_m` to `arc_max_m`, each with `rolls` rolls about x of Base.

    The depth of the presses is linear in the arc length, from `depth_m` at the first to `depth_max_m` at the last one; it is
    constant without `depth_max_m`. Between two presses the base withdraws by `withdrawal_m`, beyond the reach of the turning
    whisker.
    """

    arc_max_m: Length
    depth_m: Length
    depth_max_m: Length | None = None
    arcs: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 6
    rolls: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 8
    withdrawal_m: Length = 0.05
    peak_speed_m_s: Positive = 0.03

    example: ClassVar[dict[str, Any]] = {
        "contact_arc_m": 0.04,
        "arc_max_m": 0.06,
        "depth_m": 0.004,
        "arcs": 1,
        "rolls": 2,
        "dwell_s": 0.2,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.contact_arc_m > self.arc_max_m:
            raise ValueError(f"arc_max_m: expected at least contact_arc_m = {self.contact_arc_m}, found {self.arc_max_m}")

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the presses."""
        stage.check_arc("arc_max_m", self.arc_max_m)
        rotation, direction = matrix_of(self.orientation), unit(self.direction)
        aim_m = np.array(stage.solid.center_m if self.aim_m is None else self.aim_m)
        arcs_m = np.linspace(self.contact_arc_m, self.arc_max_m, self.arcs)
        depths_m = np.linspace(self.depth_m, self.depth_m if self.depth_max_m is None else self.depth_max_m, self.arcs)
        path, touching = None, []
        for roll_rad in 2.0 * np.pi * np.arange(self.rolls) / self.rolls:
            for arc_m, depth_m in zip(arcs_m.tolist(), depths_m.tolist(), strict=True):
                rolled = rotation @ about(0, roll_rad)
                touch_m = stage.touch_position(rolled, arc_m, direction, aim_m)
                approach = Approach(rotation, direction, touch_m, touch_m)

                def at(advance_m: float, approach: Approach = approach, roll_rad: float = roll_rad) -> Array:
                    return approach.at(advance_m) + np.array((0.0, 0.0, 0.0, 0.0, 0.0, roll_rad))

                if path is None:
                    path = SpatialPath(at(-self.withdrawal_m), stage.timestep_s)
                    path.rest(REST_S)
                path.move(at(-self.withdrawal_m), _TURN_SPEED_M_S, "motion.withdrawal_m", turning_m=arc_m)
                path.move(at(-TOUCH_GAP_M), _TURN_SPEED_M_S, "motion.withdrawal_m")
                path.move(at(0.1 * depth_m), self.touch_speed_m_s, "motion.touch_speed_m_s")
                pressed_s = path.time_s
                path.move(at(depth_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
                path.rest(self.dwell_s, "motion.dwell_s")
                path.move(at(0.1 * depth_m), self.peak_speed_m_s, "motion.peak_speed_m_s")
                touching.append((pressed_s, path.time_s))
                path.move(at(-TOUCH_GAP_M), self.touch_speed_m_s, "motion.touch_speed_m_s")
                path.move(at(-self.withdrawal_m), _TURN_SPEED_M_S, "motion.withdrawal_m")
        return SpatialPlan(rotation, path.poses(), tuple(touching))
