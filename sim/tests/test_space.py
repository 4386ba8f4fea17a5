"""Whiskers in space: rotations, chain, solids, motions and certificates against theory and against each other."""

import json

import msgspec
import mujoco
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from whisker_sim.arm import panda
from whisker_sim.cli import main
from whisker_sim.errors import InputError
from whisker_sim.physics import space_chain, space_pins
from whisker_sim.physics.cases import WHISKERS
from whisker_sim.render import is_rendered, render_set
from whisker_sim.rod import Suspension, spatially_loaded
from whisker_sim.runs import Run, load_runs
from whisker_sim.space import rotation
from whisker_sim.space.certificate import certify_in_space
from whisker_sim.space.model import BASE_COORDINATES, build_model
from whisker_sim.space.motions import AnySpatialMotion
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import SpatialSimulated, simulate_in_space
from whisker_sim.space.solids import AnySolid
from whisker_sim.space.solids.base import CORNER, EDGE, FACE
from whisker_sim.space.solids.box import Box
from whisker_sim.space.solids.cone import Cone
from whisker_sim.space.solids.cylinder import Cylinder
from whisker_sim.space.solids.mesh import read_mesh
from whisker_sim.space.solids.pin import ThinRod
from whisker_sim.space.statics import chain_under_load
from whisker_sim.space.trace import SPATIAL_COLUMNS, spatial_columns
from whisker_sim.space.truth import CenterCurve
from whisker_sim.space.whisker import SpatialWhisker

from conftest import REPOSITORY, SCENES

SOLIDS = {solid.__struct_config__.tag: solid for solid in AnySolid.__args__}
MOTIONS = {motion.__struct_config__.tag: motion for motion in AnySpatialMotion.__args__}
SLOW_SWEEP = {"kind": "sweep", "contact_arc_m": 0.0487, "depth_m": 0.006, "stroke_m": [0.0, 0.0, 0.003], "peak_speed_m_s": 0.004}
ARM = {"kind": "arm", "contact_arc_m": 0.05, "depth_m": 0.006, "joints_rad": [-0.02, 0.01, 0.0, 0.006, 0.01, -0.008, 0.05]}
OCTAHEDRON = """# 30 mm across
v 15 0 0
v -15 0 0
v 0 15 0
v 0 -15 0
v 0 0 15
v 0 0 -15
f 1 3 5
f 3 2 5
f 2 4 5
f 4 1 5
f 3 1 6
f 2 3 6
f 4 2 6
f 1/1 4/2/3 6//1
"""
BOX = {"shape": "box", "size_m": [0.02, 0.02, 0.02]}
SCENE = {
    "format": 2,
    "name": "space",
    "role": "trial",
    "group": "test",
    "whisker": "straight",
    "solid": {"shape": "sphere", "radius_m": 0.02},
    "motion": SLOW_SWEEP,
}


@pytest.fixture
def space_run(tmp_path):
    """A function that writes `SCENE` with keys replaced, and returns its run."""
    (tmp_path / "octahedron.obj").write_text(OCTAHEDRON)

    def make(**changes) -> Run:
        path = tmp_path / "space.json"
        path.write_text(json.dumps({key: value for key, value in {**SCENE, **changes}.items() if value is not None}, indent=2))
        return load_runs(path)[1][0]

    return make


@pytest.fixture
def rejected(space_run):
    """A function that checks that a scene with keys replaced is rejected with one line that contains `words`."""

    def check(words: list[str], **changes) -> None:
        with pytest.raises(Exception) as raised:  # noqa: PT011
            simulate_in_space(space_run(**changes))
        message = str(raised.value)
        assert "\n" not in message
        for word in words:
            assert word in message

    return check


