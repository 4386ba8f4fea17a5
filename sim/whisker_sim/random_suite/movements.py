"""Random motions: one row per kind, with its weight. Lengths and speeds are scaled with the length of the whisker."""

from collections.abc import Callable

import numpy as np

from whisker_sim.motions import AnyMotion, Excursions, LateralSweep, LiftOffs, Smooth
from whisker_sim.random_suite.draw import log_uniform, uniform, weighted
from whisker_sim.random_suite.whiskers import scale
from whisker_sim.whisker import Whisker

DURATION_S = 4.0
"""Duration of `smooth` and approximate duration of the other motions."""

_ARC_SHARES = (0.15, 0.95)
"""Places of the contact, as shares of the whisker's length."""
_SET_SHARE = 0.15
"""Range of the places of a set, as a share of the whisker's length."""

Movement = Callable[[np.random.Generator], AnyMotion]
"""Draws the motion of one trace."""


def _arcs_m(whisker: Whisker, rng: np.random.Generator) -> tuple[float, float]:
    low = rng.uniform(_ARC_SHARES[0], _ARC_SHARES[1] - _SET_SHARE)
    return round(low * whisker.length_m, 5), round((low + _SET_SHARE) * whisker.length_m, 5)


def _smooth(whisker: Whisker, rng: np.random.Generator) -> Movement:
    low_m, high_m = _arcs_m(whisker, rng)
    lowest_hz, size = log_uniform(rng, 0.3, 1.2, 3), scale(whisker)
    motion = Smooth(
        arc_min_m=low_m,
        arc_max_m=high_m,
        press_per_m=round(2.4 / size, 4),
        depth_per_m=round(uniform(rng, 0.8, 2.4) / size, 4),
        translation_m=round(log_uniform(rng, 1e-3, 5e-3) * size, 6),
        rotation_rad=uniform(rng, 0.0, 0.1, 4),
        frequency_min_hz=lowest_hz,
        frequency_max_hz=round(lowest_hz * uniform(rng, 1.2, 4.0), 3),
    )
    return lambda _: motion


def _lateral_sweep(whisker: Whisker, rng: np.random.Generator) -> Movement:
    low_m, high_m = _arcs_m(whisker, rng)
    stroke_m = round(log_uniform(rng, 2e-3, 0.02) * scale(whisker), 6)
    # A stroke to and fro with the peak speed v takes 4 d / v.
    slowest_m_s = max(0.008 * scale(whisker), 4.0 * stroke_m / DURATION_S)
    speed_m_s = log_uniform(rng, slowest_m_s, max(slowest_m_s, 0.1 * scale(whisker)))
    strokes = max(1, round(DURATION_S * speed_m_s / (4.0 * stroke_m)))
    turn_rad = uniform(rng, 0.0, 0.5, 4)
    return lambda of_trace: LateralSweep(
        contact_arc_m=uniform(of_trace, low_m, high_m, 5),
        stroke_m=stroke_m,
        strokes=strokes,
        peak_speed_m_s=speed_m_s,
        yaw_rad=uniform(of_trace, -turn_rad, turn_rad, 4),
    )


def _lift_offs(whisker: Whisker, rng: np.random.Generator) -> Movement:
    low_m, high_m = _arcs_m(whisker, rng)
    size = scale(whisker)
    motion = LiftOffs(
        strokes=int(rng.integers(2, 7)),
        arc_min_m=low_m,
        arc_max_m=high_m,
        depth_min_m=round(2e-3 * size, 6),
        depth_max_m=round(uniform(rng, 4e-3, 9e-3) * size, 6),
        free_min_s=0.05,
        free_max_s=0.3,
        clearance_m=2e-3,
        acceleration_max_m_s2=uniform(rng, 0.5, 1.5, 3),
        rest_s=0.3,
    )
    return lambda _: motion


def _excursions(whisker: Whisker, rng: np.random.Generator) -> Movement:
    low_m, high_m = _arcs_m(whisker, rng)
    size = scale(whisker)
    fastest_m_s = log_uniform(rng, 0.02, 0.12)
    motion = Excursions(
        moves=int(rng.integers(5, 10)),
        arc_min_m=low_m,
        arc_max_m=high_m,
        depth_min_m=round(1.5e-3 * size, 6),
        depth_max_m=round(uniform(rng, 4e-3, 10e-3) * size, 6),
        along_m=round(uniform(rng, 0.0, 8e-3) * size, 6),
        turn_rad=uniform(rng, 0.0, 0.2, 4),
        speed_min_m_s=round(0.3 * fastest_m_s, 6),
        speed_max_m_s=fastest_m_s,
        pause_share=uniform(rng, 0.0, 0.6, 3),
        lift_share=uniform(rng, 0.0, 0.3, 3),
    )
    return lambda _: motion


MOVEMENTS: tuple[tuple[float, Callable[[Whisker, np.random.Generator], Movement]], ...] = (
    (0.35, _smooth),
    (0.30, _lateral_sweep),
    (0.15, _lift_offs),
    (0.20, _excursions),
)
"""Kinds of motion with their weights. A row draws the properties that the traces of a set have in common."""


def random_movement(whisker: Whisker, rng: np.random.Generator) -> Movement:
    """The motions of a set."""
    return weighted(rng, MOVEMENTS)(whisker, rng)
