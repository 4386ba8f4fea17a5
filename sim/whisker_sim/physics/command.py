"""Command line of `python -m whisker_sim.physics`, which runs the studies, writes their tables and prints the claims.

Exit codes: 0 every claim holds, 1 a claim does not hold or a study failed, 2 wrong usage or input, 130 interrupted.
"""

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from whisker_sim.cli import add_jobs, exit_code
from whisker_sim.jobs import FAILED, SUCCESS, dead_workers_reported
from whisker_sim.paths import ROOT
from whisker_sim.physics.results import write_results
from whisker_sim.physics.studies import STUDIES
from whisker_sim.physics.study import Claim, Findings, Study
from whisker_sim.progress import Progress

_NAMES = [study.name for study in STUDIES]


def main(arguments: list[str] | None = None) -> int:
    """Runs the studies; returns the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: _report(options), "interrupted; no table was written")


def _report(options: argparse.Namespace) -> int:
    studies = [study for study in STUDIES if study.name in (options.studies or _NAMES)]
    findings = run(studies, options.dataset, options.jobs)
    write_results(options.out, findings)
    for study, found in zip(studies, findings, strict=True):
        print(f"\n{study.about}")
        for claim in found.claims:
            print(f"  {claim_line(claim)}")
    print(f"\ntables: {options.out}")
    return SUCCESS if all(claim.holds for found in findings for claim in found.claims) else FAILED


def run(studies: Sequence[Study], dataset: Path, jobs: int) -> list[Findings]:
    """Runs `studies` on `jobs` worker processes; returns their findings in the same order.

    Raises the first error of a task, such as `InputError` for a missing or damaged trace.
    """
    tasks = [study.tasks(dataset) for study in studies]
    flat = [task for group in tasks for task in group]
    results: dict[int, Any] = {}
    context = multiprocessing.get_context("spawn")
    with (
        dead_workers_reported(),
        ProcessPoolExecutor(jobs, context) as executor,
        Progress("physics", "task", len(flat)) as progress,
    ):
        try:
            waiting: dict[Future[Any], int] = {executor.submit(task): index for index, task in enumerate(flat)}
            for future in as_completed(waiting):
                results[waiting[future]] = future.result()
                progress.finish()
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
    ordered = iter(results[index] for index in range(len(flat)))
    return [study.conclude([next(ordered) for _ in group]) for study, group in zip(studies, tasks, strict=True)]


def claim_line(claim: Claim) -> str:
    """One line about a claim: whether it holds, its text, the measured value."""
    verdict = "holds" if claim.holds else "DOES NOT HOLD"
    return f"{verdict:<13}  {claim.claim}: {claim.measured:.3g} {claim.relation} {claim.bound:g} {claim.unit}".rstrip()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="whisker_sim.physics", description="Compare the simulator with theory and measure all claims."
    )
    parser.add_argument(
        "studies", nargs="*", metavar="STUDY", type=_study, help=f"studies to run (default: all): {', '.join(_NAMES)}"
    )
    parser.add_argument(
        "--dataset", type=Path, default=ROOT / "datasets/standard", metavar="DIR", help="traces of the standard suite"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "results/physics", metavar="DIR", help="folder of the tables")
    add_jobs(parser)
    return parser


def _study(name: str) -> str:
    if name not in _NAMES:
        raise argparse.ArgumentTypeError(f"expected one of {', '.join(_NAMES)}, found '{name}'")
    return name


if __name__ == "__main__":
    sys.exit(main())
