"""Exact quasi-static whisker under two forces, for many base poses at once.

The equations are those of `elastica`, integrated from the outer contact back to the root; at the inner contact the second force is
added. Both contacts are frictionless, so that each force is normal to the whisker's surface. With the outer contact at the origin,
its force F along +y, and the force f of the inner contact at the point p, the bending moment between root and inner contact is

    M(s) = -x(s) F + (p_x - x(s)) f_y - (p_y - y(s)) f_x.

The contacts with an object are the two arc lengths and forces for which the surfaces touch with opposite normals at both places. An
object may be on the left of the whisker at one contact and on its right at the other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Array, Whisker

_STEPS = 128
_ITERATIONS = 40
_TOLERANCE = 1e-10
_DIFFERENCE = 1e-7
_HALVINGS = 10


@dataclass(frozen=True)
class LoadedTwice:
    """Whiskers in Base, each under two forces; n cases. The inner contact is the first of each pair."""

    point_m: Array
    """Points of application (n, 2, 2) of the forces, on the centre line."""
    tangent_rad: Array
    """Tangent angles (n, 2) there."""
    moment_n_m: Array
    """Bending moments (n,) at the root."""


@dataclass(frozen=True)
class TouchingTwice:
    """Whiskers in contact with an object in two places, in World; n cases. The inner contact is the first of each pair."""

    arc_m: Array
    """(n, 2)."""
    force_n: Array
    """Magnitudes (n, 2)."""
    surface_m: Array
    """Points (n, 2, 2) of the object's surface."""
    moment_n_m: Array
    solved: NDArray[np.bool_]
    """Whether the equations are satisfied with two pressing forces (n,); otherwise the other fields are undefined."""


