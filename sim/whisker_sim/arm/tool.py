"""The end effector: two arrays of three whiskers, back to back.

Frame of the tool: origin on the flange's axis, in the plane of the middle whiskers; z up, when the flange points down; x ahead.
The whiskers of an array are stacked, so that each bends in a horizontal plane of its own, and stand in echelon, so that they
meet a place one after the other. The right array is the left one turned by half a turn about z. So every whisker bows outwards
with its convex side, on which an outline with flats touches it in one place: it meets objects with the same face.
"""

from typing import NamedTuple

import numpy as np

from whisker_sim.arm.panda import rotation_x, rotation_z, translation
from whisker_sim.whisker import Array

LENGTH_M = 0.15
"""From the flange to the middle whiskers' plane."""
TOOL = translation((0.0, 0.0, LENGTH_M)) @ rotation_x(np.pi)
"""Pose (4, 4) of the tool's frame in the flange's."""
FACE = "right"
"""Face of every whisker on which it meets objects: its convex side."""

HALF_WIDTH_M, HALF_HEIGHT_M = 0.012, 0.014
"""Of the block that bears the whiskers: their roots lie on its sides, and their planes within its height."""
_AHEAD_M = 0.032
"""The middle root of the left array lies so far ahead of the axis, for its whisker reaches back from there."""
_ECHELON_M, _RISE_M = 0.01, 0.008
"""From one root of an array to the next, ahead and up."""
_YAW_RAD = np.radians(137.0)
"""Direction of the left roots. A whisker of 80 mm with a radius of 80 mm points straight back at three quarters of its length."""


class Mount(NamedTuple):
    """Where a whisker is mounted."""

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
"""The six whiskers."""
