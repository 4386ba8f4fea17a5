"""Free-standing objects on the table against statics: at rest, under a push below the limit, and at the limit.

A cylinder of mass m and radius R under a horizontal push at the height z slides from mu m g on, and tips from m g R / z on.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from whisker_sim.free_object import FreeObject
from whisker_sim.model import MM_PER_M, N_PER_UN
from whisker_sim.physics.cases import (
    MASSES_KG,
    TIMESTEP_S,
    TOUCHED_M,
    cylinder,
    largest,
    model_with_free_object,
    slides_at_n,
    tips_at_n,
)
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.table import displacement
from whisker_sim.whisker import PRESETS, Array

LASTING_S = 10.0

_SETTLING_S = 0.2
_OUT_OF_REACH_M = 0.2
_LOW_M = 0.02
"""Height of a cylinder that slides before it tips."""
_RAMP_FROM, _RAMP_TO, _RAMP_PER_S = 0.9, 1.1, 0.1
"""Range and rate of the slowly increasing push, relative to the limit by statics."""
_GIVEN_WAY_M = 1e-6
_GIVEN_WAY_RAD = 1e-4


class Row(NamedTuple):
    """Cylinders of one mass and 30 mm diameter."""

    mass_kg: float
    drift_m: float
    """Displacement at rest within `LASTING_S`."""
    creep_m: float
    """The same under half of the push at which it would slide."""
    slides_at_n: float
    expected_slides_at_n: float
    tips_at_n: float
    """At the height of the whisker, for a cylinder of 120 mm height."""
    expected_tips_at_n: float


def standing(mass_kg: float) -> Row:
    """Leaves cylinders at rest and pushes them."""
    low, tall = cylinder(mass_kg, _LOW_M), cylinder(mass_kg)
    slides_n, tips_n = slides_at_n(low), tips_at_n(tall, TOUCHED_M)
    return Row(
        mass_kg=mass_kg,
        drift_m=_crept_m(tall, 0.0),
        creep_m=_crept_m(low, 0.5 * slides_n),
        slides_at_n=_gives_way_at_n(low, 0.5 * _LOW_M, slides_n, lambda moved: moved[0] > _GIVEN_WAY_M),
        expected_slides_at_n=slides_n,
        tips_at_n=_gives_way_at_n(tall, TOUCHED_M, tips_n, lambda moved: moved[4] > _GIVEN_WAY_RAD),
        expected_tips_at_n=tips_n,
    )


class _Pushed:
    """`free` under a push along x, `height_m` above the table."""

    def __init__(self, free: FreeObject, height_m: float) -> None:
        self._free, self._lever_mm = free, MM_PER_M * (height_m - 0.5 * free.height_m)
        self._model = model_with_free_object(PRESETS["straight"][1], free, TIMESTEP_S)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[0] = self._data.act[0] = -MM_PER_M * _OUT_OF_REACH_M
        self._body = self._model.body(free.name).id

    def hold(self, push_n: float, duration_s: float) -> Array:
        """Applies a constant push; returns the displacement: x, y, z (m), yaw and tilt (rad)."""
        force_un = push_n / N_PER_UN
        self._data.xfrc_applied[self._body, [0, 4]] = force_un, force_un * self._lever_mm
        for _ in range(round(duration_s / TIMESTEP_S)):
            mujoco.mj_step(self._model, self._data)
        return displacement(self._model, self._data.qpos, self._free.name)


def _crept_m(free: FreeObject, push_n: float) -> float:
    """Planar displacement within `LASTING_S` of a constant push at half the height, after the object has settled under it."""
    pushed = _Pushed(free, 0.5 * free.height_m)
    settled = pushed.hold(push_n, _SETTLING_S)
    moved = pushed.hold(push_n, LASTING_S) - settled
    return float(np.hypot(moved[0], moved[1]))


def _gives_way_at_n(free: FreeObject, height_m: float, expected_n: float, given_way: Callable[[Array], bool]) -> float:
    """The slowly increasing push at which the object starts to move; NaN if it does not."""
    pushed = _Pushed(free, height_m)
    settled = pushed.hold(_RAMP_FROM * expected_n, _SETTLING_S)
    every_s = 10.0 * TIMESTEP_S
    for share in np.arange(_RAMP_FROM, _RAMP_TO, _RAMP_PER_S * every_s):
        if given_way(pushed.hold(share * expected_n, every_s) - settled):
            return float(share * expected_n)
    return float("nan")


def _tasks(_: Path) -> list[partial[Row]]:
    return [partial(standing, mass_kg) for mass_kg in MASSES_KG]


def _conclude(results: list[Row]) -> Findings:
    lasting = f"{LASTING_S:g} s"
    sliding = largest([row.slides_at_n / row.expected_slides_at_n - 1.0 for row in results])
    tipping = largest([row.tips_at_n / row.expected_tips_at_n - 1.0 for row in results])
    drift_m, creep_m = largest([row.drift_m for row in results]), largest([row.creep_m for row in results])
    claims = [
        Claim("standing_drift", f"at rest for {lasting}: displacement", 1e6 * drift_m, "<=", 0.1, "um"),
        Claim(
            "standing_creep",
            f"half the push that makes it slide, for {lasting}: displacement",
            1e6 * creep_m,
            "<=",
            0.1,
            "um",
        ),
        Claim("standing_slides", "push at which it slides, against mu m g", PERCENT * sliding, "<=", 1.0, "%"),
        Claim("standing_tips", "push at which it tips, against m g R / z", PERCENT * tipping, "<=", 1.0, "%"),
    ]
    return Findings({"standing": results}, claims)


STUDY = Study("standing", "free-standing objects on a table, against statics", _tasks, _conclude)
