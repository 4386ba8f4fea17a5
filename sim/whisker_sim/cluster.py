"""Work on the machines of a Dask cluster, whose workers share the client's folders.

Dask does a task again whose worker it takes for dead, and that worker may go on. So a task that simulates writes into a folder of
its own, from which the client alone takes files in; and a share of an evaluation leaves files that say the same whoever wrote them.
Nothing is lost, counted twice or seen half-written.
"""

import ctypes
import hashlib
import logging
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed, get_worker

from whisker_sim.chores import FAILED, GOOD, WRONG_INPUT, Chore, Crew, Outcome, progress
from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.runs import Run
from whisker_sim.trace import generator

_ANSWER_S = 10
"""A scheduler that is there answers within this time."""
_SHARES_A_THREAD = 4
"""Shares of an evaluation for each thread of the workers: few wait long for the last, and little is lost with a worker."""

# MuJoCo's warnings are gathered by process: the threads of a worker take turns.
_turn = Lock()


def crew(address: str) -> Crew:
    """The workers of the scheduler at `address`, as a crew."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, chore: Chore, waiting: list[tuple[Path, Run]]) -> Iterator[Outcome]:
    # The working directory of a worker is another one.
    waiting = [(folder.resolve(), run) for folder, run in waiting]
    with _part_folders({folder for folder, _ in waiting}) as parts, _connected(address) as client:
        made_by = _generator()
        tasks = {
            client.submit(_task(_make_apart, made_by, chore.make, parts[folder], run), pure=False): (folder, run)
            for folder, run in waiting
        }
        for future in as_completed(list(tasks), loop=client.loop):
            folder, run = tasks.pop(future)
            try:
                outcome, part = _result(future)
            except KilledWorker as killed:
                yield Outcome(FAILED, f"error: {run.path}: {run.name}: {killed.allowed_failures + 1} workers died over it")
                continue
            if outcome.code == GOOD:
                _take_in(part, folder, f"{chore.name(run)}.json")
            yield outcome


def _make_apart(made_by: str, make: Callable[[Path, Run], Outcome], parts: Path, run: Run) -> tuple[Outcome, Path]:
    """On a worker: makes what is wanted of `run` in a folder of its own below `parts`; gives that folder too."""
    _admit(made_by, _generator(), parts)
    with _turn, tempfile.TemporaryDirectory(dir=get_worker().local_directory) as own:
        outcome = make(Path(own), run)
        # Where the client has long done without this worker, its folder is gone and nothing is left behind.
        part = Path(tempfile.mkdtemp(dir=parts))
        shutil.copytree(own, part, dirs_exist_ok=True)
    return outcome, part


def _generator() -> str:
    """All but the scene that determines the bytes of a trace."""
    made_by = generator()
    return (
        f"whisker_sim {made_by.version} (commit {made_by.git_commit}, sources {made_by.source_sha256}), "
        f"MuJoCo {made_by.mujoco}, NumPy {version('numpy')}"
    )


def _take_in(part: Path, folder: Path, last: str) -> None:
    """Moves the files of `part` to `folder`, the one that says that all is there as the last."""
    # Whatever describes files must not stand beside others: a recording has a sidecar a whisker, and one of its own.
    paths = sorted(part.iterdir(), key=lambda path: (path.name == last, path.suffix == ".json"))
    for path in paths:
        if path.suffix == ".json":
            (folder / path.name).unlink(missing_ok=True)
    for path in paths:
        path.replace(folder / path.name)


def evaluate(address: str, program: Path, shares: int | None, arguments: list[str]) -> int:
    """Has workers do the shares of `whisker evaluate` with these arguments, and puts the run together here; gives the exit code."""
    expected, here = _program(program), Path.cwd()
    command = [str(program), "evaluate", *arguments]
    with _part_folders([here]) as parts, _connected(address) as client:
        shares = shares or _SHARES_A_THREAD * sum(client.nthreads().values())
        tasks = {
            client.submit(_task(_do_share, expected, command, share, parts[here]), pure=False): share
            for share in (f"{number}/{shares}" for number in range(1, shares + 1))
        }
        with progress("evaluate", "share", shares) as report:
            for future in as_completed(list(tasks), loop=client.loop):
                share = tasks.pop(future)
                try:
                    _result(future)
                except KilledWorker as killed:
                    raise WhiskerSimError(f"share {share}: {killed.allowed_failures + 1} workers died over it") from None
                report(Outcome(GOOD, f"share {share}: done"))
    code = subprocess.run(command).returncode
    return code if code >= 0 else FAILED


def _do_share(expected: str, command: list[str], share: str, parts: Path) -> None:
    """On a worker: does a share of an evaluation, in the client's working directory."""
    _admit(expected, _program(Path(command[0])), parts)
    done = subprocess.run(
        [*command, "--share", share],
        cwd=parts.parent,
        # A task has one of the worker's threads.
        env=os.environ | {"RAYON_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        preexec_fn=_die_with_worker if sys.platform == "linux" else None,
    )
    if done.returncode != GOOD:
        said = done.stderr.partition("error: ")[2].partition("\n")[0] or f"whisker ended with {done.returncode}"
        raise (InputError if done.returncode == WRONG_INPUT else WhiskerSimError)(said)


def _program(path: Path) -> str:
    """What determines the bytes of results, beside the inputs; raises `InputError` where there is no such program."""
    try:
        return f"{path} with the SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
    except OSError as error:
        raise InputError(f"--whisker {path}: expected the program whisker, found none: {error.strerror}") from None


def _die_with_worker() -> None:
    """Has the kernel end a child when the worker is killed, which would else go on for nobody."""
    set_parent_death_signal = 1
    ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)


