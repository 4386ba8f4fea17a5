"""Objects that are not convex: contacts that jump, and contacts in two places, against the elastica under two loads."""

import math

import msgspec
import numpy as np
import pytest

from whisker_sim.certificate import certify
from whisker_sim.elastica import loaded
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate
from whisker_sim.trace import COLUMNS, SECOND_COLUMNS, write_trace
from whisker_sim.two_loads import loaded_twice
from whisker_sim.whisker import PRESETS

L = {"shape": "l", "x_m": 0.014, "y_m": 0.02, "thickness_m": 0.006, "yaw_rad": -2.356}
"""Its arms open towards a straight whisker; the farther end protrudes."""
TURNS_RAD = {"straight": 0.0, "curved": 0.65}
"""Rotation of the L, for the direction of the whisker at the touch."""
BRIDGING = {
    "kind": "stations",
    "contact_arc_m": 0.058,
    "stations": [{"depth_m": 0.002}, {"depth_m": 0.010}, {"depth_m": 0.002}],
    "peak_speed_m_s": 0.004,
}


@pytest.fixture(params=["straight", "curved"])
def bridged(request, make_run):
    """A slow press against both arms of an L, and its simulation."""
    turned = {**L, "yaw_rad": L["yaw_rad"] + TURNS_RAD[request.param]}
    run = make_run(whisker=request.param, object=turned, motion=BRIDGING)
    return run, simulate(run)


def test_val_two_contacts_agree_with_the_elastica_under_two_loads(bridged):
    """Moment, places and penetration agree as in contact with a convex object."""
    run, simulated = bridged
    scene = run.scene
    certificate = certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)
    assert certificate.sampled_twice > 5
    assert certificate.unsolved == 0
    assert certificate.moment_rms < 5e-4
    assert certificate.surface_worst_m < 30e-6
    assert certificate.arc_rms_m < 20e-6
    assert certificate.penetration_worst_m < 5e-6


def test_verif_the_contact_moves_from_the_outer_end_to_the_inner_one_by_way_of_both(bridged):
    """The load passes from one end to the other continuously, and back."""
    run, simulated = bridged
    ends_m = run.scene.object.to_world(np.array(((0.0, L["y_m"]), (L["x_m"], 0.0))))
    exists = simulated.second.exists
    assert not np.any(exists & ~simulated.touching)
    assert not np.any(exists & ~simulated.split)
    phases = np.flatnonzero(np.diff(exists.astype(int)))
    assert len(phases) == 4
    outer = np.hypot(*(simulated.truth.surface_m - ends_m[0]).T) < 1e-5
    inner = np.hypot(*(simulated.truth.surface_m - ends_m[1]).T) < 1e-5
    assert np.all((outer | inner)[simulated.touching])
    both_m = simulated.second.surface_m[exists]
    other_m = np.where(outer[exists, None], ends_m[1], ends_m[0])
    assert np.max(np.abs(both_m - other_m)) < 1e-5
    for row, arriving in zip(phases, (True, False, True, False), strict=True):
        pair = sorted((simulated.force_n[row + arriving], simulated.second.force_n[row + arriving]))
        assert pair[0] < 0.2 * pair[1]


@pytest.mark.parametrize(("name", "yaw_rad"), [("straight", -1.22), ("curved", -0.66)])
def test_verif_a_star_has_the_moment_of_its_convex_hull(make_run, name, yaw_rad):
    """On the star it bears on two points at once, on the polygon its contact slides along a side: the moment does not differ."""
    star = {"shape": "star", "points": 7, "outer_m": 0.018, "inner_m": 0.01, "yaw_rad": yaw_rad}
    hull = {"shape": "regular_polygon", "sides": 7, "side_m": 2 * 0.018 * math.sin(math.pi / 7), "yaw_rad": yaw_rad}
    motion = {**BRIDGING, "contact_arc_m": 0.055, "stations": [{"depth_m": depth_m} for depth_m in (0.002, 0.012, 0.002)]}
    on_star, on_hull = (simulate(make_run(whisker=name, object=shape, motion=motion)) for shape in (star, hull))
    assert np.any(on_star.second.exists)
    # The moment at the root is proportional to its rotation.
    by_root = [simulated.rotations_rad[:, 0] for simulated in (on_star, on_hull)]
    assert np.max(np.abs(by_root[0] - by_root[1])) < 5e-3 * np.max(np.abs(by_root))


