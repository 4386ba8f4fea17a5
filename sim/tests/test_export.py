"""A scene written as MJCF is the model that is simulated."""

import mujoco
import numpy as np
import pytest

from whisker_sim.cli import main
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.runs import load_runs
from whisker_sim.shapes import AnyShape

from conftest import SCENES

TURNED = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006, "yaw_rad": 0.7}


@pytest.mark.parametrize("whisker", ["straight", "curved"])
@pytest.mark.parametrize("shape", AnyShape.__args__, ids=lambda shape: shape.__struct_config__.tag)
def test_verif_an_exported_scene_is_the_model_that_is_simulated(write_scene, tmp_path, whisker, shape):
    """Driven alike, both take the same 1200 steps, into contact and on."""
    example = {"shape": shape.__struct_config__.tag, **shape.example}
    scene_file, out = write_scene(whisker=whisker, object=example, motion=TURNED), tmp_path / "scene.xml"
    assert main(["export", str(scene_file), "--out", str(out)]) == 0
    scene = load_runs(scene_file)[1][0].scene
    exported = mujoco.MjModel.from_xml_path(str(out))
    built = build_model(scene.resolved_whisker, scene.object, scene.simulation.timestep_s)
    assert (exported.nq, exported.nv, exported.na, exported.ngeom) == (built.nq, built.nv, built.na, built.ngeom)
    for field in ("jnt_stiffness", "dof_damping", "geom_size"):
        np.testing.assert_array_equal(getattr(exported, field), getattr(built, field), field)

    poses_mm = scene.motion.plan(scene.stage()).poses * (MM_PER_M, MM_PER_M, 1.0)
    opened, own = mujoco.MjData(exported), mujoco.MjData(built)
    own.qpos[:3] = own.act[:] = poses_mm[0]
    for velocity in np.diff(poses_mm[:1201], axis=0) / scene.simulation.timestep_s:
        for model, data in ((exported, opened), (built, own)):
            data.ctrl[:] = velocity
            mujoco.mj_step(model, data)
    assert own.ncon > 0
    np.testing.assert_allclose(opened.qpos[:3], own.qpos[:3] - poses_mm[0], atol=1e-9)
    np.testing.assert_allclose(opened.qpos[3:], own.qpos[3:], atol=1e-9)
    np.testing.assert_allclose(opened.body("link_0").xpos, own.body("link_0").xpos, atol=1e-9)


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.json")), ids=lambda path: path.stem)
def test_verif_an_exported_scene_opens_at_rest_and_free(tmp_path, path):
    """As a viewer finds it, before anything is set: nothing touches, nothing moves, nothing is warned of."""
    out = tmp_path / "scene.xml"
    assert main(["export", str(path), "--out", str(out)]) == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    assert np.max(np.abs(data.qpos)) < 1e-9
    assert not np.any(data.warning.number)


def test_verif_an_exported_scene_says_what_it_is(write_scene, tmp_path):
    """Also where the scene's name holds what would end an XML comment."""
    out = tmp_path / "new" / "scene.xml"
    assert main(["export", str(write_scene(name="one--two")), "--out", str(out)]) == 0
    text = out.read_text()
    for word in ("one- -two", "whisker_sim 0.1.0", "millimetre, gram, second"):
        assert word in text.partition("-->")[0]
    assert "<file" not in text
    assert 'file="' not in text
    assert mujoco.MjModel.from_xml_path(str(out)).nmesh == 0
    assert [path.name for path in out.parent.iterdir()] == ["scene.xml"]


def test_robust_an_export_needs_its_ending_and_a_scene_that_fits(write_scene, tmp_path, capsys):
    assert main(["export", str(write_scene()), "--out", str(tmp_path / "scene.mjcf")]) == 2
    assert "ends in .xml, found '.mjcf'" in capsys.readouterr().err
    motion = {"kind": "lateral_sweep", "contact_arc_m": 0.09, "stroke_m": 0.006}
    assert main(["export", str(write_scene(motion=motion)), "--out", str(tmp_path / "scene.xml")]) == 2
    assert "motion.contact_arc_m" in capsys.readouterr().err
    assert main(["export", str(SCENES / "suites" / "golden.json"), "--out", str(tmp_path / "scene.xml")]) == 2
    assert "expected a scene, found a suite" in capsys.readouterr().err
    assert not (tmp_path / "scene.xml").exists()
