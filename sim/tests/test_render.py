"""Pictures of sweeps: content, provenance, determinism; no graphics driver is needed."""

import json
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image

from whisker_sim import drawing
from whisker_sim.cli import main
from whisker_sim.drawing import SweepRenderer
from whisker_sim.shapes import AnyShape
from whisker_sim.simulate import simulate

from conftest import SCENES, SWEEP

COLOURS = {"whisker": (213, 94, 0), "contact and force": (0, 114, 178), "contacts": (0, 158, 115), "object": (226, 230, 235)}


def pixels(picture: Image.Image, colour: tuple[int, int, int]) -> np.ndarray:
    """Positions (n, 2) of a colour in the view, y before x."""
    values = np.asarray(picture.convert("RGB"))[drawing._CAPTION_HEIGHT : -drawing._LEGEND_HEIGHT]
    return np.argwhere(np.all(values == colour, axis=-1)) + np.array((drawing._CAPTION_HEIGHT, 0))


@pytest.mark.parametrize("shape", AnyShape.__args__, ids=lambda shape: shape.__struct_config__.tag)
def test_verif_a_sweep_over_every_shape_is_drawn(write_scene, tmp_path, shape):
    """Whisker, object, contact and previous contacts are visible; the animation has 12.5 frames per second."""
    example = {"shape": shape.__struct_config__.tag, **shape.example}
    scene = str(write_scene(object=example, motion={**SWEEP["motion"], "strokes": 2}))
    still, moving = tmp_path / "a.png", tmp_path / "a.webp"
    assert main(["render", scene, "--out", str(still)]) == 0
    assert main(["render", scene, "--out", str(moving)]) == 0
    with Image.open(still) as picture:
        for name, colour in COLOURS.items():
            assert len(pixels(picture, colour)) > 0, name
    with Image.open(moving) as animation:
        assert animation.n_frames > 20
        animation.load()
        assert animation.info["duration"] == pytest.approx(80)
        assert len(pixels(animation, COLOURS["contact and force"])) == 0, "there is no contact at first"


def test_verif_the_arrow_is_as_long_as_the_force_and_points_away_from_the_object(make_run):
    run = make_run()
    simulated = simulate(run)
    sweep = SweepRenderer(run, simulated)
    row = int(np.argmax(simulated.force_n))
    arrows_m = sweep._arrow_end_m - simulated.truth.surface_m
    lengths_m = np.hypot(*arrows_m.T)
    np.testing.assert_allclose(lengths_m, 0.2 * 0.08 * simulated.force_n / simulated.force_n[row], atol=1e-12)
    _, distance_m = run.scene.object.closest(sweep._arrow_end_m[simulated.touching])
    np.testing.assert_allclose(distance_m, lengths_m[simulated.touching], atol=1e-7)


def test_verif_a_drawn_contact_is_at_the_true_point(make_run):
    """The centre of the ring is the true point to a pixel.

    The object is above it, so that the arrow points downwards from the ring.
    """
    run = make_run()
    simulated = simulate(run)
    sweep = SweepRenderer(run, simulated)
    row = int(np.flatnonzero(simulated.touching)[0])
    (picture,) = sweep.frames([row])
    ring = pixels(picture, COLOURS["contact and force"])
    top, (left, right) = ring[:, 0].min(), (ring[:, 1].min(), ring[:, 1].max() + 1)
    middle = (0.5 * (left + right), top + drawing._RING_RADIUS)
    np.testing.assert_allclose(middle, sweep._to_pixels(simulated.truth.surface_m[row]), atol=1.0)