def test_val_rotations_against_scipy():
    rng = np.random.default_rng(0)
    matrices = Rotation.random(200, rng=rng).as_matrix()
    quaternions = rotation.quaternion_of(matrices)
    expected = Rotation.from_matrix(matrices).as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(quaternions, expected, atol=1e-14)
    np.testing.assert_allclose(rotation.matrix_of(quaternions), matrices, atol=1e-14)
    np.testing.assert_allclose(rotation.yaw_pitch_roll(matrices), Rotation.from_matrix(matrices).as_euler("ZYX"), atol=1e-12)
    np.testing.assert_allclose(rotation.from_yaw_pitch_roll(rotation.yaw_pitch_roll(matrices)), matrices, atol=1e-12)
    vectors = rng.standard_normal((50, 3))
    np.testing.assert_allclose(rotation.turn(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
    half_turns = np.array([np.diag(signs) for signs in ((1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))])
    np.testing.assert_allclose(rotation.matrix_of(rotation.quaternion_of(half_turns)), half_turns, atol=1e-15)


@pytest.mark.parametrize("name", WHISKERS)
def test_val_chain_at_rest_against_the_rod(name):
    """100 loads in all directions: second order in the segment length, 0.01 % of range at the default."""
    rows = space_chain.compare(name, "alternating")
    errors = {row.segments: row.moment_error for row in rows}
    assert errors[12] / errors[24] == pytest.approx(4.0, rel=0.1)
    assert errors[24] / errors[48] == pytest.approx(4.0, rel=0.1)
    assert errors[24] < 1e-4


def test_val_one_order_of_the_joints_is_of_first_order():
    rows = space_chain.compare("straight", "same order")
    assert rows[-2].moment_error / rows[-1].moment_error == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("name", WHISKERS)
def test_verif_mujoco_s_chain_is_in_equilibrium(name):
    """MuJoCo's model has the shape of `chain_under_load`, and the torques of the force balance its springs."""
    whisker = space_chain.whisker_in_space(name, 24)
    force_n, node = space_chain.loads_n(whisker)[:3], 18
    loaded, angles_rad = chain_under_load(whisker, node, force_n)
    model = build_model(whisker, ThinRod(center_m=(1.0, 1.0, 1.0)), np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)), 0.0005)
    data = mujoco.MjData(model)
    body = model.body(f"link_{node}").id
    offset_mm = (
        1e3
        * whisker.rest_frame(whisker.node_arcs_m[node]).T
        @ (whisker.rest_point_m(whisker.node_arcs_m[node]) - whisker.rest_point_m(whisker.hinge_arcs_m[node - 1]))
    )
    jacobian = np.empty((3, model.nv))
    for index in range(len(force_n)):
        data.qpos[BASE_COORDINATES:] = angles_rad[index]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        directors = data.xmat[body].reshape(3, 3)
        place_mm = data.xpos[body] + directors @ offset_mm
        mujoco.mj_jac(model, data, jacobian, None, place_mm, body)
        torque = jacobian[:, BASE_COORDINATES:].T @ directors @ (1e6 * force_n[index])
        np.testing.assert_allclose(
            torque, model.jnt_stiffness[BASE_COORDINATES:] * angles_rad[index], atol=1e-9 * np.max(np.abs(torque))
        )
        np.testing.assert_allclose(place_mm, 1e3 * loaded.point_m[index], atol=1e-10)


@pytest.mark.parametrize("name", WHISKERS)
def test_verif_center_curve_is_that_of_the_model(name):
    """The centre line agrees with MuJoCo's bodies for a turned base and a bent, twisted whisker."""
    whisker = space_chain.whisker_in_space(name, 24)
    start = np.array((0.1, -0.2, 0.3, *Rotation.from_euler("ZYX", (0.4, 0.3, -0.2)).as_quat(scalar_first=True)))
    model = build_model(whisker, ThinRod(center_m=(1.0, 1.0, 1.0)), start, 0.0005)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.05 * np.random.default_rng(1).standard_normal(model.nq)
    mujoco.mj_kinematics(model, data)
    base = model.body("base").id
    position_m, turned = data.xpos[base] / 1e3, data.xmat[base].reshape(3, 3)
    line = CenterCurve.from_joints(whisker, position_m[None], turned[None], data.qpos[None, BASE_COORDINATES:])
    for node in range(1, whisker.whisker.segments + 1):
        body = model.body(f"link_{node}").id
        rest = whisker.rest_point_m(whisker.node_arcs_m[node]) - whisker.rest_point_m(whisker.hinge_arcs_m[node - 1])
        local_mm = 1e3 * whisker.rest_frame(whisker.node_arcs_m[node]).T @ rest
        node_mm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local_mm
        np.testing.assert_allclose(line.points_m[0, node], node_mm / 1e3, atol=1e-12)
        np.testing.assert_allclose(line.tangents[0, node], data.xmat[body].reshape(3, 3)[:, 0], atol=1e-12)


