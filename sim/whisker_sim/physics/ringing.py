"""Ringing after release: frequency, decay and energy of the free whisker.

The whisker is bent as by a contact at 60 % of its length, let go with its base held, and rings. A hinge with the damping time tau
(`damping_s`) and the implicit time step h take energy like one with a damping time of h + tau, so the first mode's amplitude falls
with the time constant 2 / (w^2 (h + tau)).
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np

from whisker_sim.model import NNM_PER_NM, build_model
from whisker_sim.physics.cases import FAR_AWAY
from whisker_sim.physics.frequencies import beam_hz
from whisker_sim.physics.study import PERCENT, Bar, Findings, Study
from whisker_sim.whisker import PRESETS, Array, Whisker

PUBLISHED_DYING_S = 1.4
"""Time after which the ringing of Lin et al. (IROS 2022) has died, as read off their plot."""
PUBLISHED_FALL = 675.0 / 5.0
"""Ratio of the amplitude at the start to the noise at rest in the same plot."""

_TIMESTEP_S = 0.0005
_DURATION_S = 4.0
_BENT_N_M = 40e-6
_HIGH_MODES_GONE_S = 0.2


class Row(NamedTuple):
    """One release of the straight whisker."""

    case: str
    timestep_s: float
    damping_s: float
    frequency_hz: float
    beam_hz: float
    decay_s: float
    """Time constant of the amplitude."""
    expected_decay_s: float
    dying_s: float
    """Time in which the amplitude falls by `PUBLISHED_FALL`."""
    energy_growth: float
    """Largest growth of the energy in a step, relative to the energy at the start."""


def release(case: str, damping_s: float, timestep_s: float) -> Row:
    """Lets the whisker go and measures."""
    whisker = msgspec.structs.replace(PRESETS["straight"][1], damping_s=damping_s)
    reading, energy = _free_vibration(whisker, timestep_s)
    expected_hz = float(beam_hz(whisker, 1)[0])
    start = round(_HIGH_MODES_GONE_S / timestep_s)
    frequency_hz, decay_s = _fit(reading[start:], timestep_s)
    omega_rad_s = 2.0 * np.pi * expected_hz
    return Row(
        case,
        timestep_s,
        damping_s,
        frequency_hz,
        expected_hz,
        decay_s,
        2.0 / (omega_rad_s**2 * (timestep_s + damping_s)),
        decay_s * float(np.log(PUBLISHED_FALL)),
        float(np.max(np.diff(energy)) / energy[0]),
    )


def _free_vibration(whisker: Whisker, timestep_s: float) -> tuple[Array, Array]:
    """Rotation of the root and mechanical energy of whisker, base and the base's servos, after every step."""
    model = build_model(whisker, FAR_AWAY, timestep_s)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    hinges_m = (np.arange(whisker.segments) + 0.5) * whisker.segment_m
    share = np.concatenate(([1.0], np.maximum(1.0 - hinges_m / (0.6 * whisker.length_m), 0.0)))
    data.qpos[3:] = -NNM_PER_NM * _BENT_N_M * share / model.jnt_stiffness[3:]
    servo = model.actuator_gainprm[:, 0]
    rotation, energy = [], []
    for _ in range(round(_DURATION_S / timestep_s)):
        mujoco.mj_step(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        rotation.append(data.qpos[3])
        energy.append(np.sum(data.energy) + 0.5 * servo @ (data.act - data.qpos[:3]) ** 2)
    return np.array(rotation), np.array(energy)


def _fit(signal: Array, timestep_s: float) -> tuple[float, float]:
    """Frequency of a decaying oscillation from its zero crossings, and its time constant from its extremes."""
    turns = np.flatnonzero(np.sign(signal[1:]) != np.sign(signal[:-1]))
    crossings = turns + signal[turns] / (signal[turns] - signal[turns + 1])
    frequency_hz = (len(crossings) - 1) / (2.0 * timestep_s * (crossings[-1] - crossings[0]))
    pieces = zip(turns[:-1] + 1, turns[1:] + 1, strict=True)
    peaks = np.array([start + np.argmax(np.abs(signal[start:end])) for start, end in pieces])
    slope = np.polyfit(timestep_s * peaks, np.log(np.abs(signal[peaks])), 1)[0]
    return float(frequency_hz), float(-1.0 / slope)


def damping_of_the_published_decay() -> float:
    """Damping time of the hinges with which the straight whisker rings as long as the published one."""
    omega_rad_s = 2.0 * np.pi * float(beam_hz(PRESETS["straight"][1], 1)[0])
    return float(2.0 * np.log(PUBLISHED_FALL) / (omega_rad_s**2 * PUBLISHED_DYING_S) - _TIMESTEP_S)


def _tasks(_: Path) -> list[partial[Row]]:
    return [
        partial(release, "preset", 0.0, _TIMESTEP_S),
        partial(release, "half the time step", 0.0, 0.5 * _TIMESTEP_S),
        partial(release, "published decay", damping_of_the_published_decay(), _TIMESTEP_S),
    ]


def _conclude(results: list[Row]) -> Findings:
    preset, _, published = results
    decay_error = max(abs(row.decay_s / row.expected_decay_s - 1.0) for row in results)
    bars = [
        Bar(
            "ringing_frequency",
            f"ringing after release, against the beam's {preset.beam_hz:.2f} Hz",
            PERCENT * abs(preset.frequency_hz / preset.beam_hz - 1.0),
            "<=",
            1.0,
            "%",
        ),
        Bar("ringing_decay", "decay of the ringing, against 2 / (w^2 (h + tau))", PERCENT * decay_error, "<=", 3.0, "%"),
        Bar(
            "ringing_published",
            f"damping_s = {published.damping_s:.2e}: time to die down, against the published {PUBLISHED_DYING_S} s",
            PERCENT * abs(published.dying_s / PUBLISHED_DYING_S - 1.0),
            "<=",
            5.0,
            "%",
        ),
        Bar(
            "energy_growth",
            "free vibration: largest growth of the energy in a step, share of the first",
            max(row.energy_growth for row in results),
            "<=",
            1e-9,
            "",
        ),
    ]
    return Findings({"ringing": results}, bars)


STUDY = Study("ringing", "frequency, decay and energy of the ringing after release", _tasks, _conclude)
