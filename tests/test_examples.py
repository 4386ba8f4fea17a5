"""Example programs, without the command `whisker`."""

import json
import math
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
STREAM = runpy.run_path(str(ROOT / "examples" / "own-data" / "stream.py"))
STREAM_IN_SPACE = runpy.run_path(str(ROOT / "examples" / "own-data-space" / "stream.py"))


def moments_n_m(at_m: np.ndarray) -> np.ndarray:
    """Moments (n, 2) of a sensor at contacts (n, 3): products of the coordinates, so that one reading has many contacts."""
    x, y, z = at_m.T
    return np.stack([-z * (0.1 - x), y * (0.02 + x)], axis=-1)


def first_line() -> dict:
    """Prior information with the table of that sensor."""
    turns_rad = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    grid = np.meshgrid(np.linspace(0.02, 0.06, 25), turns_rad, np.linspace(0.0, 6e-3, 7), indexing="ij")
    x, turn_rad, away_m = (axis.ravel() for axis in grid)
    y, z, none = away_m * np.cos(turn_rad), away_m * np.sin(turn_rad), np.zeros(len(x))
    readings = moments_n_m(np.stack([x, y, z], axis=-1))
    table = {"x_m": x, "y_m": y, "z_m": z, "moment_y_n_m": readings[:, 0], "moment_z_n_m": readings[:, 1]}
    table |= {"moment_y_by_x_n": z, "moment_y_by_y_n": none, "moment_y_by_z_n": x - 0.1}
    table |= {"moment_z_by_x_n": y, "moment_z_by_y_n": 0.02 + x, "moment_z_by_z_n": none}
    table |= {f"model_cov_{pair}_n2_m2": none for pair in ("yy", "yz", "zz")}
    shape = [25, 16, 7]
    return {"protocol": 2, "noise_sd_n_m": 1e-6, "shape": shape, "table": {key: of.tolist() for key, of in table.items()}}


def test_verif_the_filter_in_space_finds_a_contact_at_rest() -> None:
    """The base moves across the whisker and yaws; the first row is free."""
    contact_m, last_m, true_m, lines = np.array([0.04, 2e-3, 1e-3]), np.zeros(3), [], [json.dumps(first_line())]
    for row in range(300):
        base_m = np.array([0.0, 1.5e-3 * np.sin(row / 40), 1.5e-3 * np.sin(row / 25)])
        half_rad = 0.02 * np.sin(row / 60)
        cos, sin = np.cos(2.0 * half_rad), np.sin(2.0 * half_rad)
        to_base = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        true_m.append(to_base @ (contact_m - base_m))
        reading = moments_n_m(true_m[-1][None])[0]
        sample = {"moment_y_n_m": reading[0], "moment_z_n_m": reading[1], "touched": row > 0}
        sample |= {"base_qw": np.cos(half_rad), "base_qx": 0.0, "base_qy": 0.0, "base_qz": np.sin(half_rad)}
        sample |= dict(zip(("base_x_m", "base_y_m", "base_z_m"), base_m, strict=True))
        sample |= dict(zip(("last_x_m", "last_y_m", "last_z_m"), to_base @ (last_m - base_m), strict=True))
        last_m = base_m
        lines.append(json.dumps(sample))
    command = [sys.executable, "examples/my_filter_space.py"]
    done = subprocess.run(command, input="\n".join(lines), capture_output=True, text=True, check=True, cwd=ROOT)
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(answers) == 300
    assert answers[0] is None
    found_m = np.array([answers[-1][f"contact_{axis}_m"] for axis in "xyz"])
    assert np.linalg.norm(found_m - true_m[-1]) < 1e-3


def test_robust_each_filter_rejects_the_protocol_of_the_other() -> None:
    for script, protocol, expected in (("my_filter.py", 2, 1), ("my_filter_space.py", 1, 2)):
        command = [sys.executable, f"examples/{script}"]
        line = json.dumps({"protocol": protocol})
        done = subprocess.run(command, input=line, capture_output=True, text=True, check=False, cwd=ROOT)
        assert done.returncode == 1
        assert f"protocol: found {protocol}, expected {expected}" in done.stderr


def test_verif_the_stream_sends_the_counts_of_every_row_and_begins_with_the_free_whisker() -> None:
    lines = list(STREAM["lines"]())
    assert len(lines) == len((ROOT / "examples" / "own-data" / "trial_1.csv").read_text(encoding="utf-8").splitlines()) - 1
    assert all(set(line) == {"t_s", "base_x_m", "base_y_m", "base_yaw_rad", "counts"} for line in lines)
    end_s = lines[0]["t_s"] + STREAM["FIRST_LINE"]["zeroing_s"]
    assert [line["counts"] for line in lines if line["t_s"] <= end_s] == pytest.approx([512.0] * 30, abs=6.0)


def test_verif_the_stream_states_the_pose_of_the_root() -> None:
    """The flange points along +y: the root is 30 mm ahead of it and 10 mm to its right, and points along -x."""
    found = STREAM["base"]((0.4, 0.1, math.pi / 2))
    assert found == pytest.approx({"base_x_m": 0.41, "base_y_m": 0.13, "base_yaw_rad": math.pi})


def test_verif_the_stream_in_space_sends_the_counts_of_every_row() -> None:
    lines = list(STREAM_IN_SPACE["lines"]())
    recording = ROOT / "examples" / "own-data-space" / "trial_1.csv"
    assert len(lines) == len(recording.read_text(encoding="utf-8").splitlines()) - 1
    pose = {"base_x_m", "base_y_m", "base_z_m", "base_qw", "base_qx", "base_qy", "base_qz"}
    assert all(set(line) == {"t_s", "counts"} | pose for line in lines)
    end_s = lines[0]["t_s"] + STREAM_IN_SPACE["FIRST_LINE"]["zeroing_s"]
    at_rest = np.array([line["counts"] for line in lines if line["t_s"] <= end_s])
    assert np.abs(at_rest - [512.0, -140.0]).max() <= 6.0


def test_verif_the_stream_in_space_states_the_pose_of_the_root() -> None:
    """The flange is turned by a right angle about +z, so that its y axis is -x: the whisker points there, 30 degrees down."""
    half = math.sqrt(0.5)
    found = STREAM_IN_SPACE["base"]((0.4, 0.1, 0.3), (half, 0.0, 0.0, half))
    place = {"base_x_m": 0.41, "base_y_m": 0.13, "base_z_m": 0.35}
    assert {key: found[key] for key in place} == pytest.approx(place)
    w, x, y, z = (found[f"base_q{axis}"] for axis in "wxyz")
    along = (w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y))
    assert along == pytest.approx((-math.cos(math.radians(30)), 0.0, -0.5))