@pytest.mark.parametrize("name", SOLIDS)
def test_verif_solid_geometry(name, tmp_path):
    """Nearest points lie on the surface, at the stated distance, and nothing of the surface is nearer."""
    (tmp_path / "octahedron.obj").write_text(OCTAHEDRON)
    solid = SOLIDS[name](center_m=(0.003, -0.002, 0.004), **SOLIDS[name].example).placed(tmp_path)
    rng = np.random.default_rng(0)
    points_m = np.array(solid.center_m) + rng.uniform(-0.05, 0.05, (500, 3))
    nearest = solid.closest(points_m)
    np.testing.assert_allclose(np.linalg.norm(points_m - nearest.point_m, axis=1), np.abs(nearest.distance_m), atol=1e-12)
    again = solid.closest(nearest.point_m)
    assert np.max(np.abs(again.distance_m)) < 1e-12
    samples_m = np.concatenate((nearest.point_m, np.concatenate(solid.curves_m())))
    apart_m = np.linalg.norm(points_m[:, None] - samples_m[None], axis=2).min(axis=1)
    assert np.all(apart_m >= np.abs(nearest.distance_m) - 1e-9)
    # The distance changes by the step along the normal, also from inside to outside.
    normal = (points_m - nearest.point_m) / nearest.distance_m[:, None]
    outward = solid.closest(nearest.point_m + 1e-4 * normal)
    np.testing.assert_allclose(outward.distance_m, 1e-4, atol=1e-9)
    assert np.max(np.abs(solid.closest(np.concatenate(solid.curves_m())).distance_m)) < 1e-5


def test_verif_features_of_solids():
    box = Box(size_m=(0.02, 0.02, 0.02))
    points_m = np.array(((0.02, 0.0, 0.0), (0.02, 0.02, 0.0), (0.02, 0.02, 0.02), (0.009, 0.0, 0.0)))
    assert box.closest(points_m).feature.tolist() == [FACE, EDGE, CORNER, FACE]
    cone = Cone(radius_m=0.02, length_m=0.04)
    points_m = np.array(((0.02, 0.0, 0.0), (0.03, 0.0, -0.02), (0.0, 0.001, 0.05), (0.0, 0.0, -0.03)))
    assert cone.closest(points_m).feature.tolist() == [FACE, EDGE, CORNER, FACE]
    cylinder = Cylinder(radius_m=0.01, length_m=0.02)
    assert cylinder.closest(np.array(((0.02, 0.0, 0.0), (0.0, 0.02, 0.02)))).feature.tolist() == [FACE, EDGE]


