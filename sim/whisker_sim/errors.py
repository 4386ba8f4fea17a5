"""Errors that are reported to the user as one line."""


class WhiskerSimError(Exception):
    """Base class of the errors that are reported as one line, without a traceback."""

    def __str__(self) -> str:
        """The message, with the line breaks and other control characters of an input escaped."""
        return "".join(
            character if character.isprintable() else character.encode("unicode_escape").decode() for character in super().__str__()
        )


class InputError(WhiskerSimError):
    """Invalid file or argument. The message states file, line, key, expected and found values."""


class SimulationError(WhiskerSimError):
    """Failed simulation of a trace. The message states the time, or the span of time, of a failure in the course of it."""
