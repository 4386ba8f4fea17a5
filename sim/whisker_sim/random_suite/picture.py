"""Pictures of the sets of random suites."""

from whisker_sim.drawing import SweepRenderer
from whisker_sim.random_suite.simulate import SimulatedTrace
from whisker_sim.random_suite.simulate_space import SimulatedSpatialTrace
from whisker_sim.runs import Run
from whisker_sim.space.picture import SpatialRenderer


class RandomSetRenderer(SweepRenderer):
    """Frames of the first trace of a simulated set."""

    def __init__(self, run: Run, traces: list[SimulatedTrace]) -> None:
        super().__init__(traces[0].run, traces[0].simulated)
        self.run = run


class SpatialSetRenderer(SpatialRenderer):
    """Frames of the first trace of a simulated set in space."""

    def __init__(self, run: Run, traces: list[SimulatedSpatialTrace]) -> None:
        super().__init__(traces[0].run, traces[0].simulated)
        self.run = run
