"""Times of functions and of simulated suites."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from whisker_sim.errors import WhiskerSimError
from whisker_sim.jobs import SUCCESS


def processor_s(work: Callable[[], object]) -> float:
    """Processor time of this process for `work`, in seconds, on which other programs have little influence."""
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def suite_s(suite: Path, jobs: int) -> float:
    """Wall-clock time in which `jobs` workers simulate `suite`, in seconds, from the start of the command to its end.

    Raises `WhiskerSimError` if the command fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "whisker_sim", "simulate", str(suite), "--out", folder, "--jobs", str(jobs)]
        start_s = time.perf_counter()
        finished = subprocess.run(command, capture_output=True, text=True, check=False)
        if finished.returncode != SUCCESS:
            raise WhiskerSimError(f"`{' '.join(command)}` fails: {finished.stderr.strip()}")
        return time.perf_counter() - start_s
