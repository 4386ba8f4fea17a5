"""Killed and interrupted generators: existing files are complete, and a rerun produces the same bytes as an uninterrupted run."""

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_arm import SHORT

from whisker_sim.arm.recording import is_up_to_date, write_recording
from whisker_sim.arm.simulate import simulate_passage
from whisker_sim.cli import main
from whisker_sim.errors import SimulationError
from whisker_sim.products import make_trace, product_of
from whisker_sim.runs import load_runs
from whisker_sim.simulate import _warnings, simulate
from whisker_sim.sweep import build_sweep_model
from whisker_sim.trace import remove_leftovers

from conftest import REPOSITORY, SCENES, SWEEP

TRACES = 60
KILLS = 20
LONGEST_S = 120.0
"""Longer than any run of the suite on a slow machine."""


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    """A suite of many traces that take about 50 ms each."""
    folder = tmp_path_factory.mktemp("suite")
    scene = json.loads((SCENES / "pin_curved.json").read_text()) | {"name": "short", "duration_s": 1.3}
    (folder / "scene.json").write_text(json.dumps(scene))
    suite = {"format": 1, "name": "suite", "scenes": [{"scene": "scene.json", "seeds": list(range(TRACES))}]}
    path = folder / "suite.json"
    path.write_text(json.dumps(suite))
    return path


@pytest.fixture(scope="module")
def uninterrupted(suite, tmp_path_factory):
    """Files of an uninterrupted run."""
    folder = tmp_path_factory.mktemp("uninterrupted")
    assert _start(suite, folder).wait(timeout=LONGEST_S) == 0
    return _contents(folder)


def test_verif_killed_twenty_times_same_bytes(suite, uninterrupted, tmp_path):
    """SIGKILL of all processes at twenty random times: visible files are complete each time, and the final bytes are the same."""
    rng = np.random.default_rng(20)
    # Number of finished traces at each kill; the kills are later by up to the time of a trace, and leave some traces to do.
    finished = np.sort(rng.integers(0, TRACES - 6, KILLS))
    for count, delay_s in zip(finished, rng.uniform(0.0, 0.1, KILLS), strict=True):
        process = _start(suite, tmp_path)
        _wait_for(lambda count=count: len(list(tmp_path.glob("*.json"))) >= count, process)
        time.sleep(delay_s)
        assert process.poll() is None, "the run ended before it was killed"
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        _assert_whole(tmp_path)
    assert _start(suite, tmp_path).wait(timeout=LONGEST_S) == 0
    assert _contents(tmp_path) == uninterrupted


def test_verif_a_killed_suite_in_space_has_the_same_bytes(tmp_path):
    """SIGKILL of all processes at three times, on a mesh whose file belongs to the inputs of the traces."""
    scene = json.loads((SCENES / "space/mesh_straight.json").read_text())
    (tmp_path / "meshes").mkdir()
    mesh = tmp_path / "meshes/icosahedron.obj"
    shutil.copy(SCENES / "space/meshes/icosahedron.obj", mesh)
    motion = {"kind": "smooth", "contact_arc_m": 0.0487, "depth_m": 0.003, "translation_m": 3e-4, "rotation_rad": 3e-3}
    scene |= {"name": "short", "motion": motion, "duration_s": 2.5, "simulation": "fast"}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    suite = tmp_path / "suite.json"
    suite.write_text(json.dumps({"format": 1, "name": "suite", "scenes": [{"scene": "scene.json", "seeds": list(range(8))}]}))
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert _start(suite, whole).wait(timeout=LONGEST_S) == 0
    for count in (1, 3, 5):
        process = _start(suite, out)
        _wait_for(lambda count=count: len(list(out.glob("*.json"))) >= count, process)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        _assert_whole(out)
    assert _start(suite, out).wait(timeout=LONGEST_S) == 0
    assert _contents(out) == _contents(whole)
    # Another mesh gives other traces.
    mesh.write_text(mesh.read_text().replace("v ", "v  ", 1))
    assert _untouched(out, suite) == 8
    mesh.write_text("".join(f"v {1.01 * float(x)} {y} {z}\n" for x, y, z in _vertices(mesh)) + _faces(mesh))
    assert _untouched(out, suite) == 0


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0])
def test_robust_interrupted_at_any_moment(suite, uninterrupted, tmp_path, delay_s):
    """Ctrl-C during imports, start of workers or simulation: code 130, at most one line, complete traces, no leftovers."""
    process = _start(suite, tmp_path, stderr=subprocess.PIPE)
    time.sleep(delay_s)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=LONGEST_S)
    # A shell reports an end by a signal as 128 plus its number.
    assert process.returncode in (130, -signal.SIGINT), error
    assert "Traceback" not in error
    lines = [line for line in error.splitlines() if "in contact" not in line and not line.startswith("simulate: ")]
    assert lines in ([], ["interrupted; finished files are kept"])
    _assert_whole(tmp_path)
    made = _contents(tmp_path)
    assert made == {name: uninterrupted[name] for name in made}
    assert {name.split(".")[0] for name in made} == {path.stem for path in tmp_path.glob("*.json")}


