"""Export of scenes as MJCF: equality of the exported and the simulated model."""

import mujoco
import numpy as np
import pytest

from whisker_sim.cli import main
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.runs import load_runs
from whisker_sim.shapes import AnyShape

from conftest import SCENES

CONTACT_M = 0.05
TURNED = {"kind": "lateral_sweep", "contact_arc_m": CONTACT_M, "stroke_m": 0.006, "yaw_rad": 0.7}

INDICES = ("adr", "bodyid", "colind", "dofnum", "geomnum", "jntnum", "map", "objid")
INDICES += ("parentid", "rootid", "rownnz", "treeid", "weldid")
"""Endings of the model's arrays that count or number its parts; the exported model has an additional body that holds the base."""
FRAME = {"body_pos", "body_quat", "jnt_axis", "dof_invweight0", "actuator_acc0"}
"""Arrays whose entries of the base depend on its pose at zero coordinates: in the exported model that is the start of the motion.

`actuator_acc0`, the response to a unit force at that pose, has no influence on these actuators."""
AT_START = {"body_invweight0", "dof_M0", "dof_length"}
"""Invariant arrays that the compiler computes at zero coordinates, where the two models differ by rounding."""


@pytest.mark.parametrize("whisker", ["straight", "curved"])
@pytest.mark.parametrize("shape", AnyShape.__args__, ids=lambda shape: shape.__struct_config__.tag)
def test_verif_an_exported_scene_is_the_model_that_is_simulated(write_scene, tmp_path, whisker, shape):
    """All fields except the base's frame are equal bit for bit, and 1200 equal steps lead both models into the same contact.

    Before contact the joint angles differ by rounding (1e-15 rad), because the coordinates of the base have another origin. Closed-
    form colliders keep it so. The general collider, which an ellipsoid needs, iterates until the distance is known to
    `ccd_tolerance` and may stop at another iterate. An error d of the distance displaces the contact by d, and a cantilever
    displaced by d at the arc length s rotates by 1.5 d / s at most. With a collider tolerance at rounding level the difference
    vanishes.
    """
    example = {"shape": shape.__struct_config__.tag, **shape.example}
    scene_file, out = write_scene(whisker=whisker, object=example, motion=TURNED), tmp_path / "scene.xml"
    assert main(["export", str(scene_file), "--out", str(out)]) == 0
    scene = load_runs(scene_file)[1][0].scene
    exported = mujoco.MjModel.from_xml_path(str(out))
    built = build_model(scene.resolved_whisker, scene.object, scene.simulation.timestep_s)
    assert_equal_fields(exported, built)

    poses_mm = scene.motion.plan(scene.stage()).poses[:1201] * (MM_PER_M, MM_PER_M, 1.0)
    velocities = np.diff(poses_mm, axis=0) / scene.simulation.timestep_s
    assert_equal_motion(exported, built, poses_mm[0], velocities, 1.5 * built.opt.ccd_tolerance / (MM_PER_M * CONTACT_M))
    for model in (exported, built):
        model.opt.ccd_tolerance, model.opt.ccd_iterations = 1e-12, 500
    assert_equal_motion(exported, built, poses_mm[0], velocities, 1e-9)


def assert_equal_fields(exported: mujoco.MjModel, built: mujoco.MjModel) -> None:
    """Compares all numeric arrays of the two models except `INDICES`."""
    moved = exported.body("start").id
    compared = 0
    for name in dir(built):
        own = getattr(built, name)
        if not isinstance(own, np.ndarray) or name.startswith(("_", "name")) or name.endswith(INDICES) or name in FRAME:
            continue
        opened = getattr(exported, name)
        if name.startswith("body_"):
            opened = np.delete(opened, moved, axis=0)
        np.testing.assert_allclose(opened, own, rtol=1e-9 if name in AT_START else 0.0, err_msg=name)
        compared += 1
    assert compared > 300
    base, bodies, joints = built.body("base").id, exported.nbody - 1, built.joint("base_yaw").id
    for name in ("body_pos", "body_quat"):
        opened = np.delete(getattr(exported, name), moved, axis=0)
        np.testing.assert_array_equal(opened[base:bodies], getattr(built, name)[base:bodies], name)
    np.testing.assert_array_equal(exported.jnt_axis[joints:], built.jnt_axis[joints:])
    np.testing.assert_allclose(exported.dof_invweight0[joints:], built.dof_invweight0[joints:], rtol=1e-9)


def assert_equal_motion(exported, built, start_mm, velocities, tolerance_rad) -> None:
    """Applies the same controls to both models and compares the angles of root and hinges within `tolerance_rad`.

    The coordinates of the base are compared to 1e-9 mm and rad.
    """
    opened, own = mujoco.MjData(exported), mujoco.MjData(built)
    own.qpos[:3] = own.act[:] = start_mm
    for velocity in velocities:
        for model, data in ((exported, opened), (built, own)):
            data.ctrl[:] = velocity
            mujoco.mj_step(model, data)
        if not own.ncon and not opened.ncon:
            np.testing.assert_allclose(opened.qpos[3:], own.qpos[3:], rtol=0.0, atol=1e-13)
    assert own.ncon > 0
    np.testing.assert_allclose(opened.qpos[:3], own.qpos[:3] - start_mm, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(opened.qpos[3:], own.qpos[3:], rtol=0.0, atol=tolerance_rad)
    np.testing.assert_allclose(opened.body("link_0").xpos, own.body("link_0").xpos, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.json")), ids=lambda path: path.stem)
def test_verif_an_exported_scene_opens_at_rest_and_free(tmp_path, path):
    """In the initial state of a viewer there is no contact, no motion and no warning."""
    out = tmp_path / "scene.xml"
    assert main(["export", str(path), "--out", str(out)]) == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    assert np.max(np.abs(data.qpos)) < 1e-9
    assert not np.any(data.warning.number)


def test_verif_an_exported_scene_states_its_name_and_units(write_scene, tmp_path):
    """Also if the name of the scene contains characters that would end an XML comment."""
    out = tmp_path / "new" / "scene.xml"
    assert main(["export", str(write_scene(name="one--two")), "--out", str(out)]) == 0
    text = out.read_text()
    for word in ("one- -two", "whisker_sim 0.1.0", "millimetre, gram, second"):
        assert word in text.partition("-->")[0]
    assert "<file" not in text
    assert 'file="' not in text
    assert mujoco.MjModel.from_xml_path(str(out)).nmesh == 0
    assert [path.name for path in out.parent.iterdir()] == ["scene.xml"]


def test_robust_export_requires_the_suffix_and_a_valid_scene(write_scene, tmp_path, capsys):
    assert main(["export", str(write_scene()), "--out", str(tmp_path / "scene.mjcf")]) == 2
    assert "ends in .xml, found '.mjcf'" in capsys.readouterr().err
    motion = {"kind": "lateral_sweep", "contact_arc_m": 0.09, "stroke_m": 0.006}
    assert main(["export", str(write_scene(motion=motion)), "--out", str(tmp_path / "scene.xml")]) == 2
    assert "motion.contact_arc_m" in capsys.readouterr().err
    assert main(["export", str(SCENES / "suites" / "golden.json"), "--out", str(tmp_path / "scene.xml")]) == 2
    assert "expected a scene, found a suite" in capsys.readouterr().err
    assert not (tmp_path / "scene.xml").exists()
