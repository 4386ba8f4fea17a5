"""Circular cylinder."""

from typing import Any, ClassVar

from whisker_sim.shapes.round import Round


class Circle(Round, frozen=True, forbid_unknown_fields=True, tag="circle"):
    """Upright cylinder."""

    example: ClassVar[dict[str, Any]] = {"radius_m": 0.015}
