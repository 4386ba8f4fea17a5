"""Disturbance of free-standing objects by whiskers: displacement, tipping, and the effect of softness and curvature.

The base moves straight by 30 mm into the object and back. The approach is the angle between that motion and the line from root to
tip of the undeflected whisker: 90 degrees from the side, zero head-on. The object is met at three quarters of the lateral reach of
the whisker. The tip is either frictionless, as the rest of the whisker, or has friction and sticks when pushed head-on.

A straight whisker that sticks is a column and buckles. The elastica of the certificates does not include contact at the tip; the
reference is Euler's column with a root of stiffness k and a pinned tip: P = EI (l / L)^2 with tan l = l / (1 + l^2 EI / (k L)),
where l is between pi (no stiffness) and 4.493 (clamped).

An inextensible wire on a root without axial compliance causes an impact before it buckles. Forces are therefore means over 4 ms,
the time between two readings. A silicone root would soften that impact: head-on the study is conservative.
"""

from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np
from scipy.optimize import brentq

from whisker_sim.free_object import FreeObject
from whisker_sim.model import MM_PER_M, N_PER_UN, SENSORS
from whisker_sim.motions.base import Path as BasePath
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
from whisker_sim.shapes import Shape
from whisker_sim.simulate import roll
from whisker_sim.table import displacement
from whisker_sim.whisker import PRESETS, Array, Whisker

STRAIGHT, CURVED = PRESETS["straight"][1], PRESETS["curved"][1]
CLAMPED_N_M_RAD = 10.0
"""Root stiffness several thousand times the bending stiffness EI / L of the thickest wire."""
ROOTS_N_M_RAD = (0.17e-3, 1.7e-3, 17e-3, CLAMPED_N_M_RAD)
DIAMETERS_M = (0.2e-3, 0.25e-3, 0.3e-3, 0.4e-3, 0.5e-3)
SPEEDS_M_S = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
APPROACHES_DEG = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""At zero the direction in which a straight whisker buckles would be undetermined."""
RUBBING = 0.5
"""Coefficient of friction of a tip with friction."""

CLAIMED_KG, CLAIMED_M = 0.02, 1e-5
"""Whiskers on the soft root displace an object of this mass by less than this distance."""
SIDEWAYS_RAD = np.radians(15.0)
"""Approach above which a tip with friction slips."""

_STROKE_M, _CLEARANCE_M = 0.03, 0.001
_SPEED_M_S = 0.05
_REACH_SHARE = 0.75
_MEAN_S = 0.004
_REST_S = 0.1
_CHUNK_STEPS = 500
_IMMOVABLE_KG = 10.0
_SHORTENING_M = 0.5e-3


class Row(NamedTuple):
    """One sweep against a cylinder of 30 mm diameter and 120 mm height, met 80 mm above the table."""

    whisker: str
    root_stiffness_n_m_rad: float
    diameter_m: float
    mass_kg: float
    approach_rad: float
    tip_friction: float
    speed_m_s: float
    """Largest speed of the base, which starts from rest 1 mm before the contact."""
    peak_force_n: float
    moved_m: float
    """Largest displacement in the plane of the object's axis at the height of the whisker: translation plus effect of the tilt."""
    tilt_rad: float
    left_m: float
    """Displacement of its centre after the whisker has withdrawn."""
    fell: int
    """Whether its centre of mass passed the rim, at which the sweep ends."""
    slides_at_n: float
    tips_at_n: float


class Column(NamedTuple):
    """The straight whisker with its tip held, pushed 0.5 mm against an immovable object."""

    root_stiffness_n_m_rad: float
    held_force_n: float
    """Force at rest."""
    euler_n: float


class _Swept(NamedTuple):
    force_n: Array
    """Magnitude of the mean force over `_MEAN_S` from each step on (n,)."""
    displacement: Array
    """x, y, z (m), yaw and tilt (rad) since the first instant (n, 5)."""