@pytest.fixture
def suite(write_scene, tmp_path):
    """A suite of a calibration and of three trials in two sets."""
    write_scene(name="grid", role="calibration")
    for name, group in (("first", "one"), ("second", "one"), ("third", "two")):
        write_scene(name=name, group=group)
    path = tmp_path / "suite.json"
    entries = [{"scene": f"{name}.json"} for name in ("grid", "first", "second", "third")]
    path.write_text(json.dumps({"format": 1, "name": "suite", "scenes": entries}))
    return path


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_verif_a_suite_is_drawn_once_for_each_group_and_whisker(suite, tmp_path, capsys, jobs):
    out = tmp_path / "animations"
    command = ["render", str(suite), "--out", str(out), "--jobs", jobs]
    assert main(command) == 0
    names = ["one.straight.png", "one.straight.webp", "two.straight.png", "two.straight.webp"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert "drawn from first" in capsys.readouterr().err

    before = [(out / name).stat().st_mtime_ns for name in names]
    assert main(command) == 0
    assert capsys.readouterr().err.count("up to date") == 2
    assert [(out / name).stat().st_mtime_ns for name in names] == before

    (out / "one.straight.webp").write_bytes(b"cut short")
    scene = json.loads((tmp_path / "third.json").read_text())
    (tmp_path / "third.json").write_text(json.dumps({**scene, "seed": 1}))
    assert main(command) == 0
    assert "up to date" not in capsys.readouterr().err


def test_verif_simulate_draws_the_animations_of_a_suite(suite, tmp_path, capsys):
    """The same files as by `render`, from the simulation of the traces; only missing files are made."""
    out, animations, rendered = tmp_path / "out", tmp_path / "animations", tmp_path / "rendered"
    command = ["simulate", str(suite), "--out", str(out), "--animations", str(animations), "--jobs", "2"]
    assert main(command) == 0
    assert main(["render", str(suite), "--out", str(rendered), "--jobs", "2"]) == 0
    assert {path.name for path in out.glob("*.csv") if "contour" not in path.name} == {
        *("first.csv", "grid.csv", "second.csv", "third.csv")
    }
    assert _contents(animations) == _contents(rendered)

    (animations / "two.straight.png").unlink()
    kept = {path: path.stat().st_mtime_ns for path in (*out.iterdir(), animations / "one.straight.webp")}
    capsys.readouterr()
    assert main(command) == 0
    error = capsys.readouterr().err
    assert error.count("up to date") == 3
    assert "two.straight: drawn from third" in error
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert _contents(animations) == _contents(rendered)
    scene = str(tmp_path / "first.json")
    assert main(["simulate", scene, "--out", str(out), "--animations", str(animations)]) == 2
    assert "expected a suite with --animations, found a scene" in capsys.readouterr().err


def test_robust_two_suites_with_animations_of_the_same_name(suite, write_scene, tmp_path, capsys):
    """The second would be drawn over the first; nothing is written."""
    write_scene(name="fourth", group="one")
    other = tmp_path / "other.json"
    other.write_text(json.dumps({"format": 1, "name": "other", "scenes": [{"scene": "fourth.json"}]}))
    folders = {"--out": tmp_path / "out", "--animations": tmp_path / "animations"}
    options = [str(word) for option in folders.items() for word in option]
    assert main(["simulate", str(suite), str(other), *options]) == 2
    error = capsys.readouterr().err
    assert "first.json: expected animations of different names, found 'one.straight' 2 times; draw each suite by a command" in error
    assert error.count("\n") == 1
    assert not any(folder.exists() for folder in folders.values())


@pytest.mark.parametrize("animations", ["animations", "out", "out/../out"])
def test_verif_the_folder_of_animations_is_locked(suite, tmp_path, monkeypatch, animations):
    """Once, also if it is that of the traces."""
    locked = []

    @contextmanager
    def recorded(folder, share):
        locked.append(folder.resolve().name)
        yield

    monkeypatch.setattr("whisker_sim.cli.exclusive", recorded)
    monkeypatch.setattr("whisker_sim.cli.run_job", lambda *_: 0)
    (tmp_path / "out").mkdir()
    assert main(["simulate", str(suite), "--out", str(tmp_path / "out"), "--animations", str(tmp_path / animations)]) == 0
    assert sorted(locked) == sorted({"out", animations.split("/")[-1]})


def _contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_verif_the_same_sweep_gives_the_same_bytes(write_scene, tmp_path):
    scene = str(write_scene())
    for ending in ("png", "gif", "webp"):
        files = [tmp_path / f"{name}.{ending}" for name in "ab"]
        for file in files:
            assert main(["render", scene, "--out", str(file)]) == 0
        assert files[0].read_bytes() == files[1].read_bytes()


def test_robust_a_picture_needs_a_known_suffix(capsys, tmp_path):
    assert main(["render", str(SCENES / "golden_circle.json"), "--out", str(tmp_path / "a.txt")]) == 2
    error = capsys.readouterr().err
    assert ".png, .gif or .webp, found '.txt'" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
