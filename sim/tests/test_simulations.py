"""Named simulation settings in scenes, on the command line and in sidecars."""

import json

import msgspec
import mujoco
import mujoco.rollout
import numpy as np
import pytest

from whisker_sim import cli
from whisker_sim.cli import main
from whisker_sim.errors import SimulationError
from whisker_sim.runs import load_runs
from whisker_sim.scene import SIMULATIONS, Simulation
from whisker_sim.simulate import roll


@pytest.mark.parametrize("name", SIMULATIONS)
def test_verif_a_name_stands_for_its_settings(write_scene, name):
    """After reading, a scene contains the settings, whether they were named or given."""
    _, settings = SIMULATIONS[name]
    _, (named,) = load_runs(write_scene(simulation=name))
    _, (given,) = load_runs(write_scene(simulation=msgspec.to_builtins(settings)))
    assert named.scene == given.scene
    assert named.scene.simulation == settings


def test_verif_without_settings_the_default_ones(make_run):
    assert make_run().scene.simulation == SIMULATIONS["default"][1] == Simulation()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("quick", ["scene.json:18:3: simulation", "expected one of default, fast", "found 'quick'"]),
        ({"step_s": 0.1}, ["simulation.step_s", "unknown key", "timestep_s"]),
        ({"timestep_s": 0.1}, ["simulation.timestep_s", "<= 0.002", "found 0.1"]),
    ],
)
def test_robust_wrong_settings(write_scene, tmp_path, assert_rejected, settings, words):
    assert_rejected(write_scene(simulation=settings).rename(tmp_path / "scene.json"), words)


def test_verif_settings_for_a_whole_suite_go_to_a_folder_of_their_own(write_scene, tmp_path, monkeypatch):
    """The sidecar states the settings; the default folder of the suite is not changed."""
    monkeypatch.setattr(cli, "DATASETS", tmp_path / "datasets")
    entry = {"scene": write_scene().name}
    suite = tmp_path / "suite.json"
    suite.write_text(json.dumps({"format": 1, "name": "mine", "scenes": [entry]}))
    assert main(["simulate", str(suite), "--jobs", "1", "--simulation", "fast"]) == 0
    assert [path.name for path in (tmp_path / "datasets").iterdir()] == ["mine_fast"]
    sidecar = json.loads((tmp_path / "datasets/mine_fast/sweep.json").read_text())
    assert sidecar["scene"]["simulation"] == {"timestep_s": 0.001}


def test_robust_traces_with_other_settings_are_kept(write_scene, tmp_path, capsys):
    """Traces with other simulation settings are only overwritten with `--force`."""
    command = ["simulate", str(write_scene()), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert main(command) == 0
    kept = (tmp_path / "out/sweep.csv").read_bytes()
    capsys.readouterr()
    assert main([*command, "--simulation", "fast"]) == 2
    error = capsys.readouterr().err
    for word in ("sweep.json", "expected a trace with timestep_s 0.001", "found one with timestep_s 0.0005", "--force"):
        assert word in error
    assert (tmp_path / "out/sweep.csv").read_bytes() == kept
    assert main([*command, "--simulation", "default"]) == 0
    assert "up to date" in capsys.readouterr().err
    assert main([*command, "--simulation", "fast", "--force"]) == 0
    assert (tmp_path / "out/sweep.csv").read_bytes() != kept


def test_robust_a_failure_of_mujoco_is_an_error_of_the_simulation(monkeypatch):
    """As if the contacts needed more memory than the model has: the scene fails, not the program."""

    def fails(*_, **__):
        raise mujoco.FatalError("mj_stackAlloc: out of memory")

    monkeypatch.setattr(mujoco.rollout, "rollout", fails)
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(SimulationError, match=r"MuJoCo fails between 0\.0000 s and 0\.0020 s: mj_stackAlloc: out of memory"):
        next(roll(model, mujoco.MjData(model), np.zeros((1, 0)), 1))
