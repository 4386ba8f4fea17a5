"""Simulation of a scene with an arm: plans the joints, integrates the physics, computes the ground truth of each whisker."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from whisker_sim.arm import panda
from whisker_sim.arm.model import OBJECT, TOOL_SENSOR, build_arm_model
from whisker_sim.arm.scene import ArmScene, JointPlan
from whisker_sim.arm.tool import MOUNTS, Mount
from whisker_sim.documents import located
from whisker_sim.errors import SimulationError
from whisker_sim.model import MM_PER_M, N_PER_UN, SENSOR_COLUMNS, SENSORS
from whisker_sim.motions.base import REST_S
from whisker_sim.progress import part
from whisker_sim.runs import Run
from whisker_sim.shapes import Shape
from whisker_sim.simulate import Simulated, is_split, logged, roll
from whisker_sim.table import displacement
from whisker_sim.truth import CenterLine, ContactTruth, nearest_contact, turned
from whisker_sim.whisker import Array

_SETTLING_S = 0.1
_TILT_LIMIT_RAD, _LIFT_LIMIT_M = 1e-3, 1e-4
"""Limits of an object's tilt and rise, above which the ground truth, computed for upright objects, would be wrong."""


@dataclass(frozen=True)
class SimulatedPassage:
    """One simulated recording: n rows at the logging rate, common to all whiskers and objects."""

    time_s: Array
    q_rad: Array
    """Joint angles (n, 7)."""
    dq_rad_s: Array
    whiskers: dict[str, Simulated]
    """Trace of each whisker, by the name of its mount."""
    objects: dict[str, Array]
    """Displacement (n, 5) of each object from its start pose, by its name: x, y, z (m), yaw, tilt (rad)."""
    model: mujoco.MjModel
    qpos: Array
    """Coordinates (n, nq) of the model, in its units."""


def simulate_passage(run: Run) -> SimulatedPassage:
    """Simulates the scene of `run`, which has an arm.

    Raises `InputError` if the arm cannot follow the path of the scene, and `SimulationError` if the physics fails.
    """
    scene: ArmScene = run.scene
    try:
        plan = scene.plan()
    except ValueError as error:
        raise located(run.path, str(error)) from None
    model = build_arm_model(scene, plan.q_rad[0])
    qpos, qvel, sensors = _integrate(scene, model, plan)
    time_s = np.arange(len(qpos)) / scene.rate_hz
    q_rad, dq_rad_s = plan.q_rad[0] + qpos[:, : panda.JOINTS], qvel[:, : panda.JOINTS]
    moved = {free.name: _since_start(displacement(model, qpos, f"{OBJECT}{free.name}")) for free in scene.objects}
    hinges = scene.resolved_whisker.segments + 1
    whiskers = {}
    for index, mount in enumerate(MOUNTS):
        first = panda.JOINTS + index * hinges
        readings = sensors[:, index * SENSOR_COLUMNS : (index + 1) * SENSOR_COLUMNS]
        base_pose, base_twist = base_motion(scene, mount, q_rad, dq_rad_s)
        whiskers[mount.name] = _whisker(scene, base_pose, base_twist, qpos[:, first : first + hinges], readings, moved, time_s)
    passed = SimulatedPassage(time_s, q_rad, dq_rad_s, whiskers, moved, model, qpos)
    _check(passed, sensors[:, TOOL_SENSOR])
    return passed


def base_motion(scene: ArmScene, mount: Mount, q_rad: Array, dq_rad_s: Array) -> tuple[Array, Array]:
    """Poses (n, 3) of a whisker's Base in the plane of World and its planar twists (n, 3) in Base, by xi = J(q) dq/dt."""
    pose = scene.arm.base @ panda.tool_pose(q_rad, mount.in_flange)
    yaw_rad = np.unwrap(np.arctan2(pose[:, 1, 0], pose[:, 0, 0]))
    twist = (panda.body_jacobian(q_rad, mount.in_flange) @ dq_rad_s[..., None])[..., 0]
    return np.column_stack((pose[:, :2, 3], yaw_rad)), twist[:, (0, 1, 5)]


def _integrate(scene: ArmScene, model: mujoco.MjModel, plan: JointPlan) -> tuple[Array, Array, Array]:
    """Positions, velocities and sensor data at the logged instants, in the units of the model.

    Before the first instant the objects settle on the table, by about a micrometre.
    """
    timestep_s, data = scene.simulation.timestep_s, mujoco.MjData(model)
    settling = np.zeros((round(_SETTLING_S / timestep_s), model.nu))
    with part(0.0, 0.0):
        for _ in roll(model, data, settling, len(settling)):
            data.time = 0.0
    controls = np.concatenate((plan.q_rad - plan.q_rad[0], plan.dq_rad_s), axis=1)[1:]
    return logged(model, data, controls, scene.steps_per_row)


def _since_start(moved: Array) -> Array:
    """Displacements (n, 5) relative to the first row, except for the tilt, which is relative to the vertical."""
    return np.column_stack((moved[:, :4] - moved[0, :4], moved[:, 4]))


