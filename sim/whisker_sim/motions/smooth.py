"""Arbitrary smooth planar trajectory that keeps the whisker in contact with the object."""

from typing import Any, ClassVar

import numpy as np

from whisker_sim.motions.base import REST_S, TOUCH_GAP_M, Array, Motion, Plan, Stage, check_ranges, check_steps, raised_cosine
from whisker_sim.whisker import Length, NotNegative, NotNegativeLength, Positive

# Two periods of a free whisker of 80 mm (8 Hz): a raised cosine of that duration leaves it at rest.
_APPROACH_S = 0.24
_PRESS_S = 0.3
"""At 55 mm the default press reaches 40 mm/s, about the speed of the waves."""
_RAMP_S = 0.5
_WAVES = 4
_MARGIN_M = 1e-5
"""Added to each correction of the mean depth, so that the search ends after a few steps."""
_CHECK_S = 0.02
"""Time between the poses at which the depth is checked; the base moves by a fraction of a millimetre meanwhile."""


class Smooth(Motion, frozen=True, forbid_unknown_fields=True, tag="smooth"):
    """Random sums of sinusoids in x, y and yaw about a contact, after a short approach.

    The whisker is first pressed against the object and then released to its mean depth, while the amplitude of the waves increases.
    The arc length s of the contact is drawn from `arc_min_m` to `arc_max_m`. The depth of the press is `press_per_m` s^2 and the
    mean depth `depth_per_m` s^2, so that the root moment of a cantilever, 3 EI depth / s^2, does not depend on the contact. The
    mean depth is increased if the undeflected whisker would otherwise come within less than `depth_min_m` of leaving the object.
    Translation and rotation have the amplitudes `translation_m` and `rotation_rad`; frequencies are between `frequency_min_hz` and
    `frequency_max_hz`.
    """

    needs_duration: ClassVar[bool] = True

    arc_min_m: Length
    arc_max_m: Length
    press_per_m: Positive = 2.4
    depth_per_m: Positive = 1.6
    depth_min_m: Length = 1e-3
    clearance_m: Length = 1.5e-3
    translation_m: NotNegativeLength = 3e-3
    rotation_rad: NotNegative = 0.052
    frequency_min_hz: Positive = 0.4
    frequency_max_hz: Positive = 2.2

    example: ClassVar[dict[str, Any]] = {"arc_min_m": 0.04, "arc_max_m": 0.05}

    def __post_init__(self) -> None:
        check_ranges(self, "arc_min_m", "frequency_min_hz")

    def plan(self, stage: Stage) -> Plan:
        """Plans the trajectory: rest, approach, press, and motion about the contact until `duration_s`."""
        stage.check_arc("arc_max_m", self.arc_max_m)
        settled_s = REST_S + _APPROACH_S + _PRESS_S + _RAMP_S
        if stage.duration_s <= settled_s:
            raise ValueError(f"duration_s: expected more than {settled_s} (rest, approach and press), found {stage.duration_s}")
        steps = check_steps(stage.duration_s / stage.timestep_s - 1e-6, "duration_s")
        time_s = np.arange(steps + 1) * stage.timestep_s
        arc_m = stage.rng.uniform(self.arc_min_m, self.arc_max_m)
        along_m = self.translation_m * self._waves(time_s, stage.rng)
        across_m = self.translation_m * self._waves(time_s, stage.rng)
        turn_rad = self.rotation_rad * self._waves(time_s, stage.rng)

        settled, every = time_s >= settled_s, max(1, round(_CHECK_S / stage.timestep_s))
        depth_m = self.depth_per_m * arc_m**2
        for _ in range(10):
            poses = self._poses(stage, time_s, arc_m, depth_m, along_m, across_m, turn_rad)
            missing_m = self.depth_min_m + float(np.max(stage.rest_gap_m(poses[settled][::every])))
            if missing_m <= 0.0:
                break
            depth_m += missing_m + _MARGIN_M
        else:
            raise ValueError(f"motion.depth_min_m: no mean depth up to {depth_m} m keeps the whisker on the object")
        return Plan(poses, ((settled_s, float(time_s[-1])),))

    def _poses(
        self, stage: Stage, time_s: Array, arc_m: float, depth_m: float, along_m: Array, across_m: Array, turn_rad: Array
    ) -> Array:
        """Base poses (n, 3), displaced along and across the whisker's tangent at the contact and rotated about the contact."""
        press_m = max(self.press_per_m * arc_m**2, depth_m)
        start = stage.base_pose(arc_m, self.clearance_m)
        tangent_rad = float(stage.whisker.rest_angle_rad(arc_m))
        tangent = np.array((np.cos(tangent_rad), np.sin(tangent_rad)))
        normal = stage.face * np.array((-tangent[1], tangent[0]))
        pivot = start[:2] + stage.whisker.rest_point_m(arc_m)
        lever = start[:2] - pivot

        approach = raised_cosine((time_s - REST_S) / _APPROACH_S)
        press = raised_cosine((time_s - REST_S - _APPROACH_S) / _PRESS_S)
        ramp = raised_cosine((time_s - REST_S - _APPROACH_S - _PRESS_S) / _RAMP_S)
        push_m = (
            approach * (self.clearance_m - TOUCH_GAP_M) + press * (TOUCH_GAP_M + press_m) + ramp * (depth_m - press_m + across_m)
        )
        turn = ramp * turn_rad
        cos, sin = np.cos(turn), np.sin(turn)
        x = pivot[0] + cos * lever[0] - sin * lever[1] + ramp * along_m * tangent[0] + push_m * normal[0]
        y = pivot[1] + sin * lever[0] + cos * lever[1] + ramp * along_m * tangent[1] + push_m * normal[1]
        return np.stack((x, y, turn), axis=-1)

    def _waves(self, time_s: Array, rng: np.random.Generator) -> Array:
        """Sum of sinusoids with random phases and one frequency in each of equal bands, scaled to an amplitude of one."""
        band = (np.arange(_WAVES) + rng.random(_WAVES)) / _WAVES
        frequency_hz = self.frequency_min_hz + band * (self.frequency_max_hz - self.frequency_min_hz)
        phase_rad = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        amplitude = rng.uniform(0.5, 1.0, _WAVES)
        wave = np.sum(amplitude[:, None] * np.sin(2.0 * np.pi * frequency_hz[:, None] * time_s + phase_rad[:, None]), axis=0)
        return wave / np.max(np.abs(wave))
