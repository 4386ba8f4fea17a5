"""The errors that reach the user, each as one line."""


class WhiskerSimError(Exception):
    """Base of the errors that are reported as one line and not as a traceback."""


class InputError(WhiskerSimError):
    """A file or an argument is wrong. The message names file, line, key, what was expected and what was found."""


class SimulationError(WhiskerSimError):
    """A trace could not be simulated as its scene promises. The message names the time."""
