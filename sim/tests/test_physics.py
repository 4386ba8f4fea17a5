"""Excerpt of the physics studies: the solver in NumPy against SciPy's, convergence of the chain, the beam, the claims."""

import msgspec
import numpy as np
import pytest

from whisker_sim.elastica import loaded, touching
from whisker_sim.motions import Stage
from whisker_sim.physics import convergence, disturbance, frequencies, ringing, standing
from whisker_sim.physics.cases import TAPERED, WHISKERS
from whisker_sim.physics.command import main
from whisker_sim.physics.scipy_elastica import contact_with_disc, pushed, static_contact
from whisker_sim.physics.study import Claim
from whisker_sim.shapes.circle import Circle
from whisker_sim.whisker import PRESETS

OF_EVERY_KIND = [*(whisker for _, whisker in PRESETS.values()), TAPERED]


@pytest.mark.parametrize("whisker", OF_EVERY_KIND, ids=lambda whisker: whisker.name)
def test_val_oracle_against_scipy(whisker):
    """Both solvers agree to 1e-9 in moment, point and angle, for loads to either side."""
    rng = np.random.default_rng(5)
    arc_m = rng.uniform(0.2, 0.95, 8) * whisker.length_m
    force_n = rng.uniform(-1e-3, 1e-3, 8)
    fast = loaded(whisker, arc_m, force_n)
    for index in range(8):
        exact = static_contact(whisker, arc_m[index], force_n[index])
        assert fast.moment_n_m[index] == pytest.approx(exact.moment_n_m, rel=1e-9)
        assert fast.tangent_rad[index] == pytest.approx(exact.angle_rad, abs=1e-9)
        np.testing.assert_allclose(fast.point_m[index], exact.point_m, atol=1e-9 * whisker.length_m)


@pytest.mark.parametrize(("name", "face", "height_m"), [("curved", 1, 0.02), ("tapered", 1, 0.01), ("tapered", -1, -0.01)])
def test_val_contact_against_scipy(name, face, height_m):
    """Both solvers find the same contact with a disc."""
    whisker, disc = WHISKERS[name], Circle(radius_m=0.015, center_m=(0.05, height_m))
    arc_m, force_n, exact = contact_with_disc(whisker, np.array(disc.center_m), disc.radius_m, face, (0.05, 3e-4))
    found = touching(whisker, disc, face, np.zeros((1, 3)), np.array([0.051]), np.array([2.5e-4]))
    assert found.solved[0]
    assert found.arc_m[0] == pytest.approx(arc_m, rel=1e-8)
    assert found.force_n[0] == pytest.approx(force_n, rel=1e-8)
    assert found.moment_n_m[0] == pytest.approx(exact.moment_n_m, rel=1e-8)


def test_robust_an_object_out_of_reach_is_unsolved():
    """The solver marks a case without contact as unsolved."""
    far = Circle(radius_m=0.015, center_m=(0.05, 0.2))
    found = touching(WHISKERS["straight"], far, 1, np.zeros((1, 3)), np.array([0.05]), np.array([1e-4]))
    assert not found.solved[0]


def test_val_chain_at_rest_is_of_second_order():
    """Straight whisker deflected 10 mm by a pin: half of the segment length, a quarter of the error."""
    stage = Stage(WHISKERS["straight"], convergence.OBJECTS["pin"], 1, 0.001, None, np.random.default_rng())
    poses, exact = convergence.pushed(stage, 0.01)
    errors = []
    for segments in (10, 20, 40):
        chain = msgspec.structs.replace(WHISKERS["straight"], segments=segments)
        errors.append(abs(convergence.relaxed(chain, stage, poses[:1], exact[0]).moment_error))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    assert errors[2] < 1e-4


def test_val_frequencies_of_the_beam():
    """The characteristic equation has its known limits; the frequencies of the chain are within 0.1 % of those of the beam."""
    whisker = WHISKERS["straight"]
    clamped = msgspec.structs.replace(whisker, root_stiffness_n_m_rad=1e6)
    scale = frequencies.beam_hz(clamped, 3) / frequencies.beam_hz(clamped, 3)[0]
    np.testing.assert_allclose(scale, np.array((3.51602, 22.0345, 61.6972)) / 3.51602, rtol=1e-5)
    np.testing.assert_allclose(frequencies.chain_hz(whisker, 3), frequencies.beam_hz(whisker, 3), rtol=1e-3)


def test_val_the_damping_of_the_preset_is_that_of_the_published_decay():
    """Time constant 2 / (w^2 (tau + h)) at the time step of the study, by which the ringing falls to the noise in 1.4 s."""
    preset = PRESETS["straight"][1]
    omega_rad_s = 2.0 * np.pi * frequencies.beam_hz(preset, 1)[0]
    damping_s = 2.0 * np.log(ringing.PUBLISHED_FALL) / (omega_rad_s**2 * ringing.PUBLISHED_DYING_S) - ringing._TIMESTEP_S
    assert preset.damping_s == pytest.approx(damping_s, rel=1e-3)


