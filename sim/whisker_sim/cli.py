"""The command line: `simulate`, `render`, `view`, `check` and `list`.

Exit codes: 0 good, 1 failed, 2 wrong use or input, 3 finished with some traces failed, 130 interrupted.
"""

import argparse
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import msgspec

from whisker_sim import __version__
from whisker_sim.documents import located
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.motions import AnyMotion
from whisker_sim.scene import Run, load_runs
from whisker_sim.shapes import AnyShape
from whisker_sim.whisker import PRESETS

GOOD, FAILED, WRONG_INPUT, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

_DATASETS = Path(__file__).resolve().parents[2] / "datasets"


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; gives the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: options.command(options), "interrupted; finished traces are kept")


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
    command.add_argument(
        "--jobs", type=_positive, default=os.cpu_count(), metavar="N", help="worker processes (default: one a core)"
    )
    command.add_argument("--force", action="store_true", help="simulate traces that are up to date as well")
    command.set_defaults(command=_simulate)

    command = commands.add_parser("render", help="draw a scene from above: .png a picture, .gif or .webp the whole sweep")
    command.add_argument("scene", type=Path, metavar="SCENE")
    command.add_argument("--out", type=Path, required=True, metavar="FILE")
    command.set_defaults(command=_render)

    command = commands.add_parser("view", help="open a scene in MuJoCo's viewer")
    command.add_argument("scene", type=Path, metavar="SCENE")
    command.set_defaults(command=_view)

    command = commands.add_parser("check", help="check scene and suite files")
    command.add_argument("files", nargs="+", type=Path, metavar="FILE")
    command.set_defaults(command=_check)

    command = commands.add_parser("list", help="list whiskers, shapes and motions with their parameters")
    command.set_defaults(command=_list)
    return parser


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
        waiting += [(options.out or _DATASETS / suite, run) for run in runs]
    targets = [folder / run.name for folder, run in waiting]
    for (_, run), target in zip(waiting, targets, strict=True):
        if targets.count(target) > 1:
            raise InputError(f"{run.path}: expected traces of different names, found '{run.name}' {targets.count(target)} times")

    failed = []
    with _progress(len(waiting)) as report:
        for outcome in _outcomes(waiting, options.jobs, options.force):
            report(outcome)
            failed += [outcome.code] if outcome.code != GOOD else []
    if 0 < len(failed) < len(waiting):
        print(f"{len(failed)} of {len(waiting)} traces failed", file=sys.stderr)
        return SOME_FAILED
    return max(failed, default=GOOD)


class Outcome(NamedTuple):
    """What became of one trace: an exit code, and one line for people."""

    code: int
    line: str


def _outcomes(waiting: list[tuple[Path, Run]], jobs: int, force: bool) -> Iterator[Outcome]:
    """Makes the traces that are not up to date; yields the outcome of each, as they finish."""
    if not force:
        from whisker_sim.trace import is_up_to_date

        fresh = [(folder, run) for folder, run in waiting if is_up_to_date(folder, run)]
        yield from (Outcome(GOOD, f"{run.name}: up to date") for _, run in fresh)
        waiting = [item for item in waiting if item not in fresh]
    jobs = min(jobs, len(waiting))
    if jobs <= 1:
        yield from (make_trace(folder, run) for folder, run in waiting)
        return
    # No more than one trace a worker is handed out, so that an interruption waits for those and no others.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_ignore_interrupts) as executor:
        rest = iter(waiting)
        running = {executor.submit(make_trace, folder, run) for folder, run in islice(rest, jobs)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {executor.submit(make_trace, folder, run) for folder, run in islice(rest, len(done))}
            try:
                yield from (future.result() for future in done)
            except BrokenProcessPool:
                raise WhiskerSimError("a worker process died, for lack of memory perhaps; fewer --jobs may help") from None


def make_trace(folder: Path, run: Run) -> Outcome:
    """Simulates `run` and writes its trace into `folder`."""
    # MuJoCo takes a moment to load, which commands that only look at files need not wait for.
    from whisker_sim.simulate import simulate
    from whisker_sim.trace import write_trace

    try:
        simulated = simulate(run)
        write_trace(folder, run, simulated)
    except InputError as error:
        return Outcome(WRONG_INPUT, f"error: {error}")
    except WhiskerSimError as error:
        return Outcome(FAILED, f"error: {run.path}: {run.name}: {error}")
    share = simulated.touching.mean()
    return Outcome(GOOD, f"{run.name}: {simulated.time_s[-1]:.1f} s, {100 * share:.0f} % in contact")


def _ignore_interrupts() -> None:
    """Lets a worker finish the trace it is writing; the main process hands out no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _progress(total: int) -> Iterator[Callable[[Outcome], None]]:
    """Gives a function that reports one finished trace: a bar on a terminal, a line elsewhere; errors always as a line."""
    if not sys.stderr.isatty():
        yield lambda outcome: print(outcome.line, file=sys.stderr, flush=True)
        return
    from tqdm import tqdm

    with tqdm(total=total, unit="trace", desc="simulate", dynamic_ncols=True) as bar:

        def report(outcome: Outcome) -> None:
            if outcome.code != GOOD:
                bar.write(outcome.line, file=sys.stderr)
            bar.update()

        yield report


def _render(options: argparse.Namespace) -> int:
    from whisker_sim.render import render

    render(_one_scene(options.scene), options.out)
    print(options.out)
    return GOOD


def _view(options: argparse.Namespace) -> int:
    from whisker_sim.render import view

    view(_one_scene(options.scene))
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
                run.scene.motion.plan(run.scene.stage())
            except ValueError as error:
                raise located(run.path, str(error)) from None
        print(f"{file}: good, {'scene' if suite is None else f'suite of {len(runs)} traces'}")
    return GOOD


def _list(_: argparse.Namespace) -> int:
    print("whiskers")
    for name, (about, whisker) in PRESETS.items():
        print(f"  {name:<18}{about}")
        print(f"  {'':<18}{_values(whisker)}")
    for title, registry in (("shapes", AnyShape), ("motions", AnyMotion)):
        print(title)
        for row in registry.__args__:
            print(f"  {row.__struct_config__.tag:<18}{row.__doc__.splitlines()[0].removesuffix('.')}")
            print(f"  {'':<18}{_parameters(row)}")
    return GOOD


def _values(struct: msgspec.Struct) -> str:
    pairs = ((key, value) for key, value in msgspec.to_builtins(struct).items() if isinstance(value, float | int))
    return ", ".join(f"{key} {value:g}" for key, value in pairs)


def _parameters(struct: type[msgspec.Struct]) -> str:
    def show(field: msgspec.structs.FieldInfo) -> str:
        return field.encode_name if field.required else f"{field.encode_name} ({field.default})"

    return ", ".join(_required_first(map(show, msgspec.structs.fields(struct))))


def _required_first(shown: Iterable[str]) -> list[str]:
    return sorted(shown, key=lambda text: text.endswith(")"))
