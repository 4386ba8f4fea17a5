"""Statics: the chain at rest against the elastica, for 10 to 160 segments.

MuJoCo's model relaxes to rest, with high damping, from a guess near the solution. Its contact is a hundred times stiffer than that
of the traces, so that the remaining error is that of the chain. The error depends on the position of the contact between two
hinges; hence several positions are spread over the longest segment.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np

from whisker_sim.elastica import Touching, touching
from whisker_sim.errors import SimulationError
from whisker_sim.model import MM_PER_M, NNM_PER_NM, SENSORS, build_model
from whisker_sim.motions import Stage
from whisker_sim.physics.cases import WHISKERS, largest, rms
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.shapes import AnyShape
from whisker_sim.shapes.circle import Circle
from whisker_sim.shapes.pin import Pin
from whisker_sim.shapes.polygon import Polygon
from whisker_sim.shapes.rectangle import Rectangle
from whisker_sim.truth import CenterLine, nearest_contact
from whisker_sim.whisker import Array, Whisker

SEGMENTS = (10, 20, 40, 80, 160)
OBJECTS: dict[str, AnyShape] = {
    "pin": Pin(),
    "circle_15": Circle(radius_m=0.015),
    "circle_50": Circle(radius_m=0.05),
    "corner": Rectangle(width_m=0.03, height_m=0.03, yaw_rad=np.radians(20.0)),
}
DEPTHS_M = {"shallow": 0.002, "large": 0.01}
_PLACES = 9
PLACES_M = 0.046 + 0.008 * (np.arange(_PLACES) + 0.5) / _PLACES
"""Arc lengths at which the undeflected whisker first faces the object, spread over one of ten segments. Because their number is
odd, they are also evenly spread over each of the shorter segments and their capsules, whose lengths are successive halves."""

_FIGURES = {"moment_error": "moment", "surface_error_m": "surface", "arc_error_m": "arc", "tip_error_m": "tip"}
_DEFAULT_SEGMENTS = 40
_SMALLEST_ERROR = 1e-12
_TIMESTEP_S = 0.001
_REST_S = 0.25
_DAMPING_S = 0.01
_DEPTH_STEP_M = 0.001
_HARD_SOLREF_S = 1e-4
_HARD_SOLIMP = 0.9999
_LARGEST_RATE = 1e-6
"""Joint rates (mm/s and rad/s) below which the chain is at rest."""


class Row(NamedTuple):
    """Error of the chain at rest, RMS over the positions."""

    whisker: str
    object: str
    deflection: str
    segments: int
    segment_m: float
    moment_n_m: float
    """Mean moment of the elastica over the positions."""
    moment_error: float
    """Relative."""
    surface_error_m: float
    arc_error_m: float
    tip_error_m: float
    penetration_m: float
    """Largest."""


class Order(NamedTuple):
    """Order of convergence of an error in the segment length, over all objects and deflections."""

    whisker: str
    figure: str
    order: float


class Rest(NamedTuple):
    """A chain at rest in contact with an object, and its errors relative to the elastica."""

    moment_n_m: float
    moment_error: float
    surface_error_m: float
    arc_error_m: float
    tip_error_m: float
    penetration_m: float


def face_of(whisker: Whisker, shape: AnyShape) -> int:
    """Side on which the whisker meets the object: for corners the right, convex side of a whisker curved to the left."""
    return -1 if isinstance(shape, Rectangle) and whisker.curvature[0].curvature_per_m > 0.0 else 1


def pushed(stage: Stage, depth_m: float) -> tuple[Array, Touching]:
    """Base poses (n, 3) for which the object deflects the whisker by `depth_m` at `PLACES_M`, and the elastica there.

    Newton's method follows the depth in steps, starting from the small deflection d under a force F at s, d = F s^2 (s / 3 EI + 1 /
    k). For an initial guess inside a polygon it would converge to the wrong face; therefore a disc of radius zero represents the
    corner.
    """
    whisker, shape = stage.whisker, stage.shape
    if isinstance(shape, Polygon):
        angle_rad = float(whisker.rest_angle_rad(PLACES_M[0]))
        corner_m = shape.support_m(stage.face * np.array((np.sin(angle_rad), -np.cos(angle_rad))))
        shape = Circle(radius_m=1e-12, center_m=(float(corner_m[0]), float(corner_m[1])))
    bending_rad_n_m = np.array([whisker.compliance_rad_n_m(0.0, place_m) for place_m in PLACES_M])
    compliance_m_n = PLACES_M**2 * (bending_rad_n_m / 3.0 + 1.0 / whisker.root_stiffness_n_m_rad)
    steps_m = np.linspace(0.0, depth_m, 1 + int(np.ceil(depth_m / _DEPTH_STEP_M)))[1:]
    before, guess = np.stack((PLACES_M, np.zeros_like(PLACES_M))), np.stack((PLACES_M, steps_m[0] / compliance_m_n))
    for step_m in steps_m:
        poses = np.array([stage.base_pose(place_m, -step_m) for place_m in PLACES_M])
        exact = touching(whisker, shape, stage.face, poses, *guess)
        if not np.all(exact.solved):
            raise SimulationError(f"{whisker.name}: the elastica finds no contact at a depth of {step_m} m")
        now = np.stack((exact.arc_m, exact.force_n))
        before, guess = now, 2.0 * now - before
    return poses, exact


def relaxed(whisker: Whisker, stage: Stage, pose: Array, near: Touching) -> Rest:
    """Relaxes the chain on the object of the stage, with its base held at `pose` (1, 3), and compares it with the elastica.

    `near` is the elastica at that pose, from which the chain starts.

    Raises `SimulationError` if the chain does not come to rest, or has no contact on its side.
    """
    model = build_model(whisker, stage.shape, _TIMESTEP_S)
    model.dof_damping[3:] = _DAMPING_S * model.jnt_stiffness[3:]
    data = mujoco.MjData(model)
    data.qpos[:3] = data.act[:] = pose[0] * (MM_PER_M, MM_PER_M, 1.0)

    hinges_m = (np.arange(whisker.segments) + 0.5) * whisker.segment_m
    # The bending moment decreases about linearly. An excess of a tenth makes the chain start without contact, on the right side.
    share = np.maximum(1.0 - hinges_m / near.arc_m[0], 0.0)
    data.qpos[3:] = 1.1 * NNM_PER_NM * near.moment_n_m[0] * np.concatenate(([1.0], share)) / model.jnt_stiffness[3:]
    mujoco.mj_step(model, data, nstep=round(_REST_S / _TIMESTEP_S))
    # From rest on the soft contact, the stiff one is stable. MuJoCo would soften it to twice the time step.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    model.geom_solref[:, 0] = _HARD_SOLREF_S
    model.geom_solimp[:, :2] = _HARD_SOLIMP
    mujoco.mj_step(model, data, nstep=round(_REST_S / _TIMESTEP_S))
    mujoco.mj_forward(model, data)
    if not np.max(np.abs(data.qvel)) < _LARGEST_RATE:
        raise SimulationError(f"{whisker.name}, {whisker.segments} segments: the chain does not come to rest")

    # The whisker's force displaces the base by nanometres; the elastica is solved for the displaced base. Where the elastica
    # touches, the chain penetrates by nanometres, so the chain is moved outwards by the penetration, along the normal.
    pose = data.qpos[None, :3] / (MM_PER_M, MM_PER_M, 1.0)
    sunk = nearest_contact(CenterLine.from_joints(whisker, pose, data.qpos[None, 3:]), stage.shape)
    outward_m = sunk.contact_m - sunk.surface_m
    penetration_m = -float(data.sensordata[SENSORS["distance"]]) / MM_PER_M
    pose[:, :2] += penetration_m * outward_m / np.hypot(*outward_m[0])
    line = CenterLine.from_joints(whisker, pose, data.qpos[None, 3:])
    found = nearest_contact(line, stage.shape)
    exact = touching(whisker, stage.shape, stage.face, pose, near.arc_m, near.force_n)
    if not (exact.solved[0] and penetration_m > 0.0):
        raise SimulationError(f"{whisker.name}, {whisker.segments} segments: no contact on the whisker's side")
    moment_n_m = whisker.root_stiffness_n_m_rad * data.qpos[3]
    turn_rad = exact.tangent_rad[0] - float(whisker.rest_angle_rad(exact.arc_m[0]))
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    beyond_m = whisker.rest_point_m(whisker.length_m) - whisker.rest_point_m(exact.arc_m[0])
    # Beyond the contact the whisker is unloaded and keeps its undeflected shape.
    tip_m = exact.contact_m[0] + (cos * beyond_m[0] - sin * beyond_m[1], sin * beyond_m[0] + cos * beyond_m[1])
    return Rest(
        exact.moment_n_m[0],
        moment_n_m / exact.moment_n_m[0] - 1.0,
        float(np.hypot(*(found.surface_m - exact.surface_m)[0])),
        float(found.arc_m[0] - exact.arc_m[0]),
        float(np.hypot(*(line.points_m[0, -1] - tip_m))),
        penetration_m,
    )


def converge(whisker_name: str, object_name: str, depth_name: str) -> list[Row]:
    """One row per number of segments."""
    whisker, shape = WHISKERS[whisker_name], OBJECTS[object_name]
    face = face_of(whisker, shape)
    stage = Stage(whisker, shape, face, _TIMESTEP_S, None, np.random.default_rng())
    poses, exact = pushed(stage, DEPTHS_M[depth_name])
    rows = []
    for segments in SEGMENTS:
        chain = msgspec.structs.replace(whisker, segments=segments)
        rests = [relaxed(chain, stage, poses[[index]], exact[index]) for index in range(len(PLACES_M))]
        moment, *errors, penetration = np.array(rests).T
        rows.append(
            Row(
                whisker_name,
                object_name,
                depth_name,
                segments,
                chain.segment_m,
                float(np.mean(moment)),
                *map(rms, errors),
                float(np.max(penetration)),
            )
        )
    return rows


def order(rows: list[Row], figure: str) -> float:
    """Order of convergence of `figure` in the segment length: slope of the logarithms, with equal weights of all cases.

    At a corner the contact on the object is the corner itself, regardless of the chain; such rows are ignored.
    """
    used = [row for row in rows if getattr(row, figure) > _SMALLEST_ERROR]
    lengths_m = sorted({row.segment_m for row in used})
    errors = [np.mean([np.log(getattr(row, figure)) for row in used if row.segment_m == length_m]) for length_m in lengths_m]
    return float(np.polyfit(np.log(lengths_m), errors, 1)[0])


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(converge, whisker, shape, depth) for whisker in WHISKERS for shape in OBJECTS for depth in DEPTHS_M]


def _conclude(results: list[list[Row]]) -> Findings:
    rows = [row for case in results for row in case]
    orders = [
        Order(whisker, figure, order([row for row in rows if row.whisker == whisker], field))
        for whisker in WHISKERS
        for field, figure in _FIGURES.items()
    ]
    claims = []
    for fit in orders:
        claim = f"{fit.whisker} chain at rest: order of the {fit.figure}'s error in segment length"
        claims.append(Claim(f"order_{fit.whisker}_{fit.figure}", claim, fit.order, ">=", 1.8, ""))
    for whisker in WHISKERS:
        default = [row for row in rows if row.whisker == whisker and row.segments == _DEFAULT_SEGMENTS]
        for field, scale, bound, unit in (
            ("moment_error", PERCENT, 0.05, "%"),
            ("surface_error_m", 1e3, 0.03, "mm"),
            ("arc_error_m", 1e3, 0.02, "mm"),
        ):
            claim = f"{whisker} chain at rest, {_DEFAULT_SEGMENTS} segments: {_FIGURES[field]}, worst case"
            worst = scale * largest([getattr(row, field) for row in default])
            claims.append(Claim(f"rest_{whisker}_{_FIGURES[field]}", claim, worst, "<=", bound, unit))
    return Findings({"convergence": rows, "convergence_orders": orders}, claims)


STUDY = Study("convergence", "chain at rest against the elastica, 10 to 160 segments", _tasks, _conclude)