def test_robust_workers_do_not_outlive_the_main_process(suite, tmp_path):
    """If only the main process is killed, no worker and no incomplete file remain."""
    process = _start(suite, tmp_path, stderr=subprocess.DEVNULL)
    _wait_for(lambda: list(tmp_path.glob("*.json")), process)
    process.kill()
    process.wait()
    _wait_for(lambda: not _group_lives(process.pid))
    _assert_whole(tmp_path)


def test_robust_killed_while_writing(write_scene, tmp_path, monkeypatch):
    """Kill between writing and renaming a temporary file: a rerun makes the trace and removes the leftovers."""
    out = tmp_path / "out"
    command = ["simulate", str(write_scene()), "--out", str(out), "--jobs", "1"]
    assert main(command) == 0

    def die(*_):
        raise SystemExit

    for already_renamed in range(3):
        # Other inputs give other rows: the old sidecar must not remain beside them.
        write_scene(motion={**SWEEP["motion"], "stroke_m": 0.005 + 1e-4 * already_renamed})
        with monkeypatch.context() as patch:
            patch.setattr("os.replace", _after(already_renamed, os.replace, die))
            # A process that is killed does not clean up.
            patch.setattr("os.unlink", lambda path, unlink=os.unlink: None if str(path).endswith(".tmp") else unlink(path))
            with pytest.raises(SystemExit):
                main(command)
        assert len(list(out.glob(".*.tmp"))) == 1
        _assert_whole(out)
        assert main(command) == 0
        assert sorted(path.name for path in out.iterdir()) == ["sweep.contour.csv", "sweep.csv", "sweep.json"]


def test_robust_killed_while_writing_a_recording(tmp_path, monkeypatch):
    """No old sidecar remains beside new rows, regardless of how many files of a recording were written."""
    scene, out = tmp_path / "scene.json", tmp_path / "out"
    scene.write_text(json.dumps(SHORT))
    run = load_runs(scene)[1][0]
    passed = simulate_passage(run)
    write_recording(out, run, passed)
    whole = _contents(out)
    assert is_up_to_date(out, run)
    other = replace(passed, dq_rad_s=1.5 * passed.dq_rad_s)
    for whisker in other.whiskers.values():
        whisker.base_twist[:] *= 1.5

    def die(*_):
        raise SystemExit

    for already_renamed in range(0, len(whole), 5):
        with monkeypatch.context() as patch:
            patch.setattr("os.replace", _after(already_renamed, os.replace, die))
            patch.setattr("os.unlink", lambda path, unlink=os.unlink: None if str(path).endswith(".tmp") else unlink(path))
            with pytest.raises(SystemExit):
                write_recording(out, run, other)
        assert len(list(out.glob(".*.tmp"))) == 1
        assert not (out / "short.json").exists()
        for path in out.glob("short_*.json"):
            rows = (out / f"{path.stem}.csv").read_bytes()
            assert hashlib.sha256(rows).hexdigest() == json.loads(path.read_text())["csv_sha256"]
        assert not is_up_to_date(out, run)
        for name, content in whole.items():
            (out / name).write_bytes(content)
        for leftover in out.glob(".*.tmp"):
            leftover.unlink()
    write_recording(out, run, other)
    assert is_up_to_date(out, run)


