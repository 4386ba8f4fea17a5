"""Thin dowel pin."""

from typing import Any, ClassVar

from whisker_sim.shapes.round import Round
from whisker_sim.whisker import Dimension


class Pin(Round, frozen=True, forbid_unknown_fields=True, tag="pin"):
    """Thin dowel pin, by default 1 mm in diameter."""

    radius_m: Dimension = 0.5e-3

    example: ClassVar[dict[str, Any]] = {}
