"""Entry point of `python -m whisker_sim` and of `whisker-sim`."""

import sys

from whisker_sim.startup import start


def main() -> int:
    """Runs the command line; returns the exit code."""
    return start("whisker_sim.cli")


if __name__ == "__main__":
    sys.exit(main())
