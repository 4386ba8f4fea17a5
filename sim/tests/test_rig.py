"""Calibration rig: the printed whisker, the routine, and the table of readings."""

import json

import msgspec
import numpy as np
import pytest
from scipy.integrate import quad

from whisker_sim.cli import main as simulator
from whisker_sim.errors import SimulationError
from whisker_sim.motions import Stage
from whisker_sim.physics.frequencies import chain_hz
from whisker_sim.physics.rig import beam_rad_m, pushes
from whisker_sim.rig import files
from whisker_sim.rig.command import main
from whisker_sim.rig.files import Axes, make_rig, ringing_of
from whisker_sim.rig.magnet import Magnet, Magnetometer, field_of
from whisker_sim.rig.table import Axis, grid
from whisker_sim.runs import load_runs
from whisker_sim.whisker import PRESETS

from conftest import REPOSITORY, SCENES

PRINTED = PRESETS["printed"][1]
ROUTINE = SCENES / "rig/increments_beam_test.json"
DATA = REPOSITORY / "crates/platform/data"


@pytest.fixture(scope="module")
def stage() -> Stage:
    return load_runs(ROUTINE)[1][0].scene.stage()


def routine(**changes):
    """A run of the routine with replaced parameters of the motion."""
    (run,) = load_runs(ROUTINE)[1]
    motion = msgspec.structs.replace(run.scene.motion, **changes)
    return msgspec.structs.replace(run, scene=msgspec.structs.replace(run.scene, motion=motion))


def test_verif_the_documented_call_visits_16_places(stage):
    """From 5 mm off the tip to 45 mm from the root, each 6 mm plus the lead of the ruler beyond the centre line."""
    motion = load_runs(ROUTINE)[1][0].scene.motion
    plan = motion.plan(stage)
    assert len(plan.touching) == 16
    for (start_s, end_s), distance_m in zip(plan.touching, np.linspace(0.145, 0.045, 16), strict=True):
        held = plan.poses[round(start_s / stage.timestep_s) : round(end_s / stage.timestep_s)]
        assert end_s - start_s == pytest.approx(3.0)
        assert np.ptp(held, axis=0) == pytest.approx(0.0, abs=1e-15)
        # The ruler's edge is at the origin of World, the undeflected centre line on the x axis of the base.
        assert held[0] == pytest.approx((-distance_m, -0.009, 0.0), abs=1e-9)


def test_verif_moves_are_those_of_a_printer(stage):
    """Moves reach 2000 mm/min at most, with a constant acceleration and deceleration of 1 m/s2."""
    motion = msgspec.structs.replace(load_runs(ROUTINE)[1][0].scene.motion, increments_y=1)
    velocity_m_s = np.diff(motion.plan(stage).poses[:, :2], axis=0) / stage.timestep_s
    assert np.max(np.hypot(*velocity_m_s.T)) == pytest.approx(2.0 / 60.0, rel=1e-3)
    acceleration_m_s2 = np.hypot(*np.diff(velocity_m_s, axis=0).T) / stage.timestep_s
    assert np.max(acceleration_m_s2) < 1.01


