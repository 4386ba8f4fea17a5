"""Static and dynamic part of the reading: contribution of inertia at several speeds of the base."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.certificate import SETTLING_S
from whisker_sim.physics.cases import largest, rms
from whisker_sim.physics.strokes import CASES, stroke
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study

FIRST_S = 0.1
SPEEDS_M_S = (0.02, 0.05, 0.1)


class Row(NamedTuple):
    """Static and dynamic part of the reading, relative to the largest static reading."""

    case: str
    speed_m_s: float
    """Largest speed of the base during the strokes; the first contact is slower."""
    static_n_m: float
    """Largest static reading, that of the elastica."""
    first_rms: float
    """Dynamic part, RMS over the first `FIRST_S` of the contact."""
    settled_rms: float
    """Dynamic part, RMS after `SETTLING_S` of contact."""
    settled_worst: float


def speeds(case: str, whisker: str, shape: str, face: str, speed_m_s: float) -> Row:
    """Static and dynamic part of the reading at one speed."""
    compared = stroke(whisker, shape, face, 40, 0.0005, speed_m_s)
    static_n_m = float(np.nanmax(np.abs(compared.static_n_m)))
    dynamic = compared.dynamic_n_m / static_n_m
    known = np.isfinite(dynamic)
    first, settled = known & (compared.since_s < FIRST_S), known & (compared.since_s >= SETTLING_S)
    return Row(case, speed_m_s, static_n_m, rms(dynamic[first]), rms(dynamic[settled]), largest(dynamic[settled]))


def _tasks(_: Path) -> list[partial[Row]]:
    return [partial(speeds, *case, speed_m_s) for case in CASES for speed_m_s in SPEEDS_M_S]


def _conclude(results: list[Row]) -> Findings:
    claims = [
        Claim(
            f"dynamic_{round(1e3 * speed_m_s)}",
            f"base at {1e3 * speed_m_s:g} mm/s: dynamic part of the reading once settled, RMS, worst case",
            PERCENT * largest([row.settled_rms for row in results if row.speed_m_s == speed_m_s]),
            "<=",
            bound,
            "% of range",
        )
        for speed_m_s, bound in zip(SPEEDS_M_S, (0.1, 0.3, 1.0), strict=True)
    ]
    return Findings({"speeds": results}, claims)


STUDY = Study("speeds", "static and dynamic part of the reading at several speeds", _tasks, _conclude)
