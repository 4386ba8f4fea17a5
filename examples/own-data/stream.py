"""A recording as the stream of a robot, for `whisker live`: one JSON line for each reading, at the pace of the recording.

    python examples/own-data/stream.py | whisker live --calibration datasets/lab/calibrations/lab-whisker.json

`whisker import csv examples/own-data/import.json --out datasets/lab` and `whisker fit datasets/lab` make the calibration, which
converts the counts. On a robot, replace `rows` by your drivers.
"""

import csv
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

RECORDING = Path(__file__).with_name("trial_1.csv")

FIRST_LINE = {"protocol": 1, "rate_hz": 100.0, "zeroing_s": 0.3}
"""The whisker is free for `zeroing_s`."""

BASE_IN_FLANGE = (0.030, -0.010, math.pi / 2)
"""Root of the whisker in the frame of the flange (m, m, rad), as in `import.json`."""


def rows() -> Iterator[tuple[float, tuple[float, float, float], float]]:
    """Time (s), pose of the flange (m, m, rad) and counts of each row."""
    with RECORDING.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            x_m, y_m = 1e-3 * float(row["flange_x_mm"]), 1e-3 * float(row["flange_y_mm"])
            yield 1e-3 * float(row["time_ms"]), (x_m, y_m, math.radians(float(row["flange_yaw_deg"]))), float(row["hall_counts"])


def base(flange: tuple[float, float, float]) -> dict[str, float]:
    """Pose of the root of the whisker for a pose of the flange."""
    x_m, y_m, yaw_rad = flange
    along_m, across_m, turn_rad = BASE_IN_FLANGE
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return {
        "base_x_m": x_m + cos * along_m - sin * across_m,
        "base_y_m": y_m + sin * along_m + cos * across_m,
        "base_yaw_rad": yaw_rad + turn_rad,
    }


def lines() -> Iterator[dict[str, float]]:
    """Counts with the pose at their time, for each row."""
    for t_s, flange, counts in rows():
        yield {"t_s": t_s, **base(flange), "counts": counts}


def main() -> None:
    """Prints the first line, then the others at their times."""
    print(json.dumps(FIRST_LINE), flush=True)
    begin_s = time.monotonic()
    first_s = None
    for line in lines():
        first_s = line["t_s"] if first_s is None else first_s
        time.sleep(max(0.0, line["t_s"] - first_s - (time.monotonic() - begin_s)))
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
