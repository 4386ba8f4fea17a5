"""Common tests that every shape, motion and whisker of the registries must pass."""

import numpy as np
import pytest

from whisker_sim.motions import AnyMotion
from whisker_sim.shapes import AnyShape
from whisker_sim.simulate import simulate
from whisker_sim.whisker import PRESETS

SHAPES = {shape.__struct_config__.tag: shape for shape in AnyShape.__args__}
MOTIONS = {motion.__struct_config__.tag: motion for motion in AnyMotion.__args__}


@pytest.mark.parametrize("name", SHAPES)
def test_verif_shape_geometry(name):
    """Outline, support point and signed distance are consistent."""
    shape = SHAPES[name](center_m=(0.003, -0.002), **SHAPES[name].example)
    outline = shape.outline_m()
    assert np.array_equal(outline[0], outline[-1])
    edge = np.diff(outline, axis=0)
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    assert np.all(turn > 0.0) == shape.convex
    x, y = outline.T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0.0, "counter-clockwise"

    _, at_vertices_m = shape.closest(outline)
    _, at_middles_m = shape.closest(0.5 * (outline[1:] + outline[:-1]))
    assert np.max(np.abs(at_vertices_m)) < 1e-12
    assert np.max(np.abs(at_middles_m)) <= shape.chord_error_m() + 1e-12

    for angle in np.linspace(0.0, 6.0, 13):
        direction = np.array((np.cos(angle), np.sin(angle)))
        support = shape.support_m(direction)
        assert support @ direction == pytest.approx(np.max(outline @ direction), abs=shape.chord_error_m() + 1e-12)

    rng = np.random.default_rng(0)
    points = np.array(shape.center_m) + rng.uniform(-0.03, 0.03, (400, 2))
    nearest, distance_m = shape.closest(points)
    np.testing.assert_allclose(np.hypot(*(points - nearest).T), np.abs(distance_m), atol=1e-12)
    brute_m = np.array([np.min(_to_segments(point, outline)) for point in points])
    np.testing.assert_allclose(np.abs(distance_m), brute_m, atol=shape.chord_error_m() + 1e-9)
    inside = _turns(points, outline) == 1
    clear = np.abs(distance_m) > shape.chord_error_m()
    assert np.array_equal((distance_m < 0.0)[clear], inside[clear])


def _to_segments(point, outline):
    start, edge = outline[:-1], np.diff(outline, axis=0)
    share = np.clip(np.sum((point - start) * edge, axis=1) / np.sum(edge**2, axis=1), 0.0, 1.0)
    return np.hypot(*(point - start - share[:, None] * edge).T)


def _turns(points, outline):
    """How often the outline runs round each point."""
    offset = outline - points[:, None]
    angle = np.unwrap(np.arctan2(offset[..., 1], offset[..., 0]), axis=1)
    return np.round((angle[:, -1] - angle[:, 0]) / (2.0 * np.pi)).astype(int)


@pytest.mark.parametrize("name", SHAPES)
def test_verif_shape_in_the_simulator(make_run, name):
    """A sweep over the shape runs without a warning, and MuJoCo's geometry coincides with the outline."""
    run = make_run(object={"shape": name, **SHAPES[name].example})
    simulated = simulate(run)
    assert np.mean(simulated.touching) > 0.5
    settled = simulated.touching & (simulated.time_s > 0.8)
    _, distance_m = run.scene.object.closest(simulated.truth.contact_m[settled])
    radius_m = run.scene.resolved_whisker.radius_m(simulated.truth.arc_m[settled])
    assert np.max(np.abs(distance_m - radius_m)) < 5e-6


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("face", ["left", "right"])
def test_verif_motion(make_run, name, face):
    """The motion starts at rest and without contact, keeps its guarantees, and its plan is smooth."""
    duration = {"duration_s": 1.5} if MOTIONS[name].needs_duration else {}
    run = make_run(face=face, object={"shape": "pin"}, motion={"kind": name, **MOTIONS[name].example}, **duration)
    plan = run.scene.motion.plan(run.scene.stage())
    assert plan.touching
    step_m = np.hypot(*np.diff(plan.poses[:, :2], axis=0).T)
    assert step_m[0] == 0.0
    assert np.max(np.abs(np.diff(step_m))) < 1e-6, "acceleration below 4 m/s^2 at a step of 0.5 ms"
    simulated = simulate(run)
    assert not np.any(simulated.touching[simulated.time_s < 0.2])
    # The base lags behind its command by 4 ms.
    np.testing.assert_allclose(simulated.base_pose[-1], plan.poses[-1], atol=3e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_verif_whisker(make_run, name):
    """The whisker runs without a warning and is touched at the planned arc length."""
    arc_m = 0.6 * PRESETS[name][1].length_m
    simulated = simulate(
        make_run(whisker=name, motion={"kind": "lateral_sweep", "contact_arc_m": arc_m, "stroke_m": 0.1 * arc_m, "strokes": 1})
    )
    touch = int(np.argmax(simulated.touching))
    assert simulated.truth.arc_m[touch] == pytest.approx(arc_m, rel=0.02)
