"""Effects of sensor and mounting that are added at replay, as a scene states them."""

from typing import Annotated

import msgspec

Fraction = Annotated[float, msgspec.Meta(ge=-0.5, le=0.5)]


class Miscalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Deviations of sensor, whisker and mounting from their calibration; all zero by default."""

    gain: Fraction = 0.0
    """Relative deviation of the reading."""
    offset: Fraction = 0.0
    """Constant deviation of the reading, relative to the largest calibrated one."""
    drift_per_s: Fraction = 0.0
    """Rate at which the offset grows from the start."""
    stiffness: Fraction = 0.0
    """Relative deviation of Young's modulus."""
    mount_rad: Annotated[float, msgspec.Meta(ge=-0.5, le=0.5)] = 0.0
    """Rotation of the calibrated Base in the actual one."""
    mount_x_m: Annotated[float, msgspec.Meta(ge=-0.1, le=0.1)] = 0.0
    mount_y_m: Annotated[float, msgspec.Meta(ge=-0.1, le=0.1)] = 0.0
    """Displacement of the calibrated Base in the actual one."""
    latency_s: Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)] = 0.0
    """Time by which the poses lag the readings."""


class Replay(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Effects that `whisker evaluate` adds to the readings and poses of a trace unless its options state others."""

    noise: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
    """Standard deviation of the measurement noise, as a fraction of the largest reading of the set."""
    miscalibration: Miscalibration = Miscalibration()
