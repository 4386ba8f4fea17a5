"""Command line: invalid input, exit codes, interruption."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_arm import SHORT

from whisker_sim import products
from whisker_sim.cli import main
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate

from conftest import REPOSITORY, SCENES

PIN = {"shape": "pin"}
SWEEP = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006}

WRONG = {
    "unknown key": ({"colour": "red"}, ["scene.json:18:3", "colour", "unknown key", "expected one of", "whisker"]),
    "unknown key of a shape": ({"object": {"shape": "pin", "size_m": 1}}, ["object.size_m", "unknown key", "radius_m"]),
    "unknown shape": ({"object": {"shape": "heart"}}, ["object.shape", "pin, circle, rectangle", '"heart"']),
    "unknown motion": (
        {"motion": {"kind": "dance"}},
        [
            "motion.kind",
            "calibration_grid, excursions, increments_beam_test, lateral_sweep, lift_offs, rub, smooth, stations",
            '"dance"',
        ],
    ),
    "unknown whisker": ({"whisker": "cat"}, ["scene.json:7:3", "whisker", "straight, curved, stanford", "'cat'"]),
    "unknown role": ({"role": "test"}, ["role", "trial", "calibration", '"test"']),
    "wrong version": ({"format": 2}, ["scene.json:2:3", "format", "expected one of 1", "found 2"]),
    "missing key": ({"face": None}, ["expected the key 'face'"]),
    "wrong type": ({"group": 3}, ["group", "expected str", "found 3"]),
    "negative length": (
        {"whisker": {"preset": "straight", "name": "w", "length_m": -0.1}},
        ["scene.json", "whisker.length_m", "> 0.0", "found -0.1"],
    ),
    "lengths that do not add up": (
        {"whisker": {"preset": "straight", "name": "w", "curvature": [{"length_m": 0.01, "curvature_per_m": 1.0}]}},
        ["whisker.curvature", "0.08", "0.01"],
    ),
    "no duration": ({"motion": {"kind": "smooth", "arc_min_m": 0.04, "arc_max_m": 0.05}}, ["duration_s", "smooth"]),
    "surplus duration": ({"duration_s": 3.0}, ["duration_s", "lateral_sweep", "3.0"]),
    "uneven rate": ({"rate_hz": 300}, ["rate_hz", "whole number", "6.66667"]),
    "contact beyond the tip": (
        {"motion": {**SWEEP, "contact_arc_m": 0.09}},
        ["scene.json:14:5", "motion.contact_arc_m", "0.08", "0.09"],
    ),
    "dented polygon": (
        {"object": {"shape": "convex_polygon", "vertices_m": [[0, 0], [0.01, 0], [0.002, 0.002], [0, 0.01]]}},
        ["object.vertices_m", "left turn", "vertex 2"],
    ),
    "name that is a path": ({"name": "../sweep"}, ["name", "found"]),
    "huge seed": ({"seed": 2**60}, ["seed", "<="]),
    "minute circle": ({"object": {"shape": "circle", "radius_m": 1e-200}}, ["scene.json:10:5", "object.radius_m", ">= 1e-05"]),
    "thin polygon": (
        {"object": {"shape": "convex_polygon", "vertices_m": [[0, 0], [0.01, 0.01], [0.009997, 0.010003]]}},
        ["object.vertices_m: expected an outline at least 1e-05 m broad", "4.24e-06"],
    ),
    "yaw of an object in degrees": ({"object": {**PIN, "yaw_rad": 90.0}}, ["object.yaw_rad", "<= 12.56", "found 90.0"]),
    "yaw of a motion in degrees": ({"motion": {**SWEEP, "yaw_rad": 90.0}}, ["motion.yaw_rad", "<= 12.56", "found 90.0"]),
    "violent vibration": ({"vibration": {"acceleration_m_s2": 1e3}}, ["vibration.acceleration_m_s2", "<= 30", "found 1000.0"]),
    "hollow name": ({"name": ""}, ["name: expected letters, digits, '_' and '-', the first a letter or a digit, found \"\""]),
}


IMPLAUSIBLE = {
    "modulus in GPa": ({"youngs_modulus_pa": 60.0}, ["youngs_modulus_pa: expected 1000 to 1e+13 Pa, found 60"]),
    "modulus of nothing": ({"youngs_modulus_pa": 1e14}, ["youngs_modulus_pa: expected 1000 to 1e+13 Pa, found 1e+14"]),
    "density in g/mm3": ({"density_kg_m3": 0.00645}, ["density_kg_m3: expected 1 to 30000 kg/m3, found 0.00645"]),
    "diameter in mm": ({"root_diameter_m": 0.25}, ["root_diameter_m: expected 1e-06 to 0.1 m, found 0.25"]),
    "diameter of an atom": ({"tip_diameter_m": 1e-10}, ["tip_diameter_m: expected 1e-06 to 0.1 m, found 1e-10"]),
    "a cone": (
        {"length_m": 0.05, "root_diameter_m": 0.06, "tip_diameter_m": 0.001},
        ["tip_diameter_m: expected a radius that changes by less than 0.5 m per metre of length_m, found 0.59"],
    ),
    "a spiral": (
        {"curvature": [{"length_m": 0.08, "curvature_per_m": 50.0}]},
        ["curvature: expected arcs that turn by at most pi rad, found 4"],
    ),
    "an arc within the wire": (
        {"curvature": [{"length_m": 1e-4, "curvature_per_m": -9e3}, {"length_m": 0.0799, "curvature_per_m": 0.0}]},
        ["curvature: expected less than 8000 per metre, the inverse of the whisker's radius, found 9000"],
    ),
}


@pytest.mark.parametrize("case", IMPLAUSIBLE)
def test_robust_implausible_whisker(write_scene, tmp_path, assert_rejected, case):
    changes, words = IMPLAUSIBLE[case]
    whisker = {"preset": "straight", "name": "w", **changes}
    assert_rejected(write_scene(whisker=whisker).rename(tmp_path / "scene.json"), ["scene.json:", *words])


LONG = {
    "a rest": (
        {"kind": "increments_beam_test", "total_x_m": 0.002, "total_y_m": 0.0, "pause_s": 1e12},
        ["scene.json:16:5", "motion.pause_s: expected at most 10000000 time steps of the whole motion, found 2e+15"],
    ),
    "the sum of rests": (
        {"kind": "stations", "contact_arc_m": 0.05, "rounds": 1000, "stations": [{"depth_m": 0.003, "pause_s": 9.0}]},
        ["motion.stations: expected at most 10000000 time steps of the whole motion, found 1001"],
    ),
    "the sum of moves": (
        {**SWEEP, "strokes": 1000, "peak_speed_m_s": 0.001},
        ["scene.json:17:5", "motion.peak_speed_m_s: expected at most 10000000 time steps of the whole motion, found 1000"],
    ),
    "an endless rest": ({"kind": "rub", "contact_arc_m": 0.05, "press_m": 0.005, "dwell_s": 1e308}, ["motion.dwell_s", "inf"]),
}


@pytest.mark.parametrize("case", LONG)
def test_robust_a_motion_that_is_too_long(write_scene, tmp_path, assert_rejected, case):
    """Moves and rests count, alone and together; the error names the parameter."""
    motion, words = LONG[case]
    assert_rejected(write_scene(motion=motion).rename(tmp_path / "scene.json"), words)


@pytest.mark.parametrize("case", WRONG)
def test_robust_wrong_scene(write_scene, tmp_path, assert_rejected, case):
    """The error states file, key, expected and found values."""
    changes, words = WRONG[case]
    assert_rejected(write_scene(**changes).rename(tmp_path / "scene.json"), words)


RAW = {
    "not a number": ('{"format": 1,\n "rate_hz": NaN}', [":2:13", "finite", "NaN"]),
    "infinite": ('{"format": 1,\n "rate_hz": 1e999}', [":2:13", "finite", "1e999"]),
    "broken": ('{"format": 1,\n "name" "x"}', [":2:9", "expected JSON", '"x"']),
    "empty": ("", [":1:1", "the end of the file"]),
    "a list": ("[]", ["expected an object", "list"]),
    "repeated key": ('{"format": 1,\n "format": 1}', [":2:2", "'format' once", "2 times"]),
    "repeated key further inside": ('{"name": "x",\n "object": {"name": 1,\n  "name": 2}}', [":3:3", "'name' once", "2 times"]),
    "endless number": ('{"format": 1,\n "seed": -' + "1" * 5000 + "}", [":2:10", "at most 4300 digits, found one of 5000"]),
    "number in a text, too": ('{"name": "1e999",\n "rate_hz": 1e999}', [":2:13", "finite", "1e999"]),
    "nothing": ("{}", ["expected the key 'format', found none\n"]),
    "suite of a random suite": (
        '{"format": 1, "name": "s", "scenes": [{"scene": "random.json"}]}',
        ["scenes[0].scene: expected a scene's file, found the suite 'random.json'"],
    ),
    "empty suite": ('{"format": 1, "name": "s", "scenes": []}', ["scenes", "found []"]),
    "suite without file": ('{"format": 1, "name": "s", "scenes": [{"scene": "no.json"}]}', ["scenes[0].scene", "no.json"]),
}


@pytest.mark.parametrize("case", RAW)
def test_robust_wrong_document(tmp_path, assert_rejected, case):
    text, words = RAW[case]
    (tmp_path / "random.json").write_text('{"format": 1, "name": "r", "random": {"seed": 1, "sets": 1}}')
    path = tmp_path / "scene.json"
    path.write_text(text)
    assert_rejected(path, words)


NESTED = """{
  "format": 1, "name": "sweep", "role": "trial", "group": "test", "face": "left",
  "replay": {"noise": 0.01, "miscalibration": {}},
  "whisker": {"name": "w", "preset": "straight",
    "curvature": [{"length_m": 0.04, "curvature_per_m": 0.0},
      {"curvature_per_m": 0.0, "length_m": LENGTH}]},
  "object": {"shape": "convex_polygon", "yaw_rad": 0.0,
    "vertices_m": [[0, 0], [0.01, 0],
      [0.01, Y], [0, 0.01]]},
  "motion": {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006, "yaw_rad": YAW}
}
"""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"LENGTH": "true"}, [":6:32: whisker.curvature[1].length_m", "found true"]),
        ({"YAW": '"north"'}, [":10:81: motion.yaw_rad", 'found "north"']),
        ({"Y": "11"}, [":9:14: object.vertices_m[2][1]", "found 11"]),
        ({"Y": "-0.01"}, [":8:5: object.vertices_m: expected a left turn"]),
    ],
)
def test_robust_positions_of_keys_that_occur_more_than_once(tmp_path, assert_rejected, changes, words):
    """The position is that of the key or element which is wrong, not of another one of the same name."""
    text = NESTED
    for name, value in ({"LENGTH": "0.04", "YAW": "0.0", "Y": "0.01"} | changes).items():
        text = re.sub(rf"\b{name}\b", value, text)
    path = tmp_path / "scene.json"
    path.write_text(text)
    assert_rejected(path, words)


def test_robust_files_that_cannot_be_read(tmp_path, capsys):
    assert main(["check", str(tmp_path / "none.json")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe")
    assert main(["check", str(tmp_path / "binary.json")]) == 2
    assert "UTF-8" in capsys.readouterr().err


def test_robust_repeated_trace_names(write_scene, tmp_path, capsys):
    scene = str(write_scene())
    assert main(["simulate", scene, scene, "--out", str(tmp_path)]) == 2
    assert "'sweep' 2 times" in capsys.readouterr().err


def test_robust_names_that_a_recording_takes(write_scene, tmp_path, capsys):
    """In a suite, a trace must not have the name of a whisker's trace of a recording."""
    (tmp_path / "arm.json").write_text(json.dumps(SHORT))
    write_scene(name="short_left_1")
    path = tmp_path / "suite.json"
    entries = [{"scene": "arm.json"}, {"scene": "short_left_1.json"}]
    path.write_text(json.dumps({"format": 1, "name": "suite", "scenes": entries}))
    assert main(["check", str(path)]) == 2
    assert capsys.readouterr().err == f"error: {path}: scenes[1]: expected traces of different names, found 'short_left_1' twice\n"
    assert main(["simulate", str(tmp_path / "arm.json"), str(tmp_path / "short_left_1.json"), "--out", str(tmp_path / "out")]) == 2
    assert "'short_left_1' 2 times" in capsys.readouterr().err


