"""Calibrations: fit, prediction, files and their errors."""

import json

import numpy as np
import pytest

import whisker_contact as wc

from conftest import PIN_RADIUS_M, calibration_lines, same_bits


def test_val_predictions_follow_the_elastica(whisker, calibration):
    contacts = np.concatenate([points for points, _ in calibration_lines(whisker, -1.0, lines=7)])
    predicted = calibration.predict(contacts, "left")
    exact = wc.deflect(whisker, contacts)
    inside = predicted.calibrated
    assert inside.mean() > 0.8
    error = np.abs(predicted.reading_n_m - exact.moment_n_m)[inside]
    assert error.max() < 0.01 * calibration.largest_reading_n_m
    assert (predicted.model_sd_n_m[inside] > 0).all()


def test_verif_gradients_are_central_differences(whisker, calibration):
    contacts = calibration_lines(whisker, 1.0)[7][0][4:20]
    stated = calibration.predict(contacts, "right").gradient_n
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 1e-6
        ahead, behind = (calibration.predict(contacts + sign * step, "right").reading_n_m for sign in (1, -1))
        assert np.allclose((ahead - behind) / 2e-6, stated[:, axis], rtol=1e-4, atol=1e-8)


def test_verif_outside_the_domain_there_is_no_prediction(calibration):
    predicted = calibration.predict([[0.055, -0.001], [0.01, 0.0], [0.055, 0.02]], "left")
    assert predicted.calibrated.tolist() == [True, False, False]
    assert np.isnan(predicted.reading_n_m).tolist() == [False, True, True]
    assert np.isnan(predicted.gradient_n[1:]).all()


def test_verif_a_written_calibration_predicts_the_same_bits(tmp_path, whisker, calibration):
    path = tmp_path / "straight.json"
    calibration.write(path)
    read = wc.load_calibration(path)
    assert read.whisker == whisker
    assert read.faces == calibration.faces == ["left", "right"]
    assert read.models("left") == calibration.models("left")
    contacts = calibration_lines(whisker, -1.0)[3][0]
    assert same_bits(read.predict(contacts, "left").reading_n_m, calibration.predict(contacts, "left").reading_n_m)


def test_verif_the_best_of_several_models_is_chosen(whisker):
    lines = {"left": calibration_lines(whisker, -1.0, lines=8)}
    fitted = wc.fit_calibration(whisker, lines, PIN_RADIUS_M, models=["polynomial", "elastica"])
    assert fitted.models("left")[0] == "elastica"
    assert len(fitted.models("left")) > 1


COEFFICIENTS = [-3e7, 0.0, -1.2e15]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, calibration):
    """A calibration with the sensor of recordings, as `whisker fit` writes it."""
    path = tmp_path_factory.mktemp("recorded") / "lab.json"
    calibration.write(path)
    stored = json.loads(path.read_text())
    characteristic = {"coefficients": COEFFICIENTS, "range_n_m": [-6e-5, 0.0]}
    sensor = {"name": "lab", "array": "lab", "common_mode": [0.0, 0.0], "characteristic": characteristic, "cross_talk": []}
    stored["sensor"] = {**sensor, "noise_sd_n_m": 1e-7, "offset_sd_n_m": 0.0, "gain_sd": 0.0}
    path.write_text(json.dumps(stored))
    return wc.load_calibration(path)


def test_verif_the_sensor_inverts_its_polynomial(recorded):
    assert recorded.sensors == ["lab.lab"]
    sensor = recorded.sensor()
    assert (sensor.name, sensor.noise_sd_n_m, sensor.range_n_m) == ("lab.lab", 1e-7, (-6e-5, 0.0))
    assert sensor.coefficients.tolist() == COEFFICIENTS
    moments_n_m = np.linspace(-6e-5, 0.0, 12)
    counts = sum(of * moments_n_m**power for power, of in enumerate(COEFFICIENTS, start=1))
    assert np.allclose(sensor.moment_n_m(counts), moments_n_m, rtol=0, atol=1e-15)
    one = sensor.moment_n_m(counts[3])
    assert isinstance(one, float)
    assert one == sensor.moment_n_m(counts)[3]
    assert same_bits(sensor.moment_n_m(counts.reshape(3, 4)), sensor.moment_n_m(counts).reshape(3, 4))
    assert sensor.moment_n_m([]).shape == (0,)
    # Beyond the calibrated range the slope is that at its end.
    slope = -3e7 - 3 * 1.2e15 * 6e-5**2
    assert sensor.moment_n_m(counts[0] - slope * 1e-5) == pytest.approx(-7e-5, rel=1e-9)


