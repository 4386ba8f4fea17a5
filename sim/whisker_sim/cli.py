"""The command line: `simulate`, `render`, `view`, `export`, `check` and `list`.

Exit codes: 0 good, 1 failed, 2 wrong use or input, 3 finished with some traces failed, 130 interrupted.
"""

import argparse
import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from types import UnionType
from typing import NamedTuple

import msgspec

from whisker_sim import __version__
from whisker_sim.arm.passage import Pass, Passage
from whisker_sim.arm.scene import ArmScene
from whisker_sim.documents import located
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.free_object import FreeObject
from whisker_sim.motions import AnyMotion
from whisker_sim.runs import Run, load_runs, with_simulation
from whisker_sim.scene import SIMULATIONS
from whisker_sim.shapes import AnyShape
from whisker_sim.whisker import PRESETS

GOOD, FAILED, WRONG_INPUT, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

_DATASETS = Path(__file__).resolve().parents[2] / "datasets"


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
    command.add_argument("files", nargs="+", type=Path, metavar="SCENE_OR_SUITE")
    command.add_argument("--out", type=Path, metavar="DIR", help="folder of the traces (default: datasets/<suite>)")
    add_jobs(command)
    command.add_argument(
        "--simulation",
        choices=SIMULATIONS,
        metavar="NAME",
        help=f"settings of the simulation, for every scene: {', '.join(SIMULATIONS)} (default: each scene's own); "
        "the traces of a suite then go to datasets/<suite>_<name>",
    )
    command.add_argument("--force", action="store_true", help="simulate traces that are up to date as well")
    command.set_defaults(command=_simulate)

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


def add_jobs(command: argparse.ArgumentParser) -> None:
    """Adds the option `--jobs`."""
    command.add_argument(
        "--jobs", type=_positive, default=os.cpu_count(), metavar="N", help="worker processes (default: one a core)"
    )


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a number above zero, found '{text}'")
    return int(text)


def _simulate(options: argparse.Namespace) -> int:
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
    with _interrupts_wait():
        from whisker_sim.products import product_of

    def is_up_to_date(folder: Path, run: Run) -> bool:
        return product_of(run).is_up_to_date(folder, run)

    chore = Chore("simulate", "trace", lambda run: run.name, is_up_to_date, make_trace)
    return _do(chore, waiting, options.jobs, options.force)


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


class Outcome(NamedTuple):
    """What became of one item of a chore: an exit code, and one line for people."""

    code: int
    line: str


class Chore(NamedTuple):
    """Something to be made in a folder for each of many runs."""

    verb: str
    noun: str
    """What is made, in the singular."""
    name: Callable[[Run], str]
    """Under which its files go, without their endings."""
    is_up_to_date: Callable[[Path, Run], bool]
    make: Callable[[Path, Run], Outcome]
    """A function of this module, which worker processes can find."""


def _do(chore: Chore, waiting: list[tuple[Path, Run]], jobs: int, force: bool) -> int:
    """Does a chore for all that wait, in worker processes; gives the exit code."""
    failed = []
    with _progress(chore, len(waiting)) as report:
        for outcome in _outcomes(chore, waiting, jobs, force):
            report(outcome)
            failed += [outcome.code] if outcome.code != GOOD else []
    if 0 < len(failed) < len(waiting):
        print(f"{len(failed)} of {len(waiting)} {chore.noun}s failed", file=sys.stderr)
        return SOME_FAILED
    return max(failed, default=GOOD)


def _outcomes(chore: Chore, waiting: list[tuple[Path, Run]], jobs: int, force: bool) -> Iterator[Outcome]:
    """Makes what is not up to date; yields the outcome of each, as they finish."""
    from whisker_sim.trace import remove_leftovers

    for folder, run in waiting:
        remove_leftovers(folder, chore.name(run))
    if not force:
        fresh = [(folder, run) for folder, run in waiting if chore.is_up_to_date(folder, run)]
        yield from (Outcome(GOOD, f"{chore.name(run)}: up to date") for _, run in fresh)
        waiting = [item for item in waiting if item not in fresh]
    jobs = min(jobs, len(waiting))
    if jobs <= 1:
        yield from (chore.make(folder, run) for folder, run in waiting)
        return
    # No more than one item a worker is handed out, so that an interruption waits for those and no others.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_outlive_nobody) as executor:
        rest = iter(waiting)
        running = _submit(executor, chore, islice(rest, jobs))
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= _submit(executor, chore, islice(rest, len(done)))
            try:
                yield from (future.result() for future in done)
            except BrokenProcessPool:
                raise WhiskerSimError("a worker process died, for lack of memory perhaps; fewer --jobs may help") from None


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


def _submit(executor: ProcessPoolExecutor, chore: Chore, items: Iterable[tuple[Path, Run]]) -> set[Future[Outcome]]:
    """Hands out items to workers; they start here, where there are too few.

    They never hear an interrupt, and finish the items they are making; the main process does, and hands out no more.
    """
    with _interrupts_wait():
        return {executor.submit(chore.make, folder, run) for folder, run in items}


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Puts interrupts off until its end; the processes that start within it never hear one."""
    late: list[int] = []
    # A blocked signal alone does not wait: a library's thread that does not block it would take it for the whole process.
    heard = signal.signal(signal.SIGINT, lambda number, _: late.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, heard)
        if late:
            signal.raise_signal(signal.SIGINT)


def _outlive_nobody() -> None:
    """Ends a worker when the main process is killed: it would wait for work for ever."""
    main_process = multiprocessing.parent_process()

    def follow() -> None:
        main_process.join()
        os._exit(FAILED)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def _progress(chore: Chore, total: int) -> Iterator[Callable[[Outcome], None]]:
    """Gives a function that reports one finished item: a bar on a terminal, a line elsewhere; errors always as a line."""
    if not sys.stderr.isatty():
        yield lambda outcome: print(outcome.line, file=sys.stderr, flush=True)
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=chore.noun, desc=chore.verb, dynamic_ncols=True) as bar:

        def report(outcome: Outcome) -> None:
            if outcome.code != GOOD:
                bar.write(outcome.line, file=sys.stderr)
            bar.update()

        yield report


def _render(options: argparse.Namespace) -> int:
    with _interrupts_wait():
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
    return _do(chore, [(options.out, run) for run in first_of_each_set(runs)], options.jobs, options.force)


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
