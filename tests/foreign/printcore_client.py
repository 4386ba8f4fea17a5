"""Printrun's printcore drives the printer on the given port and prints its responses; exit code 0 if all lines are processed.

Runs in a virtual environment of its own with Printrun; the project does not import it.
"""

import sys
import threading
import time

from printrun import gcoder
from printrun.printcore import printcore

LINES = ["G21", "G90", "G28 X Y", "M117 hello", *(f"G1 X{20 + k % 7} Y{10 + k % 11} F9000" for k in range(60)), "M400", "M114"]
TIMEOUT_S = 120


def main() -> int:
    """Connects, prints `LINES`, and queries the position of the head."""
    printer, online = printcore(), threading.Event()
    responses: list[str] = []
    printer.recvcb = responses.append
    printer.onlinecb = online.set
    printer.connect(sys.argv[1], 115200)
    if not online.wait(TIMEOUT_S):
        return 1
    printer.startprint(gcoder.LightGCode(LINES))
    deadline = time.monotonic() + TIMEOUT_S
    while printer.printing and time.monotonic() < deadline:
        time.sleep(0.05)
    while not any(line.startswith("X:") for line in responses) and time.monotonic() < deadline:
        time.sleep(0.05)
    printer.disconnect()
    print("".join(responses))
    return 0 if any(line.startswith("X:") for line in responses) else 1


sys.exit(main())
