"""Products of a run, a trace or a recording of several whiskers, and the jobs that make them. One row per kind of scene."""

import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import mujoco
import numpy as np

from whisker_sim import trace
from whisker_sim.arm import recording
from whisker_sim.arm.picture import PassageRenderer, replayed_passage
from whisker_sim.arm.scene import ArmScene
from whisker_sim.arm.simulate import simulate_passage
from whisker_sim.drawing import SweepRenderer
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.export import Start, passage_at_start, sweep_at_start
from whisker_sim.jobs import FAILED, SUCCESS, WRONG_INPUT, Items, Job, Outcome
from whisker_sim.progress import part
from whisker_sim.random_suite import simulate as random_set
from whisker_sim.random_suite import simulate_space as random_spatial_set
from whisker_sim.random_suite.contacts import RandomContactSet
from whisker_sim.random_suite.picture import RandomSetRenderer, SpatialSetRenderer
from whisker_sim.random_suite.plane import RandomSet
from whisker_sim.random_suite.space import SpatialRandomSet
from whisker_sim.render import Renderer, check_format, is_rendered, render, render_set, replayed_sweep
from whisker_sim.runs import Run, set_name
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate
from whisker_sim.space.picture import SpatialRenderer
from whisker_sim.space.replay import replayed_in_space, space_at_start
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import simulate_in_space
from whisker_sim.space.trace import is_spatial_up_to_date, write_spatial_trace
from whisker_sim.whisker import Array


class Product(NamedTuple):
    """Operations on the runs of one kind of scene."""

    simulate: Callable[[Run], Any]
    """Simulates the run."""
    write: Callable[[Path, Run, Any], str]
    """Writes the files of a simulated run into a folder; returns one line of text for the user."""
    is_up_to_date: Callable[[Path, Run], bool]
    """Whether a folder holds exactly the files that `write` would write."""
    renderer: type[Renderer]
    """Draws a simulated run."""
    replay: Callable[[Run, Any], tuple[mujoco.MjModel, Array]]
    """Model and coordinates (n, nq) of a simulated run at every row."""
    start: Callable[[Run], Start]
    """Model in its start pose, for export."""


_RANDOM_SET_PRODUCT = Product(
    random_set.simulate_set,
    random_set.write_set,
    random_set.is_set_up_to_date,
    RandomSetRenderer,
    lambda _, traces: replayed_sweep(traces[0].run, traces[0].simulated),
    lambda run: sweep_at_start(random_set.first_trace(run)),
)

PRODUCTS: dict[type, Product] = {
    Scene: Product(simulate, trace.write_trace, trace.is_up_to_date, SweepRenderer, replayed_sweep, sweep_at_start),
    ArmScene: Product(
        simulate_passage, recording.write_recording, recording.is_up_to_date, PassageRenderer, replayed_passage, passage_at_start
    ),
    SpatialScene: Product(
        simulate_in_space, write_spatial_trace, is_spatial_up_to_date, SpatialRenderer, replayed_in_space, space_at_start
    ),
    RandomSet: _RANDOM_SET_PRODUCT,
    RandomContactSet: _RANDOM_SET_PRODUCT,
    SpatialRandomSet: Product(
        random_spatial_set.simulate_spatial_set,
        random_spatial_set.write_spatial_set,
        random_spatial_set.is_spatial_set_up_to_date,
        SpatialSetRenderer,
        lambda _, traces: replayed_in_space(traces[0].run, traces[0].simulated),
        lambda run: space_at_start(random_set.first_trace(run)),
    ),
}
"""Products by kind of scene."""


BOUNDS = {
    1: {
        "unsolved": 0.0,
        "moment_rms": 1e-3,
        "surface_rms_m": 10e-6,
        "surface_worst_m": 60e-6,
        "arc_rms_m": 40e-6,
        "penetration_worst_m": 10e-6,
    },
    2: {
        "unsolved": 0.0,
        "moment_rms": 1e-3,
        "moment_jump": 1e-3,
        "surface_rms_m": 20e-6,
        "normal_rms_rad": 3.5e-3,
        "penetration_worst_m": 10e-6,
    },
}
"""Bounds of the values of certificates, by the format of the trace; those of `whisker check`."""

_MOST_NAMED = 10


Drawn = frozenset[tuple[Path, str]]
"""Files of the scenes and names of the runs that are drawn: runs of several suites may have the same name."""


def product_of(run: Run) -> Product:
    """Operations on `run`."""
    return PRODUCTS[type(run.scene)]


def replayed(run: Run) -> tuple[mujoco.MjModel, Array]:
    """Simulates `run`; returns the model and its coordinates (n, nq) at every row."""
    product = product_of(run)
    return product.replay(run, product.simulate(run))


