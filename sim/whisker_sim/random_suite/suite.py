"""Documents of random suites, and the scenes that they define."""

from collections.abc import Iterator
from typing import Annotated

import msgspec

from whisker_sim.random_suite.contacts import RandomContactSet
from whisker_sim.random_suite.plane import RandomSet
from whisker_sim.random_suite.space import SpatialRandomSet, spatial_calibration_scene
from whisker_sim.random_suite.whiskers import CALIBRATION_SEEDS, FACES, STANDARD, calibration_scene, random_whisker
from whisker_sim.scene import Format, Scene, Seed, random_stream
from whisker_sim.space.scene import SpatialScene
from whisker_sim.whisker import Name, WhiskerOverride, resolve_whisker

Count = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]


class Draws(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Numbers of sets, traces and whiskers of a random suite, and its seed."""

    seed: Seed
    sets: Count
    traces: Annotated[int, msgspec.Meta(ge=1, le=99)] = 5
    """Traces of each set."""
    whiskers: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 8
    """Random whiskers, beside the presets `STANDARD`; in space there are the presets alone."""
    in_space: bool = False
    """Whether the scenes are scenes in space."""
    ideal: bool = True
    """Whether the contacts are without friction, on convex objects at rest; must be true with `in_space`."""

    def __post_init__(self) -> None:
        if self.in_space and not self.ideal:
            raise ValueError("ideal: expected true with `in_space`, found false; remove one of the two keys")


class RandomSuite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A suite whose scenes are drawn."""

    format: Format
    name: Name
    random: Draws

    @property
    def prefix(self) -> str:
        """Common prefix of the names of its traces."""
        return f"{self.name}_{self.random.seed}"

    def whisker(self, index: int) -> str | WhiskerOverride:
        """The whisker number `index`: the presets, then the random ones."""
        if index < len(STANDARD):
            return STANDARD[index]
        name = f"{self.prefix}_w{index - len(STANDARD):02d}"
        return random_whisker(name, random_stream(f"{self.name} whisker {index}", self.random.seed))

    def sets(self) -> Iterator[RandomSet | SpatialRandomSet]:
        """The sets."""
        return self._sets_in_space() if self.random.in_space else self._sets_in_plane()

    def _sets_in_space(self) -> Iterator[SpatialRandomSet]:
        for index in range(self.random.sets):
            rng = random_stream(f"{self.name} set {index} whisker", self.random.seed)
            whisker = STANDARD[int(rng.integers(len(STANDARD)))]
            yield SpatialRandomSet(self.format, self.name, self.random.seed, index, self.random.traces, whisker)

    def _sets_in_plane(self) -> Iterator[RandomSet]:
        kind = RandomSet if self.random.ideal else RandomContactSet
        for index in range(self.random.sets):
            rng = random_stream(f"{self.name} set {index} whisker", self.random.seed)
            is_standard = self.random.whiskers == 0 or rng.random() < 0.5
            number = rng.integers(len(STANDARD)) if is_standard else len(STANDARD) + rng.integers(self.random.whiskers)
            yield kind(
                format=self.format,
                suite=self.name,
                seed=self.random.seed,
                index=index,
                traces=self.random.traces,
                whisker=self.whisker(int(number)),
            )

    def calibrations(self) -> Iterator[Scene | SpatialScene]:
        """Scenes of the calibrations of all whiskers of the sets."""
        if self.random.in_space:
            for whisker in sorted({drawn.whisker for drawn in self.sets()}):
                yield spatial_calibration_scene(self.prefix, whisker)
            return
        whiskers = {resolve_whisker(drawn.whisker).name: drawn.whisker for drawn in self.sets()}
        for name in sorted(whiskers):
            for face in FACES:
                for seed in CALIBRATION_SEEDS:
                    yield calibration_scene(self.prefix, whiskers[name], face, seed)
