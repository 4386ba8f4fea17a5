"""Fixtures of the tests: a calibrated whisker and a simulated sweep."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import whisker_contact as wc

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "datasets" / "golden"

PIN_RADIUS_M = 0.5e-3 + 0.125e-3


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--suite", help="suite in datasets/ whose replays are compared with the command's (default: smoke)")


def calibration_lines(whisker: wc.Whisker, sign: float, lines: int = 16) -> list[tuple[np.ndarray, np.ndarray]]:
    """Contacts and readings of presses at evenly spaced arc lengths, by the exact elastica."""
    result = []
    for arc_m in np.linspace(0.03, 0.076, lines):
        force_n = sign * 8e-5 * np.arange(24) * (0.03 / arc_m) ** 2
        pressed = wc.press(whisker, np.full(24, arc_m), force_n, strict=True)
        result.append((pressed.point, pressed.moment_n_m))
    return result


@pytest.fixture(scope="session")
def whisker() -> wc.Whisker:
    return wc.Whisker.straight()


@pytest.fixture(scope="session")
def calibration(whisker: wc.Whisker) -> wc.Calibration:
    lines = {"left": calibration_lines(whisker, -1.0), "right": calibration_lines(whisker, 1.0)}
    return wc.fit_calibration(whisker, lines, PIN_RADIUS_M, models=["polynomial"])


def sweep_base(t_s: np.ndarray) -> np.ndarray:
    """Poses of a base that approaches an object on its left for 0.5 s and then moves to and fro."""
    roam_s = np.maximum(t_s - 0.5, 0.0)
    y_m = 12e-3 * np.minimum(t_s, 0.5) - 1.5e-3 + 1e-3 * np.sin(12.0 * roam_s)
    return np.column_stack([8e-3 * np.sin(8.0 * roam_s), y_m, 0.03 * np.sin(10.0 * roam_s)])


@pytest.fixture(scope="session")
def simulated(whisker: wc.Whisker) -> wc.Trace:
    t_s = np.arange(0.0, 4.0, 0.004)
    return wc.simulate(whisker, wc.Shape.pin([0.055, 0.0]), t_s, sweep_base(t_s), "left", name="pin")


@pytest.fixture(scope="session")
def trial(simulated: wc.Trace, calibration: wc.Calibration) -> wc.Trial:
    return wc.Trial(simulated, calibration, noise=0.01, seed=1)


@pytest.fixture(scope="session")
def command() -> Path:
    """The command `whisker`: `WHISKER`, or that of the repository's release build."""
    program = Path(os.environ.get("WHISKER", ROOT / "target" / "release" / "whisker"))
    if not program.is_file():
        pytest.skip(f"{program}: not built")
    return program


@pytest.fixture(scope="session")
def in_repository() -> Callable[[str], Path]:
    """Path of a file that a run of the tests of the repository makes; the test is skipped without it."""

    def path(name: str) -> Path:
        found = ROOT / name
        if not found.exists():
            pytest.skip(f"{found}: not made; `cargo xtask test` makes it")
        return found

    return path


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays have equal shapes and numbers, with NaN equal to NaN."""
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
