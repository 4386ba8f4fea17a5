"""Estimators: steps, replays, threads, interruption and refused input."""

import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import whisker_contact as wc

from conftest import same_bits, sweep_base

NAMES = [row["name"] for row in wc.estimators()]


def estimator(name: str, trial: wc.Trial, **options) -> wc.Estimator:
    return wc.Estimator(name, trial.calibration, trial.noise_sd_n_m, trial.rate_hz, **options)


def base(trial: wc.Trial) -> np.ndarray:
    recording = trial.trace.recording
    return np.column_stack([recording["base_x_m"], recording["base_y_m"], recording["base_yaw_rad"]])


def contacts(estimates: list) -> np.ndarray:
    return np.array([[np.nan, np.nan] if estimate is None else estimate.contact for estimate in estimates])


@pytest.mark.parametrize("name", NAMES)
def test_verif_every_estimator_replays_as_it_steps(name, trial):
    replay = estimator(name, trial).replay(trial.trace.recording["t_s"], base(trial), trial.readings_n_m)
    assert replay.touching.sum() > 500
    row = next(row for row in wc.estimators() if row["name"] == name)
    if row["class"] == "hindsight":
        return
    stepped = estimator(name, trial)
    estimates = [stepped.step(*sample) for sample in zip(trial.motions, trial.dt_s, trial.readings_n_m, strict=True)]
    # The yaw of a pose from numbers is that of its angle, not of the product of rotations: the last bits differ.
    assert np.allclose(contacts(estimates), replay.contact, rtol=0, atol=1e-9, equal_nan=True)
    updated = estimator(name, trial)
    poses = zip(trial.trace.recording["t_s"], base(trial), trial.readings_n_m, strict=True)
    assert same_bits(contacts([updated.update(*sample) for sample in poses]), replay.contact)


@pytest.mark.parametrize("name", ["recommended", "paper-ekf", "particle"])
def test_verif_threads_give_the_same_bits(name, trial):
    expected = trial.replay(name)
    with ThreadPoolExecutor(4) as pool:
        for replay in pool.map(lambda _: trial.replay(name), range(8)):
            assert same_bits(replay.contact, expected.contact)
            assert same_bits(replay.covariance_m2, expected.covariance_m2)


def test_val_the_recommended_estimator_finds_a_pin(trial):
    replay = trial.replay("recommended")
    last = replay[-1]
    true = trial.trace.truth[["contact_x_m", "contact_y_m"]][-1]
    assert last.face == "left"
    assert last.calibrated
    assert not last.at_tip
    assert np.hypot(*(replay.contact_world[-1] - np.array(true.tolist()))) < 0.2e-3
    # The covariance allows for errors of the calibration, of the readings and of the poses.
    assert np.sqrt(np.trace(last.covariance_m2)) < 0.6e-3
    assert sum(last.models.values()) == pytest.approx(1.0)
    assert np.hypot(*(last.surface - last.contact)) == pytest.approx(0.125e-3)
    # Within a block of samples there is no innovation. The noise of a mean is smaller than that of a sample.
    variances_n2_m2 = [found.innovation_variance_n2_m2 for found in replay if found and found.innovation_variance_n2_m2]
    assert 8 * variances_n2_m2[-1] > trial.noise_sd_n_m**2


def test_verif_columns_and_rows_of_a_replay_agree(trial):
    replay = trial.replay("sliding")
    row = int(np.flatnonzero(replay.touching)[-1])
    one = replay[row]
    assert (replay.contact[row] == one.contact).all()
    assert (replay.covariance_m2[row] == one.covariance_m2).all()
    assert replay.radius_m[row] == one.radius_m
    assert replay.radius_sd_m[row] == one.radius_sd_m
    assert replay[0] is None
    assert np.isnan(replay.contact[0]).all()
    assert len(replay) == len(trial) == len(trial.trace)
    with pytest.raises(IndexError, match="row 1000 of 1000"):
        replay[1000]


def test_verif_velocity_and_deviation_are_those_of_the_table(trial):
    replay = trial.replay("installed")
    last, row = replay[-1], replay.table[-1]
    assert last.velocity_m_s is None
    assert last.velocity_covariance_m2_s2 is None
    assert list(last.deviation) == ["gain", "mount_rad", "mount_x_m", "mount_y_m"]
    assert last.deviation["gain"] == (row["gain"], row["gain_sd"])
    assert last.deviation["mount_rad"] == (row["mount_rad"], row["mount_sd_rad"])
    assert last.deviation["mount_y_m"] == (row["mount_y_m"], row["mount_y_sd_m"])
    replay = trial.replay("drifting")
    last, row = replay[-1], replay.table[-1]
    assert last.deviation is None
    assert np.isnan(row["gain"])
    # Base has turned against World.
    speeds_m_s = np.hypot(*last.velocity_m_s), np.hypot(row["object_vx_m_s"], row["object_vy_m_s"])
    assert np.isclose(*speeds_m_s, rtol=1e-12, atol=0)
    variance = row["object_vx_sd_m_s"] ** 2 + row["object_vy_sd_m_s"] ** 2
    assert np.isclose(np.trace(last.velocity_covariance_m2_s2), variance, rtol=1e-12, atol=0)


def test_verif_the_outline_so_far_is_in_start(whisker, calibration):
    t_s = np.arange(0.0, 2.0, 0.004)
    shape = wc.Shape.circle([0.055, 0.01], 0.01)
    trace = wc.simulate(whisker, shape, t_s, sweep_base(t_s), "left")
    trial = wc.Trial(trace, calibration)
    running = estimator("outline", trial)
    assert running.outline() is None
    for sample in zip(t_s, base(trial), trial.readings_n_m, strict=True):
        running.update(*sample)
    outline = running.outline()
    assert running.touching
    assert outline.frame == "Start"
    assert outline.points.shape == outline.normals.shape == (len(outline), 2)
    assert np.allclose(np.hypot(*outline.normals.T), 1.0)
    # The base starts unturned at (0, y0).
    center = np.array([0.055, 0.01]) - sweep_base(t_s)[0, :2]
    assert np.abs(np.hypot(*(outline.points - center).T) - 0.01).mean() < 1e-3


