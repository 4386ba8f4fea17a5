"""OctoPrint's virtual printer on a pseudo-terminal: prints the port and serves it until the process ends.

Runs in a virtual environment of its own with OctoPrint; the project does not import it.
"""

import os
import threading
import tty

from octoprint.plugin import plugin_manager
from octoprint.plugins.virtual_printer import VirtualPrinterPlugin
from octoprint.plugins.virtual_printer.virtual import VirtualPrinter


class Settings:
    """Defaults of the plugin, with the interface that the plugin uses."""

    def __init__(self, folder: str) -> None:
        self._values = VirtualPrinterPlugin().get_settings_defaults()
        self._folder = folder

    def get(self, path: list[str], merged: bool = False) -> object:
        value = self._values
        for key in path:
            value = value[key]
        return value

    def get_int(self, path: list[str]) -> int:
        return int(self.get(path))

    def get_float(self, path: list[str]) -> float:
        return float(self.get(path))

    def get_boolean(self, path: list[str]) -> bool:
        return bool(self.get(path))

    def global_get_basefolder(self, name: str) -> str:
        return self._folder


def main() -> None:
    """Serves until the process ends."""
    folder = os.environ["TMPDIR"]
    # The printer queries other plugins; there are none.
    plugin_manager(init=True, plugin_folders=[], plugin_entry_points=[])
    device, port = os.openpty()
    tty.setraw(device)
    print(os.ttyname(port), flush=True)
    printer = VirtualPrinter(Settings(folder), None, folder, read_timeout=0.5)

    def answer() -> None:
        while True:
            line = printer.readline()
            if line:
                os.write(device, line if line.endswith(b"\n") else line + b"\n")

    threading.Thread(target=answer, daemon=True).start()
    rest = b""
    while True:
        *lines, rest = (rest + os.read(device, 4096)).split(b"\n")
        for line in lines:
            printer.write(line + b"\n")


main()
