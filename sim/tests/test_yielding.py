"""Objects that stand freely or have an elastic surface, against Coulomb's law, Hooke's law and the elastica."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from whisker_sim.certificate import certify
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate
from whisker_sim.table import GRAVITY_M_S2
from whisker_sim.trace import COLUMNS, YIELDING_COLUMNS, write_trace
from whisker_sim.yielding import support

SLOW = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006, "strokes": 1, "peak_speed_m_s": 0.01}
ELLIPSE = {"shape": "ellipse", "semi_x_m": 0.02, "semi_y_m": 0.01, "yaw_rad": 0.7}
L = {"shape": "l", "x_m": 0.016, "y_m": 0.012, "thickness_m": 0.006}
SLIDING_M_S = 1e-3
SUITES = Path(__file__).parents[2] / "scenes/suites"


def certified(run, simulated):
    """Certificate of a simulated run."""
    scene = run.scene
    return certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)


@pytest.mark.parametrize("whisker", ["straight", "curved"])
def test_val_a_sliding_object_has_the_friction_of_coulomb(make_run, whisker):
    """The contact force less the inertial force of the object is mu m g along its velocity, in the mean over the slide."""
    stand = {"mass_kg": 2e-4, "friction": 0.1}
    run = make_run(whisker=whisker, motion=SLOW, object_stand=stand, rate_hz=2000)
    simulated = simulate(run)
    moved_m, rate_hz = simulated.yielding.stand_m, run.scene.rate_hz
    velocity_m_s = 0.5 * rate_hz * (moved_m[2:] - moved_m[:-2])
    acceleration_m_s2 = rate_hz**2 * (moved_m[2:] - 2.0 * moved_m[1:-1] + moved_m[:-2])
    speed_m_s = np.hypot(*velocity_m_s.T)
    sliding = (speed_m_s > SLIDING_M_S) & simulated.touching[1:-1]
    on_object_n = -simulated.force_n[1:-1, None] * simulated.truth.normal[1:-1]
    friction_n = (on_object_n - stand["mass_kg"] * acceleration_m_s2)[sliding]
    along_n = np.sum(friction_n * velocity_m_s[sliding] / speed_m_s[sliding, None], axis=1)
    limit_n = stand["friction"] * stand["mass_kg"] * GRAVITY_M_S2
    assert np.sum(sliding) > 500
    assert abs(np.mean(along_n) / limit_n - 1.0) < 0.01


def test_val_the_support_of_a_disc_has_two_thirds_of_its_radius(make_run):
    center_mm, reach_mm = support(1e3 * make_run().scene.object.local_outline_m())
    np.testing.assert_allclose(center_mm, (0.0, 0.0), atol=1e-9)
    assert abs(reach_mm / 10.0 - 1.0) < 1e-3


def test_val_the_support_of_a_square_off_its_origin():
    """Centroid and mean distance (sqrt 2 + asinh 1) / 6 of its side."""
    square_mm = 10.0 * np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    center_mm, reach_mm = support(square_mm)
    np.testing.assert_allclose(center_mm, (5.0, 5.0), atol=1e-12)
    assert reach_mm == pytest.approx(10.0 * (np.sqrt(2.0) + np.arcsinh(1.0)) / 6.0, rel=1e-3)


@pytest.mark.parametrize("shift_mm", [(30.0, -20.0), (-400.0, 0.0)])
def test_verif_the_support_does_not_depend_on_the_origin_of_the_outline(shift_mm):
    outline_mm = np.array(((-10.0, -10.0), (12.0, -8.0), (9.0, 11.0), (-4.0, 13.0)))
    center_mm, reach_mm = support(outline_mm)
    shifted_mm, same_mm = support(outline_mm + shift_mm)
    np.testing.assert_allclose(shifted_mm, center_mm + shift_mm, rtol=1e-12)
    assert same_mm == pytest.approx(reach_mm, rel=1e-9)


def test_verif_a_displacement_does_not_depend_on_the_time_step(make_run):
    moved = {}
    for timestep_s in (5e-4, 1e-4):
        changes = {"object": ELLIPSE, "motion": SLOW, "simulation": {"timestep_s": timestep_s}}
        given = simulate(make_run(object_stand={"mass_kg": 2e-4, "friction": 0.1}, **changes)).yielding
        moved[timestep_s] = np.append(given.stand_m[-1] / 1e-3, given.yaw_rad[-1] / 0.1)
    assert np.min(np.abs(moved[1e-4][1:])) > 1.0
    np.testing.assert_allclose(moved[5e-4], moved[1e-4], rtol=0.0, atol=0.02)


def test_val_an_object_below_its_friction_limit_does_not_creep(make_run):
    """The whisker presses with up to 0.8 times the limit."""
    sweep = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.012, "strokes": 2, "peak_speed_m_s": 0.03}
    run = make_run(motion=sweep, object_stand={"mass_kg": 1e-3, "friction": 0.1})
    simulated = simulate(run)
    share = np.max(simulated.force_n) / (0.1 * 1e-3 * GRAVITY_M_S2)
    assert 0.7 < share < 0.9
    # Rows 0.1 s apart: between them the force on the feet, which are elastic by nanometres, hardly changes.
    apart = round(0.1 * run.scene.rate_hz)
    moved_m = simulated.yielding.stand_m
    creep_m_s = np.hypot(*(moved_m[apart:] - moved_m[:-apart]).T) / 0.1
    assert np.max(creep_m_s) < 1e-6
    assert np.max(np.abs(simulated.yielding.yaw_rad)) < 1e-5


@pytest.mark.parametrize("whisker", ["straight", "curved"])
@pytest.mark.parametrize("stiffness_n_m", [5.0, 100.0])
@pytest.mark.parametrize("stand", [None, {"mass_kg": 2e-4, "friction": 0.3}])
def test_val_indentations_follow_the_stated_stiffness(make_run, whisker, stiffness_n_m, stand):
    run = make_run(whisker=whisker, motion=SLOW, object_stiffness_n_m=stiffness_n_m, object_stand=stand)
    simulated = simulate(run)
    # After the impact, whose inertial forces the springs bear too.
    settled = simulated.time_s > simulated.time_s[np.argmax(simulated.touching)] + 0.1
    pressed = settled & (simulated.force_n > 5e-5)
    indentation_m = simulated.yielding.indentation_m[pressed]
    found_n_m = simulated.force_n[pressed] / np.hypot(*indentation_m.T)
    assert np.sum(pressed) > 100
    assert abs(np.median(found_n_m) / stiffness_n_m - 1.0) < 1e-3
    assert np.percentile(np.abs(found_n_m / stiffness_n_m - 1.0), 99) < 0.01
    # Along the inward normal.
    into_m = -np.sum(indentation_m * simulated.truth.normal[pressed], axis=1)
    assert np.percentile(np.abs(into_m / np.hypot(*indentation_m.T) - 1.0), 99) < 1e-3


@pytest.mark.parametrize("whisker", ["straight", "curved"])
def test_val_contacts_with_an_object_that_turns_agree_with_the_elastica(make_run, whisker):
    shape = {**ELLIPSE, "center_m": [0.01, -0.02]}
    run = make_run(
        whisker=whisker, object=shape, object_stand={"mass_kg": 2e-4, "friction": 0.1}, object_stiffness_n_m=20.0, motion=SLOW
    )
    simulated = simulate(run)
    assert np.max(np.abs(simulated.yielding.yaw_rad)) > 0.05
    assert np.max(np.abs(simulated.yielding.stand_m)) > 1e-3
    certificate = certified(run, simulated)
    assert certificate.sampled == 50
    assert certificate.unsolved == 0
    assert certificate.moment_rms < 5e-4
    assert certificate.surface_worst_m < 30e-6
    # The base follows its plan in World, and the contact is on the outline where that is.
    planned = run.scene.plan().poses[:: run.scene.steps_per_row]
    assert np.max(np.abs(simulated.base_pose - planned)) < 3e-4, "the base lags behind its command"
    _, distance_m = run.scene.object.closest(simulated.yielding.to_start(simulated.truth.surface_m))
    assert np.max(np.abs(distance_m[simulated.touching])) < 1e-9
    there_and_back_m = simulated.yielding.to_world(simulated.yielding.to_start(simulated.truth.surface_m))
    np.testing.assert_allclose(there_and_back_m, simulated.truth.surface_m, atol=1e-15)


def test_verif_a_heavy_object_gives_the_readings_of_a_fixed_one(make_run):
    fixed, heavy = simulate(make_run()), simulate(make_run(object_stand={"mass_kg": 0.02, "friction": 0.3}))
    assert fixed.yielding is None
    np.testing.assert_allclose(heavy.rotations_rad, fixed.rotations_rad, atol=1e-6)
    np.testing.assert_allclose(heavy.truth.contact_m, fixed.truth.contact_m, atol=1e-7)


def test_verif_traces_have_the_displacements_of_objects_that_give_way_only(make_run, tmp_path):
    for name, changes in (("fixed", {}), ("soft", {"object_stiffness_n_m": 20})):
        run = make_run(name=name, **changes)
        write_trace(tmp_path, run, simulate(run))
    headers = [(tmp_path / f"{name}.csv").read_text().splitlines()[0].split(",") for name in ("fixed", "soft")]
    assert headers[0] == [column for column, _ in COLUMNS]
    assert headers[1] == [column for column, _ in COLUMNS + YIELDING_COLUMNS]
    rows = [row.split(",") for row in (tmp_path / "soft.csv").read_text().splitlines()[1:]]
    assert rows[0][-4:] == ["0.0000000000"] * 4
    assert any(row[-1] != "0.0000000000" for row in rows)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"object_stand": {"mass_kg": 0.002}, "friction": 0.3}, ["friction: expected none with object_stand, found 0.3"]),
        (
            {"object_stiffness_n_m": 20, "object_velocity_m_s": [0.001, 0.0]},
            ["object_velocity_m_s: expected none with object_stiffness_n_m, found [0.001, 0.0]"],
        ),
        (
            {"object_stand": {"mass_kg": 0.002}, "object": L},
            ["object_stand: expected none with an object that is not convex"],
        ),
        ({"object_stand": {"mass_kg": 2e-5}}, ["object_stand.mass_kg"]),
        ({"object_stand": {"mass_kg": 0.002, "friction": 0.0}}, ["object_stand.friction"]),
        ({"object_stand": {}}, ["mass_kg"]),
        ({"object_stiffness_n_m": 1e5}, ["object_stiffness_n_m"]),
    ],
)
def test_robust_what_an_object_that_gives_way_cannot_have_is_refused(write_scene, assert_rejected, changes, words):
    assert_rejected(write_scene(**changes), ["expected", *words])


def test_verif_scenes_are_read_as_written(make_run):
    scene = make_run(object_stand={"mass_kg": 0.002}, object_stiffness_n_m=20).scene
    assert msgspec.convert(msgspec.to_builtins(scene), Scene) == scene
    assert scene.stand.friction == 0.5


def objects_of(suite):
    """Shape, stand and stiffness of the object of each trial of a suite, as JSON."""
    entries = [json.loads((SUITES / entry["scene"]).read_text()) for entry in json.loads((SUITES / suite).read_text())["scenes"]]
    keys = ("object", "object_stand", "object_stiffness_n_m")
    return [tuple(json.dumps(scene.get(key)) for key in keys) for scene in entries if scene["role"] == "trial"]


def test_verif_settings_and_reports_use_different_objects():
    training, reported = objects_of("yielding_training.json"), objects_of("yielding.json")
    assert (len(training), len(reported)) == (18, 32)
    assert set(training).isdisjoint(reported)
