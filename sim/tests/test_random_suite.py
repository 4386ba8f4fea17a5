"""Random suites: draws, rejection, files, and the separation of the suite for settings from the one for reports."""

import hashlib
import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from whisker_sim.cli import main
from whisker_sim.documents import to_json
from whisker_sim.jobs import SUCCESS, WRONG_INPUT, process_executor, run_job
from whisker_sim.products import product_of, trace_job
from whisker_sim.random_suite import simulate as random_set
from whisker_sim.random_suite.contacts import CONDITIONS, NON_CONVEX_KINDS
from whisker_sim.random_suite.effects import MISCALIBRATIONS, RATES_HZ
from whisker_sim.random_suite.movements import MOVEMENTS
from whisker_sim.random_suite.objects import KINDS
from whisker_sim.random_suite.simulate import SET_ATTEMPTS, TRACE_ATTEMPTS, simulate_set
from whisker_sim.random_suite.space import CALIBRATION
from whisker_sim.random_suite.suite import Draws, RandomSuite
from whisker_sim.random_suite.whiskers import LEAST_DEPTH_M, STANDARD, calibration_scene, random_whisker, scale
from whisker_sim.replay import Miscalibration
from whisker_sim.runs import Redrawn, Run, load_runs
from whisker_sim.scene import Simulation
from whisker_sim.shapes import Circle
from whisker_sim.simulate import simulate
from whisker_sim.whisker import resolve_whisker

from conftest import SCENES

HELD_OUT, TRAINING = SCENES / "suites/random.json", SCENES / "suites/random_training.json"
CONTACTS, TRAINING_CONTACTS = SCENES / "suites/random_contacts.json", SCENES / "suites/random_contacts_training.json"
IN_SPACE = SCENES / "suites/random_space.json"
TRAINING_IN_SPACE = SCENES / "suites/random_space_training.json"
MORE_TRAINING_IN_SPACE = SCENES / "suites/random_space_training_more.json"
LARGE_TRAINING_IN_SPACE = SCENES / "suites/random_space_training_large.json"


def sets_of(path: Path, redrawn: Redrawn | None = None) -> list[Run]:
    """Runs of the sets of a random suite."""
    return [run for run in load_runs(path, redrawn)[1] if run.scene.role == "trial"]


def contents(runs: list[Run]) -> list[str]:
    """Hash of what is drawn of each scene, as first drawn, without its names."""
    scenes = (run.scene.draw(0).scene(trace, 0) for run in runs for trace in range(run.scene.traces))
    keys = ("object", "motion", "seed", "face", "rate_hz", "replay", "friction", "object_velocity_m_s")
    drawn = ([value for key in keys if (value := getattr(scene, key)) is not msgspec.UNSET] for scene in scenes)
    return [hashlib.sha256(to_json(values)).hexdigest() for values in drawn]


def test_verif_random_whiskers_are_plausible():
    """`Whisker` accepts all that are drawn."""
    for seed in range(1000):
        whisker = resolve_whisker(random_whisker("w", np.random.default_rng(seed)))
        assert whisker.length_m >= 0.05


@pytest.mark.parametrize(
    ("for_settings", "for_reports", "counts"),
    [(TRAINING, HELD_OUT, (600, 1500)), (TRAINING_CONTACTS, CONTACTS, (90, 150))],
    ids=["ideal", "contacts"],
)
def test_verif_settings_and_reports_use_disjoint_scenes(for_settings, for_reports, counts):
    """No scene of the suite for settings occurs in the suite for reports, with the same seed or another, and none occurs twice."""
    training, held_out = contents(sets_of(for_settings)), contents(sets_of(for_reports))
    assert (len(set(training)), len(set(held_out))) == (len(training), len(held_out)) == counts
    assert set(training).isdisjoint(held_out)
    seeds = {run.scene.seed for run in (*sets_of(for_settings), *sets_of(for_reports))}
    for seed in (*seeds, 2, 3):
        assert set(contents(sets_of(for_settings, Redrawn(seed, 20)))).isdisjoint(held_out)


@pytest.mark.parametrize(
    ("for_settings", "least"), [(TRAINING_IN_SPACE, 25), (MORE_TRAINING_IN_SPACE, 20), (LARGE_TRAINING_IN_SPACE, 100)]
)
def test_verif_settings_and_reports_use_disjoint_scenes_in_space(for_settings, least):
    """No valid scene in space of a suite for settings occurs in the suite for reports, with the same seed or another."""
    training, held_out = contents_in_space(sets_of(for_settings)), contents_in_space(sets_of(IN_SPACE))
    assert len(set(training)) == len(training) > least
    assert len(set(held_out)) == len(held_out) > 60
    assert set(training).isdisjoint(held_out)
    for seed in {run.scene.seed for run in (*sets_of(for_settings), *sets_of(IN_SPACE))}:
        assert set(contents_in_space(sets_of(for_settings, Redrawn(seed, 20)))).isdisjoint(held_out)


