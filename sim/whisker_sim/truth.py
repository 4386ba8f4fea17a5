"""Ground truth: the centre line that follows from the joint angles, and its contact point with the object.

The centre line is the cubic Hermite curve through the middles of the links, where position and tangent of the chain equal those of
the rod (see `model`). It is smooth where the chain has corners. It is used instead of the solver's contact points, which jump
from one capsule to the next.

The surface of the whisker is the envelope of circles of radius r(s) about the points P(s) of the centre line. The contact is at
the minimum of the clearance dist(P(s)) - r(s), where its derivative t . n - r' vanishes, with the tangent t and the outward normal
n of the object. On a tapered whisker the contact normal is thus inclined to the centre line as the surface is.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from whisker_sim.shapes import Shape
from whisker_sim.whisker import Array, Whisker

_ARC_TOLERANCE_M = 1e-10
TIP_M = 1e-6
"""A contact within this distance of the end is at the tip."""


@dataclass(frozen=True)
class CenterLine:
    """Centre lines at n instants, in World, through nodes at equal steps of arc length."""

    points_m: Array
    """Nodes (n, N + 1, 2)."""
    angles_rad: Array
    """Tangent angles (n, N + 1) at the nodes, continuous along the whisker and in time."""
    step_m: float
    radius_slope: float
    """Derivative of the whisker's radius with respect to arc length."""

    @classmethod
    def from_joints(cls, whisker: Whisker, base_pose: Array, rotations_rad: Array) -> "CenterLine":
        """Centre lines for base poses (n, 3) and rotations (n, N + 1) of root and hinges."""
        nodes_m = np.arange(whisker.segments + 1) * whisker.segment_m
        hinges_m = nodes_m[:-1] + 0.5 * whisker.segment_m
        rest_points_m, rest_angles_rad = whisker.rest_point_m(nodes_m), whisker.rest_angle_rad(nodes_m)
        hinge_points_m = whisker.rest_point_m(hinges_m)
        # Rotation of each link relative to its undeflected direction.
        turn_rad = base_pose[:, 2:] + np.cumsum(rotations_rad, axis=1)
        pieces_m = turned(hinge_points_m - rest_points_m[:-1], turn_rad[:, :-1]) + turned(
            rest_points_m[1:] - hinge_points_m, turn_rad[:, 1:]
        )
        points_m = base_pose[:, None, :2] + np.concatenate((np.zeros((len(base_pose), 1, 2)), np.cumsum(pieces_m, axis=1)), axis=1)
        return cls(points_m, turn_rad + rest_angles_rad, whisker.segment_m, whisker.radius_slope)

    def at(self, arc_m: Array, rows: NDArray[np.intp] | None = None) -> tuple[Array, Array]:
        """Points (k, 2) and tangent angles (k,) at the arc lengths `arc_m` (k,) and instants `rows` (k,), by default all."""
        row = np.arange(len(arc_m)) if rows is None else rows
        left = np.clip((arc_m / self.step_m).astype(int), 0, self.points_m.shape[1] - 2)
        u = arc_m / self.step_m - left
        p0, p1 = self.points_m[row, left], self.points_m[row, left + 1]
        a0, a1 = self.angles_rad[row, left], self.angles_rad[row, left + 1]
        t0 = self.step_m * np.stack((np.cos(a0), np.sin(a0)), axis=-1)
        t1 = self.step_m * np.stack((np.cos(a1), np.sin(a1)), axis=-1)
        u = u[:, None]
        chord = p1 - p0
        point = p0 + u * (t0 + u * (3.0 * chord - 2.0 * t0 - t1 + u * (t0 + t1 - 2.0 * chord)))
        slope = t0 + u * (2.0 * (3.0 * chord - 2.0 * t0 - t1) + 3.0 * u * (t0 + t1 - 2.0 * chord))
        # The angle is measured relative to that of the node, so that it does not wrap.
        cos, sin = np.cos(a0), np.sin(a0)
        along, across = slope[:, 0] * cos + slope[:, 1] * sin, slope[:, 1] * cos - slope[:, 0] * sin
        return point, a0 + np.arctan2(across, along)


