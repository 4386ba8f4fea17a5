"""An arm between its objects in perspective: MuJoCo's own picture of the model, with whiskers, contacts and places touched so far.

Whiskers are drawn several times as thick as they are, for a wire of a quarter of a millimetre would not be seen, and nothing casts
a shadow, for that of a whisker looks like another one. Colours are those of `whisker_sim.drawing`.
"""

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from whisker_sim import drawing
from whisker_sim.arm.simulate import Passed
from whisker_sim.arm.tool import LENGTH_M, MOUNTS
from whisker_sim.drawing import BLUE, GREEN, VERMILION, Colour
from whisker_sim.errors import SimulationError
from whisker_sim.model import MM_PER_M
from whisker_sim.runs import Run
from whisker_sim.truth import CenterLine
from whisker_sim.whisker import Array

_WIDTH, _HEIGHT = 540, 480
_OVERSAMPLING = 2
_WHISKER_MM, _CONTACT_MM, _TRACE_MM = 0.8, 2.4, 1.1
_TRACE_APART_M = 1e-3
"""A place is marked where it lies so far from the one marked before."""
_AZIMUTH_DEG, _ELEVATION_DEG = 162.0, -40.0
"""Direction of the view, towards an arm that looks along x; so low that the arm, which comes from above, hides little."""
_FIELD_DEG = 22.0
"""Height of the field; from so far away what is near looks hardly larger than what is far."""
_FIELD_SHARE = 0.95
"""Share of the picture's width and height that objects and whiskers take up."""
_CENTERINGS = 4
_FRAMED_ROWS = 25
"""Whiskers are framed at one instant in so many."""
_AMBIENT = 0.2
_SLICES = 96
"""Of a round body, which else shows its edges."""


class PassageRenderer:
    """A simulated passage, ready to be drawn at any instant."""

    sources = (Path(__file__), Path(drawing.__file__))
    frames_hz = 8.0
    lossless = False
    """Shaded faces are far smaller with loss than without."""

    def __init__(self, run: Run, passed: Passed) -> None:
        self.run, self._passed = run, passed
        whisker = run.scene.resolved_whisker
        self._heights_mm = {mount.name: MM_PER_M * (run.scene.path.height_m + mount.pose[2, 3]) for mount in MOUNTS}
        self._lines_m = {
            name: CenterLine.from_joints(whisker, one.base_pose, one.rotations_rad).points_m
            for name, one in passed.whiskers.items()
        }

    @property
    def rows(self) -> int:
        """Number of instants."""
        return len(self._passed.time_s)

    @property
    def still_row(self) -> int:
        """The instant at which most whiskers touch; of several the last."""
        touching = np.sum([whisker.touching for whisker in self._passed.whiskers.values()], axis=0)
        return int(np.flatnonzero(touching == np.max(touching))[-1])

    def frames(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """The pictures at `rows`, which rise; each shows the contact points up to its own.

        Raises `SimulationError` where the machine cannot draw in perspective.
        """
        passed = self._passed
        marked = {name: _apart(one.truth.surface_m, one.touching) for name, one in passed.whiskers.items()}
        most_sticks = sum(len(self._lines_m[name][0]) + len(marked[name]) + 1 for name in marked)
        with _painter(passed.model, self._framed_mm(), most_sticks) as paint:
            for row in rows:
                sticks: list[Stick] = []
                for name, one in passed.whiskers.items():
                    z_mm = self._heights_mm[name]
                    line_mm = _lifted(self._lines_m[name][row, ::2], z_mm)
                    sticks += [(start, end, _WHISKER_MM, VERMILION) for start, end in pairwise(line_mm)]
                    touched = marked[name][marked[name] <= row]
                    sticks += [(place, place, _TRACE_MM, GREEN) for place in _lifted(one.truth.surface_m[touched], z_mm)]
                    if one.touching[row]:
                        place = _lifted(one.truth.surface_m[row], z_mm)
                        sticks.append((place, place, _CONTACT_MM, BLUE))
                yield paint(passed.qpos[row], sticks)

    def _framed_mm(self) -> Array:
        """Points (n, 3) in millimetres that are to be seen: the objects' edges, the whiskers wherever they go, the flange above."""
        edges = [
            _lifted(free.object.outline_m(), MM_PER_M * z_m) for free in self.run.scene.objects for z_m in (0.0, free.height_m)
        ]
        lines = [_lifted(lines_m[::_FRAMED_ROWS].reshape(-1, 2), self._heights_mm[name]) for name, lines_m in self._lines_m.items()]
        flange = [
            _lifted(one.base_pose[::_FRAMED_ROWS, :2], MM_PER_M * (self.run.scene.path.height_m + LENGTH_M))
            for one in self._passed.whiskers.values()
        ]
        return np.concatenate((*edges, *lines, *flange))


def replayed_passage(_: Run, passed: Passed) -> tuple[mujoco.MjModel, Array]:
    """Model of a simulated passage and its coordinates (n, nq) at every row."""
    return passed.model, passed.qpos


Stick = tuple[Array, Array, float, Colour]
"""Ends (3,) and radius in millimetres of a rod with round ends, or of a ball where both ends are the same; and its colour."""


@contextlib.contextmanager
def _painter(model: mujoco.MjModel, framed_mm: Array, most_sticks: int) -> Iterator[Callable[[Array, list[Stick]], Image.Image]]:
    """Gives a function that draws the model at its coordinates (nq,) with up to `most_sticks` rods and balls added.

    The points `framed_mm` (n, 3) fill the picture. The model's own whiskers are not drawn.

    Raises `SimulationError` where there is no OpenGL to draw with.
    """
    width, height = _OVERSAMPLING * _WIDTH, _OVERSAMPLING * _HEIGHT
    try:
        # On Linux without a display MuJoCo would look for one all the same.
        if sys.platform == "linux":
            from mujoco.egl import GLContext
        else:
            from mujoco import GLContext
        context = GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError) as error:
        raise SimulationError(f"a picture in perspective needs OpenGL (on Linux: EGL), found none: {error}") from None
    try:
        context.make_current()
        # The picture is drawn larger and shrunk, which smooths every edge; OpenGL would take as long again for it.
        model.vis.quality.offsamples = 0
        model.vis.quality.numslices = _SLICES
        model.vis.headlight.ambient[:] = _AMBIENT
        model.vis.global_.fovy = _FIELD_DEG
        model.geom_rgba[_is_of_whiskers(model), 3] = 0.0
        drawn = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_resizeOffscreen(width, height, drawn)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, drawn)
        data, option = mujoco.MjData(model), mujoco.MjvOption()
        scene = mujoco.MjvScene(model, model.ngeom + most_sticks)
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        camera = _camera(framed_mm)
        field, pixels = mujoco.MjrRect(0, 0, width, height), np.empty((height, width, 3), dtype=np.uint8)

        def paint(qpos: Array, sticks: list[Stick]) -> Image.Image:
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            for stick in sticks:
                _add(scene, *stick)
            mujoco.mjr_render(field, scene, drawn)
            mujoco.mjr_readPixels(pixels, None, field, drawn)
            return Image.fromarray(pixels[::-1]).reduce(_OVERSAMPLING)

        yield paint
    finally:
        context.free()


