"""SciPy's elastica: published values, closed forms, and the golden cases that also test the solver in Rust."""

import msgspec
import numpy as np
import pytest

from whisker_sim.physics.oracle import PUBLISHED, cantilever
from whisker_sim.physics.scipy_elastica import GOLDEN, GOLDEN_CASES, GOLDEN_SEED, random_friction, read_cases, static_contact
from whisker_sim.whisker import PRESETS

STRAIGHT = PRESETS["straight"][1]
CLAMPED = msgspec.structs.replace(STRAIGHT, root_stiffness_n_m_rad=1e12)
BENDING_N_M2 = STRAIGHT.youngs_modulus_pa * np.pi * STRAIGHT.root_diameter_m**4 / 64.0


@pytest.mark.parametrize(("load", "deflection", "shortening"), PUBLISHED)
def test_val_mattiasson(load, deflection, shortening):
    assert cantilever(load) == pytest.approx((deflection, shortening), abs=0.5e-5)


def test_val_small_deflection():
    """Root and wire in series, and a straight line beyond the contact."""
    arc_m, force_n = 0.05, 1e-8
    contact = static_contact(STRAIGHT, arc_m, force_n)
    root_rad = force_n * arc_m / STRAIGHT.root_stiffness_n_m_rad
    deflection_m = force_n * arc_m**3 / (3.0 * BENDING_N_M2) + root_rad * arc_m
    angle_rad = force_n * arc_m**2 / (2.0 * BENDING_N_M2) + root_rad
    assert contact.point_m[1] == pytest.approx(deflection_m, rel=1e-8)
    assert contact.angle_rad == pytest.approx(angle_rad, rel=1e-8)
    assert contact.moment_n_m == pytest.approx(force_n * arc_m, rel=1e-8)
    assert contact.tip_m[1] == pytest.approx(deflection_m + angle_rad * (STRAIGHT.length_m - arc_m), rel=1e-8)


def test_val_tapered_cone():
    """A cone under a small force F at its tip deflects by 64 F L^3 / (3 pi E d0^3 d1)."""
    cone = msgspec.structs.replace(CLAMPED, tip_diameter_m=0.05e-3)
    force_n = 1e-10
    expected_m = 64.0 * force_n * cone.length_m**3 / (3.0 * np.pi * cone.youngs_modulus_pa * cone.root_diameter_m**3 * 0.05e-3)
    assert static_contact(cone, cone.length_m, force_n).point_m[1] == pytest.approx(expected_m, rel=1e-8)


def test_regress_golden_cases():
    """The file contains the cases of its seed and their solutions, to 1e-10."""
    cases = list(read_cases(GOLDEN))
    assert len(cases) == GOLDEN_CASES
    for index, (whisker, load, answer) in enumerate(cases):
        assert load == pytest.approx(random_friction(GOLDEN_SEED, index)[1:], rel=1e-12, abs=1e-18)
        arc_m, along_n, left_n, couple_n_m = load
        contact = static_contact(whisker, arc_m, left_n, along_n, couple_n_m)
        assert np.hypot(*(contact.point_m - answer[:2])) < 1e-10 * arc_m
        assert contact.angle_rad == pytest.approx(answer[2], abs=1e-10)
        assert contact.moment_n_m == pytest.approx(answer[3], rel=1e-10)
        assert np.hypot(*(contact.tip_m - answer[4:])) < 1e-10 * whisker.length_m
