"""Ringing after release: frequency, decay and energy of the free whisker.

The whisker is bent as by a contact at 60 % of its length and released with its base held. With the implicit time step h, a hinge of
damping time tau (`damping_s`) dissipates like one of damping time h + tau (Kelvin-Voigt model). A mode of angular frequency w thus
has the damping ratio zeta = w (tau + h) / 2, and its amplitude decays with the time constant 1 / (zeta w) = 2 / (w^2 (tau + h)).
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np

from whisker_sim.model import NNM_PER_NM, build_model
from whisker_sim.physics.cases import FAR_AWAY, largest
from whisker_sim.physics.frequencies import beam_hz
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.whisker import PRESETS, Array, Whisker

PUBLISHED_DYING_S = 1.4
"""Time after which the ringing of Lin et al. (IROS 2022) has decayed, read from their plot."""
PUBLISHED_FALL = 675.0 / 5.0
"""Ratio of the initial amplitude to the noise at rest in the same plot."""

_TIMESTEP_S = 0.0005
_DURATION_S = 4.0
_BENT_N_M = 40e-6
_HIGH_MODES_GONE_S = 0.2
_DRAWN_S = 1.6
_DRAWN_EVERY = 13
"""Stride of the steps in the table of the signal, which is for plotting: about twenty instants per period."""


class Row(NamedTuple):
    """One release of the straight whisker."""

    case: str
    timestep_s: float
    damping_s: float
    frequency_hz: float
    beam_hz: float
    amplitude_n_m: float
    """Amplitude of the first mode's reading at the release."""
    decay_s: float
    """Time constant of the amplitude."""
    expected_decay_s: float
    damping_ratio: float
    expected_damping_ratio: float
    dying_s: float
    """Time in which the amplitude decays by the factor `PUBLISHED_FALL`."""
    published_dying_s: float
    published_fall: float
    energy_growth: float
    """Largest growth of the energy in a step, relative to the initial energy."""


class Instant(NamedTuple):
    """One instant of the ringing."""

    case: str
    t_s: float
    """Time since the release."""
    moment_n_m: float


def release(case: str, damping_s: float, timestep_s: float) -> tuple[Row, list[Instant]]:
    """Releases the whisker and evaluates its ringing; also returns the reading."""
    whisker = msgspec.structs.replace(PRESETS["straight"][1], damping_s=damping_s)
    time_s, reading_n_m, energy = free_vibration(whisker, timestep_s, _BENT_N_M, _DURATION_S)
    expected_hz = float(beam_hz(whisker, 1)[0])
    ringing = time_s > _HIGH_MODES_GONE_S
    frequency_hz, amplitude_n_m, decay_s = fit(time_s[ringing], reading_n_m[ringing])
    omega_rad_s = 2.0 * np.pi * expected_hz
    expected_damping_ratio = 0.5 * omega_rad_s * (damping_s + timestep_s)
    row = Row(
        case=case,
        timestep_s=timestep_s,
        damping_s=damping_s,
        frequency_hz=frequency_hz,
        beam_hz=expected_hz,
        amplitude_n_m=amplitude_n_m,
        decay_s=decay_s,
        expected_decay_s=1.0 / (expected_damping_ratio * omega_rad_s),
        damping_ratio=1.0 / (2.0 * np.pi * frequency_hz * decay_s),
        expected_damping_ratio=expected_damping_ratio,
        dying_s=decay_s * float(np.log(PUBLISHED_FALL)),
        published_dying_s=PUBLISHED_DYING_S,
        published_fall=PUBLISHED_FALL,
        energy_growth=float(np.max(np.diff(energy)) / energy[0]),
    )
    drawn = zip(time_s[::_DRAWN_EVERY].tolist(), reading_n_m[::_DRAWN_EVERY].tolist(), strict=True)
    return row, [Instant(case, t_s, moment_n_m) for t_s, moment_n_m in drawn if t_s <= _DRAWN_S]


