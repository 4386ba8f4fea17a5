"""Quasi-static stick and slip of a whisker on a disc, without MuJoCo.

At every instant of a known motion of the base the whisker is the elastica in contact (`whisker_sim.elastica`) under a force at the
angle psi to the normal, positive towards the tip, and Coulomb's law selects psi. Between two instants the contact moves by ds along
the disc, positive towards the tip, and by da along the centre line. Its way along the whisker's surface, which is at the radius r
from the centre line on the side f of the object (+1 left), is (1 - f kappa r) da. The surface of the whisker thus slips by

    d = ds - (1 - f kappa r) da,

positive towards the tip; rolling is no slip. Since friction towards the tip moves the whisker that way, d increases with psi, and
the return mapping (Giannakopoulos, Computers & Structures 32, 1989) is a search for a zero: if d vanishes at an angle inside the
cone, |psi| <= atan mu, the contact sticks there; otherwise it slips at the side of the cone that is opposed to the slip.

The slip is the change of a place that depends on pose and psi alone, so that the steps have no influence as long as the slip
reverses at instants only. The equilibria are solved at Chebyshev points of psi for all instants together, and interpolated between
them. The whisker has a uniform diameter. kappa is the curvature of the undeflected whisker: the couple of the friction about the
centre line changes the way by less than a millionth.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import brentq

from whisker_sim.elastica import touching
from whisker_sim.errors import SimulationError
from whisker_sim.shapes.round import Round
from whisker_sim.whisker import Array, Whisker

_DEGREE = 6
"""Degree of the polynomials in psi. At a coefficient of friction of 0.5 the last coefficient of the place is below 0.1 nm."""


class StickSlip(NamedTuple):
    """Quasi-static contact at n instants."""

    moment_n_m: Array
    """Bending moments (n,) at the root."""
    frictionless_n_m: Array
    """Bending moments (n,) at the root without friction."""
    force_n: Array
    """Magnitudes (n,)."""
    arc_m: Array
    """Arc lengths (n,) of the contact on the whisker."""
    friction_rad: Array
    """Angles (n,) of the force to the normal, positive if the friction on the whisker is towards its tip."""
    slip_m: Array
    """Slip (n,) of the whisker's surface since the previous instant, positive towards its tip."""
    sticking: NDArray[np.bool_]


def stick_slip(
    whisker: Whisker, disc: Round, face: int, poses: Array, coefficient: float, arc_m: Array, force_n: Array
) -> StickSlip:
    """Contact of `whisker` with `disc` on its side `face` (+1 left) for base poses (n, 3) in succession.

    The first instant has no friction. `arc_m` and `force_n` (n,) are initial guesses. Raises `SimulationError` if an instant has no
    equilibrium.
    """
    cone_rad = float(np.arctan(coefficient))
    nodes = chebyshev.chebpts2(_DEGREE + 1)
    count = len(poses)
    found = touching(
        whisker,
        disc,
        face,
        np.repeat(poses, len(nodes), axis=0),
        np.repeat(arc_m, len(nodes)),
        np.repeat(force_n, len(nodes)),
        np.tile(cone_rad * nodes, count),
    )
    if not np.all(found.solved):
        missing = int(np.sum(~np.all(_rows(found.solved), axis=1)))
        raise SimulationError(f"{whisker.name}: no equilibrium on the disc at {missing} of {count} instants")
    outward_m = found.surface_m - np.array(disc.center_m)
    # Along the disc the direction towards the tip is counter-clockwise if the disc is on the left.
    along_m = face * disc.radius_m * np.unwrap(_rows(np.arctan2(outward_m[:, 1], outward_m[:, 0])), axis=0)
    way_m = _rows(found.arc_m - face * whisker.radius_m(found.arc_m) * whisker.rest_angle_rad(found.arc_m))
    # Polynomials in psi / atan mu; the slip is the change of the place, up to the sum over the steps.
    place, arc, force, moment = (
        chebyshev.chebfit(nodes, values.T, _DEGREE).T
        for values in (along_m - way_m, _rows(found.arc_m), _rows(found.force_n), _rows(found.moment_n_m))
    )
    share, slip_m = np.zeros(count), np.zeros(count)
    at_m = float(chebyshev.chebval(0.0, place[0]))
    for index in range(1, count):
        lowest_m, highest_m = (float(chebyshev.chebval(side, place[index])) - at_m for side in (-1.0, 1.0))
        if lowest_m < 0.0 < highest_m:
            remaining = place[index].copy()
            remaining[0] -= at_m
            share[index] = brentq(chebyshev.chebval, -1.0, 1.0, args=(remaining,), xtol=1e-12)
        else:
            share[index], slip_m[index] = (-1.0, lowest_m) if lowest_m >= 0.0 else (1.0, highest_m)
            at_m += slip_m[index]

    def at(psi: Array, rows: Array) -> Array:
        """Values (n,) of the polynomials `rows` (n, degree + 1), each at its `psi`."""
        return np.array([chebyshev.chebval(*each) for each in zip(psi, rows, strict=True)])

    return StickSlip(
        moment_n_m=at(share, moment),
        frictionless_n_m=at(np.zeros(count), moment),
        force_n=at(share, force),
        arc_m=at(share, arc),
        friction_rad=cone_rad * share,
        slip_m=slip_m,
        sticking=np.abs(share) < 1.0,
    )


def _rows(values: Array) -> Array:
    """Values of all equilibria as one row (n, nodes) for each instant."""
    return values.reshape(-1, _DEGREE + 1)
