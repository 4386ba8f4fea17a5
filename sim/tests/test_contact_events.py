"""Contact events, made and lost on a vibrating base."""

from itertools import pairwise

import numpy as np
import pytest

from whisker_sim.motions.base import REST_S
from whisker_sim.runs import load_runs
from whisker_sim.simulate import simulate
from whisker_sim.vibration import Vibration

from conftest import SCENES

STEP_S = 0.0005


def test_val_vibration_has_the_specified_spectrum():
    """Acceleration with the specified root mean square in the band and none elsewhere, starting from rest."""
    vibration = Vibration(acceleration_m_s2=0.5, low_hz=10.0, high_hz=40.0)
    displacement_m = vibration.displacement_m(20_000, STEP_S, np.random.default_rng(0))
    assert np.array_equal(displacement_m[0], (0.0, 0.0))
    settled = displacement_m[round(REST_S / STEP_S) :]
    acceleration = np.diff(settled, 2, axis=0) / STEP_S**2
    np.testing.assert_allclose(np.sqrt(np.mean(acceleration**2, axis=0)), 0.5, rtol=0.02)
    power = np.abs(np.fft.rfft(acceleration * np.hanning(len(acceleration))[:, None], axis=0)) ** 2
    frequency_hz = np.fft.rfftfreq(len(acceleration), STEP_S)
    outside = (frequency_hz < 9.5) | (frequency_hz > 40.5)
    assert np.max(np.sum(power[outside], axis=0) / np.sum(power, axis=0)) < 1e-3
    assert abs(np.corrcoef(acceleration.T)[0, 1]) < 0.2


@pytest.mark.parametrize(
    ("vibration", "expected"),
    [
        ({"acceleration_m_s2": 0.5, "low_hz": 60.0, "high_hz": 60.0}, "high_hz: expected more than low_hz = 60.0, found 60.0"),
        ({"acceleration_m_s2": 0.5, "high_hz": 600.0}, "expected 5.0 to 600.0 Hz to fit"),
        ({"acceleration_m_s2": 0.0}, "acceleration_m_s2"),
    ],
)
def test_robust_vibration_out_of_range(make_run, vibration, expected):
    with pytest.raises(Exception, match=expected):
        simulate(make_run(vibration=vibration))


def test_verif_vibration_does_not_change_the_motion(make_run):
    motion = {"kind": "lift_offs", "strokes": 2, "arc_min_m": 0.05, "arc_max_m": 0.06}
    calm = make_run(motion=motion).scene.plan()
    shaken = make_run(motion=motion, vibration={"acceleration_m_s2": 0.7}).scene.plan()
    assert calm.touching == shaken.touching
    added_m = np.abs(shaken.poses - calm.poses).max(axis=0)
    assert 1e-4 < added_m[0] < 2e-3
    assert added_m[2] == 0.0


def test_verif_reading_of_the_free_whisker_vibrates_by_three_per_cent():
    """The vibration of the suite causes a background RMS of about 3 % of the largest reading."""
    _, runs = load_runs(SCENES / "suites" / "contact_events.json")
    shaken = []
    for run in runs[::3]:
        simulated = simulate(run)
        reading = simulated.rotations_rad[:, 0]
        undisturbed = (simulated.time_s > REST_S) & (simulated.time_s < run.scene.motion.rest_s)
        shaken.append((np.std(reading[undisturbed]), np.max(np.abs(reading))))
    share = np.sqrt(np.mean(np.square([sd for sd, _ in shaken]))) / max(largest for _, largest in shaken)
    assert share == pytest.approx(0.03, abs=0.01)


def test_verif_strokes_end_in_lift_offs_of_both_kinds(make_run):
    """There are as many contacts as strokes, and every second one reaches the tip."""
    motion = {"kind": "lift_offs", "strokes": 4, "arc_min_m": 0.05, "arc_max_m": 0.06}
    simulated = simulate(make_run(motion=motion, object={"shape": "pin"}))
    lasting = np.flatnonzero(np.convolve(simulated.touching, np.ones(10)) == 0)
    free_between = np.split(lasting, np.flatnonzero(np.diff(lasting) > 1) + 1)
    assert len(free_between) == 5
    contacts = [slice(before[-1], after[0]) for before, after in pairwise(free_between)]
    tips = [bool(np.any(simulated.truth.tip[contact] & simulated.touching[contact])) for contact in contacts]
    assert tips[0] != tips[1]
    assert tips[:2] == tips[2:]
