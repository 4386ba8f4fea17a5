"""Objects of sweeps that give way: they stand freely on a table, their surface is elastic, or both.

Stand. The body `stand` moves along x, y and z of World and turns about the vertical. Gravity presses its foot onto a table. Tipping
is excluded. The foot, a point at the centroid of the outline, transmits the friction of the whole support: a force f and a moment m
about the vertical within the ellipsoid (f / (mu N))^2 + (m / (mu N r))^2 <= 1 with the weight N and the mean distance r of the
support's points from the centroid, for a uniform pressure. This is the usual approximation of the limit surface of a planar slider
(R. D. Howe, M. R. Cutkosky, "Practical force-motion models for sliding manipulation", IJRR 1996), and MuJoCo's elliptic cone of a
contact with torsional friction; both have the velocity normal to the surface. Several feet would not do: the shares of the weight
that they bear are indeterminate.

Surface. The force on the surface is its stiffness times its indentation along the normal. The body `object` with the rigid outline
is held by springs of this stiffness along x and y. A frictionless contact force is along the normal, and so is the displacement
f / k of the outline. A whisker that touches the displaced outline has the normal of the undeformed one at the point of contact, and
is inside it by f / k. These are the conditions of a contact with a surface that is indented locally, whose deepest point is the
contact. The two agree for a single contact without friction. The mass on the springs is small and critically damped.

Units of the model are those of `model.py`: millimetres, grams, seconds.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import mujoco
import numpy as np

from whisker_sim.free_object import Stand
from whisker_sim.model import G_PER_KG, MM_PER_M
from whisker_sim.shapes import Shape
from whisker_sim.shapes.base import HALF_HEIGHT_MM, mjcf
from whisker_sim.table import add_solid_inertia, add_table, let_gravity_act
from whisker_sim.truth import turned
from whisker_sim.whisker import Array

_SURFACE_MASS_G = 0.001
"""Mass on the springs of an elastic surface, small beside that of a preset whisker (25 mg). Its frequency is at least 220 Hz."""
_FOOT_RADIUS_MM = 0.1
_PARTS = 32
_STAND_JOINTS = ("stand_x", "stand_y", "stand_yaw")
_SURFACE_JOINTS = ("surface_x", "surface_y")
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "yaw": "0 0 1"}


@dataclass(frozen=True)
class Yielding:
    """Displacements of an object that gives way, at n instants, in World."""

    center_m: Array
    """Origin (2,) of the shape's frame at the start."""
    stand_m: Array
    """Displacements (n, 2) of the origin of the shape's frame since the start."""
    yaw_rad: Array
    """Rotations (n,) about that origin since the start."""
    indentation_m: Array
    """Displacements (n, 2) of the surface at the contact relative to the object."""

    def to_world(self, points_m: Array) -> Array:
        """Points (n, 2) of the outline that the whisker touches, given at their places at the start."""
        return turned(points_m - self.center_m, self.yaw_rad) + self.center_m + self.stand_m + self.indentation_m

    def to_start(self, points_m: Array) -> Array:
        """Inverse of `to_world`."""
        return turned(points_m - self.center_m - self.stand_m - self.indentation_m, -self.yaw_rad) + self.center_m


