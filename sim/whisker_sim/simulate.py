"""Simulation of a scene: plans the motion, integrates the physics, computes the ground truth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import mujoco
import mujoco.rollout
import numpy as np
from numpy.typing import NDArray

from whisker_sim.documents import located
from whisker_sim.errors import SimulationError
from whisker_sim.model import BASE_LAG_S, MM_PER_M, N_PER_UN, SENSORS
from whisker_sim.motions import Plan
from whisker_sim.motions.base import REST_S
from whisker_sim.progress import report_share
from whisker_sim.runs import Run
from whisker_sim.scene import Scene
from whisker_sim.sweep import build_sweep_model
from whisker_sim.truth import (
    SEPARATE_M,
    CenterLine,
    ContactTruth,
    FrictionTruth,
    SecondContact,
    friction_truth,
    loaded_contacts,
    nearest_contact,
)
from whisker_sim.whisker import Array
from whisker_sim.yielding import Yielding, yielding

# By default MuJoCo writes warnings to a log file in the working directory; here a warning fails the trace.
_warnings: list[str] = []
mujoco.set_mju_user_warning(_warnings.append)

_CHUNK_STEPS = 2000
_STICKING_SHARE = 0.999
"""Share of the coefficient of friction below which the ratio of friction to normal force is that of a sticking contact."""
PENETRATION_LIMIT_M = 20e-6
"""At larger penetrations the contact is not the rigid one that a scene describes."""


@dataclass(frozen=True)
class Simulated:
    """One simulated trace: n rows at the logging rate, in World and SI units unless stated otherwise."""

    time_s: Array
    base_pose: Array
    """(n, 3): x, y (m), yaw (rad)."""
    base_twist: Array
    """(n, 3): velocity along the x and y axes of Base (m/s), angular velocity (rad/s); in Base."""
    rotations_rad: Array
    """(n, N + 1): rotations of the root and of the hinges."""
    touching: NDArray[np.bool_]
    force_n: Array
    nearest: NDArray[np.intp]
    """Index (n,) of the object nearest to the whisker; zero if there is only one."""
    truth: ContactTruth
    """Contact with the nearest object at every row; meaningful only at rows in contact."""
    split: NDArray[np.bool_]
    """Whether the whisker touches at separate points (n,); `truth` is then the nearest contact only."""
    penetration_m: Array
    """Penetration of the two surfaces (n,); zero without contact."""
    friction: FrictionTruth | None = None
    """`None` without friction."""
    second: SecondContact | None = None
    """`None` for convex objects. For others `force_n` is that of the contact `truth` alone."""
    object_m: Array | None = None
    """Displacements (n, 2) of the object since the start; `None` if it is at rest."""
    yielding: Yielding | None = None
    """`None` for objects that do not give way."""

    def relative_to_object(self) -> "Simulated":
        """The same with positions relative to those of the object, which then is at rest at its pose at the start.

        Positions are relative to the indented surface, if the surface is elastic.
        """
        if self.yielding is not None:
            return replace(transformed(self, self.yielding.to_start, -self.yielding.yaw_rad), yielding=None)
        return self if self.object_m is None else replace(displaced(self, -self.object_m), object_m=None)


def displaced(simulated: Simulated, by_m: Array) -> Simulated:
    """A copy with base and contacts displaced by `by_m` (n, 2)."""
    truth, second = simulated.truth, simulated.second
    return replace(
        simulated,
        base_pose=simulated.base_pose + np.pad(by_m, ((0, 0), (0, 1))),
        truth=replace(truth, contact_m=truth.contact_m + by_m, surface_m=truth.surface_m + by_m),
        second=second and replace(second, contact_m=second.contact_m + by_m, surface_m=second.surface_m + by_m),
    )


def transformed(simulated: Simulated, place: Callable[[Array], Array], yaw_rad: Array) -> Simulated:
    """A copy with base and contact at the places that `place` returns for positions (n, 2), rotated by `yaw_rad` (n,)."""
    pose, truth = simulated.base_pose, simulated.truth
    return replace(
        simulated,
        base_pose=np.column_stack((place(pose[:, :2]), pose[:, 2] + yaw_rad)),
        truth=replace(
            truth,
            contact_m=place(truth.contact_m),
            surface_m=place(truth.surface_m),
            tangent_rad=truth.tangent_rad + yaw_rad,
        ),
    )


def simulate(run: Run) -> Simulated:
    """Simulates `run`.

    The physics is the same in every frame at constant velocity: a moving object is at rest in the frame of the integration, in
    which the base moves with the opposite velocity in addition to the planned motion. If the object gives way, the integration is
    in World, and the contact is determined in the frame of the displaced outline.

    Raises `InputError` if the motion does not fit the scene, and `SimulationError` if the physics fails or the contact is not the
    one that the motion guarantees.
    """
    scene = run.scene
    try:
        plan = scene.plan()
    except ValueError as error:
        raise located(run.path, str(error)) from None
    qpos, qvel, sensors, gave_way = _integrate(scene, plan)
    time_s = np.arange(len(qpos)) / scene.rate_hz
    whisker = scene.resolved_whisker
    rotations_rad = qpos[:, 3 : 4 + whisker.segments]
    base_pose = qpos[:, :3] / (MM_PER_M, MM_PER_M, 1.0)
    cos, sin = np.cos(base_pose[:, 2]), np.sin(base_pose[:, 2])
    object_m = scene.object_m(time_s)
    vx, vy = qvel[:, :2].T / MM_PER_M + scene.object_m(np.ones(1)).T
    force_n = N_PER_UN * np.sqrt(np.sum(sensors[:, SENSORS["force"]] ** 2, axis=1))
    if gave_way is not None:
        base_pose = np.column_stack((gave_way.to_start(base_pose[:, :2]), base_pose[:, 2] - gave_way.yaw_rad))
    line = CenterLine.from_joints(whisker, base_pose, rotations_rad)
    truth = nearest_contact(line, scene.object)
    # With friction the chains in parallel may touch one place with more than the `POINTS` strongest contacts.
    split = is_split(sensors[:, SENSORS["points"].start :])
    second = None
    if not scene.object.convex:
        contacts = sensors[:, SENSORS["points"]].reshape(len(sensors), -1, 6)
        truth, first_force_n, second = loaded_contacts(
            line, scene.object, truth, contacts[:, :, 3:5] / MM_PER_M, N_PER_UN * contacts[:, :, 0]
        )
    simulated = Simulated(
        time_s=time_s,
        base_pose=base_pose,
        base_twist=np.stack((cos * vx + sin * vy, cos * vy - sin * vx, qvel[:, 2]), axis=-1),
        rotations_rad=rotations_rad,
        touching=force_n > 0.0,
        force_n=force_n if second is None else first_force_n,
        nearest=np.zeros(len(qpos), dtype=int),
        truth=truth,
        split=split if second is None else split | second.exists,
        penetration_m=np.maximum(-sensors[:, SENSORS["distance"]], 0.0) / MM_PER_M,
        friction=_friction(scene, qpos, qvel, sensors, truth) if scene.friction_coefficient > 0.0 else None,
        second=second,
    )
    if np.any(object_m):
        simulated = replace(displaced(simulated, object_m), object_m=object_m)
    if gave_way is not None:
        simulated = replace(transformed(simulated, gave_way.to_world, gave_way.yaw_rad), yielding=gave_way)
    # From an object that is not convex the whisker may jump off at any time after the touch; one that gives way may stay behind.
    guaranteed = plan.touching if scene.object.convex and not scene.yields else [(start_s, start_s) for start_s, _ in plan.touching]
    # Inside an object that is not convex, the distance to the surface is not the depth below the parts that are touched.
    tunnelling_m = np.inf
    if scene.object.convex:
        tunnelling_m = tunnelling_limit_m(float(whisker.radius_m(whisker.length_m)), scene.object.thickest_radius_m())
    check_contacts(simulated, guaranteed, _slipping(simulated, plan), tunnelling_m)
    return simulated


def _integrate(scene: Scene, plan: Plan) -> tuple[Array, Array, Array, Yielding | None]:
    """Positions, velocities and sensor data at the logged instants, in the units of the model, and how the object gave way."""
    model = build_sweep_model(scene)
    data = mujoco.MjData(model)
    away_m = np.pad(scene.object_m(np.arange(len(plan.poses)) * scene.simulation.timestep_s), ((0, 0), (0, 1)))
    poses_mm = (plan.poses - away_m) * (MM_PER_M, MM_PER_M, 1.0)
    data.qpos[:3] = data.act[:] = poses_mm[0]
    # Base and whisker are at rest in World, without the transient of a base that has not yet fallen behind its command.
    data.qvel[:2] = -MM_PER_M * scene.object_m(np.ones(1))[0]
    data.act[:2] += (BASE_LAG_S + scene.simulation.timestep_s) * data.qvel[:2]
    velocities = np.diff(poses_mm, axis=0) / scene.simulation.timestep_s
    qpos, qvel, sensors = logged(model, data, velocities, scene.steps_per_row)
    return qpos, qvel, sensors, yielding(model, qpos, scene.object) if scene.yields else None


def _friction(scene: Scene, qpos: Array, qvel: Array, sensors: Array, truth: ContactTruth) -> FrictionTruth:
    """Truth of the friction at the logged instants, in the units of the model."""
    # The sensor measures the force on the object.
    force_n = -N_PER_UN * sensors[:, SENSORS["force"]][:, :2]

    def later(duration_s: float) -> CenterLine:
        moved = qpos + duration_s * qvel
        return CenterLine.from_joints(scene.resolved_whisker, moved[:, :3] / (MM_PER_M, MM_PER_M, 1.0), moved[:, 3:])

    # Forces in the frames of the contacts; the normals of the capsules differ by some tenths of a degree from that of the whisker.
    contacts = sensors[:, SENSORS["points"]].reshape(len(sensors), -1, 6)[:, :, :3]
    strongest = contacts[np.arange(len(contacts)), np.argmax(contacts[:, :, 0], axis=1)]
    sticking = np.hypot(*strongest[:, 1:].T) < _STICKING_SHARE * scene.friction_coefficient * strongest[:, 0]
    return friction_truth(later, truth, force_n, sticking)


def logged(model: mujoco.MjModel, data: mujoco.MjData, controls: Array, stride: int) -> tuple[Array, Array, Array]:
    """Integrates from the state of `data` with the controls (n, nu), one per step, and logs every `stride` steps.

    Returns positions, velocities and sensor data at the start and after every `stride` steps, in the units of the model. Raises
    `SimulationError` as `roll` does.
    """
    # Sensor data of a step belong to the state before the step; one additional step gives those of the last row.
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
    """MuJoCo's full physics state: time, coordinates, velocities and actuator states."""
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def roll(model: mujoco.MjModel, data: mujoco.MjData, controls: Array, chunk: int) -> Iterator[tuple[Array, Array]]:
    """Integrates from the state of `data` with the controls (n, nu), one per step; yields the results of `chunk` steps at a time.

    Yields full physics states after each step, and sensor data, which belong to the state before the step. Raises `SimulationError`
    on a warning or a failure of MuJoCo or a state that is not finite.
    """
    _warnings.clear()
    state, timestep_s = full_state(model, data), model.opt.timestep
    for start in range(0, len(controls), chunk):
        control = controls[start : start + chunk]
        warmstart = data.qacc_warmstart.copy()
        try:
            after, readings = mujoco.rollout.rollout(model, data, state[None], control[None], initial_warmstart=warmstart[None])
        except mujoco.FatalError as error:
            # As when the contacts need more memory than the model has.
            raise SimulationError(f"MuJoCo fails {_span(start, len(control), timestep_s)}: {error}") from None
        _check_physics(after[0], start, timestep_s)
        report_share(min(1.0, (start + chunk) / len(controls)))
        yield after[0], readings[0]
        state = after[0][-1]