def _whisker(
    scene: ArmScene,
    base_pose: Array,
    base_twist: Array,
    rotations_rad: Array,
    readings: Array,
    moved: dict[str, Array],
    time_s: Array,
) -> Simulated:
    """Trace of one whisker."""
    force_n = N_PER_UN * np.linalg.norm(readings[:, SENSORS["force"]], axis=1)
    touching = force_n > 0.0
    nearest, truth = _truth(scene, base_pose, rotations_rad, moved, np.flatnonzero(touching))
    return Simulated(
        time_s=time_s,
        base_pose=base_pose,
        base_twist=base_twist,
        rotations_rad=rotations_rad,
        touching=touching,
        force_n=force_n,
        nearest=nearest,
        truth=truth,
        split=is_split(readings[:, SENSORS["points"]]),
        penetration_m=np.maximum(-readings[:, SENSORS["distance"]], 0.0) / MM_PER_M,
    )


def _truth(
    scene: ArmScene, base_pose: Array, rotations_rad: Array, moved: dict[str, Array], rows: NDArray[np.intp]
) -> tuple[NDArray[np.intp], ContactTruth]:
    """Index (n,) of the object nearest to the whisker, and the contact with it, at `rows`; other rows are undefined."""
    count, whisker = len(base_pose), scene.resolved_whisker
    nearest, least_m = np.zeros(count, dtype=int), np.full(len(rows), np.inf)
    points, numbers = np.full((count, 2), np.nan), np.full(count, np.nan)
    truth = ContactTruth(points, points.copy(), numbers, numbers.copy(), np.zeros(count, dtype=bool))
    for index, free in enumerate(scene.objects):
        frame = _Displaced(free.object, moved[free.name][rows])
        found = nearest_contact(
            CenterLine.from_joints(whisker, frame.start_pose(base_pose[rows]), rotations_rad[rows]), free.object
        )
        gap_m = free.object.closest(found.contact_m)[1] - whisker.radius_m(found.arc_m)
        nearer = gap_m < least_m
        here = rows[nearer]
        least_m[nearer], nearest[here] = gap_m[nearer], index
        truth.contact_m[here] = frame.now(found.contact_m)[nearer]
        truth.surface_m[here] = frame.now(found.surface_m)[nearer]
        truth.arc_m[here], truth.tip[here] = found.arc_m[nearer], found.tip[nearer]
        truth.tangent_rad[here] = (found.tangent_rad + frame.yaw_rad)[nearer]
    return nearest, truth


def seen_from_objects(scene: ArmScene, moved: dict[str, Array], simulated: Simulated) -> Simulated:
    """`simulated` with base poses and contacts relative to the touched object in its start pose.

    `moved` contains the displacements (n, 5) of the objects, by their names. Rows without contact are unchanged.
    """
    base_pose, truth = simulated.base_pose.copy(), simulated.truth
    contact_m, surface_m = truth.contact_m.copy(), truth.surface_m.copy()
    for index, free in enumerate(scene.objects):
        rows = np.flatnonzero(simulated.touching & (simulated.nearest == index))
        frame = _Displaced(free.object, moved[free.name][rows])
        base_pose[rows] = frame.start_pose(base_pose[rows])
        contact_m[rows], surface_m[rows] = frame.at_start(contact_m[rows]), frame.at_start(surface_m[rows])
    return replace(simulated, base_pose=base_pose, truth=replace(truth, contact_m=contact_m, surface_m=surface_m))


class _Displaced:
    """An object displaced in the plane at n instants: rotated by `yaw_rad` about its start position and then translated.

    Its tilt is neglected: below `_TILT_LIMIT_RAD`, above which a recording fails, and with a rise of micrometres, it displaces the
    object at the height of the whiskers by less than a micrometre.
    """

    def __init__(self, shape: Shape, moved: Array) -> None:
        self._center_m, self._moved_m, self.yaw_rad = np.array(shape.center_m), moved[:, :2], moved[:, 3]

    def start_pose(self, poses: Array) -> Array:
        """Poses (n, 3) in World, transformed to the start pose of the object."""
        return np.column_stack((self.at_start(poses[:, :2]), poses[:, 2] - self.yaw_rad))

    def at_start(self, points_m: Array) -> Array:
        """Points (n, 2) in World, transformed to the start pose of the object."""
        return turned(points_m - self._center_m - self._moved_m, -self.yaw_rad) + self._center_m

    def now(self, points_m: Array) -> Array:
        """Points (n, 2) of the object in its start pose, transformed to its present pose."""
        return turned(points_m - self._center_m, self.yaw_rad) + self._center_m + self._moved_m


def _check(passed: SimulatedPassage, tool_contacts: Array) -> None:
    if np.any(tool_contacts > 0.0):
        raise SimulationError(
            f"the tool itself is in contact at {passed.time_s[np.argmax(tool_contacts > 0.0)]:.3f} s, expected none"
        )
    for name, moved in passed.objects.items():
        fallen = (moved[:, 4] > _TILT_LIMIT_RAD) | (np.abs(moved[:, 2]) > _LIFT_LIMIT_M)
        if np.any(fallen):
            row = int(np.argmax(fallen))
            raise SimulationError(
                f"object '{name}' at {passed.time_s[row]:.3f} s: found a tilt of {moved[row, 4]:.2g} rad and a rise of "
                f"{moved[row, 2]:.2g} m, expected at most {_TILT_LIMIT_RAD:g} rad and {_LIFT_LIMIT_M:g} m"
            )
    for name, whisker in passed.whiskers.items():
        early = whisker.touching & (passed.time_s <= REST_S)
        if np.any(early):
            raise SimulationError(f"{name} touches at {passed.time_s[np.argmax(early)]:.3f} s, before the arm moves")