def contents_in_space(runs: list[Run]) -> list[str]:
    """Hash of what is drawn of each valid scene, as first drawn, without its names."""
    drawn = []
    for run in (run for run in runs if _is_valid(run, 0)):
        for trace in range(run.scene.traces):
            try:
                scene = run.scene.draw(0).scene(trace, 0)
            except ValueError:
                continue
            drawn.append(to_json([scene.solid, scene.motion, scene.seed, scene.rate_hz]))
    return [hashlib.sha256(values).hexdigest() for values in drawn]


def test_verif_a_set_depends_on_suite_seed_and_number_alone():
    """A longer suite begins with the sets of a shorter one, in any order of drawing."""
    short, long = sets_of(TRAINING, Redrawn(5, 3)), sets_of(TRAINING, Redrawn(5, 30))
    assert contents(short) == contents(long)[: len(contents(short))]
    assert contents(long[::-1])[-5:] == [*contents(long[:1])[:5]]
    names = [name for run in long for name in run.scene.names(run.name)]
    assert names[0] == "random_training_5_0000_00"
    assert len(set(names)) == len(names)


def test_val_distribution_of_draws():
    """All kinds occur about as often as their weights state, and quantities cover their ranges."""
    runs = sets_of(HELD_OUT, Redrawn(4, 3000))
    scenes = [run.scene.draw(0).scene(0, 0) for run in runs]
    count = len(scenes)
    shares = {scene.shape: 0 for scene in scenes}
    for scene in scenes:
        shares[scene.shape] += 1
    circles = sum(weight for weight, kind in KINDS if kind.name == "circle") / sum(weight for weight, _ in KINDS)
    assert abs(shares["circle"] / count - circles) < 0.03
    assert len(shares) == 8, "every shape but none else"
    assert len({scene.motion_kind for scene in scenes}) == len(MOVEMENTS)
    assert {scene.rate_hz for scene in scenes} == set(RATES_HZ)
    assert {scene.face for scene in scenes} == {"left", "right"}
    # The logarithm of a log-uniform radius has the mean and the variance of a uniform distribution.
    share = np.log10([scene.object.radius_m / 1e-3 for scene in scenes if isinstance(scene.object, Circle)]) / 2.0
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    assert abs(share.mean() - 0.5) < 4.0 * np.sqrt(1.0 / 12.0 / len(share))
    noise = np.log([scene.replay.noise / 0.001 for scene in scenes]) / np.log(50.0)
    assert noise.min() >= 0.0
    assert noise.max() <= 1.0
    assert abs(noise.mean() - 0.5) < 4.0 * np.sqrt(1.0 / 12.0 / count)
    off = [scene.replay.miscalibration for scene in scenes if scene.replay.miscalibration != Miscalibration()]
    assert abs(len(off) / count - 0.3) < 0.04
    used = {key for one in off for key, value in msgspec.structs.asdict(one).items() if value != 0.0}
    assert used == set(Miscalibration.__struct_fields__)
    assert len(MISCALIBRATIONS) == 7
    standard = np.mean([run.scene.resolved_whisker.name in STANDARD for run in runs])
    assert abs(standard - 0.5) < 0.04


def test_val_distribution_of_conditions():
    """Each scene has friction, an object that is not convex or one that moves, as often as their weights state."""
    scenes = [run.scene.draw(0).scene(0, 0) for run in sets_of(CONTACTS, Redrawn(4, 1000))]
    friction = [scene.friction for scene in scenes if scene.friction_coefficient > 0.0]
    hollow = [scene for scene in scenes if not scene.object.convex]
    speeds_m_s = [np.hypot(*scene.object_velocity_m_s) for scene in scenes if scene.object_velocity_m_s is not msgspec.UNSET]
    assert len(friction) + len(hollow) + len(speeds_m_s) == len(scenes)
    total = sum(weight for weight, _ in CONDITIONS)
    for found, (weight, _) in zip((friction, hollow, speeds_m_s), CONDITIONS, strict=True):
        assert abs(len(found) / len(scenes) - weight / total) < 0.05
    assert {scene.shape for scene in hollow} == set(NON_CONVEX_KINDS)
    assert 0.05 <= min(friction) < 0.1 < 0.5 < max(friction) <= 0.6
    assert 1.9e-4 < min(speeds_m_s) < 3e-4 < 1e-3 < max(speeds_m_s) < 2.1e-3


