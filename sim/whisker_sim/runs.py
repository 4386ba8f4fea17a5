"""Runs of the simulation that scene and suite files define."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import msgspec

from whisker_sim.arm.scene import ArmScene
from whisker_sim.documents import located, read_document, read_json
from whisker_sim.errors import InputError
from whisker_sim.scene import Format, Scene, Seed, Simulation
from whisker_sim.whisker import Name

AnyScene = Scene | ArmScene


class SuiteEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One scene of a suite with the seeds of its runs; by default the scene's own seed."""

    scene: str
    seeds: Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)] | None = None


class Suite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A set of scenes that are run together."""

    format: Format
    name: Name
    scenes: Annotated[tuple[SuiteEntry, ...], msgspec.Meta(min_length=1)]


class Run(msgspec.Struct, frozen=True):
    """One run, which makes a trace or a recording of several whiskers."""

    name: str
    scene: AnyScene
    """The scene with the seed of this run."""
    path: Path
    """File of the scene."""


def load(path: Path) -> AnyScene | Suite:
    """Reads a scene or a suite; a scene with an arm has the key `arm`. Raises `InputError` if the file is neither."""
    value, _ = read_json(path)
    if not isinstance(value, dict):
        raise InputError(f"{path}: expected an object, found {type(value).__name__}")
    kind = Suite if "scenes" in value else ArmScene if "arm" in value else Scene
    return read_document(path, kind)


def with_simulation(run: Run, simulation: Simulation) -> Run:
    """`run` with other simulation settings; raises `InputError` if its rows are not whole numbers of their time steps."""
    try:
        return msgspec.structs.replace(run, scene=msgspec.structs.replace(run.scene, simulation=simulation))
    except ValueError as error:
        raise located(run.path, str(error)) from None


def load_runs(path: Path) -> tuple[str | None, list[Run]]:
    """Name of the suite, or `None` for a scene, and the runs of a scene or suite file.

    Raises `InputError`, also if two traces or recordings of a suite have the same name.
    """
    document = load(path)
    if not isinstance(document, Suite):
        return None, [Run(document.name, document, path)]
    runs: list[Run] = []
    taken: set[str] = set()
    for index, entry in enumerate(document.scenes):
        scene_path = Path(os.path.normpath(path.parent / entry.scene))
        if not scene_path.is_file():
            raise InputError(f"{path}: scenes[{index}].scene: expected a scene's file, found no file '{entry.scene}'")
        scene = load(scene_path)
        if isinstance(scene, Suite):
            raise InputError(f"{path}: scenes[{index}].scene: expected a scene's file, found the suite '{entry.scene}'")
        seeds = entry.seeds or (scene.seed,)
        for seed in seeds:
            name = scene.name if entry.seeds is None else f"{scene.name}_{seed:02d}"
            for made in scene.names(name):
                if made in taken:
                    raise InputError(f"{path}: scenes[{index}]: expected traces of different names, found '{made}' twice")
                taken.add(made)
            runs.append(Run(name, msgspec.structs.replace(scene, seed=seed), scene_path))
    return document.name, runs


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