def loaded_twice(whisker: Whisker, arc_m: Array, force_n: Array, lean_rad: Array | float = 0.0) -> LoadedTwice:
    """The whisker under forces `force_n` (n, 2), positive to the left, at the ascending arc lengths `arc_m` (n, 2).

    The forces are perpendicular to the whisker, or rotated from there by `lean_rad` (n, 2) (counter-clockwise).
    """
    lean_rad = np.broadcast_to(lean_rad, arc_m.shape)
    inner_m, outer_m = arc_m.T
    x, y, t = np.zeros(len(arc_m)), np.zeros(len(arc_m)), -lean_rad[:, 1]
    # Force of the inner contact and its moment about the origin: none until the contact is reached.
    fx, fy, about = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    inner = np.stack((x, y, t))
    ends_m = np.cumsum([arc.length_m for arc in whisker.curvature])
    starts_m = np.concatenate(([0.0], ends_m[:-1]))
    bending_per_m4 = whisker.youngs_modulus_pa * np.pi / 64.0
    for start_m, end_m, arc in zip(starts_m[::-1], ends_m[::-1], whisker.curvature[::-1], strict=True):
        from_m, reached_m = np.clip(outer_m, start_m, end_m), np.clip(inner_m, start_m, end_m)
        for near_m, far_m, loads in ((from_m, reached_m, False), (reached_m, np.full_like(x, start_m), True)):
            if loads:
                arrives = (inner_m >= start_m) & (inner_m < end_m)
                inner = np.where(arrives, np.stack((x, y, t)), inner)
                angle = inner[2] + lean_rad[:, 0]
                loaded = inner_m >= start_m
                fx, fy = np.where(loaded, -force_n[:, 0] * np.sin(angle), 0.0), np.where(loaded, force_n[:, 0] * np.cos(angle), 0.0)
                about = inner[0] * fy - inner[1] * fx
            step_m = (far_m - near_m) / _STEPS

            def slope(
                state: Array,
                s_m: Array,
                curvature_per_m: float = arc.curvature_per_m,
                fx: Array = fx,
                total_y: Array = force_n[:, 1] + fy,
                about: Array = about,
            ) -> Array:
                x, y, t = state
                moment_n_m = about - x * total_y + y * fx
                bending_n_m2 = bending_per_m4 * whisker.diameter_m(s_m) ** 4
                return np.stack((np.cos(t), np.sin(t), curvature_per_m + moment_n_m / bending_n_m2))

            state = np.stack((x, y, t))
            for index in range(_STEPS):
                s_m = near_m + index * step_m
                k1 = slope(state, s_m)
                k2 = slope(state + 0.5 * step_m * k1, s_m + 0.5 * step_m)
                k3 = slope(state + 0.5 * step_m * k2, s_m + 0.5 * step_m)
                k4 = slope(state + step_m * k3, s_m + step_m)
                state = state + step_m / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            x, y, t = state
    moment_n_m = about - x * (force_n[:, 1] + fy) + y * fx
    base_rad = t - moment_n_m / whisker.root_stiffness_n_m_rad
    cos, sin = np.cos(base_rad), np.sin(base_rad)

    def in_base(dx: Array, dy: Array) -> Array:
        return np.stack((cos * dx + sin * dy, cos * dy - sin * dx), axis=-1)

    point_m = np.stack((in_base(inner[0] - x, inner[1] - y), in_base(-x, -y)), axis=1)
    tangent_rad = np.stack((inner[2], -lean_rad[:, 1]), axis=-1) - base_rad[:, None]
    return LoadedTwice(point_m, tangent_rad, moment_n_m)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def touching_twice(whisker: Whisker, shape: Shape, sides: Array, poses: Array, arc_m: Array, force_n: Array) -> TouchingTwice:
    """Whiskers with base poses (n, 3) in contact with `shape` in two places, by damped Newton's method.

    `sides` (n, 2) states on which side of the whisker the object is (+1 left); `arc_m` and `force_n` (n, 2) are initial guesses of
    the arc lengths, ascending, and of the magnitudes of the forces. The unknowns are scaled by the length of the whisker and by
    EI / L^2 at its root; the Jacobian consists of forward differences.
    """
    force_scale_n = whisker.youngs_modulus_pa * np.pi * whisker.root_diameter_m**4 / 64.0 / whisker.length_m**2
    lean_rad = sides * float(np.arcsin(whisker.radius_slope))

    def state(unknown: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, LoadedTwice]:
        """Gaps in lengths and angles between opposite normals (m, 4), surface points (m, 2, 2), loads."""
        arc_m = np.clip(unknown[:, :2], 1e-3, 1.0) * whisker.length_m
        load = loaded_twice(whisker, arc_m, -sides[rows] * unknown[:, 2:] * force_scale_n, lean_rad[rows])
        x, y, yaw = (column[:, None] for column in poses[rows].T)
        cos, sin = np.cos(yaw), np.sin(yaw)
        px, py = np.moveaxis(load.point_m, -1, 0)
        contact_m = np.stack((x + cos * px - sin * py, y + sin * px + cos * py), axis=-1)
        surface_m, distance_m = (values.reshape(len(rows), 2, -1) for values in shape.closest(contact_m.reshape(-1, 2)))
        outward = (contact_m - surface_m) / distance_m
        angle = yaw + load.tangent_rad + lean_rad[rows]
        along, normal = np.stack((np.cos(angle), np.sin(angle)), axis=-1), np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
        toward = -sides[rows]
        miss_rad = np.arctan2(toward * np.sum(outward * along, axis=-1), toward * np.sum(outward * normal, axis=-1))
        gap = (distance_m[..., 0] - whisker.radius_m(arc_m)) / whisker.length_m
        return np.concatenate((gap, miss_rad), axis=-1), surface_m, load

    unknown = np.concatenate((arc_m / whisker.length_m, force_n / force_scale_n), axis=-1)
    pending = np.arange(len(unknown))
    for _ in range(_ITERATIONS):
        guess = unknown[pending]
        neighbours = (guess + _DIFFERENCE * np.concatenate((np.zeros((1, 4)), np.eye(4)))[:, None]).reshape(-1, 4)
        residual, *shifted = np.split(state(neighbours, np.tile(pending, 5))[0], 5)
        jacobian = np.stack([(other - residual) / _DIFFERENCE for other in shifted], axis=-1)
        regular = np.isfinite(jacobian).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(jacobian))) > 0.0)
        update = np.full_like(guess, np.nan)
        update[regular] = np.linalg.solve(jacobian[regular], residual[regular][..., None])[..., 0]
        share, before, rows = np.ones((len(guess), 1)), np.linalg.norm(residual, axis=1), np.arange(len(guess))
        for _ in range(_HALVINGS):
            after = np.linalg.norm(state(guess[rows] - share[rows] * update[rows], pending[rows])[0], axis=1)
            rows = rows[~(after < before[rows]) & ~(before[rows] < _TOLERANCE)]
            if len(rows) == 0:
                break
            share[rows] *= 0.5
        unknown[pending] = guess - share * update
        pending = pending[~(np.max(np.abs(update), axis=1) < _TOLERANCE)]
        if len(pending) == 0:
            break
    residual, surface_m, load = state(unknown, np.arange(len(unknown)))
    arc, force = unknown[:, :2], unknown[:, 2:]
    inside = np.all((arc > 1e-3) & (arc < 1.0) & (force > 0.0), axis=1) & (arc[:, 0] < arc[:, 1])
    solved = inside & np.all(np.abs(residual) < 1e3 * _TOLERANCE, axis=1)
    return TouchingTwice(arc * whisker.length_m, force * force_scale_n, surface_m, load.moment_n_m, solved)
