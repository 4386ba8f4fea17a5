"""Jobs: files that an executor makes for each of many runs; up-to-date files are reused."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, MutableSequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from whisker_sim.errors import WhiskerSimError
from whisker_sim.progress import Progress, work_on
from whisker_sim.runs import Run

SUCCESS, FAILED, WRONG_INPUT, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit codes."""


class Outcome(NamedTuple):
    """Result of one item of a job: an exit code, and a line of text for the user."""

    code: int
    line: str


class Job(NamedTuple):
    """Files to be made in a folder for each of many runs."""

    verb: str
    noun: str
    """Name of what is made for one run, in the singular."""
    name: Callable[[Run], str]
    """Name of a run's files without their endings."""
    is_up_to_date: Callable[[Path, Run], bool]
    make: Callable[[Path, Run], Outcome]
    """A function that can be pickled, for other processes."""


Items = list[tuple[Path, Run]]
"""Folders and runs."""
Executor = Callable[[Job, Items, Progress], Iterator[Outcome]]
"""Makes the files of all items; yields the outcome of each as it finishes."""


def run_job(job: Job, items: Items, executor: Executor, force: bool) -> int:
    """Runs a job on `items` by an executor; returns the exit code. Up-to-date items are reused unless `force` is set."""
    failed = []
    with Progress(job.verb, job.noun, len(items)) as progress:
        for outcome in _outcomes(job, items, executor, force, progress):
            progress.finish(outcome.line, outcome.code != SUCCESS)
            failed += [outcome.code] if outcome.code != SUCCESS else []
    if 0 < len(failed) < len(items):
        print(f"{len(failed)} of {len(items)} {job.noun}s failed", file=sys.stderr)
        return SOME_FAILED
    return max(failed, default=SUCCESS)


def _outcomes(job: Job, items: Items, executor: Executor, force: bool, progress: Progress) -> Iterator[Outcome]:
    """Makes the items that are not up to date; yields the outcome of each item."""
    from whisker_sim.trace import remove_leftovers

    for folder, run in items:
        remove_leftovers(folder, job.name(run))
    stale = []
    for folder, run in items:
        if not force and job.is_up_to_date(folder, run):
            yield Outcome(SUCCESS, f"{job.name(run)}: up to date")
        else:
            stale.append((folder, run))
    if stale:
        yield from executor(job, stale, progress)


def process_executor(jobs: int) -> Executor:
    """An executor of `jobs` processes on this machine."""
    return partial(_in_processes, jobs)


def _in_processes(jobs: int, job: Job, items: Items, progress: Progress) -> Iterator[Outcome]:
    jobs = min(jobs, len(items))
    if jobs == 1:
        progress.start(shares := [0.0] * len(items))
        for index, (folder, run) in enumerate(items):
            with work_on(shares, index):
                outcome = job.make(folder, run)
            yield outcome
        return
    context = multiprocessing.get_context("spawn")
    progress.start(shares := context.RawArray("d", len(items)))
    # At most one item per worker is submitted at a time: an interrupted run waits for those items only.
    with dead_workers_reported(), ProcessPoolExecutor(jobs, context, initializer=_set_up_worker, initargs=(shares,)) as executor:
        rest = iter(enumerate(items))
        running = _submit(executor, job, islice(rest, jobs))
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= _submit(executor, job, islice(rest, len(done)))
            yield from (future.result() for future in done)


@contextmanager
def dead_workers_reported() -> Iterator[None]:
    """Reports a worker process that died within the context, when a result is awaited or an item submitted, as one error."""
    try:
        yield
    except BrokenProcessPool:
        raise WhiskerSimError("a worker process died, possibly for lack of memory; fewer --jobs may help") from None


def _submit(executor: ProcessPoolExecutor, job: Job, items: Iterable[tuple[int, tuple[Path, Run]]]) -> set[Future[Outcome]]:
    """Submits items to the workers, which start here if there are too few.

    Workers ignore an interrupt and finish their items; the main process handles it and submits no more.
    """
    with deferred_interrupts():
        return {executor.submit(_make, index, job.make, folder, run) for index, (folder, run) in items}


_shares: MutableSequence[float]
"""In a worker process: finished shares of all items, in memory that the main process reads."""


def _make(index: int, make: Callable[[Path, Run], Outcome], folder: Path, run: Run) -> Outcome:
    """In a worker process: makes the item number `index`."""
    with work_on(_shares, index):
        return make(folder, run)


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Defers interrupts until the end of the context; processes started within it ignore them for good."""
    late: list[int] = []
    # Blocking the signal is not enough: a library's thread that does not block it would receive it for the whole process.
    previous = signal.signal(signal.SIGINT, lambda number, _: late.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, previous)
        if late:
            signal.raise_signal(signal.SIGINT)


def _set_up_worker(shares: MutableSequence[float]) -> None:
    """Sets up a worker process, which ends with the main process, even if that is killed."""
    global _shares
    _shares = shares
    main_process = multiprocessing.parent_process()

    def follow() -> None:
        main_process.join()
        os._exit(FAILED)

    threading.Thread(target=follow, daemon=True).start()
