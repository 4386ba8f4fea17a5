"""Start of the command-line programs, before their packages are imported."""

import importlib
import os
import signal
import sys

_FAILED = 1


def start(module: str) -> int:
    """Imports `module`, runs its `main()` and returns the exit code.

    If a package is missing, prints a line that states the remedy and returns 1. An interrupt during the import ends the process
    as the signal does by default, without a traceback.
    """
    # Worker processes occupy all cores; threads of BLAS would only compete with them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    previous = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        program = importlib.import_module(module)
    except ModuleNotFoundError as error:
        print(f"error: {missing_package(error)}", file=sys.stderr)
        return _FAILED
    finally:
        signal.signal(signal.SIGINT, previous)
    return program.main()


def missing_package(error: ModuleNotFoundError) -> str:
    """The message about a package that is not installed; raises `error` itself if it is a module of this project."""
    package = (error.name or "").partition(".")[0]
    if package in ("", "whisker_sim"):
        raise error
    requirement = _EXTRAS.get(package, "./sim")
    return f"expected the package '{package}', found none: pip install {requirement}, in the repository's root"


_EXTRAS = {"distributed": "'./sim[cluster]'", "scipy": "'./sim[dev]'"}
"""Requirement that brings a package which not every command needs."""
