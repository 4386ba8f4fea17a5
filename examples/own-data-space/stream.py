"""A recording in space as the stream of a robot, for `whisker live`: one JSON line for each reading, at the pace of the recording.

    python examples/own-data-space/stream.py | whisker live --calibration datasets/lab-space/calibrations/lab-whisker.json

`whisker import csv examples/own-data-space/import.json --space --out datasets/lab-space` and `whisker fit datasets/lab-space` make
the calibration, which converts the counts. On a robot, replace `rows` by your drivers.
"""

import csv
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

RECORDING = Path(__file__).with_name("trial_1.csv")

FIRST_LINE = {"protocol": 2, "rate_hz": 100.0, "zeroing_s": 0.3}
"""First line of the stream. The whisker must be free for the first `zeroing_s` (s)."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z."""


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Rotation by `b`, then by `a`."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def turned(by: Quaternion, vector: Vector) -> Vector:
    """A vector after a rotation."""
    w, x, y, z = by
    _, *result = product(product(by, (0.0, *vector)), (w, -x, -y, -z))
    return (result[0], result[1], result[2])


def about(axis: Vector, angle_rad: float) -> Quaternion:
    """Rotation about a unit vector."""
    x, y, z = axis
    sin = math.sin(0.5 * angle_rad)
    return (math.cos(0.5 * angle_rad), sin * x, sin * y, sin * z)


BASE_IN_FLANGE: tuple[Vector, Quaternion] = (
    (0.030, -0.010, 0.050),
    product(about((0.0, 0.0, 1.0), math.radians(90)), about((0.0, 1.0, 0.0), math.radians(30))),
)
"""Position (m) and rotation of the root of the whisker in the frame of the flange, as in `import.json`."""


def rows() -> Iterator[tuple[float, Vector, Quaternion, tuple[float, float]]]:
    """Time (s), position (m) and rotation of the flange, and counts of both channels of each row."""
    with RECORDING.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            x_mm, y_mm, z_mm = (float(row[f"flange_{axis}_mm"]) for axis in "xyz")
            w, x, y, z = (float(row[f"flange_q{axis}"]) for axis in "wxyz")
            position = (1e-3 * x_mm, 1e-3 * y_mm, 1e-3 * z_mm)
            yield 1e-3 * float(row["time_ms"]), position, (w, x, y, z), (float(row["hall_a"]), float(row["hall_b"]))


def base(position: Vector, rotation: Quaternion) -> dict[str, float]:
    """Pose of the root of the whisker for a pose of the flange."""
    at, turn = BASE_IN_FLANGE
    from_flange = turned(rotation, at)
    names = ("base_qw", "base_qx", "base_qy", "base_qz")
    return {
        "base_x_m": position[0] + from_flange[0],
        "base_y_m": position[1] + from_flange[1],
        "base_z_m": position[2] + from_flange[2],
        **dict(zip(names, product(rotation, turn), strict=True)),
    }


def lines() -> Iterator[dict[str, float | tuple[float, float]]]:
    """Counts with the pose at their time, for each row."""
    for t_s, position, rotation, counts in rows():
        yield {"t_s": t_s, **base(position, rotation), "counts": counts}


def main() -> None:
    """Prints the first line, then the others at their times."""
    print(json.dumps(FIRST_LINE), flush=True)
    begin_s = time.monotonic()
    first_s = None
    for line in lines():
        t_s = float(line["t_s"])
        first_s = t_s if first_s is None else first_s
        time.sleep(max(0.0, t_s - first_s - (time.monotonic() - begin_s)))
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
