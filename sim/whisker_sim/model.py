"""MuJoCo model of a whisker, a chain of hinged links on a moving base, and of one fixed object.

Mechanics. The rod is cut into N segments of length l. Each segment bends at its midpoint by one hinge with the compliance of the
segment, int ds/EI; the chain thus has N hinges and N + 1 links, of which the first and the last have half length. Links are rigid
pieces of the undeflected rod, so that the chain at rest coincides with the undeflected shape. At the boundary between two
segments, in the middle of a link, position and tangent equal those of the rod to second order in l. The compliant root is an
additional hinge.

Units. The model is in millimetres, grams and seconds, hence micronewtons and nanonewton metres. In SI units the inertias of the
links would be below MuJoCo's minimum.

Contact. Contact has a softness of about a micrometre, and no friction unless a coefficient is given (`add_friction`). A curved link
carries short capsules along its undeflected arc: the bending moment vanishes at a frictionless contact, so the rod has its
undeflected curvature there. A tapered link carries capsules along both flanks of its cone. Capsules along its centre line would
form a staircase, on whose edges the contact normal deviates by several times the cone's half angle.

Where a capsule ends, its round end is inclined to the surface by up to sqrt(2 d / R) at the penetration d, R being the sum of the
radii of wire and object. Without friction the contact leaves that place; with friction the force, which is on the cone about that
normal, deviates there, by some degrees on a pin. The surface of a whisker with friction therefore consists of several chains of
capsules in parallel, whose ends lie at different places.
"""

import functools
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import ceil

import mujoco
import numpy as np

from whisker_sim.errors import SimulationError
from whisker_sim.shapes import Shape
from whisker_sim.shapes.base import mjcf
from whisker_sim.whisker import Array, Whisker

MM_PER_M = 1e3
G_PER_KG = 1e3
N_PER_UN = 1e-6
NNM_PER_NM = 1e9

_CAPSULES_PER_LINK_AND_SEGMENT = 0.15
"""The surface of a capsule is tilted against the rod by up to half of its share of the curvature. With six capsules per link at 40
segments the tilt is negligible; in finer chains it decreases with the square of the segment length, as all other errors do."""
IMPEDANCE = "0.99 0.999 0.001 0.5 2"
"""Impedance of contacts, MuJoCo's `solimp`."""
_CONTACT_DAMPING_RATIO = 1.5
"""Above one, so that a whisker dragged along the object does not lose contact between two capsules."""
# With this mass and stiffness the whisker deflects the base by a micrometre at most; the base lags behind its command by 4 ms.
_BASE_MASS_G = 100.0
_BASE_INERTIA_G_MM2 = 1e5
_BASE_FREQUENCY_RAD_S = 2.0 * np.pi * 80.0

BASE_LAG_S = 2.0 / _BASE_FREQUENCY_RAD_S
"""Time by which the base lags behind its command at constant velocity, in addition to one time step."""

POINTS = 8

SENSOR_COLUMNS = 4 + 6 * POINTS
SENSORS = {"force": slice(0, 3), "distance": 3, "points": slice(4, 4 + 6 * POINTS)}
"""Columns of the sensor data: net contact force (uN); smallest distance (mm); force (uN) and position (mm), in World, of each of
the `POINTS` strongest contacts, zero for missing ones. A model with friction has the further strongest contacts after them."""


_FRICTION_CHAINS = 8
"""Chains of capsules in parallel, of which the surface of a whisker with friction consists."""
_FRICTION_RATE_PER_S = 250.0
"""Rate at which a slip velocity decays in a contact that begins to stick."""
_FRICTION_SOFTNESS_S2 = 5e-9
"""Regularisation of the normal direction relative to the inertia, times the square of the time step. As the stiffness of the
reference acceleration has the same dependence, the penetration is the same at every time step."""
_FRICTION_IMPRATIO = 2e5
"""Ratio of the regularisations of normal and slip: a sticking whisker creeps by less than a micrometre per second."""


def build_model(whisker: Whisker, shape: Shape, timestep_s: float, friction: float = 0.0) -> mujoco.MjModel:
    """Compiles the model of `whisker` and the object `shape`, between which the coefficient of friction is `friction`.

    Coordinates: base x and y (mm), base yaw, root rotation, then hinge rotations (rad), relative to the undeflected whisker with
    its base at the origin of World. Controls: velocities of the three coordinates of the base.

    Raises `SimulationError` if MuJoCo rejects the model, as for links of too small a mass.
    """
    return compiled(build_mjcf(whisker, shape, timestep_s, friction))


