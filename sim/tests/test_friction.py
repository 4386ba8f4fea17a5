"""Contacts with Coulomb friction, against Coulomb's law and the elastica."""

import msgspec
import numpy as np
import pytest

from whisker_sim.certificate import certify
from whisker_sim.cli import main
from whisker_sim.model import POINTS, SENSORS
from whisker_sim.scene import Scene, Simulation
from whisker_sim.simulate import is_split, simulate
from whisker_sim.sweep import build_sweep_model
from whisker_sim.trace import COLUMNS, FRICTION_COLUMNS, write_trace

STEP = Simulation(timestep_s=0.0002)


@pytest.fixture(params=["straight", "curved"])
def rubbed(request, make_run):
    """A run with friction, and its simulation."""
    run = make_run()
    scene = msgspec.structs.replace(run.scene, whisker=request.param, friction=0.3, simulation=STEP)
    run = msgspec.structs.replace(run, scene=scene)
    return run, simulate(run)


def test_val_friction_agrees_with_the_elastica(rubbed):
    """The moment agrees with that of the elastica under the force's true angle to 0.1 % of the range, RMS."""
    run, simulated = rubbed
    scene = run.scene
    certificate = certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)
    assert certificate.sampled > 20
    assert certificate.unsolved == 0
    assert certificate.moment_rms < 1e-3


def test_val_slipping_force_is_on_the_friction_cone(rubbed):
    """While the whisker slips, the force leans by atan(mu) against the slip: to 0.5 degrees RMS."""
    run, simulated = rubbed
    friction = simulated.friction
    slipping = simulated.touching & ~friction.sticking & (np.abs(friction.slip_m_s) > 1e-3)
    assert np.sum(slipping) > 50
    angle_rad = np.arctan(run.scene.friction)
    miss_rad = friction.angle_rad[slipping] + np.sign(friction.slip_m_s[slipping]) * angle_rad
    assert np.degrees(np.sqrt(np.mean(miss_rad**2))) < 0.5
    assert np.all(np.abs(friction.angle_rad[simulated.touching]) < angle_rad + np.radians(2.0))


def test_verif_columns_of_friction(rubbed, tmp_path):
    """They appear in traces of scenes with friction, and are empty while the whisker is free."""
    run, simulated = rubbed
    write_trace(tmp_path, run, simulated)
    header, *rows = (tmp_path / f"{run.name}.csv").read_text(encoding="utf-8").splitlines()
    assert header.split(",") == [name for name, _ in COLUMNS + FRICTION_COLUMNS]
    fields = [row.split(",") for row in rows]
    assert all((row[9] == "1") == all(row[-3:]) for row in fields)
    assert all(row[9] == "1" or not any(row[-3:]) for row in fields)


def test_verif_a_place_beyond_the_strongest_contacts_is_seen(make_run):
    """Chains in parallel touch one place with up to eight contacts each; a weaker contact elsewhere makes a split."""
    ideal = make_run().scene
    frictional = msgspec.structs.replace(ideal, friction=0.3, simulation=STEP)
    widths = [build_sweep_model(scene).nsensordata - SENSORS["points"].start for scene in (ideal, frictional)]
    assert widths == [6 * POINTS, 6 * 8 * POINTS]
    slots = np.zeros((1, 8 * POINTS, 6))
    slots[0, :16] = (2.0, 0.1, 0.0, 10.0, 0.0, 0.0)
    assert not is_split(slots.reshape(1, -1))
    slots[0, 16] = (1.0, 0.1, 0.0, 15.0, 0.0, 0.0)
    assert is_split(slots.reshape(1, -1))
    assert not is_split(slots[:, :POINTS].reshape(1, -1))


@pytest.mark.parametrize("friction", [-0.1, 0.0, 1.5])
def test_robust_friction_out_of_range_is_refused(make_run, friction):
    """The coefficient is positive and at most 1."""
    scene = msgspec.to_builtins(make_run().scene)
    with pytest.raises(msgspec.ValidationError, match="friction"):
        msgspec.convert({**scene, "friction": friction}, Scene)


@pytest.mark.parametrize(("settings", "found_s"), [(None, 0.0005), ("fast", 0.001), ({"timestep_s": 0.00025}, 0.00025)])
def test_robust_a_long_time_step_with_friction_is_refused(write_scene, assert_rejected, settings, found_s):
    """Contacts would bounce, with forces outside the friction cone."""
    words = ["simulation: expected a time step of at most 0.0002 s with friction", f"found {found_s} s"]
    assert_rejected(write_scene(friction=0.3, simulation=settings), words)


@pytest.mark.parametrize("settings", ["default", "fast"])
def test_robust_a_long_time_step_of_the_command_line_is_refused_with_friction(write_scene, tmp_path, capsys, settings):
    """The error names the place of the scene's own settings; nothing is written."""
    path = write_scene(friction=0.3, simulation={"timestep_s": 0.0002})
    assert main(["check", str(path)]) == 0
    capsys.readouterr()
    assert main(["simulate", str(path), "--out", str(tmp_path / "out"), "--jobs", "1", "--simulation", settings]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {path}:")
    assert "simulation: expected a time step of at most 0.0002 s with friction, found 0.0" in error
    assert not (tmp_path / "out").exists()
