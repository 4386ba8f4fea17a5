"""Command line of `python -m whisker_sim.rig`, which writes the table of the rig, `rig.csv` and `rig.json`.

Exit codes: 0 success, 1 failure, 2 wrong usage or input, 130 interrupted.
"""

import argparse
import sys
from pathlib import Path

from whisker_sim.cli import exit_code
from whisker_sim.documents import located
from whisker_sim.errors import InputError
from whisker_sim.jobs import SUCCESS
from whisker_sim.paths import ROOT
from whisker_sim.progress import Progress, work_on
from whisker_sim.rig.files import write_rig
from whisker_sim.runs import load
from whisker_sim.scene import Scene


def main(arguments: list[str] | None = None) -> int:
    """Writes the files; returns the exit code."""
    options = _parser().parse_args(arguments)
    return exit_code(lambda: _write(options), "interrupted; no table was written")


def _write(options: argparse.Namespace) -> int:
    scene = load(options.scene)
    if not isinstance(scene, Scene):
        raise InputError(f"{options.scene}: expected a scene with one whisker, found another kind of document")
    with Progress("tabulate", "table", 1) as progress:
        progress.start(shares := [0.0])
        with work_on(shares, 0):
            try:
                rig = write_rig(options.out, scene)
            except InputError as error:
                raise located(options.scene, str(error)) from None
    ringing = f"rings at {rig.ring_hz:g} Hz with a time constant of {rig.decay_s:g} s"
    print(f"{options.out / rig.table.file}: {rig.table.rows} rows; {ringing}")
    return SUCCESS


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whisker_sim.rig", description="Tabulate the readings of the calibration rig at rest.")
    parser.add_argument(
        "--scene",
        type=Path,
        default=ROOT / "scenes/rig/increments_beam_test.json",
        metavar="SCENE",
        help="scene that defines whisker and object (default: the scene of the routine)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=ROOT / "crates/platform/data",
        metavar="DIR",
        help="folder of the files (default: the one that the emulated rig reads)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
