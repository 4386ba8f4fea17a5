"""Validation of the simulator: the chain against the exact elastica, and its dynamics against the analytic beam.

`python -m whisker_sim.physics` runs all studies and prints each claim with its measured value. The generator of traces does not
depend on this package.
"""
