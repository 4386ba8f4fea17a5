"""Arm: kinematics, path, recordings, error messages about scenes."""

import copy
import csv
import hashlib
import json

import mujoco
import numpy as np
import pytest
from PIL import Image

from whisker_sim.arm import panda
from whisker_sim.arm.model import build_arm_model
from whisker_sim.arm.simulate import base_motion, simulate_passage
from whisker_sim.arm.spline import Spline
from whisker_sim.arm.tool import MOUNTS, TOOL
from whisker_sim.cli import main
from whisker_sim.model import MM_PER_M
from whisker_sim.runs import load_runs
from whisker_sim.trace import COLUMNS

from conftest import SCENES

COARSE = {"preset": "curved", "name": "coarse", "segments": 12}
SHORT = {
    "format": 1,
    "name": "short",
    "group": "arm",
    "arm": {"foot_m": [-0.5, 0.02, 0.01], "yaw_rad": 0.3},
    "whisker": COARSE,
    "objects": [
        {
            "name": "can",
            "object": {"shape": "circle", "radius_m": 0.02, "center_m": [0.0, 0.05]},
            "mass_kg": 0.02,
            "height_m": 0.09,
        },
        {"name": "box", "object": {"shape": "rectangle", "width_m": 0.03, "height_m": 0.02}, "mass_kg": 0.02, "height_m": 0.09},
    ],
    "path": {
        "height_m": 0.06,
        "lead_m": 0.05,
        "strokes": [[{"object": "can", "side": "left", "from_rad": -2.2, "to_rad": -1.3, "distance_m": 0.024}]],
    },
}
"""A scene that is simulated within seconds: the left array is dragged along a can, with a box nearby."""
SHORT["objects"][1]["object"]["center_m"] = [0.0, -0.12]


@pytest.fixture
def write_short(tmp_path):
    """A function that writes `SHORT`, modified by another function, and returns its path."""

    def write(change=lambda scene: None):
        scene = copy.deepcopy(SHORT)
        change(scene)
        path = tmp_path / "scene.json"
        path.write_text(json.dumps(scene, indent=2))
        return path

    return write


@pytest.fixture
def short(write_short):
    """A run of `SHORT`."""
    return load_runs(write_short())[1][0]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder of the recording of `SHORT`, and file of its scene."""
    folder = tmp_path_factory.mktemp("recorded")
    path = folder / "scene.json"
    path.write_text(json.dumps(SHORT))
    assert main(["simulate", str(path), "--out", str(folder / "out")]) == 0
    return folder / "out", path


def postures(count: int) -> np.ndarray:
    rng = np.random.default_rng(6)
    return rng.uniform(panda.LOWER_RAD, panda.UPPER_RAD, (count, panda.JOINTS))


def test_val_kinematics_and_jacobian_are_those_of_mujoco(short):
    """Base and body Jacobian of every whisker in random postures."""
    start_rad = panda.READY_RAD
    model = build_arm_model(short.scene, start_rad)
    data = mujoco.MjData(model)
    linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
    for q_rad in postures(20):
        data.qpos[: panda.JOINTS] = q_rad - start_rad
        mujoco.mj_forward(model, data)
        for mount in MOUNTS:
            pose = short.scene.arm.base @ panda.tool_pose(q_rad, mount.in_flange)
            body = data.body(mount.name)
            turn = body.xmat.reshape(3, 3)
            np.testing.assert_allclose(body.xpos / MM_PER_M, pose[:3, 3], atol=1e-12)
            np.testing.assert_allclose(turn, pose[:3, :3], atol=1e-12)
            mujoco.mj_jacBody(model, data, linear, angular, body.id)
            expected = np.concatenate((turn.T @ linear / MM_PER_M, turn.T @ angular))[:, : panda.JOINTS]
            np.testing.assert_allclose(panda.body_jacobian(q_rad, mount.in_flange), expected, atol=1e-12)


def test_val_the_flange_of_the_stretched_arm():
    """All joints at zero: the flange points down, 88 mm ahead and 926 mm above the base, by Franka's table."""
    flange = panda.frames(np.zeros(panda.JOINTS))[-1]
    np.testing.assert_allclose(flange[:3, 3], (0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.107), atol=1e-15)
    np.testing.assert_allclose(flange[:3, 2], (0.0, 0.0, -1.0), atol=1e-15)


