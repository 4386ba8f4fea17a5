"""Entry point of `python -m whisker_sim.rig`."""

import sys

from whisker_sim.startup import start

if __name__ == "__main__":
    sys.exit(start("whisker_sim.rig.command"))
