"""Random sets in the plane: the traces of one whisker on one convex object at rest, without friction."""

import numpy as np

from whisker_sim.motions import Smooth
from whisker_sim.random_suite.effects import random_rate_hz, random_replay
from whisker_sim.random_suite.movements import DURATION_S, random_movement
from whisker_sim.random_suite.objects import random_kind
from whisker_sim.random_suite.sets import DrawnScenes
from whisker_sim.random_suite.whiskers import FACES
from whisker_sim.scene import Scene, random_stream
from whisker_sim.whisker import Whisker


class RandomSet(DrawnScenes, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """One set of a random suite: the traces of one whisker on one object."""

    def draw(self, attempt: int) -> "DrawnSet":
        """The set as drawn for the `attempt`-th time."""
        return DrawnSet(self, attempt, self.stream(attempt))

    def stream(self, attempt: int) -> np.random.Generator:
        """Random stream of the properties that the traces of the set have in common."""
        return random_stream(f"{self.suite} set {self.index} attempt {attempt}", self.seed)


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
