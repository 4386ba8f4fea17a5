"""Documents of random suites, and the scenes that they define."""

from collections.abc import Iterator
from typing import Annotated

import msgspec
import numpy as np

from whisker_sim.motions import Smooth
from whisker_sim.random_suite.effects import random_rate_hz, random_replay
from whisker_sim.random_suite.movements import DURATION_S, random_movement
from whisker_sim.random_suite.objects import random_kind
from whisker_sim.random_suite.sets import DrawnScenes
from whisker_sim.random_suite.space import SpatialRandomSet, spatial_calibration_scene
from whisker_sim.random_suite.whiskers import CALIBRATION_SEEDS, FACES, STANDARD, calibration_scene, random_whisker
from whisker_sim.scene import Format, Scene, Seed, random_stream
from whisker_sim.space.scene import SpatialScene
from whisker_sim.whisker import Name, Whisker, WhiskerOverride, resolve_whisker

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

    def sets(self) -> "Iterator[RandomSet | SpatialRandomSet]":
        """The sets."""
        return self._sets_in_space() if self.random.in_space else self._sets_in_plane()

    def _sets_in_space(self) -> Iterator[SpatialRandomSet]:
        for index in range(self.random.sets):
            rng = random_stream(f"{self.name} set {index} whisker", self.random.seed)
            whisker = STANDARD[int(rng.integers(len(STANDARD)))]
            yield SpatialRandomSet(self.format, self.name, self.random.seed, index, self.random.traces, whisker)

    def _sets_in_plane(self) -> "Iterator[RandomSet]":
        for index in range(self.random.sets):
            rng = random_stream(f"{self.name} set {index} whisker", self.random.seed)
            is_standard = self.random.whiskers == 0 or rng.random() < 0.5
            number = rng.integers(len(STANDARD)) if is_standard else len(STANDARD) + rng.integers(self.random.whiskers)
            yield RandomSet(
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


class RandomSet(DrawnScenes, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One set of a random suite: the traces of one whisker on one object."""

    def draw(self, attempt: int) -> "DrawnSet":
        """The set as drawn for the `attempt`-th time."""
        rng = random_stream(f"{self.suite} set {self.index} attempt {attempt}", self.seed)
        return DrawnSet(self, attempt, rng)


class DrawnSet:
    """Properties that the traces of a set have in common, and the random stream of each trace."""

    def __init__(self, of: RandomSet, attempt: int, rng: np.random.Generator) -> None:
        self._set, self._attempt = of, attempt
        whisker: Whisker = of.resolved_whisker
        self._kind = random_kind(rng)
        self._object = self._kind.draw(rng)
        self._movement = random_movement(whisker, rng)
        self._face = str(rng.choice(FACES))
        self._rate_hz = random_rate_hz(rng)
        self._replay = random_replay(rng)

    def scene(self, trace: int, attempt: int) -> Scene:
        """Scene of a trace of the set, as drawn for the `attempt`-th time."""
        of = self._set
        rng = random_stream(f"{of.suite} set {of.index} attempt {self._attempt} trace {trace} attempt {attempt}", of.seed)
        motion = self._movement(rng)
        return Scene(
            format=of.format,
            name=of.name,
            role="trial",
            group=of.group,
            face=self._face,
            whisker=of.whisker,
            object=self._kind.placed(self._object, rng),
            motion=motion,
            # The motion is drawn from the seed.
            seed=int(rng.integers(2**32)),
            duration_s=DURATION_S if isinstance(motion, Smooth) else None,
            rate_hz=self._rate_hz,
            simulation=of.simulation,
            replay=self._replay,
        )
