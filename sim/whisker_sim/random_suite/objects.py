"""Random objects: one row per kind, with its weight."""

from collections.abc import Callable

import msgspec
import numpy as np

from whisker_sim.random_suite.draw import log_uniform, uniform, weighted
from whisker_sim.shapes import AnyShape, Circle, ConvexPolygon, Ellipse, Pin, Rectangle, RegularPolygon, RoundedPolygon, Stadium


class Kind(msgspec.Struct, frozen=True):
    """A kind of object."""

    name: str
    draw: Callable[[np.random.Generator], AnyShape]
    """Draws an object at the origin."""
    yaw_rad: tuple[float, float] = (0.0, 2.0 * np.pi)
    """Range of its orientation; the whisker touches from below, along the y axis of World."""

    def placed(self, shape: AnyShape, rng: np.random.Generator) -> AnyShape:
        """The object at a random pose."""
        center_m = (uniform(rng, -0.2, 0.2, 4), uniform(rng, -0.2, 0.2, 4))
        return msgspec.structs.replace(shape, center_m=center_m, yaw_rad=uniform(rng, *self.yaw_rad, 4))


def _pin(rng: np.random.Generator) -> Pin:
    return Pin(radius_m=log_uniform(rng, 0.3e-3, 1e-3))


def _circle(rng: np.random.Generator) -> Circle:
    return Circle(radius_m=log_uniform(rng, 1e-3, 0.1))


def _ellipse(rng: np.random.Generator) -> Ellipse:
    semi_m = log_uniform(rng, 4e-3, 0.06)
    return Ellipse(semi_x_m=semi_m, semi_y_m=round(semi_m * uniform(rng, 0.25, 0.9), 6))


def _stadium(rng: np.random.Generator) -> Stadium:
    return Stadium(flat_m=log_uniform(rng, 2e-3, 0.04), radius_m=log_uniform(rng, 2e-3, 0.03))


def _rectangle(rng: np.random.Generator) -> Rectangle:
    return Rectangle(width_m=log_uniform(rng, 8e-3, 0.08), height_m=log_uniform(rng, 8e-3, 0.08))


def _plate(rng: np.random.Generator) -> Rectangle:
    return Rectangle(width_m=log_uniform(rng, 0.02, 0.08), height_m=log_uniform(rng, 5e-4, 3e-3))


def _regular_polygon(rng: np.random.Generator) -> RegularPolygon:
    sides = int(rng.integers(3, 13))
    return RegularPolygon(sides=sides, side_m=round(2.0 * log_uniform(rng, 6e-3, 0.05) * float(np.sin(np.pi / sides)), 6))


def _vertices_m(rng: np.random.Generator, low_m: float, high_m: float) -> tuple[tuple[float, float], ...]:
    """Irregular convex polygon: points of an ellipse at random parameters, no two closer than a fifth of the mean step."""
    count = int(rng.integers(3, 11))
    gaps = 0.2 + rng.dirichlet(np.full(count, 2.0)) * count * 0.8
    t = 2.0 * np.pi * np.cumsum(gaps) / count
    semi_m = log_uniform(rng, low_m, high_m)
    points_m = semi_m * np.stack((np.cos(t), uniform(rng, 0.5, 1.0) * np.sin(t)), axis=-1)
    return tuple((round(float(x), 6), round(float(y), 6)) for x, y in points_m - points_m.mean(axis=0))


def _convex_polygon(rng: np.random.Generator) -> ConvexPolygon:
    return ConvexPolygon(vertices_m=_vertices_m(rng, 8e-3, 0.05))


def _rounded_polygon(rng: np.random.Generator) -> RoundedPolygon:
    return RoundedPolygon(vertices_m=_vertices_m(rng, 6e-3, 0.04), radius_m=log_uniform(rng, 1e-3, 8e-3))


KINDS: tuple[tuple[float, Kind], ...] = (
    (0.12, Kind("pin", _pin)),
    (0.20, Kind("circle", _circle)),
    (0.13, Kind("ellipse", _ellipse)),
    (0.09, Kind("stadium", _stadium)),
    (0.11, Kind("rectangle", _rectangle)),
    (0.10, Kind("regular_polygon", _regular_polygon)),
    (0.10, Kind("convex_polygon", _convex_polygon)),
    (0.09, Kind("rounded_polygon", _rounded_polygon)),
    (0.03, Kind("plate_edge", _plate, (0.5 * np.pi - 0.5, 0.5 * np.pi + 0.5))),
    (0.03, Kind("plate_side", _plate, (-0.5, 0.5))),
)
"""Kinds of objects with their weights."""


def random_kind(rng: np.random.Generator) -> Kind:
    """A kind of object."""
    return weighted(rng, KINDS)
