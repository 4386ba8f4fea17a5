"""Entry point of `python -m whisker_sim`."""

import signal
import sys

# The libraries take a moment to load; an interrupt in it ends the program as it ends any other, without a traceback.
_heard = signal.signal(signal.SIGINT, signal.SIG_DFL)

from whisker_sim.cli import main  # noqa: E402

signal.signal(signal.SIGINT, _heard)

if __name__ == "__main__":
    sys.exit(main())
