"""Folders and programs of the repository."""

import os
import shutil
from pathlib import Path

_SOURCES = Path(__file__).resolve().parents[1]

IN_REPOSITORY = _SOURCES.name == "sim" and (_SOURCES.parent / "scenes").is_dir()
"""Whether the package runs from the repository's sources, and not from an installed copy."""
ROOT = _SOURCES.parent if IN_REPOSITORY else Path()
"""Root of the repository; for an installed package the working directory."""
DATASETS = ROOT / "datasets"


def whisker_program() -> Path:
    """The program `whisker`: that of the variable `WHISKER`, else of the repository's release build, else on the PATH.

    If none exists, the path of the release build is returned, for the error message of the caller.
    """
    if named := os.environ.get("WHISKER"):
        return Path(named)
    built = ROOT / "target/release/whisker"
    on_path = shutil.which("whisker")
    return built if built.is_file() or on_path is None else Path(on_path)
