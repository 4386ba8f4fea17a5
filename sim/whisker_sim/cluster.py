"""Work on the machines of a Dask cluster, whose workers share the client's folders.

A task writes into a folder of its own, and the client alone takes files in from there. Dask makes a task again whose worker it
takes for dead; whatever that one still writes, nothing is taken in twice or half-written.
"""

import logging
import shutil
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

from whisker_sim.chores import FAILED, GOOD, Chore, Crew, Outcome
from whisker_sim.errors import WhiskerSimError
from whisker_sim.runs import Run
from whisker_sim.trace import generator

_ANSWER_S = 10
"""A scheduler that is there answers within this time."""

# MuJoCo's warnings are gathered by process: the threads of a worker take turns.
_turn = Lock()


def crew(address: str) -> Crew:
    """The workers of the scheduler at `address`, as a crew."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, chore: Chore, waiting: list[tuple[Path, Run]]) -> Iterator[Outcome]:
    # The working directory of a worker is another one.
    waiting = [(folder.resolve(), run) for folder, run in waiting]
    with _part_folders({folder for folder, _ in waiting}) as parts, _connected(address) as client:
        made_by = _made_by()
        tasks = {
            client.submit(_make_apart, made_by, chore.make, parts[folder], run, pure=False): (folder, run)
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
    """On a worker: makes what is wanted of `run` in a folder of its own below `parts`; gives that folder too.

    Raises `WhiskerSimError` where the worker would make other bytes than the client, or does not share its folders.
    """
    worker = get_worker()
    if made_by != _made_by():
        raise WhiskerSimError(f"worker {worker.address}: expected what the client has, {made_by}; found {_made_by()}")
    if not parts.is_dir():
        raise WhiskerSimError(
            f"worker {worker.address}: expected the client's folder {parts.parent}, found none; they must share it"
        )
    with _turn, tempfile.TemporaryDirectory(dir=worker.local_directory) as own:
        outcome = make(Path(own), run)
        # Where the client has long done without this worker, its folder is gone and nothing is left behind.
        part = Path(tempfile.mkdtemp(dir=parts))
        shutil.copytree(own, part, dirs_exist_ok=True)
    return outcome, part


def _made_by() -> str:
    """All but the scene that determines the bytes of a trace."""
    made_by = generator()
    return (
        f"whisker_sim {made_by.version} (commit {made_by.git_commit}, sources {made_by.source_sha256}), "
        f"MuJoCo {made_by.mujoco}, NumPy {version('numpy')}"
    )


def _take_in(part: Path, folder: Path, last: str) -> None:
    """Moves the files of `part` to `folder`, the one that says that all is there as the last."""
    # It must not stand beside files that it does not describe.
    (folder / last).unlink(missing_ok=True)
    for path in sorted(part.iterdir(), key=lambda path: path.name == last):
        path.replace(folder / path.name)


@contextmanager
def _part_folders(folders: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Makes a hidden folder in each of `folders`, in which tasks write, and removes it at its end."""
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
    """A client of the scheduler at `address`; raises `WhiskerSimError` where none answers."""
    # What goes wrong becomes one line for people.
    logging.disable(logging.CRITICAL)
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise WhiskerSimError(
            f"--scheduler {address}: expected the address of a Dask scheduler, found none there: {error}"
        ) from None
    with client:
        yield client


def _result(future: Future) -> Any:
    """What a task gave; raises `KilledWorker`, or what ends the whole work as an error for people."""
    try:
        return future.result()
    except (KilledWorker, WhiskerSimError, OSError):
        raise
    except CancelledError:
        raise WhiskerSimError("the scheduler is gone; what is finished is kept") from None
    except Exception as error:
        raise WhiskerSimError(f"a worker failed; it needs what is installed here: {type(error).__name__}: {error}") from None
