"""MuJoCo model of a scene with an arm: arm, tool, whiskers, table and free-standing objects.

Units are those of `whisker_sim.model`: millimetres, grams, seconds. Gravity acts on all bodies; the weight of the arm is
compensated, as by its controller. Joint coordinates count from the initial posture of the scene, so that the model with zero
coordinates and controls is the scene at its start.
"""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from whisker_sim.arm import panda
from whisker_sim.arm.scene import ArmScene
from whisker_sim.arm.tool import HALF_HEIGHT_M, HALF_WIDTH_M, LENGTH_M, MOUNTS
from whisker_sim.model import G_PER_KG, MM_PER_M, NNM_PER_NM, SENSOR_COLUMNS, add_contact_sensors, add_whisker, compiled, new_model
from whisker_sim.shapes.base import mjcf
from whisker_sim.table import add_free_object, add_table, let_gravity_act
from whisker_sim.whisker import Array

TABLE_M = 0.0
"""Height of the table's top in World."""
OBJECT = "object_"
"""Prefix of the names of the objects, which distinguishes them from parts of the arm."""

_SERVO_RAD_S = 2.0 * np.pi * 40.0
_SERVO_INERTIA_KG_M2 = (1.0, 1.5, 0.8, 0.8, 0.06, 0.05, 0.012)
"""Inertia for which each servo is tuned, about that which its joint moves."""
_VISUALS: dict[str, tuple[tuple[float, ...], ...]] = {
    "foot": ((0.0, 0.0, 60.0, 0.0, 0.0, 200.0, 72.0), (-50.0, 0.0, 40.0, 0.0, 0.0, 40.0, 78.0)),
    "arm_1": ((0.0, 0.0, -120.0, 0.0, 0.0, 0.0, 60.0), (0.0, -60.0, 0.0, 0.0, 60.0, 0.0, 58.0)),
    "arm_2": ((0.0, 0.0, 0.0, 0.0, -200.0, 0.0, 54.0),),
    "arm_3": (
        (0.0, 0.0, -110.0, 0.0, 0.0, 0.0, 54.0),
        (0.0, 0.0, 0.0, 82.5, 0.0, 0.0, 50.0),
        (82.5, -45.0, 0.0, 82.5, 45.0, 0.0, 50.0),
    ),
    "arm_4": ((0.0, 0.0, 0.0, -82.5, 82.5, 0.0, 46.0), (-82.5, 82.5, 0.0, -82.5, 190.0, 0.0, 50.0)),
    "arm_5": ((0.0, 0.0, -190.0, 0.0, 30.0, -60.0, 46.0), (0.0, 30.0, -60.0, 0.0, 0.0, 0.0, 46.0)),
    "arm_6": ((0.0, 0.0, -40.0, 0.0, 0.0, 40.0, 44.0), (0.0, 0.0, 0.0, 88.0, 0.0, 0.0, 42.0)),
    "arm_7": ((0.0, 0.0, -10.0, 0.0, 0.0, 70.0, 40.0),),
    "tool": ((0.0, 0.0, MM_PER_M * LENGTH_M - 8.0, 0.0, 0.0, 16.0, 7.0),),
}
"""Capsules that represent the links: both ends and the radius (mm), in the frame of the body."""
_SUN = {
    "pos": "600 -500 1200",
    "dir": "-0.45 0.35 -0.8",
    "directional": "true",
    "diffuse": "0.55 0.55 0.55",
    "ambient": "0.1 0.1 0.1",
    "specular": "0.1 0.1 0.1",
}
_BLOCK_MM = (50.0, MM_PER_M * HALF_WIDTH_M, MM_PER_M * HALF_HEIGHT_M)
_LIGHT, _DARK = "0.93 0.94 0.95 1", "0.25 0.27 0.30 1"
_TOOL_MASS_KG, _TOOL_INERTIA_KG_M2 = 0.25, (4e-4, 5e-4, 2e-4)

TOOL_SENSOR = len(MOUNTS) * SENSOR_COLUMNS
"""Column of the sensor data, after those of the whiskers, that is positive while the tool itself is in contact."""


def build_arm_model(scene: ArmScene, start_rad: Array) -> mujoco.MjModel:
    """Compiles the model of `scene` with the arm's joints at `start_rad` (7,).

    Coordinates: joint angles relative to `start_rad`, then rotations of root and hinges of each whisker in the order of `MOUNTS`,
    then poses of the objects. Controls: joint angles relative to `start_rad`, then joint speeds.
    """
    return compiled(build_arm_mjcf(scene, start_rad))