def sweep(
    whisker: Whisker,
    mass_kg: float,
    approach_rad: float,
    tip_friction: float,
    concave: bool = False,
    speed_m_s: float = _SPEED_M_S,
) -> Row:
    """One sweep; the object is on the convex side of a whisker that bends to its left, or on the `concave` one."""
    free = cylinder(mass_kg)
    falls_at_rad = np.arctan2(free.object.radius_m, 0.5 * free.height_m)
    side = -1.0 if concave else 1.0
    swept = _swept(whisker, free, side * approach_rad, tip_friction, _STROKE_M, speed_m_s, falls_at_rad)
    moved = swept.displacement
    middle_m = np.hypot(moved[:, 0], moved[:, 1])
    return Row(
        whisker=whisker.name,
        root_stiffness_n_m_rad=whisker.root_stiffness_n_m_rad,
        diameter_m=whisker.root_diameter_m,
        mass_kg=mass_kg,
        approach_rad=approach_rad,
        tip_friction=tip_friction,
        speed_m_s=speed_m_s,
        peak_force_n=float(np.max(swept.force_n)),
        moved_m=float(np.max(middle_m + abs(TOUCHED_M - 0.5 * free.height_m) * moved[:, 4])),
        tilt_rad=float(np.max(moved[:, 4])),
        left_m=float(middle_m[-1]),
        fell=int(moved[-1, 4] > falls_at_rad),
        slides_at_n=slides_at_n(free),
        tips_at_n=tips_at_n(free, TOUCHED_M),
    )


