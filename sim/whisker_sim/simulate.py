"""Runs a scene: plans the motion, steps the physics, reads the truth."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np
from numpy.typing import NDArray

from whisker_sim.documents import located
from whisker_sim.errors import SimulationError
from whisker_sim.model import MM_PER_M, N_PER_UN, SENSORS, build_model
from whisker_sim.motions import Plan
from whisker_sim.motions.base import REST_S
from whisker_sim.progress import report_share
from whisker_sim.runs import Run
from whisker_sim.scene import Scene
from whisker_sim.truth import CenterLine, ContactTruth, nearest_contact
from whisker_sim.whisker import Array

# MuJoCo would write its warnings to a log file in the working directory; here they fail the trace.
_warnings: list[str] = []
mujoco.set_mju_user_warning(_warnings.append)

_CHUNK_STEPS = 2000
_APART_M = 1e-3
"""Loaded places farther from one another than this are places of their own. The softness of the contact spreads a single one over
some tenths of a millimetre."""
_PENETRATION_LIMIT_M = 20e-6
"""Deeper than this the contact is not the rigid one that a scene stands for."""


@dataclass(frozen=True)
class Simulated:
    """One trace: n rows at the logging rate. World and SI units unless the name says otherwise."""

    time_s: Array
    base_pose: Array
    """(n, 3): x, y, yaw."""
    base_twist: Array
    """(n, 3): velocity along the base's x and y, angular velocity; in Base."""
    rotations_rad: Array
    """(n, N + 1): rotation of the root, then of the hinges."""
    touching: NDArray[np.bool_]
    force_n: Array
    nearest: NDArray[np.intp]
    """Index of the object nearest to the whisker (n,): zero where there is one alone."""
    truth: ContactTruth
    """Of every row, for the nearest object; it has a meaning where the whisker touches."""
    split: NDArray[np.bool_]
    """Whether the whisker touches in places apart from one another (n,): the one contact of `truth` is then but the nearest."""
    penetration_m: Array
    """Penetration of the two surfaces (n,), zero while free."""


def simulate(run: Run) -> Simulated:
    """Simulates `run`.

    Raises `InputError` where the motion does not fit the scene, and `SimulationError` where the physics fails or the contact
    is not what the motion promises.
    """
    scene = run.scene
    try:
        plan = scene.plan()
    except ValueError as error:
        raise located(run.path, str(error)) from None
    qpos, qvel, sensors = _integrate(scene, plan)
    time_s = np.arange(len(qpos)) / scene.rate_hz
    whisker = scene.resolved_whisker
    base_pose = qpos[:, :3] / (MM_PER_M, MM_PER_M, 1.0)
    cos, sin = np.cos(base_pose[:, 2]), np.sin(base_pose[:, 2])
    vx, vy = qvel[:, 0] / MM_PER_M, qvel[:, 1] / MM_PER_M
    force_n = N_PER_UN * np.sqrt(np.sum(sensors[:, SENSORS["force"]] ** 2, axis=1))
    line = CenterLine.from_joints(whisker, base_pose, qpos[:, 3:])
    simulated = Simulated(
        time_s=time_s,
        base_pose=base_pose,
        base_twist=np.stack((cos * vx + sin * vy, cos * vy - sin * vx, qvel[:, 2]), axis=-1),
        rotations_rad=qpos[:, 3:],
        touching=force_n > 0.0,
        force_n=force_n,
        nearest=np.zeros(len(qpos), dtype=int),
        truth=nearest_contact(line, scene.object),
        split=is_split(sensors),
        penetration_m=np.maximum(-sensors[:, SENSORS["distance"]], 0.0) / MM_PER_M,
    )
    _check(simulated, plan)
    return simulated


def _integrate(scene: Scene, plan: Plan) -> tuple[Array, Array, Array]:
    """Positions, velocities and sensor data at the logged instants, in the model's units."""
    model = build_model(scene.resolved_whisker, scene.object, scene.simulation.timestep_s)
    data = mujoco.MjData(model)
    poses_mm = plan.poses * (MM_PER_M, MM_PER_M, 1.0)
    data.qpos[:3] = data.act[:] = poses_mm[0]
    velocities = np.diff(poses_mm, axis=0) / scene.simulation.timestep_s
    return logged(model, data, velocities, scene.steps_per_row)


