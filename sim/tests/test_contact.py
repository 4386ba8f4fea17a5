"""Complete traces against the exact elastica, and the ground truth against brute force."""

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from whisker_sim.errors import SimulationError
from whisker_sim.motions.base import REST_S
from whisker_sim.physics.scipy_elastica import contact_with_disc
from whisker_sim.runs import load_runs
from whisker_sim.simulate import check_contacts, simulate, tunnelling_limit_m
from whisker_sim.truth import CenterLine, nearest_contact

from conftest import SCENES

CASES = {
    "straight_pin": {"object": {"shape": "pin"}},
    "straight_circle": {},
    "curved_concave": {"whisker": "curved"},
    "curved_convex": {"whisker": "curved", "face": "right", "object": {"shape": "pin"}},
    "stanford": {
        "whisker": "stanford",
        "motion": {"kind": "lateral_sweep", "contact_arc_m": 0.03, "stroke_m": 0.004, "strokes": 1},
    },
    "tapered": {"whisker": {"preset": "straight", "name": "tapered", "tip_diameter_m": 0.00015}},
}

STEEP = {"preset": "straight", "name": "steep", "root_diameter_m": 0.0003, "tip_diameter_m": 0.00008}


@pytest.mark.parametrize("case", CASES)
def test_val_moment_against_the_elastica(make_run, case):
    """Base moment within 0.05 % of its range and contact within micrometres, at instants after the impact has decayed."""
    run = make_run(**CASES[case])
    simulated = simulate(run)
    whisker, disc = run.scene.resolved_whisker, run.scene.object
    face = 1 if run.scene.face == "left" else -1
    moment = whisker.root_stiffness_n_m_rad * simulated.rotations_rad[:, 0]
    touch = int(np.argmax(simulated.touching))
    errors, arc_errors_m = [], []
    for row in np.linspace(touch + 0.3 * run.scene.rate_hz, len(moment) - 1, 15).astype(int):
        x, y, yaw = simulated.base_pose[row]
        turn = np.array(((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))))
        center_m = turn @ (np.array(disc.center_m) - (x, y))
        guess = (simulated.truth.arc_m[row], simulated.force_n[row])
        arc_m, _, static = contact_with_disc(whisker, center_m, disc.radius_m, face, guess)
        errors.append(moment[row] - static.moment_n_m)
        arc_errors_m.append(simulated.truth.arc_m[row] - arc_m)
    reach = np.max(np.abs(moment))
    assert np.sqrt(np.mean(np.square(errors))) < 5e-4 * reach
    assert np.max(np.abs(arc_errors_m)) < 15e-6
    # An object on the left pushes the whisker to the right.
    assert np.sign(moment[np.argmax(np.abs(moment))]) == -face


def test_verif_reading_has_no_jumps(make_run):
    """The slope of the reading is smooth, although the contact passes links and capsules."""
    simulated = simulate(make_run(whisker="curved", object={"shape": "circle", "radius_m": 0.05}))
    touch = int(np.argmax(simulated.touching)) + 75
    reading = simulated.rotations_rad[touch:, 0]
    assert np.max(np.abs(np.diff(reading, 2))) < 2e-3 * np.max(np.abs(reading))


@pytest.mark.parametrize(
    "settings",
    [
        {
            "whisker": "curved",
            "face": "right",
            "object": {"shape": "rectangle", "width_m": 0.03, "height_m": 0.03, "yaw_rad": 0.35},
        },
        # This taper displaces the contact on the circle by 0.07 mm.
        {"whisker": STEEP, "object": {"shape": "circle", "radius_m": 0.05}},
    ],
    ids=["corner", "steep"],
)
def test_verif_nearest_contact_against_brute_force(make_run, settings):
    """The contact is at the minimum of distance less radius over a dense sampling of the centre line."""
    run = make_run(**settings)
    simulated = simulate(run)
    rows = np.flatnonzero(simulated.touching)[::40]
    line = CenterLine.from_joints(run.scene.resolved_whisker, simulated.base_pose[rows], simulated.rotations_rad[rows])
    truth = nearest_contact(line, run.scene.object)
    arcs_m = np.linspace(0.0, run.scene.resolved_whisker.length_m, 8001)
    for index in range(len(rows)):
        _, distance_m = run.scene.object.closest(line.at(arcs_m, np.full(len(arcs_m), index))[0])
        clearance_m = distance_m - run.scene.resolved_whisker.radius_m(arcs_m)
        assert abs(arcs_m[np.argmin(clearance_m)] - truth.arc_m[index]) < 1.5e-5