@dataclass(frozen=True)
class ContactTruth:
    """Points at which the surface of the whisker is nearest to the object at n instants, in World."""

    contact_m: Array
    """Points (n, 2) on the centre line."""
    surface_m: Array
    """Points (n, 2) on the object's surface."""
    arc_m: Array
    tangent_rad: Array
    tip: NDArray[np.bool_]

    @property
    def normal(self) -> Array:
        """Outward normals (n, 2) of the object, from its surface to the centre line; zero where the two coincide."""
        outward_m = self.contact_m - self.surface_m
        distance_m = np.hypot(*outward_m.T)
        return outward_m / np.where(distance_m > 0.0, distance_m, 1.0)[:, None]


SEPARATE_M = 1e-3
"""Loaded points at larger distances count as separate contacts. A single soft contact extends over some tenths of a millimetre."""
_SEARCHED_M = 0.5 * SEPARATE_M
"""Distance along the centre line within which the second contact is searched about the place that the solver states."""
_PLACES = 81
_GAP_M = 10e-6
"""Least clearance somewhere between two contacts. On a flat the whisker touches along its length: one contact of greater extent."""
_BETWEEN = 9


@dataclass(frozen=True)
class SecondContact:
    """Second contacts with an object at n instants, in World; NaN at instants without one."""

    contact_m: Array
    """Points (n, 2) on the centre line."""
    surface_m: Array
    """Points (n, 2) on the object's surface."""
    arc_m: Array
    tangent_rad: Array
    force_n: Array
    """Magnitudes (n,)."""

    @property
    def exists(self) -> NDArray[np.bool_]:
        """Whether there is a second contact (n,)."""
        return np.isfinite(self.arc_m)


_DIFFERENCE_S = 1e-6


@dataclass(frozen=True)
class FrictionTruth:
    """Friction at n instants; meaningful only at rows in contact."""

    angle_rad: Array
    """Angles (n,) of the force on the whisker to the object's outward normal, positive towards the tip."""
    slip_m_s: Array
    """Velocities (n,) of the whisker's surface relative to the object's, along the whisker towards its tip."""
    sticking: NDArray[np.bool_]
    """Whether the force of the model's strongest contact is inside the friction cone (n,)."""


def friction_truth(
    later: Callable[[float], CenterLine], truth: ContactTruth, force_n: Array, sticking: NDArray[np.bool_]
) -> FrictionTruth:
    """Friction of the contacts `truth` under the forces (n, 2) on the whisker.

    `later` returns the centre lines after a duration (s) at the instants' velocities. The whisker's surface at a contact moves with
    the point of the centre line there and turns with its tangent.
    """
    (ahead_m, ahead_rad), (behind_m, behind_rad) = (later(way_s).at(truth.arc_m) for way_s in (_DIFFERENCE_S, -_DIFFERENCE_S))
    velocity_m_s, spin_rad_s = ((a - b) / (2.0 * _DIFFERENCE_S) for a, b in ((ahead_m, behind_m), (ahead_rad, behind_rad)))
    outward_m, normal = truth.contact_m - truth.surface_m, truth.normal
    along = np.stack((np.cos(truth.tangent_rad), np.sin(truth.tangent_rad)), axis=-1)
    # The tangent of the two surfaces, towards the tip.
    forward = np.stack((-normal[:, 1], normal[:, 0]), axis=-1)
    forward *= np.where(np.sum(forward * along, axis=1) < 0.0, -1.0, 1.0)[:, None]
    surface_m_s = velocity_m_s + spin_rad_s[:, None] * np.stack((outward_m[:, 1], -outward_m[:, 0]), axis=-1)
    friction_n, normal_n = np.sum(force_n * forward, axis=1), np.sum(force_n * normal, axis=1)
    return FrictionTruth(np.arctan2(friction_n, normal_n), np.sum(surface_m_s * forward, axis=1), sticking)