def trace_job(force: bool, animations: Path | None = None, drawn: Drawn = frozenset()) -> Job:
    """The job that makes traces and recordings and, from the same simulation, animations of the runs in `drawn`.

    `force` makes up-to-date files again.
    """

    def is_up_to_date(folder: Path, run: Run) -> bool:
        product = product_of(run)
        drawing = (run.path, run.name) in drawn and not is_rendered(animations, run, product.renderer)
        return product.is_up_to_date(folder, run) and not drawing

    make = partial(make_trace, force=force, animations=animations, drawn=drawn)
    return Job("simulate", "trace", lambda run: run.name, is_up_to_date, make)


def animation_job() -> Job:
    """The job that draws an animation and a still of each set."""

    def is_up_to_date(folder: Path, run: Run) -> bool:
        return is_rendered(folder, run, product_of(run).renderer)

    return Job("render", "animation", set_name, is_up_to_date, _make_animation)


def picture_job(path: Path) -> Job:
    """The job that draws one run into the file `path`."""
    return Job("render", "picture", lambda _: path.stem, lambda *_: False, partial(_make_picture, path))


def make_trace(folder: Path, run: Run, force: bool = False, animations: Path | None = None, drawn: Drawn = frozenset()) -> Outcome:
    """Simulates `run`; writes its trace into `folder` and its animation into `animations` unless they are up to date."""
    product = product_of(run)

    def work() -> str:
        draws = (run.path, run.name) in drawn and (force or not is_rendered(animations, run, product.renderer))
        simulation_share = 0.5 if draws else 0.9
        with part(0.0, simulation_share):
            simulated = product.simulate(run)
        lines = []
        if force or not product.is_up_to_date(folder, run):
            lines.append(product.write(folder, run, simulated))
        if draws:
            with part(simulation_share, 1.0):
                render_set(animations, product.renderer(run, simulated))
            lines.append(f"{set_name(run)}: drawn from {run.name}")
        return "\n".join(lines)

    return _outcome(run, work)


def _make_animation(folder: Path, run: Run) -> Outcome:
    """Simulates `run` and draws it into `folder` for its set."""

    def work() -> str:
        renderer = _simulated_renderer(run)
        with part(0.5, 1.0):
            render_set(folder, renderer)
        return f"{set_name(run)}: drawn from {run.name}"

    return _outcome(run, work)


def _make_picture(path: Path, _: Path, run: Run) -> Outcome:
    """Simulates `run` and draws it into the file `path`."""

    def work() -> str:
        check_format(path)
        renderer = _simulated_renderer(run)
        with part(0.5, 1.0):
            render(path, renderer)
        return ""

    return _outcome(run, work)


def _simulated_renderer(run: Run) -> Renderer:
    product = product_of(run)
    with part(0.0, 0.5):
        simulated = product.simulate(run)
    return product.renderer(run, simulated)


def _outcome(run: Run, work: Callable[[], str]) -> Outcome:
    """Outcome of `work` on `run`: its line of text, or its error.

    An error of the arithmetic or for lack of memory concerns this run alone, and the other runs go on.
    """
    try:
        return Outcome(SUCCESS, work())
    except InputError as error:
        return Outcome(WRONG_INPUT, f"error: {error}")
    except WhiskerSimError as error:
        return Outcome(FAILED, f"error: {run.path}: {run.name}: {error}")
    except (ArithmeticError, MemoryError, ValueError, np.linalg.LinAlgError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        found = WhiskerSimError(" ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":"))
        return Outcome(FAILED, f"error: {run.path}: {run.name}: unexpected {found} ({Path(place.filename).name}:{place.lineno})")


def notes_on_accuracy(items: Items) -> list[str]:
    """Notes that name the traces of `items` whose certificates exceed a bound, one per folder."""
    inaccurate: dict[Path, list[str]] = {}
    for folder, run in items:
        for name in run.scene.names(run.name):
            if _exceeds_a_bound(folder / f"{name}.json"):
                inaccurate.setdefault(folder, []).append(name)
    return [
        f"note: the deviation from statics exceeds a bound (quick motion, or coarse simulation) in {_named(names)}; "
        f"`whisker check {folder}` states the values"
        for folder, names in inaccurate.items()
    ]


def _exceeds_a_bound(path: Path) -> bool:
    """Whether a sidecar states a certificate with a value above its bound.

    The description of a recording of several whiskers has no certificate; a trace that failed may have no valid sidecar.
    """
    try:
        sidecar = msgspec.json.decode(path.read_bytes())
        certificate = sidecar["certificate"]
        return any((certificate[key] or 0.0) > bound for key, bound in BOUNDS[sidecar["format"]].items())
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return False


def _named(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more
