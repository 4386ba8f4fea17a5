"""The simulator put to the test: the chain against the exact elastica, and its dynamics against the analytic beam.

`python -m whisker_sim.physics` runs every study and prints each claim with what was measured. The traces' generator uses nothing
of this package.
"""
