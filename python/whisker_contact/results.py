"""Readers of the results of `whisker evaluate`."""

import csv
import json
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._native import check_run, check_table

#: Columns of text, of flags and of whole numbers that are always present; the others are numbers.
_TEXTS = frozenset(
    (
        "array",
        "estimator",
        "group",
        "matched",
        "models",
        "nis_verdict",
        "quantity",
        "reason",
        "recording",
        "state",
        "trace",
        "traces",
        "verdict",
        "whisker",
    )
)
_FLAGS = frozenset(("at_tip", "calibrated", "model_doubtful", "second_contact", "touched", "truth_touching"))
_WHOLE = frozenset(
    (
        "left_out",
        "missing",
        "object",
        "objects",
        "objects_found",
        "objects_merged",
        "objects_split",
        "objects_touched",
        "points",
        "points_left_out",
        "samples",
        "seed",
        "steps",
        "swept",
        "trials",
        "whiskers",
    )
)


def read_table(path: str | PathLike[str]) -> NDArray[np.void]:
    """Table of a run, such as `trials.csv` or, in space, `space_trials.csv`, as a structured array.

    The columns are described in `datasets/FORMAT.md`. The kind of a column depends on the table, not on its content: text (names,
    `models`, verdicts, reasons), flags, whole numbers (counts and seeds), and otherwise numbers of `float64`. A missing number is
    NaN, a missing flag is -1 (true is 1, false is 0), a missing text is empty.
    """
    count = check_table(path)
    with Path(path).open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    names, cells = rows[0], rows[1:]
    columns = [_column(name, names, [row[place] for row in cells]) for place, name in enumerate(names)]
    table = np.empty(count, dtype=[(name, column.dtype) for name, column in zip(names, columns, strict=True)])
    for name, column in zip(names, columns, strict=True):
        table[name] = column
    return table


def _column(name: str, names: list[str], cells: list[str]) -> NDArray[Any]:
    """Column `name` of a table with the columns `names`."""
    # `object` is a shape in the tables of trials and sets, an index in those of maps, where a point may belong to none. `touched`
    # counts in a grid.
    if name in _TEXTS or (name == "object" and "group" in names):
        return np.array(cells, dtype=np.str_)
    if name in _FLAGS and "swept" not in names:
        return np.array([{"true": 1, "false": 0}.get(cell, -1) for cell in cells], dtype=np.int8)
    if (name in _WHOLE and "array" not in names) or (name == "touched" and "swept" in names):
        return np.array([int(cell) for cell in cells], dtype=np.uint64)
    return np.array([float(cell) if cell else np.nan for cell in cells], dtype=np.float64)


class Results(Mapping[str, NDArray[np.void]]):
    """Tables of a run, read at each access.

    A table is named by its path in the folder without `.csv`: `results["trials"]`, in space `results["space_trials"]`.
    """

    def __init__(self, folder: str | PathLike[str]) -> None:
        self.folder = Path(folder)
        """Folder of the run."""
        with (self.folder / check_run(self.folder)).open(encoding="utf-8") as file:
            self.run: dict[str, Any] = json.load(file)
            """Record of the run, `run.json` or `space_run.json`: settings, estimators, trials."""
        self._paths = {
            path.relative_to(self.folder).with_suffix("").as_posix(): path for path in sorted(self.folder.rglob("*.csv"))
        }

    def __getitem__(self, name: str) -> NDArray[np.void]:
        if name not in self._paths:
            raise KeyError(f"{self.folder}: found no table `{name}`, expected one of: {', '.join(self._paths)}")
        return read_table(self._paths[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def __repr__(self) -> str:
        return f"<Results of {self.folder}: {len(self)} tables>"


def read_results(folder: str | PathLike[str]) -> Results:
    """Results of a run in the plane or in space, from its folder (`results/<run>`).

    `FileNotFoundError` says that a folder has no results, `ValueError` that it has others than those of a run.
    """
    return Results(folder)


def frame(table: NDArray[np.void], library: str | None = None) -> Any:
    """Data frame of a structured array, by `pandas` or `polars`; by default whichever is installed, pandas first."""
    if table.dtype.names is None:
        raise ValueError(f"frame: found an array of {table.dtype}, expected a structured array")
    columns = {name: np.ascontiguousarray(table[name]) for name in table.dtype.names}
    known = ("pandas", "polars")
    if library is not None and library not in known:
        raise ValueError(f"library: found `{library}`, expected `pandas` or `polars`")
    for name in known if library is None else (library,):
        try:
            module = __import__(name)
        except ImportError:
            continue
        return module.DataFrame(columns)
    raise ImportError(f"frame: found no {library or 'pandas or polars'}, expected it to be installed")
