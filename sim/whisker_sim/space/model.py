"""MuJoCo model of a whisker in space on a base with six degrees of freedom, and of one fixed solid.

The chain, the units, the contact and the servos of the base are those of `whisker_sim.model`. Each hinge of the chain consists of
three joints, which bend about two axes and twist; so does the root.

Contact. Near the joint of two capsules that follow each other, both press on the object, the second with its round end: with the
penetration d, and the radii R of wire and object in sum, within sqrt(2 R d) of the joint, inclined by up to sqrt(2 d / R). The
contact is twice as stiff there, so that the surface of the whisker has in effect a bump of half the penetration, on whose flanks a
frictionless contact comes to rest: the force then leaves the normal. Capsules therefore end before the joint. With a gap of sqrt(c
R d) on both sides, each presses at the joint with the depth (1 - c / 2) d. Both together press there as hard as one beside it if
the force grows with the power p of the depth and 2 (1 - c / 2)^p = 1. Between, the sum sags by a sixth for p = 1, but by a fiftieth
for p = 2, so that the stiffness of the contact is made to grow with the depth. What remains is divided by `_CHAINS`: the surface
consists of as many chains of capsules in parallel, whose joints lie at different places. A curved link carries short capsules along
its undeflected arc; the chains then average the inclination of the chords to the arc. The joints of all chains are 0.03 mm apart,
nearer than the width of their influence on a pin, which then overlap. A tapered link carries capsules around its cone, all with the
radius of the thinner end.
"""

import functools
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import pairwise
from math import ceil

import mujoco
import numpy as np

from whisker_sim.model import (
    G_PER_KG,
    MM_PER_M,
    NNM_PER_NM,
    add_capsule,
    add_contact_sensors,
    capsule_cuts_m,
    compiled,
    new_model,
)
from whisker_sim.shapes.base import mjcf
from whisker_sim.space.rotation import quaternion_of, undone
from whisker_sim.space.solids import Solid
from whisker_sim.space.whisker import ROOT_ORDER, SpatialWhisker, hinge_order
from whisker_sim.whisker import Array

BASE_COORDINATES = 6
"""Coordinates of the base: position along the axes of the start pose (mm), then yaw, pitch and roll relative to it (rad)."""
ROOT = slice(6, 9)
"""Coordinates of the root: yaw, pitch, twist (rad)."""
HINGES = 9
"""First coordinate of the chain's hinges, three for each."""
ROOT_FORCE = "root_force"
"""Sensor of the force (uN) that the whisker exerts on the base, along the axes of the root's link."""

_AXES = ("1 0 0", "0 1 0", "0 0 1")
_LETTERS = ("x", "y", "z")
_CURVED_CAPSULES = 320
"""Capsules along each chain of a curved whisker. Of 80 mm and a radius of 80 mm, their middles are 0.1 um below its surface."""
_CHAINS = 8
"""Chains of capsules in parallel. Their joints are an eighth of a capsule of a curved whisker apart."""
_GAP_PENETRATION_M = 0.2e-6
"""Square of the gap at the end of a capsule over the radius R: c d of a typical penetration d."""
_IMPEDANCE = "0.93 0.998 0.0008 0.5 2"
"""Impedance of contacts (MuJoCo's `solimp`), which grows with the penetration up to 0.8 um. The force of a contact is proportional
to d imp / (1 - imp): between 0.2 and 0.6 um it grows with about the power 2.7 of the penetration d."""
_TAPER_CAPSULES = 8
"""Capsules around a tapered link. Between two of them the surface is lower by a thirteenth of the change of radius."""
_BASE_MASS_G = 100.0
_BASE_INERTIA_G_MM2 = 1e5
_BASE_FREQUENCY_RAD_S = 2.0 * np.pi * 80.0
_SLICES = 16
"""Slices of a link over which mass and inertia are summed."""


def build_model(whisker: SpatialWhisker, solid: Solid, start: Array, timestep_s: float) -> mujoco.MjModel:
    """Compiles the model of `whisker` and `solid` with the base at the pose `start` (7,): position (m) and quaternion, in World.

    Coordinates: six of the base (`BASE_COORDINATES`), three of the root (`ROOT`), then three for each hinge in its order
    (`hinge_order`). Controls: velocities of the coordinates of the base.

    Raises `SimulationError` if MuJoCo rejects the model, as for links of too small a mass.
    """
    return compiled(build_mjcf(whisker, solid, tuple(start.tolist()), timestep_s))


