"""Time of a step of `recommended`, and its errors, in this version and in an earlier one.

Usage: compare.py [--config FILE] NOW EARLIER

Both are checkouts with the built program (`cargo build --release -p whisker-cli`) and the simulated and fitted suite
(`whisker simulate scenes/suites/standard.json --out datasets/standard`, `whisker fit scenes/suites/standard.json`). In each round
both programs evaluate the suite, in turn; a ratio of times is computed within a round, so that drift of the machine's speed
cancels. FILE contains settings of the estimators for NOW, as for `whisker evaluate --config`; EARLIER runs with its defaults.
Writes CSV to stdout: the median step of either over the rounds (ns), median, least and largest ratio of the times, and the median
RMSE (m) over the seeds.
"""

import argparse
import csv
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

SUITE = "standard"
RUN = "earlier"
ROUNDS = 5
SEEDS = 40
COLUMNS = ("group", "whisker", "step_ns", "earlier_step_ns", "ratio", "least", "most", "rmse_m", "earlier_rmse_m")

Sets = dict[tuple[str, str], dict[str, str]]


def evaluated(checkout: Path, config: Path | None = None) -> Sets:
    """Rows of the summary by set, after an evaluation."""
    program = checkout / "target/release/whisker"
    options = ["--estimators", "recommended", "--seeds", str(SEEDS), "--name", RUN]
    if config is not None:
        options += ["--config", str(config.resolve())]
    command = [str(program.resolve()), "evaluate", f"scenes/suites/{SUITE}.json", *options]
    # Earlier versions do not replace a finished run.
    shutil.rmtree(checkout / "results" / RUN, ignore_errors=True)
    subprocess.run(command, cwd=checkout, check=True, stdout=subprocess.DEVNULL)
    with (checkout / "results" / RUN / "summary.csv").open(newline="") as file:
        return {(row["group"], row["whisker"]): row for row in csv.DictReader(file)}


def main() -> None:
    """Run the rounds and write the table."""
    parser = argparse.ArgumentParser()
    for name in ("now", "earlier"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--config", type=Path)
    arguments = parser.parse_args()
    rounds = [(evaluated(arguments.now, arguments.config), evaluated(arguments.earlier)) for _ in range(ROUNDS)]
    table = csv.writer(sys.stdout)
    table.writerow(COLUMNS)
    for key in rounds[0][0]:
        now, earlier = ([float(one[side][key]["step_ns"]) for one in rounds] for side in (0, 1))
        ratios = [before / after for after, before in zip(now, earlier, strict=True)]
        times = [statistics.median(now), statistics.median(earlier)]
        spread = [statistics.median(ratios), min(ratios), max(ratios)]
        errors = [rounds[0][side][key]["rmse_m"] for side in (0, 1)]
        table.writerow([*key, *(f"{value:.0f}" for value in times), *(f"{value:.2f}" for value in spread), *errors])


if __name__ == "__main__":
    main()
