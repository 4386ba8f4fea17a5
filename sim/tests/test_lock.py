"""Exclusive access to folders of traces."""

import os
import subprocess
import sys

from whisker_sim.cli import main
from whisker_sim.lock import exclusive

from conftest import REPOSITORY

_HOLD = """
import sys
from pathlib import Path
from whisker_sim.lock import exclusive
with exclusive(Path(sys.argv[1])):
    print("holds", flush=True)
    sys.stdin.read()
"""


def _python(*arguments: str) -> subprocess.Popen:
    command = [sys.executable, *arguments]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, text=True, env=os.environ | {"PYTHONPATH": str(REPOSITORY / "sim")}, **pipes)


def test_robust_a_second_simulation_states_who_writes_the_folder_and_waits(tmp_path, write_scene):
    """It begins when the first one has ended, and no lock file remains."""
    out = tmp_path / "out"
    with exclusive(out):
        second = _python("-m", "whisker_sim", "simulate", str(write_scene()), "--out", str(out), "--jobs", "1")
        assert f"waiting for process {os.getpid()} on " in second.stderr.readline()
        assert not out.exists()
    second.communicate()
    assert second.returncode == 0
    assert (out / "sweep.json").is_file()
    assert not list(tmp_path.glob(".*.lock"))


def test_robust_a_killed_process_keeps_no_lock(tmp_path):
    """The operating system releases its lock; the lock file is taken over."""
    holder = _python("-c", _HOLD, str(tmp_path / "out"))
    assert holder.stdout.readline() == "holds\n"
    assert list(tmp_path.glob(".out.lock"))
    holder.kill()
    holder.communicate()
    with exclusive(tmp_path / "out"):
        pass
    assert not list(tmp_path.glob(".*.lock"))


def test_robust_a_scene_is_not_replaced_by_the_sidecar_of_its_trace(tmp_path, write_scene, capsys):
    """`--out` may be neither the folder of the scene, if names coincide, nor lead there through a link."""
    scene = write_scene()
    before = scene.read_bytes()
    (tmp_path / "link").symlink_to(tmp_path)
    for out in (tmp_path, tmp_path / "link", tmp_path / "link" / ".." / tmp_path.name):
        assert main(["simulate", str(scene), "--out", str(out)]) == 2
        assert "sweep.json: is an input" in capsys.readouterr().err
    assert main(["export", str(scene), "--out", str(tmp_path / "link" / "sweep.json")]) == 2
    assert "is the scene itself" in capsys.readouterr().err
    assert scene.read_bytes() == before