def compiled(model: str) -> mujoco.MjModel:
    """Compiles MJCF; raises `SimulationError` if MuJoCo rejects it."""
    try:
        return mujoco.MjModel.from_xml_string(model)
    except ValueError as error:
        raise SimulationError(f"MuJoCo rejects the model: {' '.join(str(error).split())}") from None


@functools.lru_cache(maxsize=8)
def build_mjcf(whisker: Whisker, shape: Shape, timestep_s: float, friction: float = 0.0) -> str:
    """The model as MJCF."""
    root = new_model("whisker", timestep_s, whisker.length_m)
    asset, world = root.find("asset"), root.find("worldbody")
    for mesh in shape.meshes():
        ET.SubElement(asset, "mesh", mesh)
    _add_object(world, shape)
    chains = _FRICTION_CHAINS if friction > 0.0 else 1
    add_whisker(_add_base(world), whisker, timestep_s, chains=chains)
    _add_actuators(root)
    add_contact_sensors(ET.SubElement(root, "sensor"), {"subtree1": "base", "body2": "object"}, chains=chains)
    if friction > 0.0:
        add_friction(root, friction, timestep_s)
    return ET.tostring(root, encoding="unicode")


def add_friction(root: ET.Element, coefficient: float, timestep_s: float) -> None:
    """Replaces the frictionless contacts of MJCF's `root` by pairs with Coulomb friction.

    MuJoCo's contact is a convex relaxation of Coulomb's law, in which a slip velocity v drives the surfaces apart: they separate if
    the normal force is below mu b v / R, with the rate b of the reference acceleration of slip and the regularisation R of the
    normal. With the rate of the normal direction, 1 / `timestep_s`, a whisker of a few milligrams loses contact at some mm/s and
    then bounces. Only a pair can have a rate of its own (`solreffriction`). With a lower rate and a softer normal direction contact
    persists; the ratio of the regularisations keeps creep small. `noslip_iterations`, which keep the feet of objects on a
    table from creeping (`table`), are not used here: five of them change no coordinate of `rub_circle_15_mu30_curved` by more than
    1.7e-7 (mm, rad; MuJoCo 3.17.0), and take more time.

    In every direction the `_FRICTION_CHAINS` contacts in parallel have together the regularisation and each the reference
    acceleration of a single contact. MuJoCo divides given rates by the impedance, on which the regularisation depends.
    """
    root.find("option").set("cone", "elliptic")
    root.find("option").set("impratio", mjcf(_FRICTION_IMPRATIO))
    softness = _FRICTION_SOFTNESS_S2 / timestep_s**2
    impedance = 1.0 / (1.0 + _FRICTION_CHAINS * softness)
    # Critically damped, with the time constant 2 h that MuJoCo recommends, which the softness of the contact lengthens.
    rate_per_s = (1.0 + softness) / timestep_s
    stiffness_per_s2 = rate_per_s / (4.0 * timestep_s)
    geoms = root.findall(".//body[@name='base']//geom"), root.findall(".//body[@name='object']/geom")
    for kind, of_kind in zip(("whisker", "object"), geoms, strict=True):
        for index, geom in enumerate(of_kind):
            geom.set("name", f"{kind}_{index}")
            # Pairs replace the selection by types.
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
    contact = ET.SubElement(root, "contact")
    for of_whisker, of_object in product(*geoms):
        ET.SubElement(
            contact,
            "pair",
            geom1=of_whisker.get("name"),
            geom2=of_object.get("name"),
            condim="3",
            friction=mjcf(coefficient, coefficient, 0.0, 0.0, 0.0),
            solref=mjcf(-impedance * stiffness_per_s2, -impedance * rate_per_s),
            solimp=mjcf(impedance, impedance, 0.001, 0.5, 2.0),
            solreffriction=mjcf(-1.0, -impedance * _FRICTION_RATE_PER_S),
        )


def new_model(name: str, timestep_s: float, extent_m: float) -> ET.Element:
    """An MJCF model with an empty `asset` and `worldbody` and the options that whiskers need."""
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    option = ET.SubElement(
        root,
        "option",
        timestep=mjcf(timestep_s),
        gravity="0 0 0",
        integrator="discrete",
        solver="Newton",
        jacobian="dense",
        tolerance="1e-12",
    )
    # The native collider of MuJoCo 3.17 lets a capsule that lies along a prism's face penetrate by tens of micrometres.
    ET.SubElement(option, "flag", nativeccd="disable")
    ET.SubElement(root, "statistic", center="0 0 0", extent=mjcf(MM_PER_M * extent_m))
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "global", offwidth="1280", offheight="960")
    asset = ET.SubElement(root, "asset")
    white = {"rgb1": "1 1 1", "rgb2": "1 1 1", "width": "4", "height": "24"}
    ET.SubElement(asset, "texture", white, type="skybox", builtin="flat")
    ET.SubElement(root, "worldbody")
    return root


