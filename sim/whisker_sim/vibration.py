"""Vibration of the base: what a robot's arm adds to the motion it is asked for.

It excites the free whisker as on a robot: the simulator shakes the base, and the whisker answers by its own dynamics. The trace
logs the base where it truly is, shaken; what a robot's encoders would miss of that is for a sensor front end to leave out.
"""

import msgspec
import numpy as np

from whisker_sim.motions.base import REST_S, raised_cosine
from whisker_sim.whisker import Array, Positive


class Vibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise with an even spectrum of acceleration between two frequencies, along x and y of World, independently.

    `acceleration_m_s2` is its root mean square along each axis, as it is asked of the base's drive.
    """

    acceleration_m_s2: Positive
    low_hz: Positive = 5.0
    high_hz: Positive = 60.0

    def __post_init__(self) -> None:
        if self.low_hz >= self.high_hz:
            raise ValueError(f"vibration.high_hz: expected more than low_hz = {self.low_hz}, found {self.high_hz}")

    def displacement_m(self, steps: int, timestep_s: float, rng: np.random.Generator) -> Array:
        """Displacements (steps + 1, 2) of the base along x and y at every time step; they rise from zero within `REST_S`.

        Raises `ValueError` where the time steps are too long for the band, or too few to hold it.
        """
        frequency_hz = np.fft.rfftfreq(steps + 1, timestep_s)
        in_band = (frequency_hz >= self.low_hz) & (frequency_hz <= self.high_hz)
        if self.high_hz > 0.25 / timestep_s or not np.any(in_band):
            raise ValueError(
                f"vibration: expected {self.low_hz} to {self.high_hz} Hz to fit {steps} time steps of {timestep_s} s, found no room"
            )
        phase_rad = rng.uniform(0.0, 2.0 * np.pi, (np.sum(in_band), 2))
        # A cosine of amplitude A adds A^2 / 2 to the mean square; numpy's inverse transform has A (n / 2) for it.
        amplitude_m_s2 = self.acceleration_m_s2 * np.sqrt(2.0 / np.sum(in_band))
        spectrum = np.zeros((len(frequency_hz), 2), dtype=complex)
        spectrum[in_band] = (
            0.5 * (steps + 1) * amplitude_m_s2 * np.exp(1j * phase_rad) / (2.0 * np.pi * frequency_hz[in_band, None]) ** 2
        )
        rise = raised_cosine(np.arange(steps + 1) * timestep_s / REST_S)
        return rise[:, None] * np.fft.irfft(spectrum, steps + 1, axis=0)