def test_verif_an_estimator_takes_converted_counts(recorded, simulated):
    sensor = recorded.sensor("lab.lab")
    known = simulated.recording
    counts = 512.0 + sum(of * known["moment_z_n_m"] ** power for power, of in enumerate(COEFFICIENTS, start=1))
    base = np.column_stack([known[name] for name in ("base_x_m", "base_y_m", "base_yaw_rad")])
    estimator = wc.Estimator("ekf", recorded, sensor.noise_sd_n_m, simulated.rate_hz)
    of_counts = estimator.replay(known["t_s"], base, sensor.moment_n_m(counts - 512.0))
    of_moments = estimator.replay(known["t_s"], base, known["moment_z_n_m"])
    assert np.isfinite(of_counts.contact[-1]).all()
    assert np.allclose(of_counts.contact, of_moments.contact, rtol=0, atol=1e-8, equal_nan=True)


def test_robust_a_missing_sensor_and_wrong_counts_are_refused(calibration, recorded):
    assert calibration.sensors == []
    with pytest.raises(ValueError, match="calibration: sensor: found none, expected one, by which counts are converted"):
        calibration.sensor()
    with pytest.raises(ValueError, match=r"lab\.json: sensor: found lab\.lab, expected `a\.s` among them"):
        recorded.sensor("a.s")
    with pytest.raises(ValueError, match=r"counts\[1\]: found NaN, expected finite numbers"):
        recorded.sensor().moment_n_m([0.0, np.nan])
    with pytest.raises(TypeError, match="expected one of real numbers"):
        recorded.sensor().moment_n_m("many")


def test_robust_errors_are_those_of_the_command(tmp_path, calibration):
    with pytest.raises(FileNotFoundError, match=r"absent\.json"):
        wc.load_calibration(tmp_path / "absent.json")
    path = tmp_path / "straight.json"
    calibration.write(path)
    stored = json.loads(path.read_text())
    path.write_text(json.dumps({**stored, "colour": "blue"}))
    with pytest.raises(ValueError, match=r"straight.json:1:\d+: unknown field `colour`"):
        wc.load_calibration(path)
    stored["faces"][0]["pin_radius_m"] = 1.0
    path.write_text(json.dumps(stored))
    with pytest.raises(ValueError, match=r"straight\.json: faces_sha256: found"):
        wc.load_calibration(path)
    with pytest.raises(ValueError, match="face: found `top`, expected `left` or `right`"):
        calibration.predict([[0.05, 0.0]], "top")
    with pytest.raises(ValueError, match="poly9"):
        calibration.predict([[0.05, 0.0]], "left", model="poly9")


@pytest.mark.parametrize(
    ("face", "sign", "factor"), [("left", "negative", -1.0), ("right", "positive", -1.0), ("left", "negative", 0.0)]
)
def test_robust_readings_of_no_sign_or_the_wrong_one_are_refused(whisker, face, sign, factor):
    lines = calibration_lines(whisker, -1.0 if face == "left" else 1.0, lines=8)
    lines[3] = (lines[3][0], factor * lines[3][1])
    with pytest.raises(ValueError, match=rf"readings of lines\[`{face}`\]\[3\]: found .*, expected {sign} readings"):
        wc.fit_calibration(whisker, {face: lines}, PIN_RADIUS_M, models=["polynomial"])


def test_robust_contacts_on_the_wrong_side_are_refused(whisker):
    lines = calibration_lines(whisker, -1.0, lines=8)
    lines[5] = (lines[5][0] * [1.0, -1.0], lines[5][1])
    with pytest.raises(ValueError, match=r"readings of lines\[`left`\]\[5\]: found .*, expected about"):
        wc.fit_calibration(whisker, {"left": lines}, PIN_RADIUS_M, models=["polynomial"])
    with pytest.raises(ValueError, match="models: found none"):
        wc.fit_calibration(whisker, {"left": lines[:5]}, PIN_RADIUS_M, models=[])


def test_robust_data_that_determine_no_model_are_refused(whisker):
    lines = {"left": [([[0.05, -0.001]], [-1e-5])]}
    with pytest.raises(ValueError, match=r"lines\[`left`\]: found data to which no model can be fitted, expected other data: "):
        wc.fit_calibration(whisker, lines, PIN_RADIUS_M)
    with pytest.raises(ValueError, match="unknown sensor model `magic`, expected one of: polynomial"):
        wc.fit_calibration(whisker, lines, PIN_RADIUS_M, models=["magic"])
    with pytest.raises(ValueError, match="readings of lines"):
        wc.fit_calibration(whisker, {"left": [([[0.05, -0.001]], [-1e-5, 0.0])]}, PIN_RADIUS_M)
