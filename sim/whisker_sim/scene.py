"""Scenes, as they are written by users and as they are simulated."""

import hashlib
from typing import Annotated, Literal

import msgspec
import numpy as np

from whisker_sim.free_object import Stand
from whisker_sim.motions import AnyMotion, Plan, Stage
from whisker_sim.replay import Replay
from whisker_sim.shapes import AnyShape
from whisker_sim.vibration import Vibration
from whisker_sim.whisker import Array, Name, Positive, Whisker, WhiskerOverride, resolve_whisker

LARGEST_SEED = 2**53
"""Largest whole number up to which every JSON reader is exact."""
Seed = Annotated[int, msgspec.Meta(ge=0, le=LARGEST_SEED)]
Format = Literal[1]
Velocity = Annotated[float, msgspec.Meta(ge=-0.01, le=0.01)]
Friction = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
Stiffness = Annotated[float, msgspec.Meta(ge=2.0, le=1000.0)]
LARGEST_FRICTION_STEP_S = 0.0002
"""Longest time step with friction: at longer ones contacts bounce, and the force leaves the friction cone by several degrees."""


class Simulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of the integration."""

    timestep_s: Annotated[float, msgspec.Meta(ge=1e-5, le=0.002)] = 0.0005


SIMULATIONS: dict[str, tuple[str, Simulation]] = {
    "default": ("reference settings, for which the accuracy bounds are stated", Simulation()),
    "fast": ("twice as fast; errors at most twice the bounds of the default", Simulation(timestep_s=0.001)),
}
"""Simulation settings by name, each with a one-line description."""


def resolve_simulation(choice: str | Simulation) -> Simulation:
    """The settings that a scene names or contains; raises `ValueError` for an unknown name."""
    if isinstance(choice, Simulation):
        return choice
    if choice not in SIMULATIONS:
        raise ValueError(f"simulation: expected one of {', '.join(SIMULATIONS)}, found '{choice}'")
    return SIMULATIONS[choice][1]


def check_rate(rate_hz: float, simulation: Simulation) -> None:
    """Raises `ValueError` if a row is not a whole number of time steps."""
    steps = 1.0 / (rate_hz * simulation.timestep_s)
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-9:
        raise ValueError(f"rate_hz: expected a whole number of time steps of {simulation.timestep_s} s a row, found {steps:g}")


def random_stream(name: str, seed: int) -> np.random.Generator:
    """The random stream of a scene, determined only by its name and seed."""
    return np.random.Generator(np.random.PCG64([int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big"), seed]))


class SceneBase(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """Properties of all kinds of scenes, which have the fields `whisker`, `rate_hz` and `simulation`."""

    @property
    def resolved_whisker(self) -> Whisker:
        """Parameters of the whisker."""
        return resolve_whisker(self.whisker)

    @property
    def steps_per_row(self) -> int:
        """Time steps between two rows of a trace."""
        return round(1.0 / (self.rate_hz * self.simulation.timestep_s))


class SweepScene(SceneBase, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """Properties of scenes of one whisker, which also have the fields `motion` and `duration_s`."""

    def __post_init__(self) -> None:
        resolve_whisker(self.whisker)
        msgspec.structs.force_setattr(self, "simulation", resolve_simulation(self.simulation))
        if self.motion.needs_duration and self.duration_s is None:
            raise ValueError(f"duration_s: the motion '{self.motion_kind}' needs it, found none")
        if not self.motion.needs_duration and self.duration_s is not None:
            raise ValueError(
                f"duration_s: expected none, for the motion '{self.motion_kind}' ends by itself, found {self.duration_s}"
            )
        check_rate(self.rate_hz, self.simulation)

    @property
    def motion_kind(self) -> str:
        """Name of the motion in its registry."""
        return self.motion.__struct_config__.tag

    def names(self, name: str) -> tuple[str, ...]:
        """Names in the dataset of the files of a run called `name`."""
        return (name,)


class Scene(SweepScene, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One experiment: whisker, object and motion."""

    format: Format
    name: Name
    role: Literal["trial", "calibration"]
    group: Name
    face: Literal["left", "right"]
    whisker: str | WhiskerOverride
    object: AnyShape
    motion: AnyMotion
    vibration: Vibration | None = None
    seed: Seed = 0
    duration_s: Positive | None = None
    friction: Friction | msgspec.UnsetType = msgspec.UNSET
    """Coefficient of Coulomb friction between whisker and object; no friction if not stated."""
    object_velocity_m_s: tuple[Velocity, Velocity] | msgspec.UnsetType = msgspec.UNSET
    """Velocity of the object in World, from the start on; at rest if not stated. `object` is its pose at the start."""
    object_stand: Stand | msgspec.UnsetType = msgspec.UNSET
    """Free stand of the object on a table; the object is fixed if not stated. `object` is its pose at the start."""
    object_stiffness_n_m: Stiffness | msgspec.UnsetType = msgspec.UNSET
    """Contact force over indentation of the object's surface; rigid if not stated."""
    rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=1e5)] = 250.0
    simulation: str | Simulation = Simulation()
    """A name is replaced by its settings on reading, so that a scene and the sidecar of a trace contain the settings themselves."""
    replay: Replay | msgspec.UnsetType = msgspec.UNSET
    """Effects that are added at replay; omitted from sidecars if not stated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction_coefficient > 0.0 and not self.object.convex:
            raise ValueError(f"friction: expected none with an object that is not convex ('{self.shape}'), found {self.friction}")
        if self.yields:
            self._check_yielding()
        if self.friction_coefficient > 0.0 and self.simulation.timestep_s > LARGEST_FRICTION_STEP_S:
            raise ValueError(
                f"simulation: expected a time step of at most {LARGEST_FRICTION_STEP_S} s with friction, "
                f"found {self.simulation.timestep_s} s"
            )

    def _check_yielding(self) -> None:
        """Raises `ValueError` for properties that an object which gives way cannot have."""
        key = "object_stand" if self.stand is not None else "object_stiffness_n_m"
        if self.role == "calibration":
            raise ValueError(f"{key}: expected none in a calibration, whose pin is fixed")
        if not self.object.convex:
            raise ValueError(f"{key}: expected none with an object that is not convex, found '{self.shape}'")
        if self.friction_coefficient > 0.0:
            raise ValueError(f"friction: expected none with {key}, found {self.friction}")
        if self.object_velocity_m_s is not msgspec.UNSET:
            raise ValueError(f"object_velocity_m_s: expected none with {key}, found {list(self.object_velocity_m_s)}")

    @property
    def stand(self) -> Stand | None:
        """Free stand of the object, `None` if it is fixed."""
        return None if self.object_stand is msgspec.UNSET else self.object_stand

    @property
    def stiffness_n_m(self) -> float | None:
        """Stiffness of the object's surface, `None` if it is rigid."""
        return None if self.object_stiffness_n_m is msgspec.UNSET else self.object_stiffness_n_m

    @property
    def yields(self) -> bool:
        """Whether the object gives way."""
        return self.stand is not None or self.stiffness_n_m is not None

    @property
    def shape(self) -> str:
        """Name of the object's shape in its registry."""
        return self.object.__struct_config__.tag

    @property
    def friction_coefficient(self) -> float:
        """Coefficient of friction, zero if not stated."""
        return 0.0 if self.friction is msgspec.UNSET else self.friction

    def object_m(self, time_s: Array) -> Array:
        """Displacements (n, 2) of the object at the times (n,)."""
        velocity_m_s = (0.0, 0.0) if self.object_velocity_m_s is msgspec.UNSET else self.object_velocity_m_s
        return time_s[:, None] * np.array(velocity_m_s)

    def plan(self) -> Plan:
        """The motion with the added vibration; raises `ValueError` if the geometry of the scene does not allow it."""
        stage = self.stage()
        plan = self.motion.plan(stage)
        if self.vibration is None:
            return plan
        # Drawn after the motion, so that the motion does not depend on it.
        added_m = self.vibration.displacement_m(len(plan.poses) - 1, stage.timestep_s, stage.rng)
        return msgspec.structs.replace(plan, poses=plan.poses + np.pad(added_m, ((0, 0), (0, 1))))

    def stage(self) -> Stage:
        """Inputs of the motion."""
        return Stage(
            whisker=self.resolved_whisker,
            shape=self.object,
            face=1 if self.face == "left" else -1,
            timestep_s=self.simulation.timestep_s,
            duration_s=self.duration_s,
            rng=random_stream(self.name, self.seed),
        )
