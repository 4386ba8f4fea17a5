"""Influence of time step and number of segments on the reading of a moving whisker."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.certificate import SETTLING_S
from whisker_sim.physics.cases import largest, rms
from whisker_sim.physics.strokes import CASES, stroke
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study

TIMESTEPS_S = (0.001, 0.0005, 0.00025)
SPEED_M_S = 0.035


class Row(NamedTuple):
    """Change of the reading relative to the default of 40 segments and 0.5 ms, divided by its range."""

    case: str
    segments: int
    timestep_s: float
    change_rms: float
    change_worst: float


def steps(case: str, whisker: str, shape: str, face: str) -> list[Row]:
    """The reading for other time steps and numbers of segments.

    Each move of a plan has a whole number of time steps, so that base poses differ slightly; each reading is therefore taken
    relative to the elastica at its own base pose.
    """
    reference = stroke(whisker, shape, face, 40, 0.0005, SPEED_M_S)
    range_n_m = np.nanmax(np.abs(reference.static_n_m))
    rows = []
    for segments, timestep_s in [(40, step_s) for step_s in TIMESTEPS_S] + [(20, 0.0005), (80, 0.0005)]:
        other = stroke(whisker, shape, face, segments, timestep_s, SPEED_M_S)
        count = min(len(reference.since_s), len(other.since_s))
        change = (other.dynamic_n_m[:count] - reference.dynamic_n_m[:count]) / range_n_m
        settled = change[reference.since_s[:count] >= SETTLING_S]
        rows.append(Row(case, segments, timestep_s, rms(settled), largest(settled)))
    return rows


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(steps, *case) for case in CASES]


def _conclude(results: list[list[Row]]) -> Findings:
    rows = [row for result in results for row in result]

    def worst(segments: int, timestep_s: float) -> float:
        return PERCENT * largest([row.change_worst for row in rows if (row.segments, row.timestep_s) == (segments, timestep_s)])

    claims = [
        Claim("step_halved", "half the time step: change of the reading, worst", worst(40, 0.00025), "<=", 0.1, "% of range"),
        Claim("segments_doubled", "twice the segments: change of the reading, worst", worst(80, 0.0005), "<=", 0.1, "% of range"),
    ]
    return Findings({"steps": rows}, claims)


STUDY = Study("steps", "change of the reading with time step and segments", _tasks, _conclude)
