"""Trials of the standard suite with the fast simulation settings, against the elastica at every quasi-static instant."""

import hashlib
from functools import partial
from pathlib import Path

from whisker_sim.certificate import contacts_of
from whisker_sim.documents import read_document
from whisker_sim.physics.study import Findings, Study
from whisker_sim.physics.sweeps import Row, claims_about, compare_contacts
from whisker_sim.runs import Run, with_simulation
from whisker_sim.scene import SIMULATIONS, Scene
from whisker_sim.simulate import simulate
from whisker_sim.trace import COLUMNS, Sidecar, format_csv, trace_columns

_, FAST = SIMULATIONS["fast"]
TIMES_THE_BOUNDS = 2.0
"""Bounds of the fast settings relative to the default ones."""


def fast(run: Run) -> Row:
    """Simulates `run` with the fast settings and compares it, without writing files."""
    run = with_simulation(run, FAST)
    simulated = simulate(run)
    rows = format_csv(trace_columns(simulated, run.scene.resolved_whisker), COLUMNS)
    row, _ = compare_contacts(
        run.name, run.scene, contacts_of(run.scene.resolved_whisker, simulated), hashlib.sha256(rows).hexdigest()
    )
    return row


def _tasks(dataset: Path) -> list[partial[Row]]:
    sidecars = [(path, read_document(path, Sidecar[Scene])) for path in sorted(dataset.glob("*.json"))]
    return [partial(fast, Run(sidecar.name, sidecar.scene, path)) for path, sidecar in sidecars if sidecar.role == "trial"]


def _conclude(results: list[Row]) -> Findings:
    return Findings({"fast": results}, claims_about("fast", "fast settings, trials", results, TIMES_THE_BOUNDS))


STUDY = Study("fast", "trials of the standard suite with the fast settings against the elastica", _tasks, _conclude)