def is_split(points: Array) -> NDArray[np.bool_]:
    """Mask (n,) of rows with contacts at separate points, from forces and positions (n, 6 k) of one whisker's contacts.

    The contacts are separate if the diagonal of their bounding box exceeds `SEPARATE_M`.
    """
    slots = points.reshape(len(points), -1, 6)
    loaded = np.any(slots[:, :, :3] != 0.0, axis=-1)
    several = np.sum(loaded, axis=1) > 1
    points_mm, where = slots[several, :, 3:], loaded[several, :, None]
    highest = np.max(points_mm, axis=1, where=where, initial=-np.inf)
    lowest = np.min(points_mm, axis=1, where=where, initial=np.inf)
    extent_mm = np.zeros(len(slots))
    extent_mm[several] = np.linalg.norm(highest - lowest, axis=1)
    return extent_mm > MM_PER_M * SEPARATE_M


def _span(start: int, steps: int, timestep_s: float) -> str:
    """Text for the time of `steps` steps from the step `start` on, within which MuJoCo reports something without its time."""
    return f"between {start * timestep_s:.4f} s and {(start + steps) * timestep_s:.4f} s"


def _check_physics(states: Array, start: int, timestep_s: float) -> None:
    if _warnings:
        # Warnings about the state of the simulation end with their time.
        when = "" if "Time = " in _warnings[0] else f" {_span(start, len(states), timestep_s)}"
        raise SimulationError(f"MuJoCo warns{when}: {_warnings[0]}")
    # A value that is not finite remains so.
    if not np.all(np.isfinite(states[-1])):
        finite = np.all(np.isfinite(states), axis=1)
        raise SimulationError(f"state is not finite at {timestep_s * (start + int(np.argmin(finite)) + 1):.4f} s")


