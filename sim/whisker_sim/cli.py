"""Command line: `simulate`, `cluster`, `render`, `view`, `export`, `check`, `list` and `schema`.

Exit codes: 0 success, 1 failure, 2 wrong usage or input, 3 finished but some traces failed, 130 interrupted.
"""

import argparse
import json
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType, UnionType

import msgspec

from whisker_sim import __version__
from whisker_sim.arm.passage import Pass, Passage
from whisker_sim.arm.scene import ArmScene
from whisker_sim.documents import located
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.free_object import FreeObject
from whisker_sim.jobs import (
    FAILED,
    INTERRUPTED,
    SUCCESS,
    WRONG_INPUT,
    Executor,
    deferred_interrupts,
    process_executor,
    run_job,
)
from whisker_sim.lock import exclusive
from whisker_sim.motions import AnyMotion
from whisker_sim.paths import DATASETS, whisker_program
from whisker_sim.progress import Progress
from whisker_sim.runs import Redrawn, Run, check_plan, first_of_each_set, load_runs, set_name, with_simulation
from whisker_sim.scene import LARGEST_SEED, SIMULATIONS
from whisker_sim.schema import scene_schema
from whisker_sim.shapes import AnyShape
from whisker_sim.space.motions import AnySpatialMotion
from whisker_sim.space.solids import AnySolid
from whisker_sim.startup import missing_package
from whisker_sim.whisker import PRESETS


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: options.command(options), "interrupted; finished files are kept")


def exit_code(command: Callable[[], int], interrupted: str) -> int:
    """Runs a command and returns its exit code; an error is printed as one line on stderr."""
    try:
        code = command()
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except WhiskerSimError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except ModuleNotFoundError as error:
        print(f"error: {missing_package(error)}", file=sys.stderr)
        return FAILED
    except BrokenPipeError:
        # The reader of stdout has closed it; the rest of the buffer is discarded.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print(interrupted, file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whisker-sim", description="Simulate whisker sweeps in MuJoCo, with ground truth.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    command = commands.add_parser("simulate", help="simulate scenes and suites and write traces")
    _add_simulation_options(command)
    add_jobs(command)
    command.add_argument(
        "--animations",
        type=Path,
        metavar="DIR",
        help="also draw each group and whisker of a suite, as `whisker-sim render` does, into DIR",
    )
    command.add_argument(
        "--share",
        type=_share,
        default=(1, 1),
        metavar="K/N",
        help="make only share K of N equal shares of the traces (K from 1 to N); other processes make the others",
    )
    command.set_defaults(command=_simulate)

    _add_cluster_commands(commands)

    command = commands.add_parser("render", help="draw sweeps from above: a scene, or each group and whisker of a suite")
    command.add_argument("file", type=Path, metavar="SCENE_OR_SUITE")
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE_OR_DIR",
        help="for a scene a .png still, or a .gif or .webp animation of the whole sweep; for a suite the folder of its animations",
    )
    add_jobs(command)
    command.add_argument("--force", action="store_true", help="draw up-to-date animations of a suite again")
    command.set_defaults(command=_render)

    command = commands.add_parser("view", help="open a scene in MuJoCo's viewer")
    command.add_argument("scene", type=Path, metavar="SCENE")
    command.set_defaults(command=_view)

    command = commands.add_parser("export", help="write a scene as MJCF, for MuJoCo's own viewer")
    command.add_argument("scene", type=Path, metavar="SCENE")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.xml")
    command.set_defaults(command=_export)

    command = commands.add_parser("check", help="check scene and suite files")
    command.add_argument("files", nargs="+", type=Path, metavar="FILE")
    command.set_defaults(command=_check)

    command = commands.add_parser("list", help="list whiskers, simulation settings, shapes and motions with their parameters")
    command.set_defaults(command=_list)

    command = commands.add_parser("schema", help="print the JSON Schema of scene files, with the default of every key")
    command.set_defaults(command=_schema)
    return parser