def _camera(framed_mm: Array) -> mujoco.MjvCamera:
    """A camera whose picture the points (n, 3) fill.

    With a, b and c the distances of a point from where the camera looks, to the right, up and away from it, the camera's distance
    d has |b| <= s (d + c) and |a| <= s (d + c) width / height, where s is the tangent of half the field that may be used. It looks
    at the middle of the box around the points at first, and then at where the middle of their picture is.
    """
    azimuth, elevation = np.radians((_AZIMUTH_DEG, _ELEVATION_DEG))
    ahead = np.array((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)))
    right = np.array((np.sin(azimuth), -np.cos(azimuth), 0.0))
    axes = np.stack((right, np.cross(right, ahead), ahead))
    share = _FIELD_SHARE * np.tan(0.5 * np.radians(_FIELD_DEG))
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG
    camera.lookat[:] = _middle(framed_mm)
    for _ in range(_CENTERINGS):
        a, b, c = axes @ (framed_mm - camera.lookat).T
        distance_mm = np.max(np.maximum(np.abs(b), np.abs(a) * _HEIGHT / _WIDTH) / share - c)
        seen = np.stack((a, b), axis=-1) / (distance_mm + c)[:, None]
        camera.distance = distance_mm
        camera.lookat[:] += distance_mm * _middle(seen) @ axes[:2]
    return camera


def _middle(points: Array) -> Array:
    """Middle (m,) of the box around `points` (n, m)."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def _is_of_whiskers(model: mujoco.MjModel) -> Array:
    """Which of the model's geoms belong to whiskers."""
    bodies = [model.body(body).name for body in model.geom_bodyid]
    return np.array([body.startswith(tuple(f"{mount.name}_" for mount in MOUNTS)) for body in bodies])


def _add(scene: mujoco.MjvScene, start_mm: Array, end_mm: Array, radius_mm: float, colour: Colour) -> None:
    shape = scene.geoms[scene.ngeom]
    rgba = np.array((*colour, 255), dtype=np.float32) / 255.0
    ball = np.array_equal(start_mm, end_mm)
    kind = mujoco.mjtGeom.mjGEOM_SPHERE if ball else mujoco.mjtGeom.mjGEOM_CAPSULE
    mujoco.mjv_initGeom(shape, kind, np.full(3, radius_mm), start_mm, np.eye(3).ravel(), rgba)
    if not ball:
        mujoco.mjv_connector(shape, kind, radius_mm, start_mm, end_mm)
    shape.emission = 0.5
    scene.ngeom += 1


def _apart(places_m: Array, touching: Array) -> Array:
    """Rows at which the whisker touches `_TRACE_APART_M` away from the place marked before."""
    rows, last_m = [], np.full(2, np.inf)
    for row in np.flatnonzero(touching):
        if not np.hypot(*(places_m[row] - last_m)) < _TRACE_APART_M:
            rows.append(row)
            last_m = places_m[row]
    return np.array(rows, dtype=int)


def _lifted(points_m: Array, z_mm: float) -> Array:
    """Points (..., 3) in millimetres at the height `z_mm`, of points (..., 2) of the plane."""
    return np.concatenate((MM_PER_M * points_m, np.full((*points_m.shape[:-1], 1), z_mm)), axis=-1)
