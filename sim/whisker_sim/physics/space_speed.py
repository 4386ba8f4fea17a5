"""Speed of a scene in space: `python -m whisker_sim.physics.space_speed` prints one row per whisker.

The scene is a sweep over a sphere with time steps of 1 ms. Times are processor time of this process.
"""

import time
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco

from whisker_sim.runs import Run
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import prepared, simulate_in_space

_TIMESTEP_S = 1e-3


class Speed(NamedTuple):
    """Speed of one scene."""

    whisker: str
    times_real_time: float
    """Simulated time over processor time, with planning, logging and ground truth."""
    trace_over_steps: float
    """Processor time of the whole trace over that of its `mj_step` calls."""


def measured(whisker: str, direction: tuple[float, float, float]) -> Speed:
    """Simulates the scene, then repeats its steps alone."""
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
    start_s = time.process_time()
    simulated = simulate_in_space(Run(scene.name, scene, Path(f"{scene.name}.json")))
    whole_s = time.process_time() - start_s
    model, data, controls = prepared(scene, scene.solid, scene.plan(scene.solid))
    start_s = time.process_time()
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
    steps_s = time.process_time() - start_s
    return Speed(whisker, float(simulated.time_s[-1]) / whole_s, whole_s / steps_s)


def main() -> None:
    """Print the speeds."""
    for whisker, direction in (("straight", (0.0, 1.0, 0.0)), ("curved", (0.0, -1.0, 0.0))):
        speed = measured(whisker, direction)
        print(f"{whisker}: {speed.times_real_time:.1f} times real time, trace over steps {speed.trace_over_steps:.2f}")


if __name__ == "__main__":
    main()
