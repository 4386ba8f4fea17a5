"""Simulation of the sets of a random suite in space, with rejection of scenes that are not possible.

A scene is rejected if the geometry does not allow its motion, the simulator refuses it (`whisker_sim.space.simulate`), it lasts
longer than `LONGEST_S`, or the whisker touches for less than `LEAST_TOUCHING_S`. It is drawn again as in the plane
(`whisker_sim.random_suite.simulate`).
"""

from pathlib import Path
from typing import NamedTuple

from whisker_sim.errors import WhiskerSimError
from whisker_sim.random_suite.simulate import accepted_set, set_line
from whisker_sim.runs import Run
from whisker_sim.space.simulate import SpatialSimulated, simulate_in_space
from whisker_sim.space.trace import is_spatial_complete, write_spatial_trace
from whisker_sim.trace import inputs_sha256

LONGEST_S = 15.0
LEAST_TOUCHING_S = 2.0


class SimulatedSpatialTrace(NamedTuple):
    """An accepted trace."""

    run: Run
    simulated: SpatialSimulated


def simulate_spatial_set(run: Run) -> list[SimulatedSpatialTrace]:
    """Simulates the traces of the random set `run`. Raises `SimulationError` if no attempt is possible."""
    return accepted_set(run, _accepted)


def _accepted(run: Run) -> SimulatedSpatialTrace | None:
    """The simulated trace, or `None` if it is rejected."""
    scene = run.scene
    try:
        plan = scene.plan(scene.solid)
    except ValueError:
        return None
    if len(plan.coordinates) * scene.simulation.timestep_s > LONGEST_S:
        return None
    try:
        simulated = simulate_in_space(run)
    except WhiskerSimError:
        return None
    touching_s = simulated.touching.sum() / scene.rate_hz
    return SimulatedSpatialTrace(run, simulated) if touching_s >= LEAST_TOUCHING_S else None


def write_spatial_set(folder: Path, run: Run, traces: list[SimulatedSpatialTrace]) -> str:
    """Writes the traces of a set into `folder`; returns one line of text for the user."""
    made_from = inputs_sha256(run.scene)
    for trace in traces:
        write_spatial_trace(folder, trace.run, trace.simulated, made_from)
    return set_line(run, traces)


def is_spatial_set_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the traces of a set."""
    made_from = inputs_sha256(run.scene)
    return all(is_spatial_complete(folder, name, made_from) for name in run.scene.names(run.name))
