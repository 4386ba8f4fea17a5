"""Registry of solids: one file and one row per solid."""

from whisker_sim.space.solids.base import Nearest, Solid
from whisker_sim.space.solids.box import Box
from whisker_sim.space.solids.cone import Cone
from whisker_sim.space.solids.cylinder import Cylinder
from whisker_sim.space.solids.mesh import Mesh
from whisker_sim.space.solids.pin import ThinRod
from whisker_sim.space.solids.sphere import Sphere
from whisker_sim.space.solids.torus import Torus

AnySolid = (
    ThinRod  #
    | Sphere
    | Cylinder
    | Cone
    | Box
    | Torus
    | Mesh
)
"""Solids that the key `shape` of a spatial scene's `solid` may name."""

__all__ = ["AnySolid", "Nearest", "Solid"]
