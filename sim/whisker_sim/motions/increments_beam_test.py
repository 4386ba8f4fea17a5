"""Routine of the calibration platform: a printer pushes the edge of a ruler into the whisker at points from tip to root."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, Array, Motion, Path, Plan, Stage
from whisker_sim.whisker import Length, NotNegative, NotNegativeLength, Positive

Increments = Annotated[int, msgspec.Meta(ge=0, le=1000)]


class IncrementsBeamTest(Motion, frozen=True, forbid_unknown_fields=True, tag="increments_beam_test"):
    """Pushes the whisker at points from tip to root, as the routine of this name moves a ruler by a 3D printer.

    The motion is relative to the ruler: the ruler is the object, and the base moves in the opposite direction. The printer's x axis
    is perpendicular to the whisker, its y axis parallel. There are `increments_y` + 1 points at equal distances over `total_y_m`,
    the first `tip_padding_m` from the tip. At each, the nozzle moves from `padding_m` before the undeflected centre line to
    `total_x_m` beyond it, in `increments_x` steps or in one, with the edge of the ruler `edge_ahead_m` ahead of it; it rests for
    `pause_s` after each step and `hold_s` after the last. Moves are those of the printer: straight, from rest to rest, with
    constant acceleration up to `speed_m_s`.
    """

    total_x_m: Length
    total_y_m: NotNegativeLength
    increments_x: Increments = 0
    increments_y: Increments = 0
    pause_s: NotNegative = 0.0
    hold_s: Positive = 3.0
    tip_padding_m: Length = 5e-3
    edge_ahead_m: NotNegativeLength = 3e-3
    padding_m: Length = 20e-3
    speed_m_s: Positive = 2.0 / 60.0
    acceleration_m_s2: Positive = 1.0

    example: ClassVar[dict[str, Any]] = {
        "total_x_m": 0.002, "total_y_m": 0.02, "increments_x": 2, "increments_y": 1, "pause_s": 0.1, "hold_s": 0.3,
        "edge_ahead_m": 0.002, "padding_m": 0.006,
    }  # fmt: skip

    def __post_init__(self) -> None:
        if self.padding_m <= self.edge_ahead_m:
            raise ValueError(f"padding_m: expected more than edge_ahead_m = {self.edge_ahead_m}, found {self.padding_m}")

    def plan(self, stage: Stage) -> Plan:
        """Plans the pushes from the tip to the root."""
        length_m = stage.whisker.length_m
        if self.tip_padding_m + self.total_y_m >= length_m:
            raise ValueError(
                f"motion.total_y_m: expected less than the whisker's length less tip_padding_m = "
                f"{length_m - self.tip_padding_m:g}, found {self.total_y_m}"
            )
        places_m = length_m - self.tip_padding_m - np.linspace(0.0, self.total_y_m, self.increments_y + 1)
        steps = max(self.increments_x, 1)
        if self.edge_ahead_m - self.padding_m + float(stage.whisker.radius_m(places_m[-1])) >= 0.0:
            raise ValueError(f"motion.padding_m: expected more than edge_ahead_m and the whisker's radius, found {self.padding_m}")

        def at(arc_m: float, nozzle_m: float) -> Array:
            """Pose for which the nozzle is `nozzle_m` beyond the undeflected centre line."""
            return stage.base_pose(arc_m, -(nozzle_m + self.edge_ahead_m + float(stage.whisker.radius_m(arc_m))))

        path = Path(at(places_m[0], -self.padding_m), stage.timestep_s)
        path.rest(REST_S)
        touching = []
        for arc_m in places_m:
            self._move(path, at(arc_m, -self.padding_m), stage.timestep_s)
            for step in range(1, steps + 1):
                self._move(path, at(arc_m, self.total_x_m * step / steps), stage.timestep_s)
                path.rest(self.pause_s, "motion.pause_s")
            start_s = path.time_s
            path.rest(self.hold_s, "motion.hold_s")
            touching.append((start_s, path.time_s))
            self._move(path, at(arc_m, -self.padding_m), stage.timestep_s)
        return Plan(path.poses(), tuple(touching))

    def _move(self, path: Path, target: Array, timestep_s: float) -> None:
        """Adds a move with constant acceleration to `speed_m_s` and equal deceleration; a short move does not reach the speed."""
        way_m = float(np.hypot(*(target - path.end)[:2]))
        if way_m == 0.0:
            return
        peak_m_s = min(self.speed_m_s, np.sqrt(way_m * self.acceleration_m_s2))
        ramp_s = peak_m_s / self.acceleration_m_s2
        duration_s = way_m / peak_m_s + ramp_s
        key = "motion.speed_m_s" if peak_m_s == self.speed_m_s else "motion.acceleration_m_s2"
        count = path.check(duration_s / timestep_s, key)
        time_s = np.linspace(0.0, duration_s, count + 1)[1:]
        # Deceleration mirrors acceleration.
        since_s, until_s = np.minimum(time_s, ramp_s), np.minimum(duration_s - time_s, ramp_s)
        sped_up_m = 0.5 * self.acceleration_m_s2 * (since_s**2 + ramp_s**2 - until_s**2)
        even_m = peak_m_s * np.clip(time_s - ramp_s, 0.0, duration_s - 2.0 * ramp_s)
        path.follow(target, (sped_up_m + even_m) / way_m, key)
