"""Smooth random motion with six degrees of freedom."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.motions.base import raised_cosine
from whisker_sim.space.motions.base import SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.space.rotation import turn
from whisker_sim.whisker import Array, Length, NotNegative, NotNegativeLength, Positive

_RAMP_S = 0.4
_WAVES = 4


class SpatialSmooth(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="smooth"):
    """Presses to `depth_m`, then moves and turns at random about that pose until the scene ends.

    Along each axis of World the base moves by at most `translation_m`, and turns by at most `rotation_rad` about the point at which
    the undeflected whisker first touches. Each motion is a sum of sinusoids of random phase between `frequency_min_hz` and
    `frequency_max_hz`.
    """

    depth_m: Length
    translation_m: NotNegativeLength = 0.002
    rotation_rad: NotNegative = 0.04
    frequency_min_hz: Positive = 0.4
    frequency_max_hz: Positive = 1.6

    needs_duration: ClassVar[bool] = True
    example: ClassVar[dict[str, Any]] = {"contact_arc_m": 0.05, "depth_m": 0.008}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frequency_min_hz > self.frequency_max_hz:
            raise ValueError(
                f"frequency_max_hz: expected at least frequency_min_hz = {self.frequency_min_hz}, found {self.frequency_max_hz}"
            )

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the motion, drawn from the random stream of the scene."""
        approach = self.approach(stage)
        path = SpatialPath(approach.at(-self.clearance_m), stage.timestep_s)
        touch_s = path.touch(approach, self, self.depth_m)
        steps = (stage.duration_s - path.time_s) / stage.timestep_s
        path.check(steps, "duration_s")
        count = round(steps)
        if count * stage.timestep_s < _RAMP_S:
            raise ValueError(
                f"duration_s: expected at least {path.time_s + _RAMP_S:.2f} s for this motion, found {stage.duration_s}"
            )
        time_s = np.arange(1, count + 1) * stage.timestep_s
        ramp = raised_cosine(time_s / _RAMP_S)[:, None]
        aside_m = self.translation_m * ramp * self._waves(time_s, stage.rng)
        turn_rad = self.rotation_rad * ramp * self._waves(time_s, stage.rng)
        path.add(approach.at(np.full(count, self.depth_m), aside_m, turn(turn_rad)), "duration_s")
        return SpatialPlan(approach.rotation, path.poses(), ((touch_s, path.time_s),))

    def _waves(self, time_s: Array, rng: np.random.Generator) -> Array:
        """Random waves (n, 3) of amplitude 1, with one frequency in each of equal bands."""
        band = (np.arange(_WAVES)[:, None] + rng.random((_WAVES, 3))) / _WAVES
        frequency_hz = self.frequency_min_hz + band * (self.frequency_max_hz - self.frequency_min_hz)
        phase_rad, amplitude = rng.uniform(0.0, 2.0 * np.pi, (_WAVES, 3)), rng.uniform(0.5, 1.0, (_WAVES, 3))
        wave = np.sum(amplitude * np.sin(2.0 * np.pi * frequency_hz * time_s[:, None, None] + phase_rad), axis=1)
        return wave / np.max(np.abs(wave), axis=0)