def nearest_contact(line: CenterLine, shape: Shape) -> ContactTruth:
    """Finds the point of each centre line at which the surface of the whisker is nearest to `shape`.

    Between the neighbours of the nearest node the clearance has a minimum. Its derivative along the centre line, the cosine of the
    angle between the tangent and the outward normal less the slope of the radius, is zero there (`zero_of_slope`).
    """
    count, nodes, _ = line.points_m.shape
    _, distance_m = shape.closest(line.points_m.reshape(-1, 2))
    # The radius at the root is a common constant and omitted.
    clearance_m = distance_m.reshape(count, nodes) - line.radius_slope * line.step_m * np.arange(nodes)
    node = np.argmin(clearance_m, axis=1)
    low, high = np.maximum(node - 1, 0) * line.step_m, np.minimum(node + 1, nodes - 1) * line.step_m

    def slope_at(rows: NDArray[np.intp], arc_m: Array) -> Array:
        return _clearance_slope(line, shape, rows, arc_m)

    arc_m = zero_of_slope(slope_at, node * line.step_m, low, high)
    contact_m, tangent_rad = line.at(arc_m)
    surface_m, _ = shape.closest(contact_m)
    return ContactTruth(contact_m, surface_m, arc_m, tangent_rad, arc_m > line.step_m * (nodes - 1) - TIP_M)


def _clearance_slope(line: CenterLine, shape: Shape, rows: NDArray[np.intp], arc_m: Array) -> Array:
    """Derivatives (k,) of the clearance along the centre lines `rows` (k,) at the arc lengths `arc_m` (k,)."""
    point_m, tangent_rad = line.at(arc_m, rows)
    nearest_m, distance_m = shape.closest(point_m)
    away_x, away_y = ((point_m - nearest_m) / distance_m[:, None]).T
    return away_x * np.cos(tangent_rad) + away_y * np.sin(tangent_rad) - line.radius_slope


def loaded_contacts(
    line: CenterLine, shape: Shape, nearest: ContactTruth, points_m: Array, forces_n: Array
) -> tuple[ContactTruth, Array, SecondContact]:
    """First contacts with the magnitudes (n,) of their forces, and second contacts.

    `points_m` (n, k, 2) and `forces_n` (n, k) are the solver's contacts. A second contact exists where a loaded one is more than
    `SEPARATE_M` from the nearest point `nearest` and the whisker is clear of the object between them. It is the minimum of the
    clearance near the strongest such contact. Each force counts for the nearer of the two. The nearest point is the first contact
    unless it carries no load while the other does.
    """
    from_first_m = np.linalg.norm(points_m - nearest.surface_m[:, None], axis=-1)
    apart = (forces_n > 0.0) & (from_first_m > SEPARATE_M)
    rows = np.flatnonzero(np.any(apart, axis=1))
    seed_m = points_m[rows, np.argmax(np.where(apart, forces_n, 0.0)[rows], axis=1)]
    other = _contact_near(line, shape, rows, seed_m)
    parted = _clearance_between_m(line, shape, rows, nearest.arc_m[rows], other.arc_m) > _GAP_M
    rows, other = rows[parted], ContactTruth(*(getattr(other, field.name)[parted] for field in fields(other)))
    of_other = np.linalg.norm(points_m[rows] - other.surface_m[:, None], axis=-1) < from_first_m[rows]
    other_n = np.sum(forces_n[rows] * of_other, axis=1)
    first_n = np.sum(forces_n, axis=1)
    first_n[rows] -= other_n
    alone = np.sum(forces_n[rows] * ~of_other, axis=1) == 0.0
    fields_of_first = {field.name: getattr(nearest, field.name).copy() for field in fields(nearest)}
    for name, values in fields_of_first.items():
        values[rows[alone]] = getattr(other, name)[alone]
    first_n[rows[alone]] = other_n[alone]

    def placed(values: Array) -> Array:
        whole = np.full((len(points_m), *values.shape[1:]), np.nan)
        whole[rows[~alone]] = values[~alone]
        return whole

    second = SecondContact(
        *(placed(values) for values in (other.contact_m, other.surface_m, other.arc_m, other.tangent_rad, other_n))
    )
    return ContactTruth(**fields_of_first), first_n, second