def test_val_the_twist_is_the_derivative_of_the_pose():
    """J(q) dq/dt against fourth-order central differences of the pose along random motions, to 1e-6 of the twist."""
    rng = np.random.default_rng(7)
    step = 1e-3
    for q_rad in postures(50):
        dq_rad_s = rng.uniform(-1.0, 1.0, panda.JOINTS)
        for mount in MOUNTS:
            before2, before, after, after2 = (
                panda.tool_pose(q_rad + share * step * dq_rad_s, mount.in_flange) for share in (-2, -1, 1, 2)
            )
            slope = (before2 - 8.0 * before + 8.0 * after - after2) / (12.0 * step)
            hat = panda.tool_pose(q_rad, mount.in_flange)[:3, :3].T @ slope[:3]
            expected = np.array((*hat[:, 3], hat[2, 1], hat[0, 2], hat[1, 0]))
            twist = panda.body_jacobian(q_rad, mount.in_flange) @ dq_rad_s
            assert np.max(np.abs(twist - expected)) < 1e-6 * np.max(np.abs(expected))


def test_verif_the_joints_move_the_tool_along_the_path(short):
    """Poses of the path are reached to a micrometre and a microradian; joint angles and speeds keep their limits."""
    scene = short.scene
    time_s, poses = scene.path.poses({free.name: free for free in scene.objects}, 60.0)
    plan = scene.plan()
    rows = np.round(time_s / scene.simulation.timestep_s).astype(int)
    tool = scene.arm.base @ panda.tool_pose(plan.q_rad[rows], TOOL)
    np.testing.assert_allclose(tool[:, :2, 3], poses[:, :2], atol=1e-6)
    np.testing.assert_allclose(tool[:, 2, 3], scene.path.height_m, atol=1e-6)
    np.testing.assert_allclose(tool[:, 1, 0], np.sin(poses[:, 2]), atol=1e-6)
    np.testing.assert_allclose(tool[:, 2, 2], 1.0, atol=1e-6)
    assert np.all((plan.q_rad >= panda.LOWER_RAD) & (plan.q_rad <= panda.UPPER_RAD))
    assert np.all(np.abs(plan.dq_rad_s) <= panda.SPEED_RAD_S)
    speed_m_s = np.hypot(*np.diff(poses[:, :2], axis=0).T) / np.diff(time_s)
    assert speed_m_s[0] == 0.0
    assert np.max(speed_m_s) == pytest.approx(scene.path.speed_m_s, rel=1e-3)


def test_verif_vibration_displaces_the_tool_as_specified(write_short):
    """Displacements of the references along x and y of World have the specified acceleration; there is none along z."""
    still = load_runs(write_short())[1][0].scene
    shaken = load_runs(write_short(lambda scene: scene.update(vibration={"acceleration_m_s2": 0.3})))[1][0].scene
    added = [panda.tool_pose(scene.plan().q_rad, TOOL) for scene in (shaken, still)]
    moved_m = (shaken.arm.base[:3, :3] @ (added[0] - added[1])[:, :3, 3:])[..., 0]
    timestep_s = shaken.simulation.timestep_s
    acceleration_m_s2 = np.diff(moved_m, 2, axis=0)[1000:] / timestep_s**2
    np.testing.assert_allclose(np.sqrt(np.mean(acceleration_m_s2[:, :2] ** 2, axis=0)), 0.3, rtol=0.05)
    assert np.max(np.abs(moved_m[:, 2])) < 1e-3 * np.max(np.abs(moved_m[:, :2]))


def test_val_a_spline_of_a_smooth_curve():
    """A sine through points about 0.1 apart, between zeros of its second derivative."""
    knots = np.linspace(0.0, 2.0 * np.pi, 64)
    spline = Spline(knots, np.stack((np.sin(knots), knots), axis=-1))
    at = np.linspace(0.0, 2.0 * np.pi, 500)
    np.testing.assert_allclose(spline(at), np.stack((np.sin(at), at), axis=-1), atol=1e-6)
    np.testing.assert_allclose(spline.slope(at), np.stack((np.cos(at), np.ones_like(at)), axis=-1), atol=1e-4)


def read(path):
    with path.open() as file:
        return {key: [row[key] for row in rows] for rows in [list(csv.DictReader(file))] for key in rows[0]}


