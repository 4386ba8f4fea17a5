"""Random sampling rates, noise and miscalibrations."""

import numpy as np

from whisker_sim.random_suite.draw import Draw, log_uniform, signed
from whisker_sim.replay import Miscalibration, Replay

RATES_HZ = (50.0, 80.0, 100.0, 125.0, 200.0, 250.0, 400.0, 500.0, 1000.0)
"""Sampling rates, equally probable; each row is a whole number of time steps of 0.5 ms."""

_MISCALIBRATED_SHARE = 0.3

MISCALIBRATIONS: dict[str, Draw[dict[str, float]]] = {
    "gain": lambda rng: {"gain": signed(rng, 0.003, 0.05, 5)},
    "offset": lambda rng: {"offset": signed(rng, 0.001, 0.02, 5)},
    "drift": lambda rng: {"drift_per_s": signed(rng, 0.0003, 0.005, 6)},
    "stiffness": lambda rng: {"stiffness": signed(rng, 0.005, 0.05, 5)},
    "mount angle": lambda rng: {"mount_rad": signed(rng, 0.0008, 0.0087, 6)},
    "mount place": lambda rng: {"mount_x_m": signed(rng, 3e-5, 3e-4, 7), "mount_y_m": signed(rng, 3e-5, 3e-4, 7)},
    "latency": lambda rng: {"latency_s": log_uniform(rng, 5e-4, 5e-3, 5)},
}
"""Miscalibrations by name, equally probable."""


def random_rate_hz(rng: np.random.Generator) -> float:
    """A sampling rate."""
    return float(rng.choice(RATES_HZ))


def random_replay(rng: np.random.Generator) -> Replay:
    """Noise of 0.1 to 5 % and, in three of ten sets, one or two miscalibrations."""
    noise = log_uniform(rng, 0.001, 0.05, 5)
    if rng.random() >= _MISCALIBRATED_SHARE:
        return Replay(noise)
    names = rng.choice(sorted(MISCALIBRATIONS), size=int(rng.integers(1, 3)), replace=False)
    drawn = [MISCALIBRATIONS[name](rng) for name in names]
    return Replay(noise, Miscalibration(**{key: value for part in drawn for key, value in part.items()}))
