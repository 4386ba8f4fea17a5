"""Table with free-standing objects, held by gravity and friction only, so that a whisker can push them over.

An object is a solid upright prism of uniform density over a shape of the registry. It stands on feet at its rim: the corners of the
outline, or eight of its points if there are more. A round object therefore tips over a foot, or over the chord between two feet,
which is up to 8 % nearer to its centre than the rim. The feet touch only the table; whiskers touch only the sides, without friction
and with the stiffness of fixed objects. Objects do not collide with one another.

Units of the model are those of `model.py`: millimetres, grams, seconds.
"""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from whisker_sim.free_object import FreeObject
from whisker_sim.model import G_PER_KG, MM_PER_M
from whisker_sim.shapes.base import mjcf
from whisker_sim.whisker import Array

GRAVITY_M_S2 = 9.81

_FEET = 8
_FOOT_RADIUS_MM = 0.1
_NOSLIP_ITERATIONS = 5
"""MuJoCo's friction is soft: an object under a steady push of half the friction limit creeps by a micrometre per second. These
iterations without softness, after the solver's own, reduce the creep to less than a thousandth."""


def let_gravity_act(option: ET.Element) -> None:
    """Configures MJCF's `option` for objects that stand by gravity: elliptic friction cone, friction without slip."""
    option.set("gravity", mjcf(0.0, 0.0, -MM_PER_M * GRAVITY_M_S2))
    option.set("cone", "elliptic")
    option.set("noslip_iterations", str(_NOSLIP_ITERATIONS))


def add_table(world: ET.Element, top_m: float) -> None:
    """Adds the table to MJCF's `worldbody`: a plane at the height `top_m` in World."""
    place = {"pos": mjcf(0.0, 0.0, MM_PER_M * top_m), "size": mjcf(1e3, 1e3, 1.0)}
    ET.SubElement(world, "geom", place, name="table", type="plane", contype="0", conaffinity="2", rgba="0.93 0.92 0.90 1")


def add_free_object(root: ET.Element, free: FreeObject, top_m: float, timestep_s: float, prefix: str = "") -> None:
    """Adds `free` to the MJCF model `root`, which has `asset` and `worldbody`, on a table whose top is at `top_m`.

    Body and free joint have its name after `prefix`. The origin of the body is that of the shape's frame at half the object's
    height.
    """
    shape, half_height_mm = free.object, 0.5 * MM_PER_M * free.height_m
    outline_mm = MM_PER_M * shape.local_outline_m()
    x_m, y_m = shape.center_m
    body = ET.SubElement(
        root.find("worldbody"),
        "body",
        name=f"{prefix}{free.name}",
        pos=mjcf(MM_PER_M * x_m, MM_PER_M * y_m, MM_PER_M * top_m + half_height_mm),
        euler=mjcf(0.0, 0.0, shape.yaw_rad),
    )
    ET.SubElement(body, "freejoint", name=f"{prefix}{free.name}")
    add_solid_inertia(body, outline_mm, 2.0 * half_height_mm, G_PER_KG * free.mass_kg)
    _add_sides(root.find("asset"), body, free, half_height_mm)
    _add_visual(root.find("asset"), body, free, outline_mm, half_height_mm)
    for x_mm, y_mm in outline_mm[np.linspace(0, len(outline_mm), min(_FEET, len(outline_mm)), endpoint=False).astype(int)]:
        ET.SubElement(
            body,
            "geom",
            type="sphere",
            pos=mjcf(x_mm, y_mm, _FOOT_RADIUS_MM - half_height_mm),
            size=mjcf(_FOOT_RADIUS_MM),
            contype="2",
            conaffinity="0",
            condim="3",
            priority="1",
            friction=mjcf(free.friction, 0.0, 0.0),
            solref=mjcf(2.0 * timestep_s, 1.0),
            solimp="0.99 0.999 0.001 0.5 2",
            group="3",
        )


