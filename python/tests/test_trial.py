"""Trials: noise, truth, scores, bound, own estimators, outlines and maps."""

import hashlib
import json
from dataclasses import dataclass

import numpy as np
import pytest

import whisker_contact as wc

from conftest import GOLDEN, same_bits, sweep_base


@dataclass
class Answer:
    contact: np.ndarray
    covariance_m2: np.ndarray | None = None


class Resting:
    """Contact at rest in the world at the centre of the pin, moved by the motion of the base."""

    def __init__(self, contact, covariance_m2=None):
        self.contact, self.covariance_m2 = np.array(contact), covariance_m2

    def step(self, motion, dt_s, reading_n_m):
        x_m, y_m, yaw_rad = motion
        sin, cos = np.sin(yaw_rad), np.cos(yaw_rad)
        self.contact = np.array([[cos, -sin], [sin, cos]]) @ self.contact + [x_m, y_m]
        return Answer(self.contact, self.covariance_m2)


def test_verif_a_golden_trace_has_recording_truth_and_outline():
    trace = wc.Trace.read(GOLDEN / "golden_pin.csv")
    assert (trace.rate_hz, len(trace), trace.role) == (250.0, 301, "trial")
    recording, truth = trace.recording, trace.truth
    assert recording["t_s"][-1] == pytest.approx(1.2)
    touching = truth["touching"] == 1
    assert np.isnan(truth["contact_x_m"][~touching]).all()
    distance_m = np.hypot(truth["contact_x_m"] - truth["surface_x_m"], truth["contact_y_m"] - truth["surface_y_m"])
    assert np.allclose(distance_m[touching], 0.125e-3, atol=2e-5)
    assert trace.sidecar["name"] == trace.name == "golden_pin"
    with pytest.raises(ValueError, match="read-only"):
        recording["t_s"][0] = 1.0


def test_robust_a_damaged_trace_is_refused_with_line_and_column(tmp_path):
    for file in GOLDEN.glob("golden_pin*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    table = tmp_path / "golden_pin.csv"
    lines = table.read_text().splitlines()
    lines[4] = lines[4].replace("0.012", "x", 1)
    table.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"golden_pin.csv(:5: column t_s: found|: csv_sha256)"):
        wc.Trace.read(table)
    with pytest.raises(FileNotFoundError, match="absent"):
        wc.Trace.read(tmp_path / "absent.csv")


@pytest.mark.parametrize("name", ["absent", "absent.json", "absent.csv"])
def test_robust_an_absent_dataset_is_an_error_of_the_operating_system(tmp_path, name):
    with pytest.raises(FileNotFoundError, match=rf"{name}: no such file or folder, expected a suite \(\.json\) or a folder"):
        wc.Dataset(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=rf"{name}: no such file or folder"):
        wc.Dataset(str(tmp_path / name))


def test_verif_a_simulated_sweep_is_consistent_with_the_elastica(whisker, simulated):
    truth = simulated.truth
    touching = truth["touching"] == 1
    assert 0.8 < touching.mean() < 1.0
    base = sweep_base(simulated.recording["t_s"])[touching]
    at = np.column_stack([truth["contact_x_m"], truth["contact_y_m"]])[touching] - base[:, :2]
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    seen = np.column_stack([cos * at[:, 0] + sin * at[:, 1], cos * at[:, 1] - sin * at[:, 0]])
    found = wc.deflect(whisker, seen, strict=True)
    assert np.allclose(found.moment_n_m, simulated.recording["moment_z_n_m"][touching], rtol=1e-9, atol=1e-15)
    assert np.allclose(found.arc_m, truth["arc_m"][touching])
    center = np.column_stack([truth["surface_x_m"], truth["surface_y_m"]])[touching] - [0.055, 0.0]
    assert np.allclose(np.hypot(*center.T), 0.5e-3)


