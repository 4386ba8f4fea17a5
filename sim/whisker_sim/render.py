"""Pictures of a scene from above, headless, and MuJoCo's viewer."""

import os
import sys
import time
from pathlib import Path

# MuJoCo chooses its rendering back end when it is imported; EGL needs no display.
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tqdm import tqdm

from whisker_sim.errors import InputError, SimulationError
from whisker_sim.model import MM_PER_M, build_model
from whisker_sim.scene import Run
from whisker_sim.simulate import Simulated, simulate
from whisker_sim.truth import CenterLine

_WIDTH, _HEIGHT = 960, 720
_FRAMES_HZ = 25.0
_MARGIN = 1.15
# A true wire is a pixel wide; drawn as wide as this share of the picture it can be seen.
_WHISKER_SHARE = 0.004
_ABOVE_ALL_MM = 100.0
_ROOT_RGBA = (0.20, 0.20, 0.20, 1.0)
_CONTACT_RGBA = (0.00, 0.45, 0.70, 1.0)
_INK = (40, 40, 40)


def render(run: Run, path: Path) -> None:
    """Simulates `run` and draws it: `.png` the instant of the largest reading, `.gif` or `.webp` the sweep in real time.

    Raises `InputError` for another ending, and `SimulationError` where there is no rendering back end.
    """
    if path.suffix not in (".png", ".gif", ".webp"):
        raise InputError(f"{path}: expected a name that ends in .png, .gif or .webp, found '{path.suffix}'")
    simulated = simulate(run)
    step = max(1, round(run.scene.rate_hz / _FRAMES_HZ))
    still = path.suffix == ".png"
    rows = [int(np.argmax(np.abs(simulated.rotations_rad[:, 0])))] if still else range(0, len(simulated.time_s), step)
    with _Camera(run, simulated) as camera:
        frames = [camera.frame(row) for row in tqdm(rows, unit="frame", desc="render", disable=still or not sys.stderr.isatty())]
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp{path.suffix}")
    try:
        if still:
            frames[0].save(temporary)
        else:
            # One palette for all frames keeps the colours from flickering.
            if path.suffix == ".gif":
                palette = frames[len(frames) // 2].quantize(64)
                frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
            duration_ms = round(1e3 * step / run.scene.rate_hz)
            frames[0].save(temporary, save_all=True, append_images=frames[1:], duration=duration_ms, loop=0)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def view(run: Run) -> None:
    """Simulates `run` and plays it in MuJoCo's viewer, over and over, until the window is closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SimulationError("the viewer needs a display, found none; `render` draws without one")
    import mujoco.viewer

    simulated = simulate(run)
    model, data = _posed_model(run)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running():
            start_s = time.monotonic()
            while viewer.is_running() and (elapsed_s := time.monotonic() - start_s) < simulated.time_s[-1]:
                _pose(model, data, simulated, int(elapsed_s * run.scene.rate_hz))
                viewer.sync()
                time.sleep(1.0 / 60.0)


class _Camera:
    """Looks straight down on the part of the plane where the whisker moves."""

    def __init__(self, run: Run, simulated: Simulated) -> None:
        self._run, self._simulated = run, simulated
        line = CenterLine.from_joints(run.scene.resolved_whisker, simulated.base_pose, simulated.rotations_rad)
        surface_m = simulated.truth.surface_m[simulated.touching]
        seen_mm = MM_PER_M * np.concatenate((line.points_m.reshape(-1, 2), surface_m))
        low, high = seen_mm.min(axis=0), seen_mm.max(axis=0)
        self._center_mm = 0.5 * (low + high)
        width, height = high - low
        self._height_mm = _MARGIN * max(height, width * _HEIGHT / _WIDTH)
        self._model, self._data = _posed_model(run)
        capsules = self._model.geom_contype == 1
        self._dot_mm = _WHISKER_SHARE * self._height_mm
        self._model.geom_size[capsules, 0] = np.maximum(self._model.geom_size[capsules, 0], self._dot_mm)
        # A plan view: flat colours, and round objects round.
        self._model.vis.headlight.ambient[:], self._model.vis.headlight.diffuse[:] = 1.0, 0.0
        self._model.vis.headlight.specular[:] = 0.0
        self._model.vis.quality.numslices, self._model.vis.quality.numstacks = 128, 4
        self._model.vis.global_.orthographic = 1
        self._model.vis.global_.fovy = self._height_mm
        self._font = ImageFont.load_default(22)

    def __enter__(self) -> "_Camera":
        try:
            self._renderer = mujoco.Renderer(self._model, _HEIGHT, _WIDTH)
        except Exception as error:
            raise SimulationError(f"no headless rendering: {error}; Debian has it in libegl1 and libgl1-mesa-dri") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def frame(self, row: int) -> Image.Image:
        """The picture at a row of the trace."""
        simulated = self._simulated
        _pose(self._model, self._data, simulated, row)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = (*self._center_mm, 0.0)
        camera.azimuth, camera.elevation = 90.0, -90.0
        camera.distance = 4.0 * self._height_mm
        camera.orthographic = 1
        self._renderer.update_scene(self._data, camera)
        self._dot(simulated.base_pose[row, :2], 2.2, _ROOT_RGBA)
        if simulated.touching[row]:
            self._dot(simulated.truth.surface_m[row], 1.8, _CONTACT_RGBA)
        picture = Image.fromarray(self._renderer.render())
        caption = f"{self._run.name}    t = {simulated.time_s[row]:.2f} s"
        ImageDraw.Draw(picture).text((16, 12), caption, fill=_INK, font=self._font)
        self._scale_bar(picture)
        return picture

    def _dot(self, point_m: np.ndarray, size: float, rgba: tuple[float, ...]) -> None:
        scene = self._renderer.scene
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom],
            mujoco.mjtGeom.mjGEOM_SPHERE,
            np.full(3, size * self._dot_mm),
            np.array((*MM_PER_M * point_m, _ABOVE_ALL_MM)),
            np.eye(3).ravel(),
            np.array(rgba, dtype=np.float32),
        )
        scene.ngeom += 1

    def _scale_bar(self, picture: Image.Image) -> None:
        length = round(10.0 * _HEIGHT / self._height_mm)
        draw = ImageDraw.Draw(picture)
        draw.line(((16, _HEIGHT - 20), (16 + length, _HEIGHT - 20)), fill=_INK, width=3)
        draw.text((16, _HEIGHT - 52), "10 mm", fill=_INK, font=self._font)


def _posed_model(run: Run) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = build_model(run.scene.resolved_whisker, run.scene.object, run.scene.simulation.timestep_s)
    return model, mujoco.MjData(model)


def _pose(model: mujoco.MjModel, data: mujoco.MjData, simulated: Simulated, row: int) -> None:
    data.qpos[:3] = simulated.base_pose[row] * (MM_PER_M, MM_PER_M, 1.0)
    data.qpos[3:] = simulated.rotations_rad[row]
    mujoco.mj_kinematics(model, data)
