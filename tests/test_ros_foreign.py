"""Recordings, live node and Foxglove feed with third-party programs.

These are `rosbags`, `mcap-ros2-support`, `rosless`, `cyclonedds`, `robo-ws-bridge` and `foxglove-schemas-protobuf`.

They are installed only if `WHISKER_FOREIGN=1`, into a virtual environment of their own. The node runs in a network namespace with
only a loopback interface, which isolates it from other nodes; the feed is bound to the loopback interface.
"""

import csv
import json
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
PACKAGES += ["foxglove-schemas-protobuf==0.4.0"]
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
def test_val_third_party_readers_read_every_message_of_a_recording(
    python: Path, whisker: Path, tmp_path: Path, reader: str
) -> None:
    folder = tmp_path / "circle"
    output(whisker, "bag", "export", TRACE, "--out", folder)
    assert totals(output(python, FOREIGN / "read_bag.py", folder, reader)) == totals_of_trace()


def test_val_a_third_party_recording_becomes_a_log(python: Path, whisker: Path, tmp_path: Path) -> None:
    folder, out = tmp_path / "foreign", tmp_path / "log"
    output(python, FOREIGN / "write_bag.py", folder, "openwhisker", "8000")
    assert "8000" not in output(whisker, "bag", "info", folder)  # in messages of 80 readings
    output(whisker, "bag", "import", folder, "--out", out)
    rows = list(csv.DictReader((out / "log.csv").open()))
    assert [int(row["x_counts"]) for row in rows] == list(range(8000))
    assert all(abs(float(row["t_s"]) - i / RATE_HZ) < 1e-6 for i, row in enumerate(rows))


@in_a_namespace
def test_val_a_third_party_node_receives_every_message(python: Path, node: Path, tmp_path: Path) -> None:
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
def test_val_a_third_party_service_call_runs_the_routine(python: Path, whisker: Path, node: Path, tmp_path: Path) -> None:
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