def test_robust_a_sweep_without_an_equilibrium_names_the_row(whisker):
    t_s = np.arange(0.0, 2.0, 0.004)
    base = np.column_stack([np.zeros_like(t_s), 0.05 * t_s, np.zeros_like(t_s)])
    with pytest.raises(ValueError, match=r"base\[\d+\]: the whisker (slips off|buckles)"):
        wc.simulate(whisker, wc.Shape.pin([0.055, 0.002]), t_s, base, "left")
    with pytest.raises(ValueError, match="rate_hz: found"):
        wc.simulate(whisker, wc.Shape.pin([0.055, 0.002]), 1e-7 * t_s / t_s[1], base, "left")
    with pytest.raises(ValueError, match=r"t_s\[1\]: found a step of"):
        wc.simulate(whisker, wc.Shape.pin([0.055, 0.002]), [0.0, 0.1, 0.5], base[:3], "left")


def test_robust_an_object_on_the_other_side_or_ahead_of_the_tip_is_refused(whisker):
    t_s = np.arange(7) * 0.01
    base = np.column_stack([np.zeros(7), np.linspace(0.0, 6e-3, 7), np.zeros(7)])
    circle = wc.Shape.circle([0.05, 0.015], 0.012)
    assert wc.simulate(whisker, circle, t_s, base, "left").truth["touching"].sum() > 2
    with pytest.raises(
        ValueError, match=r"base\[\d\]: found the object .* mm from the undeflected whisker, expected it to meet .* right"
    ):
        wc.simulate(whisker, circle, t_s, base, "right")
    ahead = np.column_stack([np.linspace(0.0, 12e-3, 7), np.zeros(7), np.zeros(7)])
    with pytest.raises(ValueError, match=r"found the undeflected whisker in the object by .* mm and no contact on its left side"):
        wc.simulate(whisker, wc.Shape.circle([0.1, 0.0], 0.015), t_s, ahead, "left")


def test_verif_noise_is_seeded_and_of_the_stated_size(simulated, calibration, trial):
    again = wc.Trial(simulated, calibration, noise=0.01, seed=1)
    assert same_bits(again.readings_n_m, trial.readings_n_m)
    other = wc.Trial(simulated, calibration, seed=2)
    noise_n_m = other.readings_n_m - simulated.recording["moment_z_n_m"]
    assert noise_n_m.std() == pytest.approx(other.noise_sd_n_m, rel=0.1)
    assert other.noise_sd_n_m == 0.01 * np.abs(simulated.recording["moment_z_n_m"]).max()
    exact = wc.Trial(simulated, calibration, noise_sd_n_m=0.0)
    assert same_bits(exact.readings_n_m, simulated.recording["moment_z_n_m"].copy())
    with pytest.raises(ValueError, match="noise and noise_sd_n_m: found both"):
        wc.Trial(simulated, calibration, noise=0.1, noise_sd_n_m=0.0)
    t_s = np.arange(0.0, 0.1, 0.004)
    curved = wc.simulate(wc.Whisker.curved(), wc.Shape.pin([0.5, 0.5]), t_s, sweep_base(t_s), "left")
    with pytest.raises(ValueError, match=r"whisker\.name: found .*, expected "):
        wc.Trial(curved, calibration)


def test_val_the_bound_is_below_the_error_and_near_it_on_a_pin(trial):
    replay = trial.replay("recommended")
    steady = trial.bound["since_touch_s"] > 1.0
    error_m = np.sqrt(np.mean(trial.errors_m(replay)[steady] ** 2))
    bound_m = np.sqrt(np.mean(trial.bound["bound_m"][steady] ** 2))
    assert 0.3 * bound_m < error_m < 3.0 * bound_m
    direct = wc.cramer_rao_bound(trial.trace, trial.calibration, trial.noise_sd_n_m)
    assert same_bits(direct["bound_m"], trial.bound["bound_m"])
    with_base = wc.cramer_rao_bound(trial.trace, trial.calibration, trial.noise_sd_n_m, np.diag([1e-10, 1e-10, 1e-8]))
    assert (with_base["bound_m"][steady] > direct["bound_m"][steady]).all()
    with pytest.raises(ValueError, match="without noise the bound is 0"):
        wc.cramer_rao_bound(trial.trace, trial.calibration, 0.0)


