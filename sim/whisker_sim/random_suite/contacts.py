"""Random sets whose contacts are not ideal: with friction, on objects that are not convex, or on objects that move.

Object, motion, rate, noise and miscalibration are drawn as for ideal contacts; one of `CONDITIONS` is added.
"""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from whisker_sim.random_suite.draw import Draw, log_uniform, uniform, weighted
from whisker_sim.random_suite.objects import Kind
from whisker_sim.random_suite.plane import DrawnSet, RandomSet
from whisker_sim.scene import Scene, Simulation
from whisker_sim.shapes import AnyShape, Cup, Discs, L, Star, Step

_FRICTION = (0.05, 0.6)
_FRICTION_TIMESTEP_S = 1e-4
"""Largest time step at which a sticking contact does not creep."""

_SPEED_M_S = (2e-4, 2e-3)


def _l(rng: np.random.Generator) -> L:
    x_m, y_m = log_uniform(rng, 8e-3, 0.03), log_uniform(rng, 8e-3, 0.03)
    return L(x_m=x_m, y_m=y_m, thickness_m=log_uniform(rng, 2e-3, 8e-3))


def _star(rng: np.random.Generator) -> Star:
    points = int(rng.integers(3, 10))
    outer_m = log_uniform(rng, 0.01, 0.03)
    most_m = outer_m * float(np.cos(np.pi / points))
    return Star(points=points, outer_m=outer_m, inner_m=round(most_m * uniform(rng, 0.4, 0.95), 6))


def _cup(rng: np.random.Generator) -> Cup:
    width_m = log_uniform(rng, 8e-3, 0.03)
    return Cup(width_m=width_m, depth_m=round(width_m * uniform(rng, 0.2, 1.0), 6), thickness_m=log_uniform(rng, 2e-3, 8e-3))


def _discs(rng: np.random.Generator) -> Discs:
    radius_m = log_uniform(rng, 3e-3, 0.02)
    return Discs(radius_m=radius_m, distance_m=round(radius_m * uniform(rng, 1.0, 1.95), 6))


def _step(rng: np.random.Generator) -> Step:
    return Step(tread_m=log_uniform(rng, 8e-3, 0.03), rise_m=log_uniform(rng, 1e-3, 8e-3), levels=int(rng.integers(2, 4)))


NON_CONVEX_KINDS: dict[str, Draw[AnyShape]] = {"l": _l, "star": _star, "cup": _cup, "discs": _discs, "step": _step}
"""Kinds of objects that are not convex, equally probable."""


class _DrawnContactSet(DrawnSet):
    """Properties that the traces of a set have in common, with one condition that ideal contacts do not have."""

    def __init__(self, of: RandomSet, attempt: int, rng: np.random.Generator) -> None:
        super().__init__(of, attempt, rng)
        self._changes: dict[str, Any] = {}
        """Fields of the scenes that replace those of ideal contacts."""
        weighted(rng, CONDITIONS)(self, rng)

    def scene(self, trace: int, attempt: int) -> Scene:
        """Scene of a trace of the set, as drawn for the `attempt`-th time."""
        return msgspec.structs.replace(super().scene(trace, attempt), **self._changes)

    def with_friction(self, rng: np.random.Generator) -> None:
        """Adds Coulomb friction."""
        timestep_s = min(_FRICTION_TIMESTEP_S, self._set.simulation.timestep_s)
        self._changes = {"friction": uniform(rng, *_FRICTION, 3), "simulation": Simulation(timestep_s)}

    def with_non_convex_object(self, rng: np.random.Generator) -> None:
        """Replaces the object of the set by one that is not convex."""
        name = str(rng.choice(sorted(NON_CONVEX_KINDS)))
        self._kind = Kind(name, NON_CONVEX_KINDS[name])
        self._object = self._kind.draw(rng)

    def with_moving_object(self, rng: np.random.Generator) -> None:
        """Moves the object with a constant velocity in a random direction."""
        speed_m_s, angle_rad = log_uniform(rng, *_SPEED_M_S), rng.uniform(0.0, 2.0 * np.pi)
        velocity_m_s = speed_m_s * np.array((np.cos(angle_rad), np.sin(angle_rad)))
        self._changes = {"object_velocity_m_s": tuple(round(float(value), 7) for value in velocity_m_s)}


CONDITIONS: tuple[tuple[float, Callable[[_DrawnContactSet, np.random.Generator], None]], ...] = (
    (0.20, _DrawnContactSet.with_friction),
    (0.40, _DrawnContactSet.with_non_convex_object),
    (0.40, _DrawnContactSet.with_moving_object),
)
"""Conditions that ideal contacts do not have, with their weights."""


class RandomContactSet(RandomSet, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One set of a random suite whose contacts are not ideal."""

    def draw(self, attempt: int) -> DrawnSet:
        """The set as drawn for the `attempt`-th time."""
        return _DrawnContactSet(self, attempt, self.stream(attempt))
