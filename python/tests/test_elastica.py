"""Batched elastica: derivatives, inverse map and rows without an equilibrium."""

import numpy as np
import pytest

import whisker_contact as wc


def contacts(whisker: wc.Whisker) -> wc.Contacts:
    arc_m = np.linspace(0.03, 0.07, 20)
    return wc.press(whisker, arc_m, -4e-4 * (0.03 / arc_m) ** 2, strict=True)


@pytest.mark.parametrize("preset", [wc.Whisker.straight, wc.Whisker.curved, wc.Whisker.stanford])
def test_verif_deflect_inverts_press(preset):
    whisker = preset()
    arc_m = np.linspace(0.3, 0.9, 20) * whisker.length_m
    pressed = wc.press(whisker, arc_m, np.full(20, -2e-4), strict=True)
    found = wc.deflect(whisker, pressed.point, strict=True)
    assert np.allclose(found.force_n, -2e-4, rtol=1e-8)
    assert np.allclose(found.arc_m, arc_m, rtol=1e-9)
    assert np.allclose(found.moment_n_m, pressed.moment_n_m, rtol=1e-9)


@pytest.mark.parametrize(
    ("value", "gradient"),
    [
        ("moment_n_m", "moment_gradient_n"),
        ("force_n", "force_gradient_n_m"),
        ("tangent_rad", "tangent_gradient_rad_m"),
        ("arc_m", "arc_gradient"),
    ],
)
def test_verif_derivatives_are_central_differences(whisker, value, gradient):
    points = contacts(whisker).point
    stated = getattr(wc.deflect(whisker, points, strict=True), gradient)
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 1e-7
        ahead, behind = (getattr(wc.deflect(whisker, points + sign * step), value) for sign in (1, -1))
        assert np.allclose((ahead - behind) / 2e-7, stated[:, axis], rtol=1e-4, atol=1e-6 * np.abs(stated).max())


def test_verif_shape_runs_from_the_root_through_the_contact_to_the_tip(whisker):
    found = contacts(whisker)
    shape = found.shape(801)
    assert shape.shape == (20, 801, 2)
    assert np.allclose(shape[:, 0], 0.0, atol=1e-15)
    assert np.allclose(shape[:, -1], found.tip, atol=1e-12)
    nearest = np.linalg.norm(shape - found.point[:, None], axis=2).min(axis=1)
    assert (nearest < 0.5 * whisker.length_m / 800 + 1e-9).all()
    steps = np.linalg.norm(np.diff(shape, axis=1), axis=2)
    assert np.allclose(steps.sum(axis=1), whisker.length_m, rtol=1e-6)


def test_verif_an_undeflected_whisker_has_its_rest_shape():
    whisker = wc.Whisker.curved()
    on_it = whisker.rest_shape(np.array([0.05]))
    shape = wc.deflect(whisker, on_it, strict=True).shape(9)
    assert np.allclose(shape[0], whisker.rest_shape(np.linspace(0, whisker.length_m, 9)), atol=1e-12)


def test_robust_points_out_of_reach_are_rows_of_nan_with_a_reason(whisker):
    points = [[0.05, -0.005], [0.2, 0.0], [0.05, 0.005]]
    found = wc.deflect(whisker, points)
    assert np.isnan(found.moment_n_m).tolist() == [False, True, False]
    [(row, reason)] = found.failures
    assert row == 1
    assert reason.startswith("point 0.2 m from the root: out of reach of the whisker")
    assert np.isnan(found.shape(3)[1]).all()
    with pytest.raises(ValueError, match=r"points\[1\]: point 0.2 m from the root: out of reach"):
        wc.deflect(whisker, points, strict=True)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([0.05, 0.0], r"points: found an array of shape \[2\], expected shape \[n, 2\]"),
        ([[0.05, 0.0, 1.0]], r"shape \[1, 3\]"),
        ([[0.05, 0.0], [np.nan, 0.0]], r"points\[1\]: found NaN, expected finite numbers"),
    ],
)
def test_robust_arrays_of_another_shape_or_without_numbers_are_refused(whisker, points, message):
    with pytest.raises(ValueError, match=message):
        wc.deflect(whisker, points)


@pytest.mark.parametrize(
    ("points", "found"),
    [
        (np.ma.masked_array([[0.05, 0.0]], mask=[[True, False]]), "a masked array"),
        (np.array([["2026-01-01", "2026-01-02"]], dtype="datetime64[D]"), r"an array of datetime64\[D\]"),
        ([["0.05", "0.0"]], "an array of <U4"),
        (np.array([[0.05, 0.0]], dtype=object), "an array of object"),
        ([[0.05 + 1.0j, 0.0]], "an array of complex128"),
        ([[True, False]], "an array of bool"),
    ],
)
def test_robust_what_is_no_array_of_real_numbers_is_refused(whisker, points, found):
    with pytest.raises(TypeError, match=rf"found {found}, expected .*\n.*'points'"):
        wc.deflect(whisker, points)
    with pytest.raises(TypeError, match=rf"lines\[`left`\]\[0\]: found {found}, expected"):
        wc.fit_calibration(whisker, {"left": [(points, [-1e-5])]}, 0.6e-3)


@pytest.mark.parametrize("arc_m", [-0.001, 0.0801])
def test_robust_arc_lengths_beyond_the_whisker_are_refused(whisker, arc_m):
    message = rf"arc_m\[1\]: found {arc_m}, expected 0 to 0.08, the length of the whisker"
    with pytest.raises(ValueError, match=message):
        whisker.rest_shape([0.05, arc_m])
    with pytest.raises(ValueError, match=message):
        wc.press(whisker, [0.05, arc_m], [1e-4, 1e-4])


@pytest.mark.parametrize("count", [10**18, 10**8])
def test_robust_arrays_of_more_than_1e8_coordinates_are_refused(whisker, count):
    shape = wc.Shape.pin([0.05, 0.0])
    deflected, in_space = contacts(whisker), wc.Rod(whisker).deflect([[0.05, 0.005, 0.0]])
    for points, rows, coordinates in [(deflected.shape, len(deflected), 2), (in_space.shape, 1, 3), (shape.points, 1, 2)]:
        most = 10**8 // (rows * coordinates)
        with pytest.raises(ValueError, match=f"count: found {count}, expected at most {most} points for an array of {rows} rows"):
            points(count)
    with pytest.raises(ValueError, match="count: found 0, expected at least 1 points"):
        shape.points(0)


def test_robust_parameters_of_no_whisker_are_refused(whisker):
    assert wc.Whisker(whisker.parameters) == whisker
    with pytest.raises(ValueError, match=r"whisker.length_m: found -1, expected a positive number"):
        wc.Whisker({**whisker.parameters, "length_m": -1.0})
    with pytest.raises(ValueError, match=r"whisker.length_m: found 90, expected 1e-3 to 1 m; compare the unit"):
        wc.Whisker({**whisker.parameters, "length_m": 90.0, "curvature": [{"length_m": 90.0, "curvature_per_m": 0.0}]})
    with pytest.raises(ValueError, match="unknown field `colour`"):
        wc.Whisker({**whisker.parameters, "colour": "blue"})


def test_verif_arrays_of_any_layout_give_the_same_bits(whisker):
    points = contacts(whisker).point
    expected = wc.deflect(whisker, points).moment_n_m
    assert (wc.deflect(whisker, np.asfortranarray(points)).moment_n_m == expected).all()
    assert (wc.deflect(whisker, points[::-1]).moment_n_m[::-1] == expected).all()
    assert (wc.deflect(whisker, points.tolist()).moment_n_m == expected).all()
