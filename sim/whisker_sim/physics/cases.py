"""Whiskers, objects and functions that several studies share."""

import xml.etree.ElementTree as ET

import msgspec
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from whisker_sim.free_object import FreeObject
from whisker_sim.model import build_mjcf, compiled
from whisker_sim.shapes.base import mjcf
from whisker_sim.shapes.circle import Circle
from whisker_sim.shapes.pin import Pin
from whisker_sim.table import GRAVITY_M_S2, add_free_object, add_table, let_gravity_act
from whisker_sim.whisker import PRESETS, Array, Whisker

TAPERED = msgspec.structs.replace(PRESETS["straight"][1], name="tapered", tip_diameter_m=0.12e-3)

WHISKERS: dict[str, Whisker] = {whisker.name: whisker for whisker in (PRESETS["straight"][1], PRESETS["curved"][1], TAPERED)}
"""Whiskers of the studies, by name."""


def rms(values: Array) -> float:
    """Root mean square of `values`, of any shape; NaN if there are none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


def largest(values: ArrayLike) -> float:
    """Largest magnitude of `values`, of any shape; NaN if there are none or one is NaN, in contrast to Python's `max`."""
    return float(np.max(np.abs(values))) if np.size(values) else float("nan")


FAR_AWAY = Pin(center_m=(1.0, 1.0))
"""An object out of reach."""

TIMESTEP_S = 0.0005
"""Time step of the studies of free-standing objects."""
MASSES_KG = (0.005, 0.02, 0.1)
"""Masses of the free-standing objects."""
TOUCHED_M = 0.08
"""Height above the table at which a whisker touches a free-standing object."""


def cylinder(mass_kg: float, height_m: float = 0.12) -> FreeObject:
    """An upright cylinder of 30 mm diameter, with its axis at the origin of World."""
    return FreeObject("object", Circle(radius_m=0.015), mass_kg, height_m)


def slides_at_n(free: FreeObject) -> float:
    """Horizontal force at which the object slides: mu m g."""
    return free.friction * free.mass_kg * GRAVITY_M_S2


def tips_at_n(free: FreeObject, height_m: float) -> float:
    """Horizontal force at `height_m` above the table at which a round object tips over the foot ahead of it: m g R / height."""
    return free.mass_kg * GRAVITY_M_S2 * free.object.radius_m / height_m


def model_with_free_object(whisker: Whisker, free: FreeObject, timestep_s: float, tip_friction: float = 0.0) -> mujoco.MjModel:
    """The model of `whisker` with `free`, on a table `TOUCHED_M` below the whisker, instead of the fixed object.

    `free` has the name of the object that it replaces, so that the sensors of the model measure its contact. The last link of the
    whisker has the friction `tip_friction` with the object; the others are frictionless.

    Raises `SimulationError` if MuJoCo rejects the model.
    """
    root = ET.fromstring(build_mjcf(whisker, free.object, timestep_s))
    world = root.find("worldbody")
    world.remove(world.find(f"body[@name='{free.name}']"))
    let_gravity_act(root.find("option"))
    add_table(world, -TOUCHED_M)
    add_free_object(root, free, -TOUCHED_M, timestep_s)
    if tip_friction > 0.0:
        for geom in root.findall(f".//body[@name='link_{whisker.segments}']/geom"):
            geom.set("condim", "3")
            geom.set("friction", mjcf(tip_friction, 0.0, 0.0))
    return compiled(ET.tostring(root, encoding="unicode"))