def test_verif_scores_are_those_of_the_errors(trial):
    replay = trial.replay("ekf")
    scores = trial.score(replay)
    assert list(scores) == [metric["name"] for metric in wc.metrics()]
    truth = trial.trace.truth
    touch = int(np.flatnonzero(~np.isnan(truth["contact_x_m"]))[0])
    t_contact_s = trial.trace.recording["t_s"] - trial.trace.recording["t_s"][touch]
    steady = ~np.isnan(truth["contact_x_m"]) & (t_contact_s >= 2.0)
    assert scores["rmse_m"] == pytest.approx(np.sqrt(np.mean(trial.errors_m(replay)[steady] ** 2)))


def test_verif_an_own_estimator_is_judged_like_a_registered_one(trial):
    class Wrapped:
        def __init__(self, of):
            self.inner = wc.Estimator("ekf", of.calibration, of.noise_sd_n_m, of.rate_hz)

        def step(self, motion, dt_s, reading_n_m):
            return self.inner.step(motion, dt_s, reading_n_m)

    one, other = trial.replay("ekf"), trial.run(Wrapped(trial))
    assert np.allclose(one.contact, other.contact, rtol=0, atol=1e-9, equal_nan=True)
    assert trial.score(other)["rmse_m"] == pytest.approx(trial.score(one)["rmse_m"])

    start = -sweep_base(np.zeros(1))[0, :2] + [0.055, 0.0]
    pinned = trial.run(Resting(start, 1e-6 * np.eye(2)))
    # The contact lies within pin and wire radius of the pin's centre.
    assert trial.score(pinned)["rmse_m"] < 0.7e-3
    assert trial.score(pinned)["coverage_95"] == 1.0
    assert trial.replay("ekf").table.dtype == pinned.table.dtype


def test_robust_a_replay_of_another_trial_is_refused(whisker, simulated, calibration, trial):
    t_s = simulated.recording["t_s"].copy()
    base = sweep_base(t_s)
    other_object = wc.simulate(whisker, wc.Shape.circle([0.055, 0.01], 0.01), t_s, base, "left")
    other_base = wc.simulate(whisker, wc.Shape.pin([0.056, 0.0]), t_s, base + np.array([0.001, 0.0, 0.0]), "left")
    own = wc.Estimator("ekf", calibration, trial.noise_sd_n_m, trial.rate_hz)
    for replay, found in [
        (wc.Trial(other_object, calibration, noise=0.01, seed=1).replay("ekf"), "reading"),
        (wc.Trial(simulated, calibration, noise=0.01, seed=2).replay("ekf"), "reading"),
        (wc.Trial(other_base, calibration, noise=0.01, seed=1).replay("ekf"), "base x"),
        (own.replay(t_s + 0.1, base, trial.readings_n_m), "time"),
        (own.replay(t_s, base + np.array([0.0, 0.0, 0.01]), trial.readings_n_m), "base yaw"),
        (own.replay(t_s[:10], base[:10], trial.readings_n_m[:10]), "10 rows"),
    ]:
        for use in (trial.score, trial.errors_m, trial.outline, lambda replay: wc.scene_map([(trial, replay)])):
            with pytest.raises(ValueError, match=rf"replay: .*{found}.*, expected"):
                use(replay)
    assert trial.score(own.replay(t_s, base, trial.readings_n_m))["rmse_m"] > 0.0


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (3.0, "estimate of row 0: estimate: found 3.0, expected None or an object"),
        (Answer(np.zeros(3)), "estimate of row 0: contact: found 3 numbers"),
        (Answer(np.array([np.nan, 0.0])), r"estimate of row 0: contact\[0\]: found NaN"),
        (Answer(np.array([2e3, 0.0])), "estimate of row 0: contact: found .* within 1000 m"),
        (Answer(np.zeros(2), np.diag([1.0, -1.0])), "covariance_m2: found .*, expected a positive definite matrix"),
    ],
)
def test_robust_answers_of_an_own_estimator_are_checked(trial, answer, message):
    class Own:
        def step(self, *_):
            return answer

    with pytest.raises(ValueError, match=message):
        trial.run(Own())


