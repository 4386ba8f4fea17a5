"""Excursions: moves between random poses about a contact, with pauses and lift-offs."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, Array, Motion, Path, Plan, Stage, check_ranges
from whisker_sim.whisker import Length, NotNegative, NotNegativeLength, Positive

_HOLD_S = 0.05
"""Duration of the rest after the first press, during which the contact is guaranteed."""

Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class Excursions(Motion, frozen=True, forbid_unknown_fields=True, tag="excursions"):
    """Presses the whisker against the object, then moves `moves` times to a random pose, as an unplanned exploration does.

    The arc length of the contact is drawn from `arc_min_m` to `arc_max_m`. A pose presses to a depth between `depth_min_m` and
    `depth_max_m`, is displaced by up to `along_m` along the tangent of the whisker and rotated by up to `turn_rad`. With the
    probability `lift_share` the base withdraws to `clearance_m` before a move, and with `pause_share` it pauses for up to
    `pause_max_s` after it. Peak speeds are log-uniform and limited by `acceleration_max_m_s2`. After the first press the contact
    may break or slip off the tip at any time.
    """

    moves: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    arc_min_m: Length
    arc_max_m: Length
    depth_min_m: Length = 2e-3
    depth_max_m: Length = 8e-3
    along_m: NotNegativeLength = 4e-3
    turn_rad: NotNegative = 0.1
    speed_min_m_s: Positive = 0.01
    speed_max_m_s: Positive = 0.08
    pause_share: Share = 0.3
    pause_max_s: NotNegative = 0.5
    lift_share: Share = 0.1
    clearance_m: Length = 1.5e-3
    acceleration_max_m_s2: Positive = 0.5

    example: ClassVar[dict[str, Any]] = {"moves": 3, "arc_min_m": 0.05, "arc_max_m": 0.055}

    def __post_init__(self) -> None:
        check_ranges(self, "arc_min_m", "depth_min_m", "speed_min_m_s")

    def plan(self, stage: Stage) -> Plan:
        """Plans the moves."""
        stage.check_arc("arc_max_m", self.arc_max_m)
        rng = stage.rng
        arc_m = rng.uniform(self.arc_min_m, self.arc_max_m)
        path = Path(stage.base_pose(arc_m, self.clearance_m), stage.timestep_s)

        def move(target: Array) -> None:
            speed_m_s = self.speed_min_m_s * (self.speed_max_m_s / self.speed_min_m_s) ** rng.random()
            # A raised cosine over the distance d with the peak speed v has the peak acceleration pi v^2 / (2 d).
            distance_m = float(np.hypot(*(target - path.end)[:2]))
            limited_m_s = np.sqrt(2.0 / np.pi * self.acceleration_max_m_s2 * distance_m)
            key = "motion.speed_min_m_s" if speed_m_s <= limited_m_s else "motion.acceleration_max_m_s2"
            path.move(target, min(speed_m_s, limited_m_s), key)

        path.rest(REST_S)
        move(stage.base_pose(arc_m, -rng.uniform(self.depth_min_m, self.depth_max_m)))
        pressed_s = path.time_s
        path.rest(_HOLD_S)
        held_s = path.time_s
        for _ in range(self.moves):
            if rng.random() < self.lift_share:
                move(stage.base_pose(arc_m, self.clearance_m, path.end[2]))
            yaw_rad = rng.uniform(-self.turn_rad, self.turn_rad)
            pose = stage.base_pose(arc_m, -rng.uniform(self.depth_min_m, self.depth_max_m), yaw_rad)
            tangent_rad = yaw_rad + float(stage.whisker.rest_angle_rad(arc_m))
            along_m = rng.uniform(-self.along_m, self.along_m)
            move(pose + along_m * np.array((np.cos(tangent_rad), np.sin(tangent_rad), 0.0)))
            if rng.random() < self.pause_share:
                path.rest(rng.uniform(0.0, self.pause_max_s), "motion.pause_max_s")
        return Plan(path.poses(), ((pressed_s, held_s),), may_slip_off=True)
