"""Figures that the tests of the mechanics in Rust print."""

import os
import subprocess
from collections.abc import Mapping, Sequence

from whisker_sim.errors import SimulationError
from whisker_sim.paths import ROOT

NUMBER = r"([-+0-9.eE]+)"
"""Regular expression of a printed number."""


def rust_tests(file: str, tests: Sequence[str], variables: Mapping[str, str]) -> str | None:
    """Output of tests of the crate `whisker` with the environment `variables`; `None` if one fails.

    `file` is the name of the integration test that contains `tests`. Raises `SimulationError` if they do not run.
    """
    command = ["cargo", "test", "--quiet", "--release", "--package", "whisker", "--test", file]
    try:
        run = subprocess.run(
            [*command, "--", "--nocapture", *tests],
            cwd=ROOT,
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError as error:
        raise SimulationError(f"tests of the oracle in Rust: expected to start cargo, found: {error.strerror}") from None
    if "test result" not in run.stdout:
        reason = (run.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise SimulationError(f"tests of the oracle in Rust: expected results of `{' '.join(command)}`, found: {reason}")
    return run.stdout if run.returncode == 0 else None
