"""Registry of studies: one file and one row per study."""

from whisker_sim.physics import (
    convergence,
    disturbance,
    fast,
    frequencies,
    friction,
    oracle,
    rig,
    ringing,
    space_chain,
    space_oracle,
    space_scenes,
    space_suite,
    speeds,
    standing,
    steps,
    sweeps,
)

STUDIES = (
    oracle.STUDY,
    convergence.STUDY,
    sweeps.STUDY,
    fast.STUDY,
    frequencies.STUDY,
    ringing.STUDY,
    steps.STUDY,
    speeds.STUDY,
    standing.STUDY,
    disturbance.STUDY,
    rig.STUDY,
    friction.STUDY,
    space_oracle.STUDY,
    space_chain.STUDY,
    space_scenes.STUDY,
    space_suite.STUDY,
)
"""Studies in the order of the report."""
