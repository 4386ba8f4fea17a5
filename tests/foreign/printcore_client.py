"""Printrun's printcore drives the printer on the port that is given, and prints what it says; ends with 0 once all is done.

Runs in a virtual environment of its own that has Printrun; nothing of the project imports it.
"""

import sys
import threading
import time

from printrun import gcoder
from printrun.printcore import printcore

LINES = ["G21", "G90", "G28 X Y", "M117 hello", *(f"G1 X{20 + k % 7} Y{10 + k % 11} F9000" for k in range(60)), "M400", "M114"]
PATIENCE_S = 120


def main() -> int:
    """Connects, prints `LINES`, and asks where the head is."""
    printer, online = printcore(), threading.Event()
    said: list[str] = []
    printer.recvcb = said.append
    printer.onlinecb = online.set
    printer.connect(sys.argv[1], 115200)
    if not online.wait(PATIENCE_S):
        return 1
    printer.startprint(gcoder.LightGCode(LINES))
    deadline = time.monotonic() + PATIENCE_S
    while printer.printing and time.monotonic() < deadline:
        time.sleep(0.05)
    while not any(line.startswith("X:") for line in said) and time.monotonic() < deadline:
        time.sleep(0.05)
    printer.disconnect()
    print("".join(said))
    return 0 if any(line.startswith("X:") for line in said) else 1


sys.exit(main())