def _clearance_between_m(line: CenterLine, shape: Shape, rows: NDArray[np.intp], from_m: Array, to_m: Array) -> Array:
    """Largest clearance (k,) between two arc lengths (k,) of the centre lines `rows` (k,)."""
    share = np.linspace(0.0, 1.0, _BETWEEN + 2)[1:-1]
    arc_m = from_m[:, None] + share * (to_m - from_m)[:, None]
    points_m, _ = line.at(arc_m.ravel(), np.repeat(rows, _BETWEEN))
    _, distance_m = shape.closest(points_m)
    # The radius decreases linearly, so that its value at the first contact follows from the clearance there, which is zero.
    at_first_m = shape.closest(line.at(from_m, rows)[0])[1][:, None]
    clearance_m = distance_m.reshape(arc_m.shape) - at_first_m - line.radius_slope * (arc_m - from_m[:, None])
    return np.max(clearance_m, axis=1, initial=0.0)


def _contact_near(line: CenterLine, shape: Shape, rows: NDArray[np.intp], seed_m: Array) -> ContactTruth:
    """The minima of the clearance at the instants `rows` (k,) near the points `seed_m` (k, 2)."""
    nodes = line.points_m.shape[1]
    length_m = line.step_m * (nodes - 1)
    node = np.argmin(np.linalg.norm(line.points_m[rows] - seed_m[:, None], axis=-1), axis=1)
    places_m = np.clip(line.step_m * (node[:, None] + np.linspace(-1.0, 1.0, _PLACES)), 0.0, length_m)
    along_m, _ = line.at(places_m.ravel(), np.repeat(rows, _PLACES))
    away_m = np.linalg.norm(along_m.reshape(len(rows), _PLACES, 2) - seed_m[:, None], axis=-1)
    start_m = places_m[np.arange(len(rows)), np.argmin(away_m, axis=1)]

    def slope_at(of: NDArray[np.intp], arc_m: Array) -> Array:
        return _clearance_slope(line, shape, rows[of], arc_m)

    low_m, high_m = np.maximum(start_m - _SEARCHED_M, 0.0), np.minimum(start_m + _SEARCHED_M, length_m)
    arc_m = zero_of_slope(slope_at, start_m, low_m, high_m)
    contact_m, tangent_rad = line.at(arc_m, rows)
    surface_m, _ = shape.closest(contact_m)
    return ContactTruth(contact_m, surface_m, arc_m, tangent_rad, arc_m > length_m - TIP_M)


def zero_of_slope(slope_at: Callable[[NDArray[np.intp], Array], Array], arc_m: Array, low: Array, high: Array) -> Array:
    """Arc lengths (n,) between `low` and `high` at which a slope vanishes, by regula falsi (Illinois variant).

    `slope_at` returns the slopes (k,) at the instants `rows` (k,) and arc lengths (k,). Where the slope does not change sign, the
    nearest point is an end of the whisker, and the result is the given `arc_m`.
    """
    rows, arc_m = np.arange(len(arc_m)), arc_m.copy()
    slope_low, slope_high = slope_at(rows, low), slope_at(rows, high)
    fell = slope_low > 0.0
    moving = (slope_low < 0.0) & (slope_high > 0.0)
    while np.any(moving):
        rows, low, high, slope_low, slope_high, fell = (values[moving] for values in (rows, low, high, slope_low, slope_high, fell))
        probe = low + slope_low / (slope_low - slope_high) * (high - low)
        slope = slope_at(rows, probe)
        falls = slope < 0.0
        fading = np.where(falls == fell, 0.5, 1.0)
        low, high = np.where(falls, probe, low), np.where(falls, high, probe)
        slope_low, slope_high = np.where(falls, slope, fading * slope_low), np.where(falls, fading * slope_high, slope)
        moving = np.abs(probe - arc_m[rows]) > _ARC_TOLERANCE_M
        arc_m[rows], fell = probe, falls
    return arc_m


def turned(vectors_m: Array, angle_rad: Array) -> Array:
    """Vectors (..., 2) rotated by the angles (...), which are broadcast."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors_m[..., 0], vectors_m[..., 1]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
