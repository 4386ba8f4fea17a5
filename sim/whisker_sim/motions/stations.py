"""Stations: the whisker is pressed against the object and then moved through stated poses, with pauses."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, TOUCH_GAP_M, Array, Motion, Path, Plan, Stage
from whisker_sim.whisker import Angle, Coordinate, Length, NotNegative, Positive


class Station(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pose of the base relative to the touch, and the pause there."""

    depth_m: Coordinate
    """Displacement towards the object, along the normal of the undeflected whisker at the touch."""
    along_m: Coordinate = 0.0
    """Displacement along its tangent, towards the tip."""
    turn_rad: Angle = 0.0
    """Rotation about the root."""
    pause_s: NotNegative = 0.0


class Stations(Motion, frozen=True, forbid_unknown_fields=True, tag="stations"):
    """Touches the object at `contact_arc_m`, then passes `stations` in turn, `rounds` times.

    The contact may jump, break or slip off the tip at any time after the first station.
    """

    contact_arc_m: Length
    stations: Annotated[tuple[Station, ...], msgspec.Meta(min_length=1, max_length=1000)]
    rounds: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1
    peak_speed_m_s: Positive = 0.035
    clearance_m: Length = 1.5e-3
    touch_speed_m_s: Positive = 0.01
    yaw_rad: Angle = 0.0

    example: ClassVar[dict[str, Any]] = {
        "contact_arc_m": 0.05,
        "stations": ({"depth_m": 0.003, "pause_s": 0.3}, {"depth_m": 0.006, "along_m": 0.004, "turn_rad": 0.05}),
    }

    def plan(self, stage: Stage) -> Plan:
        """Plans the moves; a station without displacement from the previous one is refused unless it has the same rotation."""
        stage.check_arc("contact_arc_m", self.contact_arc_m)
        touch = stage.base_pose(self.contact_arc_m, 0.0, self.yaw_rad)
        tangent_rad = self.yaw_rad + float(stage.whisker.rest_angle_rad(self.contact_arc_m))
        along = np.array((np.cos(tangent_rad), np.sin(tangent_rad), 0.0))
        inward = stage.face * np.array((-np.sin(tangent_rad), np.cos(tangent_rad), 0.0))

        def at(station: Station) -> Array:
            return touch + station.depth_m * inward + station.along_m * along + np.array((0.0, 0.0, station.turn_rad))

        path = Path(touch - self.clearance_m * inward, stage.timestep_s)
        path.rest(REST_S)
        path.move(touch - TOUCH_GAP_M * inward, self.touch_speed_m_s, "motion.touch_speed_m_s")
        path.move(at(self.stations[0]), self.touch_speed_m_s, "motion.touch_speed_m_s")
        touch_s = path.time_s
        path.rest(self.stations[0].pause_s, "motion.stations")
        for index, station in enumerate(self.stations * self.rounds):
            if index == 0:
                continue
            target = at(station)
            if np.array_equal(target[:2], path.end[:2]) and target[2] != path.end[2]:
                raise ValueError(
                    f"motion.stations: station {index % len(self.stations)}: expected a displacement with the rotation"
                )
            path.move(target, self.peak_speed_m_s, "motion.peak_speed_m_s")
            path.rest(station.pause_s, "motion.stations")
        return Plan(path.poses(), ((touch_s, touch_s),), may_slip_off=True)
