"""Quasi-static table: the whisker under the ruler's edge, on a grid of positions and depths.

The values are those of the exact elastica, from which MuJoCo's whisker at rest deviates by less than a thousandth, as tests and the
certificates of the rig's traces show.
"""

from typing import NamedTuple

import msgspec
import numpy as np

from whisker_sim.elastica import Touching, touching
from whisker_sim.errors import SimulationError
from whisker_sim.motions import Stage
from whisker_sim.progress import report_share
from whisker_sim.whisker import Array

COLUMNS = (
    ("contact_m", 4),
    ("push_m", 4),
    ("rotation_rad", 9),
    ("slope_rad", 9),
    ("moment_n_m", 10),
    ("force_n", 8),
)
"""Columns of the table in order, with their numbers of decimals."""

_SUBSTEPS = 2
"""Number of continuation steps of Newton's method from one depth to the next."""
_TIP_M = 2e-3
"""Maximum distance from the tip at which the ruler may slip off."""


class Axis(msgspec.Struct, frozen=True):
    """Evenly spaced values of the grid."""

    first: float
    step: float
    count: int

    @property
    def values(self) -> Array:
        """The values (count,)."""
        return self.first + self.step * np.arange(self.count)


CONTACT_M = Axis(0.02, 0.0025, 53)
PUSH_M = Axis(0.0, 0.001, 17)


class Grid(NamedTuple):
    """The whisker at rest for p depths at c positions, (c, p) each; NaN beyond the depth at which the ruler slips off the tip."""

    rotation_rad: Array
    """Rotation of the root, and thus of the magnet."""
    slope_rad: Array
    """Tangent angle of the shaft at the contact relative to the root."""
    moment_n_m: Array
    force_n: Array

    def columns(self, contacts_m: Array, pushes_m: Array) -> list[Array]:
        """Values (c p,) of `COLUMNS`, sorted by contact, then push."""
        contact_m, push_m = np.meshgrid(contacts_m, pushes_m, indexing="ij")
        return [values.ravel() for values in (contact_m, push_m, *self)]


def grid(stage: Stage, contacts_m: Array, pushes_m: Array) -> Grid:
    """Pushes the object of the stage into its whisker at `contacts_m` (c,), to the ascending depths `pushes_m` (p,) from zero.

    Raises `SimulationError` if the contact is lost away from the tip.
    """
    whisker = stage.whisker
    # Initial guess for small deflections: a force F at s pushes by F s^2 (s / 3 EI + 1 / k).
    bending_rad_n_m = np.array([whisker.compliance_rad_n_m(0.0, contact_m) for contact_m in contacts_m])
    compliance_m_n = contacts_m**2 * (bending_rad_n_m / 3.0 + 1.0 / whisker.root_stiffness_n_m_rad)
    guess = np.stack((contacts_m, pushes_m[1] / _SUBSTEPS / compliance_m_n))
    before = np.stack((contacts_m, np.zeros_like(contacts_m)))
    holding = np.arange(len(contacts_m))
    found = np.full((4, len(contacts_m), len(pushes_m)), np.nan)
    found[:, :, 0] = 0.0
    for index in range(1, len(pushes_m)):
        for push_m in np.linspace(*pushes_m[index - 1 : index + 1], _SUBSTEPS + 1)[1:]:
            poses = np.array([stage.base_pose(contact_m, -push_m) for contact_m in contacts_m[holding]]).reshape(-1, 3)
            exact = touching(whisker, stage.shape, stage.face, poses, *guess)
            lost = ~exact.solved & (before[0] < whisker.length_m - _TIP_M)
            if np.any(lost):
                place_m = contacts_m[holding[np.argmax(lost)]]
                raise SimulationError(f"the elastica finds no contact at {place_m:g} m and a depth of {push_m:g} m")
            now = np.stack((exact.arc_m, exact.force_n))
            guess, before, holding = ((2.0 * now - before)[:, exact.solved], now[:, exact.solved], holding[exact.solved])
        found[:, holding, index] = _at_rest(stage, exact)[:, exact.solved]
        report_share(index / (len(pushes_m) - 1))
    return Grid(*found)


def _at_rest(stage: Stage, exact: Touching) -> Array:
    """Table values (4, c) of the whiskers `exact`."""
    rotation_rad = exact.moment_n_m / stage.whisker.root_stiffness_n_m_rad
    return np.stack((rotation_rad, exact.tangent_rad - rotation_rad, exact.moment_n_m, exact.force_n))