@functools.lru_cache(maxsize=8)
def build_mjcf(whisker: SpatialWhisker, solid: Solid, start: tuple[float, ...], timestep_s: float) -> str:
    """The model as MJCF."""
    root = new_model("whisker", timestep_s, whisker.whisker.length_m)
    asset, world = root.find("asset"), root.find("worldbody")
    for mesh in solid.meshes():
        ET.SubElement(asset, "mesh", mesh)
    pose = {"pos": mjcf(*MM_PER_M * np.array(solid.center_m)), "quat": mjcf(*quaternion_of(solid.rotation))}
    body = ET.SubElement(world, "body", pose, name="object")
    for geom in solid.geoms():
        ET.SubElement(body, "geom", geom, contype="0", conaffinity="1", condim="1", rgba="0.60 0.66 0.74 1")
    add_whisker(_add_base(world, start), whisker, solid.sharpest_radius_m, timestep_s)
    _add_actuators(root)
    sensor = ET.SubElement(root, "sensor")
    add_contact_sensors(sensor, {"subtree1": "base", "body2": "object"})
    ET.SubElement(sensor, "force", name=ROOT_FORCE, site="root")
    return ET.tostring(root, encoding="unicode")


def _add_base(world: ET.Element, start: tuple[float, ...]) -> ET.Element:
    pose = {"pos": mjcf(*MM_PER_M * np.array(start[:3])), "quat": mjcf(*start[3:])}
    fixed = ET.SubElement(world, "body", pose, name="start")
    base = ET.SubElement(fixed, "body", name="base")
    ET.SubElement(base, "inertial", pos="0 0 0", mass=mjcf(_BASE_MASS_G), diaginertia=mjcf(*[_BASE_INERTIA_G_MM2] * 3))
    for axis in range(3):
        ET.SubElement(base, "joint", name=f"base_{_LETTERS[axis]}", type="slide", axis=_AXES[axis])
    for axis, name in ((2, "base_yaw"), (1, "base_pitch"), (0, "base_roll")):
        ET.SubElement(base, "joint", name=name, type="hinge", axis=_AXES[axis])
    return base


def add_whisker(base: ET.Element, whisker: SpatialWhisker, solid_radius_m: float, timestep_s: float) -> None:
    """Adds `whisker` to the body `base`, whose frame is its Base, for contacts with a surface of the radius `solid_radius_m`."""
    wire, nodes_m = whisker.whisker, whisker.node_arcs_m
    ends_m = np.concatenate(([0.0], whisker.hinge_arcs_m, [wire.length_m]))
    pieces = ceil(_CURVED_CAPSULES / wire.segments)
    parent, origin_m, frame = base, np.zeros(3), np.eye(3)
    for index, node_m in enumerate(nodes_m):
        start_m, end_m = ends_m[index], ends_m[index + 1]
        next_origin_m, next_frame = whisker.rest_point_m(start_m), whisker.rest_frame(node_m)
        body = ET.SubElement(
            parent,
            "body",
            name=f"link_{index}",
            pos=mjcf(*MM_PER_M * undone(frame, next_origin_m - origin_m)),
            quat=mjcf(*quaternion_of(frame.T @ next_frame)),
        )
        if index == 0:
            _add_joints(body, "root", ROOT_ORDER, np.eye(3), whisker.root_stiffness_n_m_rad, wire.damping_s)
            ET.SubElement(body, "site", name="root", size="0.1")
        else:
            # The axes are those of the undeflected wire at the hinge.
            axes = next_frame.T @ whisker.rest_frame(start_m)
            stiffness = whisker.stiffness_n_m_rad(index - 1)
            _add_joints(body, f"hinge_{index}", hinge_order(index - 1), axes, stiffness, wire.damping_s)
        _add_inertial(body, whisker, (next_origin_m, next_frame), start_m, end_m)
        for cuts_m in capsule_cuts_m(wire, index, (start_m, end_m), pieces, _CHAINS):
            for a, b, radius_mm in _capsules(whisker, (next_origin_m, next_frame), cuts_m, solid_radius_m):
                add_capsule(body, a, b, radius_mm, timestep_s, _IMPEDANCE)
        parent, origin_m, frame = body, next_origin_m, next_frame


