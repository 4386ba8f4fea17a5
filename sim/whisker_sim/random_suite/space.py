"""Random sets in space: the traces of a preset whisker on one solid, from random directions.

Depths are at most those of the calibration at the arc length of the contact.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from whisker_sim.random_suite.draw import Draw, log_uniform, uniform, weighted
from whisker_sim.random_suite.sets import DrawnScenes
from whisker_sim.scene import random_stream
from whisker_sim.space.motions import AnySpatialMotion
from whisker_sim.space.motions.grid import SpatialGrid
from whisker_sim.space.motions.push import Push
from whisker_sim.space.motions.smooth import SpatialSmooth
from whisker_sim.space.motions.spiral import Spiral
from whisker_sim.space.motions.sweep import Sweep
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.solids import AnySolid
from whisker_sim.space.solids.box import Box
from whisker_sim.space.solids.cone import Cone
from whisker_sim.space.solids.cylinder import Cylinder
from whisker_sim.space.solids.pin import ThinRod
from whisker_sim.space.solids.sphere import Sphere
from whisker_sim.space.solids.torus import Torus
from whisker_sim.whisker import Array

RATES_HZ = (100.0, 125.0, 200.0, 250.0, 500.0)
"""Sampling rates, equally probable."""

CALIBRATION = SpatialGrid(
    contact_arc_m=0.013, arc_max_m=0.0587, depth_m=0.0062, depth_max_m=0.01, arcs=9, rolls=9, direction=(0.0, 1.0, 0.0), dwell_s=0.5
)
"""Motion of the calibrations, that of the suite `spatial`."""

_ARCS_M = (0.025, 0.056)
_DEPTH_SHARES = (0.3, 0.95)
_DURATION_S = 8.0
_STEEPEST = 0.6
"""Largest share of the axis of a thin rod along the whisker, along which the rod would be missed."""
_ALONG = 0.5
"""Largest share of the direction of the push along that axis."""


class SolidKind(NamedTuple):
    """A kind of solid."""

    draw: Draw[AnySolid]
    """Draws a solid at the origin, in a random orientation."""
    aim: Callable[[AnySolid, np.random.Generator], Array]
    """Point (3,) of the solid's frame at which the push aims."""


def _direction(rng: np.random.Generator) -> tuple[float, float, float]:
    vector = rng.standard_normal(3)
    return tuple(round(float(value), 4) for value in vector / np.linalg.norm(vector))


def _quaternion(rng: np.random.Generator) -> tuple[float, float, float, float]:
    vector = rng.standard_normal(4)
    return tuple(float(value) for value in vector / np.linalg.norm(vector))


def _rod(rng: np.random.Generator) -> ThinRod:
    return ThinRod(radius_m=log_uniform(rng, 0.3e-3, 1e-3), axis=_direction(rng))


def _sphere(rng: np.random.Generator) -> Sphere:
    return Sphere(radius_m=log_uniform(rng, 8e-3, 0.08))


def _cylinder(rng: np.random.Generator) -> Cylinder:
    return Cylinder(radius_m=log_uniform(rng, 3e-3, 0.06), axis=_direction(rng))


def _cone(rng: np.random.Generator) -> Cone:
    radius_m = log_uniform(rng, 0.01, 0.04)
    return Cone(radius_m=radius_m, length_m=round(radius_m * uniform(rng, 1.5, 5.0), 6), axis=_direction(rng))


def _box(rng: np.random.Generator) -> Box:
    return Box(size_m=tuple(log_uniform(rng, 0.01, 0.08) for _ in range(3)), orientation=_quaternion(rng))


def _torus(rng: np.random.Generator) -> Torus:
    radius_m = log_uniform(rng, 0.02, 0.06)
    return Torus(radius_m=radius_m, tube_m=round(radius_m * uniform(rng, 0.2, 0.5), 6), axis=_direction(rng))


def _middle(_: AnySolid, __: np.random.Generator) -> Array:
    return np.zeros(3)


def _along_axis(solid: AnySolid, rng: np.random.Generator) -> Array:
    return np.array((0.0, 0.0, uniform(rng, -0.25, 0.25) * solid.length_m))


def _within(solid: Box, rng: np.random.Generator) -> Array:
    return np.array([uniform(rng, -0.45, 0.45) * size_m for size_m in solid.size_m])


def _on_ring(solid: Torus, rng: np.random.Generator) -> Array:
    angle_rad = uniform(rng, 0.0, 2.0 * np.pi)
    return solid.radius_m * np.array((np.cos(angle_rad), np.sin(angle_rad), 0.0))


SOLIDS: tuple[tuple[float, SolidKind], ...] = (
    (0.20, SolidKind(_rod, _middle)),
    (0.20, SolidKind(_sphere, _middle)),
    (0.22, SolidKind(_cylinder, _along_axis)),
    (0.10, SolidKind(_cone, _along_axis)),
    (0.20, SolidKind(_box, _within)),
    (0.08, SolidKind(_torus, _on_ring)),
)
"""Kinds of solids with their weights."""

Press = dict[str, object]
"""Parameters of a motion that all kinds have."""


