"""Exact quasi-static whisker, for many base poses at once.

A contact at the arc length s_c loads the rod with a force F at a point of its surface, without friction normal to the surface;
beyond the contact the rod is unloaded. With the loaded point at the origin and the force along +y, the equations are integrated
from s_c back to the root:

    dx/ds = cos t,  dy/ds = sin t,  dt/ds = kappa0(s) + M(s) / EI(s),  M(s) = -x(s) F.

Without friction the angle t at s_c is that between the tangent and the surface: zero except on a tapered rod, whose surface is
inclined to the centre line by asin r', where r(s) is the radius, and x = 0 there, because the force passes through the centre line.
Friction turns the force by the angle psi from the normal (psi > 0 if the friction on the rod is towards its tip); the centre line
then is at x = -r sin psi, and the rod has a bending moment at the contact. The bending moment M(0) at the root rotates the
compliant root by M(0) / k. For
given (s_c, F) this is an initial-value problem for shape and load of the rod. The contact with an object is the pair (s_c, F) for
which the two surfaces touch and their normals are opposite. The only inputs shared with the simulator are the parameters of the
whisker and the signed distances of the shapes.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Array, Whisker

_STEPS = 128
"""Runge-Kutta steps in each piece of constant pre-curvature; the relative error of the moment is then 1e-9."""
_ITERATIONS = 40
_TOLERANCE = 1e-10
_DIFFERENCE = 1e-7
_HALVINGS = 10


@dataclass(frozen=True)
class Loaded:
    """Whiskers in Base, each under one force; n cases."""

    point_m: Array
    """Points of application (n, 2) of the forces, on the centre line."""
    tangent_rad: Array
    """Tangent angles (n,) there."""
    moment_n_m: Array
    """Bending moments (n,) at the root: root stiffness times root rotation."""


@dataclass(frozen=True)
class Touching:
    """Whiskers in contact with an object, in World; n cases."""

    arc_m: Array
    force_n: Array
    """Magnitudes (n,)."""
    contact_m: Array
    """Points (n, 2) of the centre line."""
    surface_m: Array
    """Points (n, 2) of the object's surface."""
    tangent_rad: Array
    moment_n_m: Array
    solved: NDArray[np.bool_]
    """Whether the equations are satisfied (n,); otherwise the other fields are undefined."""

    def replaced(self, rows: NDArray[np.intp], other: "Touching") -> "Touching":
        """A copy with the cases `rows` taken from `other`."""
        values = {field.name: getattr(self, field.name).copy() for field in fields(self)}
        for name, value in values.items():
            value[rows] = getattr(other, name)
        return Touching(**values)

    def __getitem__(self, index: int) -> "Touching":
        """One case, with arrays of length one."""
        return Touching(*(getattr(self, field.name)[index : index + 1] for field in fields(self)))


def loaded(whisker: Whisker, arc_m: Array, force_n: Array, lean_rad: Array | float = 0.0, offset_m: Array | float = 0.0) -> Loaded:
    """The whisker under forces `force_n` (n,), positive to the left, at the arc lengths `arc_m` (n,).

    The forces are perpendicular to the whisker, or rotated from there by `lean_rad` (n,) (counter-clockwise). They pass the centre
    line at the distance `offset_m` (n,), positive if the centre line is to the right of the force.
    """
    lean_rad, offset_m = np.broadcast_to(lean_rad, arc_m.shape), np.broadcast_to(offset_m, arc_m.shape)
    x, y, t = offset_m.copy(), np.zeros_like(arc_m), -lean_rad
    ends_m = np.cumsum([arc.length_m for arc in whisker.curvature])
    starts_m = np.concatenate(([0.0], ends_m[:-1]))
    bending_per_m4 = whisker.youngs_modulus_pa * np.pi / 64.0
    for start_m, end_m, arc in zip(starts_m[::-1], ends_m[::-1], whisker.curvature[::-1], strict=True):
        # If the contact lies nearer to the root than this piece, its step is zero.
        near_m = np.clip(arc_m, start_m, end_m)
        step_m = (start_m - near_m) / _STEPS

        def bend(x: Array, s_m: Array, curvature_per_m: float = arc.curvature_per_m) -> Array:
            return curvature_per_m - x * force_n / (bending_per_m4 * whisker.diameter_m(s_m) ** 4)

        for index in range(_STEPS):
            s_m = near_m + index * step_m
            x1, y1, t1 = np.cos(t), np.sin(t), bend(x, s_m)
            angle = t + 0.5 * step_m * t1
            x2, y2, t2 = np.cos(angle), np.sin(angle), bend(x + 0.5 * step_m * x1, s_m + 0.5 * step_m)
            angle = t + 0.5 * step_m * t2
            x3, y3, t3 = np.cos(angle), np.sin(angle), bend(x + 0.5 * step_m * x2, s_m + 0.5 * step_m)
            angle = t + step_m * t3
            x4, y4, t4 = np.cos(angle), np.sin(angle), bend(x + step_m * x3, s_m + step_m)
            x = x + step_m / 6.0 * (x1 + 2.0 * (x2 + x3) + x4)
            y = y + step_m / 6.0 * (y1 + 2.0 * (y2 + y3) + y4)
            t = t + step_m / 6.0 * (t1 + 2.0 * (t2 + t3) + t4)
    moment_n_m = -x * force_n
    base_rad = t - moment_n_m / whisker.root_stiffness_n_m_rad
    cos, sin = np.cos(base_rad), np.sin(base_rad)
    x = x - offset_m
    return Loaded(np.stack((-cos * x - sin * y, sin * x - cos * y), axis=-1), -lean_rad - base_rad, moment_n_m)