@pytest.mark.parametrize("name", ["pin_straight", "pin_curved", "circle_15_curved", "octagon_straight", "rectangle_curved"])
def test_verif_standard_trials_hold_their_contact(name):
    """From 50 ms after the first contact to the end the whisker touches, not at the tip, with micrometres of penetration."""
    _, (run,) = load_runs(SCENES / f"{name}.json")
    simulated = simulate(run)
    touch = int(np.argmax(simulated.touching))
    assert 0.2 < simulated.time_s[touch] < (0.5 if "pin" in name else 0.7)
    assert np.all(simulated.touching[touch + 13 :])
    assert not np.any(simulated.truth.tip[simulated.touching])
    assert np.max(simulated.penetration_m) < 5e-6


def test_robust_deep_penetration_fails_the_run(make_run, monkeypatch):
    """A penetration above the bound is an error that states its time."""
    monkeypatch.setattr("whisker_sim.simulate.PENETRATION_LIMIT_M", 1e-9)
    with pytest.raises(SimulationError, match=r"penetration of \S+ m at \d+\.\d+ s"):
        simulate(make_run())


def contacts_of(touching, penetration_m=0.0, rate_hz=50.0):
    """Contacts in the rows after the rest at the start."""
    time_s = REST_S + np.arange(1, len(touching) + 1) / rate_hz
    touching = np.array(touching, dtype=bool)
    return SimpleNamespace(time_s=time_s, touching=touching, penetration_m=np.where(touching, penetration_m, 0.0))


def check(simulated, guaranteed):
    check_contacts(simulated, guaranteed, np.zeros(len(simulated.time_s), dtype=bool), tunnelling_limit_m(1e-4, 5e-4))


def test_verif_an_interval_between_rows_is_judged_by_the_rows_around_it():
    """One of the rows within a period must be in contact."""
    between_s = REST_S + 0.05
    for touching in ([0, 1, 1, 1], [0, 1, 0, 0], [0, 0, 1, 0]):
        check(contacts_of(touching), [(between_s, between_s + 0.005)])
    for touching in ([0, 0, 0, 1], [1, 0, 0, 1]):
        with pytest.raises(SimulationError, match=r"contact lost at \S+ s, expected from \S+ s to \S+ s"):
            check(contacts_of(touching), [(between_s, between_s + 0.005)])
    with pytest.raises(SimulationError, match=r"penetration of 3\.0e-05 m"):
        check(contacts_of([0, 1, 0, 0], 3e-5), [(between_s, between_s)])


def test_robust_a_whisker_that_never_touches_fails_the_run():
    """Also if the guaranteed contact is after the last row."""
    for start_s in (REST_S + 0.05, REST_S + 10.0):
        with pytest.raises(SimulationError, match="whisker never touches the object, expected contact from"):
            check(contacts_of([0, 0, 0, 0]), [(start_s, start_s)])
    check(contacts_of([0, 0, 0, 0]), [])


def test_robust_a_whisker_that_passes_through_the_object_fails_the_run():
    """A penetration of half of the radii of wire and object is refused, also where no contact is guaranteed."""
    check(contacts_of([0, 1, 0, 0], 2.9e-4), [])
    with pytest.raises(SimulationError, match=r"whisker passes through the object: penetration of 3\.1e-04 m .*at most 3\.0e-04 m"):
        check(contacts_of([0, 1, 0, 0], 3.1e-4), [])


@pytest.mark.parametrize(
    ("shape", "radius_m"),
    [
        ({"shape": "pin", "radius_m": 2e-4}, 2e-4),
        ({"shape": "rectangle", "width_m": 0.03, "height_m": 0.001, "yaw_rad": 0.35}, 5e-4),
        ({"shape": "circle", "radius_m": 0.015, "center_m": [0.1, 0.2]}, 0.015),
    ],
)
def test_verif_the_largest_circle_inside_a_shape(make_run, shape, radius_m):
    assert make_run(object=shape).scene.object.thickest_radius_m() == pytest.approx(radius_m, rel=1e-4)


def test_verif_calibration_strata():
    """There is one push in every stratum of the arc length, and none slips off the tip."""
    _, (run,) = load_runs(SCENES / "calibration_curved_concave.json")
    motion = run.scene.motion
    plan = motion.plan(run.scene.stage())
    middles = [round(0.5 * (start_s + end_s) / run.scene.simulation.timestep_s) for start_s, end_s in plan.touching]
    assert len(middles) == motion.lines
    assert all(a < b for a, b in pairwise(middles))
    assert np.ptp(plan.poses[:, 2]) == 0.0
    simulated = simulate(run)
    assert not np.any(simulated.truth.tip[simulated.touching])
    assert np.min(simulated.truth.arc_m[simulated.touching]) < motion.arc_min_m + 3e-3
    assert np.max(simulated.truth.arc_m[simulated.touching]) > motion.arc_max_m - 3e-3
    assert json.loads((SCENES / "calibration_curved_concave.json").read_text())["face"] == "left"
