"""Single simulated strokes beside the elastica, shared by the studies of time step and speed."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.elastica import touching
from whisker_sim.motions.lateral_sweep import LateralSweep
from whisker_sim.physics.convergence import OBJECTS
from whisker_sim.runs import Run
from whisker_sim.scene import Scene, Simulation
from whisker_sim.simulate import simulate
from whisker_sim.whisker import Array, WhiskerOverride

CASES = (
    ("straight, circle R 15 mm", "straight", "circle_15", "left"),
    ("curved, concave side, circle R 15 mm", "curved", "circle_15", "left"),
    ("curved, convex side, pin", "curved", "pin", "right"),
)
"""Strokes by name: whisker, object, side on which the object is."""


class Compared(NamedTuple):
    """A sweep beside the elastica at the same base poses; n instants in contact."""

    since_s: Array
    """Time since the first contact (n,)."""
    static_n_m: Array
    """Reading of the elastica (n,); NaN where it has no contact."""
    dynamic_n_m: Array
    """Simulated reading minus that of the elastica (n,)."""


def stroke(whisker: str, shape: str, face: str, segments: int, timestep_s: float, speed_m_s: float) -> Compared:
    """Simulates one stroke of 10 mm back and forth."""
    scene = Scene(
        format=1,
        name="stroke",
        role="trial",
        group="physics",
        face=face,
        whisker=WhiskerOverride(preset=whisker, name=f"{whisker}_{segments}", segments=segments),
        object=OBJECTS[shape],
        motion=LateralSweep(contact_arc_m=0.05, stroke_m=0.01, strokes=1, peak_speed_m_s=speed_m_s),
        simulation=Simulation(timestep_s),
    )
    simulated = simulate(Run(scene.name, scene, Path(scene.name)))
    rows = np.flatnonzero(simulated.touching)
    arc_m, force_n = simulated.truth.arc_m[rows], simulated.force_n[rows]
    exact = touching(scene.resolved_whisker, scene.object, 1 if face == "left" else -1, simulated.base_pose[rows], arc_m, force_n)
    reading_n_m = scene.resolved_whisker.root_stiffness_n_m_rad * simulated.rotations_rad[rows, 0]
    static_n_m = np.where(exact.solved, exact.moment_n_m, np.nan)
    return Compared(simulated.time_s[rows] - simulated.time_s[rows[0]], static_n_m, reading_n_m - static_n_m)
