"""The whisker in space: SciPy, the solver for many loads at once, and the plane agree."""

import numpy as np
import pytest

from whisker_sim.elastica import loaded
from whisker_sim.physics.scipy_rod import (
    GOLDEN,
    GOLDEN_CASES,
    GOLDEN_SEED,
    deviation,
    random_spatial_case,
    read_cases,
    solve,
)
from whisker_sim.rod import Suspension, spatially_loaded
from whisker_sim.whisker import PRESETS

WHISKERS = [whisker for _, whisker in PRESETS.values()]


def test_val_the_batched_solver_agrees_with_scipy():
    cases = list(read_cases(GOLDEN))
    assert len(cases) == GOLDEN_CASES
    assert max(deviation(case, answer) for case, answer in cases) < 1e-9


@pytest.mark.parametrize("index", [3, 4])
def test_regress_golden_cases(index):
    """The file contains the cases of its seed and their solutions."""
    case, answer = list(read_cases(GOLDEN))[index]
    made = random_spatial_case(GOLDEN_SEED, index)
    assert np.append(made.arc_m, made.force_n) == pytest.approx(np.append(case.arc_m, case.force_n), rel=1e-12, abs=1e-18)
    assert np.concatenate(solve(case)) == pytest.approx(answer, rel=1e-9, abs=1e-12)


# The planar solver takes fewer steps, which shows in a taper to a fifth.
@pytest.mark.parametrize("whisker", WHISKERS, ids=lambda whisker: whisker.name)
def test_verif_a_load_in_the_plane_gives_the_planar_elastica(whisker):
    arc_m = whisker.length_m * np.array((0.4, 0.7, 1.0))
    force_n = whisker.root_stiffness_n_m_rad / whisker.length_m * np.array((-0.2, 0.3, 0.1))
    planar = loaded(whisker, arc_m, force_n)
    suspension = Suspension(whisker.root_stiffness_n_m_rad, 1.0, 1.0)
    spatial = spatially_loaded(whisker, suspension, 0.33, arc_m, np.stack((0.0 * force_n, force_n, 0.0 * force_n), axis=-1))
    assert spatial.moment_n_m[:, 2] == pytest.approx(planar.moment_n_m, rel=1e-7)
    assert spatial.point_m[:, :2] == pytest.approx(planar.point_m, abs=1e-7 * whisker.length_m)
    assert np.abs(spatial.moment_n_m[:, :2]).max() == 0.0
    assert np.abs(spatial.point_m[:, 2]).max() == 0.0
