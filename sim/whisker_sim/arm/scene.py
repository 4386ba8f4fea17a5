"""Scenes with an arm, as they are written by users and as they are simulated."""

from typing import Annotated, Literal

import msgspec
import numpy as np

from whisker_sim.arm import panda
from whisker_sim.arm.passage import Passage, displaced, joint_trajectory
from whisker_sim.arm.tool import HALF_HEIGHT_M, LENGTH_M, MOUNTS
from whisker_sim.free_object import FreeObject
from whisker_sim.scene import Format, SceneBase, Seed, Simulation, check_rate, random_stream, resolve_simulation
from whisker_sim.vibration import Vibration
from whisker_sim.whisker import Angle, Array, Coordinate, Name, WhiskerOverride, resolve_whisker

_MOST_STEPS = 2_000_000
"""Maximum length of a plan; a row of a recording has about a hundred times the numbers of a trace's, and must fit into memory."""
_BELOW_FLANGE_M = 0.01
"""Minimum distance between objects and the flange above: only the block that bears the whiskers comes near them."""


class Arm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Position of the centre of the arm's foot in World, and its direction."""

    foot_m: tuple[Coordinate, Coordinate, Coordinate]
    yaw_rad: Angle = 0.0

    @property
    def base(self) -> Array:
        """Pose (4, 4) of the arm's base in World."""
        return panda.translation(self.foot_m) @ panda.rotation_z(self.yaw_rad)


class JointPlan(msgspec.Struct, frozen=True):
    """Joint references, one per time step from time zero."""

    q_rad: Array
    """(n + 1, 7)."""
    dq_rad_s: Array
    """(n + 1, 7)."""


class ArmScene(SceneBase, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One experiment: an arm with six equal whiskers, objects on a table, and a path between them."""

    format: Format
    name: Name
    group: Name
    arm: Arm
    whisker: str | WhiskerOverride
    objects: Annotated[tuple[FreeObject, ...], msgspec.Meta(min_length=1)]
    path: Passage
    role: Literal["trial"] = "trial"
    vibration: Vibration | None = None
    seed: Seed = 0
    rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=1e5)] = 250.0
    simulation: str | Simulation = Simulation()

    def __post_init__(self) -> None:
        resolve_whisker(self.whisker)
        msgspec.structs.force_setattr(self, "simulation", resolve_simulation(self.simulation))
        names = [free.name for free in self.objects]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"objects: expected objects of different names, found '{name}' {names.count(name)} times")
        self._check_heights()
        check_rate(self.rate_hz, self.simulation)

    def _check_heights(self) -> None:
        """Checks that the block that bears the whiskers passes above the table and beside the upright sides of all objects."""
        height_m = self.path.height_m
        if height_m <= HALF_HEIGHT_M:
            raise ValueError(f"path.height_m: expected more than {HALF_HEIGHT_M} m, half the tool's height, found {height_m}")
        above_m, below_m = height_m + HALF_HEIGHT_M, height_m + LENGTH_M - _BELOW_FLANGE_M
        for free in self.objects:
            if not above_m < free.height_m < below_m:
                raise ValueError(
                    f"objects: expected heights between {above_m:g} m, the tool's upper side, and {below_m:g} m, below the flange, "
                    f"found '{free.name}' {free.height_m:g} m high"
                )

    def names(self, name: str) -> tuple[str, ...]:
        """Names in the dataset of the files of a run called `name`: the recording, and one trace per whisker."""
        return (name, *(trace_name(name, mount.name) for mount in MOUNTS))

    def plan(self) -> JointPlan:
        """The joint trajectory with the added vibration; raises `ValueError` if the arm cannot follow it."""
        timestep_s = self.simulation.timestep_s
        time_s, poses = self.path.poses({free.name: free for free in self.objects}, _MOST_STEPS * timestep_s)
        trajectory = joint_trajectory(self.arm.base, self.path.height_m, time_s, poses)
        steps_s = timestep_s * np.arange(round(time_s[-1] / timestep_s) + 1)
        q_rad = trajectory(steps_s)
        if self.vibration is not None:
            added_m = self.vibration.displacement_m(len(q_rad) - 1, timestep_s, random_stream(self.name, self.seed))
            q_rad = displaced(q_rad, added_m, np.interp(steps_s, time_s, poses[:, 2]) - self.arm.yaw_rad)
        return JointPlan(q_rad, np.gradient(q_rad, timestep_s, axis=0))


def trace_name(recording: str, whisker: str) -> str:
    """Name of the trace of one whisker of a recording."""
    return f"{recording}_{whisker}"
