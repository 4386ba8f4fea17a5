"""Convergence of whole scenes in space in the number of segments and in the time step.

The base follows the same path in every run, that of the coarsest time step. The reading of each run is compared with that of the
next finer one at all instants at which the whisker touches in both, from `SETTLING_S` after the first touch on. If the error
decreases with the power p of the segment length or time step, so does this change.
"""

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.simulate import logged
from whisker_sim.space.model import ROOT
from whisker_sim.space.motions import SpatialPlan
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import prepared
from whisker_sim.space.truth import root_moment_n_m
from whisker_sim.whisker import Array

SEGMENTS = (12, 24, 48)
TIMESTEPS_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
SETTLING_S = 0.3
DEFAULT_SEGMENTS, DEFAULT_TIMESTEP_S = 24, 5e-4

_MOTION = {"kind": "sweep", "contact_arc_m": 0.0487, "depth_m": 0.006, "stroke_m": (0.0, 0.0, 0.003), "dwell_s": 0.5}
_SCENES: dict[str, dict[str, Any]] = {
    "straight, sphere": {"whisker": "straight", "solid": {"shape": "sphere", "radius_m": 0.02}, "direction": (0.0, 1.0, 0.2)},
    "straight, tilted pin": {
        "whisker": "straight",
        "solid": {"shape": "pin", "axis": (0.3, -0.4, 0.85)},
        "direction": (0.0, 0.9, 0.45),
    },
    "curved, sphere": {"whisker": "curved", "solid": {"shape": "sphere", "radius_m": 0.02}, "direction": (0.0, -1.0, 0.2)},
}


class Row(NamedTuple):
    """A run beside the next finer one; changes relative to the largest moment of the finer run."""

    scene: str
    refined: str
    """`segments` or `timestep_s`."""
    coarse: float
    fine: float
    change_rms: float
    change_worst: float


class Order(NamedTuple):
    """Power of the segment length or time step with which the change decreases, between the finest runs."""

    scene: str
    refined: str
    order: float


def refine(name: str, refined: str) -> list[Row]:
    """One row per pair of neighbouring runs."""
    rows = []
    values = list(SEGMENTS if refined == "segments" else TIMESTEPS_S)
    runs = [
        _moments_n_m(name, int(value), DEFAULT_TIMESTEP_S) if refined == "segments" else _moments_n_m(name, DEFAULT_SEGMENTS, value)
        for value in values
    ]
    for coarse, fine, (first, touching), (second, touching_too) in zip(values, values[1:], runs, runs[1:], strict=False):
        both = touching & touching_too
        range_n_m = np.max(np.linalg.norm(second[both], axis=1))
        change = np.linalg.norm(first - second, axis=1)[both] / range_n_m
        rows.append(Row(name, refined, coarse, fine, float(np.sqrt(np.mean(change**2))), float(np.max(change))))
    return rows


def _moments_n_m(name: str, segments: int, timestep_s: float) -> tuple[Array, Array]:
    """Moments (n, 3) at the root, and the mask (n,) of settled instants in contact."""
    scene = _scene(name, segments, timestep_s)
    plan = _scene(name, DEFAULT_SEGMENTS, TIMESTEPS_S[0]).plan(scene.solid)
    finer = round(TIMESTEPS_S[0] / timestep_s)
    coarse = np.arange(len(plan.coordinates))
    times = np.arange(finer * (len(coarse) - 1) + 1) / finer
    coordinates = np.stack([np.interp(times, coarse, column) for column in plan.coordinates.T], axis=-1)
    model, data, velocities = prepared(scene, scene.solid, SpatialPlan(plan.start_rotation, coordinates, plan.touching))
    qpos, _, sensors = logged(model, data, velocities, scene.steps_per_row)
    time_s = np.arange(len(qpos)) / scene.rate_hz
    touching = np.any(sensors[:, :3] != 0.0, axis=1)
    settled = time_s > time_s[np.argmax(touching)] + SETTLING_S
    return root_moment_n_m(scene.spatial_whisker, qpos[:, ROOT]), touching & settled


def _scene(name: str, segments: int, timestep_s: float) -> SpatialScene:
    given = _SCENES[name]
    document = {
        "format": 2,
        "name": "convergence",
        "role": "trial",
        "group": "convergence",
        "whisker": given["whisker"],
        "solid": given["solid"],
        "motion": {**_MOTION, "direction": given["direction"]},
        "segments": segments,
        "simulation": {"timestep_s": timestep_s},
    }
    return msgspec.convert(document, SpatialScene)


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(refine, name, refined) for name in _SCENES for refined in ("segments", "timestep_s")]


def _conclude(results: list[list[Row]]) -> Findings:
    orders = []
    for rows in results:
        before, last = rows[-2:]
        order = float(np.log(before.change_rms / last.change_rms) / np.log(2.0))
        orders.append(Order(last.scene, last.refined, order))
    claims = []
    for refined, default, name, words, least, most in (
        ("segments", DEFAULT_SEGMENTS, "segments", "twice the segments", 1.7, 0.1),
        ("timestep_s", DEFAULT_TIMESTEP_S, "step", "half the time step", 0.7, 0.5),
    ):
        lowest = min((order for order in orders if order.refined == refined), key=lambda order: order.order)
        claim = f"scenes in space: order of the reading's change in {name} ({lowest.scene})"
        claims.append(Claim(f"space_scenes_order_{name}", claim, lowest.order, ">=", least, ""))
        changed = [row for rows in results for row in rows if row.refined == refined and row.coarse == default]
        worst = max(changed, key=lambda row: row.change_rms)
        claim = f"scenes in space: change of the reading with {words}, RMS ({worst.scene})"
        claims.append(Claim(f"space_scenes_{name}", claim, PERCENT * worst.change_rms, "<=", most, "% of range"))
    return Findings({"space_scenes": [row for rows in results for row in rows], "space_scenes_orders": orders}, claims)


STUDY = Study("space_scenes", "scenes in space with other time steps and numbers of segments", _tasks, _conclude)
