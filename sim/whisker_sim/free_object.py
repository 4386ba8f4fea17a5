"""Free-standing objects of a scene; `table` builds their models."""

from typing import Annotated

import msgspec

from whisker_sim.shapes import AnyShape
from whisker_sim.whisker import Length, Positive


class FreeObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An object that stands freely on the table."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]*\Z", max_length=40)]
    object: AnyShape
    mass_kg: Positive
    height_m: Length
    friction: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 0.5
    """Coefficient of Coulomb friction between object and table."""

    def __post_init__(self) -> None:
        if not self.object.convex:
            raise ValueError(f"object.shape: expected a convex shape, found '{self.object.__struct_config__.tag}'")
        if not self.object.upright:
            raise ValueError(f"object.shape: expected a shape with upright sides, found '{self.object.__struct_config__.tag}'")
