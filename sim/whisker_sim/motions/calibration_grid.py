"""Calibration: a pin is pushed into the whisker at many points by two orthogonal prismatic joints."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, Motion, Path, Plan, Stage
from whisker_sim.whisker import Length, Positive


class CalibrationGrid(Motion, frozen=True, forbid_unknown_fields=True, tag="calibration_grid"):
    """Pushes the pin into the whisker at `lines` points along it and back; the base only translates.

    The range of arc lengths is divided into `lines` equal strata with one push at a random point of each. A push follows the normal
    of the undeflected whisker to a depth of `depth_ratio` times the arc length, limited to `depth_max_m` and, near the tip, to the
    depth at which the contact is still `tip_margin_m` away from it.
    """

    lines: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    arc_min_m: Length
    arc_max_m: Length
    depth_ratio: Positive
    depth_max_m: Length
    speed_m_s: Positive
    clearance_m: Length = 0.2e-3
    tip_margin_m: Length = 1e-3

    example: ClassVar[dict[str, Any]] = {
        "lines": 2, "arc_min_m": 0.03, "arc_max_m": 0.05, "depth_ratio": 0.2, "depth_max_m": 0.01, "speed_m_s": 0.06,
    }  # fmt: skip

    def __post_init__(self) -> None:
        if self.arc_min_m >= self.arc_max_m:
            raise ValueError(f"arc_max_m: expected more than arc_min_m = {self.arc_min_m}, found {self.arc_max_m}")

    def plan(self, stage: Stage) -> Plan:
        """Plans the pushes from the root to the tip."""
        if self.arc_max_m + self.tip_margin_m >= stage.whisker.length_m:
            raise ValueError(
                f"motion.arc_max_m: expected less than length_m - tip_margin_m = "
                f"{stage.whisker.length_m - self.tip_margin_m}, found {self.arc_max_m}"
            )
        stratum = (np.arange(self.lines) + stage.rng.random(self.lines)) / self.lines
        arcs_m = self.arc_min_m + stratum * (self.arc_max_m - self.arc_min_m)
        path = Path(stage.base_pose(arcs_m[0], self.clearance_m), stage.timestep_s)
        path.rest(REST_S)
        touching = []
        for arc_m in arcs_m:
            path.move(stage.base_pose(arc_m, self.clearance_m), self.speed_m_s, "motion.speed_m_s")
            start_s = path.time_s
            path.move(stage.base_pose(arc_m, -self.depth_m(arc_m, stage)), self.speed_m_s, "motion.speed_m_s")
            turn_s = path.time_s
            path.move(stage.base_pose(arc_m, self.clearance_m), self.speed_m_s, "motion.speed_m_s")
            # Half of the push on either side of the reversal is well within the contact, regardless of ringing.
            touching.append((0.5 * (start_s + turn_s), 0.5 * (turn_s + path.time_s)))
        return Plan(path.poses(), tuple(touching))

    def depth_m(self, arc_m: float, stage: Stage) -> float:
        """Depth of the push at `arc_m`.

        If the whisker only rotated about its root, the push d would move the contact to the distance |c - d n| from the root, with
        the undeflected point c and the normal n towards the pin. Bending increases the term d^2 by about a fifth (int y'^2 / 2 is
        0.6 d^2 / s for a cantilever, 0.5 d^2 / s for a rigid bar). The limit is the d at which the contact reaches the margin of
        the tip.
        """
        point_m, end_m = stage.whisker.rest_point_m([arc_m, stage.whisker.length_m - self.tip_margin_m])
        angle_rad = float(stage.whisker.rest_angle_rad(arc_m))
        outward_m = -stage.face * float(point_m @ (-np.sin(angle_rad), np.cos(angle_rad)))
        room_m2 = 1.2 * float(end_m @ end_m - point_m @ point_m)
        slip_off_m = (np.sqrt(outward_m**2 + room_m2) - outward_m) / 1.2
        return float(min(self.depth_ratio * arc_m, self.depth_max_m, slip_off_m))