@pytest.mark.parametrize(
    ("text", "unit_m", "words"),
    [
        (OCTAHEDRON.replace("f 2 3 6\n", ""), 1e-3, ["closed surface", "3 edges of only one"]),
        (OCTAHEDRON.replace("f 2 3 6", "f 3 2 6"), 1e-3, ["one sense of rotation"]),
        (OCTAHEDRON.replace("v 0 0 15", "v 0 0 -10"), 1e-3, ["convex surface", "in front of triangle"]),
        (OCTAHEDRON, 1.0, ["extent of 0.001 to 2.0 m", "found 30 m", "unit_m"]),
        (OCTAHEDRON, 1e-6, ["found 3e-05 m", "unit_m"]),
        (OCTAHEDRON.replace("f 1 3 5", "f 1 3 50"), 1e-3, ["line 8", "one of 6 vertices", "50"]),
        (OCTAHEDRON.replace("v 15 0 0", "v 15 0"), 1e-3, ["line 2", "three coordinates"]),
        (OCTAHEDRON.replace("v 15 0 0", "v 15 0 nan"), 1e-3, ["line 2", "finite number", "nan"]),
        (OCTAHEDRON.replace("v 15 0 0", "v 15 0 l"), 1e-3, ["line 2", "finite number", "found 'l'"]),
        ("", 1e-3, ["vertices and faces"]),
        (OCTAHEDRON + 6000 * "f 1 3 5\n", 1e-3, ["at most 5000 triangles"]),
        (None, 1e-3, ["No such file"]),
    ],
)
def test_robust_wrong_meshes_are_one_clear_error(tmp_path, text, unit_m, words):
    path = tmp_path / "space.json"
    path.write_text(json.dumps({**SCENE, "solid": {"shape": "mesh", "file": "mesh.obj", "unit_m": unit_m}}, indent=2))
    if text is not None:
        (tmp_path / "mesh.obj").write_text(text)
    with pytest.raises(InputError) as raised:
        load_runs(path)
    message = str(raised.value)
    assert message.startswith(f"{path}:9:5: solid.file: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"solid\nfacet\nvertex 0 0\n", ["line 3", "three coordinates", "found 2"]),
        (b"solid\nvertex 0 0 x\n", ["line 2", "finite number", "found 'x'"]),
        (b"solid\nvertex 0 0 1\n", ["three vertices a triangle", "found 1 vertices"]),
        (b"not a mesh", ["expected an STL file"]),
        (bytes(80) + (1).to_bytes(4, "little") + np.full(12, np.nan, "<f4").tobytes() + bytes(2), ["triangle 1", "finite"]),
        (b"solid\n" + 15003 * b"vertex 0 0 1\n", ["at most 5000 triangles"]),
    ],
)
def test_robust_wrong_stl_files_are_one_clear_error(tmp_path, content, words):
    (tmp_path / "mesh.stl").write_bytes(content)
    with pytest.raises(ValueError, match="expected") as raised:
        read_mesh(tmp_path / "mesh.stl", 1e-3)
    assert all(word in str(raised.value) for word in words), raised.value


def test_verif_stl_and_obj_files_of_a_solid_are_equal(tmp_path):
    obj, ascii_stl, binary_stl = (tmp_path / name for name in ("mesh.obj", "ascii.stl", "binary.stl"))
    obj.write_text(OCTAHEDRON)
    vertices, triangles = read_mesh(obj, 1e-3)
    corners = 1e3 * np.array(vertices)[np.array(triangles)]
    lines = ["solid octahedron"]
    for corner in corners:
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"vertex {x:.6e} {y:.6e} {z:.6e}" for x, y, z in corner),
            "endloop",
            "endfacet",
        ]
    ascii_stl.write_text("\n".join([*lines, "endsolid"]))
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    rows["corners"] = corners
    binary_stl.write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
    for path in (ascii_stl, binary_stl):
        found, faces = read_mesh(path, 1e-3)
        np.testing.assert_allclose(sorted(found), sorted(vertices), atol=1e-9)
        assert len(faces) == len(triangles)


def settled(simulated: SpatialSimulated):
    return simulated.touching & (simulated.time_s > 1.0)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("whisker", ["straight"])
def test_val_solid_in_the_simulator(space_run, name, whisker):
    """MuJoCo's geometry coincides with the signed distance, the force with the normal, and the contact with the rod's."""
    direction = [0.0, -1.0, 0.2] if whisker == "curved" else [0.0, 1.0, 0.2]
    run = space_run(whisker=whisker, solid={"shape": name, **SOLIDS[name].example}, motion={**SLOW_SWEEP, "direction": direction})
    simulated = simulate_in_space(run)
    scene = run.scene
    touching = settled(simulated)
    truth = simulated.truth
    gap_m = np.linalg.norm(truth.contact_m - truth.surface_m, axis=1) - scene.resolved_whisker.radius_m(truth.arc_m)
    assert np.max(np.abs(gap_m[touching])) < 5e-6
    certificate = certify_in_space(scene.spatial_whisker, simulated.solid, simulated, scene.simulation.timestep_s)
    assert certificate.unsolved == 0
    assert certificate.sampled >= 20
    assert certificate.moment_rms < 1e-3
    assert certificate.surface_rms_m < 10e-6
    assert certificate.normal_rms_rad < np.radians(0.2)


