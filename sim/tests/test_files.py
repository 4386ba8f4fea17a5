"""Files of traces: format, determinism, golden files."""

import csv
import io
import json
import re

import mujoco
import numpy as np
import pytest

from whisker_sim.cli import main
from whisker_sim.runs import load_runs
from whisker_sim.trace import COLUMNS, format_csv

from conftest import REPOSITORY, SCENES

GOLDEN = REPOSITORY / "datasets" / "golden"


def test_verif_csv_formatting():
    """Fixed decimals, empty fields for unknown values, no negative zero."""
    text = format_csv([np.array([0.0, -1e-9, 1.25]), np.array([np.nan, 1.0, -0.0])], (("a_m", 4), ("b", 0)))
    assert text == b"a_m,b\n0.0000,\n0.0000,1\n1.2500,0\n"


@pytest.fixture(scope="module")
def golden_twice(tmp_path_factory):
    folders = []
    for jobs in ("1", "2"):
        folders.append(tmp_path_factory.mktemp(f"jobs_{jobs}"))
        assert main(["simulate", str(SCENES / "suites" / "golden.json"), "--out", str(folders[-1]), "--jobs", jobs]) == 0
    return folders


def test_verif_same_bytes_on_one_worker_and_two(golden_twice):
    one, two = golden_twice
    names = sorted(path.name for path in one.iterdir())
    assert names == sorted(path.name for path in two.iterdir())
    assert names == [f"golden_{trace}.{end}" for trace in ("circle", "pin") for end in ("contour.csv", "csv", "json")]
    for name in names:
        assert (one / name).read_bytes() == (two / name).read_bytes()


def test_verif_rows_and_sidecar_follow_the_format(golden_twice):
    folder = golden_twice[0]
    rows = list(csv.reader(io.StringIO((folder / "golden_pin.csv").read_text())))
    assert rows[0] == [name for name, _ in COLUMNS]
    for row in rows[1:]:
        for field, (_, decimals) in zip(row, COLUMNS, strict=True):
            assert re.fullmatch(rf"(-?\d+(\.\d{{{decimals}}})?)?", field)
        assert (row[9] == "1") == all(field for field in row[10:])
    times = [float(row[0]) for row in rows[1:]]
    np.testing.assert_allclose(np.diff(times), 0.004, atol=1e-9)
    sidecar = json.loads((folder / "golden_pin.json").read_text())
    assert list(sidecar) == [
        "format", "kind", "name", "role", "group", "object", "face", "seed", "rate_hz", "rows", "whisker", "scene", "generator",
        "inputs_sha256", "csv_sha256", "contour", "certificate",
    ]  # fmt: skip
    assert sidecar["rows"] == len(times)
    contour = (folder / sidecar["contour"]["file"]).read_text().splitlines()
    assert contour[0] == "x_m,y_m"
    assert contour[1] == contour[-1]


@pytest.mark.skipif(mujoco.__version__ != "3.17.0", reason="golden traces belong to MuJoCo 3.17.0")
def test_regress_golden_traces(golden_twice):
    """Equal bytes, or equal to nanometres on a machine whose elementary functions round differently."""
    for name in ("golden_circle", "golden_pin"):
        assert (golden_twice[0] / f"{name}.contour.csv").read_bytes() == (GOLDEN / f"{name}.contour.csv").read_bytes()
        made, kept = (golden_twice[0] / f"{name}.csv").read_bytes(), (GOLDEN / f"{name}.csv").read_bytes()
        if made != kept:
            made, kept = (np.genfromtxt(io.BytesIO(content), delimiter=",", names=True) for content in (made, kept))
            for column, tolerance in _TOLERANCES.items():
                np.testing.assert_allclose(made[column], kept[column], rtol=0.0, atol=tolerance, err_msg=f"{name}: {column}")
        made, kept = (json.loads((folder / f"{name}.json").read_text()) for folder in (golden_twice[0], GOLDEN))
        for key in ("name", "role", "group", "object", "face", "seed", "rate_hz", "rows", "whisker", "scene"):
            assert made[key] == kept[key]


_TOLERANCES = {name: 1e-12 if name == "moment_z_n_m" else 1e-7 if name == "truth_force_n" else 1e-9 for name, _ in COLUMNS}


def test_verif_up_to_date_traces_are_left_alone(write_scene, tmp_path, capsys):
    scene = write_scene()
    out = tmp_path / "out"
    command = ["simulate", str(scene), "--out", str(out), "--jobs", "1"]
    assert main(command) == 0
    first = (out / "sweep.csv").stat().st_mtime_ns
    assert main(command) == 0
    assert "up to date" in capsys.readouterr().err
    assert (out / "sweep.csv").stat().st_mtime_ns == first
    (out / "sweep.csv").write_text("damaged")
    assert main(command) == 0
    assert (out / "sweep.csv").read_text().startswith("t_s,")
    write_scene(seed=1)
    assert main(command) == 0
    assert json.loads((out / "sweep.json").read_text())["seed"] == 1
    assert not list(out.glob(".*"))


def test_verif_seeds_name_the_traces_however_many_there_are(tmp_path):
    """Names of traces contain the seed if the suite states seeds; the Rust side reads the same names."""
    scene = json.loads((SCENES / "golden_pin.json").read_text())
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    for seeds, names in [(None, ["golden_pin"]), ([3], ["golden_pin_03"]), ([0, 112], ["golden_pin_00", "golden_pin_112"])]:
        entry = {"scene": "scene.json"} | ({} if seeds is None else {"seeds": seeds})
        (tmp_path / "suite.json").write_text(json.dumps({"format": 1, "name": "suite", "scenes": [entry]}))
        _, runs = load_runs(tmp_path / "suite.json")
        assert [run.name for run in runs] == names
