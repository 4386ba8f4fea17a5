"""What comes of a run: a trace, or a recording of several whiskers. One row a kind of scene."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco

from whisker_sim import trace
from whisker_sim.arm import recording
from whisker_sim.arm.picture import PassageDrawing, replayed_passage
from whisker_sim.arm.scene import ArmScene
from whisker_sim.drawing import Drawing
from whisker_sim.export import Start, passage_at_start, sweep_at_start
from whisker_sim.render import Pictures, replayed_sweep
from whisker_sim.runs import Run
from whisker_sim.scene import Scene
from whisker_sim.whisker import Array


class Product(NamedTuple):
    """What can be made of a run of one kind."""

    make: Callable[[Path, Run], str]
    """Simulates and writes the files into a folder; gives one line for people."""
    is_up_to_date: Callable[[Path, Run], bool]
    """Whether a folder holds just the files that `make` would write."""
    draw: type[Pictures]
    """Simulates, and makes ready to be drawn."""
    replay: Callable[[Run], tuple[mujoco.MjModel, Array]]
    """Simulates; gives the model and its coordinates (n, nq) at every row."""
    start: Callable[[Run], Start]
    """The model where it starts, to be exported."""


PRODUCTS: dict[type, Product] = {
    Scene: Product(trace.make, trace.is_up_to_date, Drawing, replayed_sweep, sweep_at_start),
    ArmScene: Product(recording.make, recording.is_up_to_date, PassageDrawing, replayed_passage, passage_at_start),
}
"""The products by the kind of scene."""


def product_of(run: Run) -> Product:
    """What comes of `run`."""
    return PRODUCTS[type(run.scene)]