@pytest.mark.parametrize("name", MOTIONS)
def test_verif_motion_in_space(space_run, name):
    """The motion starts at rest and without contact, keeps its guarantees, and its plan is smooth."""
    motion = MOTIONS[name]
    duration = {"duration_s": 4.0} if motion.needs_duration else {}
    run = space_run(solid={"shape": "pin"}, motion={"kind": name, **motion.example}, **duration)
    plan = run.scene.plan(run.scene.solid)
    assert plan.touching
    steps = np.diff(plan.coordinates, axis=0)
    assert np.all(steps[0] == 0.0)
    assert np.max(np.abs(np.diff(steps[:, :3], axis=0))) < 2e-6, "acceleration below 8 m/s^2 at a step of 0.5 ms"
    simulated = simulate_in_space(run)
    assert not np.any(simulated.touching[simulated.time_s < 0.2])
    np.testing.assert_allclose(simulated.position_m[-1], plan.coordinates[-1, :3], atol=3e-3)


def test_val_the_arm_moves_the_base_as_its_jacobian_predicts():
    """To first order in the joint angles the twist of the base is the Jacobian of the arm times the change of the angles."""
    motion = MOTIONS["arm"](**{**MOTIONS["arm"].example, "joints_rad": tuple(1e-3 * (index + 1) for index in range(7))})
    moved = motion._moved(np.array((0.0, 1e-3)))
    np.testing.assert_allclose(moved[0], np.eye(4), atol=1e-12)
    mount = panda.translation((0.0, 0.0, motion.mount_m)) @ np.array(
        ((0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    )
    expected = panda.body_jacobian(panda.READY_RAD, mount) @ (1e-3 * np.array(motion.joints_rad))
    found = np.concatenate((moved[1, :3, 3], Rotation.from_matrix(moved[1, :3, :3]).as_rotvec()))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("path", sorted((SCENES / "space").glob("*.json")), ids=lambda path: path.stem)
def test_verif_scenes_in_space_are_valid(path):
    """Every scene of the folder can be planned."""
    (run,) = load_runs(path)[1]
    assert run.scene.plan(run.scene.solid.placed(path.parent)).touching


def test_verif_every_solid_and_motion_has_a_scene():
    files = [path.read_text() for path in (SCENES / "space").glob("*.json")]
    assert max(len(text.splitlines()) for text in files) <= 10
    scenes = [json.loads(text) for text in files]
    assert {scene["solid"]["shape"] for scene in scenes} == set(SOLIDS)
    assert {scene["motion"]["kind"] for scene in scenes} == set(MOTIONS)


def test_verif_twist_is_the_derivative_of_the_pose(space_run):
    motion = {**MOTIONS["sweep"].example, "kind": "sweep", "orientation": [0.8, 0.0, 0.0, 0.6], "direction": [-0.96, 0.28, 0.0]}
    run = space_run(solid={"shape": "pin"}, motion=motion, rate_hz=1000.0)
    simulated = simulate_in_space(run)
    step_s = 1e-3
    rate = (simulated.position_m[2:] - simulated.position_m[:-2]) / (2.0 * step_s)
    in_world = rotation.applied(simulated.rotation, simulated.velocity_m_s)[1:-1]
    np.testing.assert_allclose(in_world, rate, atol=2e-4)
    turned = np.swapaxes(simulated.rotation[:-2], 1, 2) @ simulated.rotation[2:]
    vector = Rotation.from_matrix(turned).as_rotvec() / (2.0 * step_s)
    np.testing.assert_allclose(simulated.angular_rad_s[1:-1], vector, atol=2e-3)


def test_val_readings_are_in_equilibrium_with_the_force(space_run):
    """At rest the moment at the root is that of the contact force about it, and the axial force its component along the base."""
    motion = {"kind": "push", "contact_arc_m": 0.05, "depth_m": 0.006, "direction": [0.0, -1.0, 0.5], "peak_speed_m_s": 0.002}
    run = space_run(whisker="curved", motion=motion, solid={"shape": "pin", "axis": [0.0, 0.6, 1.0]})
    simulated = simulate_in_space(run)
    rows = np.flatnonzero((simulated.time_s > 1.4) & (simulated.time_s < 1.6))
    lever_m = simulated.truth.contact_m[rows] - simulated.position_m[rows]
    expected = rotation.undone(simulated.rotation[rows], np.cross(lever_m, simulated.force_n[rows]))
    range_n_m = np.max(np.linalg.norm(simulated.moment_n_m, axis=1))
    np.testing.assert_allclose(simulated.moment_n_m[rows], expected, atol=1e-3 * range_n_m)
    force_x_n = rotation.undone(simulated.rotation[rows], simulated.force_n[rows])[:, 0]
    np.testing.assert_allclose(simulated.axial_n[rows], force_x_n, atol=2e-3 * np.max(np.abs(simulated.force_n)))
    assert abs(expected[0, 0]) > 0.02 * range_n_m, "a curved whisker touched out of its plane twists its root"


def test_val_a_contact_in_the_plane_gives_the_planar_scene(space_run, make_run):
    """The same push simulated in the plane and in space: same reading within 0.02 % of range, no torsion, no second bending."""
    from whisker_sim.simulate import simulate

    # No move takes a whole number of time steps, so that both plans round them alike.
    path = {"clearance_m": 1.417e-3, "touch_depth_m": 1.013e-3}
    sweep = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.006, "strokes": 1, **path}
    seen = simulate(make_run(object={"shape": "pin"}, motion=sweep))
    motion = {"kind": "push", "contact_arc_m": 0.05, "depth_m": 0.007013, "peak_speed_m_s": 0.035, "dwell_s": 0.0, **path}
    spatial = simulate_in_space(space_run(solid={"shape": "pin"}, motion=motion, segments=40))
    assert len(spatial.time_s) == len(seen.time_s)
    moment_n_m = 0.17e-3 * seen.rotations_rad[:, 0]
    range_n_m = np.max(np.abs(moment_n_m))
    np.testing.assert_allclose(spatial.moment_n_m[:, 2], moment_n_m, atol=2e-4 * range_n_m)
    assert np.max(np.abs(spatial.moment_n_m[:, :2])) < 1e-6 * range_n_m
    touching = seen.touching & spatial.touching
    np.testing.assert_allclose(spatial.truth.surface_m[touching][:, :2], seen.truth.surface_m[touching], atol=1e-7)


def test_verif_two_simulations_have_the_same_rows(space_run):
    run = space_run(motion={"kind": "push", "contact_arc_m": 0.05, "depth_m": 0.004})
    first, second = (spatial_columns(simulate_in_space(run)) for _ in range(2))
    assert len(first) == len(SPATIAL_COLUMNS)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def test_verif_the_default_suspension_is_that_of_the_whisker(space_run):
    scene = space_run().scene
    assert scene.resolved_suspension == Suspension(0.17e-3, 0.17e-3, 0.17e-3)
    assert scene.spatial_whisker.stiffness_n_m_rad(0)[0] == pytest.approx(scene.spatial_whisker.stiffness_n_m_rad(0)[1] / 1.33)
    assert msgspec.convert(msgspec.to_builtins(scene), SpatialScene) == scene


def test_val_a_stiffer_pitch_takes_more_of_the_load():
    """A load at 45 degrees on a root ten times stiffer in pitch, against the rod."""
    wire = msgspec.structs.replace(WHISKERS["straight"], segments=48)
    whisker = SpatialWhisker(wire, Suspension(0.17e-3, 1.7e-3, 0.17e-3), 0.33)
    force_n = np.array(((0.0, 4e-4, 4e-4),))
    chain, _ = chain_under_load(whisker, 36, force_n)
    exact = spatially_loaded(wire, whisker.suspension, 0.33, np.array([0.06]), force_n)
    np.testing.assert_allclose(chain.moment_n_m, exact.moment_n_m, atol=1e-4 * np.max(np.abs(exact.moment_n_m)))
    assert abs(chain.root_rad[0, 1]) < 0.2 * abs(chain.root_rad[0, 0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"motion": {**SLOW_SWEEP, "orientation": [1.0, 0.1, 0.0, 0.0]}}, ["motion.orientation", "unit quaternion", "1.00498"]),
        ({"solid": {**BOX, "orientation": [0.0, 0.0, 0.0, 0.0]}}, ["solid.orientation", "norm 0"]),
        ({"solid": {"shape": "pin", "axis": [0.0, 0.0, 0.0]}}, ["solid.axis", "not zero"]),
        ({"solid": {"shape": "pin", "axis": [0.0, 1.0]}}, ["solid.axis", "length 3"]),
        ({"solid": {"shape": "pine"}}, ["solid.shape", "expected one of", "pin"]),
        ({"motion": {**SLOW_SWEEP, "direction": [0.0, 0.0, 0.0]}}, ["motion.direction", "not zero"]),
        ({"motion": {**SLOW_SWEEP, "aim_m": [0.0, 0.0, 0.5]}}, ["motion.direction", "does not meet"]),
        ({"motion": {**SLOW_SWEEP, "stroke_m": [0.0, 0.0, 0.0]}}, ["motion.stroke_m: expected a stroke or a tilt, found none"]),
        ({"motion": {**SLOW_SWEEP, "contact_arc_m": 0.0005}, "solid": {"shape": "pin"}}, ["motion.direction", "at its root"]),
        ({"motion": {**SLOW_SWEEP, "contact_arc_m": 0.0795}, "solid": {"shape": "pin"}}, ["motion.direction", "at its tip"]),
        ({"motion": {**SLOW_SWEEP, "contact_arc_m": 0.2}}, ["motion.contact_arc_m", "at most the length"]),
        ({"motion": {**SLOW_SWEEP, "tilt_rad": [0.0, 1.6, 0.0]}}, ["motion", "at most 80 degrees", "found 9"]),
        ({"motion": ARM | {"joints_rad": [0.0] * 6}}, ["motion.joints_rad", "length 7"]),
        ({"motion": ARM | {"joints_rad": [0.0] * 7}}, ["motion.joints_rad", "at least 0.001 m"]),
        ({"motion": ARM | {"joints_rad": [0.0] * 3 + [2.5] + [0.0] * 3}}, ["motion.joints_rad", "joint 4", "found 0.1438"]),
        ({"motion": ARM | {"posture_rad": [3.0] + [0.0] * 6}}, ["motion.posture_rad", "joint 1", "found 3"]),
        ({"motion": ARM | {"peak_speed_m_s": 100.0}}, ["motion.peak_speed_m_s", "joint speed", "rad/s"]),
        ({"motion": {**SLOW_SWEEP, "peak_speed_m_s": "fast"}}, ["motion.peak_speed_m_s", "float"]),
        ({"motion": {**SLOW_SWEEP, "dwell_s": 1e12}}, ["motion.dwell_s: expected at most 10000000 time steps", "found 2e+15"]),
        ({"motion": {**SLOW_SWEEP, "strokes": 1000, "peak_speed_m_s": 1e-3}}, ["motion.dwell_s", "time steps of the whole motion"]),
        ({"motion": {"kind": "smooth", "contact_arc_m": 0.05, "depth_m": 0.008}, "duration_s": 1e12}, ["duration_s", "time steps"]),
        ({"solid": {"shape": "sphere", "radius_m": 1e-200}}, ["solid.radius_m", ">= 1e-05"]),
        ({"poisson_ratio": 0.7}, ["poisson_ratio", "0.5"]),
        ({"duration_s": 2.0}, ["duration_s", "ends by itself"]),
        ({"format": 1}, ["format", "found 1"]),
        ({"suspension": {"yaw_n_m_rad": 1e-4, "pitch_n_m_rad": 1e-4}}, ["suspension", "twist_n_m_rad"]),
    ],
)  # fmt: skip
def test_robust_wrong_scenes_are_one_clear_error(rejected, changes, words):
    rejected(words, **changes)