def replace_object(root: ET.Element, shape: Shape, stand: Stand | None, stiffness_n_m: float | None, timestep_s: float) -> None:
    """Replaces the fixed object of a sweep's MJCF `root` by one that stands freely or has an elastic surface.

    Its coordinates follow those of the whisker.
    """
    world = root.find("worldbody")
    body = world.find("body[@name='object']")
    world.remove(body)
    place = {key: body.attrib.pop(key) for key in ("pos", "euler")}
    mounted = world
    if stand is not None:
        let_gravity_act(root.find("option"))
        add_table(world, -HALF_HEIGHT_MM / MM_PER_M)
        mounted = ET.SubElement(world, "body", name="stand", **place)
        for axis in ("x", "y", "z", "yaw"):
            joint = {"name": f"stand_{axis}", "type": "hinge" if axis == "yaw" else "slide", "axis": _AXES[axis]}
            ET.SubElement(mounted, "joint", joint)
        of_surface_g = 0.0 if stiffness_n_m is None else _SURFACE_MASS_G
        outline_mm = MM_PER_M * shape.local_outline_m()
        add_solid_inertia(mounted, outline_mm, 2.0 * HALF_HEIGHT_MM, G_PER_KG * stand.mass_kg - of_surface_g)
        _add_foot(mounted, outline_mm, stand.friction, timestep_s)
    else:
        body.attrib.update(place)
    mounted.append(body)
    if stiffness_n_m is not None:
        # 1 N/m is 1e3 g/s2, the model's unit.
        stiffness = 1e3 * stiffness_n_m
        damping = 2.0 * np.sqrt(stiffness * _SURFACE_MASS_G)
        for name in _SURFACE_JOINTS:
            spring = {"stiffness": mjcf(stiffness), "damping": mjcf(damping)}
            ET.SubElement(body, "joint", spring, name=name, type="slide", axis=_AXES[name[-1]])
        # Slides transmit forces alone: the rotational inertia has no effect.
        ET.SubElement(body, "inertial", pos="0 0 0", mass=mjcf(_SURFACE_MASS_G), diaginertia=mjcf(*[_SURFACE_MASS_G] * 3))


def _add_foot(body: ET.Element, outline_mm: Array, friction: float, timestep_s: float) -> None:
    center_mm, reach_mm = support(outline_mm)
    ET.SubElement(
        body,
        "geom",
        type="sphere",
        pos=mjcf(*center_mm, _FOOT_RADIUS_MM - HALF_HEIGHT_MM),
        size=mjcf(_FOOT_RADIUS_MM),
        contype="2",
        conaffinity="0",
        condim="4",
        priority="1",
        friction=mjcf(friction, friction * reach_mm, 0.0),
        solref=mjcf(2.0 * timestep_s, 1.0),
        solimp="0.99 0.999 0.001 0.5 2",
        group="3",
    )


def support(outline_mm: Array) -> tuple[Array, float]:
    """Centroid (2,) of a convex polygon, and the mean distance of its points from it.

    The centroid is a sum over the signed triangles between the origin and the edges. The mean distance is one over the triangles
    between the centroid and the edges, and over equal parts of them, each a point at its own centroid.
    """
    a, b, area = _triangles(outline_mm)
    center_mm = area @ (a + b) / 3.0 / area.sum()
    # The parts of a triangle are not exact for a distance: signed ones from a point outside would add up their errors.
    a, b, area = _triangles(outline_mm - center_mm)
    share = (np.arange(_PARTS) + 0.5) / _PARTS
    # Points u a + v b with the Jacobian 2 area; u + v = w at the area w dw.
    w, t = np.meshgrid(np.sqrt(share), share)
    points_mm = w[..., None, None] * ((1.0 - t)[..., None, None] * a + t[..., None, None] * b)
    distance_mm = np.mean(np.linalg.norm(points_mm, axis=-1), axis=(0, 1))
    return center_mm, float(area @ distance_mm / area.sum())


def _triangles(outline_mm: Array) -> tuple[Array, Array, Array]:
    """Corners (n, 2) and (n, 2) of the triangles between the origin and the edges of a polygon, and their signed areas (n,)."""
    a, b = outline_mm, np.roll(outline_mm, -1, axis=0)
    return a, b, 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def yielding(model: mujoco.MjModel, qpos: Array, shape: Shape) -> Yielding:
    """Displacements of the object for the model's coordinates `qpos` (n, nq)."""

    def coordinates(names: tuple[str, ...]) -> Array:
        joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
        found = [qpos[:, model.jnt_qposadr[joint]] if joint >= 0 else np.zeros(len(qpos)) for joint in joints]
        return np.stack(found, axis=-1)

    # Slides of a body are along the axes of its frame: at the start that of the shape, and then that of the stand.
    stand = coordinates(_STAND_JOINTS)
    yaw_rad = stand[:, 2]
    surface_m = coordinates(_SURFACE_JOINTS) / MM_PER_M
    center_m = np.array(shape.center_m)
    stand_m = turned(stand[:, :2] / MM_PER_M, np.array(shape.yaw_rad))
    return Yielding(center_m, stand_m, yaw_rad, turned(surface_m, shape.yaw_rad + yaw_rad))
