"""Fields and names common to the sets of random suites in the plane and in space."""

from typing import Annotated, Literal

import msgspec

from whisker_sim.scene import Format, SceneBase, Seed, Simulation
from whisker_sim.whisker import Name, WhiskerOverride


class DrawnScenes(SceneBase, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One set of a random suite, whose scenes are drawn by the method `draw` of its kind.

    It is drawn again as a whole if one of its traces is not possible; see `whisker_sim.random_suite.simulate`.
    """

    format: Format
    suite: Name
    seed: Seed
    index: Annotated[int, msgspec.Meta(ge=0)]
    traces: int
    whisker: str | WhiskerOverride
    simulation: Simulation = Simulation()

    role: Literal["trial"] = "trial"

    @property
    def name(self) -> str:
        """Name of the set, and its group."""
        return f"{self.suite}_{self.seed}_{self.index:04d}"

    @property
    def group(self) -> str:
        """Group of its traces."""
        return self.name

    def names(self, name: str) -> tuple[str, ...]:
        """Names in the dataset of its traces."""
        return tuple(f"{name}_{trace:02d}" for trace in range(self.traces))

    def plan(self) -> None:
        """Does not check anything: scenes that are not possible are drawn again."""
