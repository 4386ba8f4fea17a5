"""Runs of the simulation that scene and suite files define."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import msgspec

from whisker_sim.arm.scene import ArmScene
from whisker_sim.documents import located, read_document, read_json
from whisker_sim.errors import InputError
from whisker_sim.random_suite.plane import RandomSet
from whisker_sim.random_suite.space import SpatialRandomSet
from whisker_sim.random_suite.suite import RandomSuite
from whisker_sim.scene import Format, Scene, Seed, Simulation
from whisker_sim.space.scene import SpatialScene
from whisker_sim.whisker import Name

AnyScene = Scene | ArmScene | SpatialScene | RandomSet | SpatialRandomSet


class SuiteEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One scene of a suite with the seeds of its runs; by default the scene's own seed."""

    scene: str
    seeds: Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)] | None = None


class Suite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A set of scenes that are run together."""

    format: Format
    name: Name
    scenes: Annotated[tuple[SuiteEntry, ...], msgspec.Meta(min_length=1)]


class Redrawn(msgspec.Struct, frozen=True):
    """Values in place of those of a random suite's file; `None` keeps the file's."""

    seed: Seed | None = None
    sets: int | None = None


class Run(msgspec.Struct, frozen=True):
    """One run, which makes a trace or a recording of several whiskers."""

    name: str
    scene: AnyScene
    """The scene with the seed of this run."""
    path: Path
    """File of the scene."""


def load(path: Path) -> AnyScene | Suite | RandomSuite:
    """Reads a scene or a suite. A scene with an arm has the key `arm`, one in space `solid`, a random suite the key `random`.

    Raises `InputError` if the file is neither.
    """
    value, _ = read_json(path)
    if not isinstance(value, dict):
        raise InputError(f"{path}: expected an object, found {type(value).__name__}")
    kinds = {"scenes": Suite, "random": RandomSuite, "arm": ArmScene, "solid": SpatialScene}
    return read_document(path, next((kind for key, kind in kinds.items() if key in value), Scene))


def with_simulation(run: Run, simulation: Simulation) -> Run:
    """`run` with other simulation settings; raises `InputError` if they do not fit its rate or its friction."""
    try:
        return msgspec.structs.replace(run, scene=msgspec.structs.replace(run.scene, simulation=simulation))
    except ValueError as error:
        raise located(run.path, str(error)) from None


def load_runs(path: Path, redrawn: Redrawn | None = None) -> tuple[str | None, list[Run]]:
    """Name of the suite, or `None` for a scene, and the runs of a scene or suite file.

    `redrawn` replaces the seed and the number of sets of a random suite. Raises `InputError`, also if two traces or recordings of a
    suite have the same name, or if `redrawn` is given for another file.
    """
    document = load(path)
    if isinstance(document, RandomSuite):
        return random_runs(path, document, redrawn or Redrawn())
    if redrawn is not None:
        raise InputError(f"{path}: expected a random suite with --seed or --count, found another file")
    if not isinstance(document, Suite):
        check_files(path, document)
        return None, [Run(document.name, document, path)]
    runs: list[Run] = []
    taken: set[str] = set()
    for index, entry in enumerate(document.scenes):
        scene_path = Path(os.path.normpath(path.parent / entry.scene))
        if not scene_path.is_file():
            raise InputError(f"{path}: scenes[{index}].scene: expected a scene's file, found no file '{entry.scene}'")
        scene = load(scene_path)
        if isinstance(scene, Suite | RandomSuite):
            raise InputError(f"{path}: scenes[{index}].scene: expected a scene's file, found the suite '{entry.scene}'")
        check_files(scene_path, scene)
        seeds = entry.seeds or (scene.seed,)
        for seed in seeds:
            name = scene.name if entry.seeds is None else f"{scene.name}_{seed:02d}"
            for made in scene.names(name):
                if made in taken:
                    raise InputError(f"{path}: scenes[{index}]: expected traces of different names, found '{made}' twice")
                taken.add(made)
            runs.append(Run(name, msgspec.structs.replace(scene, seed=seed), scene_path))
    return document.name, runs


def check_files(path: Path, scene: AnyScene) -> None:
    """Raises `InputError` if a file that the scene at `path` names is not what it should be."""
    if isinstance(scene, SpatialScene):
        try:
            scene.solid.placed(path.parent)
        except ValueError as error:
            raise located(path, str(error)) from None


def check_plan(run: Run) -> None:
    """Plans the motion of `run`; raises `ValueError` if it does not fit the scene."""
    if isinstance(run.scene, SpatialScene):
        run.scene.plan(run.scene.solid.placed(run.path.parent))
    else:
        run.scene.plan()


def random_runs(path: Path, suite: RandomSuite, redrawn: Redrawn) -> tuple[str, list[Run]]:
    """Name and runs of a random suite: the calibrations of its whiskers, then its sets.

    With a seed other than that of the file, the name ends with the seed.
    """
    given = {key: value for key, value in msgspec.structs.asdict(redrawn).items() if value is not None}
    drawn = msgspec.structs.replace(suite, random=msgspec.structs.replace(suite.random, **given))
    calibrations = [Run(f"{scene.name}_{scene.seed:02d}", scene, path) for scene in drawn.calibrations()]
    name = suite.name if drawn.random.seed == suite.random.seed else drawn.prefix
    return name, calibrations + [Run(drawn_set.name, drawn_set, path) for drawn_set in drawn.sets()]


def first_of_each_set(runs: Iterable[Run]) -> list[Run]:
    """The first trial of each set, that is of each group with each whisker."""
    first: dict[str, Run] = {}
    for run in runs:
        if run.scene.role == "trial":
            first.setdefault(set_name(run), run)
    return list(first.values())


def set_name(run: Run) -> str:
    """Name of the set of a run, `<group>.<whisker>`. Neither part contains a dot, so the names of sets differ."""
    return f"{run.scene.group}.{run.scene.resolved_whisker.name}"
