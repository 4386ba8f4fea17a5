"""Magnet at the root of the whisker and magnetometer behind it.

A dipole m is `lever_m` behind the axis of the root's rotation, along the whisker; the sensor is `gap_m` behind the magnet at rest.
The field is mu0 / (4 pi r^3) (3 (m . u) u - m). Rotated by a small angle q, the magnet moves by `lever_m` q. The field across the
whisker is -mu0 m / (4 pi gap^3) (1 + 3 lever / gap) q; the field along it is even in q, and hence constant to first order.
"""

import msgspec
import numpy as np

from whisker_sim.whisker import Length, Positive

_MAGNETIC_T_M_A = 1e-7
"""mu0 / 4 pi."""


class Magnet(msgspec.Struct, frozen=True):
    """Neodymium disc of 4 mm diameter and 2 mm thickness, 5 mm from hinge and sensor. All values are assumptions.

    They give the published sensitivity: 1600 counts per millimetre of a push near the tip, 3000 at three quarters of the length.
    """

    moment_a_m2: Positive = 0.028
    gap_m: Length = 5e-3
    lever_m: Length = 5e-3

    @property
    def across_t_rad(self) -> float:
        """Field across the whisker, in its plane, per rotation of the root (T/rad), at rest."""
        return -_MAGNETIC_T_M_A * self.moment_a_m2 / self.gap_m**3 * (1.0 + 3.0 * self.lever_m / self.gap_m)


class Magnetometer(msgspec.Struct, frozen=True):
    """Three-axis chip with z along the whisker, whose readings are words of `bits` bits that wrap around.

    A count is the smallest step of an MLX90393. Readings at rest, noise and misalignment are rounded from the published log of
    readings at known positions: at rest (24963, 51635, 35964); x shows 4 % of the response of y.
    """

    tesla_per_count: Positive = 0.15e-6
    askew_rad: float = 0.035
    """Rotation of the chip about the whisker."""
    rest_counts: tuple[int, int, int] = (25_000, 51_600, 36_000)
    noise_sd_counts: Positive = 50.0
    """White noise on each axis."""
    bits: int = 16
    rate_hz: Positive = 800.0


class Field(Magnetometer, frozen=True, kw_only=True):
    """Readings to first order: `rest_counts` + `counts_per_rad` x rotation of the root + noise, modulo 2^`bits`."""

    counts_per_rad: tuple[float, float, float]
    magnet: Magnet


def field_of(magnet: Magnet, sensor: Magnetometer) -> Field:
    """Readings of `magnet` by `sensor`."""
    across = magnet.across_t_rad / sensor.tesla_per_count
    x, y = -across * np.sin(sensor.askew_rad), across * np.cos(sensor.askew_rad)
    counts_per_rad = (round(float(x), 1), round(float(y), 1), 0.0)
    return Field(counts_per_rad=counts_per_rad, magnet=magnet, **msgspec.structs.asdict(sensor))