def test_robust_a_suite_in_space_refuses_contacts_that_are_not_ideal(tmp_path, capsys):
    """A random suite in space refuses contacts that are not ideal."""
    path = tmp_path / "wrong.json"
    path.write_text('{"format": 1, "name": "wrong", "random": {"seed": 1, "sets": 1, "in_space": true, "ideal": false}}')
    assert main(["check", str(path)]) == WRONG_INPUT
    assert "ideal: expected true with `in_space`, found false; remove one of the two keys" in capsys.readouterr().err


def test_verif_random_whiskers_and_their_calibrations_are_valid():
    """Whiskers differ, are slender, and the motion of their calibration fits both faces."""
    rng = np.random.default_rng(1)
    whiskers = [random_whisker(f"w{index}", rng) for index in range(200)]
    for whisker in map(resolve_whisker, whiskers):
        assert 250.0 < whisker.length_m / whisker.root_diameter_m < 430.0
        assert whisker.tip_diameter_m <= whisker.root_diameter_m
    assert any(len(whisker.curvature) == 2 for whisker in whiskers)
    for whisker in whiskers[:4]:
        for face in ("left", "right"):
            plan = calibration_scene("suite_1", whisker, face, 0).plan()
            assert len(plan.touching) == 20


def test_regress_the_outermost_pushes_of_a_calibration_keep_their_contact():
    """Pushes at the end of the calibrated range last longer than the bouncing at their touch, also on the inside of a curved wire.

    On the inside of the suite's whisker 0, whose tangent turns by 1.1 rad, the tip limits the depth.
    """
    whisker = msgspec.json.decode(HELD_OUT.read_bytes(), type=RandomSuite).whisker(len(STANDARD))
    for seed in range(4):
        scene = calibration_scene("suite_1", whisker, "left", seed)
        grid, stage = scene.motion, scene.stage()
        least_m = LEAST_DEPTH_M * scale(scene.resolved_whisker)
        assert least_m <= grid.depth_m(grid.arc_max_m, stage) < 1.5 * least_m
        outermost = msgspec.structs.replace(grid, lines=2, arc_min_m=grid.arc_max_m - 5e-4)
        simulated = simulate(Run(scene.name, msgspec.structs.replace(scene, motion=outermost), HELD_OUT))
        assert 0.4 < simulated.touching.mean() < 1.0


@pytest.fixture(scope="module")
def suite_path(tmp_path_factory):
    """A random suite of three sets of one trace."""
    path = tmp_path_factory.mktemp("random") / "few.json"
    path.write_bytes(to_json(RandomSuite(1, "few", Draws(seed=2, sets=3, traces=1, whiskers=0))))
    return path


def test_verif_same_bytes_on_one_process_and_two(suite_path, tmp_path, capsys):
    """The bytes do not depend on the number of processes; a second run finds all traces up to date."""
    one, two = tmp_path / "one", tmp_path / "two"
    for folder, jobs in ((one, 1), (two, 2)):
        items = [(folder, run) for run in sets_of(suite_path)]
        assert run_job(trace_job(False), items, process_executor(jobs), False) == SUCCESS
    files = sorted(path.name for path in one.iterdir())
    assert files == sorted(path.name for path in two.iterdir())
    assert len(files) == 9
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in files)
    capsys.readouterr()
    assert run_job(trace_job(False), items, process_executor(1), False) == SUCCESS
    assert capsys.readouterr().err.count("up to date") == 3
    run = items[0][1]
    sidecar = json.loads((two / f"{run.name}_00.json").read_text())
    assert sidecar["replay"] == sidecar["scene"]["replay"]
    assert 0.001 <= sidecar["replay"]["noise"] <= 0.05
    (two / f"{run.name}_00.csv").write_text("damaged")
    assert not product_of(run).is_up_to_date(two, run)