def _add_cluster_commands(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    cluster = commands.add_parser("cluster", help="simulate or evaluate on the machines of a Dask cluster")
    on_cluster = cluster.add_subparsers(required=True, metavar="COMMAND")
    command = on_cluster.add_parser("simulate", help="simulate scenes and suites and write traces")
    _add_scheduler(command)
    _add_simulation_options(command)
    command.set_defaults(command=_simulate_on_cluster)
    command = on_cluster.add_parser("evaluate", help="score estimators on traces (`whisker evaluate`)")
    _add_scheduler(command)
    command.add_argument(
        "--whisker",
        type=Path,
        metavar="PROGRAM",
        help="program `whisker` (default: that of the variable WHISKER, else of the repository's release build, else on the PATH)",
    )
    command.add_argument("--shares", type=_positive, metavar="N", help="number of shares (default: four per thread of the workers)")
    command.add_argument("arguments", nargs=argparse.REMAINDER, help="arguments of `whisker evaluate`")
    command.set_defaults(command=_evaluate_on_cluster)


def _add_simulation_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("files", nargs="+", type=Path, metavar="SCENE_OR_SUITE", help="scene or suite (JSON)")
    command.add_argument("--out", type=Path, metavar="DIR", help="folder of the traces (default: datasets/<suite>)")
    command.add_argument(
        "--simulation",
        choices=SIMULATIONS,
        metavar="NAME",
        help=f"simulation settings of every scene: {', '.join(SIMULATIONS)} (default: those of each scene); "
        "the default folder of a suite is then datasets/<suite>_<name>",
    )
    command.add_argument("--force", action="store_true", help="simulate up-to-date traces again")
    command.add_argument(
        "--seed",
        type=_seed,
        metavar="S",
        help="seed of a random suite (default: that of its file); the default folder is then datasets/<suite>_<seed>",
    )
    command.add_argument(
        "--count", type=_positive, metavar="N", help="number of sets of a random suite (default: that of its file)"
    )


def _add_scheduler(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scheduler", required=True, metavar="ADDRESS", help="address of the Dask scheduler, such as tcp://127.0.0.1:8786"
    )


def add_jobs(command: argparse.ArgumentParser) -> None:
    """Adds the option `--jobs`."""
    command.add_argument(
        "--jobs", type=_positive, default=os.cpu_count(), metavar="N", help="number of worker processes (default: one per core)"
    )


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a number above zero, found '{text}'")
    return int(text)


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) > LARGEST_SEED:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to {LARGEST_SEED}, found '{text}'")
    return int(text)


def _share(text: str) -> tuple[int, int]:
    numbers = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    if not numbers or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise argparse.ArgumentTypeError(f"expected K/N with K from 1 to N, such as 3/16, found '{text}'")
    return int(numbers[1]), int(numbers[2])


def _simulate(options: argparse.Namespace) -> int:
    return _make_traces(options, process_executor(options.jobs), options.share, options.animations)


def _simulate_on_cluster(options: argparse.Namespace) -> int:
    return _make_traces(options, _cluster().cluster_executor(options.scheduler))


def _evaluate_on_cluster(options: argparse.Namespace) -> int:
    program = (options.whisker or whisker_program()).resolve()
    return _cluster().evaluate(options.scheduler, program, options.shares, options.arguments)


def _cluster() -> ModuleType:
    """The module of the commands for clusters, whose packages are optional."""
    with deferred_interrupts():
        from whisker_sim import cluster
    return cluster


def _make_traces(
    options: argparse.Namespace, executor: Executor, share: tuple[int, int] = (1, 1), animations: Path | None = None
) -> int:
    items: list[tuple[Path, Run]] = []
    drawn: list[Run] = []
    is_redrawn = options.seed is not None or options.count is not None
    redrawn = Redrawn(options.seed, options.count) if is_redrawn else None
    for file in options.files:
        suite, runs = load_runs(file, redrawn)
        if options.out is None and suite is None:
            raise InputError(f"{file}: a scene needs --out DIR; only a suite has a folder of its own")
        if animations is not None and suite is None:
            raise InputError(f"{file}: expected a suite with --animations, found a scene; `render` draws a scene")
        if animations is not None:
            drawn += first_of_each_set(runs)
        if options.simulation is None:
            items += [(options.out or DATASETS / suite, run) for run in runs]
            continue
        _, simulation = SIMULATIONS[options.simulation]
        for run in runs:
            run, folder = with_simulation(run, simulation), options.out or DATASETS / f"{suite}_{options.simulation}"
            if not options.force:
                _check_settings(folder, run)
            items.append((folder, run))
    targets = [(folder / name, run) for folder, run in items for name in run.scene.names(run.name)]
    count = Counter(target for target, _ in targets)
    for target, run in targets:
        if count[target] > 1:
            raise InputError(f"{run.path}: expected traces of different names, found '{target.name}' {count[target]} times")
    pictures = Counter(set_name(run) for run in drawn)
    for run in drawn:
        if pictures[set_name(run)] > 1:
            raise InputError(
                f"{run.path}: expected animations of different names, found '{set_name(run)}' {pictures[set_name(run)]} times; "
                "draw each suite by a command of its own, with another --animations DIR"
            )
    sidecars = [target.with_name(f"{target.name}.json") for target, _ in targets]
    _check_apart(sidecars, [*options.files, *(run.path for _, run in items)])
    # An interrupt while MuJoCo is imported would be lost, or taken for a failure of the library.
    with deferred_interrupts():
        from whisker_sim import products
    number, shares = share
    job = products.trace_job(options.force, animations, frozenset((run.path, run.name) for run in drawn))
    written = {folder for folder, _ in items} | ({animations} if animations else set())
    with ExitStack() as locks:
        # A folder under two names is locked once: the second lock would wait for the first.
        for folder in sorted({folder.resolve(): folder for folder in sorted(written)}.values()):
            locks.enter_context(exclusive(folder, f"{number}-of-{shares}" if shares > 1 else ""))
        own = items[number - 1 :: shares]
        code = run_job(job, own, executor, options.force)
        # A trace that failed may have the sidecar of an earlier scene.
        made = own if code == 0 else [item for item in own if job.is_up_to_date(*item)]
        for note in products.notes_on_accuracy(made):
            print(note, file=sys.stderr)
        return code


