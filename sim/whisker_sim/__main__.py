"""Entry point of `python -m whisker_sim`."""

import sys

from whisker_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