def test_robust_errors_about_no_key_are_one_line(write_scene, capsys, monkeypatch):
    """A general error of a plan states the file."""

    def fail(_):
        raise ValueError("Singular matrix")

    monkeypatch.setattr("whisker_sim.scene.Scene.plan", fail)
    path = write_scene()
    for command in (["check", str(path)], ["simulate", str(path), "--jobs", "1", "--out", str(path.parent / "out")]):
        assert main(command) == 2
        assert capsys.readouterr().err.endswith(f"{path}: Singular matrix\n")


def test_robust_failed_trace_among_good_ones(write_scene, tmp_path, capsys):
    """A sweep that slips off the tip fails with name and time and leaves no files; the others are finished: exit code 3."""
    good = write_scene()
    bad = write_scene(name="slips", whisker="curved", motion={**SWEEP, "contact_arc_m": 0.076, "stroke_m": 0.02})
    out = tmp_path / "out"
    assert main(["simulate", str(bad), "--out", str(out), "--jobs", "1"]) == 1
    assert main(["simulate", str(good), str(bad), "--out", str(out), "--jobs", "1"]) == 3
    error = capsys.readouterr().err
    assert "slips" in error
    assert " s" in error
    assert {path.name for path in out.iterdir()} == {"sweep.csv", "sweep.json", "sweep.contour.csv"}


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (np.linalg.LinAlgError("Singular\nmatrix"), "LinAlgError: Singular matrix"),
        (FloatingPointError("underflow"), "FloatingPointError: underflow"),
        (ValueError("cannot convert float NaN to integer"), "ValueError: cannot convert float NaN to integer"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_robust_an_unexpected_error_concerns_one_trace(write_scene, tmp_path, capsys, monkeypatch, error, text):
    """The message names the scene, the trace, the type and the text; the other trace is finished: exit code 3."""

    def fail_or_simulate(run):
        if run.name == "fails":
            raise error
        return simulate(run)

    product = products.PRODUCTS[Scene]
    monkeypatch.setitem(products.PRODUCTS, Scene, product._replace(simulate=fail_or_simulate))
    scenes, out = [write_scene(name="fails"), write_scene()], tmp_path / "out"
    assert main(["simulate", *map(str, scenes), "--out", str(out), "--jobs", "1"]) == 3
    lines = capsys.readouterr().err.splitlines()
    message = f"error: {scenes[0]}: fails: unexpected {text} ({Path(__file__).name}:"
    assert any(line.startswith(message) for line in lines)
    assert "1 of 2 traces failed" in lines
    assert (out / "sweep.json").is_file()


def test_robust_interruption_leaves_whole_traces(tmp_path):
    """Ctrl-C ends with code 130; all existing traces are complete."""
    command = [sys.executable, "-m", "whisker_sim", "simulate", str(SCENES / "suites" / "standard.json"), "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / "sim")}
    process = subprocess.Popen([*command, "--jobs", "2"], env=environment, stderr=subprocess.PIPE, start_new_session=True)
    deadline_s = time.monotonic() + 60.0
    while not list(tmp_path.glob("*.json")) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert b"Traceback" not in error
    sidecars = list(tmp_path.glob("*.json"))
    assert 0 < len(sidecars) < 34
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        f"{path.stem}.{end}" for path in sidecars for end in ("csv", "contour.csv", "json")
    )


def test_verif_suites_are_valid(capsys):
    assert main(["check", *(str(path) for path in sorted((SCENES / "suites").glob("*.json")))]) == 0
    assert "suite of 34 runs" in capsys.readouterr().out


def test_verif_every_scene_is_valid(capsys):
    scenes = sorted(SCENES.glob("*.json"))
    assert main(["check", *map(str, scenes)]) == 0
    assert all(json.loads(path.read_text())["name"] == path.stem for path in scenes)


def test_verif_list_names_every_row(capsys):
    assert main(["list"]) == 0
    listed = capsys.readouterr().out
    for word in ("straight", "stanford", "regular_polygon", "convex_polygon", "calibration_grid", "contact_arc_m"):
        assert word in listed


def test_robust_viewer_without_display(monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if not sys.platform.startswith("linux"):
        pytest.skip("other systems always have a display")
    assert main(["view", str(SCENES / "golden_circle.json")]) == 1
    assert "display" in capsys.readouterr().err