def test_verif_reset_forgets_all_samples(trial):
    running = estimator("ekf", trial)
    rows = list(zip(trial.trace.recording["t_s"], base(trial), trial.readings_n_m, strict=True))[:400]
    first = contacts([running.update(*row) for row in rows])
    running.reset()
    assert same_bits(contacts([running.update(*row) for row in rows]), first)


def test_robust_setups_are_refused_in_the_words_of_the_command(trial):
    make = lambda name="ekf", noise=1e-7, rate=250.0, **options: wc.Estimator(  # noqa: E731
        name, trial.calibration, noise, rate, **options
    )
    for options, message in [
        ({"name": "magic"}, "unknown estimator `magic`, expected one of: recommended"),
        ({"settings": {"colour": 1}}, "settings of `ekf`: unknown field `colour`"),
        ({"settings": {"fading": 0.5}}, "settings of `ekf`: `fading`: found 0.5, expected"),
        ({"settings": [1]}, "expected a JSON object"),
        ({"noise": -1.0}, "noise_sd_n_m: found -1, expected a number of 0 or more"),
        ({"rate": 0.0}, "rate_hz: found 0, expected"),
        ({"touch": {"detector": "magic"}}, "touch: unknown variant `magic`"),
        ({"base_noise": np.diag([1.0, 1.0, -1.0])}, "base_noise: found .*, expected a symmetric matrix"),
        ({"contact_prior": [0.05, 0.0, 0.0]}, "contact_prior: found"),
    ]:
        with pytest.raises(ValueError, match=message):
            make(**options)
    with pytest.raises(TypeError, match="settings: "):
        make(settings={"fading": object()})


def test_robust_samples_are_refused_and_change_nothing(trial):
    running, untouched = estimator("ekf", trial), estimator("ekf", trial)
    rows = list(zip(trial.trace.recording["t_s"], base(trial), trial.readings_n_m, strict=True))[:400]
    for row in rows[:300]:
        running.update(*row)
        untouched.update(*row)
    t_s, pose, reading_n_m = rows[300]
    for sample, message in [
        ((t_s, pose, np.nan), "reading_n_m: found NaN"),
        ((t_s, pose[:2], reading_n_m), r"base: found .*, expected three numbers: x \(m\), y \(m\) and yaw \(rad\)"),
        ((t_s, (0.0, np.inf, 0.0), reading_n_m), "base: found .*, expected finite coordinates"),
        ((t_s, (0.0, 1e300, 0.0), reading_n_m), "base: found .*, expected finite coordinates with magnitudes of at most 1000 m"),
        ((rows[299][0], pose, reading_n_m), "t_s: found 1.196, expected more than the last, 1.196"),
    ]:
        with pytest.raises(ValueError, match=message):
            running.update(*sample)
    for row in rows[300:]:
        one, other = running.update(*row), untouched.update(*row)
        assert (one is None) == (other is None)
        assert one is None or (one.contact == other.contact).all()
    stepped = estimator("ekf", trial)
    with pytest.raises(ValueError, match="dt_s: found -1, expected"):
        stepped.step((0.0, 0.0, 0.0), -1.0, 0.0)


def test_robust_samples_by_step_and_by_update_do_not_mix(trial):
    sample, pose = ((0.0, 0.0, 0.0), 0.0, 0.0), (0.0, (0.0, 0.0, 0.0), 0.0)
    running = estimator("ekf", trial)
    running.step(*sample)
    with pytest.raises(ValueError, match="dt_s: found 0, expected a positive number"):
        running.step(*sample)
    with pytest.raises(ValueError, match="update: found samples given by `step` before, expected"):
        running.update(*pose)
    running.reset()
    running.update(*pose)
    with pytest.raises(ValueError, match="step: found samples given by `update` before, expected"):
        running.step(*sample)


def test_robust_replays_of_unequal_arrays_are_refused(trial):
    t_s = trial.trace.recording["t_s"]
    with pytest.raises(ValueError, match="readings_n_m: found 3 rows, expected 1000, as many as `t_s` has"):
        estimator("ekf", trial).replay(t_s, base(trial), [0.0, 0.0, 0.0])
    far = base(trial)
    far[7, 0] = -1e4
    with pytest.raises(ValueError, match=r"base\[7\]: found \[-10000.0, .*\], expected .* of at most 1000 m"):
        estimator("ekf", trial).replay(t_s, far, trial.readings_n_m)
    with pytest.raises(ValueError, match=r"t_s\[1\]: found 0.992"):
        estimator("ekf", trial).replay(t_s[::-1] - 3.0, base(trial), trial.readings_n_m)


@pytest.fixture
def interruptible():
    """The handler of Ctrl-C, which a process in the background of a shell lacks."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_robust_ctrl_c_ends_a_long_call(whisker):
    points = np.repeat([[0.05, -0.004]], 3_000_000, axis=0)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        wc.deflect(whisker, points)
    timer.join()


def test_verif_other_threads_run_during_a_long_call(whisker):
    points = np.repeat([[0.05, -0.004]], 300_000, axis=0)
    with ThreadPoolExecutor(1) as pool:
        call = pool.submit(wc.deflect, whisker, points)
        steps = 0
        while not call.done():
            steps += 1
    # With the interpreter lock held, the loop would be entered at most a few times.
    assert steps > 1000