@np.errstate(over="ignore", invalid="ignore")
def touching(
    whisker: Whisker, shape: Shape, face: int, poses: Array, arc_m: Array, force_n: Array, friction_rad: Array | float = 0.0
) -> Touching:
    """Whiskers with base poses (n, 3) in contact with `shape` on their side `face` (+1 left), by Newton's method.

    `arc_m` and `force_n` (n,) are initial guesses of the arc length and the magnitude of the force, and `friction_rad` (n,) are the
    force's angles to the normal, positive if the friction on the whisker is towards its tip. The unknowns are scaled by the
    length of the whisker and by EI / L^2 at its root; the Jacobian consists of forward differences.
    """
    bending_n_m2 = whisker.youngs_modulus_pa * np.pi * whisker.root_diameter_m**4 / 64.0
    scale = np.array((whisker.length_m, -face * bending_n_m2 / whisker.length_m**2))
    lean_rad = face * float(np.arcsin(whisker.radius_slope))
    friction_rad = np.broadcast_to(np.asarray(friction_rad, dtype=float), arc_m.shape)

    def state(unknown: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array, Loaded]:
        """Gap of the surfaces in lengths and angle between opposite normals (m, 2); contact points, surface points, loads."""
        arc_m = np.clip(unknown[:, 0], 1e-3, 1.0) * scale[0]
        turn_rad = face * friction_rad[rows]
        offset_m = -whisker.radius_m(arc_m) * np.sin(friction_rad[rows])
        load = loaded(whisker, arc_m, unknown[:, 1] * scale[1], lean_rad + turn_rad, offset_m)
        x, y, yaw = poses[rows].T
        cos, sin = np.cos(yaw), np.sin(yaw)
        px, py = load.point_m.T
        contact_m = np.stack((x + cos * px - sin * py, y + sin * px + cos * py), axis=-1)
        surface_m, distance_m = shape.closest(contact_m)
        outward = (contact_m - surface_m) / distance_m[:, None]
        angle = yaw + load.tangent_rad + lean_rad
        along, normal = np.stack((np.cos(angle), np.sin(angle))), np.stack((-np.sin(angle), np.cos(angle)))
        # The object's outward normal is opposite to the normal of the whisker's surface on the object's side.
        miss_rad = np.arctan2(-face * np.sum(outward.T * along, axis=0), -face * np.sum(outward.T * normal, axis=0))
        gap = (distance_m - whisker.radius_m(arc_m)) / whisker.length_m
        return np.stack((gap, miss_rad), axis=-1), contact_m, surface_m, load

    unknown = np.stack((arc_m / scale[0], force_n / abs(scale[1])), axis=-1)
    pending = np.arange(len(arc_m))
    for _ in range(_ITERATIONS):
        guess = unknown[pending]
        # Residual and shifted residuals form one batch: an integration costs about the same for few cases as for many.
        neighbours = (guess + _DIFFERENCE * np.array(((0, 0), (1, 0), (0, 1)))[:, None]).reshape(-1, 2)
        residual, *shifted = np.split(state(neighbours, np.tile(pending, 3))[0], 3)
        # A diverged case has no finite residual; it remains unsolved and needs no warning.
        with np.errstate(invalid="ignore"):
            jacobian = np.stack([(other - residual) / _DIFFERENCE for other in shifted], axis=-1)
        update = _solve(jacobian, residual)

        def retried(trial: Array, rows: NDArray[np.intp], pending: NDArray[np.intp] = pending) -> Array:
            return state(trial, pending[rows])[0]

        unknown[pending] = guess - update * _damping(retried, guess, update, residual)
        pending = pending[~(np.max(np.abs(update), axis=1) < _TOLERANCE)]
        if len(pending) == 0:
            break
    everyone = np.arange(len(arc_m))
    residual, contact_m, surface_m, load = state(unknown, everyone)
    inside = (unknown[:, 0] > 1e-3) & (unknown[:, 0] < 1.0) & (unknown[:, 1] > 0.0)
    solved = inside & np.all(np.abs(residual) < 1e3 * _TOLERANCE, axis=1)
    tangent_rad = poses[:, 2] + load.tangent_rad
    force_n = unknown[:, 1] * abs(scale[1])
    return Touching(unknown[:, 0] * scale[0], force_n, contact_m, surface_m, tangent_rad, load.moment_n_m, solved)


def _damping(residual_of: Callable[[Array, NDArray[np.intp]], Array], guess: Array, update: Array, residual: Array) -> Array:
    """Step sizes (n, 1), halved until the residual decreases; at the corners of an outline it may not."""
    share = np.ones((len(guess), 1))
    before = np.hypot(*residual.T)
    rows = np.arange(len(guess))
    for _ in range(_HALVINGS):
        after = np.hypot(*residual_of(guess[rows] - share[rows] * update[rows], rows).T)
        rows = rows[~(after < before[rows]) & ~(before[rows] < _TOLERANCE)]
        if len(rows) == 0:
            break
        share[rows] *= 0.5
    return share


def _solve(matrix: Array, right: Array) -> Array:
    """Solutions (n, 2) of n systems of two equations by Cramer's rule; NaN for singular matrices."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, -1)
    determinant = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack((d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]), axis=-1) / determinant[:, None]