def test_verif_a_recording_follows_its_format(recorded):
    """Files, hashes and common times; base poses and twists follow from joints, arm and mounts of the recording."""
    folder, _ = recorded
    recording = json.loads((folder / "short.json").read_text())
    assert list(recording) == [
        *("format", "kind", "name", "seed", "rate_hz", "rows", "whiskers", "arm", "objects", "joints", "poses"),
        *("scene", "generator", "inputs_sha256"),
    ]
    named = [recording["joints"], recording["poses"], *(one["contour"] for one in recording["objects"])]
    for one in named:
        assert hashlib.sha256((folder / one["file"]).read_bytes()).hexdigest() == one["sha256"]
    joints = read(folder / recording["joints"]["file"])
    assert list(joints) == ["t_s", *(f"q{i}_rad" for i in range(1, 8)), *(f"dq{i}_rad_s" for i in range(1, 8))]
    assert len(joints["t_s"]) == recording["rows"]
    q_rad = np.array([joints[f"q{i}_rad"] for i in range(1, 8)], dtype=float).T
    dq_rad_s = np.array([joints[f"dq{i}_rad_s"] for i in range(1, 8)], dtype=float).T
    assert list(read(folder / recording["poses"]["file"]))[:6] == [
        "t_s",
        *(f"can_{key}" for key in ("x_m", "y_m", "z_m", "yaw_rad", "tilt_rad")),
    ]

    base = np.reshape(recording["arm"]["base"], (4, 4))
    assert [one["name"] for one in recording["whiskers"]] == [f"{side}_{i}" for side in ("left", "right") for i in (1, 2, 3)]
    for one in recording["whiskers"]:
        trace = read(folder / f"{one['trace']}.csv")
        assert tuple(trace) == tuple(name for name, _ in COLUMNS)
        assert trace["t_s"] == joints["t_s"]
        mount = np.reshape(one["mount"], (4, 4))
        pose = base @ panda.tool_pose(q_rad, mount)
        twist = (panda.body_jacobian(q_rad, mount) @ dq_rad_s[..., None])[..., 0]
        columns = {"base_x_m": pose[:, 0, 3], "base_y_m": pose[:, 1, 3]}
        columns |= {"base_vx_m_s": twist[:, 0], "base_vy_m_s": twist[:, 1], "base_wz_rad_s": twist[:, 5]}
        for name, values in columns.items():
            np.testing.assert_allclose(np.array(trace[name], dtype=float), values, atol=1e-9)
        sidecar = json.loads((folder / f"{one['trace']}.json").read_text())
        assert sidecar["csv_sha256"] == hashlib.sha256((folder / f"{one['trace']}.csv").read_bytes()).hexdigest()
        assert (sidecar["object"], sidecar["contour"], sidecar["whisker"]["name"]) == ("several", None, "coarse")
        assert list(sidecar)[-1] == "recording"
        assert sidecar["recording"] == "short"


def test_verif_a_recording_that_is_up_to_date_is_kept(recorded, capsys):
    folder, path = recorded
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}
    assert main(["simulate", str(path), "--out", str(folder)]) == 0
    assert "up to date" in capsys.readouterr().err
    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before


def test_val_a_recording_agrees_with_the_elastica_and_its_objects_stay_at_rest(recorded):
    """Even with few segments: only the left array touches the can; the can of 20 g moves by less than 0.1 um."""
    folder, _ = recorded
    for side, touches in (("left", True), ("right", False)):
        for number in (1, 2, 3):
            certificate = json.loads((folder / f"short_{side}_{number}.json").read_text())["certificate"]
            assert (certificate["touching"] > 200) == touches
            if touches:
                assert certificate["sampled"] == 50
                assert certificate["unsolved"] == 0
                assert certificate["moment_rms"] < 1e-2
                assert certificate["surface_worst_m"] < 60e-6
    poses = read(folder / "short.objects.csv")
    moved_m = np.array([poses["can_x_m"], poses["can_y_m"]], dtype=float)
    assert np.max(np.abs(moved_m)) < 1e-7


def test_verif_the_truth_lies_on_the_object(short):
    passed = simulate_passage(short)
    middle = passed.whiskers["left_2"]
    assert np.all(middle.nearest[middle.touching] == 0)
    inside = middle.touching & ~middle.truth.tip
    _, distance_m = short.scene.objects[0].object.closest(middle.truth.contact_m[inside])
    np.testing.assert_allclose(distance_m, short.scene.resolved_whisker.radius_m(middle.truth.arc_m[inside]), atol=40e-6)
    pose, twist = base_motion(short.scene, MOUNTS[1], passed.q_rad, passed.dq_rad_s)
    np.testing.assert_array_equal(pose, middle.base_pose)
    np.testing.assert_array_equal(twist, middle.base_twist)


