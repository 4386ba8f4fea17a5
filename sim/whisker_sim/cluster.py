"""Jobs on the machines of a Dask cluster, whose workers share the client's folders.

If Dask considers a worker dead, it runs the worker's tasks again, and the worker may continue meanwhile. Therefore each simulation
task writes into a folder of its own, from which only the client moves files to their destination; and the files of a share of an
evaluation have the same bytes on every worker. No result is lost, counted twice or visible half-written.
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

import msgspec
from distributed import Client, Future, KilledWorker, as_completed, get_worker

from whisker_sim.errors import InputError, WhiskerSimError
from whisker_sim.jobs import FAILED, SUCCESS, WRONG_INPUT, Executor, Items, Job, Outcome
from whisker_sim.progress import Progress
from whisker_sim.runs import Run
from whisker_sim.trace import generator

_ANSWER_S = 10
"""Timeout of the connection to the scheduler."""
_SHARES_A_THREAD = 4
"""Shares of an evaluation per thread of the workers: small enough to balance the load and to lose little with a worker."""
_PARTS = ".parts-"
"""Beginning of the names of the folders of parts, which eight characters of `tempfile` follow."""

# MuJoCo's warnings are collected per process, so that the threads of a worker simulate one at a time.
_lock = Lock()


def cluster_executor(address: str) -> Executor:
    """An executor of the workers of the scheduler at `address`."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, job: Job, items: Items, progress: Progress) -> Iterator[Outcome]:
    # Workers have another working directory.
    items = [(folder.resolve(), msgspec.structs.replace(run, path=run.path.resolve())) for folder, run in items]
    folders = {folder for folder, _ in items}
    _remove_leftovers(folders)
    with _part_folders(folders) as parts, _connected(address) as client:
        progress.start(())
        expected = _generator()
        tasks = {
            client.submit(_task(_make_apart, expected, job.make, parts[folder], run), pure=False): (folder, run)
            for folder, run in items
        }
        for future in as_completed(list(tasks), loop=client.loop):
            folder, run = tasks.pop(future)
            try:
                outcome, part = _result(future)
            except KilledWorker as killed:
                yield Outcome(FAILED, f"error: {run.path}: {run.name}: {killed.allowed_failures + 1} workers died on this task")
                continue
            if outcome.code == SUCCESS:
                _move_files(part, folder, f"{job.name(run)}.json")
            yield outcome


def _make_apart(expected: str, make: Callable[[Path, Run], Outcome], parts: Path, run: Run) -> tuple[Outcome, Path]:
    """On a worker: makes the files of `run` in a folder of its own below `parts`; returns the outcome and that folder."""
    _check_worker(expected, _generator(), parts)
    with _lock, tempfile.TemporaryDirectory(dir=get_worker().local_directory) as own:
        outcome = make(Path(own), run)
        # If the client has finished without this worker, `parts` does not exist any more and no file is left behind.
        part = Path(tempfile.mkdtemp(dir=parts))
        shutil.copytree(own, part, dirs_exist_ok=True)
    return outcome, part


def _generator() -> str:
    """Versions that determine the bytes of a trace, apart from its scene."""
    own = generator()
    return (
        f"whisker_sim {own.version} (commit {own.git_commit}, sources {own.source_sha256}), "
        f"MuJoCo {own.mujoco}, NumPy {version('numpy')}"
    )


def _move_files(part: Path, folder: Path, last: str) -> None:
    """Moves the files of `part` to `folder`; the file `last`, which marks them as complete, is moved last."""
    # An old sidecar must not remain beside new files: a recording has one sidecar per whisker, and one of its own.
    paths = sorted(part.iterdir(), key=lambda path: (path.name == last, path.suffix == ".json"))
    for path in paths:
        if path.suffix == ".json":
            (folder / path.name).unlink(missing_ok=True)
    for path in paths:
        path.replace(folder / path.name)