@pytest.mark.parametrize("name", PRESETS)
def test_verif_a_second_load_of_zero_has_no_effect(name):
    """Then the whisker is that under one load, whichever of the two it is."""
    whisker = PRESETS[name][1]
    outer_m = whisker.length_m * np.array((0.5, 0.7, 0.9))
    inner_m = outer_m * np.array((0.9, 0.5, 0.3))
    force_n = (
        whisker.youngs_modulus_pa * np.pi * whisker.root_diameter_m**4 / 64.0 / whisker.length_m**2 * np.array((0.3, -1.0, 2.0))
    )
    arcs_m, none_n = np.stack((inner_m, outer_m), axis=1), np.zeros(3)
    for at, forces_n in ((1, (none_n, force_n)), (0, (force_n, none_n))):
        twice = loaded_twice(whisker, arcs_m, np.stack(forces_n, axis=1))
        once = loaded(whisker, arcs_m[:, at], force_n)
        np.testing.assert_allclose(twice.moment_n_m, once.moment_n_m, rtol=1e-6)
        np.testing.assert_allclose(twice.point_m[:, at], once.point_m, atol=1e-7)
        np.testing.assert_allclose(twice.tangent_rad[:, at], once.tangent_rad, atol=1e-6)


def test_verif_two_loads_superpose_where_they_are_small():
    """The moments of small loads add up."""
    whisker = PRESETS["curved"][1]
    arcs_m = np.array(((0.03, 0.06),))
    force_n = 1e-8 * np.array(((1.0, 0.6),))
    twice = loaded_twice(whisker, arcs_m, force_n)
    once = [loaded(whisker, arcs_m[:, at], force_n[:, at]).moment_n_m for at in (0, 1)]
    assert twice.moment_n_m[0] == pytest.approx(float(sum(once)[0]), rel=1e-5)


@pytest.mark.parametrize("first", [0, 1])
def test_verif_a_second_load_nearer_to_the_root_raises_the_moment_and_one_nearer_to_the_tip_lowers_it(first):
    """With the first contact, of the inner (0) or outer (1) load, at the same place; the loads are small and of the same side."""
    whisker = PRESETS["straight"][1]
    arcs_m = np.array(((0.03, 0.06),))
    forces_n = 1e-6 * np.array(((2.0, 1.0),))
    twice = loaded_twice(whisker, arcs_m, forces_n)
    once = loaded(whisker, arcs_m[:, first], forces_n[:, first])
    alone_n_m = once.moment_n_m[0] * twice.point_m[0, first, 1] / once.point_m[0, 1]
    change = abs(twice.moment_n_m[0]) - abs(alone_n_m)
    assert change * (1 if first == 1 else -1) > 0.01 * abs(alone_n_m)


def test_verif_columns_of_the_second_contact(bridged, tmp_path):
    """They appear in traces of objects that are not convex, and are empty where there is none."""
    run, simulated = bridged
    write_trace(tmp_path, run, simulated)
    header, *rows = (tmp_path / f"{run.name}.csv").read_text(encoding="utf-8").splitlines()
    assert header.split(",") == [name for name, _ in COLUMNS + SECOND_COLUMNS]
    fields = [row.split(",") for row in rows]
    assert all((row[11] == "1") == all(row[-6:]) for row in fields)
    assert all(row[11] == "1" or not any(row[-6:]) for row in fields)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"object": {"shape": "star", "points": 5, "outer_m": 0.02, "inner_m": 0.017}}, "inner_m: expected less than 0.0161803"),
        ({"object": {"shape": "discs", "radius_m": 0.01, "distance_m": 0.02}}, "distance_m: expected less than 2 radius_m = 0.02"),
        ({"object": L, "friction": 0.3}, r"friction: expected none with an object that is not convex \('l'\)"),
    ],
)
def test_robust_impossible_shapes_are_refused(make_run, changes, words):
    scene = msgspec.to_builtins(make_run().scene)
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert({**scene, **changes}, Scene)
