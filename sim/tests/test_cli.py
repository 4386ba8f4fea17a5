"""Command line: invalid input, exit codes, interruption."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from test_arm import SHORT

from whisker_sim.cli import main

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
}


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
    "repeated key": ('{"format": 1,\n "format": 1}', ["'format' once", "2 times"]),
    "empty suite": ('{"format": 1, "name": "s", "scenes": []}', ["scenes", "found []"]),
    "suite without file": ('{"format": 1, "name": "s", "scenes": [{"scene": "no.json"}]}', ["scenes[0].scene", "no.json"]),
}


@pytest.mark.parametrize("case", RAW)
def test_robust_wrong_document(tmp_path, assert_rejected, case):
    text, words = RAW[case]
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
