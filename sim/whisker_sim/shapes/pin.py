"""A thin dowel pin."""

from typing import Any, ClassVar

from whisker_sim.shapes.round import Round
from whisker_sim.whisker import Length


class Pin(Round, frozen=True, forbid_unknown_fields=True, tag="pin"):
    """Thin dowel pin, 1 mm thick unless the radius says otherwise."""

    radius_m: Length = 0.5e-3

    example: ClassVar[dict[str, Any]] = {}