def free_vibration(whisker: Whisker, timestep_s: float, bent_n_m: float, duration_s: float) -> tuple[Array, Array, Array]:
    """Releases the whisker, bent until the moment at its root is `bent_n_m`.

    Returns time, reading, and mechanical energy of whisker, base and the servos of the base after every step, (n,) each.
    """
    model = build_model(whisker, FAR_AWAY, timestep_s)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    hinges_m = (np.arange(whisker.segments) + 0.5) * whisker.segment_m
    share = np.concatenate(([1.0], np.maximum(1.0 - hinges_m / (0.6 * whisker.length_m), 0.0)))
    data.qpos[3:] = -NNM_PER_NM * bent_n_m * share / model.jnt_stiffness[3:]
    servo = model.actuator_gainprm[:, 0]
    rotation, energy = [], []
    for _ in range(round(duration_s / timestep_s)):
        mujoco.mj_step(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        rotation.append(data.qpos[3])
        energy.append(np.sum(data.energy) + 0.5 * servo @ (data.act - data.qpos[:3]) ** 2)
    time_s = timestep_s * np.arange(1, len(rotation) + 1)
    return time_s, whisker.root_stiffness_n_m_rad * np.array(rotation), np.array(energy)


def fit(time_s: Array, signal: Array) -> tuple[float, float, float]:
    """Frequency of a decaying oscillation from its zero crossings; initial amplitude and time constant from its extrema."""
    turns = np.flatnonzero(np.sign(signal[1:]) != np.sign(signal[:-1]))
    share = signal[turns] / (signal[turns] - signal[turns + 1])
    crossings_s = time_s[turns] + share * (time_s[turns + 1] - time_s[turns])
    frequency_hz = (len(crossings_s) - 1) / (2.0 * (crossings_s[-1] - crossings_s[0]))
    pieces = zip(turns[:-1] + 1, turns[1:] + 1, strict=True)
    peaks = np.array([start + np.argmax(np.abs(signal[start:end])) for start, end in pieces])
    slope, start = np.polyfit(time_s[peaks], np.log(np.abs(signal[peaks])), 1)
    return float(frequency_hz), float(np.exp(start)), float(-1.0 / slope)


def _tasks(_: Path) -> list[partial[tuple[Row, list[Instant]]]]:
    return [
        partial(release, "preset", PRESETS["straight"][1].damping_s, _TIMESTEP_S),
        partial(release, "undamped hinges", 0.0, _TIMESTEP_S),
        partial(release, "undamped hinges, half the time step", 0.0, 0.5 * _TIMESTEP_S),
    ]


def _conclude(results: list[tuple[Row, list[Instant]]]) -> Findings:
    rows = [row for row, _ in results]
    preset = rows[0]
    decay_error = largest([row.decay_s / row.expected_decay_s - 1.0 for row in rows])
    claims = [
        Claim(
            "ringing_frequency",
            f"ringing after release, against the beam's {preset.beam_hz:.2f} Hz",
            PERCENT * largest([row.frequency_hz / row.beam_hz - 1.0 for row in rows]),
            "<=",
            1.0,
            "%",
        ),
        Claim("ringing_decay", "decay of the ringing, against 2 / (w^2 (tau + h))", PERCENT * decay_error, "<=", 3.0, "%"),
        Claim(
            "ringing_published",
            f"preset, damping_s = {preset.damping_s:.2e}: time to die down, against the published {PUBLISHED_DYING_S} s",
            PERCENT * abs(preset.dying_s / PUBLISHED_DYING_S - 1.0),
            "<=",
            5.0,
            "%",
        ),
        Claim(
            "energy_growth",
            "free vibration: largest growth of the energy in a step, share of the first",
            float(np.max([row.energy_growth for row in rows])),
            "<=",
            1e-9,
            "",
        ),
    ]
    drawn = [instant for _, instants in results[:2] for instant in instants]
    return Findings({"ringing": rows, "ringing_signal": drawn}, claims)


STUDY = Study("ringing", "frequency, decay and energy of the ringing after release", _tasks, _conclude)
