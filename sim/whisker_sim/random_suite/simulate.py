"""Simulation of the sets of a random suite, with rejection of scenes that are not possible.

A scene is rejected if

- its rows are not whole numbers of the time steps, as of some sampling rates with `--simulation fast`,
- the geometry does not allow its motion, or the undeflected whisker overlaps the object at the start,
- the simulator refuses it (`whisker_sim.simulate`): the contact that the motion guarantees is lost or slips to the tip, or the
  surfaces penetrate,
- it lasts longer than `LONGEST_S`,
- the whisker touches in less than `LEAST_TOUCHING` of the rows, or for less than `LEAST_TOUCHING_S`, or
- the strain of the wire exceeds `LARGEST_STRAIN`.

A rejected trace is drawn again up to `TRACE_ATTEMPTS` times, then its set as a whole, up to `SET_ATTEMPTS` times. The random stream
of each attempt depends on the set and the number of the attempt alone.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np

from whisker_sim.certificate import Certificate, certify
from whisker_sim.errors import SimulationError, WhiskerSimError
from whisker_sim.random_suite.plane import DrawnSet
from whisker_sim.random_suite.space import DrawnSpatialSet
from whisker_sim.runs import Run
from whisker_sim.scene import Scene
from whisker_sim.simulate import Simulated, simulate
from whisker_sim.space.scene import SpatialScene
from whisker_sim.trace import inputs_sha256, is_complete, remove_leftovers, write_files
from whisker_sim.whisker import Whisker

LONGEST_S = 12.0
LEAST_TOUCHING = 0.4
LEAST_TOUCHING_S = 1.5
LARGEST_STRAIN = 0.06
TRACE_ATTEMPTS = 6
SET_ATTEMPTS = 50

_CLEAR_M = 1e-4
"""Least gap between the undeflected whisker and the object at the start."""


Accepted = TypeVar("Accepted")
"""An accepted trace, with its `run` and what was `simulated`."""


class SimulatedTrace(NamedTuple):
    """An accepted trace."""

    run: Run
    simulated: Simulated
    certificate: Certificate


def simulate_set(run: Run) -> list[SimulatedTrace]:
    """Simulates the traces of the random set `run`. Raises `SimulationError` if no attempt is possible."""
    return accepted_set(run, _accepted)


def accepted_set(run: Run, accepted: Callable[[Run], Accepted | None]) -> list[Accepted]:
    """The first drawn traces of the random set `run` that `accepted` returns, in the plane or in space.

    Raises `SimulationError` if no attempt is possible.
    """
    for attempt in range(SET_ATTEMPTS):
        traces = _attempt(run, run.scene.draw(attempt), accepted)
        if traces is not None:
            return traces
    raise SimulationError(f"expected a possible set in {SET_ATTEMPTS} attempts, found none")


def _attempt(run: Run, drawn: DrawnSet | DrawnSpatialSet, accepted: Callable[[Run], Accepted | None]) -> list[Accepted] | None:
    """The traces of a set, or `None` if one of them is not possible."""
    traces = []
    for index, name in enumerate(run.scene.names(run.name)):
        scenes = (_scene(drawn, index, attempt) for attempt in range(TRACE_ATTEMPTS))
        attempts = (accepted(Run(name, scene, run.path)) for scene in scenes if scene is not None)
        trace = next((trace for trace in attempts if trace is not None), None)
        if trace is None:
            return None
        traces.append(trace)
    return traces


def _scene(drawn: DrawnSet | DrawnSpatialSet, trace: int, attempt: int) -> Scene | SpatialScene | None:
    """The drawn scene, or `None` if it is not valid."""
    try:
        return drawn.scene(trace, attempt)
    except ValueError:
        return None


def _accepted(run: Run) -> SimulatedTrace | None:
    """The simulated trace, or `None` if it is rejected."""
    scene = run.scene
    if not _is_possible(scene):
        return None
    try:
        simulated = simulate(run)
    except WhiskerSimError:
        return None
    touching = simulated.touching
    if touching.mean() < LEAST_TOUCHING or touching.sum() / scene.rate_hz < LEAST_TOUCHING_S:
        return None
    if largest_strain(scene.resolved_whisker, simulated) > LARGEST_STRAIN:
        return None
    certificate = certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)
    return SimulatedTrace(run, simulated, certificate)


def _is_possible(scene: Scene) -> bool:
    """Whether the geometry allows the motion, its duration is acceptable, and the undeflected whisker is clear at the start."""
    try:
        plan = scene.plan()
    except ValueError:
        return False
    if len(plan.poses) * scene.simulation.timestep_s > LONGEST_S:
        return False
    return bool(scene.stage().rest_gap_m(plan.poses[:1])[0] >= _CLEAR_M)


def largest_strain(whisker: Whisker, simulated: Simulated) -> float:
    """Largest bending strain of the wire: radius times change of curvature, which is hinge rotation over length of a segment."""
    arc_m = whisker.segment_m * (np.arange(whisker.segments) + 0.5)
    return float(np.max(np.abs(simulated.rotations_rad[:, 1:]) * whisker.radius_m(arc_m) / whisker.segment_m))


def write_set(folder: Path, run: Run, traces: list[SimulatedTrace]) -> str:
    """Writes the traces of a set into `folder`; returns one line of text for the user."""
    made_from = inputs_sha256(run.scene)
    for trace in traces:
        remove_leftovers(folder, trace.run.name)
        write_files(folder, trace.run, trace.simulated, trace.certificate, made_from)
    return set_line(run, traces)


def set_line(run: Run, traces: Sequence[Accepted]) -> str:
    """One line of text about a simulated set, for the user."""
    duration_s = sum(trace.simulated.time_s[-1] for trace in traces)
    scene = traces[0].run.scene
    return f"{run.name}: {scene.resolved_whisker.name}, {scene.shape}, {scene.motion_kind}, {duration_s:.1f} s"


def is_set_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the traces of a set."""
    made_from = inputs_sha256(run.scene)
    return all(is_complete(folder, name, made_from) for name in run.scene.names(run.name))


def first_trace(run: Run) -> Run:
    """The first trace of a set as first drawn, for export."""
    return msgspec.structs.replace(run, scene=run.scene.draw(0).scene(0, 0))
