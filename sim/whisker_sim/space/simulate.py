"""Simulation of a scene in space: plans the motion, integrates the physics, computes the ground truth."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from whisker_sim.documents import located
from whisker_sim.model import MM_PER_M, N_PER_UN, SENSOR_COLUMNS, SENSORS
from whisker_sim.runs import Run
from whisker_sim.simulate import check_contacts, is_split, logged, tunnelling_limit_m
from whisker_sim.space.model import BASE_COORDINATES, ROOT, build_model
from whisker_sim.space.motions import SpatialPlan
from whisker_sim.space.rotation import about, applied, from_yaw_pitch_roll, quaternion_of, undone
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.solids import Solid
from whisker_sim.space.truth import CenterCurve, SpatialContactTruth, nearest_contact, root_frame, root_moment_n_m
from whisker_sim.whisker import Array

_SCALE = np.array((MM_PER_M, MM_PER_M, MM_PER_M, 1.0, 1.0, 1.0))


@dataclass(frozen=True)
class SpatialSimulated:
    """One simulated trace in space: n rows at the logging rate, in World and SI units unless stated otherwise."""

    solid: Solid
    """The solid with the content of its files."""
    start: Array
    """Pose (7,) of the base at the start: position and quaternion."""
    time_s: Array
    position_m: Array
    """Positions (n, 3) of the base."""
    rotation: Array
    """Rotations (n, 3, 3) from Base to World."""
    velocity_m_s: Array
    """Velocity (n, 3) of the base, in Base."""
    angular_rad_s: Array
    """Angular velocity (n, 3) of the base, in Base."""
    coordinates: Array
    """Coordinates of the model (n, nq), in its units."""
    root_rad: Array
    """Angles (n, 3) of the root: yaw, pitch, twist."""
    moment_n_m: Array
    """Moments (n, 3) that the springs of the root carry, in Base: torsion about x, bending about y and z."""
    axial_n: Array
    """Force (n,) of the whisker on the base along +x of Base."""
    touching: NDArray[np.bool_]
    force_n: Array
    """Forces (n, 3) of the solid on the whisker."""
    truth: SpatialContactTruth
    """Contact at every row; meaningful only at rows in contact."""
    split: NDArray[np.bool_]
    """Whether the whisker touches at separate points (n,); `truth` is then the nearest contact only."""
    penetration_m: Array
    """Penetration of the two surfaces (n,); zero without contact."""


def simulate_in_space(run: Run) -> SpatialSimulated:
    """Simulates `run`.

    Raises `InputError` if the motion does not fit the scene, and `SimulationError` if the physics fails or the contact is not the
    one that the motion guarantees.
    """
    scene = run.scene
    try:
        solid = scene.solid.placed(run.path.parent)
        plan = scene.plan(solid)
    except ValueError as error:
        raise located(run.path, str(error)) from None
    model, data, velocities = prepared(scene, solid, plan)
    qpos, qvel, sensors = logged(model, data, velocities, scene.steps_per_row)
    whisker = scene.spatial_whisker
    angles_rad = qpos[:, 3:BASE_COORDINATES]
    rotation = plan.start_rotation @ from_yaw_pitch_roll(angles_rad)
    position_m = plan.coordinates[0, :3] + applied(plan.start_rotation, qpos[:, :3] / MM_PER_M)
    velocity_m_s = undone(rotation, applied(plan.start_rotation, qvel[:, :3] / MM_PER_M))
    # MuJoCo states both forces as those of the first body on the second: of the whisker on the solid, of the base on the whisker.
    force_n = -N_PER_UN * sensors[:, SENSORS["force"]]
    root_rad = qpos[:, ROOT]
    root_force_n = -N_PER_UN * applied(root_frame(root_rad), sensors[:, SENSOR_COLUMNS : SENSOR_COLUMNS + 3])
    line = CenterCurve.from_joints(whisker, position_m, rotation, qpos[:, BASE_COORDINATES:])
    simulated = SpatialSimulated(
        solid=solid,
        start=start_pose(plan),
        time_s=np.arange(len(qpos)) / scene.rate_hz,
        position_m=position_m,
        rotation=rotation,
        velocity_m_s=velocity_m_s,
        angular_rad_s=_angular(angles_rad, qvel[:, 3:BASE_COORDINATES]),
        coordinates=qpos,
        root_rad=root_rad,
        moment_n_m=root_moment_n_m(whisker, root_rad),
        axial_n=root_force_n[:, 0],
        touching=np.any(force_n != 0.0, axis=1),
        force_n=force_n,
        truth=nearest_contact(line, solid),
        split=is_split(sensors[:, SENSORS["points"]]),
        penetration_m=np.maximum(-sensors[:, SENSORS["distance"]], 0.0) / MM_PER_M,
    )
    tunnelling_m = tunnelling_limit_m(float(whisker.whisker.radius_m(whisker.whisker.length_m)), solid.thickest_radius_m())
    check_contacts(simulated, plan.touching, simulated.touching & simulated.truth.tip, tunnelling_m)
    return simulated


def start_pose(plan: SpatialPlan) -> Array:
    """Pose (7,) of the base at the start: position and quaternion, in World."""
    return np.concatenate((plan.coordinates[0, :3], quaternion_of(plan.start_rotation)))


def prepared(scene: SpatialScene, solid: Solid, plan: SpatialPlan) -> tuple[mujoco.MjModel, mujoco.MjData, Array]:
    """Model, its state at the start, and controls (n, 6), one per time step, in the units of the model."""
    model = build_model(scene.spatial_whisker, solid, start_pose(plan), scene.simulation.timestep_s)
    data = mujoco.MjData(model)
    coordinates = plan.coordinates.copy()
    coordinates[:, :3] = undone(plan.start_rotation, coordinates[:, :3] - coordinates[0, :3])
    coordinates *= _SCALE
    data.qpos[:BASE_COORDINATES] = data.act[:] = coordinates[0]
    return model, data, np.diff(coordinates, axis=0) / scene.simulation.timestep_s


def _angular(angles_rad: Array, rates_rad_s: Array) -> Array:
    """Angular velocities (n, 3) in the turned frame for yaw, pitch and roll (n, 3) and their rates."""
    yaw, pitch, roll = rates_rad_s.T
    zero = np.zeros_like(yaw)
    pitched = undone(about(1, angles_rad[:, 1]), np.stack((zero, zero, yaw), axis=-1)) + np.stack((zero, pitch, zero), axis=-1)
    return undone(about(0, angles_rad[:, 2]), pitched) + np.stack((roll, zero, zero), axis=-1)