def test_verif_rejected_scenes_are_drawn_again(suite_path, monkeypatch):
    """A trace takes the first possible attempt; a set without one is drawn again as a whole."""
    run = sets_of(suite_path)[0]
    tried = []

    def accept(number):
        def accepted(run):
            tried.append(run.scene)
            return random_set.SimulatedTrace(run, None, None) if len(tried) == number else None

        return accepted

    monkeypatch.setattr(random_set, "_accepted", accept(3))
    (trace,) = simulate_set(run)
    assert trace.run.scene == run.scene.draw(0).scene(0, 2) != run.scene.draw(0).scene(0, 1)
    tried.clear()
    monkeypatch.setattr(random_set, "_accepted", accept(TRACE_ATTEMPTS + 1))
    (trace,) = simulate_set(run)
    assert trace.run.scene == run.scene.draw(1).scene(0, 0)
    tried.clear()
    monkeypatch.setattr(random_set, "_accepted", accept(0))
    with pytest.raises(random_set.SimulationError, match=f"in {SET_ATTEMPTS} attempts"):
        simulate_set(run)


def test_verif_coarse_time_steps_take_rates_that_fit():
    """With the fast settings, sets are drawn again until their rate is a whole number of time steps."""
    simulation = Simulation(timestep_s=0.001)
    drawn = [msgspec.structs.replace(run.scene, simulation=simulation).draw(0) for run in sets_of(TRAINING, Redrawn(6, 60))]
    scenes = [random_set._scene(one, 0, 0) for one in drawn]
    valid = {scene.rate_hz for scene in scenes if scene is not None}
    assert None in scenes
    assert valid == {50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0}


def test_val_distribution_of_draws_in_space():
    """All kinds of solids and motions occur, on both presets; depths are those of the calibration at most."""
    runs = sets_of(IN_SPACE, Redrawn(4, 400))
    scenes = []
    for run in runs:
        attempts = (attempt for attempt in range(20) if _is_valid(run, attempt))
        scenes.append(run.scene.draw(next(attempts)).scene(0, 0))
    assert {scene.shape for scene in scenes} == {"pin", "sphere", "cylinder", "cone", "box", "torus"}
    assert {scene.motion_kind for scene in scenes} == {"sweep", "smooth", "spiral", "push"}
    assert {scene.resolved_whisker.name for scene in scenes} == set(STANDARD)
    assert all(0.0018 < scene.motion.depth_m < CALIBRATION.depth_max_m for scene in scenes)
    calibrations = [run.scene for run in load_runs(IN_SPACE)[1] if run.scene.role == "calibration"]
    assert [scene.name for scene in calibrations] == ["random_space_1_curved", "random_space_1_straight"]
    listed = [run.scene for run in load_runs(SCENES / "suites/spatial.json")[1] if run.scene.role == "calibration"]
    assert all(scene.motion == CALIBRATION for scene in (*calibrations, *listed))


def _is_valid(run: Run, attempt: int) -> bool:
    try:
        run.scene.draw(attempt).scene(0, 0)
    except ValueError:
        return False
    return True


def test_verif_a_set_in_space_is_simulated_and_found_up_to_date(tmp_path, capsys):
    """The trace of a set has the name of the set and its number, and the scene as drawn."""
    path = tmp_path / "few.json"
    path.write_bytes(to_json(RandomSuite(1, "few", Draws(seed=2, sets=1, traces=1, in_space=True))))
    (run,) = sets_of(path)
    items = [(tmp_path / "traces", run)]
    for expected in (": straight, ", "up to date"):
        assert run_job(trace_job(False), items, process_executor(1), False) == SUCCESS
        assert expected in "".join(capsys.readouterr())
    (sidecar,) = (json.loads(file.read_text()) for file in (tmp_path / "traces").glob("*.json"))
    assert (sidecar["name"], sidecar["group"], sidecar["format"]) == ("few_2_0000_00", "few_2_0000", 2)
    assert sidecar["object"] == sidecar["scene"]["solid"]["shape"]


def test_robust_options_of_random_suites(tmp_path, capsys):
    """Seed and count apply to random suites only and must be numbers."""
    golden = str(SCENES / "suites/golden.json")
    assert main(["simulate", golden, "--out", str(tmp_path), "--seed", "3"]) == WRONG_INPUT
    assert "expected a random suite with --seed or --count, found another file" in capsys.readouterr().err
    for wrong in (["--seed", "-1"], ["--seed", str(2**60)], ["--count", "0"]):
        with pytest.raises(SystemExit):
            main(["simulate", str(TRAINING), "--out", str(tmp_path), *wrong])
    path = tmp_path / "wrong.json"
    path.write_text('{"format": 1, "name": "wrong", "random": {"seed": 1, "sets": 0}}')
    assert main(["check", str(path)]) == WRONG_INPUT
    assert "random.sets" in capsys.readouterr().err
