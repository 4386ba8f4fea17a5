"""Picture of a set of a random suite."""

from whisker_sim.drawing import SweepRenderer
from whisker_sim.random_suite.simulate import SimulatedTrace
from whisker_sim.runs import Run


class RandomSetRenderer(SweepRenderer):
    """Frames of the first trace of a simulated set."""

    def __init__(self, run: Run, traces: list[SimulatedTrace]) -> None:
        super().__init__(traces[0].run, traces[0].simulated)
        self.run = run
