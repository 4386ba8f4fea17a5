"""Whiskers in space: mechanics, traces, calibrations and estimators."""

import csv
import hashlib
import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import whisker_contact as wc

from conftest import GOLDEN, same_bits


@pytest.fixture(scope="module")
def trace() -> wc.SpatialTrace:
    return wc.SpatialTrace.read(GOLDEN / "space" / "golden_space.csv")


@pytest.fixture(scope="module")
def rod(trace: wc.SpatialTrace) -> wc.Rod:
    return wc.Rod(trace.whisker)


@pytest.fixture(scope="module")
def lines(trace: wc.SpatialTrace, rod: wc.Rod) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lines at six arc lengths in nine directions about the whisker, by the exact rod."""
    lines = []
    for arc_m in np.linspace(0.03, 0.06, 6):
        at = np.append(trace.whisker.rest_shape([arc_m])[0], 0.0)
        ahead = np.append(trace.whisker.rest_shape([arc_m + 1e-6])[0], 0.0)
        tangent = (ahead - at) / np.linalg.norm(ahead - at)
        sides = np.array([[-tangent[1], tangent[0], 0.0], [0.0, 0.0, 1.0]])
        for angle in 2.0 * np.pi * np.arange(9) / 9.0:
            depth_m = 2.4 * arc_m**2 * np.linspace(0.1, 1.0, 8)
            points = at + depth_m[:, None] * (np.array([np.cos(angle), np.sin(angle)]) @ sides)
            lines.append((points, rod.deflect(points, strict=True).moment_n_m[:, 1:]))
    return lines


@pytest.fixture(scope="module")
def calibration(rod: wc.Rod, lines: list[tuple[np.ndarray, np.ndarray]]) -> wc.SpatialCalibration:
    return wc.fit_spatial_calibration(rod, lines, models=["polynomial"])


def test_verif_a_contact_in_the_plane_is_that_of_the_planar_whisker(trace, rod):
    pressed = wc.press(trace.whisker, [0.04, 0.06], [-2e-4, -1e-4], strict=True)
    points = np.column_stack([pressed.point, np.zeros(2)])
    contacts = rod.deflect(points, strict=True)
    assert np.allclose(contacts.moment_n_m[:, 2], pressed.moment_n_m, rtol=1e-9)
    assert np.allclose(contacts.moment_n_m[:, :2], 0.0, atol=1e-15)
    shape = contacts.shape(31)
    assert shape.shape == (2, 31, 3)
    assert np.allclose(shape[:, :, :2], pressed.shape(31), atol=1e-12)


def test_verif_derivatives_are_central_differences(rod):
    point = np.array([[0.05, 0.015, 0.004]])
    stated = rod.deflect(point, strict=True).moment_gradient_n[0]
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-7
        ahead, behind = (rod.deflect(point + sign * step, strict=True).moment_n_m[0] for sign in (1, -1))
        assert np.allclose(stated[:, axis], (ahead - behind) / 2e-7, rtol=1e-5, atol=1e-9)


def test_robust_a_contact_out_of_reach_is_a_row_of_nan_or_an_error(rod):
    points = [[0.05, 0.01, 0.0], [0.2, 0.0, 0.0]]
    contacts = rod.deflect(points)
    assert np.isfinite(contacts.moment_n_m[0]).all()
    assert np.isnan(contacts.moment_n_m[1]).all()
    assert [row for row, _ in contacts.failures] == [1]
    with pytest.raises(ValueError, match=r"points\[1\]"):
        rod.deflect(points, strict=True)


def test_verif_the_trace_has_its_recording_and_truth(trace):
    assert len(trace) == 482
    assert trace.role == "trial"
    norm = sum(trace.recording[f"base_q{part}"] ** 2 for part in "wxyz")
    assert np.allclose(norm, 1.0, atol=1e-9)
    normal = np.column_stack([trace.truth[f"normal_{axis}"] for axis in "xyz"])
    assert np.allclose(np.linalg.norm(normal[trace.truth["touching"] == 1], axis=1), 1.0, atol=1e-6)


def test_verif_predictions_are_those_of_the_rod(rod, calibration, tmp_path):
    points = np.array([[0.04, 0.012, 0.002], [0.05, 0.018, -0.002]])
    predicted = calibration.predict(points)
    assert predicted.calibrated.all()
    expected = rod.deflect(points, strict=True).moment_n_m[:, 1:]
    assert np.abs(predicted.reading_n_m - expected).max() < 0.02 * calibration.largest_reading_n_m
    assert predicted.gradient_n.shape == (
        2,
        2,
        3,
    )
    assert predicted.covariance_n2_m2.shape == (2, 2, 2)
    assert not calibration.predict([[0.05, 0.08, 0.0]]).calibrated.any()
    calibration.write(tmp_path / "curved.json")
    read = wc.load_spatial_calibration(tmp_path / "curved.json")
    assert np.array_equal(read.predict(points).reading_n_m, predicted.reading_n_m)


def inputs(trace: wc.SpatialTrace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    known = trace.recording
    base = np.column_stack([known[f"base_{part}"] for part in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")])
    return (
        known["t_s"],
        base,
        np.column_stack([known["moment_y_n_m"], known["moment_z_n_m"]]),
    )


def turning(folder: Path) -> Path:
    """The golden trace with a base that turns to and fro, its quaternions rounded as in a trace."""
    path = folder / "turning.csv"
    with (GOLDEN / "space" / "golden_space.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        half_rad = 0.002 * np.sin(20.0 * float(row["t_s"]))
        w, x, y, z = (float(row[f"base_q{part}"]) for part in "wxyz")
        cos, sin = np.cos(half_rad), np.sin(half_rad)
        turned = (w * cos - z * sin, x * cos + y * sin, y * cos - x * sin, z * cos + w * sin)
        row.update({f"base_q{part}": f"{number:.10f}" for part, number in zip("wxyz", turned, strict=True)})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    sidecar = json.loads((GOLDEN / "space" / "golden_space.json").read_text())
    sidecar |= {"name": "turning", "csv_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    path.with_suffix(".json").write_text(json.dumps(sidecar))
    return path


@pytest.mark.parametrize("name", ["line", "sphere-fit"])
def test_verif_a_replay_equals_that_of_the_command_to_the_bit(tmp_path, command, calibration, name):
    path, file, out = (turning(tmp_path), tmp_path / "curved.json", tmp_path / "estimates.csv")
    calibration.write(file)
    options = ["--estimator", name, "--calibration", file, "--out", out]
    subprocess.run([command, "replay", path, *options], check=True)
    expected = np.genfromtxt(out, delimiter=",", names=True)
    trace = wc.SpatialTrace.read(path)
    t_s, base, readings = inputs(trace)
    noise_sd_n_m = 0.01 * np.sqrt((readings**2).sum(axis=1)).max()
    estimator = wc.SpatialEstimator(name, calibration, noise_sd_n_m, trace.rate_hz)
    noisy = np.column_stack([expected["moment_y_n_m"], expected["moment_z_n_m"]])
    replay = estimator.replay(t_s, base, noisy)
    assert replay.touching.sum() > 20
    for values, names in [(replay.contact_world, "contact_{}_m"), (replay.normal_world, "normal_{}")]:
        of_command = np.column_stack([expected[names.format(axis)] for axis in "xyz"])
        assert np.array_equal(values, of_command, equal_nan=True)


def test_verif_replay_equals_steps_and_finds_the_contact(trace, calibration):
    noise_sd_n_m = 0.01 * np.abs(trace.recording["moment_z_n_m"]).max()
    estimator = wc.SpatialEstimator("line", calibration, noise_sd_n_m, trace.rate_hz)
    t_s, base, readings = inputs(trace)
    replay = estimator.replay(t_s, base, readings)
    # The base of this trace does not turn, so that its motions are translations.
    moved = -np.diff(base[:, :3], axis=0, prepend=base[:1, :3])
    for row in range(len(trace)):
        motion = (*moved[row], 1.0, 0.0, 0.0, 0.0)
        estimate = estimator.step(motion, t_s[row] - t_s[max(row - 1, 0)], readings[row])
        assert (estimate is None) == (not replay.touching[row])
        if estimate is not None:
            assert np.allclose(estimate.contact, replay.contact[row], atol=1e-9)
            assert np.allclose(estimate.covariance_m2, replay[row].covariance_m2, rtol=1e-6)
    truth = np.column_stack([trace.truth[f"contact_{axis}_m"] for axis in "xyz"])
    error_m = np.linalg.norm(replay.contact_world - truth, axis=1)
    assert replay.touching.sum() > 300
    assert np.nanmedian(error_m) < 2e-3


def test_verif_updates_with_poses_equal_the_replay(trace, calibration):
    t_s, base, readings = inputs(trace)
    estimator = wc.SpatialEstimator("sphere-fit", calibration, 2e-7, trace.rate_hz)
    replay = estimator.replay(t_s, base, readings)
    for row in range(len(trace)):
        estimate = estimator.update(t_s[row], tuple(base[row]), readings[row])
        assert (estimate is None) == (not replay.touching[row])
        if estimate is not None:
            assert np.array_equal(estimate.contact, replay.contact[row])
            assert np.array_equal([estimate.radius_m or np.nan], replay.radius_m[row : row + 1], equal_nan=True)
            assert estimate.model_doubtful == replay.model_doubtful[row]
    assert np.isfinite(replay.radius_m).any()
    assert np.isfinite(replay.radius_sd_m).any()
    with pytest.raises(ValueError, match="t_s: found"):
        estimator.update(t_s[-1], tuple(base[-1]), readings[-1])


def test_robust_bad_input_is_one_error(trace, calibration):
    with pytest.raises(ValueError, match="unknown estimator in space `ukf`"):
        wc.SpatialEstimator("ukf", calibration, 1e-7, 250.0)
    estimator = wc.SpatialEstimator("line", calibration, 1e-7, 250.0)
    with pytest.raises(ValueError, match="motion: found a quaternion of norm 2"):
        estimator.step((0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0), 0.004, (0.0, 0.0))
    with pytest.raises(ValueError, match=r"reading_n_m: found \[NaN, 0.0\]"):
        estimator.step((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), 0.004, (float("nan"), 0.0))
    estimator.step((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), 0.0, (0.0, 0.0))
    with pytest.raises(ValueError, match="update: found samples given by `step` before"):
        estimator.update(0.0, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0))
    t_s, base, readings = inputs(trace)
    with pytest.raises(ValueError, match="base: found an array of shape"):
        estimator.replay(t_s, base[:, :3], readings)
    with pytest.raises(ValueError, match="readings_n_m: found an array of shape"):
        estimator.replay(t_s, base, readings[:, 0])
    with pytest.raises(ValueError, match="format: found 1"):
        wc.SpatialTrace.read(GOLDEN / "golden_pin.csv")


@pytest.mark.parametrize("factor", [-1.0, 0.0])
def test_robust_readings_of_no_sign_or_the_wrong_one_are_refused(rod, lines, factor):
    wrong = [(points, factor * readings if i == 7 else readings) for i, (points, readings) in enumerate(lines)]
    with pytest.raises(ValueError, match=r"readings of lines\[7\]: found .*, expected about"):
        wc.fit_spatial_calibration(rod, wrong, models=["polynomial"])


def test_verif_a_calibration_states_whether_the_sensor_is_a_real_one(tmp_path, rod, lines, calibration):
    real = wc.fit_spatial_calibration(rod, lines, models=["polynomial"], real_sensor=True)
    real.write(tmp_path / "real.json")
    restored = wc.load_spatial_calibration(tmp_path / "real.json")
    assert (calibration.real_sensor, real.real_sensor, restored.real_sensor) == (False, True, True)


def test_verif_the_sensor_of_a_calibration_converts_counts(tmp_path, calibration):
    with pytest.raises(ValueError, match="found no sensor, expected a calibration that"):
        calibration.sensor()
    calibration.write(tmp_path / "calibration.json")
    stored = json.loads((tmp_path / "calibration.json").read_text())
    response = [[2e7, 5e6], [-4e6, 3e7]]
    stored["sensor"] = {"counts_per_n_m": response, "noise_sd_n_m": 1e-7}
    (tmp_path / "calibration.json").write_text(json.dumps(stored))
    sensor = wc.load_spatial_calibration(tmp_path / "calibration.json").sensor()
    assert sensor.counts_per_n_m.tolist() == response
    assert sensor.noise_sd_n_m == 1e-7
    moments = np.array([[1e-6, -2e-6], [3e-6, 0.0]])
    counts = moments @ np.transpose(response)
    assert np.allclose(sensor.moments_n_m(counts), moments, rtol=1e-12, atol=1e-20)
    assert np.array_equal(sensor.moments_n_m(counts[0]), sensor.moments_n_m(counts)[0])
    with pytest.raises(ValueError, match=r"counts: found an array of shape \[3\], expected shape \[n, 2\]"):
        sensor.moments_n_m([1.0, 2.0, 3.0])


def test_robust_a_calibration_of_missing_traces_is_refused(tmp_path, calibration):
    for name in ("one", "other"):
        for end in ("csv", "json"):
            text = (GOLDEN / "space" / f"golden_space.{end}").read_text()
            (tmp_path / f"{name}.{end}").write_text(text.replace('"golden_space"', f'"{name}"'))
    path = tmp_path / "calibrations" / "curved.json"
    path.parent.mkdir()
    calibration.write(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"traces": ["one", "other"]}))
    with pytest.raises(ValueError, match=r"curved\.json: data_sha256: found .* have changed"):
        wc.load_spatial_calibration(path)
    (tmp_path / "other.json").unlink()
    with pytest.raises(ValueError, match=r"other\.csv is missing"):
        wc.load_spatial_calibration(path)


def test_regress_an_absent_calibration_is_an_error_of_the_operating_system(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"absent\.json"):
        wc.load_spatial_calibration(tmp_path / "calibrations" / "absent.json")


def test_verif_the_registry_lists_the_estimators():
    classes = {row["name"]: row["class"] for row in wc.spatial_estimators()}
    assert (classes["line"], classes["paper-ukf-3d"], classes["batch-recommended"]) == ("recursive", "published", "hindsight")


@pytest.fixture(scope="module")
def trial(trace: wc.SpatialTrace, calibration: wc.SpatialCalibration) -> wc.SpatialTrial:
    return wc.SpatialTrial(trace, calibration, noise=0.01, seed=1)


@dataclass
class Answer:
    contact: np.ndarray
    covariance_m2: np.ndarray | None = None
    normal: np.ndarray | None = None
    direction: np.ndarray | None = None
    direction_sd_rad: float | None = None
    radius_m: float | None = None
    radius_sd_m: float | None = None
    model_doubtful: bool | None = None


class Known:
    """The true contacts of a trace whose base turns by less than a microradian, with the properties of its pin."""

    def __init__(self, trace):
        truth, known = trace.truth, trace.recording
        self.contacts = np.column_stack([truth[f"contact_{axis}_m"] - known[f"base_{axis}_m"] for axis in "xyz"])
        self.normals = np.column_stack([truth[f"normal_{axis}"] for axis in "xyz"])
        self.row = -1

    def step(self, motion, dt_s, reading_n_m):
        self.row += 1
        contact = self.contacts[self.row]
        if np.isnan(contact).any():
            return None
        axis = np.array([0.3, -0.2, 1.0])
        return Answer(
            contact, 1e-8 * np.eye(3), self.normals[self.row], axis / np.linalg.norm(axis), 0.01, 0.5e-3, 1e-4, model_doubtful=False
        )


def dataset_in_space(folder: Path, calibration: wc.SpatialCalibration) -> wc.Dataset:
    for end in ("csv", "json"):
        (folder / f"golden_space.{end}").write_bytes((GOLDEN / "space" / f"golden_space.{end}").read_bytes())
    (folder / "calibrations").mkdir()
    calibration.write(folder / "calibrations" / "curved.json")
    return wc.Dataset(folder)


def test_verif_a_trial_and_its_table_equal_those_of_the_command_to_the_bit(tmp_path, command, trial):
    calibration, out = tmp_path / "curved.json", tmp_path / "space_estimates" / "golden_space.recommended.csv"
    trial.calibration.write(calibration)
    out.parent.mkdir()
    path = GOLDEN / "space" / "golden_space.csv"
    subprocess.run([command, "replay", path, "--calibration", calibration, "--out", out], check=True)
    expected, replay = wc.read_table(out), trial.replay("recommended")
    assert replay.table.dtype.names == expected.dtype.names
    for name in expected.dtype.names:
        assert np.array_equal(replay.table[name], expected[name], equal_nan=True), name
    assert replay.touching.sum() > 100
    assert same_bits(replay.readings_n_m, trial.readings_n_m)


def test_verif_scores_equal_those_of_the_command_to_the_bit(tmp_path, command, calibration):
    folder = tmp_path / "data"
    folder.mkdir()
    dataset = dataset_in_space(folder, calibration)
    options = ["--estimators", "line,recommended", "--seeds", "2", "--results", tmp_path / "results", "--name", "run"]
    subprocess.run([command, "evaluate", folder, *options], check=True, capture_output=True)
    results = wc.read_results(tmp_path / "results" / "run")
    assert results.run["name"] == "data"
    assert {"space_trials", "space_summary", "space_times", "space_estimates/golden_space.line"} <= set(results)
    for name, table in results.items():
        assert table.dtype.names, name
    expected = results["space_trials"]
    found = wc.evaluate(dataset.traces(), dataset.calibration("curved"), ["line", "recommended"], seeds=2, threads=2)
    assert len(found) == len(expected) == 4
    assert set(found.dtype.names) == set(expected.dtype.names) - {"noise_sd_n_m"}
    for row in expected:
        [same] = found[(found["estimator"] == row["estimator"]) & (found["seed"] == row["seed"])]
        for name in found.dtype.names:
            assert same[name] == row[name] or (np.isnan(same[name]) and np.isnan(row[name])), name
    assert np.isfinite(expected["rmse_m"]).all()


def test_verif_the_true_contacts_have_no_error(trial):
    replay = trial.run(Known(trial.trace))
    scores = trial.score(replay)
    assert np.nanmax(trial.errors_m(replay)) < 1e-7
    assert scores["rmse_m"] < 1e-7
    assert scores["nees"] < 1e-4
    assert scores["answered"] == scores["coverage"] == 1.0
    assert scores["normal_rad"] < 1e-6
    assert scores["direction_rad"] < 1e-6
    assert scores["doubted"] == 0.0
    assert np.isnan(scores["radius_error"])
    assert np.isnan(scores["corner_m"])


def test_verif_an_own_estimator_is_judged_like_a_registered_one(trial):
    own = wc.SpatialEstimator("line", trial.calibration, trial.noise_sd_n_m, trial.rate_hz)
    one, other = trial.replay("line"), trial.run(own)
    assert np.allclose(one.contact, other.contact, rtol=0, atol=1e-9, equal_nan=True)
    assert trial.score(other)["rmse_m"] == pytest.approx(trial.score(one)["rmse_m"], rel=1e-6)
    assert trial.touched[one.touching].all()
    assert trial.motions.shape == (len(trial), 7)
    assert trial.dt_s[0] == 0.0
    assert trial.dt_s[1:] == pytest.approx(1 / trial.rate_hz)

    class Bare:
        def step(self, motion, dt_s, reading_n_m):
            return Answer(np.array([0.05, 0.01, 0.0]), 1e-6 * np.eye(3))

    bare = trial.run(Bare())
    assert np.linalg.norm(bare.normal, axis=1) == pytest.approx(1.0)
    assert np.isnan(bare.direction).all()
    assert not bare.model_doubtful.any()


def test_verif_a_replay_has_normals_directions_models_and_surface(trial):
    line, mixed = trial.replay("line"), trial.replay("recommended")
    touching = line.touching
    assert np.linalg.norm(line.direction[touching], axis=1) == pytest.approx(1.0)
    base = trial.trace.recording
    axis = np.column_stack([base[f"base_q{name}"] for name in "xyz"])
    turn = 2.0 * np.cross(axis, line.direction)
    turned = line.direction + base["base_qw"][:, None] * turn + np.cross(axis, turn)
    assert np.allclose(turned, line.direction_world, equal_nan=True)
    assert (line.direction_sd_rad[touching] > 0.0).all()
    assert line.calibrated[touching].any()
    assert not line.calibrated[~touching].any()
    assert (line.nis[touching][1:] >= 0.0).all()
    assert line.models == {}
    assert np.allclose(line.normal_covariance, line.normal_covariance.transpose(0, 2, 1), equal_nan=True)
    wire_m = np.linalg.norm(line.contact_world - line.surface_world, axis=1)[touching]
    assert wire_m == pytest.approx(0.125e-3, rel=1e-6)
    assert list(mixed.models) == ["cone-fit", "line-fit", "patch-fit", "sphere-fit"]
    total = sum(mixed.models.values())
    assert total[mixed.touching] == pytest.approx(1.0)
    assert np.isnan(total[~mixed.touching]).all()
    row = int(np.flatnonzero(mixed.touching)[-1])
    estimate = mixed[row]
    assert estimate.models == {name: shares[row] for name, shares in mixed.models.items()}
    assert np.linalg.norm(estimate.surface - estimate.contact) == pytest.approx(0.125e-3, rel=1e-6)
    squared = estimate.innovation_n_m @ np.linalg.solve(estimate.innovation_covariance_n2_m2, estimate.innovation_n_m)
    assert squared == pytest.approx(mixed.nis[row])
    own = wc.SpatialEstimator("line", trial.calibration, trial.noise_sd_n_m, trial.rate_hz)
    table = own.replay(*inputs(trial.trace)).table
    assert np.isnan(table["truth_contact_x_m"]).all()
    assert set(table["calibrated"].tolist()) <= {-1, 0, 1}


def test_val_the_bound_is_below_the_error_and_that_of_an_unknown_object_is_above_it(trial):
    bound = trial.bound
    direct = wc.spatial_cramer_rao_bound(trial.trace, trial.calibration, trial.noise_sd_n_m)
    for name in bound.dtype.names:
        assert np.array_equal(bound[name], direct[name], equal_nan=True), name
    steady = bound["since_touch_s"] >= 1.0
    assert steady.sum() > 100
    assert (bound["object_bound_m"][steady] > bound["bound_m"][steady]).all()
    assert (bound["radius_bound_m"][steady] > 0.0).all()
    scores = trial.score(trial.replay("line-fit"))
    known_m = np.sqrt(np.mean(bound["bound_m"][steady] ** 2))
    assert known_m == pytest.approx(scores["bound_m"])
    assert known_m < scores["rmse_m"]
    assert trial.expected[steady].all()
    with pytest.raises(ValueError, match="noise_sd_n_m: found 0, expected a positive number"):
        wc.spatial_cramer_rao_bound(trial.trace, trial.calibration, 0.0)
    exact = wc.SpatialTrial(trial.trace, trial.calibration, noise_sd_n_m=0.0)
    assert np.isnan(exact.bound["bound_m"]).all()
    assert np.isnan(exact.score(exact.run(Known(trial.trace)))["bound_m"])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (3.0, r"estimate of row 0: estimate: found 3.0, expected None or an object"),
        (Answer(np.zeros(3)), "estimate of row 0: covariance_m2: found none, expected a positive definite matrix"),
        (Answer(np.zeros(2), np.eye(3)), "estimate of row 0: contact: found 2 numbers, expected 3"),
        (Answer(np.array([0.0, np.nan, 0.0]), np.eye(3)), r"contact\[1\]: found NaN, expected finite numbers"),
        (Answer(np.array([2e3, 0.0, 0.0]), np.eye(3)), "contact: found .*, expected a point within 1000 m"),
        (Answer(np.zeros(3), np.diag([1.0, 1.0, -1.0])), "covariance_m2: found .*, expected a positive definite matrix"),
        (Answer(np.zeros(3), np.eye(3), np.array([0.0, 0.0, 2.0])), "normal: found .*, expected a unit vector"),
        (Answer(np.zeros(3), np.eye(3), None, np.array([0.0, 0.0, 1.0])), "direction_sd_rad: found none, expected"),
        (Answer(np.zeros(3), np.eye(3), radius_sd_m=1.0), "radius_m: found none, expected a value beside `radius_sd_m`"),
        (Answer(np.zeros(3), np.eye(3), radius_m=1.0, radius_sd_m=0.0), "radius_sd_m: found 0.0, expected a positive number"),
        (Answer(np.zeros(3), np.eye(3), radius_m=-1.0, radius_sd_m=1.0), "radius_m: found -1.0, expected a number of 0 or more"),
    ],
)
def test_robust_answers_of_an_own_estimator_in_space_are_checked(trial, answer, message):
    class Own:
        def step(self, *_):
            return answer

    with pytest.raises(ValueError, match=message):
        trial.run(Own())


def test_robust_wrong_arguments_of_trials_in_space_are_one_error(trace, calibration, trial):
    with pytest.raises(ValueError, match="noise: found -1, expected a number of 0 or more"):
        wc.SpatialTrial(trace, calibration, noise=-1.0)
    with pytest.raises(ValueError, match="noise and noise_sd_n_m: found both, expected one"):
        wc.SpatialTrial(trace, calibration, noise=0.1, noise_sd_n_m=0.0)
    with pytest.raises(ValueError, match=r"in space `ukf` \(it is one for planar traces\), expected one of"):
        trial.replay("ukf")
    other = wc.SpatialTrial(trace, calibration, seed=2).replay("line")
    for use in (trial.score, trial.errors_m):
        with pytest.raises(ValueError, match=r"replay: row 0: reading: found .*, expected .*, that of the trial of golden_space"):
            use(other)
    t_s, base, readings = inputs(trace)
    own = wc.SpatialEstimator("line", calibration, trial.noise_sd_n_m, trial.rate_hz)
    with pytest.raises(ValueError, match=r"replay: found 10 rows, expected 482"):
        trial.score(own.replay(t_s[:10], base[:10], readings[:10]))
    moved = base + np.array([1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"replay: row 0: base: found"):
        trial.score(own.replay(t_s, moved, trial.readings_n_m))
    assert trial.score(own.replay(t_s, base, trial.readings_n_m))["rmse_m"] > 0.0


def test_verif_a_folder_with_planar_traces_and_traces_in_space_gives_both(tmp_path, calibration):
    dataset_in_space(tmp_path, calibration)
    for file in GOLDEN.glob("golden_pin*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    dataset = wc.Dataset(tmp_path)
    traces = dataset.traces()
    assert [type(trace) for trace in traces] == [wc.Trace, wc.SpatialTrace]
    assert [trace.name for trace in traces] == ["golden_pin", "golden_space"]
    assert isinstance(dataset.calibration("curved"), wc.SpatialCalibration)
    with pytest.raises(ValueError, match="golden_space: found a trace in space, expected a planar trace, as golden_pin is"):
        wc.evaluate(traces, calibration, ["line"])
    with pytest.raises(TypeError, match="calibrations: straight: found SpatialCalibration, expected Calibration"):
        wc.evaluate(traces[:1], calibration, ["ekf"])
    with pytest.raises(ValueError, match="found no traces with the role `calibration`"):
        dataset.traces("calibration")


def test_verif_the_sweep_of_a_trial_in_space_is_drawn(trial):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    axes = wc.plot_sweep(trial, {"line": trial.replay("line")})
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["line", "line, stated", "Cramér–Rao bound", "Cramér–Rao bound, unknown object"]
    axes.figure.canvas.draw()


def calibration_trace(folder: Path, rod: wc.Rod, lines: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """A calibration trace of a base at rest whose contacts are those of the lines, with pauses between them."""
    with (GOLDEN / "space" / "golden_space.csv").open(newline="") as file:
        golden = list(csv.DictReader(file))
    free = next(row for row in golden if not row["truth_contact_x_m"])
    touching = next(row for row in golden if row["truth_contact_x_m"])
    rows = [free] * 5
    for points, _ in lines:
        contacts = rod.deflect(points, strict=True)
        for point, moment, force, arc_m, tangent in zip(
            points, contacts.moment_n_m, contacts.force_n, contacts.arc_m, contacts.tangent, strict=True
        ):
            row = touching | {"truth_arc_m": f"{arc_m:.9f}"}
            parts = {"contact_{}_m": point, "surface_{}_m": point, "force_{}_n": force, "tangent_{}": tangent}
            parts["normal_{}"] = force / np.linalg.norm(force)
            for name, vector in parts.items():
                row |= {f"truth_{name.format(axis)}": f"{number:.12f}" for axis, number in zip("xyz", vector, strict=True)}
            row |= {f"moment_{axis}_n_m": f"{number:.15f}" for axis, number in zip("xyz", moment, strict=True)}
            rows.append(row)
        rows += [free] * 3
    still = {name: "0.0" for name in free if name.startswith("base_")} | {"base_qw": "1.0"}
    unknown = {name: "" for name in free if name.startswith("rotation_")}
    sidecar = json.loads((GOLDEN / "space" / "golden_space.json").read_text())
    for place, row in enumerate(rows):
        rows[place] = row | still | unknown | {"t_s": f"{place / sidecar['rate_hz']:.9f}"}
    path = folder / "lines.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    sidecar |= {"name": "lines", "role": "calibration", "rows": len(rows), "certificate": None}
    sidecar |= {"csv_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    path.with_suffix(".json").write_text(json.dumps(sidecar))


def test_verif_a_trial_through_a_hall_sensor_equals_the_command_to_the_bit(tmp_path, command, rod, lines, calibration, trace):
    calibration_trace(tmp_path, rod, lines)
    subprocess.run([command, "fit", tmp_path, "--front-end", "hall", "--model", "polynomial"], check=True, capture_output=True)
    through_hall = wc.load_spatial_calibration(tmp_path / "calibrations" / "hall" / "curved.json")
    out = tmp_path / "space_estimates" / "golden_space.line.csv"
    out.parent.mkdir()
    options = ["--front-end", "hall", "--calibration", tmp_path / "calibrations" / "hall" / "curved.json", "--seed", "3"]
    options += ["--estimator", "line", "--out", out]
    subprocess.run([command, "replay", GOLDEN / "space" / "golden_space.csv", *options], check=True)
    trial = wc.SpatialTrial(trace, through_hall, seed=3, front_end="hall")
    expected, replay = wc.read_table(out), trial.replay("line")
    # `line` does not judge its model, and a column without values has no type.
    assert (replay.table["model_doubtful"] == -1).all()
    for name in set(expected.dtype.names) - {"model_doubtful"}:
        assert np.array_equal(replay.table[name], expected[name], equal_nan=True), name
    assert 0.0 < trial.noise_sd_n_m < 0.01 * through_hall.largest_reading_n_m
    assert trial.score(replay)["rmse_m"] < 3e-3
    assert [row["name"] for row in wc.spatial_front_ends()] == ["white", "hall"]
    with pytest.raises(ValueError, match="front_end: found none, expected `hall`"):
        wc.SpatialTrial(trace, calibration, front_end="hall")
    with pytest.raises(ValueError, match=r"front_end\.name: found `hall`, expected `white`"):
        wc.SpatialTrial(trace, through_hall)
    with pytest.raises(ValueError, match="unknown front end `optical` of traces in space, expected one of: white, hall"):
        wc.SpatialTrial(trace, calibration, front_end="optical")
    with pytest.raises(ValueError, match=r"front_end\.config\.gap_m: found .*, expected 0\.003"):
        wc.SpatialTrial(trace, through_hall, front_end="hall", front_end_settings={"gap_m": 3e-3})


def on_a_sphere(count: int, radius_m: float) -> dict[str, np.ndarray]:
    """Contacts of two touches on a cap of a sphere about the origin."""
    polar = np.sqrt((np.arange(count) + 0.5) / count)
    azimuth = 2.4 * np.arange(count)
    normals = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    return {
        "points": radius_m * normals,
        "normals": normals,
        "covariance_m2": 5e-6**2 * np.einsum("ni,nj->nij", normals, normals),
        "normal_sd_rad": np.full(count, 5e-3),
        "touch": np.arange(count) % 2,
    }


def test_verif_a_surface_is_found_from_points_and_normals():
    contacts = on_a_sphere(60, 0.02)
    surface = wc.SpatialSurface.fit(**contacts)
    away = np.array([[0.004, 0.003, 0.0205], [-0.008, 0.002, 0.018]])
    points, normals, sd_m = surface.project(away)
    assert np.abs(np.linalg.norm(points, axis=1) - 0.02).max() < 20e-6
    assert np.allclose(normals, points / 0.02, atol=0.01)
    assert np.all((sd_m > 0.0) & (sd_m < 200e-6))
    value_m, sd_m = surface.level(np.vstack([points, 1.02 * points]))
    assert np.abs(value_m[:2]).max() < 1e-9
    assert np.allclose(value_m[2:], 0.0004, atol=2e-5)
    assert sd_m.shape == (4,)
    assert np.isnan(wc.SpatialSurface(0.02).project(away)[0]).all()
    online = wc.SpatialSurface(surface.length_m)
    online.add(**contacts)
    assert (len(online), len(surface)) == (60, 60)
    assert np.allclose(online.project(away)[0], points, atol=1e-9)
    assert online.log_evidence == pytest.approx(surface.log_evidence)


def test_verif_a_surface_is_fitted_to_the_points_of_a_replay(trial):
    replay = trial.replay("recommended")
    known = np.flatnonzero(replay.calibrated & (replay.sd_m < 1e-3))
    # The standard deviation along the normal is the same in either frame.
    of_frames = [(replay.normal, replay.covariance_m2), (replay.normal_world, replay.covariance_world_m2)]
    in_base, in_world = (
        np.einsum("ni,nij,nj->n", normal[known], covariance[known], normal[known]) for normal, covariance in of_frames
    )
    assert np.allclose(in_base, in_world, rtol=1e-6)
    normals = replay.normal_world[known]
    surface = wc.SpatialSurface.fit(
        replay.surface_world[known],
        normals,
        replay.covariance_world_m2[known],
        np.sqrt(0.5 * np.trace(replay.normal_covariance[known], axis1=1, axis2=2)),
        np.zeros(len(known), dtype=int),
    )
    points, found, _ = surface.project(replay.surface_world[known])
    assert np.linalg.norm(points - replay.surface_world[known], axis=1).max() < 1e-3
    assert np.all(np.sum(found * normals, axis=1) > 0.9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"normals": np.zeros((4, 3))}, r"normals\[0\]: found length 0, expected a unit vector"),
        ({"covariance_m2": np.zeros((4, 3))}, r"covariance_m2: found an array of shape \[4, 3\], expected shape \[n, 3, 3\]"),
        ({"covariance_m2": -np.stack([np.eye(3)] * 4)}, r"covariance_m2\[0\]: found .*, expected a symmetric matrix"),
        ({"normal_sd_rad": np.array([1e-6, -1e-6, 0.0, 0.0])}, r"normal_sd_rad\[1\]: found -0.000001, expected zero or more"),
        ({"touch": np.zeros(3, dtype=int)}, "touch: found 3 rows, expected 4"),
        ({"points": np.zeros((4, 2))}, r"points: found an array of shape \[4, 2\]"),
    ],
)
def test_robust_invalid_points_of_a_surface_are_refused(change, words):
    with pytest.raises(ValueError, match=words):
        wc.SpatialSurface.fit(**{**on_a_sphere(4, 0.02), **change})
    with pytest.raises(ValueError, match=words):
        wc.SpatialSurface(0.02).add(**{**on_a_sphere(4, 0.02), **change})


def test_robust_a_length_scale_outside_its_range_is_refused():
    for length_m in (0.0, -0.01, 1e3, np.nan):
        with pytest.raises(ValueError, match="length_m: found"):
            wc.SpatialSurface(length_m)
