"""Speed of the generator: `python -m whisker_sim.physics.speed` measures, prints and evaluates claims.

Times of one process are processor times, so that other programs on the machine have little influence. Compared variants alternate;
medians are reported. Workers are timed by the wall clock on the whole suites `standard` and `spatial`, including their start. The
claims about the arm and about scenes in space (`whisker_sim.physics.space_speed`) are included.

Exit codes: 0 every claim holds, 1 a claim does not hold, 2 wrong usage, 130 interrupted.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

# As in the measured commands: threads of BLAS would compete with the processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import mujoco.rollout
import numpy as np

from whisker_sim.arm.simulate import SimulatedPassage, simulate_passage
from whisker_sim.cli import exit_code
from whisker_sim.jobs import FAILED, SUCCESS
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.paths import ROOT
from whisker_sim.physics import space_speed
from whisker_sim.physics.command import claim_line
from whisker_sim.physics.study import Claim
from whisker_sim.physics.timing import processor_s, suite_s
from whisker_sim.progress import Progress
from whisker_sim.runs import Run, load_runs, with_simulation
from whisker_sim.scene import SIMULATIONS
from whisker_sim.simulate import full_state, simulate
from whisker_sim.trace import write_trace

_SCENES = ROOT / "scenes"
_SUITE, _PASSAGE = _SCENES / "suites/standard.json", _SCENES / "arm/passage.json"
_TURNS = 7


class Row(NamedTuple):
    """Times of one trace, in seconds."""

    trace: str
    simulation: str
    simulated_s: float
    steps_s: float
    """Time of the `mj_step` calls."""
    traced_s: float
    """Time of `simulate`: plan, model, steps, logging and ground truth."""
    written_s: float
    """The same including certificate and files."""


def main(arguments: list[str] | None = None) -> int:
    """Measures and prints; returns the exit code."""
    parser = argparse.ArgumentParser(prog="whisker_sim.physics.speed", description="Measure the speed of the generator.")
    parser.parse_args(arguments)
    return exit_code(_report, "interrupted")


def _report() -> int:
    # One trial of each object and whisker.
    trials = {(run.scene.group, run.scene.whisker): run for run in load_runs(_SUITE)[1] if run.scene.role == "trial"}
    print(f"{'trace':<20}{'simulation':<12}{'times real time':>16}{'over bare steps':>17}{'and written':>13}", flush=True)
    rows = []
    with Progress("measure", "part", len(trials) * len(SIMULATIONS) + 4) as progress:
        for run, simulation in product(trials.values(), SIMULATIONS):
            row = measure(run, simulation)
            rows.append(row)
            print(
                f"{row.trace:<20}{row.simulation:<12}{row.simulated_s / row.traced_s:>16.1f}"
                f"{row.traced_s / row.steps_s:>17.3f}{row.written_s / row.steps_s:>13.3f}",
                flush=True,
            )
            progress.finish()
        claims = conclude(rows, two_workers())
        for further in (lambda: [arm()], space_speed.claims, lambda: [space_speed.suite_claim()]):
            progress.finish()
            claims += further()
        progress.finish()
    print()
    for claim in claims:
        print(claim_line(claim))
    return SUCCESS if all(claim.holds for claim in claims) else FAILED


def measure(run: Run, simulation: str) -> Row:
    """Times the trace of `run` with the simulation settings of a name."""
    run = with_simulation(run, SIMULATIONS[simulation][1])
    with tempfile.TemporaryDirectory() as folder:
        ways = (bare_steps(run), lambda: simulate(run), lambda: write_trace(Path(folder), run, simulate(run)))
        times = np.array([[processor_s(way) for way in ways] for _ in range(1 + _TURNS)])
    # The first turn warms up the caches.
    return Row(run.name, simulation, simulate(run).time_s[-1], *np.median(times[1:], axis=0))


def bare_steps(run: Run) -> Callable[[], object]:
    """A function that takes the time steps of the trace, with its controls, in one call of MuJoCo, and discards the results.

    The call stores the state after each step; a loop of `mj_step` without storage takes the same time within 1 %.
    """
    scene = run.scene
    plan = scene.plan()
    model = build_model(scene.resolved_whisker, scene.object, scene.simulation.timestep_s, scene.friction_coefficient)
    data = mujoco.MjData(model)
    poses = plan.poses * (MM_PER_M, MM_PER_M, 1.0)
    data.qpos[:3] = data.act[:] = poses[0]
    state = full_state(model, data)
    velocities = np.diff(poses, axis=0) / scene.simulation.timestep_s
    return lambda: mujoco.rollout.rollout(model, data, state[None], velocities[None])


def two_workers() -> float:
    """Speed-up of the standard suite by two workers over one, by the wall clock, from the start of the command to its end."""
    return suite_s(_SUITE, 1) / suite_s(_SUITE, 2)


def arm() -> Claim:
    """The claim about the arm with its six whiskers and free objects in one model: plan, steps, logging and ground truth, once."""
    ((run,),) = load_runs(_PASSAGE)[1:]
    passed: list[SimulatedPassage] = []
    taken_s = processor_s(lambda: passed.append(simulate_passage(run)))
    claim = f"arm with six whiskers and free objects, one core, times real time ({run.name})"
    return Claim("speed_arm", claim, passed[0].time_s[-1] / taken_s, ">=", 0.5, "")


def conclude(rows: list[Row], gain_of_two_workers: float) -> list[Claim]:
    """Claims about the slowest traces."""

    def times_real_time(row: Row) -> float:
        return row.simulated_s / row.traced_s

    claims = []
    for simulation, bound in (("default", 7.0), ("fast", 14.0)):
        slowest = min((row for row in rows if row.simulation == simulation), key=times_real_time)
        claim = f"{simulation} settings, one core, times real time ({slowest.trace})"
        claims.append(Claim(f"speed_{simulation}", claim, times_real_time(slowest), ">=", bound, ""))
    most = max((row for row in rows if row.simulation == "default"), key=lambda row: row.traced_s / row.steps_s)
    claim = f"whole trace over its bare steps ({most.trace})"
    claims.append(Claim("overhead", claim, most.traced_s / most.steps_s, "<=", 1.1, ""))
    claims.append(Claim("two_workers", "two workers, times faster than one", gain_of_two_workers, ">=", 1.8, ""))
    return claims


if __name__ == "__main__":
    sys.exit(main())
