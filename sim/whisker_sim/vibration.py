"""Vibration of the base, as superimposed on the planned motion by a robot arm.

It excites the free whisker as on a robot: the simulated base vibrates and the whisker responds dynamically. The trace contains the
true pose of the base; errors of a robot's encoders are modelled elsewhere, by a sensor front end.
"""

from typing import Annotated

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, raised_cosine
from whisker_sim.whisker import Array, Positive


class Vibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise of constant acceleration density between two frequencies, independent along x and y of World.

    `acceleration_m_s2` is the root mean square of the commanded acceleration along each axis.
    """

    acceleration_m_s2: Annotated[float, msgspec.Meta(gt=0.0, le=30.0)]
    """At most about three times gravity. With larger ones a sweep loses contact in every band between 5 and 400 Hz; above about
    100 m/s2 the integration is unstable."""
    low_hz: Positive = 5.0
    high_hz: Positive = 60.0

    def __post_init__(self) -> None:
        if self.low_hz >= self.high_hz:
            raise ValueError(f"vibration.high_hz: expected more than low_hz = {self.low_hz}, found {self.high_hz}")

    def displacement_m(self, steps: int, timestep_s: float, rng: np.random.Generator) -> Array:
        """Displacements (steps + 1, 2) of the base along x and y at every time step; they rise from zero within `REST_S`.

        Raises `ValueError` if the time step is too long for the band, or the duration too short to resolve it.
        """
        frequency_hz = np.fft.rfftfreq(steps + 1, timestep_s)
        in_band = (frequency_hz >= self.low_hz) & (frequency_hz <= self.high_hz)
        if self.high_hz > 0.25 / timestep_s or not np.any(in_band):
            raise ValueError(
                f"vibration: expected {self.low_hz} to {self.high_hz} Hz to fit {steps} time steps of {timestep_s} s, found no room"
            )
        phase_rad = rng.uniform(0.0, 2.0 * np.pi, (np.sum(in_band), 2))
        # A cosine of amplitude A contributes A^2 / 2 to the mean square; its coefficient in NumPy's inverse transform is A n / 2.
        amplitude_m_s2 = self.acceleration_m_s2 * np.sqrt(2.0 / np.sum(in_band))
        spectrum = np.zeros((len(frequency_hz), 2), dtype=complex)
        spectrum[in_band] = (
            0.5 * (steps + 1) * amplitude_m_s2 * np.exp(1j * phase_rad) / (2.0 * np.pi * frequency_hz[in_band, None]) ** 2
        )
        rise = raised_cosine(np.arange(steps + 1) * timestep_s / REST_S)
        return rise[:, None] * np.fft.irfft(spectrum, steps + 1, axis=0)
