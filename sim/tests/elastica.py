"""Independent oracle: the exact quasi-static whisker, by SciPy.

A frictionless point contact at arc length s_c pushes the rod with a force F along its left normal; past the contact the rod is
unloaded. Put the contact at the origin with the tangent along +x and walk back to the root:

    dx/ds = cos t,  dy/ds = sin t,  dt/ds = kappa0(s) + M(s) / EI(s),  M(s) = -x(s) F.

The root's bending moment M(0) turns the compliant root by M(0) / k. No part of the simulator is used but the whisker's parameters.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from whisker_sim.whisker import Whisker


@dataclass(frozen=True)
class StaticContact:
    """A loaded whisker, in Base."""

    point_m: np.ndarray
    angle_rad: float
    moment_n_m: float


def static_contact(whisker: Whisker, arc_m: float, force_n: float) -> StaticContact:
    """The whisker under a force `force_n` (positive to the left) at the arc length `arc_m`."""
    ends = np.cumsum([arc.length_m for arc in whisker.curvature])

    def slope(s, state):
        x, _, t = state
        piece = min(int(np.searchsorted(ends, s, side="left")), len(ends) - 1)
        diameter_m = whisker.root_diameter_m + s / whisker.length_m * (whisker.tip_diameter_m - whisker.root_diameter_m)
        bending_n_m2 = whisker.youngs_modulus_pa * np.pi * diameter_m**4 / 64.0
        return np.cos(t), np.sin(t), whisker.curvature[piece].curvature_per_m - x * force_n / bending_n_m2

    state = np.zeros(3)
    # One integration a piece, so that a jump of the curvature is no trouble to the step control.
    starts = np.concatenate(([0.0], ends[:-1]))
    for start_m, end_m in zip(starts[::-1], ends[::-1], strict=True):
        if arc_m > start_m:
            inside = np.array([np.nextafter(min(arc_m, end_m), 0.0), start_m])
            state = solve_ivp(slope, inside, state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    x, y, t = state
    moment_n_m = -x * force_n
    base_rad = t - moment_n_m / whisker.root_stiffness_n_m_rad
    cos, sin = np.cos(base_rad), np.sin(base_rad)
    return StaticContact(np.array((-cos * x - sin * y, sin * x - cos * y)), -base_rad, moment_n_m)


def contact_with_disc(
    whisker: Whisker, center_m: np.ndarray, radius_m: float, face: int, guess: tuple[float, float]
) -> tuple[float, float, StaticContact]:
    """Solves for the contact with a disc at `center_m` (in Base) on the whisker's side `face` (+1 left).

    Gives arc length, force magnitude and the loaded whisker. `guess` holds the first two.
    """

    def miss(unknown):
        arc_m, force_n = unknown * (1e-2, 1e-3)
        contact = static_contact(whisker, arc_m, -face * force_n)
        normal = face * np.array((-np.sin(contact.angle_rad), np.cos(contact.angle_rad)))
        return 1e3 * (contact.point_m + (radius_m + whisker.radius_m(arc_m)) * normal - center_m)

    solution = root(miss, np.array(guess) / (1e-2, 1e-3), tol=1e-12)
    assert solution.success or np.max(np.abs(solution.fun)) < 1e-8, solution.message
    arc_m, force_n = solution.x * (1e-2, 1e-3)
    return arc_m, force_n, static_contact(whisker, arc_m, -face * force_n)
