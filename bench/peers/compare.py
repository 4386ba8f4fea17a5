"""Comparison of this project's filters with other implementations: estimates first, then time per step.

Usage: compare.py PEERS TRACE CALIBRATION TABLE

PEERS is the program built from the Cargo workspace beside this file. Fails if the Kalman filters do not agree to rounding, or the
particle filters not within statistical error. Otherwise the times are written to TABLE (CSV): medians over rounds, and the median
and the extremes of the ratio. Implementations alternate in each round, and ratios are taken within a round, so that drift of the
machine's speed cancels. Times are processor times, which exclude other programs.
"""

import argparse
import csv
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

# One thread for all implementations: the matrices of a step are too small for more.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from python_filters import Estimates, Problem, filterpy_ekf, filterpy_ukf, numpy_particle

ROUNDS = 5
SEEDS = 20
PASSES = 3

# Kalman filters of one kind perform the same computation in another order.
RELATIVE_TOLERANCE = 1e-6
# Share of the trace, from its start, in which the particle filters converge.
START_SHARE = 0.2
# Allowed difference of the mean errors of two particle filters, in standard errors.
CHANCE = 4.0

MAKERS = {
    "ekf": {"smelly": "smelly", "filterpy": "filterpy"},
    "ukf": {"smelly": "smelly", "filterpy": "filterpy"},
    "particle": {"smelly": "smelly", "numpy": "NumPy"},
}

Answers = dict[tuple[str, str], tuple[float, list[Estimates]]]


def main() -> int:
    """Runs the comparison; returns the exit code."""
    parser = argparse.ArgumentParser()
    for name in ("peers", "trace", "calibration", "table"):
        parser.add_argument(name, type=Path)
    arguments = parser.parse_args()
    times: dict[tuple[str, str], list[float]] = {}
    for number in range(ROUNDS):
        problem, answers = run_round(arguments)
        if number == 0:
            failures = disagreements(problem, answers)
            if failures:
                sys.exit("error: the filters do not agree: " + "; ".join(failures))
        for who, (step_s, _) in answers.items():
            times.setdefault(who, []).append(step_s)
        print(f"round {number + 1} of {ROUNDS}", file=sys.stderr)
    write(arguments.table, rows(times, f"trace {arguments.trace.stem}, {len(problem.reading_n_m)} steps, {ROUNDS} rounds"))
    return 0


def run_round(arguments: argparse.Namespace) -> tuple[Problem, Answers]:
    """Results of every filter: time per step (s), and estimates, one per seed."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.json"
        command = [arguments.peers, arguments.trace, arguments.calibration, str(SEEDS), file]
        printed = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
        problem = Problem(json.loads(file.read_text()))
    answers: Answers = {}
    for answer in json.loads(printed):
        estimates = [as_estimates(each) for each in answer["estimates"]]
        answers[answer["maker"], answer["filter"]] = (answer["step_s"], estimates)
    answers["filterpy", "ekf"] = timed(lambda _: filterpy_ekf(problem), 1)
    answers["filterpy", "ukf"] = timed(lambda _: filterpy_ukf(problem), 1)
    answers["numpy", "particle"] = timed(lambda seed: numpy_particle(problem, seed), SEEDS)
    return problem, answers


def as_estimates(steps: list[dict[str, list[float]]]) -> Estimates:
    """Converts estimates from JSON."""
    means = np.array([step["mean_m"] for step in steps])
    return Estimates(means, np.array([step["covariance_m2"] for step in steps]).reshape(-1, 2, 2))


def timed(run: Callable[[int], Estimates], seeds: int) -> tuple[float, list[Estimates]]:
    """Processor time per step of the fastest pass, and the estimates of each seed."""
    estimates, fastest_s = [], np.inf
    for seed in range(max(seeds, PASSES)):
        started = time.thread_time()
        estimates.append(run(seed))
        fastest_s = min(fastest_s, time.thread_time() - started)
    return fastest_s / len(estimates[0].mean_m), estimates[:seeds]


def disagreements(problem: Problem, answers: Answers) -> list[str]:
    """Descriptions of all disagreements."""
    found = []
    for kind in ("ekf", "ukf"):
        ours = answers["whisker", kind][1][0]
        for maker in MAKERS[kind]:
            theirs = answers[maker, kind][1][0]
            sd_m = np.sqrt(np.diagonal(ours.covariance_m2, axis1=1, axis2=2))
            means = np.max(np.abs(ours.mean_m - theirs.mean_m) / sd_m)
            covariances = np.max(np.abs(ours.covariance_m2 - theirs.covariance_m2) / (sd_m[:, :, None] * sd_m[:, None]))
            print(f"{kind}: {maker} differs by {means:.1e} sd, covariance by {covariances:.1e}", file=sys.stderr)
            if not max(means, covariances) < RELATIVE_TOLERANCE:
                found.append(f"{kind} of {maker} differs by {max(means, covariances):.1e} standard deviations")
    errors_m = {maker: rms_m(problem, answers[maker, "particle"][1]) for maker in ("whisker", *MAKERS["particle"])}
    for maker, theirs_m in errors_m.items():
        ours_m = errors_m["whisker"]
        error_m = np.sqrt((ours_m.var(ddof=1) + theirs_m.var(ddof=1)) / SEEDS)
        error = f"{1e3 * theirs_m.mean():.3f} mm, sd {1e3 * theirs_m.std(ddof=1):.3f} mm over seeds"
        print(f"particle: {maker} has an error of {error}", file=sys.stderr)
        if not abs(theirs_m.mean() - ours_m.mean()) <= CHANCE * error_m:
            found.append(f"particle: {maker} has an error of {error}, expected about {1e3 * ours_m.mean():.3f} mm")
    return found


def rms_m(problem: Problem, estimates: list[Estimates]) -> np.ndarray:
    """Root mean square error of the contact after convergence (m), one per seed."""
    start = int(START_SHARE * len(problem.truth_m))
    apart_m = np.array([each.mean_m[start:] - problem.truth_m[start:] for each in estimates])
    return np.sqrt((apart_m**2).sum(axis=2).mean(axis=1))


def rows(times: dict[tuple[str, str], list[float]], problem: str) -> list[dict[str, str]]:
    """Rows of the table, with the conditions of the measurement."""
    smelly = re.search(r'name = "smelly"\nversion = "(.*)"', Path(__file__).with_name("Cargo.lock").read_text())
    versions = f"filterpy {version('filterpy')}, NumPy {np.__version__}, smelly {smelly[1] if smelly else 'unknown'}"
    conditions = {"problem": problem, "machine": processor(), "versions": f"{versions}, Python {platform.python_version()}"}
    found = []
    for kind, makers in MAKERS.items():
        ours = np.array(times["whisker", kind])
        for maker, name in makers.items():
            theirs = np.array(times[maker, kind])
            ratios = theirs / ours
            numbers = {
                "here_s": np.median(ours),
                "other_s": np.median(theirs),
                "ratio": np.median(ratios),
                "ratio_least": ratios.min(),
                "ratio_most": ratios.max(),
            }
            head = {"filter": kind, "other": name}
            found.append(head | {column: f"{value:.4g}" for column, value in numbers.items()} | conditions)
    return found


def processor() -> str:
    """Model of the processor and number of cores."""
    names = [line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def write(table: Path, found: list[dict[str, str]]) -> None:
    """Writes the rows as CSV, at once."""
    unfinished = table.with_suffix(".partial")
    with unfinished.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(found[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)
    unfinished.replace(table)


if __name__ == "__main__":
    sys.exit(main())