def test_verif_a_passage_is_drawn(write_short, tmp_path, capsys):
    """The whiskers are visible in their colour, which lighting changes slightly."""
    out = tmp_path / "passage.png"
    if main(["render", str(write_short()), "--out", str(out)]) != 0:
        error = capsys.readouterr().err
        assert "needs OpenGL" in error
        pytest.skip(error)
    with Image.open(out) as picture:
        red, green, blue = np.moveaxis(np.asarray(picture.convert("RGB"), dtype=int), -1, 0)
    assert np.sum((red > green + 60) & (green > blue + 30)) > 50


def one_pass(**changes):
    return lambda scene: scene["path"]["strokes"][0][0].update(changes)


def the_can(**changes):
    return lambda scene: scene["objects"][0].update(changes)


def the_path(**changes):
    return lambda scene: scene["path"].update(changes)


WRONG = {
    "unknown object": (one_pass(object="jug"), ["path.strokes", "can, box", "'jug'"]),
    "unknown side": (one_pass(side="top"), ["path.strokes[0][0].side", "left, right", '"top"']),
    "unknown key": (one_pass(speed=1), ["path.strokes[0][0].speed", "unknown key", "from_rad"]),
    "equal angles": (
        one_pass(to_rad=-2.2),
        ["path.strokes[0][0].to_rad", "more than 0.001 rad from from_rad = -2.2", "found -2.2"],
    ),
    "huge angle": (one_pass(to_rad=1e12), ["path.strokes[0][0].to_rad", "<= 12.56", "found 1000000000000.0"]),
    "huge yaw": (lambda scene: scene["arm"].update(yaw_rad=-1e300), ["arm.yaw_rad", ">= -12.56", "found -1e+300"]),
    "no distance": (one_pass(distance_m=1e-300), ["path.strokes[0][0].distance_m", ">= 0.001", "found 1e-300"]),
    "out of reach": (lambda scene: scene["arm"].update(foot_m=[-2.0, 0.0, 0.0]), ["path", "reach", "at 0.00 s"]),
    "a joint's limit": (one_pass(from_rad=-5.2, to_rad=1.5), ["path", "joint 7 between -2.8973 and 2.8973 rad", "at 2.10 s"]),
    "too fast": (the_path(speed_m_s=2.0), ["path.speed_m_s", "joint", "rad/s"]),
    "too slow": (the_path(speed_m_s=1e-310), ["path.speed_m_s", "longest plan", "found 1e-310 m/s"]),
    "too low": (the_path(height_m=0.014), ["path.height_m", "more than 0.014 m", "found 0.014"]),
    "low object": (the_can(height_m=0.07), ["objects", "0.074 m", "'can' 0.07 m high"]),
    "tall object": (the_can(height_m=0.2), ["objects", "0.2 m, below the flange", "'can' 0.2 m high"]),
    "friction": (the_can(friction=1e300), ["objects[0].friction", "<= 10.0", "found 1e+300"]),
    "twins": (lambda scene: scene["objects"][1].update(name="can"), ["objects", "'can' 2 times"]),
    "no objects": (lambda scene: scene.update(objects=[]), ["objects", "found []"]),
    "no strokes": (the_path(strokes=[]), ["path.strokes", "found []"]),
    "uneven rate": (lambda scene: scene.update(rate_hz=300), ["rate_hz", "whole number"]),
    "no foot": (lambda scene: scene.update(arm={}), ["arm", "foot_m"]),
    "unknown whisker": (lambda scene: scene.update(whisker="cat"), ["whisker", "straight, curved", "'cat'"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_robust_wrong_scene(write_short, assert_rejected, case):
    """The error states file, key, expected and found values."""
    change, words = WRONG[case]
    assert_rejected(write_short(change), words)


def joined(scene):
    """The can is passed in two halves that join, and then back again from the end."""
    (first,) = scene["path"]["strokes"][0]
    scene["path"]["strokes"] = [[first, {**first, "from_rad": -1.3, "to_rad": -0.9}], [{**first, "from_rad": -0.9, "to_rad": -1.6}]]


@pytest.mark.parametrize("lead_m", [0.05, 1e-9])
def test_verif_joined_passes_are_one_path(write_short, lead_m):
    """A junction counts once, also between two strokes; the distance from the can is kept."""

    def change(scene):
        joined(scene)
        scene["path"]["lead_m"] = lead_m

    scene = load_runs(write_short(change))[1][0].scene
    _, poses = scene.path.poses({free.name: free for free in scene.objects}, 60.0)
    _, distance_m = scene.objects[0].object.closest(poses[:, :2])
    assert np.min(distance_m) == pytest.approx(0.024, abs=1e-3)
    assert np.all(np.isfinite(scene.plan().q_rad))


@pytest.mark.parametrize("name", ["tool", "left_1", "arm_3", "foot", "table", "world"])
def test_verif_an_object_may_have_the_name_of_a_part_of_the_arm(write_short, name):
    def change(scene):
        scene["objects"][1]["name"] = name

    scene = load_runs(write_short(change))[1][0].scene
    model = build_arm_model(scene, panda.READY_RAD)
    assert model.body(f"object_{name}").id > 0


def test_robust_an_object_that_tilts_fails_the_recording(write_short, tmp_path, capsys):
    """5 g under a clamped wire of 0.5 mm: one line that states object and time; no files."""

    def change(scene):
        scene["whisker"] |= {"root_stiffness_n_m_rad": 10.0, "root_diameter_m": 0.5e-3, "tip_diameter_m": 0.5e-3}
        scene["objects"][0]["mass_kg"] = 0.005
        for one in scene["objects"]:
            one["height_m"] = 0.1
        scene["path"]["height_m"] = 0.08

    path = write_short(change)
    assert main(["simulate", str(path), "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert "object 'can' at 1." in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_val_the_certificate_follows_an_object_that_is_pushed_aside(write_short, tmp_path):
    """With low friction the can is displaced by millimetres, upright; the ground truth of the contacts follows it."""
    path = write_short(the_can(friction=0.002))
    assert main(["simulate", str(path), "--out", str(tmp_path)]) == 0
    poses = read(tmp_path / "short.objects.csv")
    assert np.hypot(float(poses["can_x_m"][-1]), float(poses["can_y_m"][-1])) > 0.01
    certificate = json.loads((tmp_path / "short_left_2.json").read_text())["certificate"]
    assert certificate["sampled"] == 50
    assert certificate["unsolved"] == 0
    assert certificate["moment_rms"] < 1e-2
    assert certificate["surface_worst_m"] < 60e-6


def test_verif_the_physics_does_not_depend_on_the_rate(write_short, short):
    """The settling time of the objects does not depend on the logging rate."""
    often = load_runs(write_short(lambda scene: scene.update(rate_hz=2000.0)))[1][0]
    np.testing.assert_array_equal(simulate_passage(often).qpos[::8], simulate_passage(short).qpos)


def test_val_the_shipped_passage_keeps_the_bounds_of_the_certificate(tmp_path):
    """`passage_still` with all segments, along a part of its first object: the bounds of datasets/FORMAT.md."""
    scene = json.loads((SCENES / "arm" / "passage_still.json").read_text())
    scene["path"]["strokes"], scene["objects"] = [[{**scene["path"]["strokes"][0][0], "to_rad": -2.7}]], scene["objects"][:1]
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    assert main(["simulate", str(path), "--out", str(tmp_path / "out")]) == 0
    for number in (1, 2, 3):
        sidecar = json.loads((tmp_path / "out" / f"passage_still_left_{number}.json").read_text())
        certificate = sidecar["certificate"]
        assert sidecar["whisker"]["segments"] == 40
        assert certificate["sampled"] > 20
        assert certificate["unsolved"] == 0
        assert certificate["moment_rms"] < 1e-3
        assert certificate["surface_rms_m"] < 10e-6
        assert certificate["surface_worst_m"] < 60e-6
        assert certificate["arc_rms_m"] < 40e-6
        assert certificate["penetration_worst_m"] < 10e-6


def test_robust_the_tool_may_not_touch(write_short, tmp_path, capsys):
    path = write_short(one_pass(distance_m=0.005))
    assert main(["simulate", str(path), "--out", str(tmp_path / "out")]) == 1
    assert "the tool itself is in contact" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["passage", "passage_still"])
def test_verif_the_scenes_are_valid_and_open_at_rest(tmp_path, name):
    path, out = SCENES / "arm" / f"{name}.json", tmp_path / "arm.xml"
    assert json.loads(path.read_text())["name"] == name
    assert main(["export", str(path), "--out", str(out)]) == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    for _ in range(50):
        mujoco.mj_step(model, data)
    assert np.max(np.abs(data.qpos[: panda.JOINTS])) < 1e-6
    assert not np.any(data.warning.number)
    whiskers = data.qpos[panda.JOINTS : model.jnt_qposadr[model.joint("object_cylinder_90").id]]
    assert np.max(np.abs(whiskers)) < 1e-4
