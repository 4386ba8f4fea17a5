"""Complete traces against the exact elastica, and the ground truth against brute force."""

import json
from itertools import pairwise

import numpy as np
import pytest

from whisker_sim.errors import SimulationError
from whisker_sim.physics.scipy_elastica import contact_with_disc
from whisker_sim.runs import load_runs
from whisker_sim.simulate import simulate
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
