"""Platform with third-party programs in separate processes: OctoPrint's virtual printer, and Printrun's client.

They are large and under other licences, and are installed only if `WHISKER_FOREIGN=1`, into a virtual environment of their own.
"""

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOREIGN = ROOT / "tests/foreign"
VENV = ROOT / "target/foreign/venv"
PYTHON = VENV / "bin/python"
PACKAGES = [["pyserial", "octoprint==1.11.8"], ["--no-deps", "printrun==2.2.0"]]
"""Printrun without the packages of its user interface."""

pytestmark = pytest.mark.skipif(os.environ.get("WHISKER_FOREIGN") != "1", reason="WHISKER_FOREIGN=1 installs third-party programs")


@pytest.fixture(scope="module")
def python() -> Path:
    """A Python interpreter with the third-party programs."""
    if not (VENV / "complete").exists():
        subprocess.run([sys.executable, "-m", "venv", VENV], check=True)
        for packages in PACKAGES:
            subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", *packages], check=True)
        (VENV / "complete").touch()
    return PYTHON


@pytest.fixture(scope="module")
def whisker() -> Path:
    """The program `whisker`."""
    subprocess.run(["cargo", "build", "--quiet", "--release", "--bin", "whisker"], cwd=ROOT, check=True)
    return ROOT / "target/release/whisker"


@pytest.fixture
def rig(whisker: Path) -> Iterator[dict[str, str]]:
    """Ports of the emulated rig, by name."""
    process = subprocess.Popen([whisker, "platform", "emulate"], stdout=subprocess.PIPE, text=True)
    ports = dict(process.stdout.readline().split() for _ in range(2))
    yield ports
    process.send_signal(signal.SIGINT)
    assert process.wait(10) == 0


def test_val_our_driver_drives_octoprints_printer(python: Path, whisker: Path, rig: dict[str, str], tmp_path: Path) -> None:
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    command = [python, FOREIGN / "octoprint_printer.py"]
    printer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        ports = ["--printer", printer.stdout.readline().strip(), "--sensor", rig["sensor"]]
        out = tmp_path / "log"
        done = subprocess.run(
            [whisker, "platform", "run", *ports, "--speed", "15000", "--out", out], capture_output=True, text=True, timeout=300
        )
    finally:
        printer.kill()
        printer.wait()
    assert done.returncode == 0, done.stderr
    contacts = json.loads((out / "log.json").read_text())["contacts"]
    assert [round(1e3 * contact["distance_m"], 3) for contact in contacts] == [round(145 - 100 * k / 15, 3) for k in range(16)]
    with (out / "head.csv").open() as file:
        pushed = {row["y_m"] for row in csv.DictReader(file) if float(row["x_m"]) == 0.153}
    assert len(pushed) == 16


def test_val_printruns_client_drives_our_printer(python: Path, rig: dict[str, str]) -> None:
    command = [python, FOREIGN / "printcore_client.py", rig["printer"]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    # The last of the sixty moves.
    assert "X:23.00 Y:14.00" in done.stdout
    assert "Resend" not in done.stdout
    assert "Error" not in done.stdout
