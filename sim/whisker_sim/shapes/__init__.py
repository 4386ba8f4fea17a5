"""Registry of object shapes: one file and one row per shape."""

from whisker_sim.shapes.base import CHORD_ERROR_M, Shape
from whisker_sim.shapes.circle import Circle
from whisker_sim.shapes.convex_polygon import ConvexPolygon
from whisker_sim.shapes.cup import Cup
from whisker_sim.shapes.discs import Discs
from whisker_sim.shapes.ellipse import Ellipse
from whisker_sim.shapes.l import L
from whisker_sim.shapes.pin import Pin
from whisker_sim.shapes.rectangle import Rectangle
from whisker_sim.shapes.regular_polygon import RegularPolygon
from whisker_sim.shapes.rounded_polygon import RoundedPolygon
from whisker_sim.shapes.stadium import Stadium
from whisker_sim.shapes.star import Star
from whisker_sim.shapes.step import Step

AnyShape = (
    Pin  #
    | Circle
    | Rectangle
    | RegularPolygon
    | Ellipse
    | Stadium
    | ConvexPolygon
    | RoundedPolygon
    | L
    | Star
    | Cup
    | Discs
    | Step
)
"""Shapes that the key `shape` of a scene's `object` may name."""

__all__ = ["CHORD_ERROR_M", "AnyShape", "Shape"]
