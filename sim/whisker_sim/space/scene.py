"""Scenes in space, as they are written by users and as they are simulated."""

from typing import Annotated, Literal

import msgspec

from whisker_sim.rod import Suspension
from whisker_sim.scene import Seed, Simulation, SweepScene, random_stream
from whisker_sim.space.motions import AnySpatialMotion, SpatialPlan, SpatialStage
from whisker_sim.space.solids import AnySolid, Solid
from whisker_sim.space.whisker import SpatialWhisker
from whisker_sim.whisker import Name, Positive, Whisker, WhiskerOverride

_SEGMENTS = 24
"""Segments of a whisker in space unless the scene states others, by the convergence study `space_chain`."""


class SpatialScene(SweepScene, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One experiment in space: whisker, solid and motion.

    The root's springs `suspension` are by default equally stiff about every axis, with the whisker's `root_stiffness_n_m_rad`. The
    Poisson ratio of nitinol, 0.33, gives the stiffness in twist.
    """

    format: Literal[2]
    name: Name
    role: Literal["trial", "calibration"]
    group: Name
    whisker: str | WhiskerOverride
    solid: AnySolid
    motion: AnySpatialMotion
    suspension: Suspension | None = None
    poisson_ratio: Annotated[float, msgspec.Meta(gt=-1.0, le=0.5)] = 0.33
    segments: Annotated[int, msgspec.Meta(ge=2, le=200)] = _SEGMENTS
    seed: Seed = 0
    duration_s: Positive | None = None
    rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=1e5)] = 250.0
    simulation: str | Simulation = Simulation()

    @property
    def resolved_whisker(self) -> Whisker:
        """Parameters of the whisker in its own plane, with the segments of this scene."""
        return msgspec.structs.replace(super().resolved_whisker, segments=self.segments)

    @property
    def resolved_suspension(self) -> Suspension:
        """The springs of the root."""
        stiffness = self.resolved_whisker.root_stiffness_n_m_rad
        return self.suspension or Suspension(stiffness, stiffness, stiffness)

    @property
    def spatial_whisker(self) -> SpatialWhisker:
        """The whisker in space."""
        return SpatialWhisker(self.resolved_whisker, self.resolved_suspension, self.poisson_ratio)

    @property
    def shape(self) -> str:
        """Name of the solid in its registry."""
        return self.solid.__struct_config__.tag

    def plan(self, solid: Solid) -> SpatialPlan:
        """The motion about `solid`, that of the scene with its files; raises `ValueError` if the geometry does not allow it."""
        stage = SpatialStage(
            whisker=self.spatial_whisker,
            solid=solid,
            timestep_s=self.simulation.timestep_s,
            duration_s=self.duration_s,
            rng=random_stream(self.name, self.seed),
        )
        return self.motion.plan(stage)