def test_robust_unstable_step_fails_with_name_and_time(make_run, tmp_path, monkeypatch):
    """A warning from MuJoCo fails the trace with its name and time; no files are left."""

    def unstable(scene) -> mujoco.MjModel:
        model = build_sweep_model(scene)
        # With an explicit integrator the hinges would need time steps of 5 us.
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        return model

    monkeypatch.setattr("whisker_sim.simulate.build_sweep_model", unstable)
    outcome = make_trace(tmp_path / "out", make_run())
    assert outcome.code == 1
    assert re.search(r"sweep\.json: sweep: MuJoCo warns: .*unstable.* Time = 0\.\d+", outcome.line)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("warning", "words"),
    [
        ("Nothing is left", "MuJoCo warns between 0.0000 s and 1.0000 s: Nothing is left"),
        ("Unstable. Time = 0.2500.", "MuJoCo warns: Unstable. Time = 0.2500."),
    ],
)
def test_verif_warnings_state_their_time(make_run, monkeypatch, warning, words):
    """If MuJoCo does not state it, the message states the span of time that was integrated."""

    def warn(*arguments, **options):
        _warnings.append(warning)
        return rollout(*arguments, **options)

    rollout = mujoco.rollout.rollout
    monkeypatch.setattr("mujoco.rollout.rollout", warn)
    with pytest.raises(SimulationError) as error:
        simulate(make_run())
    assert str(error.value) == words


def test_verif_only_own_leftovers_are_removed(tmp_path):
    """Another process may be writing another trace into the same folder."""
    for name in (".pin.csv.x1.tmp", ".pin.contour.csv.x2.tmp", ".pin_00.csv.x3.tmp", "pin.csv"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path, "pin")
    assert {path.name for path in tmp_path.iterdir()} == {".pin_00.csv.x3.tmp", "pin.csv"}


def _untouched(folder: Path, suite: Path) -> int:
    """Number of up-to-date traces."""
    return sum(product_of(run).is_up_to_date(folder, run) for run in load_runs(suite)[1])


def _vertices(mesh: Path) -> list[list[str]]:
    return [line.split()[1:] for line in mesh.read_text().splitlines() if line.startswith("v ")]


def _faces(mesh: Path) -> str:
    return "".join(line for line in mesh.read_text().splitlines(keepends=True) if line.startswith("f "))


def _start(suite: Path, folder: Path, **options) -> subprocess.Popen:
    command = [sys.executable, "-m", "whisker_sim", "simulate", str(suite), "--out", str(folder), "--jobs", "2"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / "sim")}
    return subprocess.Popen(command, env=environment, start_new_session=True, text=True, **options)


def _wait_for(condition, process=None) -> None:
    """Waits for `condition`; fails after `LONGEST_S` or if `process` ends before."""
    deadline_s = time.monotonic() + LONGEST_S
    while not condition():
        assert process is None or process.poll() is None, "the run ended before its time"
        assert time.monotonic() < deadline_s
        time.sleep(0.002)


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def _after(calls: int, first, then):
    """A function that calls `first` for the first `calls` calls and `then` afterwards."""
    left = iter([first] * calls)
    return lambda *arguments: next(left, then)(*arguments)


def _assert_whole(folder: Path) -> None:
    """Every sidecar is readable, and its files match their hashes."""
    for path in folder.glob("*.json"):
        sidecar = json.loads(path.read_text())
        assert hashlib.sha256((folder / f"{path.stem}.csv").read_bytes()).hexdigest() == sidecar["csv_sha256"]
        contour = sidecar.get("contour")
        if contour is None:
            continue
        assert hashlib.sha256((folder / contour["file"]).read_bytes()).hexdigest() == contour["sha256"]


def _contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}
