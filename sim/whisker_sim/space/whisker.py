"""Whisker in space: the parameters of the plane with a suspension of three springs and a Poisson ratio."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from whisker_sim.rod import Suspension
from whisker_sim.space.rotation import about
from whisker_sim.whisker import Array, Whisker

YAW, PITCH, TWIST = 2, 1, 0
"""Axes of the hinges: the left-right bending turns about z, the up-down bending about y, the twist about x."""

ROOT_ORDER = (YAW, PITCH, TWIST)
"""Order of the springs at the root, from Base to the wire, as in `rod.Suspension`."""


@dataclass(frozen=True)
class SpatialWhisker:
    """A whisker that bends about two axes and twists."""

    whisker: Whisker
    suspension: Suspension
    poisson_ratio: float

    @property
    def node_arcs_m(self) -> Array:
        """Arc lengths (N + 1,) of the boundaries of the segments, in the middles of the links."""
        return np.arange(self.whisker.segments + 1) * self.whisker.segment_m

    @property
    def hinge_arcs_m(self) -> Array:
        """Arc lengths (N,) of the hinges, in the middles of the segments."""
        return self.node_arcs_m[:-1] + 0.5 * self.whisker.segment_m

    def rest_point_m(self, arc_m: ArrayLike) -> Array:
        """Points (..., 3) of the undeflected centre line in Base at the arc lengths (...)."""
        plane_m = self.whisker.rest_point_m(arc_m)
        return np.concatenate((plane_m, np.zeros_like(plane_m[..., :1])), axis=-1)

    def rest_frame(self, arc_m: ArrayLike) -> Array:
        """Directors (..., 3, 3) of the undeflected whisker in Base, as columns: tangent, left and upper normal."""
        return about(YAW, self.whisker.rest_angle_rad(arc_m))

    def stiffness_n_m_rad(self, hinge: int) -> Array:
        """Stiffness (3,) of a hinge about x (twist), y and z (bending): that of its segment, with GJ = EI / (1 + nu)."""
        step_m = self.whisker.segment_m
        bending = 1.0 / self.whisker.compliance_rad_n_m(hinge * step_m, (hinge + 1) * step_m)
        return bending * np.array((1.0 / (1.0 + self.poisson_ratio), 1.0, 1.0))

    @property
    def root_stiffness_n_m_rad(self) -> Array:
        """Stiffness (3,) of the root about x (twist), y (pitch) and z (yaw)."""
        return np.array((self.suspension.twist_n_m_rad, self.suspension.pitch_n_m_rad, self.suspension.yaw_n_m_rad))


def hinge_order(hinge: int) -> tuple[int, int, int]:
    """Axes of the three joints of a hinge, from the root to the tip.

    Finite rotations do not commute. With the same order at every hinge, the twist that the order adds has the same sign everywhere
    and the error decreases with the first power of the segment length. With the opposite order at every second hinge it cancels,
    and the error decreases with the square.
    """
    return (YAW, PITCH, TWIST) if hinge % 2 == 0 else (TWIST, PITCH, YAW)