def tunnelling_limit_m(wire_radius_m: float, object_radius_m: float) -> float:
    """Penetration above which the whisker passes through the object: half of that at which their middles coincide."""
    return 0.5 * (wire_radius_m + object_radius_m)


class _Contacts(Protocol):
    """Contacts of a simulated trace of one whisker: n rows."""

    @property
    def time_s(self) -> Array: ...

    @property
    def touching(self) -> NDArray[np.bool_]: ...

    @property
    def penetration_m(self) -> Array: ...


def check_contacts(
    simulated: _Contacts, guaranteed: Iterable[tuple[float, float]], slipping: NDArray[np.bool_], tunnelling_m: float
) -> None:
    """Raises `SimulationError` unless the contacts are those of the plan.

    The whisker must be free until the motion starts, and in contact in the `guaranteed` intervals (s), with a penetration of at
    most `PENETRATION_LIMIT_M`. An interval between two rows is judged by the rows within a row's period of it, one of which must be
    in contact. `slipping` marks rows (n,) with a contact at the tip that the plan does not allow. In no row may the penetration
    exceed `tunnelling_m`.
    """
    time_s, touching = simulated.time_s, simulated.touching
    early = touching & (time_s <= REST_S)
    if np.any(early):
        raise SimulationError(f"whisker touches the object at {time_s[np.argmax(early)]:.3f} s, before the motion starts")
    tunnelled = simulated.penetration_m > tunnelling_m
    if np.any(tunnelled):
        raise SimulationError(
            f"whisker passes through the object: penetration of {simulated.penetration_m[np.argmax(tunnelled)]:.1e} m at "
            f"{time_s[np.argmax(tunnelled)]:.3f} s, expected at most {tunnelling_m:.1e} m; a slower motion or a shorter time step "
            "may help"
        )
    period_s = time_s[1] - time_s[0] if len(time_s) > 1 else 0.0
    for start_s, end_s in guaranteed:
        if not np.any(touching):
            raise SimulationError(f"whisker never touches the object, expected contact from {start_s:.3f} s to {end_s:.3f} s")
        within = (time_s >= start_s) & (time_s <= end_s)
        lost = ~touching & within
        if not np.any(within):
            within = (time_s > start_s - period_s) & (time_s < end_s + period_s)
            lost = within & ~np.any(touching & within)
        if np.any(lost):
            raise SimulationError(
                f"contact lost at {time_s[np.argmax(lost)]:.3f} s, expected from {start_s:.3f} s to {end_s:.3f} s"
            )
        deep = (simulated.penetration_m > PENETRATION_LIMIT_M) & within
        if np.any(deep):
            raise SimulationError(
                f"penetration of {simulated.penetration_m[np.argmax(deep)]:.1e} m at {time_s[np.argmax(deep)]:.3f} s, "
                f"expected at most {PENETRATION_LIMIT_M:.0e} m; a slower motion or a shorter time step may help"
            )
    if np.any(slipping):
        raise SimulationError(f"contact slips to the tip at {time_s[np.argmax(slipping)]:.3f} s")


def _slipping(simulated: Simulated, plan: Plan) -> NDArray[np.bool_]:
    """Rows (n,) with a contact at the tip; only those in guaranteed intervals if the plan allows the whisker to slip off."""
    time_s = simulated.time_s
    at_tip = simulated.touching & simulated.truth.tip
    if plan.may_slip_off:
        guaranteed = [(time_s >= start_s) & (time_s <= end_s) for start_s, end_s in plan.touching]
        at_tip &= np.any(guaranteed, axis=0)
    return at_tip
