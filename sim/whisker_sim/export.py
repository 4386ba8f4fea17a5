"""Export of scenes as plain MJCF, for MuJoCo's viewer and other programs."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import whisker_sim
from whisker_sim.arm.model import build_arm_mjcf
from whisker_sim.documents import located
from whisker_sim.errors import InputError
from whisker_sim.model import MM_PER_M
from whisker_sim.runs import Run
from whisker_sim.shapes.base import mjcf
from whisker_sim.sweep import sweep_mjcf
from whisker_sim.trace import write_atomically
from whisker_sim.whisker import Array


class Start(NamedTuple):
    """A model in its start pose."""

    model: ET.Element
    controls: str
    """Description of the controls with their units."""


def export(run: Run, path: Path, start_of: Callable[[Run], Start]) -> None:
    """Writes the simulated model, as returned by `start_of`, to one self-contained MJCF file.

    Raises `InputError` if `path` does not end in `.xml`, or the motion does not fit the scene.
    """
    if path.suffix != ".xml":
        raise InputError(f"{path}: expected a name that ends in .xml, found '{path.suffix}'")
    try:
        start = start_of(run)
    except ValueError as error:
        raise located(run.path, str(error)) from None
    start.model.set("model", run.name)
    ET.indent(start.model)
    # Two consecutive hyphens would end the comment.
    name = run.name.replace("--", "- -")
    about = f"""<!--
  Scene {name}, written by whisker_sim {whisker_sim.__version__}.
  Units: millimetre, gram, second, radian; hence micronewton and nanonewton metre.
  The controls are {start.controls}.
-->
"""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, f"{about}{ET.tostring(start.model, encoding='unicode')}\n".encode())


def sweep_at_start(run: Run) -> Start:
    """The model of a sweep, with zero coordinates at the start of the motion.

    The coordinates of the base count from the start pose, along the axes of World: MuJoCo initialises all coordinates and servo
    integrators to zero, and with the base at the origin of World the whisker would be inside the object. Raises `ValueError` if the
    motion does not fit the scene.
    """
    scene = run.scene
    pose = scene.plan().poses[0]
    root = ET.fromstring(sweep_mjcf(scene))
    _put_base_at(root, pose)
    return Start(root, "the velocities of the base: x and y in mm/s, yaw in rad/s")


def passage_at_start(run: Run) -> Start:
    """The model of a scene with an arm in its start pose; raises `ValueError` if the arm cannot follow the path."""
    root = ET.fromstring(build_arm_mjcf(run.scene, run.scene.plan().q_rad[0]))
    return Start(root, "the joint angles in rad, relative to the start pose, and the joint speeds in rad/s")


def _put_base_at(root: ET.Element, pose: Array) -> None:
    """Attaches the base to a fixed body at `pose` (x and y in m, yaw in rad, in World)."""
    x_m, y_m, yaw_rad = pose
    world = root.find("worldbody")
    base = world.find("body[@name='base']")
    world.remove(base)
    start = {"pos": mjcf(MM_PER_M * x_m, MM_PER_M * y_m, 0.0), "euler": mjcf(0.0, 0.0, yaw_rad)}
    ET.SubElement(world, "body", start, name="start").append(base)
    # Axes of World in the frame of the rotated body.
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    base.find("joint[@name='base_x']").set("axis", mjcf(cos, -sin, 0.0))
    base.find("joint[@name='base_y']").set("axis", mjcf(sin, cos, 0.0))
