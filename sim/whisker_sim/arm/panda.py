"""Franka Emika Panda arm: kinematics, limits and masses.

Craig's convention (J. J. Craig, "Introduction to Robotics", 3rd edition, section 3.4): frame i is fixed to link i, its z axis is
that of joint i, and T_i(q_i) = Rx(alpha_i) Tx(a_i) Rz(q_i) Tz(d_i) places it in frame i - 1. Parameters and limits are those of
Franka's documentation ("Robot and interface specifications", frankaemika.github.io/docs/control_parameters.html); masses, centres
of mass and inertias those of its package `franka_description` (`robots/common/inertial.yaml`), which come from C. Gaz et al.,
"Dynamic Identification of the Franka Emika Panda Robot With Retrieval of Feasible Parameters", IEEE RA-L 4(4), 2019.
"""

from typing import NamedTuple

import msgspec
import numpy as np

from whisker_sim.whisker import Array

NAME = "panda"


class Link(msgspec.Struct, frozen=True):
    """One row of the Denavit-Hartenberg table."""

    a_m: float
    alpha_rad: float
    d_m: float


_QUARTER = 0.5 * np.pi
LINKS = (
    Link(0.0, 0.0, 0.333),
    Link(0.0, -_QUARTER, 0.0),
    Link(0.0, _QUARTER, 0.316),
    Link(0.0825, _QUARTER, 0.0),
    Link(-0.0825, -_QUARTER, 0.384),
    Link(0.0, _QUARTER, 0.0),
    Link(0.088, _QUARTER, 0.0),
)
JOINTS = len(LINKS)
FLANGE_D_M = 0.107
"""Distance of the flange along the last axis, in the frame of the last link."""

LOWER_RAD = np.array((-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973))
UPPER_RAD = np.array((2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973))
SPEED_RAD_S = np.array((2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61))
TORQUE_N_M = np.array((87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0))
READY_RAD = np.array((0.0, -0.25 * np.pi, 0.0, -0.75 * np.pi, 0.0, _QUARTER, 0.25 * np.pi))
"""Initial posture of Franka's examples: elbow up, flange down."""


class Body(NamedTuple):
    """Mass, centre of mass and inertia of a link, in its frame."""

    mass_kg: float
    center_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float, float, float, float]
    """xx, yy, zz, xy, xz, yz, about the centre of mass."""


BODIES = (
    Body(4.970684, (0.003875, 0.002081, -0.04762), (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169)),
    Body(0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704)),
    Body(3.228604, (0.027518, 0.039252, -0.066502), (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)),
    Body(3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
    Body(1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229)),
    Body(1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341)),
    Body(0.735522, (0.010517, -0.004252, 0.061597), (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741)),
)


def frames(q_rad: Array) -> Array:
    """Poses (..., 8, 4, 4) of the links and, last, of the flange, in the base frame of the arm, for joint angles (..., 7)."""
    pose = np.broadcast_to(np.eye(4), (*q_rad.shape[:-1], 4, 4))
    poses = []
    for index, link in enumerate(LINKS):
        pose = pose @ _link_pose(link, q_rad[..., index])
        poses.append(pose)
    return np.stack([*poses, pose @ translation((0.0, 0.0, FLANGE_D_M))], axis=-3)


def tool_pose(q_rad: Array, tool: Array) -> Array:
    """Poses (..., 4, 4), in the base frame of the arm, of a body mounted on the flange at `tool` (4, 4)."""
    return frames(q_rad)[..., -1, :, :] @ tool


def body_jacobian(q_rad: Array, tool: Array) -> Array:
    """Jacobians (..., 6, 7) of the twist (v, w), in its own frame, of a body mounted on the flange at `tool` (4, 4).

    xi = J(q) dq/dt. Joint i rotates the body about its axis z_i through o_i: v = z_i x (p - o_i), w = z_i, transformed to the body.
    """
    poses = frames(q_rad)
    pose = poses[..., -1, :, :] @ tool
    axes, origins = poses[..., :-1, :3, 2], poses[..., :-1, :3, 3]
    linear = np.cross(axes, pose[..., None, :3, 3] - origins)
    # Rows are joints here; multiplication by the rotation from the right transforms them to the body.
    return np.concatenate((linear @ pose[..., :3, :3], axes @ pose[..., :3, :3]), axis=-1).swapaxes(-1, -2)


def translation(offset_m: tuple[float, float, float]) -> Array:
    """Pose (4, 4) of a pure translation."""
    pose = np.eye(4)
    pose[:3, 3] = offset_m
    return pose


def rotation_z(angle_rad: float) -> Array:
    """Pose (4, 4) of a rotation about z."""
    pose, cos, sin = np.eye(4), np.cos(angle_rad), np.sin(angle_rad)
    pose[:2, :2] = ((cos, -sin), (sin, cos))
    return pose


def rotation_x(angle_rad: float) -> Array:
    """Pose (4, 4) of a rotation about x."""
    pose, cos, sin = np.eye(4), np.cos(angle_rad), np.sin(angle_rad)
    pose[1:3, 1:3] = ((cos, -sin), (sin, cos))
    return pose


def _link_pose(link: Link, q_rad: Array) -> Array:
    """T_i(q_i) (..., 4, 4)."""
    fixed = rotation_x(link.alpha_rad) @ translation((link.a_m, 0.0, 0.0))
    turned = np.zeros((*q_rad.shape, 4, 4))
    turned[..., 0, 0] = turned[..., 1, 1] = np.cos(q_rad)
    turned[..., 1, 0] = np.sin(q_rad)
    turned[..., 0, 1] = -turned[..., 1, 0]
    turned[..., 2, 2] = turned[..., 3, 3] = 1.0
    turned[..., 2, 3] = link.d_m
    return fixed @ turned