@pytest.mark.parametrize(
    ("solid", "extent_m"),
    [({"shape": "sphere", "radius_m": 3.0}, 3.0), ({"shape": "cylinder", "radius_m": 1.5, "length_m": 1.0}, 1.5)],
)
def test_robust_the_touch_of_a_solid_larger_than_a_metre_is_on_its_surface(space_run, solid, extent_m):
    """The advance begins outside the solid, also if the aim is deep inside it."""
    scene = space_run(solid=solid).scene
    start_m = scene.plan(scene.solid).coordinates[0, :3]
    assert start_m[1] == pytest.approx(-extent_m - scene.motion.clearance_m - scene.resolved_whisker.radius_m(0.0487), abs=1e-4)


class Blank:
    """A renderer of two empty frames."""

    sources = ()
    frames_hz = rate_hz = 1.0
    lossless = True
    rows, still_row = 2, 0

    def __init__(self, run):
        self.run = run

    def frames(self, rows):
        return (Image.new("RGB", (8, 8), (row, 0, 0)) for row in rows)


def test_regress_an_animation_is_drawn_again_after_its_mesh_changed(space_run, tmp_path):
    run = space_run(solid={"shape": "mesh", "file": "octahedron.obj", "unit_m": 1e-3})
    assert not is_rendered(tmp_path, run, Blank)
    render_set(tmp_path, Blank(run))
    assert is_rendered(tmp_path, run, Blank)
    (tmp_path / "octahedron.obj").write_text(OCTAHEDRON.replace("v 0 0 15", "v 0 0 15.5"))
    assert not is_rendered(tmp_path, run, Blank)
    (tmp_path / "octahedron.obj").write_text(OCTAHEDRON)
    assert is_rendered(tmp_path, run, Blank)


