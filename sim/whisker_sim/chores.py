"""Chores: something is made for each of many runs, by a crew; what is up to date is left alone."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from whisker_sim.errors import WhiskerSimError
from whisker_sim.runs import Run

GOOD, FAILED, WRONG_INPUT, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit codes."""


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
    """A function of a module, where other processes can find it."""


Crew = Callable[[Chore, list[tuple[Path, Run]]], Iterator[Outcome]]
"""Makes all that is given to it; yields the outcome of each, as they finish."""


def do(chore: Chore, waiting: list[tuple[Path, Run]], crew: Crew, force: bool) -> int:
    """Has a crew do a chore for all that wait, in a folder each; gives the exit code."""
    failed = []
    with progress(chore.verb, chore.noun, len(waiting)) as report:
        for outcome in _outcomes(chore, waiting, crew, force):
            report(outcome)
            failed += [outcome.code] if outcome.code != GOOD else []
    if 0 < len(failed) < len(waiting):
        print(f"{len(failed)} of {len(waiting)} {chore.noun}s failed", file=sys.stderr)
        return SOME_FAILED
    return max(failed, default=GOOD)


def _outcomes(chore: Chore, waiting: list[tuple[Path, Run]], crew: Crew, force: bool) -> Iterator[Outcome]:
    """Has made what is not up to date; yields the outcome of each, as they finish."""
    from whisker_sim.trace import remove_leftovers

    for folder, run in waiting:
        remove_leftovers(folder, chore.name(run))
    stale = []
    for folder, run in waiting:
        if not force and chore.is_up_to_date(folder, run):
            yield Outcome(GOOD, f"{chore.name(run)}: up to date")
        else:
            stale.append((folder, run))
    if stale:
        yield from crew(chore, stale)


def processes(jobs: int) -> Crew:
    """A crew of so many processes on this machine."""
    return partial(_in_processes, jobs)


def _in_processes(jobs: int, chore: Chore, waiting: list[tuple[Path, Run]]) -> Iterator[Outcome]:
    jobs = min(jobs, len(waiting))
    if jobs == 1:
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


def _submit(executor: ProcessPoolExecutor, chore: Chore, items: Iterable[tuple[Path, Run]]) -> set[Future[Outcome]]:
    """Hands out items to workers; they start here, where there are too few.

    They never hear an interrupt, and finish the items they are making; the main process does, and hands out no more.
    """
    with interrupts_wait():
        return {executor.submit(chore.make, folder, run) for folder, run in items}


@contextmanager
def interrupts_wait() -> Iterator[None]:
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
def progress(verb: str, noun: str, total: int) -> Iterator[Callable[[Outcome], None]]:
    """Gives a function that reports one finished item: a bar on a terminal, a line elsewhere; errors always as a line."""
    if not sys.stderr.isatty():
        yield lambda outcome: print(outcome.line, file=sys.stderr, flush=True)
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=noun, desc=verb, dynamic_ncols=True) as bar:

        def report(outcome: Outcome) -> None:
            if outcome.code != GOOD:
                bar.write(outcome.line, file=sys.stderr)
            bar.update()

        yield report