def _check_apart(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raises `InputError` if an output is an input, also through links."""
    read = {path.resolve() for path in set(inputs)}
    names = {path.name for path in read}
    for path in outputs:
        if path.name in names and path.resolve() in read:
            raise InputError(f"{path}: is an input, which a trace of that name would replace; choose another --out DIR")


def _check_settings(folder: Path, run: Run) -> None:
    """Raises `InputError` if `folder` holds the trace of `run` with other simulation settings."""
    path = folder / f"{run.name}.json"
    try:
        kept = msgspec.json.decode(path.read_bytes())["scene"]["simulation"]
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return
    if kept != msgspec.to_builtins(run.scene.simulation):
        raise InputError(
            f"{path}: expected a trace with {_values(run.scene.simulation)} or none, found one with "
            f"{', '.join(f'{key} {value:g}' for key, value in kept.items())}; "
            "use another --out DIR to keep both, or --force to replace it"
        )


def _render(options: argparse.Namespace) -> int:
    with deferred_interrupts():
        from whisker_sim import products

    suite, runs = load_runs(options.file)
    if suite is not None:
        items = [(options.out, run) for run in first_of_each_set(runs)]
        return run_job(products.animation_job(), items, process_executor(options.jobs), options.force)
    code = run_job(products.picture_job(options.out), [(options.out.parent, runs[0])], process_executor(1), force=True)
    if code == SUCCESS:
        print(options.out)
    return code


def _view(options: argparse.Namespace) -> int:
    from whisker_sim.products import replayed
    from whisker_sim.render import view

    run = _one_scene(options.scene)
    view(*replayed(run), run.scene.rate_hz)
    return SUCCESS


def _export(options: argparse.Namespace) -> int:
    from whisker_sim.export import export
    from whisker_sim.products import product_of

    run = _one_scene(options.scene)
    if options.out.resolve() == options.scene.resolve():
        raise InputError(f"{options.out}: is the scene itself; choose another --out FILE.xml")
    export(run, options.out, product_of(run).start)
    print(options.out)
    return SUCCESS


def _one_scene(path: Path) -> Run:
    suite, runs = load_runs(path)
    if suite is not None:
        raise InputError(f"{path}: expected a scene, found a suite")
    return runs[0]


def _check(options: argparse.Namespace) -> int:
    files = [(file, *load_runs(file)) for file in options.files]
    with Progress("check", "trace", sum(len(runs) for _, _, runs in files)) as progress:
        for run in (run for _, _, runs in files for run in runs):
            try:
                check_plan(run)
            except ValueError as error:
                raise located(run.path, str(error)) from None
            progress.finish()
    for file, suite, runs in files:
        print(f"{file}: valid, {'scene' if suite is None else f'suite of {len(runs)} runs'}")
    return SUCCESS


def _list(_: argparse.Namespace) -> int:
    presets = {"whiskers": PRESETS, "simulations": SIMULATIONS}
    types = {
        "shapes": _by_tag(AnyShape),
        "motions": _by_tag(AnyMotion),
        "solids of scenes in space": _by_tag(AnySolid),
        "motions in space": _by_tag(AnySpatialMotion),
        "scenes with an arm": {"scene": ArmScene, "object": FreeObject, "path": Passage, "pass": Pass},
    }
    width = max(len(name) for rows in (presets | types).values() for name in rows) + 2
    for title, rows in presets.items():
        print(title)
        for name, (about, values) in rows.items():
            print(f"  {name:<{width}}{about}")
            print(f"  {'':<{width}}{_values(values)}")
    for title, rows in types.items():
        print(title)
        for name, row in rows.items():
            print(f"  {name:<{width}}{row.__doc__.splitlines()[0].removesuffix('.')}")
            print(f"  {'':<{width}}{_parameters(row)}")
    return SUCCESS


def _schema(_: argparse.Namespace) -> int:
    print(json.dumps(scene_schema(), indent=1))
    return SUCCESS


def _by_tag(registry: UnionType) -> dict[str, type[msgspec.Struct]]:
    return {row.__struct_config__.tag: row for row in registry.__args__}


def _values(struct: msgspec.Struct) -> str:
    pairs = ((key, value) for key, value in msgspec.to_builtins(struct).items() if isinstance(value, float | int))
    return ", ".join(f"{key} {value:g}" for key, value in pairs)


def _parameters(struct: type[msgspec.Struct]) -> str:
    def show(field: msgspec.structs.FieldInfo) -> str:
        return field.encode_name if field.required else f"{field.encode_name} ({field.default})"

    return ", ".join(_required_first(map(show, msgspec.structs.fields(struct))))


def _required_first(shown: Iterable[str]) -> list[str]:
    return sorted(shown, key=lambda text: text.endswith(")"))