def test_val_a_third_party_listener_receives_every_message_of_a_trace(
    python: Path, whisker: Path, node: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "circle"
    output(whisker, "bag", "export", TRACE, "--out", folder)
    with fed(node, "play", folder, "--wait-for", "/moment") as lines:
        url = lines.readline().strip()
        assert totals(output(python, FOREIGN / "read_bag.py", url, "foxglove")) == totals_of_trace()


def test_val_a_third_party_listener_receives_every_message_of_a_minute(python: Path, node: Path, tmp_path: Path) -> None:
    folder, expected = tmp_path / "stream", STREAM_S * RATE_HZ
    output(python, FOREIGN / "write_bag.py", folder, "stream", str(expected))
    with fed(node, "play", folder, "--wait-for", "/field") as lines:
        url = lines.readline().strip()
        received = totals(output(python, FOREIGN / "read_bag.py", url, "foxglove"))
    assert received == {"/field": (expected, expected * (expected - 1) / 2)}


def test_val_a_third_party_listener_runs_the_routine(python: Path, whisker: Path, node: Path) -> None:
    with subprocess.Popen([whisker, "platform", "emulate"], stdout=subprocess.PIPE, text=True) as rig:
        ports = dict(rig.stdout.readline().split() for _ in range(2))
        run = ["run", "--printer", ports["printer"], "--sensor", ports["sensor"], "--speed", "15000"]
        with fed(node, *run) as lines:
            url, token = lines.readline().strip(), lines.readline().removeprefix("token ").strip()
            pushed = output(python, FOREIGN / "call_foxglove.py", url, token, "6", "20", "0", "2", "0")
        rig.send_signal(signal.SIGINT)
    assert pushed.split() == ["0.1450", "0.1350", "0.1250"]


MAPPING = {"format": 1, "kind": "contact_mapping", "estimator": "ekf", "seed": 1}
SAME_M = 1e-12
"""Largest distance between contacts of the node and of a replay."""


@pytest.fixture(scope="module")
def calibration(whisker: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration fitted to the golden traces themselves, which suffices for a comparison of two paths."""
    folder = tmp_path_factory.mktemp("calibrated")
    for name in ("golden_pin", "golden_circle"):
        shutil.copy(TRACE.with_name(f"{name}.csv"), folder)
        sidecar = json.loads(TRACE.with_name(f"{name}.json").read_text())
        (folder / f"{name}.json").write_text(json.dumps(sidecar | {"role": "calibration", "contour": None}))
    output(whisker, "fit", folder)
    [made] = (folder / "calibrations").glob("*.json")
    return made


Contacts = dict[int, tuple[float, float]]
"""Contact in World (m) by time (ns)."""


def replayed(whisker: Path, calibration: Path) -> Contacts:
    """Contacts of `whisker replay`, without noise."""
    options = ["--calibration", calibration, "--estimator", MAPPING["estimator"], "--noise", "0"]
    rows = csv.DictReader(output(whisker, "replay", TRACE, *options).splitlines())
    return {
        round(1e9 * float(row["t_s"])): (float(row["contact_x_m"]), float(row["contact_y_m"])) for row in rows if row["contact_x_m"]
    }


def received(table: Path) -> Contacts:
    """Contacts that a listener wrote."""
    return {int(row["time_ns"]): (float(row["x_m"]), float(row["y_m"])) for row in csv.DictReader(table.open())}


@in_a_namespace
def test_val_third_party_listeners_receive_the_contacts_of_a_replay(
    python: Path, whisker: Path, node: Path, calibration: Path, tmp_path: Path
) -> None:
    """A third-party client plays a recording by DDS; others listen by DDS and by the Foxglove protocol."""
    name, folder, mapping = TRACE.stem, tmp_path / "recording", tmp_path / "mapping.json"
    output(whisker, "bag", "export", TRACE, "--out", folder)
    entry = {"name": name, "calibration": str(calibration), "rate_hz": 250, "noise_sd_n_m": 1e-15, "moment": "/moment"}
    mapping.write_text(json.dumps(MAPPING | {"whiskers": [entry]}))
    by_dds, by_foxglove, seen, notes = (tmp_path / file for file in ("dds.csv", "foxglove.csv", "seen.json", "notes"))
    script = f"""
        {LOOPBACK}
        export CYCLONEDDS_URI='{CYCLONE}'
        {node} contact {mapping} --foxglove=127.0.0.1:0 >{tmp_path / "lines"} 2>{notes} & node=$!
        until grep --quiet ready {tmp_path / "lines"}; do sleep 0.1; done
        {python} {FOREIGN / "contact_foxglove.py"} $(head -n 1 {tmp_path / "lines"}) {by_foxglove} >{seen} & listener=$!
        sleep 2
        {python} {FOREIGN / "contact.py"} {folder} {name} {by_dds} && wait $listener
        done=$?
        kill -INT $node; wait $node
        exit $done
    """
    summary = json.loads(output("unshare", "--net", "bash", "-c", script))
    expected = replayed(whisker, calibration)
    assert len(expected) > 100
    for found in (received(by_dds), received(by_foxglove)):
        assert found.keys() == expected.keys()
        off_m = max(math.dist(found[time_ns], contact) for time_ns, contact in expected.items())
        print(f"largest distance from the replay: {off_m:.1e} m")
        assert off_m <= SAME_M
    assert summary["maps"] > 0
    assert (summary["frame"], f"{name}/whisker" in summary["markers"]) == ("world", True)
    values = summary["diagnostics"][f"whisker {name}"]
    assert [int(values[key]) for key in ("readings", "late", "stale")] == [summary["moments"], 0, 0]
    scene = json.loads(seen.read_text())
    assert {"/whiskers/scene", "/whiskers/markers", "/whiskers/map", "/diagnostics"} <= scene["counts"].keys()
    assert {f"{name}/whisker/0", f"{name}/contact/0"} <= set(scene["entities"])
    assert "everyone who reaches it reads the contacts" in notes.read_text()
