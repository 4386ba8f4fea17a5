"""Errors that are reported to the user as one line."""


class WhiskerSimError(Exception):
    """Base class of the errors that are reported as one line, without a traceback."""


class InputError(WhiskerSimError):
    """Invalid file or argument. The message states file, line, key, expected and found values."""


class SimulationError(WhiskerSimError):
    """Failed simulation of a trace. The message states the time."""
