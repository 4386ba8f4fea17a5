"""Recordings, live node and Foxglove feed with third-party programs.

These are `rosbags`, `mcap-ros2-support`, `rosless`, `cyclonedds` and `robo-ws-bridge`.

They are installed only if `WHISKER_FOREIGN=1`, into a virtual environment of their own. The node runs in a network namespace with
only a loopback interface, which isolates it from other nodes; the feed is bound to the loopback interface.
"""

import csv
import math
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOREIGN = ROOT / "tests/foreign"
VENV = ROOT / "target/foreign/ros"
PYTHON = VENV / "bin/python"
PACKAGES = ["rosbags==0.11.9", "mcap-ros2-support==0.6.0", "rosless==0.5.0", "cyclonedds==11.0.1", "robo-ws-bridge==0.11.0"]
TRACE = ROOT / "datasets/golden/golden_circle.csv"

COLUMNS = {
    "/tf": "base_x_m",
    "/joint_states": "base_yaw_rad",
    "/base_twist": "base_vx_m_s",
    "/moment": "moment_z_n_m",
    "/truth/touching": "truth_touching",
    "/truth/tip": "truth_tip",
    "/truth/split": "truth_split",
    "/truth/contact": "truth_contact_x_m",
    "/truth/surface": "truth_surface_x_m",
    "/truth/arc_m": "truth_arc_m",
    "/truth/force_n": "truth_force_n",
    "/truth/tangent_rad": "truth_tangent_rad",
}
"""Column of the trace that a topic contains."""

STREAM_S, RATE_HZ = 60, 800

LOOPBACK = "ip link set lo up && ip route add 224.0.0.0/4 dev lo"
INTERFACE = '<Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>'
CYCLONE = f"<CycloneDDS><Domain><General>{INTERFACE}</General></Domain></CycloneDDS>"
in_a_namespace = pytest.mark.skipif(
    os.geteuid() != 0 or not shutil.which("unshare"), reason="a network namespace needs root and unshare"
)

pytestmark = pytest.mark.skipif(os.environ.get("WHISKER_FOREIGN") != "1", reason="WHISKER_FOREIGN=1 installs third-party programs")