def test_val_ringing_decays_with_the_expected_time_constant():
    """Decay within 1 % of 2 / (w^2 (h + tau)); the energy never increases."""
    row, _ = ringing.release("test", 2e-3, 0.001)
    assert row.decay_s == pytest.approx(row.expected_decay_s, rel=0.01)
    assert row.energy_growth < 1e-12


def test_verif_a_claim_without_a_value_does_not_hold():
    assert not Claim("id", "claim", float("nan"), "<=", 1.0, "").holds
    assert not Claim("id", "claim", float("nan"), ">=", 1.0, "").holds


@pytest.mark.parametrize("field", ["drift_m", "creep_m", "slides_at_n", "tips_at_n"])
def test_verif_a_study_with_a_missing_value_fails(field):
    """A claim does not hold if one of its rows has no value, such as an object that does not move."""
    good = standing.Row(0.02, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0)
    assert all(claim.holds for claim in standing.STUDY.conclude([good, good]).claims)
    for rows in ([good, good._replace(**{field: float("nan")})], [good._replace(**{field: float("nan")}), good]):
        assert sum(not claim.holds for claim in standing.STUDY.conclude(rows).claims) == 1


def test_verif_claims_of_displaced_objects_are_about_single_sweeps():
    """A sweep with a thick wire or a fast base that displaces the object does not support a claim about the preset's wire."""
    rows = []
    for tasks in (disturbance._BY_APPROACH, disturbance._BY_STIFFNESS, disturbance._BY_SPEED):
        for task in tasks:
            whisker, mass_kg, approach_rad, tip_friction, *_ = task.args
            moved_m = 0.0 if tasks is disturbance._BY_APPROACH else 1.0
            root, diameter_m = whisker.root_stiffness_n_m_rad, whisker.root_diameter_m
            rows.append(
                disturbance.Row(
                    whisker.name, root, diameter_m, mass_kg, approach_rad, tip_friction, 0.05, 0.0, moved_m, 0.0, 0.0, 0, 1.0, 1.0
                )
            )
    rows += [disturbance.Column(root, 1.0, 1.0) for root in disturbance.ROOTS_N_M_RAD]
    holds = {claim.id: claim.holds for claim in disturbance.STUDY.conclude(rows).claims}
    assert not holds["disturbance_head_on"]
    assert not holds["disturbance_stiffer"]


def test_verif_one_study_is_run_by_its_name(tmp_path, capsys):
    assert main(["frequencies", "--out", str(tmp_path), "--jobs", "1"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"claims.csv", "frequencies.csv", "watermark.json"}
    assert "natural frequenc" in capsys.readouterr().out
    with pytest.raises(SystemExit) as left:
        main(["frequency"])
    assert left.value.code == 2
    assert "expected one of oracle, " in capsys.readouterr().err


def test_robust_missing_traces_are_one_clear_error(tmp_path, capsys):
    assert main(["--dataset", str(tmp_path / "none"), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'none'}: expected the traces")


@pytest.mark.parametrize("name", WHISKERS)
@pytest.mark.parametrize("face", [1, -1])
def test_val_friction_agrees_with_scipy(name, face):
    """Loads with friction, and contacts with a disc under friction, by the two Python solvers."""
    whisker = WHISKERS[name]
    arc_m, force_n = np.array([0.04, 0.06, 0.07]), np.array([6e-4, 2.5e-4, 1e-4])
    friction_rad = np.array([-0.5, 0.3, 0.7])
    lean_rad = face * (float(np.arcsin(whisker.radius_slope)) + friction_rad)
    fast = loaded(whisker, arc_m, -face * force_n, lean_rad, -whisker.radius_m(arc_m) * np.sin(friction_rad))
    for index in range(3):
        exact = pushed(whisker, face, arc_m[index], force_n[index], friction_rad[index])
        assert fast.moment_n_m[index] == pytest.approx(exact.moment_n_m, rel=1e-9)
        assert fast.tangent_rad[index] == pytest.approx(exact.angle_rad, abs=1e-9)
        assert np.hypot(*(fast.point_m[index] - exact.point_m)) < 1e-9 * arc_m[index]
    center_m, guess = np.array([0.05, 0.005 * face + (0.012 if name == "curved" else 0.0)]), (0.051, 2.5e-4)
    disc = Circle(radius_m=0.01, center_m=tuple(center_m))
    for angle_rad in (-0.4, 0.3):
        exact_arc_m, exact_force_n, exact = contact_with_disc(whisker, center_m, 0.01, face, guess, angle_rad)
        found = touching(whisker, disc, face, np.zeros((1, 3)), np.array([guess[0]]), np.array([guess[1]]), angle_rad)
        assert found.solved[0]
        assert found.arc_m[0] == pytest.approx(exact_arc_m, rel=1e-9)
        assert found.force_n[0] == pytest.approx(exact_force_n, rel=1e-9)
        assert found.moment_n_m[0] == pytest.approx(exact.moment_n_m, rel=1e-9)
