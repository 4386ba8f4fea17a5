"""Free-standing objects of scenes; `table` and `yielding` build their models."""

from typing import Annotated

import msgspec

from whisker_sim.shapes import AnyShape
from whisker_sim.whisker import WORD, Dimension, Positive

TableFriction = Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]
"""Coefficient of Coulomb friction between an object and the table."""


class Stand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Free stand of the object of a sweep: it slides on the table and turns about the vertical, and does not tip."""

    mass_kg: Annotated[float, msgspec.Meta(ge=1e-4, le=1.0)]
    friction: TableFriction = 0.5


class FreeObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An object that stands freely on the table."""

    name: Annotated[str, msgspec.Meta(pattern=WORD, max_length=40)]
    object: AnyShape
    mass_kg: Positive
    height_m: Dimension
    friction: TableFriction = 0.5

    def __post_init__(self) -> None:
        if not self.object.convex:
            raise ValueError(f"object.shape: expected a convex shape, found '{self.object.__struct_config__.tag}'")
        if not self.object.upright:
            raise ValueError(f"object.shape: expected a shape with upright sides, found '{self.object.__struct_config__.tag}'")
