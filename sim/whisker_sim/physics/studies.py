"""Registry of studies: one file and one row a study."""

from whisker_sim.physics import convergence, frequencies, ringing, speeds, steps, sweeps

STUDIES = (
    convergence.STUDY,
    sweeps.STUDY,
    frequencies.STUDY,
    ringing.STUDY,
    steps.STUDY,
    speeds.STUDY,
)
"""The studies in the order in which they are reported."""
