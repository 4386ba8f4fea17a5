"""The command line: `simulate`, `cluster`, `render`, `view`, `export`, `check` and `list`.

Exit codes: 0 good, 1 failed, 2 wrong use or input, 3 finished with some traces failed, 130 interrupted.
"""

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType, UnionType

import msgspec

from whisker_sim import __version__
from whisker_sim.arm.passage import Pass, Passage
from whisker_sim.arm.scene import ArmScene
from whisker_sim.chores import FAILED, GOOD, INTERRUPTED, WRONG_INPUT, Chore, Crew, Outcome, do, interrupts_wait, processes
from whisker_sim.documents import located
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.free_object import FreeObject
from whisker_sim.motions import AnyMotion
from whisker_sim.runs import Run, load_runs, with_simulation
from whisker_sim.scene import SIMULATIONS
from whisker_sim.shapes import AnyShape
from whisker_sim.whisker import PRESETS

_REPOSITORY = Path(__file__).resolve().parents[2]
_DATASETS = _REPOSITORY / "datasets"
_WHISKER = _REPOSITORY / "target/release/whisker"


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; gives the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: options.command(options), "interrupted; what is finished is kept")


def exit_code(command: Callable[[], int], interrupted: str) -> int:
    """Runs a command and gives its exit code; what goes wrong becomes one line on stderr and a code of its own."""
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
    except BrokenPipeError:
        # The reader of stdout has seen enough; what is left in the buffer goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return GOOD
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print(interrupted, file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whisker_sim", description="Whisker sweeps in MuJoCo, with ground truth.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    command = commands.add_parser("simulate", help="simulate scenes and suites and write traces")
    _add_what_to_simulate(command)
    add_jobs(command)
    command.add_argument(
        "--share",
        type=_share,
        default=(1, 1),
        metavar="K/N",
        help="make only one of N equal shares of the traces, K from 1 to N, while other processes make the others",
    )
    command.set_defaults(command=_simulate)

    cluster = commands.add_parser("cluster", help="simulate or evaluate on the machines of a Dask cluster")
    on_cluster = cluster.add_subparsers(required=True, metavar="COMMAND")
    command = on_cluster.add_parser("simulate", help="simulate scenes and suites and write traces")
    _add_scheduler(command)
    _add_what_to_simulate(command)
    command.set_defaults(command=_simulate_on_cluster)
    command = on_cluster.add_parser("evaluate", help="score estimators on traces (`whisker evaluate`)")
    _add_scheduler(command)
    command.add_argument("--whisker", type=Path, default=_WHISKER, metavar="PROGRAM", help=f"default: {_WHISKER}")
    command.add_argument("--shares", type=_positive, metavar="N", help="shares of the work (default: some a thread of the workers)")
    command.add_argument("arguments", nargs=argparse.REMAINDER, help="those of `whisker evaluate`")
    command.set_defaults(command=_evaluate_on_cluster)

    command = commands.add_parser("render", help="draw sweeps from above, of a scene or of each group and whisker of a suite")
    command.add_argument("file", type=Path, metavar="SCENE_OR_SUITE")
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE_OR_DIR",
        help="of a scene: .png a picture, .gif or .webp the whole sweep; of a suite: the folder of its pictures",
    )
    add_jobs(command)
    command.add_argument("--force", action="store_true", help="draw pictures of a suite that are up to date as well")
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

    command = commands.add_parser(
        "list", help="list whiskers, settings of the simulation, shapes and motions with their parameters"
    )
    command.set_defaults(command=_list)
    return parser


def _add_what_to_simulate(command: argparse.ArgumentParser) -> None:
    command.add_argument("files", nargs="+", type=Path, metavar="SCENE_OR_SUITE")
    command.add_argument("--out", type=Path, metavar="DIR", help="folder of the traces (default: datasets/<suite>)")
    command.add_argument(
        "--simulation",
        choices=SIMULATIONS,
        metavar="NAME",
        help=f"settings of the simulation, for every scene: {', '.join(SIMULATIONS)} (default: each scene's own); "
        "the traces of a suite then go to datasets/<suite>_<name>",
    )
    command.add_argument("--force", action="store_true", help="simulate traces that are up to date as well")


def _add_scheduler(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scheduler", required=True, metavar="ADDRESS", help="of the Dask scheduler, such as tcp://127.0.0.1:8786"
    )


def add_jobs(command: argparse.ArgumentParser) -> None:
    """Adds the option `--jobs`."""
    command.add_argument(
        "--jobs", type=_positive, default=os.cpu_count(), metavar="N", help="worker processes (default: one a core)"
    )


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a number above zero, found '{text}'")
    return int(text)


def _share(text: str) -> tuple[int, int]:
    numbers = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    if not numbers or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise argparse.ArgumentTypeError(f"expected K/N with K from 1 to N, such as 3/16, found '{text}'")
    return int(numbers[1]), int(numbers[2])


def _simulate(options: argparse.Namespace) -> int:
    return _make_traces(options, processes(options.jobs), options.share)


def _simulate_on_cluster(options: argparse.Namespace) -> int:
    return _make_traces(options, _cluster().crew(options.scheduler))


def _evaluate_on_cluster(options: argparse.Namespace) -> int:
    return _cluster().evaluate(options.scheduler, options.whisker.resolve(), options.shares, options.arguments)


def _cluster() -> ModuleType:
    """What works on clusters, and needs packages that nothing else does."""
    try:
        with interrupts_wait():
            from whisker_sim import cluster
    except ModuleNotFoundError as error:
        raise WhiskerSimError(
            f"expected the package '{error.name}', found none: pip install --requirement sim/requirements-cluster.lock"
        ) from None
    return cluster


