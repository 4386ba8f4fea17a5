"""Two views of a sweep in space: from above and from the side, with the whisker, the solid, the contact, its normal and force.

Both are parallel projections: the plan view shows x and y of World, the side view x and z. Solids appear as the curves of their
surface. No graphics driver is needed.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageFont

from whisker_sim import drawing
from whisker_sim.drawing import BLUE, EDGE, INK, OVERSAMPLING, PAPER, VERMILION, Pen, largest_round
from whisker_sim.model import MM_PER_M
from whisker_sim.runs import Run
from whisker_sim.space.model import BASE_COORDINATES
from whisker_sim.space.simulate import SpatialSimulated
from whisker_sim.space.truth import CenterCurve
from whisker_sim.whisker import Array

_WIDTH, _FIELD_HEIGHT, _MARGIN, _CAPTION_HEIGHT, _FONT_SIZE = 640, 300, 16, 40, 15
_ARROW_SHARE = 0.2
"""Length of the arrow of the largest force, relative to the length of the whisker."""
_BEYOND_SHARE = 0.3
"""Extent of the solid beyond the reach of the whisker that is shown, relative to the length of the whisker."""
_BASE_LENGTH_SHARE = 0.04
_LONGEST_SAMPLE = 70.0
_VIEWS = ((0, 1, "from above"), (0, 2, "from the side"))
"""Coordinates to the right and upwards, and the name of each view."""


class SpatialRenderer:
    """Frames of a simulated sweep in space."""

    sources = (Path(__file__), Path(drawing.__file__))
    frames_hz = 12.5
    lossless = True

    def __init__(self, run: Run, simulated: SpatialSimulated) -> None:
        self.run, self._simulated = run, simulated
        whisker, truth = run.scene.spatial_whisker, simulated.truth
        joints_rad = simulated.coordinates[:, BASE_COORDINATES:]
        self._line_m = CenterCurve.from_joints(whisker, simulated.position_m, simulated.rotation, joints_rad).points_m
        self._length_m = whisker.whisker.length_m
        self._curves_m = simulated.solid.curves_m()
        largest_n = np.max(np.linalg.norm(simulated.force_n, axis=1))
        m_per_n = _ARROW_SHARE * self._length_m / largest_n if largest_n > 0.0 else 0.0
        self._arrow_end_m = truth.surface_m + m_per_n * simulated.force_n
        self._fit_views()
        self._font = ImageFont.load_default(OVERSAMPLING * _FONT_SIZE)

    @property
    def rate_hz(self) -> float:
        """Number of instants per second."""
        return self.run.scene.rate_hz

    @property
    def rows(self) -> int:
        """Number of instants."""
        return len(self._simulated.time_s)

    @property
    def still_row(self) -> int:
        """Row of the largest reading; the last of several within 1 %."""
        reading = np.linalg.norm(self._simulated.moment_n_m, axis=1)
        return int(np.flatnonzero(reading >= 0.99 * np.max(reading))[-1])

    def frames(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """Frames at `rows`, which ascend; each shows the previous contact points."""
        touched = (self._simulated.truth.surface_m, self._simulated.touching)
        return drawing.frames(rows, self._background(), touched, self._in_views, self._draw_instant)

    def _draw_instant(self, pen: Pen, row: int) -> None:
        simulated = self._simulated
        back_m = simulated.position_m[row] - _BASE_LENGTH_SHARE * self._length_m * simulated.rotation[row, :, 0]
        for view in range(len(_VIEWS)):
            pen.line(self._to_pixels(np.stack((back_m, simulated.position_m[row])), view), 9.0, INK)
            pen.line(self._to_pixels(self._line_m[row], view), 3.0, VERMILION)
            if simulated.touching[row]:
                surface = self._to_pixels(simulated.truth.surface_m[row], view)
                pen.arrow(surface, self._to_pixels(self._arrow_end_m[row], view), BLUE)
                pen.ring(surface, 6.0, BLUE)
        time = f"t = {simulated.time_s[row]:.2f} s"
        pen.text((_WIDTH - _MARGIN, _CAPTION_HEIGHT / 2), time, self._font, anchor="rm")

    def _fit_views(self) -> None:
        """Chooses the part of space that both views show: the reach of the whisker, and the solid near it."""
        reached_m = np.concatenate((self._line_m.reshape(-1, 3), self._arrow_end_m[self._simulated.touching]))
        low_m, high_m = reached_m.min(axis=0), reached_m.max(axis=0)
        beyond_m = _BEYOND_SHARE * self._length_m
        near_m = np.clip(np.concatenate(self._curves_m), low_m - beyond_m, high_m + beyond_m)
        low_m, high_m = np.minimum(low_m, near_m.min(axis=0)), np.maximum(high_m, near_m.max(axis=0))
        extent_m = high_m - low_m
        across, up = _WIDTH - 2.0 * _MARGIN, _FIELD_HEIGHT - 2.0 * _MARGIN
        self._per_m = min(across / extent_m[0], up / max(extent_m[1], extent_m[2]))
        self._center_m = 0.5 * (low_m + high_m)

    def _to_pixels(self, points_m: Array, view: int) -> Array:
        """Points (..., 3) of World in pixels of a view."""
        right, up, _ = _VIEWS[view]
        center = (0.5 * _WIDTH, _CAPTION_HEIGHT + (view + 0.5) * _FIELD_HEIGHT)
        return center + self._per_m * (points_m - self._center_m)[..., [right, up]] * (1.0, -1.0)

    def _in_views(self, point_m: Array) -> list[Array]:
        """A point (3,) of World in pixels of each view."""
        return [self._to_pixels(point_m, view) for view in range(len(_VIEWS))]

    def _background(self) -> Image.Image:
        """Constant part of all frames, oversampled: solid, names of the views, scale."""
        height = _CAPTION_HEIGHT + len(_VIEWS) * _FIELD_HEIGHT
        picture = Image.new("RGB", (OVERSAMPLING * _WIDTH, OVERSAMPLING * height), PAPER)
        for view, (_, _, name) in enumerate(_VIEWS):
            field = Image.new("RGB", (OVERSAMPLING * _WIDTH, OVERSAMPLING * height), PAPER)
            pen = Pen(field)
            for curve_m in self._curves_m:
                pen.line(self._to_pixels(curve_m, view), 1.0, EDGE)
            # The solid may extend beyond the field of its view.
            top = _CAPTION_HEIGHT + view * _FIELD_HEIGHT
            box = tuple(OVERSAMPLING * edge for edge in (0, top, _WIDTH, top + _FIELD_HEIGHT))
            picture.paste(field.crop(box), box)
            Pen(picture).text((_MARGIN, top + _MARGIN), name, self._font, anchor="lm")
        pen = Pen(picture)
        pen.text((_MARGIN, _CAPTION_HEIGHT / 2), self.run.name, self._font, anchor="lm")
        bar_m = largest_round(_LONGEST_SAMPLE / self._per_m)
        end, y = _WIDTH - _MARGIN, height - _MARGIN
        pen.line(np.array(((end - self._per_m * bar_m, y), (end, y))), 1.5, INK)
        pen.text((end - self._per_m * bar_m - 6.0, y), f"{MM_PER_M * bar_m:g} mm", self._font, anchor="rm")
        return picture
