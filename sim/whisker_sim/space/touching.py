"""Exact quasi-static whisker in space in contact with a solid, for many base poses at once.

A frictionless contact at the arc length a loads the rod with a force along the outward normal n of the solid. On a tapered wire the
normal of the surface is inclined to the centre line: n . d1 = r', with the radius r(s). The contact is the arc length and the two
components of the force across the wire for which

    dist(p) = r(a),  n . d1 = r',  (n . d2, n . d3) parallel to (f . d2, f . d3),

with the point p and the directors d1, d2, d3 of the rod under that force (`whisker_sim.rod`). The only inputs shared with the
simulator are the parameters of the whisker and the signed distances of the solids.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from whisker_sim.rod import SpatiallyLoaded, spatially_loaded
from whisker_sim.space.rotation import applied, undone
from whisker_sim.space.solids import Solid
from whisker_sim.space.whisker import SpatialWhisker
from whisker_sim.whisker import Array

_STEPS = 96
"""Runge-Kutta steps in each piece: errors below 1e-7, a thousandth of the smallest bound of a certificate."""
_ITERATIONS = 30
_TOLERANCE = 1e-9
_DIFFERENCE = 1e-6
_HALVINGS = 8


@dataclass(frozen=True)
class SpatiallyTouching:
    """Whiskers in contact with a solid, in World unless stated otherwise; n cases."""

    arc_m: Array
    force_n: Array
    """Forces (n, 3) on the whisker."""
    contact_m: Array
    """Points (n, 3) of the centre line."""
    surface_m: Array
    """Points (n, 3) of the surface of the solid."""
    normal: Array
    """Outward unit normals (n, 3) of the solid."""
    moment_n_m: Array
    """Moments (n, 3) at the root, in Base."""
    solved: NDArray[np.bool_]
    """Whether the equations are satisfied (n,); otherwise the other fields are undefined."""


@dataclass(frozen=True)
class _State:
    residual: Array
    """Gap in lengths of the whisker, and two components of the normal (m, 3)."""
    load: SpatiallyLoaded
    force: Array
    """Components (m, 3) of the force along the directors at the contact."""
    contact_m: Array
    surface_m: Array
    normal: Array


class Touch:
    """The equations of contact for n poses of the base: positions (n, 3) and rotations (n, 3, 3)."""

    def __init__(self, whisker: SpatialWhisker, solid: Solid, position_m: Array, rotation: Array) -> None:
        self._whisker, self._solid, self._position_m, self._rotation = whisker, solid, position_m, rotation
        wire = whisker.whisker
        bending_n_m2 = wire.youngs_modulus_pa * np.pi * wire.root_diameter_m**4 / 64.0
        self._scale = np.array((wire.length_m, *[bending_n_m2 / wire.length_m**2] * 2))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def solved_from(self, arc_m: Array, force_n: Array) -> SpatiallyTouching:
        """Newton's method from the arc lengths (n,) and the forces across the wire (n, 2), to the left and up."""
        unknown = np.column_stack((arc_m, force_n)) / self._scale
        pending = np.arange(len(arc_m))
        for _ in range(_ITERATIONS):
            guess = unknown[pending]
            shifts = _DIFFERENCE * np.concatenate((np.zeros((1, 3)), np.eye(3)))
            neighbours = (guess + shifts[:, None]).reshape(-1, 3)
            residual, *shifted = np.split(self._state(neighbours, np.tile(pending, 4)).residual, 4)
            jacobian = np.stack([(other - residual) / _DIFFERENCE for other in shifted], axis=-1)
            update = _solutions(jacobian, residual)
            unknown[pending] = guess - update * self._damping(guess, update, residual, pending)
            pending = pending[~(np.max(np.abs(update), axis=1) < _TOLERANCE)]
            if len(pending) == 0:
                break
        state = self._state(unknown, np.arange(len(arc_m)))
        inside = (unknown[:, 0] > 1e-3) & (unknown[:, 0] < 1.0)
        force_n = applied(self._rotation, applied(state.load.directors, state.force))
        pushes = np.sum(force_n * state.normal, axis=1) > 0.0
        solved = inside & pushes & np.all(np.abs(state.residual) < 1e2 * _TOLERANCE, axis=1)
        arc_m = unknown[:, 0] * self._scale[0]
        return SpatiallyTouching(arc_m, force_n, state.contact_m, state.surface_m, state.normal, state.load.moment_n_m, solved)

    def _state(self, unknown: Array, rows: NDArray[np.intp]) -> _State:
        """State for the unknowns (m, 3) at the poses `rows` (m,)."""
        wire = self._whisker.whisker
        arc_m = np.clip(unknown[:, 0], 1e-3, 1.0) * self._scale[0]
        across = unknown[:, 1:] * self._scale[1:]
        size = np.linalg.norm(across, axis=1)
        slope = wire.radius_slope
        force = np.column_stack((size * slope / np.sqrt(1.0 - slope**2), across))
        load = spatially_loaded(wire, self._whisker.suspension, self._whisker.poisson_ratio, arc_m, force, _STEPS)
        contact_m = self._position_m[rows] + applied(self._rotation[rows], load.point_m)
        nearest = self._solid.closest(contact_m)
        normal = (contact_m - nearest.point_m) / nearest.distance_m[:, None]
        seen = undone(load.directors, undone(self._rotation[rows], normal))
        aside = (across[:, 0] * seen[:, 2] - across[:, 1] * seen[:, 1]) / size
        gap = (nearest.distance_m - wire.radius_m(arc_m)) / wire.length_m
        return _State(np.stack((gap, seen[:, 0] - slope, aside), axis=-1), load, force, contact_m, nearest.point_m, normal)

    def _damping(self, guess: Array, update: Array, residual: Array, pending: NDArray[np.intp]) -> Array:
        """Step sizes (m, 1), halved until the residual decreases; at an edge it may not."""
        share = np.ones((len(guess), 1))
        before = np.linalg.norm(residual, axis=1)
        rows = np.arange(len(guess))
        for _ in range(_HALVINGS):
            after = np.linalg.norm(self._state(guess[rows] - share[rows] * update[rows], pending[rows]).residual, axis=1)
            rows = rows[~(after < before[rows]) & ~(before[rows] < _TOLERANCE)]
            if len(rows) == 0:
                break
            share[rows] *= 0.5
        return share


def _solutions(matrix: Array, right: Array) -> Array:
    """Solutions (n, 3) of n systems of three equations by Cramer's rule; NaN for singular matrices."""
    columns = np.moveaxis(matrix, -1, 0)
    determinant = np.sum(columns[0] * np.cross(columns[1], columns[2]), axis=1)
    numerators = [
        np.sum(right * np.cross(columns[1], columns[2]), axis=1),
        np.sum(columns[0] * np.cross(right, columns[2]), axis=1),
        np.sum(columns[0] * np.cross(columns[1], right), axis=1),
    ]
    return np.stack(numerators, axis=-1) / determinant[:, None]