@pytest.fixture(scope="module")
def python() -> Path:
    """A Python interpreter with the third-party programs."""
    complete, packages = VENV / "complete", "\n".join(PACKAGES)
    if not complete.exists() or complete.read_text() != packages:
        subprocess.run([sys.executable, "-m", "venv", VENV], check=True)
        subprocess.run([PYTHON, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        complete.write_text(packages)
    return PYTHON


def built(program: str, *options: str) -> Path:
    """Builds a program of this project."""
    command = ["cargo", "build", "--quiet", "--release", "--bin", program, *options]
    subprocess.run(command, cwd=ROOT, check=True)
    return ROOT / "target/release" / program


@pytest.fixture(scope="module")
def whisker() -> Path:
    """The program `whisker`."""
    return built("whisker")


@pytest.fixture(scope="module")
def node() -> Path:
    """The node with the feed."""
    return built("ros2-node", "--package", "ros2-node", "--features", "foxglove")


def output(*command: str | Path) -> str:
    """Standard output of a command, which must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


Totals = dict[str, tuple[int, float]]
"""Number of messages of a topic, and the sum of their values."""


def totals(lines: str) -> Totals:
    """Totals printed by `read_bag.py`."""
    return {topic: (int(count), float(total)) for topic, count, total in map(str.split, lines.splitlines())}


def totals_of_trace() -> Totals:
    """Totals of the trace."""
    rows = list(csv.DictReader(TRACE.open()))
    numbers = {topic: [float(row[column]) for row in rows if row[column]] for topic, column in COLUMNS.items()}
    return {topic: (len(of_topic), math.fsum(of_topic)) for topic, of_topic in numbers.items()}


@pytest.mark.parametrize("reader", ["rosbags", "mcap_ros2"])
def test_third_party_readers_read_every_message_of_a_recording(python: Path, whisker: Path, tmp_path: Path, reader: str) -> None:
    folder = tmp_path / "circle"
    output(whisker, "bag", "export", TRACE, "--out", folder)
    assert totals(output(python, FOREIGN / "read_bag.py", folder, reader)) == totals_of_trace()


def test_a_third_party_recording_becomes_a_log(python: Path, whisker: Path, tmp_path: Path) -> None:
    folder, out = tmp_path / "foreign", tmp_path / "log"
    output(python, FOREIGN / "write_bag.py", folder, "openwhisker", "8000")
    assert "8000" not in output(whisker, "bag", "info", folder)  # in messages of 80 readings
    output(whisker, "bag", "import", folder, "--out", out)
    rows = list(csv.DictReader((out / "log.csv").open()))
    assert [int(row["x_counts"]) for row in rows] == list(range(8000))
    assert all(abs(float(row["t_s"]) - i / RATE_HZ) < 1e-6 for i, row in enumerate(rows))


@in_a_namespace
def test_a_third_party_node_receives_every_message(python: Path, node: Path, tmp_path: Path) -> None:
    folder, expected = tmp_path / "stream", STREAM_S * RATE_HZ
    output(python, FOREIGN / "write_bag.py", folder, "stream", str(expected))
    script = f"""
        {LOOPBACK}
        {python} {FOREIGN / "receive.py"} /field {expected} &
        {node} play {folder} --wait-for /field >{tmp_path / "node"} && wait
    """
    count, in_order, duration_s = output("unshare", "--net", "sh", "-c", script).split()
    assert (int(count), in_order) == (expected, "True")
    assert abs(float(duration_s) - STREAM_S) < 1.0


@in_a_namespace
def test_a_third_party_service_call_runs_the_routine(python: Path, whisker: Path, node: Path, tmp_path: Path) -> None:
    printer, sensor = tmp_path / "printer", tmp_path / "sensor"
    script = f"""
        {LOOPBACK}
        export CYCLONEDDS_URI='{CYCLONE}'
        {whisker} platform emulate --printer-link {printer} --sensor-link {sensor} >&2 & rig=$!
        until test -e {printer} && test -e {sensor}; do sleep 0.1; done
        {node} run --printer {printer} --sensor {sensor} --speed 15000 --middleware cyclonedds 2>{tmp_path / "notes"} >&2 & node=$!
        {python} {FOREIGN / "call.py"} 6 20 0 2 0
        called=$?
        kill -INT $node; wait $node; kill -INT $rig; wait $rig
        exit $called
    """
    assert output("unshare", "--net", "bash", "-c", script).split() == ["0.1450", "0.1350", "0.1250"]
    notes = (tmp_path / "notes").read_text()
    assert "everyone who reaches it reads the sensor and moves the printer" in notes, notes
    assert "confine it with --localhost-only" in notes, notes


@contextmanager
def fed(node: Path, *arguments: str | Path) -> Iterator[TextIO]:
    """Output of the node, whose first line is the address of its feed, while it runs."""
    process = subprocess.Popen([node, *arguments, "--foxglove=127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
    try:
        yield process.stdout
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def test_a_third_party_listener_receives_every_message_of_a_trace(python: Path, whisker: Path, node: Path, tmp_path: Path) -> None:
    folder = tmp_path / "circle"
    output(whisker, "bag", "export", TRACE, "--out", folder)
    with fed(node, "play", folder, "--wait-for", "/moment") as lines:
        url = lines.readline().strip()
        assert totals(output(python, FOREIGN / "read_bag.py", url, "foxglove")) == totals_of_trace()


def test_a_third_party_listener_receives_every_message_of_a_minute(python: Path, node: Path, tmp_path: Path) -> None:
    folder, expected = tmp_path / "stream", STREAM_S * RATE_HZ
    output(python, FOREIGN / "write_bag.py", folder, "stream", str(expected))
    with fed(node, "play", folder, "--wait-for", "/field") as lines:
        url = lines.readline().strip()
        received = totals(output(python, FOREIGN / "read_bag.py", url, "foxglove"))
    assert received == {"/field": (expected, expected * (expected - 1) / 2)}


def test_a_third_party_listener_runs_the_routine(python: Path, whisker: Path, node: Path) -> None:
    with subprocess.Popen([whisker, "platform", "emulate"], stdout=subprocess.PIPE, text=True) as rig:
        ports = dict(rig.stdout.readline().split() for _ in range(2))
        run = ["run", "--printer", ports["printer"], "--sensor", ports["sensor"], "--speed", "15000"]
        with fed(node, *run) as lines:
            url, token = lines.readline().strip(), lines.readline().removeprefix("token ").strip()
            pushed = output(python, FOREIGN / "call_foxglove.py", url, token, "6", "20", "0", "2", "0")
        rig.send_signal(signal.SIGINT)
    assert pushed.split() == ["0.1450", "0.1350", "0.1250"]