def _admit(expected: str, found: str, parts: Path) -> None:
    """Raises `WhiskerSimError` on a worker that would make other bytes than the client, or does not share its folders."""
    worker = get_worker().address
    if found != expected:
        raise WhiskerSimError(f"worker {worker}: expected what the client has, {expected}; found {found}")
    if not parts.is_dir():
        raise WhiskerSimError(f"worker {worker}: expected the client's folder {parts.parent}, found none; they must share it")


@contextmanager
def _part_folders(folders: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Makes a hidden folder in each of `folders`, by which workers know it for the client's, and removes it at its end."""
    parts = {folder: folder / ".parts" for folder in folders}

    def remove() -> None:
        for part in parts.values():
            shutil.rmtree(part, ignore_errors=True)

    remove()
    for part in parts.values():
        part.mkdir(parents=True, exist_ok=True)
    try:
        yield parts
    finally:
        remove()


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """A client of the scheduler at `address`, which has a worker; raises `WhiskerSimError` where none answers."""
    # What goes wrong becomes one line for people.
    logging.disable(logging.CRITICAL)
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise WhiskerSimError(
            f"--scheduler {address}: expected the address of a Dask scheduler, found none there: {error}"
        ) from None
    with client:
        if not client.nthreads():
            print("waiting for workers", file=sys.stderr, flush=True)
            client.wait_for_workers(1)
        yield client


def _task(function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    """A call as a task. What a worker lacks for it fails the task; Dask by itself would end the worker as it reads the call."""
    packed = pickle.dumps((function, arguments))

    def task() -> Any:
        function, arguments = pickle.loads(packed)
        return function(*arguments)

    return task


def _result(future: Future) -> Any:
    """What a task gave; raises `KilledWorker`, or what ends the whole work as an error for people."""
    try:
        return future.result()
    except (KilledWorker, WhiskerSimError, OSError):
        raise
    except CancelledError:
        raise WhiskerSimError("the scheduler is gone; what is finished is kept") from None
    except Exception as error:
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise WhiskerSimError(f"a worker failed; it needs the packages and the PYTHONPATH that the client has: {said}") from None
