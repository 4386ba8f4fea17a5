"""Exact quasi-static whisker in space, for many loads at once: an inextensible, unshearable Kirchhoff rod on a compliant root.

A contact at the arc length a loads the rod with a force f; beyond the contact the rod is unloaded. With the contact at the origin
and the directors d1 (tangent), d2 (left) and d3 (up) there as axes, the equations are integrated from a back to the root:

    dp/ds = d1,  ddi/ds = kappa x di,  m = f x p,
    kappa = (m . d1) / GJ d1 + (m . d2) / EI d2 + (kappa0 + (m . d3) / EI) d3,

with EI = E pi d^4 / 64 and GJ = EI / (1 + nu) for a round wire of Poisson ratio nu (Love, "A Treatise on the Mathematical Theory of
Elasticity", chapters 18 and 19). The moment at the root turns the springs of the suspension, which are in series: a yaw about +z of
Base, a pitch about the turned +y, a twist about the wire. Only the parameters of the whisker are shared with the solvers in Rust
(`crates/whisker/src/rod`, Taylor series) and by SciPy (`whisker_sim.physics.scipy_rod`, boundary-value problem from the root).
"""

from dataclasses import dataclass

import msgspec
import numpy as np

from whisker_sim.whisker import Array, Positive, Whisker

_STEPS = 512
"""Runge-Kutta steps in each piece of constant pre-curvature: errors below 1e-10 for tapers down to a quarter."""

_NEXT, _AFTER_NEXT = np.array((1, 2, 0)), np.array((2, 0, 1))
"""Axes that follow each axis of a right-handed frame."""


class Suspension(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Stiffness of the three springs at the root, in series (N m/rad)."""

    yaw_n_m_rad: Positive
    pitch_n_m_rad: Positive
    twist_n_m_rad: Positive


@dataclass(frozen=True)
class SpatiallyLoaded:
    """Whiskers in Base, each under one force; n cases."""

    point_m: Array
    """Points of application (n, 3) of the forces, on the centre line."""
    directors: Array
    """Directors there (n, 3, 3), as columns: tangent, left and upper normal of the material."""
    moment_n_m: Array
    """Moments (n, 3) at the root: twisting about x, bending about y and z."""
    root_rad: Array
    """Angles (n, 3) of the springs at the root: yaw, pitch, twist."""


def spatially_loaded(
    whisker: Whisker, suspension: Suspension, poisson_ratio: float, arc_m: Array, force_n: Array, steps: int = _STEPS
) -> SpatiallyLoaded:
    """The whisker under forces `force_n` (n, 3) at the arc lengths `arc_m` (n,).

    The components of a force are along the tangent at the contact, towards the tip, and along the left and upper normals of the
    material there. `steps` is the number of Runge-Kutta steps in each piece of constant pre-curvature; the error decreases with its
    fourth power.
    """
    count = len(arc_m)
    state = np.concatenate((np.zeros((count, 1, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))), axis=1)
    ends_m = np.cumsum([arc.length_m for arc in whisker.curvature])
    starts_m = np.concatenate(([0.0], ends_m[:-1]))
    unbent = np.array((1.0 + poisson_ratio, 1.0, 1.0))
    for start_m, end_m, arc in zip(starts_m[::-1], ends_m[::-1], whisker.curvature[::-1], strict=True):
        # If a contact lies nearer to the root than this piece, its step is zero.
        near_m = np.clip(arc_m, start_m, end_m)
        step_m = (start_m - near_m) / steps
        if not step_m.any():
            continue
        h = step_m[:, None, None]

        def compliance(s_m: Array) -> Array:
            bending_n_m2 = whisker.youngs_modulus_pa * np.pi * whisker.diameter_m(s_m) ** 4 / 64.0
            return unbent / bending_n_m2[:, None]

        def slope(state: Array, compliance_here: Array, curvature_per_m: float = arc.curvature_per_m) -> Array:
            position, directors = state[:, 0], state[:, 1:]
            moment = _cross(force_n, position)
            about = np.einsum("nij,nj->ni", directors, moment)
            about *= compliance_here
            about[:, 2] += curvature_per_m
            curvature = np.einsum("ni,nij->nj", about, directors)
            changes = np.empty_like(state)
            changes[:, 0] = directors[:, 0]
            changes[:, 1:] = _cross(curvature[:, None], directors)
            return changes

        for index in range(steps):
            s_m = near_m + index * step_m
            at_start, midway, at_end = (compliance(s_m + share * step_m) for share in (0.0, 0.5, 1.0))
            k1 = slope(state, at_start)
            k2 = slope(state + 0.5 * h * k1, midway)
            k3 = slope(state + 0.5 * h * k2, midway)
            k4 = slope(state + h * k3, at_end)
            state = state + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    position, to_root = state[:, 0], state[:, 1:]
    in_root = np.einsum("nij,nj->ni", to_root, _cross(force_n, position))
    root_rad, rotation = _turned(suspension, in_root)
    directors = rotation @ to_root
    point_m = -np.einsum("nij,nj->ni", directors, position)
    moment_n_m = np.einsum("nij,nj->ni", rotation, in_root)
    return SpatiallyLoaded(point_m, directors, moment_n_m, root_rad)


def _cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis: that of `np.cross` to the bit, and several times as fast for few vectors."""
    return a[..., _NEXT] * b[..., _AFTER_NEXT] - a[..., _AFTER_NEXT] * b[..., _NEXT]


def _turned(suspension: Suspension, moment: Array) -> tuple[Array, Array]:
    """Angles (n, 3) of the springs under moments (n, 3) in the frame of the turned root, and its rotation (n, 3, 3)."""
    twist = moment[:, 0] / suspension.twist_n_m_rad
    # Components along the axes of pitch and yaw, which the later angles of the series have turned.
    across = np.cos(twist) * moment[:, 1] - np.sin(twist) * moment[:, 2]
    upright = np.sin(twist) * moment[:, 1] + np.cos(twist) * moment[:, 2]
    pitch = across / suspension.pitch_n_m_rad
    yaw = (np.cos(pitch) * upright - np.sin(pitch) * moment[:, 0]) / suspension.yaw_n_m_rad
    rotation = _about(2, yaw) @ _about(1, pitch) @ _about(0, twist)
    return np.stack((yaw, pitch, twist), axis=-1), rotation


def _about(axis: int, angle_rad: Array) -> Array:
    """Rotations (n, 3, 3) about a coordinate axis."""
    rotation = np.zeros((len(angle_rad), 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rotation[:, axis, axis] = 1.0
    rotation[:, j, j] = rotation[:, k, k] = np.cos(angle_rad)
    rotation[:, k, j] = np.sin(angle_rad)
    rotation[:, j, k] = -np.sin(angle_rad)
    return rotation
