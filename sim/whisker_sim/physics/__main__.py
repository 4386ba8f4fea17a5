"""Entry point of `python -m whisker_sim.physics`: runs the studies, writes their tables, prints the claims.

Exit codes: 0 every claim holds, 1 a claim does not hold or a study failed, 2 wrong use or input, 130 interrupted.
"""

import argparse
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from whisker_sim.cli import FAILED, GOOD, add_jobs, exit_code
from whisker_sim.errors import WhiskerSimError
from whisker_sim.physics.results import write_results
from whisker_sim.physics.studies import STUDIES
from whisker_sim.physics.study import Bar, Findings, Study

_REPOSITORY = Path(__file__).resolve().parents[3]
_NAMES = [study.name for study in STUDIES]


def main(arguments: list[str] | None = None) -> int:
    """Runs the studies; gives the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: _report(options), "interrupted; no table was written")


def _report(options: argparse.Namespace) -> int:
    studies = [study for study in STUDIES if study.name in (options.studies or _NAMES)]
    findings = run(studies, options.dataset, options.jobs)
    write_results(options.out, findings)
    for study, found in zip(studies, findings, strict=True):
        print(f"\n{study.about}")
        for bar in found.bars:
            print(f"  {claim_line(bar)}")
    print(f"\ntables: {options.out}")
    return GOOD if all(bar.holds for found in findings for bar in found.bars) else FAILED


def run(studies: Sequence[Study], dataset: Path, jobs: int) -> list[Findings]:
    """Runs `studies` on `jobs` worker processes and gives their findings, in the same order.

    Raises what a task raises, `InputError` for a missing or damaged trace, as soon as it does.
    """
    tasks = [study.tasks(dataset) for study in studies]
    flat = [task for group in tasks for task in group]
    results: dict[int, Any] = {}
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as executor, _progress(len(flat)) as advance:
        waiting: dict[Future[Any], int] = {executor.submit(task): index for index, task in enumerate(flat)}
        try:
            for future in as_completed(waiting):
                results[waiting[future]] = future.result()
                advance()
        except BrokenProcessPool:
            raise WhiskerSimError("a worker process died, for lack of memory perhaps; fewer --jobs may help") from None
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
    ordered = iter(results[index] for index in range(len(flat)))
    return [study.conclude([next(ordered) for _ in group]) for study, group in zip(studies, tasks, strict=True)]


def claim_line(bar: Bar) -> str:
    """One line: whether the claim holds, what it is, what was measured."""
    verdict = "holds" if bar.holds else "DOES NOT HOLD"
    return f"{verdict:<13}  {bar.claim}: {bar.measured:.3g} {bar.relation} {bar.bound:g} {bar.unit}".rstrip()


@contextmanager
def _progress(total: int) -> Iterator[Callable[[], None]]:
    """Gives a function that reports one finished task: a bar on a terminal, a line for every tenth of the way elsewhere."""
    if sys.stderr.isatty():
        from tqdm import tqdm

        with tqdm(total=total, unit="task", desc="physics", dynamic_ncols=True) as bar:
            yield bar.update
        return
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        if 10 * done // total > 10 * (done - 1) // total:
            print(f"physics: {done} of {total} tasks", file=sys.stderr, flush=True)

    yield report


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whisker_sim.physics", description="The simulator against theory, every claim measured.")
    parser.add_argument(
        "studies", nargs="*", metavar="STUDY", type=_study, help=f"which to run, all without one: {', '.join(_NAMES)}"
    )
    parser.add_argument(
        "--dataset", type=Path, default=_REPOSITORY / "datasets/standard", metavar="DIR", help="traces of the standard suite"
    )
    parser.add_argument("--out", type=Path, default=_REPOSITORY / "results/physics", metavar="DIR", help="folder of the tables")
    add_jobs(parser)
    return parser


def _study(name: str) -> str:
    if name not in _NAMES:
        raise argparse.ArgumentTypeError(f"expected one of {', '.join(_NAMES)}, found '{name}'")
    return name


if __name__ == "__main__":
    sys.exit(main())