def add_contact_sensors(sensor: ET.Element, pair: dict[str, str], prefix: str = "", chains: int = 1) -> None:
    """Adds the sensors of `SENSORS` for the contacts of `pair` to MJCF's `sensor`, with `POINTS` contacts for each chain."""
    ET.SubElement(sensor, "contact", pair, name=f"{prefix}net", num="1", reduce="netforce", data="force")
    ET.SubElement(sensor, "contact", pair, name=f"{prefix}nearest", num="1", reduce="mindist", data="dist")
    ET.SubElement(sensor, "contact", pair, name=f"{prefix}points", num=str(chains * POINTS), reduce="maxforce", data="force pos")


def _add_object(world: ET.Element, shape: Shape) -> None:
    x_m, y_m = shape.center_m
    pose = {"pos": mjcf(MM_PER_M * x_m, MM_PER_M * y_m, 0.0), "euler": mjcf(0.0, 0.0, shape.yaw_rad)}
    body = ET.SubElement(world, "body", pose, name="object")
    for geom in shape.geoms():
        ET.SubElement(body, "geom", geom, contype="0", conaffinity="1", condim="1", rgba="0.60 0.66 0.74 1")


def _add_base(world: ET.Element) -> ET.Element:
    base = ET.SubElement(world, "body", name="base")
    ET.SubElement(base, "inertial", pos="0 0 0", mass=mjcf(_BASE_MASS_G), diaginertia=mjcf(*[_BASE_INERTIA_G_MM2] * 3))
    ET.SubElement(base, "joint", name="base_x", type="slide", axis="1 0 0")
    ET.SubElement(base, "joint", name="base_y", type="slide", axis="0 1 0")
    ET.SubElement(base, "joint", name="base_yaw", type="hinge", axis="0 0 1")
    return base


def add_whisker(base: ET.Element, whisker: Whisker, timestep_s: float, prefix: str = "", chains: int = 1) -> None:
    """Adds `whisker` to the body `base`, whose frame is its Base. Names of bodies and joints begin with `prefix`.

    The surface consists of `chains` chains of capsules in parallel (`capsule_cuts_m`).
    """
    length_m, step_m = whisker.length_m, whisker.segment_m
    hinges_m = (np.arange(whisker.segments) + 0.5) * step_m
    ends_m = np.concatenate(([0.0], hinges_m, [length_m]))
    nodes_m = np.arange(whisker.segments + 1) * step_m
    pieces = ceil(_CAPSULES_PER_LINK_AND_SEGMENT * whisker.segments)
    parent, frame = base, _RestFrame(np.zeros(2), 0.0)
    for index, node_m in enumerate(nodes_m):
        start_m, end_m = ends_m[index], ends_m[index + 1]
        link_frame = _RestFrame(whisker.rest_point_m(start_m), float(whisker.rest_angle_rad(node_m)))
        body = ET.SubElement(
            parent,
            "body",
            name=f"{prefix}link_{index}",
            pos=mjcf(*MM_PER_M * frame.local(link_frame.origin_m), 0.0),
            euler=mjcf(0.0, 0.0, link_frame.angle_rad - frame.angle_rad),
        )
        stiffness_n_m_rad = (
            whisker.root_stiffness_n_m_rad if index == 0 else 1.0 / whisker.compliance_rad_n_m((index - 1) * step_m, index * step_m)
        )
        ET.SubElement(
            body,
            "joint",
            name=f"{prefix}root" if index == 0 else f"{prefix}hinge_{index}",
            type="hinge",
            axis="0 0 1",
            stiffness=mjcf(NNM_PER_NM * stiffness_n_m_rad),
            damping=mjcf(NNM_PER_NM * stiffness_n_m_rad * whisker.damping_s),
        )
        _add_inertial(body, whisker, link_frame, start_m, end_m)
        for cuts_m in capsule_cuts_m(whisker, index, (start_m, end_m), pieces, chains):
            for a, b, radius_mm in _capsules(whisker, link_frame, cuts_m):
                add_capsule(body, (*a, 0.0), (*b, 0.0), radius_mm, timestep_s)
        parent, frame = body, link_frame


