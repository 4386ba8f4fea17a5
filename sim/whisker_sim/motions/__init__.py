"""Registry of base motions: one file and one row per motion."""

from whisker_sim.motions.base import Motion, Plan, Stage
from whisker_sim.motions.calibration_grid import CalibrationGrid
from whisker_sim.motions.excursions import Excursions
from whisker_sim.motions.increments_beam_test import IncrementsBeamTest
from whisker_sim.motions.lateral_sweep import LateralSweep
from whisker_sim.motions.lift_offs import LiftOffs
from whisker_sim.motions.rub import Rub
from whisker_sim.motions.smooth import Smooth
from whisker_sim.motions.stations import Stations

AnyMotion = (
    CalibrationGrid  #
    | Excursions
    | IncrementsBeamTest
    | LateralSweep
    | LiftOffs
    | Rub
    | Smooth
    | Stations
)
"""Motions that the key `kind` of a scene's `motion` may name."""

__all__ = ["AnyMotion", "Motion", "Plan", "Stage"]