def build_arm_mjcf(scene: ArmScene, start_rad: Array) -> str:
    """The model as MJCF."""
    timestep_s = scene.simulation.timestep_s
    root = new_model("arm", timestep_s, extent_m=1.0)
    option = root.find("option")
    let_gravity_act(option)
    option.set("jacobian", "sparse")
    world = root.find("worldbody")
    add_table(world, TABLE_M)
    ET.SubElement(world, "light", _SUN)
    tool = _add_arm(world, scene, start_rad)
    sensor = ET.SubElement(root, "sensor")
    for mount in MOUNTS:
        x_m, y_m, z_m = mount.pose[:3, 3]
        yaw_rad = np.arctan2(mount.pose[1, 0], mount.pose[0, 0])
        pose = {"pos": mjcf(*(MM_PER_M * np.array((x_m, y_m, z_m)))), "euler": mjcf(0.0, 0.0, yaw_rad)}
        base = ET.SubElement(tool, "body", pose, name=mount.name)
        add_whisker(base, scene.resolved_whisker, timestep_s, prefix=f"{mount.name}_")
        add_contact_sensors(sensor, {"subtree1": mount.name}, prefix=f"{mount.name}_")
    ET.SubElement(sensor, "contact", name="tool", body1="tool", num="1", reduce="maxforce", data="found")
    for free in scene.objects:
        add_free_object(root, free, TABLE_M, timestep_s, prefix=OBJECT)
    _add_servos(root)
    return ET.tostring(root, encoding="unicode")


def _add_arm(world: ET.Element, scene: ArmScene, start_rad: Array) -> ET.Element:
    """Adds the arm; returns the body of the tool's frame."""
    foot_mm = MM_PER_M * np.array(scene.arm.foot_m)
    body = ET.SubElement(world, "body", name="foot", pos=mjcf(*foot_mm), euler=mjcf(0.0, 0.0, scene.arm.yaw_rad))
    _add_visuals(body, "foot")
    rows = zip(panda.LINKS, panda.BODIES, start_rad, panda.TORQUE_N_M, strict=True)
    for index, (link, mass, angle_rad, torque_n_m) in enumerate(rows, start=1):
        # Tx and Tz of Craig's link transform in the frame of the previous link: Rx(alpha) rotates z to (0, -sin, cos).
        sin, cos = np.sin(link.alpha_rad), np.cos(link.alpha_rad)
        body = ET.SubElement(
            body,
            "body",
            name=f"arm_{index}",
            pos=mjcf(MM_PER_M * link.a_m, -MM_PER_M * link.d_m * sin, MM_PER_M * link.d_m * cos),
            euler=mjcf(link.alpha_rad, 0.0, angle_rad),
            gravcomp="1",
        )
        limit_nnm = NNM_PER_NM * torque_n_m
        ET.SubElement(body, "joint", name=f"arm_{index}", type="hinge", axis="0 0 1", actuatorfrcrange=mjcf(-limit_nnm, limit_nnm))
        ET.SubElement(
            body,
            "inertial",
            pos=mjcf(*(MM_PER_M * np.array(mass.center_m))),
            mass=mjcf(G_PER_KG * mass.mass_kg),
            fullinertia=mjcf(*(G_PER_KG * MM_PER_M**2 * np.array(mass.inertia_kg_m2))),
        )
        _add_visuals(body, f"arm_{index}")
    tool_mm = (0.0, 0.0, MM_PER_M * (panda.FLANGE_D_M + LENGTH_M))
    tool = ET.SubElement(body, "body", name="tool", pos=mjcf(*tool_mm), euler=mjcf(np.pi, 0.0, 0.0), gravcomp="1")
    ET.SubElement(
        tool,
        "inertial",
        pos=mjcf(0.0, 0.0, 0.3 * MM_PER_M * LENGTH_M),
        mass=mjcf(G_PER_KG * _TOOL_MASS_KG),
        diaginertia=mjcf(*(G_PER_KG * MM_PER_M**2 * np.array(_TOOL_INERTIA_KG_M2))),
    )
    _add_visuals(tool, "tool")
    # The block that bears the whiskers is the only part of the arm that comes near the objects, and can collide with them.
    ET.SubElement(tool, "geom", type="box", size=mjcf(*_BLOCK_MM), contype="1", conaffinity="0", condim="1", rgba=_DARK)
    return tool


def _add_visuals(body: ET.Element, name: str) -> None:
    for *ends_mm, radius_mm in _VISUALS[name]:
        seen = {"type": "capsule", "fromto": mjcf(*ends_mm), "size": mjcf(radius_mm), "rgba": _DARK if name == "tool" else _LIGHT}
        ET.SubElement(body, "geom", seen, contype="0", conaffinity="0")


def _add_servos(root: ET.Element) -> None:
    """Adds a critically damped servo about a moving reference for each joint."""
    actuator = ET.SubElement(root, "actuator")
    for index, inertia_kg_m2 in enumerate(_SERVO_INERTIA_KG_M2, start=1):
        stiffness = NNM_PER_NM * inertia_kg_m2 * _SERVO_RAD_S**2
        ET.SubElement(actuator, "position", name=f"angle_{index}", joint=f"arm_{index}", kp=mjcf(stiffness))
    for index, inertia_kg_m2 in enumerate(_SERVO_INERTIA_KG_M2, start=1):
        damping = 2.0 * NNM_PER_NM * inertia_kg_m2 * _SERVO_RAD_S
        ET.SubElement(actuator, "velocity", name=f"speed_{index}", joint=f"arm_{index}", kv=mjcf(damping))
