"""Quasi-static stick and slip: conservation of energy, step size, the cone, and the simulation."""

import msgspec
import numpy as np
import pytest

from whisker_sim.elastica import touching
from whisker_sim.errors import SimulationError
from whisker_sim.physics import friction
from whisker_sim.physics.stick_slip import StickSlip, stick_slip
from whisker_sim.shapes.circle import Circle
from whisker_sim.whisker import PRESETS

DISC = Circle(radius_m=0.005)
MU = 0.5


def pressed(steps: int) -> tuple[np.ndarray, StickSlip]:
    """Base poses, and contact, of the curved whisker pressed twice by 8 mm from a depth of 2 mm, in `steps` steps each way."""
    whisker = PRESETS["curved"][1]
    arc_m, yaw_rad = 0.05, -float(whisker.rest_angle_rad(0.05))
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = whisker.rest_point_m(arc_m)
    depth_m = 0.002 + 0.008 * (0.5 - 0.5 * np.cos(np.pi * np.arange(4 * steps + 1) / steps))
    # The disc is to the left of the whisker, whose tangent at the contact is along +x.
    below_m = -(DISC.radius_m + float(whisker.radius_m(arc_m))) + depth_m
    poses = np.stack(
        (np.full_like(depth_m, -cos * x + sin * y), below_m - sin * x - cos * y, np.full_like(depth_m, yaw_rad)), axis=-1
    )
    return poses, stick_slip(whisker, DISC, 1, poses, MU, np.full_like(depth_m, arc_m), 0.06 * depth_m)


def test_verif_friction_dissipates_the_work_of_the_base():
    """In a closed cycle of the base the work against the contact force equals that of the friction along the slip, to 0.1 %."""
    poses, found = pressed(200)
    whisker = PRESETS["curved"][1]
    exact = touching(whisker, DISC, 1, poses, found.arc_m, found.force_n, found.friction_rad)
    normal = exact.surface_m / DISC.radius_m
    forward = np.stack((-normal[:, 1], normal[:, 0]), axis=-1)
    along_n, across_n = found.force_n * np.sin(found.friction_rad), found.force_n * np.cos(found.friction_rad)
    force_n = across_n[:, None] * normal + along_n[:, None] * forward
    cycle = slice(len(poses) // 2, None)
    force_n, moved_m, along_n = force_n[cycle], np.diff(poses[cycle, :2], axis=0), along_n[cycle]
    work_j = -np.sum(0.5 * (force_n[1:] + force_n[:-1]) * moved_m)
    dissipated_j = -np.sum(0.5 * (along_n[1:] + along_n[:-1]) * found.slip_m[cycle][1:])
    assert dissipated_j > 1e-7
    assert work_j == pytest.approx(dissipated_j, rel=1e-3)


def test_verif_the_contact_does_not_depend_on_the_steps():
    """With half the step the contact is the same at common instants: the slip is integrated exactly between its reversals."""
    coarse, fine = pressed(25)[1], pressed(50)[1]
    np.testing.assert_allclose(fine.moment_n_m[::2], coarse.moment_n_m, atol=1e-9 * np.max(np.abs(coarse.moment_n_m)))
    np.testing.assert_allclose(fine.friction_rad[::2], coarse.friction_rad, atol=1e-8)
    assert np.sum(fine.slip_m) == pytest.approx(np.sum(coarse.slip_m), abs=1e-12)


def test_verif_slip_is_opposed_to_the_friction_on_the_cone():
    _, found = pressed(50)
    slipping = ~found.sticking
    assert np.sum(slipping) > 50
    assert 4 < np.sum(found.sticking[1:]) < 100
    np.testing.assert_allclose(np.abs(found.friction_rad[slipping]), np.arctan(MU))
    assert np.all(found.slip_m[slipping] * found.friction_rad[slipping] <= 0.0)
    assert np.all(found.slip_m[found.sticking] == 0.0)
    assert np.all(np.abs(found.friction_rad) <= np.arctan(MU) + 1e-12)


def test_robust_a_motion_without_equilibrium_is_one_error():
    poses = np.array(((0.0, -1.0, 0.0), (0.0, -1.0, 0.0)))
    with pytest.raises(SimulationError, match="no equilibrium on the disc at 2 of 2 instants"):
        stick_slip(PRESETS["straight"][1], DISC, 1, poses, MU, np.full(2, 0.05), np.full(2, 1e-3))


def test_val_simulated_hysteresis_agrees_with_stick_and_slip(monkeypatch):
    """A short press of the curved whisker with reversal, within the bounds of the study."""
    monkeypatch.setattr(friction, "_PRESS_M", {"curved": 0.006})
    monkeypatch.setattr(friction, "_RUB", {"along_m": 0.002})
    case = next(case for case in friction.cases() if case.name == "curved, concave side, circle, 0.5")
    row, loops, _ = friction.compare(case)
    assert row.moment_rms < 1e-3
    assert row.angle_rms_rad < np.radians(0.5)
    assert row.creep_m_s < 1e-6
    assert all(abs(loop.deviation) < 0.02 for loop in loops)


def test_verif_claims_of_the_study_need_every_value():
    """A claim about the worst case does not hold if one case has no value."""
    row = friction.Row("a", 0.5, 10, 1, 1e-4, 1e-5, 1e-4, 5, 0.0, 1e-4, 1e-4, 1e-8)
    loop = friction.Loop("a", "press", 1e-9, 0.01, 0.001)
    assert all(claim.holds for claim in friction.STUDY.conclude([(row, [loop], [])]).claims)
    broken = row._replace(moment_rms=float("nan"))
    assert not all(claim.holds for claim in friction.STUDY.conclude([(row, [loop], []), (broken, [loop], [])]).claims)


def test_verif_damping_is_the_only_change_of_the_whiskers():
    """The study's whiskers are the presets with a tenth of their damping."""
    for case in friction.cases():
        whisker, preset = friction.scene_of(case).resolved_whisker, PRESETS[case.whisker][1]
        assert whisker == msgspec.structs.replace(preset, name=whisker.name, damping_s=0.1 * preset.damping_s)