def _make_traces(options: argparse.Namespace, crew: Crew, share: tuple[int, int] = (1, 1)) -> int:
    waiting: list[tuple[Path, Run]] = []
    for file in options.files:
        suite, runs = load_runs(file)
        if options.out is None and suite is None:
            raise InputError(f"{file}: a scene needs --out DIR; only a suite has a folder of its own")
        if options.simulation is None:
            waiting += [(options.out or _DATASETS / suite, run) for run in runs]
            continue
        _, simulation = SIMULATIONS[options.simulation]
        for run in runs:
            run, folder = with_simulation(run, simulation), options.out or _DATASETS / f"{suite}_{options.simulation}"
            if not options.force:
                _keep_other_settings(folder, run)
            waiting.append((folder, run))
    targets = [(folder / name, run) for folder, run in waiting for name in run.scene.names(run.name)]
    count = Counter(target for target, _ in targets)
    for target, run in targets:
        if count[target] > 1:
            raise InputError(f"{run.path}: expected traces of different names, found '{target.name}' {count[target]} times")

    # An interrupt that comes while MuJoCo loads would be lost, or pass for a failure of the library.
    with interrupts_wait():
        from whisker_sim.products import product_of

    def is_up_to_date(folder: Path, run: Run) -> bool:
        return product_of(run).is_up_to_date(folder, run)

    chore = Chore("simulate", "trace", lambda run: run.name, is_up_to_date, make_trace)
    number, shares = share
    return do(chore, waiting[number - 1 :: shares], crew, options.force)


def _keep_other_settings(folder: Path, run: Run) -> None:
    """Raises `InputError` where `folder` holds the trace of `run` with other settings, finer ones perhaps."""
    path = folder / f"{run.name}.json"
    try:
        kept = msgspec.json.decode(path.read_bytes())["scene"]["simulation"]
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return
    if kept != msgspec.to_builtins(run.scene.simulation):
        raise InputError(
            f"{path}: expected a trace with {_values(run.scene.simulation)} or none, found one with "
            f"{', '.join(f'{key} {value:g}' for key, value in kept.items())}; "
            "another --out DIR keeps both, --force replaces it"
        )


def make_trace(folder: Path, run: Run) -> Outcome:
    """Simulates `run` and writes what comes of it into `folder`."""
    # MuJoCo takes a moment to load, which commands that only look at files need not wait for.
    from whisker_sim.products import product_of

    return _outcome(run, lambda: product_of(run).make(folder, run))


def make_pictures(folder: Path, run: Run) -> Outcome:
    """Simulates `run` and draws it into `folder` for its group and whisker."""
    from whisker_sim.products import product_of
    from whisker_sim.render import render_set, set_name

    def work() -> str:
        render_set(folder, run, product_of(run).draw)
        return f"{set_name(run)}: drawn from {run.name}"

    return _outcome(run, work)


def _outcome(run: Run, work: Callable[[], str]) -> Outcome:
    """Does the work on `run`; its line for people, or what went wrong."""
    try:
        return Outcome(GOOD, work())
    except InputError as error:
        return Outcome(WRONG_INPUT, f"error: {error}")
    except WhiskerSimError as error:
        return Outcome(FAILED, f"error: {run.path}: {run.name}: {error}")


def _render(options: argparse.Namespace) -> int:
    with interrupts_wait():
        from whisker_sim.products import product_of
        from whisker_sim.render import first_of_each_set, is_rendered, render, set_name

    suite, runs = load_runs(options.file)
    if suite is None:
        render(runs[0], options.out, product_of(runs[0]).draw)
        print(options.out)
        return GOOD

    def is_up_to_date(folder: Path, run: Run) -> bool:
        return is_rendered(folder, run, product_of(run).draw)

    chore = Chore("render", "animation", set_name, is_up_to_date, make_pictures)
    return do(chore, [(options.out, run) for run in first_of_each_set(runs)], processes(options.jobs), options.force)


def _view(options: argparse.Namespace) -> int:
    from whisker_sim.products import product_of
    from whisker_sim.render import view

    run = _one_scene(options.scene)
    view(run, product_of(run).replay)
    return GOOD


def _export(options: argparse.Namespace) -> int:
    from whisker_sim.export import export
    from whisker_sim.products import product_of

    run = _one_scene(options.scene)
    export(run, options.out, product_of(run).start)
    print(options.out)
    return GOOD


def _one_scene(path: Path) -> Run:
    suite, runs = load_runs(path)
    if suite is not None:
        raise InputError(f"{path}: expected a scene, found a suite")
    return runs[0]


def _check(options: argparse.Namespace) -> int:
    for file in options.files:
        suite, runs = load_runs(file)
        for run in runs:
            try:
                run.scene.plan()
            except ValueError as error:
                raise located(run.path, str(error)) from None
        print(f"{file}: good, {'scene' if suite is None else f'suite of {len(runs)} traces'}")
    return GOOD


def _list(_: argparse.Namespace) -> int:
    for title, presets in (("whiskers", PRESETS), ("simulations", SIMULATIONS)):
        print(title)
        for name, (about, values) in presets.items():
            print(f"  {name:<18}{about}")
            print(f"  {'':<18}{_values(values)}")
    with_an_arm = {"scene": ArmScene, "object": FreeObject, "path": Passage, "pass": Pass}
    for title, rows in (("shapes", _by_tag(AnyShape)), ("motions", _by_tag(AnyMotion)), ("scenes with an arm", with_an_arm)):
        print(title)
        for name, row in rows.items():
            print(f"  {name:<18}{row.__doc__.splitlines()[0].removesuffix('.')}")
            print(f"  {'':<18}{_parameters(row)}")
    return GOOD


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
