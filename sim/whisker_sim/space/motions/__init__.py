"""Registry of motions in space: one file and one row per motion."""

from whisker_sim.space.motions.arm import ArmStroke
from whisker_sim.space.motions.base import SpatialMotion, SpatialPlan, SpatialStage
from whisker_sim.space.motions.grid import SpatialGrid
from whisker_sim.space.motions.push import Push
from whisker_sim.space.motions.smooth import SpatialSmooth
from whisker_sim.space.motions.spiral import Spiral
from whisker_sim.space.motions.sweep import Sweep

AnySpatialMotion = (
    SpatialGrid  #
    | Push
    | SpatialSmooth
    | Spiral
    | Sweep
    | ArmStroke
)
"""Motions that the key `kind` of a spatial scene's `motion` may name."""

__all__ = ["AnySpatialMotion", "SpatialMotion", "SpatialPlan", "SpatialStage"]