def _add_joints(
    body: ET.Element, name: str, order: tuple[int, int, int], axes: Array, stiffness_n_m_rad: Array, damping_s: float
) -> None:
    """Adds three joints about the columns of `axes` to a body; MuJoCo applies the first one next to the parent."""
    for axis in order:
        stiffness = NNM_PER_NM * stiffness_n_m_rad[axis]
        ET.SubElement(
            body,
            "joint",
            name=f"{name}_{_LETTERS[axis]}",
            type="hinge",
            axis=mjcf(*axes[:, axis]),
            stiffness=mjcf(stiffness),
            damping=mjcf(stiffness * damping_s),
        )


def _capsules(
    whisker: SpatialWhisker, frame: tuple[Array, Array], cuts_m: Array, solid_radius_m: float
) -> Iterator[tuple[Array, Array, float]]:
    """End points (3,), in `frame` (origin and directors), and radii (mm) of the capsules between the arc lengths `cuts_m`."""
    origin_m, directors = frame
    points_mm = MM_PER_M * undone(directors, whisker.rest_point_m(cuts_m) - origin_m)
    radii_mm = MM_PER_M * whisker.whisker.radius_m(cuts_m)
    for (a, a_mm, _), (b, b_mm, end_m) in pairwise(zip(points_mm, radii_mm, cuts_m, strict=True)):
        length_mm = np.linalg.norm(b - a)
        along = (b - a) / length_mm
        slope = (b_mm - a_mm) / length_mm
        gap_mm = MM_PER_M * np.sqrt((solid_radius_m + whisker.whisker.radius_m(end_m)) * _GAP_PENETRATION_M)
        gap_mm = min(gap_mm, 0.25 * length_mm) * along
        # At the tip the wire ends with the capsule.
        a, b = a + gap_mm, b if end_m == whisker.whisker.length_m else b - gap_mm
        if slope == 0.0:
            yield a, b, a_mm
            continue
        left, up = np.array((-along[1], along[0], 0.0)), np.array((0.0, 0.0, 1.0))
        radius_mm = min(a_mm, b_mm)
        for angle_rad in 2.0 * np.pi * np.arange(_TAPER_CAPSULES) / _TAPER_CAPSULES:
            across = np.cos(angle_rad) * left + np.sin(angle_rad) * up
            normal = np.sqrt(1.0 - slope**2) * across - slope * along
            yield a + (a_mm - radius_mm) * normal, b + (b_mm - radius_mm) * normal, radius_mm


def _add_inertial(body: ET.Element, whisker: SpatialWhisker, frame: tuple[Array, Array], start_m: float, end_m: float) -> None:
    """Adds mass and inertia of the link: those of discs, whose inertia is m r^2 / 4 across and m r^2 / 2 along the wire."""
    origin_m, directors = frame
    cuts_m = np.linspace(start_m, end_m, _SLICES + 1)
    middles_m = 0.5 * (cuts_m[:-1] + cuts_m[1:])
    masses_g = G_PER_KG * whisker.whisker.mass_kg(cuts_m[:-1], cuts_m[1:])
    points_mm = MM_PER_M * undone(directors, whisker.rest_point_m(middles_m) - origin_m)
    mass_g = masses_g.sum()
    center_mm = masses_g @ points_mm / mass_g
    offsets_mm = points_mm - center_mm
    squares_mm2 = np.sum(offsets_mm**2, axis=1)
    tangents = undone(directors, whisker.rest_frame(middles_m)[:, :, 0])
    disc_mm2 = 0.25 * (MM_PER_M * whisker.whisker.radius_m(middles_m)) ** 2
    inertia = np.eye(3) * (masses_g @ (squares_mm2 + disc_mm2))
    inertia -= np.einsum("n,ni,nj->ij", masses_g, offsets_mm, offsets_mm)
    inertia += np.einsum("n,ni,nj->ij", masses_g * disc_mm2, tangents, tangents)
    full = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    ET.SubElement(body, "inertial", pos=mjcf(*center_mm), mass=mjcf(mass_g), fullinertia=mjcf(*full))


def _add_actuators(root: ET.Element) -> None:
    """Adds position servos behind an integrator, as for the planar base."""
    actuator = ET.SubElement(root, "actuator")
    inertias = [_BASE_MASS_G] * 3 + [_BASE_INERTIA_G_MM2] * 3
    for name, inertia in zip(("x", "y", "z", "yaw", "pitch", "roll"), inertias, strict=True):
        ET.SubElement(
            actuator,
            "intvelocity",
            joint=f"base_{name}",
            kp=mjcf(inertia * _BASE_FREQUENCY_RAD_S**2),
            kv=mjcf(2.0 * inertia * _BASE_FREQUENCY_RAD_S),
            actrange="-1e6 1e6",
        )