def test_robust_an_error_of_an_own_estimator_is_raised_unchanged(trial):
    class Own:
        def step(self, *_):
            raise ZeroDivisionError("own")

    with pytest.raises(ZeroDivisionError, match="own"):
        trial.run(Own())
    with pytest.raises(AttributeError, match="step"):
        trial.run(object())


def test_verif_evaluate_has_a_row_for_each_trace_seed_and_estimator(simulated, calibration):
    chosen = {
        "ekf": "ekf",
        "wrapped": lambda trial: wc.Estimator("ekf", trial.calibration, trial.noise_sd_n_m, trial.rate_hz),
    }
    table = wc.evaluate([simulated], calibration, chosen, seeds=2)
    assert table["estimator"].tolist() == ["ekf", "wrapped"] * 2
    assert table["seed"].tolist() == [1, 1, 2, 2]
    assert np.allclose(table["rmse_m"][::2], table["rmse_m"][1::2], rtol=1e-6)
    assert same_bits(wc.evaluate([simulated], {"straight": calibration}, chosen, seeds=2, threads=4)["rmse_m"], table["rmse_m"])
    with pytest.raises(ValueError, match="expected `straight` among them"):
        wc.evaluate([simulated], {}, ["ekf"])
    with pytest.raises(ValueError, match="found 0 traces"):
        wc.evaluate([], calibration, ["ekf"])
    with pytest.raises(ValueError, match="seeds: found none"):
        wc.evaluate([simulated], calibration, ["ekf"], seeds=0)
    with pytest.raises(TypeError, match="estimators: found the text `ekf`, expected names in a list, or a dictionary"):
        wc.evaluate([simulated], calibration, "ekf")
    with pytest.raises(ValueError, match="threads: found 0, expected at least 1"):
        wc.evaluate([simulated], calibration, ["ekf"], threads=0)
    assert wc.evaluate([simulated], calibration, ["ekf"], seeds=np.int64(1))["seed"].tolist() == [1]


def test_robust_an_error_of_an_estimator_names_its_trial(simulated, calibration):
    class Wrong:
        def step(self, *_):
            return 3.0

    with pytest.raises(ValueError, match="found") as raised:
        wc.evaluate([simulated], calibration, {"wrong": lambda trial: Wrong()}, seeds=[7])
    assert raised.value.__notes__ == [f"estimator `wrong`, trace {simulated.name}, seed 7"]


def stated(folder, replay):
    """The golden sweep over a pin, whose sidecar states `replay`."""
    folder.mkdir()
    for file in GOLDEN.glob("golden_pin*"):
        (folder / file.name).write_bytes(file.read_bytes())
    sidecar = folder / "golden_pin.json"
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | {"replay": replay}))
    return wc.Trace.read(folder / "golden_pin.csv")


def test_verif_evaluate_adds_the_noise_that_all_traces_state(tmp_path, calibration):
    trace, plain = stated(tmp_path / "stated", {"noise": 0.03}), wc.Trace.read(GOLDEN / "golden_pin.csv")

    def rmse_m(traces, **options):
        return wc.evaluate(traces, calibration, ["ekf"], seeds=2, **options)["start_rmse_m"]

    assert same_bits(rmse_m([trace]), rmse_m([plain], noise=0.03))
    assert same_bits(rmse_m([trace], noise=0.02), rmse_m([plain], noise=0.02))
    assert same_bits(rmse_m([trace, plain])[:2], rmse_m([plain], noise=0.01))
    assert not same_bits(rmse_m([trace]), rmse_m([plain]))


