"""Pictures of sweeps as files, still and moving; and MuJoCo's viewer."""

import hashlib
import io
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import ClassVar, Protocol

import mujoco
import numpy as np
import PIL
from PIL import Image
from PIL.ExifTags import Base as ExifTag
from tqdm import tqdm

import whisker_sim
from whisker_sim.errors import InputError, SimulationError
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.runs import Run
from whisker_sim.simulate import simulate
from whisker_sim.trace import inputs_sha256, write_atomically
from whisker_sim.whisker import Array


class Pictures(Protocol):
    """A simulated run, ready to be drawn at any instant."""

    run: Run
    sources: ClassVar[tuple[Path, ...]]
    """Files that say how it is drawn."""
    frames_hz: ClassVar[float]
    """Pictures a second of an animation."""
    lossless: ClassVar[bool]
    """Whether the colours are so few that an animation is best kept without loss."""

    def __init__(self, run: Run) -> None:
        """Simulates `run`."""

    @property
    def rows(self) -> int:
        """Number of instants."""

    @property
    def still_row(self) -> int:
        """The instant that is worth a still picture."""

    def pictures(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """The pictures at `rows`, which rise."""


def render(run: Run, path: Path, draw: type[Pictures]) -> None:
    """Simulates `run` and draws it: `.png` one instant, `.gif` or `.webp` the whole in real time.

    Raises `InputError` for another ending, and what `draw` raises, which simulates.
    """
    if path.suffix not in (".png", ".gif", ".webp"):
        raise InputError(f"{path}: expected a name that ends in .png, .gif or .webp, found '{path.suffix}'")
    sweep = draw(run)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".png":
        _write_still(path, sweep)
    else:
        _write_animation(path, sweep, shows_progress=sys.stderr.isatty())


def first_of_each_set(runs: Iterable[Run]) -> list[Run]:
    """The first trial of every group with every whisker."""
    first: dict[str, Run] = {}
    for run in runs:
        if run.scene.role == "trial":
            first.setdefault(set_name(run), run)
    return list(first.values())


def render_set(folder: Path, run: Run, draw: type[Pictures]) -> None:
    """Simulates `run` and writes, into `folder`, the animation `<group>.<whisker>.webp` and a still `<group>.<whisker>.png`."""
    sweep = draw(run)
    folder.mkdir(parents=True, exist_ok=True)
    still, animation = _set_paths(folder, run)
    _write_still(still, sweep)
    _write_animation(animation, sweep, shows_progress=False)


def is_rendered(folder: Path, run: Run, draw: type[Pictures]) -> bool:
    """Whether `folder` holds just the pictures that `render_set` would write, by what they say of themselves."""
    return all(_description(path) == _provenance(run, draw.sources) for path in _set_paths(folder, run))


def view(run: Run, replay: Callable[[Run], tuple[mujoco.MjModel, Array]]) -> None:
    """Simulates `run` and plays it in MuJoCo's viewer, over and over, until the window is closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SimulationError("the viewer needs a display, found none; `render` draws without one")
    import mujoco.viewer

    model, qpos = replay(run)
    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running():
            start_s = time.monotonic()
            while viewer.is_running() and (row := int(run.scene.rate_hz * (time.monotonic() - start_s))) < len(qpos):
                data.qpos[:] = qpos[row]
                mujoco.mj_kinematics(model, data)
                viewer.sync()
                time.sleep(1.0 / 60.0)


def replayed_sweep(run: Run) -> tuple[mujoco.MjModel, Array]:
    """Simulates a sweep; gives the model and its coordinates (n, nq) at every row."""
    simulated = simulate(run)
    model = build_model(run.scene.resolved_whisker, run.scene.object, run.scene.simulation.timestep_s)
    return model, np.concatenate((simulated.base_pose * (MM_PER_M, MM_PER_M, 1.0), simulated.rotations_rad), axis=1)


def _write_still(path: Path, sweep: Pictures) -> None:
    """Writes the picture of one instant."""
    (picture,) = sweep.pictures([sweep.still_row])
    buffer = io.BytesIO()
    picture.save(buffer, "png", optimize=True, exif=_exif(sweep))
    write_atomically(path, buffer.getvalue())


def _write_animation(path: Path, sweep: Pictures, shows_progress: bool) -> None:
    """Writes the whole in real time, over and over."""
    rate_hz = sweep.run.scene.rate_hz
    stride = max(1, round(rate_hz / sweep.frames_hz))
    rows = tqdm(range(0, sweep.rows, stride), unit="frame", desc="render", disable=not shows_progress)
    first, *rest = sweep.pictures(rows)
    options = {"lossless": sweep.lossless, "quality": 75, "method": 3, "exif": _exif(sweep)}
    if path.suffix == ".gif":
        options = {"comment": _provenance(sweep.run, sweep.sources)}
    buffer = io.BytesIO()
    duration_ms = round(1e3 * stride / rate_hz)
    first.save(buffer, path.suffix[1:], save_all=True, append_images=rest, duration=duration_ms, loop=0, **options)
    write_atomically(path, buffer.getvalue())


def set_name(run: Run) -> str:
    """Name of the pictures of a set, the trials of one group with one whisker. Neither holds a dot, so no two are the same."""
    return f"{run.scene.group}.{run.scene.resolved_whisker.name}"


def _set_paths(folder: Path, run: Run) -> tuple[Path, Path]:
    """The still and the animation of a set."""
    return folder / f"{set_name(run)}.png", folder / f"{set_name(run)}.webp"


def _exif(sweep: Pictures) -> Image.Exif:
    exif = Image.Exif()
    exif[ExifTag.Software] = f"whisker_sim {whisker_sim.__version__}"
    exif[ExifTag.ImageDescription] = _provenance(sweep.run, sweep.sources)
    return exif


def _provenance(run: Run, sources: tuple[Path, ...]) -> str:
    """What a picture says of itself: the name of the trace, and a hash of all that determines the picture."""
    digest = hashlib.sha256(f"{inputs_sha256(run.scene)} {PIL.__version__}".encode())
    for source in (Path(__file__), *sources):
        digest.update(source.read_bytes())
    return f"{run.name}, inputs {digest.hexdigest()}"


def _description(path: Path) -> str | None:
    """What the picture at `path` says of itself; None where there is no picture."""
    try:
        with Image.open(path) as picture:
            return picture.getexif().get(ExifTag.ImageDescription)
    except OSError:
        return None