def test_regress_the_golden_trace_in_space(tmp_path):
    """The generator writes the stored trace: the same bytes, or values within the tolerance of other processors."""
    stored = REPOSITORY / "datasets/golden/space/golden_space.csv"
    assert main(["simulate", str(SCENES / "space/golden_space.json"), "--out", str(tmp_path)]) == 0
    made = (tmp_path / "golden_space.csv").read_text()
    if made == stored.read_text():
        return
    found, expected = (np.genfromtxt(text.splitlines()[1:], delimiter=",") for text in (made, stored.read_text()))
    assert made.splitlines()[0] == stored.read_text().splitlines()[0]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


def test_verif_every_scene_of_the_suite_can_be_planned(capsys):
    assert main(["check", str(SCENES / "suites/spatial.json")]) == 0
    assert "suite of 62 runs" in capsys.readouterr().out


def test_robust_a_gigantic_mesh_file_is_not_read(tmp_path):
    path = tmp_path / "mesh.stl"
    with path.open("wb") as file:
        file.truncate(65 << 20)
    with pytest.raises(ValueError, match="expected at most 64 MiB, found 65 MiB"):
        read_mesh(path, 1e-3)


@pytest.mark.parametrize("whisker", ["straight", "curved"])
def test_verif_the_pins_of_the_suite_are_those_drawn(whisker):
    rng = space_pins.stream(whisker)
    for number in range(space_pins.PINS):
        name = f"pin_{number:02d}_{whisker}"
        assert json.loads((SCENES / f"space/{name}.json").read_text()) == space_pins.drawn(rng, name, whisker)
