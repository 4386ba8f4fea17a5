"""Models of scenes in space for MuJoCo's viewer and for export."""

import xml.etree.ElementTree as ET

import mujoco

from whisker_sim.export import Start
from whisker_sim.runs import Run
from whisker_sim.space.model import build_mjcf, build_model
from whisker_sim.space.simulate import SpatialSimulated, start_pose
from whisker_sim.whisker import Array


def replayed_in_space(run: Run, simulated: SpatialSimulated) -> tuple[mujoco.MjModel, Array]:
    """Model of a simulated scene and its coordinates (n, nq) at every row."""
    scene = run.scene
    model = build_model(scene.spatial_whisker, simulated.solid, simulated.start, scene.simulation.timestep_s)
    return model, simulated.coordinates


def space_at_start(run: Run) -> Start:
    """The model of a scene with its base at the start of the motion; raises `ValueError` if the motion does not fit the scene."""
    scene = run.scene
    solid = scene.solid.placed(run.path.parent)
    pose = start_pose(scene.plan(solid))
    model = build_mjcf(scene.spatial_whisker, solid, tuple(pose.tolist()), scene.simulation.timestep_s)
    controls = "the velocities of the base along the axes of its start pose in mm/s, then of yaw, pitch and roll in rad/s"
    return Start(ET.fromstring(model), controls)
