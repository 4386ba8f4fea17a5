"""Random whiskers, each with the scenes of its own calibration."""

import msgspec
import numpy as np

from whisker_sim.motions import CalibrationGrid
from whisker_sim.random_suite.draw import log_uniform, uniform
from whisker_sim.scene import Scene
from whisker_sim.shapes import Pin
from whisker_sim.whisker import Arc, Whisker, WhiskerOverride, resolve_whisker

STANDARD = ("straight", "curved")
"""Presets that every random suite contains; each is half as frequent as all random whiskers together."""

CALIBRATION_SEEDS = (0, 1)
FACES = ("left", "right")

_PRESET_LENGTH_M = 0.08

LEAST_DEPTH_M = 5e-3
"""Least depth of a calibration push, for a whisker as long as the presets: the whisker still rings when it first touches, and the
contact of a shallower push may bounce beyond half of the push."""
_ARC_STEP_M = 1e-4


def random_whisker(name: str, rng: np.random.Generator) -> WhiskerOverride:
    """A nitinol wire with another length, slenderness, taper, curvature and root.

    The ratio k L / (EI) of the stiffness of root and wire is 0.6 to 2.4; that of the presets is 1.2.
    """
    length_m = log_uniform(rng, 0.05, 0.11, 4)
    root_m = uniform(rng, 1.0 / 420.0, 1.0 / 260.0, 6) * length_m
    taper = uniform(rng, 0.4, 1.0, 3) if rng.random() < 0.5 else 1.0
    straight_share, turn_rad = uniform(rng, 0.0, 0.5, 2), uniform(rng, 0.3, 1.3, 3)
    bends, has_straight_part = rng.random() < 0.6, rng.random() < 0.4
    straight_m = round(straight_share * length_m, 4) if has_straight_part else 0.0
    arc_m = round(length_m - straight_m, 6)
    arcs = ((Arc(straight_m, 0.0),) if straight_m > 0.0 else ()) + (Arc(arc_m, round(turn_rad / arc_m, 3)),)
    wire = resolve_whisker("straight")
    bending_n_m2 = wire.youngs_modulus_pa * np.pi / 64.0 * root_m**4
    return WhiskerOverride(
        preset="straight",
        name=name,
        length_m=length_m,
        root_diameter_m=round(root_m, 7),
        tip_diameter_m=round(taper * root_m, 7),
        curvature=arcs if bends else (Arc(length_m, 0.0),),
        root_stiffness_n_m_rad=float(f"{log_uniform(rng, 0.6, 2.4) * bending_n_m2 / length_m:.3g}"),
    )


def scale(whisker: Whisker) -> float:
    """Length relative to that of the presets, by which motions are scaled."""
    return whisker.length_m / _PRESET_LENGTH_M


def calibration_scene(suite: str, whisker: str | WhiskerOverride, face: str, seed: int) -> Scene:
    """Calibration of one face: that of the standard suite, scaled to the length of the whisker.

    A curved wire slips off its tip at a smaller depth than a straight one: the margin at the tip grows with the square of its turn,
    and the calibration ends where the depth falls to `LEAST_DEPTH_M`.
    """
    resolved = resolve_whisker(whisker)
    share = round(scale(resolved), 6)
    tip_margin_m = 1e-3 + 2e-3 * float(resolved.rest_angle_rad(resolved.length_m)) ** 2
    grid = CalibrationGrid(
        lines=20,
        arc_min_m=round(0.018 * share, 6),
        arc_max_m=round(min(0.076, _PRESET_LENGTH_M - tip_margin_m - 1e-3) * share, 6),
        depth_ratio=0.47,
        depth_max_m=round(0.024 * share, 6),
        speed_m_s=round(0.045 * share, 6),
        tip_margin_m=round(tip_margin_m * share, 6),
    )
    name = f"{suite}_{resolved.name.removeprefix(f'{suite}_')}_{face}"
    scene = Scene(1, name, "calibration", "calibration", face, whisker, Pin(), grid, seed=seed)
    stage = scene.stage()
    while grid.depth_m(grid.arc_max_m, stage) < LEAST_DEPTH_M * share:
        grid = msgspec.structs.replace(grid, arc_max_m=round(grid.arc_max_m - _ARC_STEP_M * share, 6))
    return msgspec.structs.replace(scene, motion=grid)
