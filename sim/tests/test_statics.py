"""Whisker against theory: large deflections, undeflected shape, natural frequencies."""

from dataclasses import replace

import msgspec
import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import root

from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.physics.scipy_elastica import static_contact
from whisker_sim.shapes.pin import Pin
from whisker_sim.truth import CenterLine
from whisker_sim.whisker import PRESETS, Arc, Whisker

FAR_AWAY = Pin(center_m=(1.0, 1.0))
STRAIGHT = PRESETS["straight"][1]
BENDING_N_M2 = STRAIGHT.youngs_modulus_pa * np.pi * STRAIGHT.root_diameter_m**4 / 64.0


def chain_deflection(whisker: Whisker, load: float) -> float:
    """Deflection w / L of MuJoCo's chain, clamped at the root, under P L^2 / EI = `load`: solution of K q = J^T f."""
    model = build_model(whisker, FAR_AWAY, 0.0005)
    data = mujoco.MjData(model)
    first = model.joint("hinge_1").dofadr[0]
    last = model.body(f"link_{whisker.segments}").id
    half_link_mm = np.array((0.5 * MM_PER_M * whisker.segment_m, 0.0, 0.0))
    jacobian = np.empty((3, model.nv))
    load_un = 1e6 * load * BENDING_N_M2 / whisker.length_m**2

    def tip_mm() -> np.ndarray:
        return data.xpos[last] + data.xmat[last].reshape(3, 3) @ half_link_mm

    def imbalance_rad(rotations_rad: np.ndarray) -> np.ndarray:
        data.qpos[first:] = rotations_rad
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jac(model, data, jacobian, None, tip_mm(), last)
        return rotations_rad - load_un * jacobian[1, first:] / model.jnt_stiffness[first:]

    solution = root(imbalance_rad, np.full(whisker.segments, 0.5 / whisker.segments), tol=1e-12)
    assert solution.success
    imbalance_rad(solution.x)
    return float(tip_mm()[1] / MM_PER_M / whisker.length_m)


# Mattiasson (1981), cantilever under a transverse load P at its tip: P L^2 / EI and the deflection w / L.
@pytest.mark.parametrize(("load", "expected"), [(1.0, 0.30172), (2.0, 0.49346), (5.0, 0.71379), (10.0, 0.81061)])
def test_val_tip_load_against_mattiasson(load, expected):
    """The error decreases with the square of the segment length, to 4e-4 at most at the default of 40 segments."""
    errors = [
        abs(chain_deflection(msgspec.structs.replace(STRAIGHT, segments=segments), load) / expected - 1.0)
        for segments in (10, 20, 40)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    assert errors[2] < 4e-4


def test_val_oracle_against_the_clamped_rod():
    """M r / EI = 3.0063 th - 0.0341 th^2 - 0.6683 th^3 for a clamped straight rod with its contact at (r, th)."""
    clamped = msgspec.structs.replace(STRAIGHT, root_stiffness_n_m_rad=1e9)
    for force_n in (1e-3, 3e-3, 6e-3):
        contact = static_contact(clamped, 0.05, force_n)
        distance_m, angle_rad = np.hypot(*contact.point_m), np.arctan2(contact.point_m[1], contact.point_m[0])
        expected = 3.0063 * angle_rad - 0.0341 * angle_rad**2 - 0.6683 * angle_rad**3
        assert contact.moment_n_m * distance_m / BENDING_N_M2 == pytest.approx(expected, rel=3e-3)


def test_val_first_natural_frequency():
    """f1 = 3.5160 / (2 pi) sqrt(EI / (rho A L^4)) for the clamped whisker: 16.67 Hz."""
    model = build_model(STRAIGHT, FAR_AWAY, 0.0005)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    hinges = slice(model.joint("hinge_1").dofadr[0], model.nv)
    square_rad_s = eigh(np.diag(model.jnt_stiffness[hinges]), mass[hinges, hinges], eigvals_only=True)[0]
    line_density_kg_m = STRAIGHT.density_kg_m3 * np.pi * STRAIGHT.root_diameter_m**2 / 4.0
    expected_hz = 3.5160 / (2.0 * np.pi) * np.sqrt(BENDING_N_M2 / line_density_kg_m) / STRAIGHT.length_m**2
    assert expected_hz == pytest.approx(16.67, abs=0.01)
    assert np.sqrt(square_rad_s) / (2.0 * np.pi) == pytest.approx(expected_hz, rel=3e-4)


TAPERED = msgspec.structs.replace(
    STRAIGHT, name="tapered", tip_diameter_m=0.1e-3, curvature=(Arc(0.02, 0.0), Arc(0.03, 20.0), Arc(0.03, -10.0))
)


@pytest.mark.parametrize("whisker", [*(whisker for _, whisker in PRESETS.values()), TAPERED], ids=lambda whisker: whisker.name)
def test_verif_center_line_is_that_of_the_model(whisker):
    """The centre line through the middles of the links agrees with MuJoCo's bodies, at rest and bent."""
    model = build_model(whisker, FAR_AWAY, 0.0005)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    for size in (0.0, 0.05):
        data.qpos[:] = size * rng.standard_normal(model.nq)
        mujoco.mj_kinematics(model, data)
        pose = data.qpos[:3] / (MM_PER_M, MM_PER_M, 1.0)
        line = CenterLine.from_joints(whisker, pose[None], data.qpos[None, 3:])
        hinges_m = (np.arange(whisker.segments) + 0.5) * whisker.segment_m
        nodes_m = np.arange(1, whisker.segments + 1) * whisker.segment_m
        bodies = [model.body(f"link_{index}").id for index in range(1, whisker.segments + 1)]
        rest_rad = whisker.rest_angle_rad(nodes_m)
        offset_m = whisker.rest_point_m(nodes_m) - whisker.rest_point_m(hinges_m)
        for index, body in enumerate(bodies):
            cos, sin = np.cos(rest_rad[index]), np.sin(rest_rad[index])
            local_mm = MM_PER_M * np.array((cos * offset_m[index, 0] + sin * offset_m[index, 1],
                                            cos * offset_m[index, 1] - sin * offset_m[index, 0], 0.0))  # fmt: skip
            node_mm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local_mm
            np.testing.assert_allclose(line.points_m[0, index + 1], node_mm[:2] / MM_PER_M, atol=1e-12)
        if size == 0.0:
            arcs_m = rng.uniform(0.0, whisker.length_m, 50)
            at_rest = replace(
                line, points_m=np.repeat(line.points_m, 50, axis=0), angles_rad=np.repeat(line.angles_rad, 50, axis=0)
            )
            np.testing.assert_allclose(at_rest.at(arcs_m)[0], whisker.rest_point_m(arcs_m), atol=1e-8)


def test_verif_compliance_and_mass_of_a_taper():
    """Closed forms against a fine numerical sum."""
    s = (np.arange(20000) + 0.5) / 20000 * TAPERED.length_m
    step_m, d = TAPERED.length_m / 20000, TAPERED.diameter_m(s)
    compliance = np.sum(64.0 * step_m / (np.pi * TAPERED.youngs_modulus_pa * d**4))
    assert TAPERED.compliance_rad_n_m(0.0, TAPERED.length_m) == pytest.approx(compliance, rel=1e-7)
    mass = np.sum(TAPERED.density_kg_m3 * np.pi / 4.0 * d**2 * step_m)
    assert TAPERED.mass_kg(0.0, TAPERED.length_m) == pytest.approx(mass, rel=1e-7)