def evaluate(address: str, program: Path, shares: int | None, arguments: list[str]) -> int:
    """Runs the shares of `whisker evaluate` on the workers and merges them here; returns the exit code."""
    expected, here = _program(program), Path.cwd()
    command = [str(program), "evaluate", *arguments]
    with _part_folders([here]) as parts, _connected(address) as client:
        shares = shares or _SHARES_A_THREAD * sum(client.nthreads().values())
        tasks = {
            client.submit(_task(_do_share, expected, command, share, parts[here]), pure=False): share
            for share in (f"{number}/{shares}" for number in range(1, shares + 1))
        }
        with Progress("evaluate", "share", shares) as progress:
            for future in as_completed(list(tasks), loop=client.loop):
                share = tasks.pop(future)
                try:
                    _result(future)
                except KilledWorker as killed:
                    raise WhiskerSimError(f"share {share}: {killed.allowed_failures + 1} workers died on this task") from None
                progress.finish(f"share {share}: done")
    code = subprocess.run(command).returncode
    return code if code >= 0 else FAILED


def _do_share(expected: str, command: list[str], share: str, parts: Path) -> None:
    """On a worker: runs a share of an evaluation in the client's working directory."""
    _check_worker(expected, _program(Path(command[0])), parts)
    done = subprocess.run(
        [*command, "--share", share],
        cwd=parts.parent,
        # A task occupies one of the worker's threads.
        env=os.environ | {"RAYON_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        preexec_fn=_die_with_worker if sys.platform == "linux" else None,
    )
    if done.returncode != SUCCESS:
        message = done.stderr.partition("error: ")[2].partition("\n")[0] or f"whisker ended with {done.returncode}"
        raise (InputError if done.returncode == WRONG_INPUT else WhiskerSimError)(message)


def _program(path: Path) -> str:
    """Path and hash of the program, which determine the bytes of results apart from the inputs.

    Raises `InputError` if there is no such program.
    """
    try:
        return f"{path} with the SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
    except OSError as error:
        raise InputError(f"--whisker {path}: expected the program whisker, found none: {error.strerror}") from None


def _die_with_worker() -> None:
    """Makes the kernel end a child process when its worker is killed."""
    set_parent_death_signal = 1
    ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)


def _check_worker(expected: str, found: str, parts: Path) -> None:
    """Raises `WhiskerSimError` if the worker's versions differ from the client's, or it does not share the client's folders."""
    worker = get_worker().address
    if found != expected:
        raise WhiskerSimError(f"worker {worker}: expected the client's {expected}; found {found}")
    if not parts.is_dir():
        raise WhiskerSimError(f"worker {worker}: expected the client's folder {parts.parent}, found none; they must share it")


def _remove_leftovers(folders: Iterable[Path]) -> None:
    """Removes the folders of parts of killed clients from `folders`, which are locked: there is no other client that lives."""
    for folder in folders:
        for part in folder.glob(f"{_PARTS}????????"):
            shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _part_folders(folders: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Creates a hidden folder in each of `folders`, by which workers recognise the client's folder, and removes it at the end."""
    parts: dict[Path, Path] = {}
    try:
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
            # A name that nothing else has: what is removed at the end was created here.
            parts[folder] = Path(tempfile.mkdtemp(prefix=_PARTS, dir=folder))
        yield parts
    finally:
        for part in parts.values():
            shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """A client of the scheduler at `address`, which has at least one worker; raises `WhiskerSimError` if none answers."""
    # Errors are reported as one line.
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
    """A call as a task. A package that a worker lacks fails the task; Dask would otherwise end the worker as it reads the call."""
    packed = pickle.dumps((function, arguments))

    def task() -> Any:
        function, arguments = pickle.loads(packed)
        return function(*arguments)

    return task


def _result(future: Future) -> Any:
    """Result of a task; raises `KilledWorker`, or an error that ends the job with one line."""
    try:
        return future.result()
    except (KilledWorker, WhiskerSimError, OSError):
        raise
    except CancelledError:
        raise WhiskerSimError("the scheduler is gone; finished files are kept") from None
    except Exception as error:
        message = " ".join(f"{type(error).__name__}: {error}".split())
        raise WhiskerSimError(f"a worker failed; it needs the packages and the PYTHONPATH that the client has: {message}") from None
