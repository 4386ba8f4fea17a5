"""Pictures of sweeps as files, still and moving; and MuJoCo's viewer."""

import hashlib
import io
import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import PIL
from PIL import Image
from PIL.ExifTags import Base as ExifTag
from tqdm import tqdm

import whisker_sim
from whisker_sim import drawing
from whisker_sim.drawing import Drawing
from whisker_sim.errors import InputError, SimulationError
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.runs import Run
from whisker_sim.simulate import simulate
from whisker_sim.trace import inputs_sha256, write_atomically

_FRAMES_HZ = 20.0


def render(run: Run, path: Path) -> None:
    """Simulates `run` and draws it: `.png` the instant of the largest reading, `.gif` or `.webp` the sweep in real time.

    Raises `InputError` for another ending, and what `simulate` raises.
    """
    if path.suffix not in (".png", ".gif", ".webp"):
        raise InputError(f"{path}: expected a name that ends in .png, .gif or .webp, found '{path.suffix}'")
    sweep = Drawing(run, simulate(run))
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


def render_set(folder: Path, run: Run) -> None:
    """Simulates `run` and writes, into `folder`, the animation `<group>.<whisker>.webp` and a still `<group>.<whisker>.png`."""
    sweep = Drawing(run, simulate(run))
    folder.mkdir(parents=True, exist_ok=True)
    still, animation = _set_paths(folder, run)
    _write_still(still, sweep)
    _write_animation(animation, sweep, shows_progress=False)


def is_rendered(folder: Path, run: Run) -> bool:
    """Whether `folder` holds just the pictures that `render_set` would write, by what they say of themselves."""
    return all(_description(path) == _provenance(run) for path in _set_paths(folder, run))


def view(run: Run) -> None:
    """Simulates `run` and plays it in MuJoCo's viewer, over and over, until the window is closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SimulationError("the viewer needs a display, found none; `render` draws without one")
    import mujoco.viewer

    simulated = simulate(run)
    model = build_model(run.scene.resolved_whisker, run.scene.object, run.scene.simulation.timestep_s)
    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running():
            start_s = time.monotonic()
            while viewer.is_running() and (elapsed_s := time.monotonic() - start_s) < simulated.time_s[-1]:
                row = int(elapsed_s * run.scene.rate_hz)
                data.qpos[:3] = simulated.base_pose[row] * (MM_PER_M, MM_PER_M, 1.0)
                data.qpos[3:] = simulated.rotations_rad[row]
                mujoco.mj_kinematics(model, data)
                viewer.sync()
                time.sleep(1.0 / 60.0)


def _write_still(path: Path, sweep: Drawing) -> None:
    """Writes the picture at the largest reading."""
    (picture,) = sweep.pictures([sweep.largest_reading_row])
    buffer = io.BytesIO()
    picture.save(buffer, "png", optimize=True, exif=_exif(sweep.run))
    write_atomically(path, buffer.getvalue())


def _write_animation(path: Path, sweep: Drawing, shows_progress: bool) -> None:
    """Writes the whole sweep in real time, over and over."""
    rate_hz = sweep.run.scene.rate_hz
    stride = max(1, round(rate_hz / _FRAMES_HZ))
    rows = tqdm(range(0, sweep.rows, stride), unit="frame", desc="render", disable=not shows_progress)
    first, *rest = sweep.pictures(rows)
    # Flat colours are smaller without loss than with it.
    options = {"lossless": True, "quality": 75, "method": 3, "exif": _exif(sweep.run)}
    if path.suffix == ".gif":
        options = {"comment": _provenance(sweep.run)}
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


def _exif(run: Run) -> Image.Exif:
    exif = Image.Exif()
    exif[ExifTag.Software] = f"whisker_sim {whisker_sim.__version__}"
    exif[ExifTag.ImageDescription] = _provenance(run)
    return exif


def _provenance(run: Run) -> str:
    """What a picture says of itself: the name of the trace, and a hash of all that determines the picture."""
    digest = hashlib.sha256(f"{inputs_sha256(run.scene)} {PIL.__version__}".encode())
    for source in (__file__, drawing.__file__):
        digest.update(Path(source).read_bytes())
    return f"{run.name}, inputs {digest.hexdigest()}"


def _description(path: Path) -> str | None:
    """What the picture at `path` says of itself; None where there is no picture."""
    try:
        with Image.open(path) as picture:
            return picture.getexif().get(ExifTag.ImageDescription)
    except OSError:
        return None
