"""End effector: two arrays of three whiskers, back to back.

Frame of the tool: origin on the axis of the flange, in the plane of the middle whiskers; z is up when the flange points down; x is
forward. The whiskers of an array are stacked, so that each bends in a horizontal plane of its own, and staggered, so that they
reach a point one after the other. The right array is the left one rotated by half a turn about z. Every whisker thus bends outwards
with its convex side, on which an object with flat sides touches it at one point, and meets objects with the same face.
"""

from typing import NamedTuple

import numpy as np

from whisker_sim.arm.panda import rotation_x, rotation_z, translation
from whisker_sim.whisker import Array

LENGTH_M = 0.15
"""Distance between the flange and the plane of the middle whiskers."""
TOOL = translation((0.0, 0.0, LENGTH_M)) @ rotation_x(np.pi)
"""Pose (4, 4) of the tool's frame in that of the flange."""
FACE = "right"
"""Face on which the whiskers meet objects: the convex side."""

HALF_WIDTH_M, HALF_HEIGHT_M = 0.012, 0.014
"""Dimensions of the block that bears the whiskers: their roots are on its sides, and their planes within its height."""
_AHEAD_M = 0.032
"""Distance of the middle root of the left array ahead of the axis; its whisker points backwards."""
_ECHELON_M, _RISE_M = 0.01, 0.008
"""Offsets between adjacent roots of an array, forward and up."""
_YAW_RAD = np.radians(137.0)
"""Direction of the left roots. A whisker of 80 mm with a radius of 80 mm points straight back at three quarters of its length."""


class Mount(NamedTuple):
    """Mount of a whisker."""

    name: str
    array: str
    pose: Array
    """Pose (4, 4) of the whisker's Base in the tool's frame."""

    @property
    def in_flange(self) -> Array:
        """Pose (4, 4) of the whisker's Base in the flange's frame."""
        return TOOL @ self.pose


def _mounts() -> tuple[Mount, ...]:
    mounts = []
    for array, turn_rad in (("left", 0.0), ("right", np.pi)):
        for number, step in enumerate((1, 0, -1), start=1):
            root_m = (_AHEAD_M + step * _ECHELON_M, HALF_WIDTH_M, step * _RISE_M)
            pose = rotation_z(turn_rad) @ translation(root_m) @ rotation_z(_YAW_RAD)
            mounts.append(Mount(f"{array}_{number}", array, pose))
    return tuple(mounts)


MOUNTS = _mounts()
"""Mounts of the six whiskers."""
