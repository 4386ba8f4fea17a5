"""Whiskers and helpers that several studies share."""

import msgspec
import numpy as np

from whisker_sim.shapes.pin import Pin
from whisker_sim.whisker import PRESETS, Array, Whisker

TAPERED = msgspec.structs.replace(PRESETS["straight"][1], name="tapered", tip_diameter_m=0.12e-3)

WHISKERS: dict[str, Whisker] = {whisker.name: whisker for whisker in (PRESETS["straight"][1], PRESETS["curved"][1], TAPERED)}
"""Whiskers that are put to the test, by name."""


def rms(values: Array) -> float:
    """Root mean square of `values`, of any shape; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


def largest(values: Array) -> float:
    """Largest magnitude among `values`, of any shape; NaN of none."""
    return float(np.max(np.abs(values))) if np.size(values) else float("nan")


FAR_AWAY = Pin(center_m=(1.0, 1.0))
"""An object that nothing reaches."""