def column(root_stiffness_n_m_rad: float) -> Column:
    """Pushes the straight whisker head-on, holds it, and measures the load of the buckled whisker."""
    whisker = msgspec.structs.replace(STRAIGHT, root_stiffness_n_m_rad=root_stiffness_n_m_rad)
    swept = _swept(whisker, cylinder(_IMMOVABLE_KG), np.radians(APPROACHES_DEG[0]), RUBBING, _SHORTENING_M, _SPEED_M_S, np.inf)
    # The base is at rest in the middle of the sweep.
    return Column(root_stiffness_n_m_rad, float(swept.force_n[len(swept.force_n) // 2]), euler_n(whisker))


def euler_n(whisker: Whisker) -> float:
    """Buckling load of a straight uniform `whisker` with a pinned tip."""
    bending_n_m2 = whisker.segment_m / whisker.compliance_rad_n_m(0.0, whisker.segment_m)
    softness = bending_n_m2 / (whisker.root_stiffness_n_m_rad * whisker.length_m)
    # Multiplied by the denominators, the equation remains finite.
    root = brentq(lambda x: np.sin(x) * (1.0 + softness * x * x) - x * np.cos(x), np.pi, 1.5 * np.pi, xtol=1e-14)
    return float(bending_n_m2 * (root / whisker.length_m) ** 2)


def _swept(
    whisker: Whisker,
    free: FreeObject,
    approach_rad: float,
    tip_friction: float,
    stroke_m: float,
    speed_m_s: float,
    falls_at_rad: float,
) -> _Swept:
    """Moves the base by `stroke_m` beyond the first contact, holds it, and withdraws it; stops if the object falls."""
    model = model_with_free_object(whisker, free, TIMESTEP_S, tip_friction)
    data = mujoco.MjData(model)
    touch = _first_touch(whisker, free.object, approach_rad)
    path = BasePath(touch - np.array((_CLEARANCE_M, 0.0, 0.0)), TIMESTEP_S)
    start = path.end
    path.rest(_REST_S)
    path.move(touch + np.array((stroke_m, 0.0, 0.0)), speed_m_s)
    path.rest(2.0 * _REST_S)
    path.move(start, speed_m_s)
    path.rest(_REST_S)
    poses_mm = path.poses() * (MM_PER_M, MM_PER_M, 1.0)
    data.qpos[:3] = data.act[:] = poses_mm[0]
    displacements, forces = [], []
    for states, sensors in roll(model, data, np.diff(poses_mm, axis=0) / TIMESTEP_S, _CHUNK_STEPS):
        displacements.append(displacement(model, states[:, 1 : 1 + model.nq], free.name))
        forces.append(N_PER_UN * sensors[:, SENSORS["force"]])
        if displacements[-1][-1, 4] > falls_at_rad:
            break
    moved = np.concatenate(displacements)
    # By the end of the rest the object has settled on its feet, by some hundredths of a micrometre.
    moved -= moved[round(_REST_S / TIMESTEP_S) - 1]
    return _Swept(_mean_magnitude(np.concatenate(forces), round(_MEAN_S / TIMESTEP_S)), moved)


def _mean_magnitude(forces_n: Array, steps: int) -> Array:
    """Magnitudes (n - steps + 1,) of the means of `forces_n` (n, 3) over `steps` instants."""
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(forces_n, axis=0)))
    return np.linalg.norm(sums[steps:] - sums[:-steps], axis=1) / steps


def _first_touch(whisker: Whisker, shape: Shape, approach_rad: float) -> Array:
    """Pose (x, y, yaw) of the base at which the undeflected whisker, moved along +x, first touches `shape`.

    Found by steps of the length that is certainly free.
    """
    tip = whisker.rest_point_m(whisker.length_m)
    yaw_rad = approach_rad - np.arctan2(tip[1], tip[0])
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    arc_m = np.linspace(0.0, whisker.length_m, 1601)
    start = np.array((-4.0 * whisker.length_m, -_REACH_SHARE * np.hypot(*tip) * np.sin(approach_rad)))
    points_m = start + whisker.rest_point_m(arc_m) @ np.array(((cos, sin), (-sin, cos)))
    way_m = 0.0
    while (free_m := np.min(shape.closest(points_m + np.array((way_m, 0.0)))[1] - whisker.radius_m(arc_m))) > 1e-7:
        way_m += free_m
    return np.array((start[0] + way_m, start[1], yaw_rad))


def _stiffer(whisker: Whisker, times: float, name: str) -> Whisker:
    """`whisker` with the stiffness of root and wire multiplied by `times`."""
    diameter_m = whisker.root_diameter_m * times**0.25
    return msgspec.structs.replace(
        whisker,
        name=name,
        root_stiffness_n_m_rad=times * whisker.root_stiffness_n_m_rad,
        root_diameter_m=diameter_m,
        tip_diameter_m=diameter_m,
    )


def _named(whisker: Whisker, name: str) -> Whisker:
    return msgspec.structs.replace(whisker, name=name)


def _with(whisker: Whisker, root_stiffness_n_m_rad: float, diameter_m: float) -> Whisker:
    return msgspec.structs.replace(
        whisker, root_stiffness_n_m_rad=root_stiffness_n_m_rad, root_diameter_m=diameter_m, tip_diameter_m=diameter_m
    )


WHISKERS = (
    (_named(STRAIGHT, "straight"), False),
    (_named(CURVED, "curved, convex side"), False),
    (_named(CURVED, "curved, concave side"), True),
    (_stiffer(CURVED, 10.0, "ten times stiffer, convex side"), False),
)
"""Whiskers that approach from all directions, and whether they meet the object with the concave side."""

_BY_APPROACH = [
    partial(sweep, whisker, CLAIMED_KG, float(np.radians(approach_deg)), tip_friction, concave)
    for tip_friction in (0.0, RUBBING)
    for whisker, concave in WHISKERS
    for approach_deg in APPROACHES_DEG
]
_BY_STIFFNESS = [
    partial(sweep, _with(whisker, root_n_m_rad, diameter_m), mass_kg, float(np.radians(approach_deg)), tip_friction)
    for whisker, approach_deg, tip_friction in ((CURVED, 90.0, 0.0), (STRAIGHT, APPROACHES_DEG[0], RUBBING))
    for mass_kg in MASSES_KG
    for root_n_m_rad in ROOTS_N_M_RAD
    for diameter_m in DIAMETERS_M
]
_BY_SPEED = [
    partial(sweep, whisker, mass_kg, float(np.radians(APPROACHES_DEG[0])), RUBBING, speed_m_s=speed_m_s)
    for mass_kg in MASSES_KG
    for whisker, _ in WHISKERS[:2]
    for speed_m_s in SPEEDS_M_S
]
_COLUMNS = [partial(column, root_n_m_rad) for root_n_m_rad in ROOTS_N_M_RAD]


def _tasks(_: Path) -> list[partial[Row] | partial[Column]]:
    return [*_BY_APPROACH, *_BY_STIFFNESS, *_BY_SPEED, *_COLUMNS]


def _conclude(results: list[Row | Column]) -> Findings:
    rest = iter(results)
    by_approach, by_stiffness, by_speed, columns = (
        list(islice(rest, len(tasks))) for tasks in (_BY_APPROACH, _BY_STIFFNESS, _BY_SPEED, _COLUMNS)
    )
    soft = [
        row
        for row in by_approach + by_stiffness + by_speed
        if (row.root_stiffness_n_m_rad, row.mass_kg) == (ROOTS_N_M_RAD[0], CLAIMED_KG)
    ]
    curved = [row for row in soft if row.whisker.startswith("curved")]
    straight = [row for row in soft if row.whisker == "straight"]
    slipping = [row for row in straight if row.approach_rad >= SIDEWAYS_RAD or row.tip_friction == 0.0]
    # For the preset's wire at one speed only: among many sweeps, one that displaces the object would always be found.
    head_on = {
        row.whisker: [row] for row in by_approach if row.approach_rad == np.radians(APPROACHES_DEG[0]) and row.tip_friction > 0.0
    }

    def moved_mm(rows: list[Row]) -> float:
        return 1e3 * largest([row.moved_m for row in rows])

    mass, bound_mm = f"object of {1e3 * CLAIMED_KG:g} g", 1e3 * CLAIMED_M
    buckling = largest([row.held_force_n / row.euler_n - 1.0 for row in columns])
    claims = [
        Claim(
            "disturbance_curved",
            f"curved whisker, soft root, any approach and speed: {mass} moves",
            moved_mm(curved),
            "<=",
            bound_mm,
            "mm",
        ),
        Claim(
            "disturbance_straight",
            f"straight whisker, soft root, from the side (15 degrees and more) or with a frictionless tip: {mass} moves",
            moved_mm(slipping),
            "<=",
            bound_mm,
            "mm",
        ),
        Claim(
            "disturbance_head_on",
            f"straight whisker, soft root, head-on at {1e3 * _SPEED_M_S:g} mm/s with a tip that rubs: {mass} does move",
            moved_mm(head_on["straight"]),
            ">=",
            bound_mm,
            "mm",
        ),
        Claim(
            "disturbance_stiffer",
            f"curved whisker, ten times stiffer, head-on at {1e3 * _SPEED_M_S:g} mm/s with a tip that rubs: {mass} does move",
            moved_mm(head_on[WHISKERS[-1][0].name]),
            ">=",
            bound_mm,
            "mm",
        ),
        Claim(
            "disturbance_buckling",
            "straight whisker, tip held: load once buckled, against Euler's",
            PERCENT * buckling,
            "<=",
            1.0,
            "%",
        ),
    ]
    tables = {
        "disturbance_approach": by_approach,
        "disturbance_stiffness": by_stiffness,
        "disturbance_speed": by_speed,
        "disturbance_buckling": columns,
    }
    return Findings(tables, claims)


STUDY = Study("disturbance", "displacement of free-standing objects by whiskers", _tasks, _conclude)
