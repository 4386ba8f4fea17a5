"""Strokes of an arm in joint space."""

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from whisker_sim.arm import panda
from whisker_sim.motions.base import raised_cosine
from whisker_sim.space.motions.base import SpatialMotion, SpatialPath, SpatialPlan, SpatialStage
from whisker_sim.whisker import Angle, Array, Length, NotNegativeLength, Positive

JointAngles = tuple[Angle, Angle, Angle, Angle, Angle, Angle, Angle]

_SAMPLES = 200
"""Points of a stroke by which its length is found."""
_SHORTEST_M = 1e-3
"""Smallest length of a stroke."""


class ArmStroke(SpatialMotion, frozen=True, forbid_unknown_fields=True, tag="arm"):
    """Presses to `depth_m`, then moves the joints of an arm by `joints_rad` and back, `strokes` times.

    The arm is a Franka Emika Panda; the root of the whisker is `mount_m` beyond its flange, with the whisker along the last axis.
    In the press the arm has the joint angles `posture_rad`, and its foot stands where the press requires. All joints begin and end
    together, so that the base moves on a curve and turns about all axes. The dynamics of the arm are not simulated.
    """

    depth_m: Length
    joints_rad: JointAngles
    posture_rad: JointAngles = tuple(panda.READY_RAD.tolist())
    mount_m: NotNegativeLength = 0.1
    strokes: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1
    peak_speed_m_s: Positive = 0.03

    example: ClassVar[dict[str, Any]] = {
        "contact_arc_m": 0.05,
        "depth_m": 0.006,
        "joints_rad": (-0.02, 0.01, 0.0, 0.006, 0.01, -0.008, 0.05),
    }

    def plan(self, stage: SpatialStage) -> SpatialPlan:
        """Plans the strokes, whose speed counts the turn by its effect on the contact's distance from the root."""
        approach = self.approach(stage)
        path = SpatialPath(approach.at(-self.clearance_m), stage.timestep_s)
        touch_s = path.touch(approach, self, self.depth_m)
        pressed_m = approach.at(self.depth_m)[:3]
        moved = self._moved(np.linspace(0.0, 1.0, _SAMPLES))
        steps_m = np.linalg.norm(np.diff(moved[:, :3, 3], axis=0), axis=1)
        # The angle of a small rotation follows from the Frobenius norm of its difference from unity.
        turns_rad = np.linalg.norm(np.diff(moved[:, :3, :3], axis=0), axis=(1, 2)) / np.sqrt(2.0)
        length_m = float(np.sum(np.hypot(steps_m, self.contact_arc_m * turns_rad)))
        count = path.check(2.0 * length_m / self.peak_speed_m_s / stage.timestep_s, "motion.peak_speed_m_s")
        if length_m < _SHORTEST_M:
            raise ValueError(f"motion.joints_rad: expected a stroke of at least {_SHORTEST_M} m, found {length_m:.2g} m")
        # The speed is twice its mean in the middle of a stroke.
        speed_rad_s = 2.0 * np.abs(self.joints_rad) / (count * stage.timestep_s)
        self._check_joints("peak_speed_m_s", "a joint speed", "rad/s", speed_rad_s, -panda.SPEED_RAD_S, panda.SPEED_RAD_S)
        moved = self._moved(raised_cosine(np.arange(1, count + 1) / count))
        there = approach.posed(pressed_m + moved[:, :3, 3] @ approach.rotation.T, moved[:, :3, :3])
        back = np.concatenate((there[-2::-1], approach.at(self.depth_m)[None]))
        for _ in range(self.strokes):
            path.add(there, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")
            path.add(back, "motion.peak_speed_m_s")
            path.rest(self.dwell_s, "motion.dwell_s")
        return SpatialPlan(approach.rotation, path.poses(), ((touch_s, path.time_s),))

    def _moved(self, share: Array) -> Array:
        """Poses (n, 4, 4) of the base relative to that of the posture, after the shares (n,) of the stroke."""
        posture_rad = np.array(self.posture_rad)
        joints_rad = posture_rad + share[:, None] * np.array(self.joints_rad)
        for key, angles_rad in (("posture_rad", posture_rad), ("joints_rad", joints_rad[-1])):
            self._check_joints(key, "an angle", "rad", angles_rad, panda.LOWER_RAD, panda.UPPER_RAD)
        # The axes x, y and z of Base are the axes z, y and -x of the flange.
        mount = panda.translation((0.0, 0.0, self.mount_m)) @ np.array(
            ((0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        )
        return np.linalg.inv(panda.tool_pose(posture_rad, mount)) @ panda.tool_pose(joints_rad, mount)

    @staticmethod
    def _check_joints(key: str, what: str, unit: str, values: Array, lower: Array, upper: Array) -> None:
        """Raises `ValueError` if a joint is beyond its limits."""
        beyond = np.flatnonzero((values < lower) | (values > upper))
        if len(beyond):
            joint = int(beyond[0])
            raise ValueError(
                f"motion.{key}: expected {what} of joint {joint + 1} of the arm between {lower[joint]} and {upper[joint]} {unit}, "
                f"found {values[joint]:.4g}"
            )
