"""Free-standing objects at rest, sliding and tipping, against statics and Newton's law; and their disturbance by a whisker."""

import xml.etree.ElementTree as ET

import msgspec
import mujoco
import numpy as np
import pytest

from whisker_sim.model import MM_PER_M, N_PER_UN
from whisker_sim.physics import disturbance
from whisker_sim.physics.cases import cylinder
from whisker_sim.physics.standing import standing
from whisker_sim.shapes import AnyShape
from whisker_sim.shapes.rectangle import Rectangle
from whisker_sim.table import GRAVITY_M_S2, FreeObject, add_free_object, add_table, displacement, let_gravity_act

SHAPES = {shape.__struct_config__.tag: shape for shape in AnyShape.__args__}
TIMESTEP_S = 0.0005


def model_of(*frees, top_m=-0.05):
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    option = ET.SubElement(root, "option", timestep=str(TIMESTEP_S), integrator="discrete", tolerance="1e-12")
    let_gravity_act(option)
    ET.SubElement(root, "asset")
    add_table(ET.SubElement(root, "worldbody"), top_m)
    for free in frees:
        add_free_object(root, free, top_m, TIMESTEP_S)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def run(model, data, duration_s):
    for _ in range(round(duration_s / TIMESTEP_S)):
        mujoco.mj_step(model, data)


@pytest.mark.parametrize("name", [name for name, shape in SHAPES.items() if shape.upright and shape.convex])
def test_verif_every_upright_shape_stands_still(name):
    """After settling, an object stays within a nanometre, regardless of its pose."""
    free = FreeObject("thing", SHAPES[name](center_m=(0.1, -0.2), **{"yaw_rad": 0.3, **SHAPES[name].example}), 0.02, 0.03)
    model = model_of(free)
    data = mujoco.MjData(model)
    np.testing.assert_array_equal(displacement(model, data.qpos, "thing"), np.zeros(5))
    run(model, data, 0.2)
    settled = displacement(model, data.qpos, "thing")
    assert np.all(np.abs(settled) < (1e-7, 1e-7, 1e-7, 1e-6, 1e-5))
    run(model, data, 1.0)
    np.testing.assert_allclose(displacement(model, data.qpos, "thing"), settled, atol=1e-9)


def test_robust_an_object_without_upright_sides_is_refused():
    text = b'{"name": "egg", "object": {"shape": "ellipse", "semi_x_m": 0.02, "semi_y_m": 0.01}, "mass_kg": 0.02, "height_m": 0.1}'
    with pytest.raises(msgspec.ValidationError, match=r"object\.shape: expected a shape with upright sides, found 'ellipse'"):
        msgspec.json.decode(text, type=FreeObject)


def test_robust_an_object_that_is_not_convex_is_refused():
    cup = b'{"shape": "cup", "width_m": 0.02, "depth_m": 0.01, "thickness_m": 0.002}'
    text = b'{"name": "bowl", "object": ' + cup + b', "mass_kg": 0.02, "height_m": 0.1}'
    with pytest.raises(msgspec.ValidationError, match=r"object\.shape: expected a convex shape, found 'cup'"):
        msgspec.json.decode(text, type=FreeObject)


def test_val_inertia_is_that_of_the_solid():
    """A block has m (a^2 + b^2) / 12 about each axis, a cylinder m R^2 / 2 about its own."""
    block = FreeObject("block", Rectangle(width_m=0.04, height_m=0.06), 0.3, 0.1)
    round_one = cylinder(0.3)
    model = model_of(block, msgspec.structs.replace(round_one, name="round"))
    inertia_kg_m2 = 1e-9 * model.body_inertia[1:]
    a, b, c = 0.04**2, 0.06**2, 0.1**2
    np.testing.assert_allclose(np.sort(inertia_kg_m2[0]), 0.3 / 12.0 * np.array((a + b, a + c, b + c)), rtol=1e-12)
    # Within the chord error of the outline.
    assert np.min(inertia_kg_m2[1]) == pytest.approx(0.5 * 0.3 * 0.015**2, rel=3e-4)


def test_val_a_pushed_object_slides_by_newtons_law():
    """Under 1.5 mu m g the acceleration is 0.5 mu g, in every direction."""
    free = FreeObject("block", Rectangle(width_m=0.06, height_m=0.06), 0.02, 0.01)
    for direction in np.radians((0.0, 45.0, 100.0)):
        model = model_of(free)
        data = mujoco.MjData(model)
        run(model, data, 0.2)
        start = displacement(model, data.qpos, "block")
        push_un = 1.5 * 0.5 * 0.02 * GRAVITY_M_S2 / N_PER_UN
        data.xfrc_applied[1, :2] = push_un * np.array((np.cos(direction), np.sin(direction)))
        run(model, data, 0.1)
        moved = displacement(model, data.qpos, "block") - start
        assert np.hypot(*moved[:2]) == pytest.approx(0.5 * 0.5 * 0.5 * GRAVITY_M_S2 * 0.1**2, rel=0.02)
        assert np.arctan2(moved[1], moved[0]) == pytest.approx(direction, abs=0.01)


def test_val_objects_slide_and_tip_at_the_limits_of_statics():
    row = standing(0.02)
    assert row.slides_at_n == pytest.approx(row.expected_slides_at_n, rel=0.01)
    assert row.tips_at_n == pytest.approx(row.expected_tips_at_n, rel=0.01)
    assert row.drift_m < 1e-9
    assert row.creep_m < 1e-8


def test_verif_displacement_separates_yaw_and_tilt():
    """A rotation about the vertical, then a tilt about a horizontal axis."""
    model = model_of(FreeObject("block", Rectangle(yaw_rad=2.0, width_m=0.04, height_m=0.06), 0.02, 0.1))
    data = mujoco.MjData(model)
    turn, tilt, pose = np.empty(4), np.empty(4), np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, np.array((0.0, 0.0, 1.0)), 2.0 - 2.5)
    mujoco.mju_axisAngle2Quat(tilt, np.array((0.6, 0.8, 0.0)), 0.2)
    mujoco.mju_mulQuat(pose, tilt, turn)
    data.qpos[3:7] = pose
    data.qpos[0] += 3e-3 * MM_PER_M
    np.testing.assert_allclose(displacement(model, data.qpos, "block"), (3e-3, 0.0, 0.0, -2.5, 0.2), atol=1e-12)


def test_val_a_held_straight_whisker_buckles_at_eulers_load():
    row = disturbance.column(0.17e-3)
    assert row.held_force_n == pytest.approx(row.euler_n, rel=0.005)
    clamped = msgspec.structs.replace(disturbance.STRAIGHT, root_stiffness_n_m_rad=1e6)
    bending_n_m2 = 60e9 * np.pi * 0.25e-3**4 / 64.0
    assert disturbance.euler_n(clamped) == pytest.approx(20.19073 * bending_n_m2 / 0.08**2, rel=1e-5)


def test_val_soft_whiskers_do_not_displace_objects_and_stiff_ones_tip_them():
    soft = disturbance.sweep(disturbance.CURVED, 0.02, np.radians(60.0), 0.0)
    assert soft.moved_m < 1e-7
    assert soft.peak_force_n < 0.1 * soft.tips_at_n
    thick = msgspec.structs.replace(disturbance.CURVED, root_stiffness_n_m_rad=10.0, root_diameter_m=0.5e-3, tip_diameter_m=0.5e-3)
    stiff = disturbance.sweep(thick, 0.02, np.radians(90.0), 0.0)
    assert stiff.fell
    assert stiff.peak_force_n > stiff.tips_at_n
