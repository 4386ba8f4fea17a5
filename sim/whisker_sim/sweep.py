"""MuJoCo model of a sweep: whisker and object as a scene describes them."""

import xml.etree.ElementTree as ET

import mujoco

from whisker_sim.model import build_mjcf, compiled
from whisker_sim.scene import Scene
from whisker_sim.yielding import replace_object


def sweep_mjcf(scene: Scene) -> str:
    """The model of `scene` as MJCF."""
    timestep_s = scene.simulation.timestep_s
    model = build_mjcf(scene.resolved_whisker, scene.object, timestep_s, scene.friction_coefficient)
    if not scene.yields:
        return model
    root = ET.fromstring(model)
    replace_object(root, scene.object, scene.stand, scene.stiffness_n_m, timestep_s)
    return ET.tostring(root, encoding="unicode")


def build_sweep_model(scene: Scene) -> mujoco.MjModel:
    """Compiles the model of `scene`.

    Raises `SimulationError` if MuJoCo rejects the model.
    """
    return compiled(sweep_mjcf(scene))