def _sweep(press: Press, rng: np.random.Generator) -> Sweep:
    length_m, turn_rad = log_uniform(rng, 1e-3, 8e-3), uniform(rng, 0.0, 0.06, 4)
    return Sweep(
        **press,
        stroke_m=_scaled(_direction(rng), length_m),
        strokes=int(rng.integers(1, 4)),
        tilt_rad=_scaled(_direction(rng), turn_rad),
        peak_speed_m_s=log_uniform(rng, 5e-3, 0.05),
        dwell_s=uniform(rng, 0.0, 0.5, 2),
    )


def _smooth(press: Press, rng: np.random.Generator) -> SpatialSmooth:
    translation_m = log_uniform(rng, 5e-4, 3e-3)
    return SpatialSmooth(**press, translation_m=translation_m, rotation_rad=uniform(rng, 0.0, 0.05, 4))


def _spiral(press: Press, rng: np.random.Generator) -> Spiral:
    radius_m, turns = log_uniform(rng, 1e-3, 5e-3), uniform(rng, 1.0, 3.0, 2)
    return Spiral(**press, radius_m=radius_m, turns=turns, peak_speed_m_s=log_uniform(rng, 0.01, 0.05))


def _push(press: Press, rng: np.random.Generator) -> Push:
    return Push(**press, pushes=int(rng.integers(2, 5)), peak_speed_m_s=log_uniform(rng, 5e-3, 0.05), dwell_s=0.2)


MOTIONS: tuple[tuple[float, Callable[[Press, np.random.Generator], AnySpatialMotion]], ...] = (
    (0.55, _sweep),
    (0.20, _smooth),
    (0.15, _spiral),
    (0.10, _push),
)
"""Kinds of motions with their weights."""


class SpatialRandomSet(DrawnScenes, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One set of a random suite in space: the traces of one preset whisker on one solid."""

    def draw(self, attempt: int) -> "DrawnSpatialSet":
        """The set as drawn for the `attempt`-th time."""
        return DrawnSpatialSet(self, attempt)


class DrawnSpatialSet:
    """Properties that the traces of a set have in common."""

    def __init__(self, of: SpatialRandomSet, attempt: int) -> None:
        self._set, self._attempt = of, attempt
        rng = random_stream(f"{of.suite} set {of.index} attempt {attempt}", of.seed)
        self._kind = weighted(rng, SOLIDS)
        self._solid = self._kind.draw(rng)
        self._move = weighted(rng, MOTIONS)
        self._rate_hz = float(rng.choice(RATES_HZ))

    def scene(self, trace: int, attempt: int) -> SpatialScene:
        """Scene of a trace of the set, as drawn for the `attempt`-th time; raises `ValueError` if it is not valid."""
        of = self._set
        rng = random_stream(f"{of.suite} set {of.index} attempt {self._attempt} trace {trace} attempt {attempt}", of.seed)
        angle_rad = uniform(rng, 0.0, 2.0 * np.pi, 4)
        direction = (0.0, round(float(np.cos(angle_rad)), 6), round(float(np.sin(angle_rad)), 6))
        _check_across(self._solid, direction)
        arc_m = uniform(rng, *_ARCS_M, 4)
        share = (arc_m - CALIBRATION.contact_arc_m) / (CALIBRATION.arc_max_m - CALIBRATION.contact_arc_m)
        most_m = CALIBRATION.depth_m + share * (CALIBRATION.depth_max_m - CALIBRATION.depth_m)
        aim_m = self._solid.rotation @ self._kind.aim(self._solid, rng)
        press = {
            "contact_arc_m": arc_m,
            "direction": direction,
            "depth_m": round(uniform(rng, *_DEPTH_SHARES) * most_m, 6),
            "aim_m": tuple(round(float(value), 6) for value in aim_m),
        }
        motion = self._move(press, rng)
        return SpatialScene(
            format=2,
            name=of.name,
            role="trial",
            group=of.group,
            whisker=of.whisker,
            solid=self._solid,
            motion=motion,
            # The motion is drawn from the seed.
            seed=int(rng.integers(2**32)),
            duration_s=_DURATION_S if motion.needs_duration else None,
            rate_hz=self._rate_hz,
            simulation=of.simulation,
        )


def spatial_calibration_scene(suite: str, whisker: str) -> SpatialScene:
    """Calibration of a whisker."""
    name = f"{suite}_{whisker}"
    return SpatialScene(2, name, "calibration", "calibration", whisker, ThinRod(), CALIBRATION)


def _check_across(solid: AnySolid, direction: tuple[float, float, float]) -> None:
    """Raises `ValueError` if a push in this direction would miss a thin rod, or slide along it."""
    if isinstance(solid, ThinRod):
        along = abs(float(np.dot(solid.axis, direction)))
        if abs(solid.axis[0]) > _STEEPEST or along > _ALONG:
            raise ValueError("solid.axis: expected a rod across whisker and push")


def _scaled(vector: tuple[float, float, float], by: float) -> tuple[float, float, float]:
    return tuple(round(by * value, 6) for value in vector)
