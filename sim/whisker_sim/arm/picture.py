"""Perspective view of an arm between its objects: MuJoCo's rendering with whiskers, contacts and previous contact points.

Whiskers are drawn several times thicker than they are, because a wire of 0.25 mm would be invisible. There are no shadows,
because that of a whisker looks like another whisker. Colours are those of `whisker_sim.drawing`.
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
from whisker_sim.arm.simulate import SimulatedPassage
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
_TRACE_SPACING_M = 1e-3
"""Minimum distance between two marked contact points."""
_AZIMUTH_DEG, _ELEVATION_DEG = 162.0, -40.0
"""Direction of the view, towards an arm that faces along x; low enough that the arm, which comes from above, occludes little."""
_FIELD_DEG = 22.0
"""Vertical field of view; narrow, so that near and far objects have similar sizes."""
_FIELD_SHARE = 0.95
"""Share of the frame's width and height that objects and whiskers fill."""
_CENTERINGS = 4
_FRAMED_ROWS = 25
"""Stride of the instants at which whiskers are framed."""
_AMBIENT = 0.2
_SLICES = 96
"""Number of facets of round bodies, enough to appear smooth."""


class PassageRenderer:
    """Frames of a simulated passage."""

    sources = (Path(__file__), Path(drawing.__file__))
    frames_hz = 8.0
    lossless = False
    """Shaded surfaces compress far better with loss."""

    def __init__(self, run: Run, passed: SimulatedPassage) -> None:
        self.run, self._passed = run, passed
        whisker = run.scene.resolved_whisker
        self._heights_mm = {mount.name: MM_PER_M * (run.scene.path.height_m + mount.pose[2, 3]) for mount in MOUNTS}
        self._lines_m = {
            name: CenterLine.from_joints(whisker, one.base_pose, one.rotations_rad).points_m
            for name, one in passed.whiskers.items()
        }

    @property
    def rate_hz(self) -> float:
        """Number of instants per second."""
        return self.run.scene.rate_hz

    @property
    def rows(self) -> int:
        """Number of instants."""
        return len(self._passed.time_s)

    @property
    def still_row(self) -> int:
        """Row with the largest number of whiskers in contact; the last of several."""
        touching = np.sum([whisker.touching for whisker in self._passed.whiskers.values()], axis=0)
        return int(np.flatnonzero(touching == np.max(touching))[-1])

    def frames(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """Frames at `rows`, which ascend; each shows the previous contact points.

        Raises `SimulationError` if the machine has no OpenGL.
        """
        passed = self._passed
        marked = {name: _marked_rows(one.truth.surface_m, one.touching) for name, one in passed.whiskers.items()}
        most_sticks = sum(len(self._lines_m[name][0]) + len(marked[name]) + 1 for name in marked)
        with _painter(passed.model, self._framed_mm(), most_sticks) as paint:
            for row in rows:
                sticks: list[Stick] = []
                for name, one in passed.whiskers.items():
                    z_mm = self._heights_mm[name]
                    line_mm = _at_height(self._lines_m[name][row, ::2], z_mm)
                    sticks += [(start, end, _WHISKER_MM, VERMILION) for start, end in pairwise(line_mm)]
                    touched = marked[name][marked[name] <= row]
                    sticks += [(place, place, _TRACE_MM, GREEN) for place in _at_height(one.truth.surface_m[touched], z_mm)]
                    if one.touching[row]:
                        place = _at_height(one.truth.surface_m[row], z_mm)
                        sticks.append((place, place, _CONTACT_MM, BLUE))
                yield paint(passed.qpos[row], sticks)

    def _framed_mm(self) -> Array:
        """Points (n, 3) to be visible (mm): edges of the objects, whiskers at all times, the flange."""
        edges = [
            _at_height(free.object.outline_m(), MM_PER_M * z_m) for free in self.run.scene.objects for z_m in (0.0, free.height_m)
        ]
        lines = [
            _at_height(lines_m[::_FRAMED_ROWS].reshape(-1, 2), self._heights_mm[name]) for name, lines_m in self._lines_m.items()
        ]
        flange = [
            _at_height(one.base_pose[::_FRAMED_ROWS, :2], MM_PER_M * (self.run.scene.path.height_m + LENGTH_M))
            for one in self._passed.whiskers.values()
        ]
        return np.concatenate((*edges, *lines, *flange))


def replayed_passage(_: Run, passed: SimulatedPassage) -> tuple[mujoco.MjModel, Array]:
    """Model of a simulated passage and its coordinates (n, nq) at every row."""
    return passed.model, passed.qpos


Stick = tuple[Array, Array, float, Colour]
"""Ends (3,) and radius (mm) of a rod with round ends, or of a ball if both ends are equal; and its colour."""


@contextlib.contextmanager
def _painter(model: mujoco.MjModel, framed_mm: Array, most_sticks: int) -> Iterator[Callable[[Array, list[Stick]], Image.Image]]:
    """Yields a function that draws the model at its coordinates (nq,) with up to `most_sticks` rods and balls.

    The points `framed_mm` (n, 3) fill the frame. The whiskers of the model itself are not drawn.

    Raises `SimulationError` if there is no OpenGL.
    """
    width, height = _OVERSAMPLING * _WIDTH, _OVERSAMPLING * _HEIGHT
    try:
        # On Linux without a display MuJoCo would still try to open one.
        if sys.platform == "linux":
            from mujoco.egl import GLContext
        else:
            from mujoco import GLContext
        context = GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError) as error:
        raise SimulationError(f"a picture in perspective needs OpenGL (on Linux: EGL), found none: {error}") from None
    try:
        context.make_current()
        # The frame is drawn larger and reduced, which smooths all edges; OpenGL's multisampling would take twice the time.
        model.vis.quality.offsamples = 0
        model.vis.quality.numslices = _SLICES
        model.vis.headlight.ambient[:] = _AMBIENT
        model.vis.global_.fovy = _FIELD_DEG
        model.geom_rgba[_whisker_geoms(model), 3] = 0.0
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
    """A camera whose frame is filled by the points (n, 3).

    Let a, b and c be the offsets of a point from the look-at point to the right, up and away. The distance d of the camera
    satisfies |b| <= s (d + c) and |a| <= s (d + c) width / height, where s is the tangent of half of the usable field. The look-at
    point is initially the centre of the bounding box of the points, and is then moved to the centre of their image.
    """
    azimuth, elevation = np.radians((_AZIMUTH_DEG, _ELEVATION_DEG))
    ahead = np.array((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)))
    right = np.array((np.sin(azimuth), -np.cos(azimuth), 0.0))
    axes = np.stack((right, np.cross(right, ahead), ahead))
    share = _FIELD_SHARE * np.tan(0.5 * np.radians(_FIELD_DEG))
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = _AZIMUTH_DEG, _ELEVATION_DEG
    camera.lookat[:] = _center(framed_mm)
    for _ in range(_CENTERINGS):
        a, b, c = axes @ (framed_mm - camera.lookat).T
        distance_mm = np.max(np.maximum(np.abs(b), np.abs(a) * _HEIGHT / _WIDTH) / share - c)
        seen = np.stack((a, b), axis=-1) / (distance_mm + c)[:, None]
        camera.distance = distance_mm
        camera.lookat[:] += distance_mm * _center(seen) @ axes[:2]
    return camera


def _center(points: Array) -> Array:
    """Centre (m,) of the bounding box of `points` (n, m)."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def _whisker_geoms(model: mujoco.MjModel) -> Array:
    """Mask of the model's geoms that belong to whiskers."""
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


def _marked_rows(points_m: Array, touching: Array) -> Array:
    """Rows of the contact points that are at least `_TRACE_SPACING_M` away from the one marked before."""
    rows, last_m = [], np.full(2, np.inf)
    for row in np.flatnonzero(touching):
        if not np.hypot(*(points_m[row] - last_m)) < _TRACE_SPACING_M:
            rows.append(row)
            last_m = points_m[row]
    return np.array(rows, dtype=int)


def _at_height(points_m: Array, z_mm: float) -> Array:
    """Points (..., 3) (mm) at the height `z_mm` of points (..., 2) (m) of the plane."""
    return np.concatenate((MM_PER_M * points_m, np.full((*points_m.shape[:-1], 1), z_mm)), axis=-1)
