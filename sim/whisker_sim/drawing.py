"""Plan view of a sweep: whisker, object, contact and force, drawn from the ground truth of the trace.

If the object moves, the view moves with it.

The physics is planar, so that a plan view is complete. No graphics driver is needed. Points of World are in metres; all other
lengths are pixels of the final frame, x to the right and y down.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from whisker_sim.model import MM_PER_M
from whisker_sim.runs import Run
from whisker_sim.simulate import Simulated
from whisker_sim.truth import CenterLine, turned
from whisker_sim.whisker import Array

Colour = tuple[int, int, int]

# Frames are drawn larger and reduced, which smooths all edges.
OVERSAMPLING = 3
_WIDTH, _MOST_FIELD_HEIGHT, _MARGIN = 640, 400, 16
_CAPTION_HEIGHT, _LEGEND_HEIGHT = 40, 44
_FONT_SIZE = 15
_WHISKER_WIDTH, _ARROW_WIDTH, _RING_WIDTH, _THIN_WIDTH = 3.0, 2.5, 2.0, 1.5
_RING_RADIUS, _TRACE_RADIUS = 6.0, 2.0
_HEAD_LENGTH, _HEAD_HALF_WIDTH = 10.0, 4.5
_BASE_LENGTH, _BASE_HALF_WIDTH = 9.0, 6.0
_FIELD_BORDER = 12.0
"""Margin around the view; the block of the base behind the root is within it."""
_LONGEST_SAMPLE = 70.0
"""Maximum length of the sample of a force or a length in the legend."""
_ARROW_SHARE = 0.2
"""Length of the arrow of the largest force, relative to the length of the whisker."""
_BEYOND_SHARE = 0.3
"""Extent of the object beyond the reach of the whisker that is shown, relative to the length of the whisker."""

# Distinguishable with any colour vision: Okabe and Ito, "Color Universal Design", 2008.
VERMILION, BLUE, GREEN = (213, 94, 0), (0, 114, 178), (0, 158, 115)
PAPER, INK, _BODY, EDGE = (255, 255, 255), (40, 40, 40), (226, 230, 235), (128, 137, 148)
_SHADES = 7
"""Number of shades between two adjacent colours."""


class SweepRenderer:
    """Frames of a simulated sweep."""

    sources = (Path(__file__),)
    frames_hz = 12.5
    lossless = True
    """Flat colours compress better without loss."""

    def __init__(self, run: Run, simulated: Simulated) -> None:
        simulated = simulated.relative_to_object()
        self.run, self._scene, self._simulated = run, run.scene, simulated
        whisker, truth = run.scene.resolved_whisker, simulated.truth
        self._line_m = CenterLine.from_joints(whisker, simulated.base_pose, simulated.rotations_rad).points_m
        largest_n = np.max(simulated.force_n)
        self._m_per_n = _ARROW_SHARE * whisker.length_m / largest_n if largest_n > 0.0 else 0.0
        # Without friction the force is normal to the surface, along the line from there to the centre line; friction turns it
        # towards the tip or the root.
        arrow_m = truth.normal
        if simulated.friction is not None:
            side = 1.0 if run.scene.face == "left" else -1.0
            arrow_m = turned(arrow_m, side * simulated.friction.angle_rad)
        self._arrow_end_m = truth.surface_m + (self._m_per_n * simulated.force_n)[:, None] * arrow_m
        self._fit_view()
        self._font = ImageFont.load_default(OVERSAMPLING * _FONT_SIZE)

    @property
    def rate_hz(self) -> float:
        """Number of instants per second."""
        return self._scene.rate_hz

    @property
    def rows(self) -> int:
        """Number of instants."""
        return len(self._simulated.time_s)

    @property
    def still_row(self) -> int:
        """Row of the largest reading; the last of several within 1 %, because most contacts have been traced by then."""
        reading = np.abs(self._simulated.rotations_rad[:, 0])
        return int(np.flatnonzero(reading >= 0.99 * np.max(reading))[-1])

    def frames(self, rows: Iterable[int]) -> Iterator[Image.Image]:
        """Frames at `rows`, which ascend; each shows the previous contact points."""
        touched = (self._simulated.truth.surface_m, self._simulated.touching)
        return frames(rows, self._background(), touched, lambda surface_m: [self._to_pixels(surface_m)], self._draw_instant)

    def _draw_instant(self, pen: "Pen", row: int) -> None:
        simulated = self._simulated
        pen.line(self._to_pixels(self._line_m[row]), _WHISKER_WIDTH, VERMILION)
        x_m, y_m, yaw_rad = simulated.base_pose[row]
        back = -np.array((math.cos(yaw_rad), -math.sin(yaw_rad)))
        side = _BASE_HALF_WIDTH * np.array((-back[1], back[0]))
        root, end = (self._to_pixels(np.array((x_m, y_m))) + length * back for length in (0.0, _BASE_LENGTH))
        pen.polygon(np.array((root - side, root + side, end + side, end - side)), INK)
        if simulated.touching[row]:
            surface = self._to_pixels(simulated.truth.surface_m[row])
            pen.arrow(surface, self._to_pixels(self._arrow_end_m[row]), BLUE)
            pen.ring(surface, _RING_RADIUS, BLUE)
        time = f"t = {simulated.time_s[row]:.2f} s"
        pen.text((_WIDTH - _MARGIN, _CAPTION_HEIGHT / 2), time, self._font, anchor="rm")

    def _fit_view(self) -> None:
        """Chooses the section of the plane that is shown: the reach of the whisker, and the object near it."""
        simulated = self._simulated
        reached_m = np.concatenate((self._line_m.reshape(-1, 2), self._arrow_end_m[simulated.touching]))
        low_m, high_m = reached_m.min(axis=0), reached_m.max(axis=0)
        beyond_m = _BEYOND_SHARE * self._scene.resolved_whisker.length_m
        near_m = np.clip(self._scene.object.outline_m(), low_m - beyond_m, high_m + beyond_m)
        low_m, high_m = np.minimum(low_m, near_m.min(axis=0)), np.maximum(high_m, near_m.max(axis=0))
        width_m, height_m = high_m - low_m
        across, up = _WIDTH - 2.0 * (_MARGIN + _FIELD_BORDER), _MOST_FIELD_HEIGHT - 2.0 * _FIELD_BORDER
        self._per_m = min(across / width_m, up / height_m)
        self._bottom = _CAPTION_HEIGHT + math.ceil(self._per_m * height_m + 2.0 * _FIELD_BORDER)
        self._center_m = 0.5 * (low_m + high_m)

    def _to_pixels(self, points_m: Array) -> Array:
        """Points (..., 2) of World in pixels."""
        center = (0.5 * _WIDTH, 0.5 * (_CAPTION_HEIGHT + self._bottom))
        return center + self._per_m * (points_m - self._center_m) * (1.0, -1.0)

    def _background(self) -> Image.Image:
        """Constant part of all frames, oversampled: object, name and legend."""
        height = self._bottom + _LEGEND_HEIGHT
        picture = Image.new("RGB", (OVERSAMPLING * _WIDTH, OVERSAMPLING * height), PAPER)
        pen = Pen(picture)
        outline = self._to_pixels(self._scene.object.outline_m())
        pen.polygon(outline, _BODY)
        pen.line(outline, _THIN_WIDTH, EDGE)
        # The object may extend beyond the edges of the view.
        for top, bottom in ((0, _CAPTION_HEIGHT), (self._bottom, height)):
            pen.polygon(np.array(((0, top), (_WIDTH, top), (_WIDTH, bottom), (0, bottom))), PAPER)
        pen.text((_MARGIN, _CAPTION_HEIGHT / 2), self.run.name, self._font, anchor="lm")
        self._draw_legend(pen, self._bottom + _LEGEND_HEIGHT / 2)
        return picture

    def _draw_legend(self, pen: "Pen", y: float) -> None:
        """Draws a row of labelled samples, spread over the width."""
        bar_m = largest_round(_LONGEST_SAMPLE / self._per_m)
        bar = self._per_m * bar_m

        def whisker(x: float) -> None:
            pen.line(np.array(((x, y), (x + 22.0, y))), _WHISKER_WIDTH, VERMILION)

        def contact(x: float) -> None:
            pen.ring((x + _RING_RADIUS, y), _RING_RADIUS, BLUE)

        def trace(x: float) -> None:
            for step in range(4):
                pen.dot((x + _TRACE_RADIUS + 6.0 * step, y), _TRACE_RADIUS, GREEN)

        def scale(x: float) -> None:
            pen.line(np.array(((x, y), (x + bar, y))), _THIN_WIDTH, INK)
            for end in (x, x + bar):
                pen.line(np.array(((end, y - 4.0), (end, y + 4.0))), _THIN_WIDTH, INK)

        samples: list[tuple[Callable[[float], None], float, str]] = [
            (whisker, 22.0, "whisker"),
            (contact, 2.0 * _RING_RADIUS, "contact"),
            (trace, 18.0 + 2.0 * _TRACE_RADIUS, "previous contacts"),
            (scale, bar, f"{MM_PER_M * bar_m:g} mm"),
        ]
        if self._m_per_n > 0.0:
            per_n = self._per_m * self._m_per_n
            force_n = largest_round(_LONGEST_SAMPLE / per_n)
            arrow = per_n * force_n

            def force(x: float) -> None:
                pen.arrow(np.array((x, y)), np.array((x + arrow, y)), BLUE)

            samples.insert(3, (force, arrow, f"force, {1e3 * force_n:g} mN"))
        gap = 6.0
        widths = [width + gap + self._font.getlength(text) / OVERSAMPLING for _, width, text in samples]
        between = (_WIDTH - 2.0 * _MARGIN - sum(widths)) / (len(samples) - 1)
        x = float(_MARGIN)
        for (draw, sample_width, text), width in zip(samples, widths, strict=True):
            draw(x)
            pen.text((x + sample_width + gap, y), text, self._font, anchor="lm")
            x += width + between


def frames(
    rows: Iterable[int],
    background: Image.Image,
    touched: tuple[Array, NDArray[np.bool_]],
    to_pixels: Callable[[Array], list[Array]],
    draw_instant: Callable[["Pen", int], None],
) -> Iterator[Image.Image]:
    """Frames at `rows`, which ascend: `draw_instant` on the oversampled `background`, with the previous contact points.

    `touched` holds the surface points (n, k) of all instants and the mask (n,) of those in contact; `to_pixels` returns the places
    of a point in the frame.
    """
    surface_m, touching = touched
    traced = 0
    for row in rows:
        pen = Pen(background)
        for point_m in surface_m[traced : row + 1][touching[traced : row + 1]]:
            for place in to_pixels(point_m):
                pen.dot(place, _TRACE_RADIUS, GREEN)
        traced = row + 1
        picture = background.copy()
        draw_instant(Pen(picture), row)
        yield picture.reduce(OVERSAMPLING).quantize(palette=palette(), dither=Image.Dither.NONE)


class Pen:
    """Draws on an oversampled picture, in pixels of the final frame."""

    def __init__(self, picture: Image.Image) -> None:
        self._draw = ImageDraw.Draw(picture)

    def line(self, points: Array, width: float, colour: Colour) -> None:
        """A line through `points` (n, 2) with round corners."""
        self._draw.line(_oversampled(points), fill=colour, width=round(OVERSAMPLING * width), joint="curve")

    def polygon(self, points: Array, colour: Colour) -> None:
        """The filled polygon with the corners `points` (n, 2)."""
        self._draw.polygon(_oversampled(points), fill=colour)

    def dot(self, center: Iterable[float], radius: float, colour: Colour) -> None:
        """A filled circle."""
        self._draw.ellipse(_box(center, radius), fill=colour)

    def ring(self, center: Iterable[float], radius: float, colour: Colour) -> None:
        """A circle with a transparent interior."""
        self._draw.ellipse(_box(center, radius), outline=colour, width=round(OVERSAMPLING * _RING_WIDTH))

    def arrow(self, start: Array, end: Array, colour: Colour) -> None:
        """An arrow with its tip at `end`; a short one consists of the head only."""
        length = float(np.hypot(*(end - start)))
        if length == 0.0:
            return
        along = (end - start) / length
        share = min(1.0, length / _HEAD_LENGTH)
        neck = end - share * _HEAD_LENGTH * along
        wing = share * _HEAD_HALF_WIDTH * np.array((-along[1], along[0]))
        self.line(np.array((start, neck)), _ARROW_WIDTH, colour)
        self.polygon(np.array((end, neck + wing, neck - wing)), colour)

    def text(self, position: tuple[float, float], text: str, font: ImageFont.FreeTypeFont, anchor: str) -> None:
        """Text at `position`, with an `anchor` as defined by Pillow."""
        self._draw.text(tuple(_oversampled(np.array(position))), text, fill=INK, font=font, anchor=anchor)


def _oversampled(points: Array) -> list[float]:
    return (OVERSAMPLING * points).ravel().tolist()


def _box(center: Iterable[float], radius: float) -> list[float]:
    x, y = center
    return _oversampled(np.array((x - radius, y - radius, x + radius, y + radius)))


def largest_round(most: float) -> float:
    """The largest number of the form 1, 2 or 5 times a power of ten that does not exceed `most` > 0."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor == 1.0 or factor * power <= most)


@functools.cache
def palette() -> Image.Image:
    """Colours of all frames and the shades between adjacent ones, which keeps files small and colours constant over time."""
    on_top = (VERMILION, BLUE, GREEN, INK, EDGE)
    meeting = [*itertools.product(on_top, (PAPER, _BODY)), *itertools.combinations((VERMILION, BLUE, GREEN), 2)]
    colours = {
        tuple(np.round(np.array(a) + share * np.subtract(b, a)).astype(int).tolist())
        for a, b in meeting
        for share in np.linspace(0.0, 1.0, _SHADES)
    }
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in sorted(colours) for value in colour])
    return palette
