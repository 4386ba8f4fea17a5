"""Speed of scenes in space: `python -m whisker_sim.physics.space_speed` measures, prints and evaluates claims.

The speed is that of a sweep over a sphere with time steps of 1 ms, by the processor time of this process. The suite `spatial` is
simulated by two workers and timed by the wall clock (`--suite`).

Exit codes: 0 every claim holds, 1 a claim does not hold, 2 wrong usage.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import NamedTuple

# As in the measured commands: threads of BLAS would compete with the processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import msgspec
import mujoco

from whisker_sim.cli import exit_code
from whisker_sim.jobs import FAILED, SUCCESS
from whisker_sim.paths import ROOT
from whisker_sim.physics.command import claim_line
from whisker_sim.physics.study import Claim
from whisker_sim.physics.timing import processor_s, suite_s
from whisker_sim.runs import Run
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import prepared, simulate_in_space

_TIMESTEP_S = 1e-3
_TURNS = 5
_DIRECTIONS = {"straight": (0.0, 1.0, 0.0), "curved": (0.0, -1.0, 0.0)}
"""Direction in which each whisker is pressed against the sphere."""
_SUITE = ROOT / "scenes/suites/spatial.json"


class Speed(NamedTuple):
    """Speed of one scene."""

    whisker: str
    times_real_time: float
    """Simulated time over processor time, with planning, logging and ground truth but without certificate and files."""
    trace_over_steps: float
    """Processor time of the whole trace over that of its `mj_step` calls."""


def measured(whisker: str, direction: tuple[float, float, float]) -> Speed:
    """Simulates the scene and its steps alone, in turns; the fastest of each counts."""
    document = {
        "format": 2,
        "name": f"speed_{whisker}",
        "role": "trial",
        "group": "speed",
        "whisker": whisker,
        "solid": {"shape": "sphere", "radius_m": 0.02},
        "motion": {
            "kind": "sweep",
            "contact_arc_m": 0.0487,
            "depth_m": 0.006,
            "direction": direction,
            "stroke_m": (0.0, 0.0, 0.006),
            "strokes": 3,
        },
        "simulation": {"timestep_s": _TIMESTEP_S},
    }
    scene = msgspec.convert(document, SpatialScene)
    run = Run(scene.name, scene, Path(f"{scene.name}.json"))

    def steps() -> None:
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)

    whole_s, steps_s = [], []
    for _ in range(_TURNS):
        whole_s.append(processor_s(lambda: simulate_in_space(run)))
        model, data, controls = prepared(scene, scene.solid, scene.plan(scene.solid))
        steps_s.append(processor_s(steps))
    simulated_s = len(controls) * _TIMESTEP_S
    return Speed(whisker, simulated_s / min(whole_s), min(whole_s) / min(steps_s))


def claims() -> list[Claim]:
    """Claims about the slower of both whiskers."""
    speeds = [measured(whisker, direction) for whisker, direction in _DIRECTIONS.items()]
    slowest = min(speeds, key=lambda speed: speed.times_real_time)
    most = max(speeds, key=lambda speed: speed.trace_over_steps)
    sweep = "sweep over a sphere in space, 1 ms steps, one core"
    return [
        Claim("speed_space", f"{sweep}, times real time ({slowest.whisker})", slowest.times_real_time, ">=", 5.0, ""),
        Claim("overhead_space", f"{sweep}: whole trace over its steps ({most.whisker})", most.trace_over_steps, "<=", 1.15, ""),
    ]


def suite_claim() -> Claim:
    """The claim about the time that two workers take for the suite, by the wall clock."""
    return Claim("space_suite_time", "suite spatial, two workers, wall-clock time", suite_s(_SUITE, 2), "<=", 600.0, "s")


def main(arguments: list[str] | None = None) -> int:
    """Measures and prints; returns the exit code."""
    parser = argparse.ArgumentParser(prog="whisker_sim.physics.space_speed", description="Measure the speed of scenes in space.")
    parser.add_argument("--suite", action="store_true", help="also simulate the suite spatial")
    options = parser.parse_args(arguments)
    return exit_code(lambda: _report(options.suite), "interrupted")


def _report(suite: bool) -> int:
    found = claims() + ([suite_claim()] if suite else [])
    for claim in found:
        print(claim_line(claim))
    return SUCCESS if all(claim.holds for claim in found) else FAILED


if __name__ == "__main__":
    sys.exit(main())
