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
