"""Natural frequencies of the free whisker on its compliant root, against the Euler-Bernoulli beam.

A uniform beam of length L with a free end and a root of rotational stiffness k vibrates at
w_i = lambda_i^2 sqrt(EI / rho A) / L^2 with (1 + cos l cosh l) k L / EI = l (sin l cosh l - cos l sinh l).
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from whisker_sim.model import build_model
from whisker_sim.physics.cases import FAR_AWAY
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.whisker import PRESETS, Array, Whisker

SEGMENTS = (10, 20, 40, 80)
MODES = 3


class Row(NamedTuple):
    """One natural frequency."""

    segments: int
    mode: int
    chain_hz: float
    beam_hz: float
    error: float
    """Relative."""


def beam_hz(whisker: Whisker, modes: int) -> Array:
    """The first natural frequencies (modes,) of a uniform straight `whisker`."""
    bending_n_m2 = whisker.youngs_modulus_pa * np.pi * whisker.root_diameter_m**4 / 64.0
    line_density_kg_m = whisker.density_kg_m3 * np.pi * whisker.root_diameter_m**2 / 4.0
    stiffness = whisker.root_stiffness_n_m_rad * whisker.length_m / bending_n_m2

    def characteristic(x: float) -> float:
        """The equation divided by cosh x, which keeps it bounded."""
        return (1.0 / np.cosh(x) + np.cos(x)) * stiffness - x * (np.sin(x) - np.cos(x) * np.tanh(x))

    grid = np.linspace(0.05, np.pi * (modes + 1), 200 * (modes + 1))
    values = characteristic(grid)
    brackets = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[:modes]
    roots = np.array([brentq(characteristic, grid[index], grid[index + 1], xtol=1e-14) for index in brackets])
    return roots**2 / (2.0 * np.pi) * np.sqrt(bending_n_m2 / line_density_kg_m) / whisker.length_m**2


def chain_hz(whisker: Whisker, modes: int) -> Array:
    """The first natural frequencies (modes,) of the undamped chain on a fixed base."""
    model = build_model(whisker, FAR_AWAY, 0.0005)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    squares = eigh(np.diag(model.jnt_stiffness[3:]), mass[3:, 3:], eigvals_only=True, subset_by_index=(0, modes - 1))
    return np.sqrt(squares) / (2.0 * np.pi)


def _frequencies(segments: int) -> list[Row]:
    whisker = msgspec.structs.replace(PRESETS["straight"][1], segments=segments)
    pairs = zip(chain_hz(whisker, MODES), beam_hz(whisker, MODES), strict=True)
    return [
        Row(segments, mode, float(chain), float(beam), float(chain / beam - 1.0)) for mode, (chain, beam) in enumerate(pairs, 1)
    ]


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(_frequencies, segments) for segments in SEGMENTS]


def _conclude(results: list[list[Row]]) -> Findings:
    rows = [row for result in results for row in result]
    claims = [
        Claim(
            f"frequency_{row.mode}",
            f"natural frequency {row.mode}, 40 segments, against the beam's {row.beam_hz:.2f} Hz",
            PERCENT * abs(row.error),
            "<=",
            1.0,
            "%",
        )
        for row in rows
        if row.segments == 40
    ]
    return Findings({"frequencies": rows}, claims)


STUDY = Study("frequencies", "natural frequencies against the analytic beam", _tasks, _conclude)