def logged(model: mujoco.MjModel, data: mujoco.MjData, controls: Array, stride: int) -> tuple[Array, Array, Array]:
    """Steps from the state of `data` with the controls (n, nu), one a step.

    Gives positions, velocities and sensor data at the start and after every `stride` steps, in the model's units. Raises as `roll`
    does.
    """
    # A step's sensor data belong to the state before the step, so one more step gives those of the last row.
    controls = np.concatenate((controls[: len(controls) // stride * stride], np.zeros((1, model.nu))))
    start, states, sensors = full_state(model, data), [], []
    chunk = max(1, _CHUNK_STEPS // stride) * stride
    for after, readings in roll(model, data, controls, chunk):
        states += [start[None], after[stride - 1 : -1 : stride]]
        sensors.append(readings[::stride])
        start = after[-1]
    states, sensors = np.concatenate(states), np.concatenate(sensors)
    qpos, qvel = states[:, 1 : 1 + model.nq], states[:, 1 + model.nq : 1 + model.nq + model.nv]
    return qpos, qvel, sensors


def full_state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """MuJoCo's full physics state: time, then coordinates, velocities and what else there is."""
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def roll(model: mujoco.MjModel, data: mujoco.MjData, controls: Array, chunk: int) -> Iterator[tuple[Array, Array]]:
    """Steps from the state of `data` with the controls (n, nu), one a step, and gives `chunk` steps at a time.

    Gives full physics states after each step, and sensor data, which belong to the state before it. Raises `SimulationError` where
    MuJoCo warns or the state is not finite.
    """
    _warnings.clear()
    state, timestep_s = full_state(model, data), model.opt.timestep
    for start in range(0, len(controls), chunk):
        control = controls[start : start + chunk]
        warmstart = data.qacc_warmstart.copy()
        after, readings = mujoco.rollout.rollout(model, data, state[None], control[None], initial_warmstart=warmstart[None])
        _check_physics(after[0], start * timestep_s, timestep_s)
        report_share(min(1.0, (start + chunk) / len(controls)))
        yield after[0], readings[0]
        state = after[0][-1]


def is_split(sensors: Array) -> NDArray[np.bool_]:
    """Whether the loaded places lie apart from one another (n,), from one whisker's sensor data (n, columns of `SENSORS`).

    They do where the diagonal of the box around them is longer than `_APART_M`.
    """
    slots = sensors[:, SENSORS["places"]].reshape(len(sensors), -1, 6)
    loaded = np.any(slots[:, :, :3] != 0.0, axis=-1)
    several = np.sum(loaded, axis=1) > 1
    points_mm, where = slots[several, :, 3:], loaded[several, :, None]
    highest = np.max(points_mm, axis=1, where=where, initial=-np.inf)
    lowest = np.min(points_mm, axis=1, where=where, initial=np.inf)
    extent_mm = np.zeros(len(slots))
    extent_mm[several] = np.linalg.norm(highest - lowest, axis=1)
    return extent_mm > MM_PER_M * _APART_M


def _check_physics(states: Array, start_s: float, timestep_s: float) -> None:
    if _warnings:
        raise SimulationError(f"MuJoCo warns: {_warnings[0]}")
    # What is not finite once stays so.
    if not np.all(np.isfinite(states[-1])):
        finite = np.all(np.isfinite(states), axis=1)
        raise SimulationError(f"state is not finite at {start_s + timestep_s * (int(np.argmin(finite)) + 1):.4f} s")


def _check(simulated: Simulated, plan: Plan) -> None:
    time_s, touching = simulated.time_s, simulated.touching
    early = touching & (time_s <= REST_S)
    if np.any(early):
        raise SimulationError(f"whisker touches the object at {time_s[np.argmax(early)]:.3f} s, before the motion starts")
    for start_s, end_s in plan.touching:
        lost = ~touching & (time_s >= start_s) & (time_s <= end_s)
        if np.any(lost):
            raise SimulationError(
                f"contact lost at {time_s[np.argmax(lost)]:.3f} s; the motion promises it from {start_s:.3f} s to {end_s:.3f} s"
            )
        deep = (simulated.penetration_m > _PENETRATION_LIMIT_M) & (time_s >= start_s) & (time_s <= end_s)
        if np.any(deep):
            raise SimulationError(
                f"penetration of {simulated.penetration_m[np.argmax(deep)]:.1e} m at {time_s[np.argmax(deep)]:.3f} s, "
                f"expected at most {_PENETRATION_LIMIT_M:.0e} m; a slower motion or a shorter time step may help"
            )
    at_tip = touching & simulated.truth.tip
    if plan.may_slip_off:
        promised = [(time_s >= start_s) & (time_s <= end_s) for start_s, end_s in plan.touching]
        at_tip &= np.any(promised, axis=0)
    if np.any(at_tip):
        raise SimulationError(f"contact slips to the tip at {time_s[np.argmax(at_tip)]:.3f} s")