def capsule_cuts_m(whisker: Whisker, link: int, ends_m: tuple[float, float], pieces: int, chains: int) -> Iterator[Array]:
    """Arc lengths between which a link has capsules, its index and ends given; one array for each of `chains` chains.

    A link of a curved whisker has `pieces` capsules in a chain, one of a straight whisker one. The chains are shifted along the
    wire, beyond the ends of the link by less than a capsule of a curved whisker.
    """
    curved = any(arc.curvature_per_m != 0.0 for arc in whisker.curvature)
    for chain in range(chains):
        shift_m = (chain - 0.5 * (chains - 1)) * whisker.segment_m / pieces / chains
        cuts_m = shift_m + np.linspace(*ends_m, (pieces if curved else 1) + 1)
        if link == 0:
            cuts_m[0] = 0.0
        if link == whisker.segments:
            cuts_m[-1] = whisker.length_m
        yield cuts_m


def add_capsule(
    body: ET.Element,
    start_mm: Sequence[float],
    end_mm: Sequence[float],
    radius_mm: float,
    timestep_s: float,
    impedance: str = IMPEDANCE,
) -> None:
    """Adds a capsule of the whisker's surface to the link `body`, between two points (3,) in its frame.

    `impedance` is that of its contacts, MuJoCo's `solimp`.
    """
    ET.SubElement(
        body,
        "geom",
        type="capsule",
        fromto=mjcf(*start_mm, *end_mm),
        size=mjcf(radius_mm),
        contype="1",
        conaffinity="0",
        condim="1",
        priority="1",
        solref=mjcf(2.0 * timestep_s, _CONTACT_DAMPING_RATIO),
        solimp=impedance,
        rgba="0.85 0.33 0.10 1",
    )


def _capsules(whisker: Whisker, frame: "_RestFrame", cuts_m: Array) -> Iterator[tuple[Array, Array, float]]:
    """End points (2,), in `frame`, and radii (mm) of the capsules between `cuts_m`.

    A tapered piece has two capsules with the radius of its thinner end, tangent to either flank of the cone.
    """
    points_mm, radii_mm = MM_PER_M * frame.local(whisker.rest_point_m(cuts_m)), MM_PER_M * whisker.radius_m(cuts_m)
    for (a, a_mm), (b, b_mm) in pairwise(zip(points_mm, radii_mm, strict=True)):
        length_mm = np.hypot(*(b - a))
        along = (b - a) / length_mm
        left = np.array((-along[1], along[0]))
        slope = (b_mm - a_mm) / length_mm
        radius_mm = min(a_mm, b_mm)
        for side in (1.0, -1.0) if slope != 0.0 else (1.0,):
            normal = side * np.sqrt(1.0 - slope**2) * left - slope * along
            yield a + (a_mm - radius_mm) * normal, b + (b_mm - radius_mm) * normal, radius_mm


def _add_inertial(body: ET.Element, whisker: Whisker, frame: "_RestFrame", start_m: float, end_m: float) -> None:
    """Adds mass and inertia of the link, summed over point masses of equal slices of its arc."""
    cuts_m = np.linspace(start_m, end_m, 17)
    masses_g = G_PER_KG * whisker.mass_kg(cuts_m[:-1], cuts_m[1:])
    points_mm = MM_PER_M * frame.local(whisker.rest_point_m(0.5 * (cuts_m[:-1] + cuts_m[1:])))
    mass_g = masses_g.sum()
    center_mm = masses_g @ points_mm / mass_g
    inertia_g_mm2 = masses_g @ np.sum((points_mm - center_mm) ** 2, axis=1)
    # Only the inertia about the normal of the plane has an effect; equal values satisfy the triangle inequality.
    ET.SubElement(body, "inertial", pos=mjcf(*center_mm, 0.0), mass=mjcf(mass_g), diaginertia=mjcf(*[inertia_g_mm2] * 3))


def _add_actuators(root: ET.Element) -> None:
    """Adds position servos behind an integrator: the base then has a velocity, which contact damping depends on."""
    actuator = ET.SubElement(root, "actuator")
    for joint, inertia in (("base_x", _BASE_MASS_G), ("base_y", _BASE_MASS_G), ("base_yaw", _BASE_INERTIA_G_MM2)):
        ET.SubElement(
            actuator,
            "intvelocity",
            joint=joint,
            kp=mjcf(inertia * _BASE_FREQUENCY_RAD_S**2),
            kv=mjcf(2.0 * inertia * _BASE_FREQUENCY_RAD_S),
            actrange="-1e6 1e6",
        )


@dataclass(frozen=True)
class _RestFrame:
    """Frame of a link of the undeflected whisker, relative to Base."""

    origin_m: Array
    angle_rad: float

    def local(self, points_m: Array) -> Array:
        """Points (..., 2) of Base in this frame."""
        cos, sin = np.cos(self.angle_rad), np.sin(self.angle_rad)
        return (points_m - self.origin_m) @ np.array(((cos, -sin), (sin, cos)))
