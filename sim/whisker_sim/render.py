"""Stills and animations of simulated runs, and MuJoCo's viewer."""

import hashlib
import io
import os
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Protocol

import mujoco
import numpy as np
import PIL
from PIL import Image
from PIL.ExifTags import Base as ExifTag

import whisker_sim
from whisker_sim.errors import InputError, SimulationError
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.progress import report_share
from whisker_sim.runs import Run, set_name
from whisker_sim.simulate import Simulated
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.trace import spatial_inputs_sha256
from whisker_sim.trace import inputs_sha256, write_atomically
from whisker_sim.whisker import Array

_FORMATS = (".png", ".gif", ".webp")
_DRAWING_SHARE = 0.6
"""Share of the frames' time in that of an animation; encoding takes the rest."""


class Renderer(Protocol):
    """Draws frames of a simulated run."""

    run: Run
    sources: ClassVar[tuple[Path, ...]]
    """Source files that determine the frames."""
    frames_hz: ClassVar[float]
    """Frame rate of an animation."""
    lossless: ClassVar[bool]
    """Whether animations are encoded losslessly, which suits few flat colours."""

    def __init__(self, run: Run, simulated: Any) -> None:
        """Prepares the frames of `run`, which was simulated to `simulated`."""

    @property
    def rate_hz(self) -> float:
        """Number of instants per second."""

    @property
    def rows(self) -> int:
        """Number of instants."""

    @property
    def still_row(self) -> int:
        """Row of the instant that a still shows."""

    def frames(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """Frames at `rows`, which ascend."""


def check_format(path: Path) -> None:
    """Raises `InputError` if the suffix of `path` is not that of a picture."""
    if path.suffix not in _FORMATS:
        raise InputError(f"{path}: expected a name that ends in .png, .gif or .webp, found '{path.suffix}'")


def render(path: Path, renderer: Renderer) -> None:
    """Writes a still (`.png`) or an animation in real time (`.gif`, `.webp`)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".png":
        _write_still(path, renderer)
    else:
        _write_animation(path, renderer)


def render_set(folder: Path, renderer: Renderer) -> None:
    """Writes the animation `<group>.<whisker>.webp` and the still `<group>.<whisker>.png` of a run's set into `folder`."""
    for path in _set_paths(folder, renderer.run):
        render(path, renderer)


def is_rendered(folder: Path, run: Run, renderer: type[Renderer]) -> bool:
    """Whether `folder` holds exactly the pictures that `render_set` would write, according to their provenance."""
    return all(_description(path) == _provenance(run, renderer.sources) for path in _set_paths(folder, run))


def view(model: mujoco.MjModel, qpos: Array, rate_hz: float) -> None:
    """Plays the coordinates `qpos` (n, nq), sampled at `rate_hz`, in MuJoCo's viewer repeatedly until its window is closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SimulationError("the viewer needs a display, found none; `render` draws without one")
    import mujoco.viewer

    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running():
            start_s = time.monotonic()
            while viewer.is_running() and (row := int(rate_hz * (time.monotonic() - start_s))) < len(qpos):
                data.qpos[:] = qpos[row]
                mujoco.mj_kinematics(model, data)
                viewer.sync()
                time.sleep(1.0 / 60.0)


def replayed_sweep(run: Run, simulated: Simulated) -> tuple[mujoco.MjModel, Array]:
    """Model of a simulated sweep, in the frame of its object, and its coordinates (n, nq) at every row."""
    simulated = simulated.relative_to_object()
    model = build_model(
        run.scene.resolved_whisker, run.scene.object, run.scene.simulation.timestep_s, run.scene.friction_coefficient
    )
    return model, np.concatenate((simulated.base_pose * (MM_PER_M, MM_PER_M, 1.0), simulated.rotations_rad), axis=1)


def _write_still(path: Path, renderer: Renderer) -> None:
    (frame,) = renderer.frames([renderer.still_row])
    buffer = io.BytesIO()
    frame.save(buffer, "png", optimize=True, exif=_exif(renderer))
    write_atomically(path, buffer.getvalue())


def _write_animation(path: Path, renderer: Renderer) -> None:
    """Writes an endless animation in real time."""
    rate_hz = renderer.rate_hz
    stride = max(1, round(rate_hz / renderer.frames_hz))
    rows = range(0, renderer.rows, stride)
    frames = []
    for index, frame in enumerate(renderer.frames(rows), 1):
        frames.append(frame)
        report_share(_DRAWING_SHARE * index / len(rows))
    # Without loss, a low quality means little effort: half the time for files an eighth larger.
    options = {"lossless": renderer.lossless, "quality": 0 if renderer.lossless else 75, "method": 1, "exif": _exif(renderer)}
    if path.suffix == ".gif":
        options = {"comment": _provenance(renderer.run, renderer.sources)}
    buffer = io.BytesIO()
    duration_ms = round(1e3 * stride / rate_hz)
    first, *rest = frames
    first.save(buffer, path.suffix[1:], save_all=True, append_images=rest, duration=duration_ms, loop=0, **options)
    write_atomically(path, buffer.getvalue())


def _set_paths(folder: Path, run: Run) -> tuple[Path, Path]:
    """Still and animation of a set."""
    return folder / f"{set_name(run)}.png", folder / f"{set_name(run)}.webp"


def _exif(renderer: Renderer) -> Image.Exif:
    exif = Image.Exif()
    exif[ExifTag.Software] = f"whisker_sim {whisker_sim.__version__}"
    exif[ExifTag.ImageDescription] = _provenance(renderer.run, renderer.sources)
    return exif


def _provenance(run: Run, sources: tuple[Path, ...]) -> str:
    """Provenance stored in a picture: name of the trace, and hash of all inputs that determine the picture, also of mesh files."""
    inputs = spatial_inputs_sha256(run) if isinstance(run.scene, SpatialScene) else inputs_sha256(run.scene)
    digest = hashlib.sha256(f"{inputs} {PIL.__version__}".encode())
    for source in (Path(__file__), *sources):
        digest.update(source.read_bytes())
    return f"{run.name}, inputs {digest.hexdigest()}"


def _description(path: Path) -> str | None:
    """Provenance stored in the picture at `path`; `None` if there is no picture."""
    try:
        with Image.open(path) as picture:
            return picture.getexif().get(ExifTag.ImageDescription)
    except OSError:
        return None