def displacement(model: mujoco.MjModel, qpos: Array, name: str) -> Array:
    """Displacements (..., 5) of the free object `name` from its start pose, for the model's coordinates `qpos` (..., nq).

    `name` is that of its joint. Columns: x, y and z of its centre (m, in World); yaw, the rotation about the vertical; and tilt,
    the angle between its axis and the vertical (both in rad). With the quaternion q of the rotation, yaw = 2 atan2(qz, qw) and tilt
    = 2 atan2(sqrt(qx^2 + qy^2), sqrt(qw^2 + qz^2)): a rotation about a horizontal axis followed by one about the vertical.
    """
    start = model.jnt_qposadr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)]
    at_rest, pose = model.qpos0[start : start + 7], qpos[..., start : start + 7]
    # Product of the pose's quaternion with the conjugate of that at the start, a rotation about the vertical: (c, 0, 0, s).
    (c, _, _, s), (w, x, y, z) = at_rest[3:], np.moveaxis(pose[..., 3:], -1, 0)
    qw, qx, qy, qz = c * w + s * z, c * x - s * y, c * y + s * x, c * z - s * w
    yaw_rad = 2.0 * np.arctan2(qz, qw)
    yaw_rad -= 2.0 * np.pi * np.round(yaw_rad / (2.0 * np.pi))
    tilt_rad = 2.0 * np.arctan2(np.hypot(qx, qy), np.hypot(qw, qz))
    moved_m = (pose[..., :3] - at_rest[:3]) / MM_PER_M
    return np.concatenate((moved_m, yaw_rad[..., None], tilt_rad[..., None]), axis=-1)


def _add_sides(asset: ET.Element, body: ET.Element, free: FreeObject, half_height_mm: float) -> None:
    """Adds the collision geometry for whiskers, which is not drawn: it may end in caps above and below the object."""
    for mesh in free.object.meshes(half_height_mm):
        ET.SubElement(asset, "mesh", mesh, name=f"{free.name}_{mesh['name']}")
    for geom in free.object.geoms(half_height_mm):
        named = {**geom, "mesh": f"{free.name}_{geom['mesh']}"} if "mesh" in geom else geom
        ET.SubElement(body, "geom", named, contype="0", conaffinity="1", condim="1", group="3")


def _add_visual(asset: ET.Element, body: ET.Element, free: FreeObject, outline_mm: Array, half_height_mm: float) -> None:
    """Adds a prism that is drawn and does not collide."""
    seen_mm = outline_mm[:: -(-len(outline_mm) // 96)]
    prism = [mjcf(x, y, z) for z in (-half_height_mm, half_height_mm) for x, y in seen_mm]
    name = f"{free.name}_visual"
    ET.SubElement(asset, "mesh", name=name, vertex=" ".join(prism), inertia="convex")
    ET.SubElement(body, "geom", type="mesh", mesh=name, contype="0", conaffinity="0", rgba="0.60 0.66 0.74 1")


def add_solid_inertia(body: ET.Element, outline_mm: Array, height_mm: float, mass_g: float) -> None:
    """Adds mass, centre and inertia of the solid prism over a polygon.

    Area, centroid and second moments are sums over the triangles between the origin and the edges a b: with
    w = a x b, area = sum w / 2, centroid = sum w (a + b) / (6 area), and the mean of p p' over the polygon
    sum w (a a' + b b' + (a + b)(a + b)') / (24 area).
    """
    a, b = outline_mm, np.roll(outline_mm, -1, axis=0)
    w = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area_mm2 = 0.5 * w.sum()
    center_mm = w @ (a + b) / (6.0 * area_mm2)
    mean_mm2 = sum((w[:, None] * p).T @ p for p in (a, b, a + b)) / (24.0 * area_mm2)
    (xx, xy), (_, yy) = mean_mm2 - np.outer(center_mm, center_mm)
    zz = height_mm**2 / 12.0
    inertia = mass_g * np.array((yy + zz, xx + zz, xx + yy, -xy, 0.0, 0.0))
    ET.SubElement(body, "inertial", pos=mjcf(*center_mm, 0.0), mass=mjcf(mass_g), fullinertia=mjcf(*inertia))