def test_verif_steps_across_the_whisker_end_where_one_step_would(stage):
    one, three = (routine(increments_x=count, increments_y=0, pause_s=0.2).scene.motion.plan(stage) for count in (0, 3))
    end = [plan.poses[round(plan.touching[0][0] / stage.timestep_s)] for plan in (one, three)]
    assert end[0] == pytest.approx(end[1], abs=1e-12)
    assert three.touching[0][0] > one.touching[0][0] + 0.4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"padding_m": 0.002}, ["padding_m: expected more than edge_ahead_m = 0.003", "found 0.002"]),
        ({"padding_m": 0.004}, ["padding_m: expected more than edge_ahead_m and the whisker's radius", "found 0.004"]),
        ({"total_y_m": 0.15}, ["total_y_m: expected less than", "0.145", "found 0.15"]),
        ({"increments_y": -1}, ["increments_y", ">= 0"]),
    ],
)
def test_robust_an_impossible_routine(tmp_path, capsys, changes, words):
    scene = json.loads(ROUTINE.read_text())
    scene["motion"] |= changes
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene, indent=2))
    assert simulator(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in ["scene.json:", *words]:
        assert word in error


@pytest.mark.parametrize("distance_m", [0.03, 0.09, 0.145])
def test_val_the_beams_formula_against_its_integral(distance_m):
    """With the compliance of the shaft, int (d - s)^2 / EI ds, by quadrature."""
    bending_per_m4 = PRINTED.youngs_modulus_pa * np.pi / 64.0
    shaft_m_n, _ = quad(lambda s: (distance_m - s) ** 2 / (bending_per_m4 * float(PRINTED.diameter_m(s)) ** 4), 0.0, distance_m)
    hinge_m_n = distance_m**2 / PRINTED.root_stiffness_n_m_rad
    expected = distance_m / PRINTED.root_stiffness_n_m_rad / (hinge_m_n + shaft_m_n)
    assert beam_rad_m(PRINTED, distance_m) == pytest.approx(expected, rel=1e-9)


def test_val_simulated_pushes_against_table_and_beam(stage):
    """MuJoCo's root at rest agrees with the elastica to 0.1 %, and while the ruler moves with the beam to 1 %.

    The table assumes a rigid base; MuJoCo's drive yields by up to 0.5 mrad and 10 um at the deepest push.
    """
    rows = pushes(routine(increments_y=2, hold_s=0.8))
    for row in rows:
        table = grid(stage, np.array([row.distance_m]), np.linspace(0.0, row.push_m, 11))
        assert abs(row.error) < 1e-3
        assert row.rotation_rad == pytest.approx(table.rotation_rad[0, -1], rel=4e-3)
        assert row.slope_rad_m == pytest.approx(row.beam_rad_m, rel=1e-2)


def test_val_small_pushes_of_the_table_against_the_beam(stage):
    """Rotation and bending share a small push; moment and force are those of the hinge."""
    contacts_m, push_m = np.array([0.03, 0.075, 0.12, 0.145]), 2e-4
    table = grid(stage, contacts_m, np.array([0.0, push_m]))
    beam = np.array([beam_rad_m(PRINTED, contact_m) for contact_m in contacts_m])
    np.testing.assert_allclose(table.rotation_rad[:, 1] / push_m, beam, rtol=2e-3)
    np.testing.assert_allclose(table.moment_n_m, PRINTED.root_stiffness_n_m_rad * table.rotation_rad, rtol=1e-12)
    np.testing.assert_allclose(table.force_n[:, 1] * contacts_m, table.moment_n_m[:, 1], rtol=5e-3)
    assert np.all(table.slope_rad[:, 1] > 0.0)
    assert np.all(table.rotation_rad[:, 0] == 0.0)


def test_verif_beyond_the_tip_the_table_is_empty(stage):
    """The ruler slips off the tip at a smaller depth the nearer it is to it, and does not return."""
    table = grid(stage, np.array([0.1, 0.149, 0.1498, 0.15]), np.arange(17) * 1e-3)
    held = np.isfinite(table.rotation_rad)
    assert np.all(held[0])
    depths = np.sum(held, axis=1)
    assert np.all(np.diff(depths) <= 0)
    assert depths[-1] == 1
    assert np.all(np.diff(held.astype(int), axis=1) <= 0)


def test_robust_a_contact_that_is_lost_away_from_the_tip_is_an_error(stage):
    """There is no solution for a push near the root as deep as the length of the shaft."""
    with pytest.raises(SimulationError, match=r"finds no contact at 0\.02 m and a depth of"):
        grid(stage, np.array([0.02]), np.array([0.0, 0.15]))


def test_val_counts_are_those_of_a_dipole():
    """Counts per rotation at rest by differences of B = mu0 / (4 pi r^3) (3 (m . u) u - m).

    The sensor is rotated about the whisker.
    """
    magnet, sensor = Magnet(), Magnetometer()

    def counts(rotation_rad: float) -> np.ndarray:
        along = np.array((np.cos(rotation_rad), np.sin(rotation_rad), 0.0))
        place_m = np.array((-magnet.lever_m - magnet.gap_m, 0.0, 0.0)) + magnet.lever_m * along
        distance_m = np.linalg.norm(place_m)
        towards = place_m / distance_m
        field_t = 1e-7 * magnet.moment_a_m2 / distance_m**3 * (3.0 * (along @ towards) * towards - along)
        cos, sin = np.cos(sensor.askew_rad), np.sin(sensor.askew_rad)
        # The sensor's z axis is along the whisker.
        x_t, y_t = cos * field_t[2] - sin * field_t[1], cos * field_t[1] + sin * field_t[2]
        return np.array((x_t, y_t, field_t[0])) / sensor.tesla_per_count

    per_rad = (counts(1e-5) - counts(-1e-5)) / 2e-5
    np.testing.assert_allclose(field_of(magnet, sensor).counts_per_rad, per_rad, rtol=1e-5, atol=0.1)


def test_val_ringing_after_release():
    """Damped frequency of the first mode of the chain; time constant 2 / (w^2 (tau + h))."""
    timestep_s = 0.00025
    ringing = ringing_of(PRINTED, timestep_s)
    omega_rad_s = 2.0 * np.pi * float(chain_hz(PRINTED, 1)[0])
    damping_s = PRINTED.damping_s + timestep_s
    ratio = 0.5 * omega_rad_s * damping_s
    assert 2.0 * np.pi * ringing.ring_hz == pytest.approx(omega_rad_s * np.sqrt(1.0 - ratio**2), rel=5e-3)
    assert ringing.decay_s == pytest.approx(2.0 / (omega_rad_s**2 * damping_s), rel=2e-2)


def test_regress_the_committed_table():
    """The committed table equals the present one except for the last digits, which may differ between machines."""
    kept = json.loads((DATA / "rig.json").read_bytes())
    rig, rows = make_rig(load_runs(ROUTINE)[1][0].scene, Axes())
    made = msgspec.to_builtins(rig)
    for key in ("ring_hz", "decay_s"):
        assert made[key] == pytest.approx(kept[key], rel=1e-3)
    for key in ("format", "kind", "field", "face", "ruler", "whisker", "scene"):
        assert msgspec.json.encode(made[key]) == msgspec.json.encode(kept[key])
    now, before = (
        np.genfromtxt(text.splitlines(), delimiter=",", skip_header=1) for text in (rows.decode(), (DATA / "rig.csv").read_text())
    )
    np.testing.assert_allclose(now, before, rtol=1e-6, atol=2e-9)


def test_verif_the_file_is_a_full_sorted_grid():
    lines = (DATA / "rig.csv").read_text().splitlines()
    assert lines[0] == "contact_m,push_m,rotation_rad,slope_rad,moment_n_m,force_n"
    rows = np.genfromtxt(lines[1:], delimiter=",")
    table = json.loads((DATA / "rig.json").read_bytes())["table"]
    contact, push = (Axis(**table["axes"][key]).values for key in ("contact_m", "push_m"))
    assert table["rows"] == len(rows) == len(contact) * len(push)
    np.testing.assert_allclose(rows[:, 0], np.repeat(contact, len(push)), atol=1e-12)
    np.testing.assert_allclose(rows[:, 1], np.tile(push, len(contact)), atol=1e-12)


SMALL = Axes(Axis(0.1, 0.01, 2), Axis(0.0, 0.001, 2))


def test_verif_the_hash_of_the_inputs_is_that_of_the_sources_of_the_table_too(monkeypatch):
    scene = load_runs(ROUTINE)[1][0].scene
    before, rows = make_rig(scene, SMALL)
    assert make_rig(scene, SMALL)[0] == before
    (changed,) = {files.sources_sha256(files._SOURCES), "0" * 64} - {files.sources_sha256(files._SOURCES)}
    monkeypatch.setattr(files, "sources_sha256", lambda modules: changed)
    after, same_rows = make_rig(scene, SMALL)
    assert rows == same_rows
    assert before.inputs_sha256 != after.inputs_sha256


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("friction", 0.3),
        ("object_velocity_m_s", [0.001, 0.0]),
        ("object_stand", {"mass_kg": 0.01, "friction": 0.5}),
        ("object_stiffness_n_m", 20.0),
        ("vibration", {"acceleration_m_s2": 0.5, "low_hz": 5.0, "high_hz": 60.0}),
    ],
)
def test_robust_effects_that_a_table_at_rest_does_not_have(tmp_path, capsys, key, value):
    scene, out = tmp_path / "scene.json", tmp_path / "out"
    # Friction requires a time step of at most 0.2 ms.
    changes = {"rate_hz": 1000.0, "simulation": {"timestep_s": 0.0002}, key: value}
    scene.write_text(json.dumps(json.loads(ROUTINE.read_text()) | changes, indent=2))
    line = scene.read_text().splitlines().index(next(line for line in scene.read_text().splitlines() if f'"{key}"' in line)) + 1
    assert main(["--scene", str(scene), "--out", str(out)]) == 2
    found = json.dumps(value, separators=(",", ":"))
    reason = "since the readings are those of a fixed, rigid edge at rest"
    expected = f"error: {scene}:{line}:3: {key}: expected no such key, {reason}, found {found}\n"
    assert capsys.readouterr().err == expected
    assert not out.exists()


def test_robust_the_command_requires_a_scene(tmp_path, capsys):
    suite = SCENES / "suites/rig.json"
    assert main(["--scene", str(suite), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error == f"error: {suite}: expected a scene with one whisker, found another kind of document\n"
    assert not list(tmp_path.iterdir())
