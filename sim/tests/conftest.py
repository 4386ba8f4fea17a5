"""Fixtures and constants shared by the tests."""

import json
import math
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from whisker_sim import progress
from whisker_sim.cli import main
from whisker_sim.runs import Run, load_runs

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = REPOSITORY / "scenes"

SWEEP = {
    "format": 1,
    "name": "sweep",
    "role": "trial",
    "group": "test",
    "face": "left",
    "whisker": "straight",
    "object": {"shape": "circle", "radius_m": 0.015},
    "motion": {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006, "strokes": 1},
}
"""A short scene that the tests modify."""


@pytest.fixture(scope="session", autouse=True)
def _interruptible() -> Iterator[None]:
    """Restores the handling of Ctrl-C, which processes started in the background by a shell script ignore and would pass on."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def _without_estimates(monkeypatch) -> None:
    """Suppresses estimates of the time left, whose lines on stderr depend on the speed of the machine."""
    monkeypatch.setattr(progress, "_LINE_S", math.inf)


@pytest.fixture
def write_scene(tmp_path):
    """A function that writes `SWEEP` with keys replaced (or removed by `None`) and returns its path."""

    def write(**changes) -> Path:
        scene = {key: value for key, value in {**SWEEP, **changes}.items() if value is not None}
        path = tmp_path / f"{scene.get('name', 'scene')}.json"
        path.write_text(json.dumps(scene, indent=2))
        return path

    return write


@pytest.fixture
def make_run(write_scene):
    """A function that returns a run of `SWEEP` with keys replaced."""

    def make(**changes) -> Run:
        return load_runs(write_scene(**changes))[1][0]

    return make


@pytest.fixture
def assert_rejected(capsys):
    """A function that checks that `check` rejects a file with one line on stderr that contains `words`, and exit code 2."""

    def check(path: Path, words: list[str]) -> None:
        assert main(["check", str(path)]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith(f"error: {path}")
        assert captured.err.count("\n") == 1
        for word in words:
            assert word in captured.err

    return check
