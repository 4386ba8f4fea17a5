"""Simulation of the sets of a random suite in space, with rejection of scenes that are not possible.

A scene is rejected if the geometry does not allow its motion, the simulator refuses it (`whisker_sim.space.simulate`), it lasts
longer than `LONGEST_S`, or the whisker touches for less than `LEAST_TOUCHING_S`. A rejected trace is drawn again up to
`TRACE_ATTEMPTS` times, then its set as a whole, up to `SET_ATTEMPTS` times.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from whisker_sim.errors import SimulationError, WhiskerSimError
from whisker_sim.random_suite.simulate import SET_ATTEMPTS, TRACE_ATTEMPTS
from whisker_sim.random_suite.space import DrawnSpatialSet
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
    for attempt in range(SET_ATTEMPTS):
        drawn = run.scene.draw(attempt)
        traces = [_first_accepted(run, drawn, index) for index in range(run.scene.traces)]
        if all(trace is not None for trace in traces):
            return traces
    raise SimulationError(f"expected a possible set in {SET_ATTEMPTS} attempts, found none")


def _first_accepted(run: Run, drawn: DrawnSpatialSet, index: int) -> SimulatedSpatialTrace | None:
    name = run.scene.names(run.name)[index]
    return next((trace for trace in _attempts(Run(name, run.scene, run.path), drawn, index) if trace is not None), None)


def _attempts(run: Run, drawn: DrawnSpatialSet, index: int) -> Iterator[SimulatedSpatialTrace | None]:
    for attempt in range(TRACE_ATTEMPTS):
        try:
            yield _accepted(msgspec.structs.replace(run, scene=drawn.scene(index, attempt)))
        except ValueError:
            yield None


def _accepted(run: Run) -> SimulatedSpatialTrace | None:
    """The simulated trace, or `None` if it is rejected."""
    scene = run.scene
    plan = scene.plan(scene.solid)
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
    scene = traces[0].run.scene
    duration_s = sum(trace.simulated.time_s[-1] for trace in traces)
    return f"{run.name}: {scene.resolved_whisker.name}, {scene.shape}, {scene.motion_kind}, {duration_s:.1f} s"


def is_spatial_set_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the traces of a set."""
    made_from = inputs_sha256(run.scene)
    return all(is_spatial_complete(folder, name, made_from) for name in run.scene.names(run.name))


def first_spatial_trace(run: Run) -> Run:
    """The first trace of a set as first drawn, for export."""
    return msgspec.structs.replace(run, scene=run.scene.draw(0).scene(0, 0))