@pytest.mark.parametrize("noise", [None, 0.01])
def test_robust_evaluate_refuses_traces_that_state_a_miscalibration(tmp_path, calibration, noise):
    none = stated(tmp_path / "none", {"noise": 0.01, "miscalibration": {"gain": 0.0}})
    assert len(wc.evaluate([none], calibration, ["ekf"], noise)) == 1
    trace = stated(tmp_path / "stated", {"noise": 0.01, "miscalibration": {"gain": 0.02, "mount_rad": 0.001}})
    expected = r"traces: golden_pin: found a stated miscalibration \(gain, mount_rad\), expected none"
    with pytest.raises(ValueError, match=expected):
        wc.evaluate([trace], calibration, ["ekf"], noise)


@pytest.mark.parametrize(
    ("traces", "found"),
    [
        ("datasets/smoke", "the path `datasets/smoke`"),
        (GOLDEN, "the path"),
        ([str(GOLDEN / "golden_pin.csv")], "the path `.*golden_pin.csv` among them"),
        ([3], "int among them"),
    ],
)
def test_robust_evaluate_refuses_what_is_no_trace(calibration, traces, found):
    with pytest.raises(TypeError, match=f"traces: found {found}.*, expected traces"):
        wc.evaluate(traces, calibration, ["ekf"])


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_robust_evaluate_refuses_seeds_out_of_range(simulated, calibration, seed):
    with pytest.raises(ValueError, match=f"seeds: found {seed}, expected 0 to"):
        wc.evaluate([simulated], calibration, ["ekf"], seeds=[1, seed])


def test_robust_a_glitch_does_not_scale_the_noise(tmp_path, calibration):
    for file in GOLDEN.glob("golden_pin*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    table, sidecar = tmp_path / "golden_pin.csv", tmp_path / "golden_pin.json"
    lines = table.read_text().splitlines()
    column = lines[0].split(",").index("moment_z_n_m")
    cells = lines[200].split(",")
    cells[column] = "1.0"
    lines[200] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    head = json.loads(sidecar.read_text())
    sidecar.write_text(json.dumps(head | {"csv_sha256": hashlib.sha256(table.read_bytes()).hexdigest()}))
    assert calibration.gate_n_m == pytest.approx(10.0 * calibration.largest_reading_n_m)
    traces = [wc.Trace.read(path) for path in (GOLDEN / "golden_pin.csv", table)]
    clean, with_glitch = (wc.evaluate([trace], calibration, ["ukf"])["start_rmse_m"][0] for trace in traces)
    assert with_glitch == pytest.approx(clean, rel=0.2)


def test_val_the_outline_of_a_circle_is_found_and_mapped(whisker, calibration):
    t_s = np.arange(0.0, 4.0, 0.004)
    trace = wc.simulate(whisker, wc.Shape.circle([0.055, 0.01], 0.01), t_s, sweep_base(t_s), "left")
    trial = wc.Trial(trace, calibration)
    replay = trial.replay("recommended")
    outline = trial.outline(replay)
    assert outline.frame == "World"
    distance_m = np.abs(np.hypot(*(outline.points - [0.055, 0.01]).T) - 0.01)
    assert distance_m.mean() < 0.2e-3
    assert (outline.sd_m > 0).all()
    scene = wc.scene_map([(trial, replay)])
    [found] = scene.objects
    assert set(found.whiskers.tolist()) == {0}
    assert np.abs(np.hypot(*(found.points - [0.055, 0.01]).T) - 0.01).mean() < 0.3e-3
    grid = scene.grid
    assert grid["touched"].sum() > 0
    assert grid["swept"].sum() > grid["touched"].sum()
    assert ((grid["occupied"] >= 0) & (grid["occupied"] <= 1)).all()
    with pytest.raises(ValueError, match="replays: found none"):
        wc.scene_map([])
    with pytest.raises(ValueError, match="cell_m: found 1, expected"):
        wc.scene_map([(trial, replay)], cell_m=1.0)
