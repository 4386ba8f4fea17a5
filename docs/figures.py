"""Measured values of the documentation: written into its Markdown files from the tables in `results/reference/`.

Usage: figures.py [--check]

A measured value stands between two comments, of which the first names its source:

    RMSE <!--= claims.pin_straight_recommended_rmse .3f -->0.049<!--/--> mm

Between the first comment's `=` and its end stand, separated by spaces:

1. optionally `min`, `max`, `median`, `p5`, `p95` (percentiles), `rms` (root mean square), `sum` or `count`, applied to all values
   whose keys match;
2. the key: the table, a dot, and the cells of its key columns and the name of a column, joined by `/`. Without a column, that of
   the measured value. Within a cell, `*` stands for any characters; `0.5..1` stands for all numbers of that range. Spaces are
   written as `_`;
3. the format of the number, as in Python: `.2f`, `.3g`; absent for a text. A value that rounds to zero becomes `< 0.01`;
4. optionally a unit, into which a value in SI units is converted: `mm`, `%`;
5. optionally `or-none`: if the table has no value for the key, the text is `none`.

Tables of variable length are written whole: `<!--= unmet_claims -->`. Other numbers with a unit, and other cells of tables that
are numbers, are settings, bounds or published values. Columns headed by a word of `GIVEN_COLUMNS` may hold them, and the comment
`<!-- given: 1 %, 95 % -->` lists those of its section; `<!-- given: all -->` exempts the section. With `--check`, nothing is
written, and the exit code is 1 if a document differs from the tables or holds another number.
"""

import argparse
import csv
import functools
import json
import math
import operator
import re
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "results" / "reference"

DOCUMENTS = (
    "README.md",
    "docs/RESULTS.md",
    "docs/choosing.md",
    "docs/CERTAINTY.md",
    "docs/REAL.md",
    "docs/ARM.md",
    "docs/HALL.md",
    "docs/LIVE.md",
    "docs/PHYSICS.md",
    "docs/SPACE.md",
    "docs/PERFORMANCE.md",
    "docs/PLATFORM.md",
    "docs/ROS.md",
    "docs/PYTHON.md",
    "docs/CLUSTER.md",
    "docs/own-data.md",
    "docs/your-estimator.md",
)
"""Documents with measured values; in these, every number with a unit is checked."""

GIVEN_COLUMNS = {"bound", "target", "published", "value", "estimated"}
"""First words of the headings of columns that hold no measured values."""


@dataclass(frozen=True)
class Table:
    """A results table: its file, or files, and the columns that identify a row."""

    files: str
    keys: tuple[str, ...]
    measured: str | None = None
    of_runs: bool = False


TABLES = {
    "claims": Table("claims.csv", ("id",), "measured"),
    "certainty": Table("certainty/claims.csv", ("id",), "measured"),
    "contacts": Table("contacts/claims.csv", ("id",), "measured"),
    "quantity_claims": Table("quantities/claims.csv", ("id",), "measured"),
    "yielding_claims": Table("yielding/claims.csv", ("id",), "measured"),
    "quantities": Table("*/quantities.csv", ("trace", "quantity", "estimator", "seed"), of_runs=True),
    "physics": Table("physics/claims.csv", ("id",), "measured"),
    "measured": Table("measured.csv", ("id",), "measured"),
    "peers": Table("peers.csv", ("filter", "other")),
    "summary": Table("*/summary.csv", ("group", "whisker", "estimator", "noise"), of_runs=True),
    "platform": Table("platform.csv", ("recordings", "hold_out", "regression", "log")),
    "rig": Table("platform_rig.csv", ("run",)),
    "real": Table("stanford/contour_trials.csv", ("trace", "estimator")),
    "space_claims": Table("spatial/claims.csv", ("id",), "measured"),
    "space_times": Table("spatial/space_times.csv", ("estimator",)),
    "space": Table("spatial/space_summary.csv", ("group", "whisker", "estimator")),
    "space_real": Table("stanford-space/space_summary.csv", ("group", "whisker", "estimator")),
    "space_mounted": Table("stanford-space-mounted/space_summary.csv", ("group", "whisker", "estimator")),
    "space_maps": Table("recordings/space_maps.csv", ("calibration", "model")),
    "space_pins": Table("recordings/space_pins_summary.csv", ("group", "estimator")),
    "space_sweeps": Table("recordings/space_sweeps.csv", ("name", "object")),
    "space_sweeps_paper": Table("recordings/space_sweeps_paper.csv", ("name", "object")),
    "space_faces": Table("recordings/space_faces.csv", ("name", "object", "normal_x", "normal_y", "normal_z", "offset_m")),
}
"""The registry of results tables. The keys of a table of runs begin with the name of the run."""


def at_share(share: float, found: list[float]) -> float:
    """The value below which about this share of the values lies."""
    return sorted(found)[round(share * (len(found) - 1))]


SCALES = {
    "mm": 1e3,
    "um": 1e6,
    "µrad": 1e6,
    "ms": 1e3,
    "µs": 1e6,
    "ns": 1e9,
    "mN": 1e3,
    "mrad": 1e3,
    "degrees": 180.0 / math.pi,
    "%": 1e2,
}
REDUCTIONS: dict[str, Callable[[list[float]], float]] = {
    "min": min,
    "max": max,
    "median": statistics.median,
    "p5": functools.partial(at_share, 0.05),
    "p95": functools.partial(at_share, 0.95),
    "rms": lambda found: math.sqrt(statistics.fmean(value * value for value in found)),
    "sum": sum,
    "count": len,
}

OR_NONE = "or-none"
"""Last word of a source that may have no value."""

MARK = re.compile(r"<!--= (?P<source>[^>]*?) -->(?P<text>.*?)<!--/-->", re.DOTALL)
STARTS = re.compile(r"^[ >]*<!--= ([^>]*?) -->(?!\n)", re.MULTILINE)
GIVEN = re.compile(r"<!-- given: (.*?) -->", re.DOTALL)
NUMBER = r"[-+]?\d[\d ]*(?:\.\d+)?(?:e-?\d+)?"
UNIT = r"(?:%|[mnuµ]?m|[mnuµ]?s|m?N|m?rad|degrees?|counts?|times|[kMG]?Hz|[kMG]B(?:/s)?|mm/s|g)(?![\w/^])"
QUANTITY = re.compile(rf"(?<![\w.,])({NUMBER} ?{UNIT})")


class FigureError(Exception):
    """A source that names no value, or a value that the format does not fit."""


def values(name: str) -> dict[str, str]:
    """Cells of a table by their keys; empty cells are left out."""
    return _values(name, REFERENCE)


@functools.cache
def _values(name: str, reference: Path) -> dict[str, str]:
    if name == "commit":
        return {path.parent.name: _commit(path) for path in sorted(reference.glob("*/run.json"))}
    table = TABLES.get(name)
    if table is None:
        raise FigureError(f"found table `{name}`, expected one of {', '.join([*TABLES, 'commit'])}")
    found = {}
    for path in sorted(reference.glob(table.files)):
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                head = [path.parent.name] * table.of_runs + [row[key].replace(" ", "_") for key in table.keys]
                found |= {"/".join([*head, column]): cell for column, cell in row.items() if cell and column not in table.keys}
                if table.measured and row[table.measured]:
                    found["/".join(head)] = row[table.measured]
    return found


def _commit(run: Path) -> str:
    """Abbreviated commit of the program that made a run."""
    return (json.loads(run.read_text(encoding="utf-8"))["watermark"]["git_commit"] or "unknown")[:7]


def matching(key: str) -> list[str]:
    """Values whose key matches `key`, in the order of the table."""
    name, _, path = key.partition(".")
    found = values(name)
    if "*" not in path and ".." not in path:
        return [found[path]] if path in found else []
    tests = [matches(part) for part in path.split("/")]
    rows = ((place.split("/"), value) for place, value in found.items())
    return [value for cells, value in rows if len(cells) == len(tests) and all(map(operator.call, tests, cells))]


def matches(part: str) -> Callable[[str], bool]:
    """Predicate of the cells that a part of a key matches: by equality, by `*`, or as numbers in a range `0.5..1`."""
    least, is_range, most = part.partition("..")
    if is_range:
        return lambda cell: re.fullmatch(NUMBER, cell) is not None and float(least) <= float(cell) <= float(most)
    if "*" not in part:
        return functools.partial(operator.eq, part)
    pattern = re.compile(".*".join(re.escape(piece) for piece in part.split("*")))
    return lambda cell: pattern.fullmatch(cell) is not None


def figure(source: str) -> str:
    """The text for a source: the content of a mark."""
    if source in GENERATED:
        return GENERATED[source]()
    words = source.split()
    reduction = REDUCTIONS[words.pop(0)] if words[0] in REDUCTIONS else None
    key, *style = words
    may_lack = style[-1:] == [OR_NONE]
    style = style[:-1] if may_lack else style
    found = matching(key)
    if may_lack and not found:
        if not matching(f"{key.rpartition('/')[0]}/*"):
            raise FigureError(f"`{source}`: found no row, expected 1")
        return "none"
    if not found or (len(found) > 1 and reduction is None):
        raise FigureError(f"`{source}`: found {len(found)} values, expected {'at least 1' if reduction else '1'}")
    if reduction is len:
        return str(len(found))
    if not style:
        return found[0]
    try:
        numbers = [float(value) for value in found]
        return in_style(reduction(numbers) if reduction else numbers[0], *style)
    except (KeyError, TypeError, ValueError) as error:
        expected = f"expected a number, a format like .2f and one of {', '.join(SCALES)}"
        raise FigureError(f"`{source}`: {error}; {expected}") from None


def in_style(value: float, style: str, unit: str | None = None) -> str:
    """A number in a format, in a unit; `< 0.01` instead of 0.00."""
    text = format(value * SCALES[unit] if unit else value, style)
    digits = re.fullmatch(r"\.(\d)f", style)
    if digits and value != 0 and float(text) == 0:
        return f"< {format(10.0 ** -int(digits[1]), style)}"
    return re.sub(r"e([-+])0*(\d)", lambda match: "e" + match[1].replace("+", "") + match[2], text)


def claims(name: str = "") -> list[dict[str, str]]:
    """Rows of a set of claims, by the name of its folder."""
    with (REFERENCE / name / "claims.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def unmet(name: str = "") -> list[dict[str, str]]:
    """Rows of the claims of a set that do not hold."""
    return [row for row in claims(name) if row["holds"] == "false"]


def unmet_count(name: str = "") -> str:
    """Number of the claims of a set that do not hold."""
    return str(len(unmet(name)))


def unmet_claims(name: str = "") -> str:
    """Table of the claims of a set that do not hold."""
    lines = ["", "| claim | measured | bound | unit |", "| --- | --- | --- | --- |"]
    lines += [f"| {row['claim']} | {measured(row)} | {bound(row)} | {row['unit']} |" for row in unmet(name)]
    return "\n".join([*lines, ""])


def measured(row: dict[str, str]) -> str:
    """Measured value of a claim."""
    return in_style(float(row["measured"]), ".3g") if row["measured"] else "no value"


def bound(row: dict[str, str]) -> str:
    """Bound of a claim."""
    return f"{row['relation']} {float(row['bound']):g}"


GENERATED: dict[str, Callable[[], str]] = {
    "unmet_claims": unmet_claims,
    "certainty_unmet_claims": functools.partial(unmet_claims, "certainty"),
    "contacts_unmet_claims": functools.partial(unmet_claims, "contacts"),
    "yielding_unmet_claims": functools.partial(unmet_claims, "yielding"),
    "space_unmet_claims": functools.partial(unmet_claims, "spatial"),
    "unmet_count": unmet_count,
    "certainty_unmet_count": functools.partial(unmet_count, "certainty"),
    "contacts_unmet_count": functools.partial(unmet_count, "contacts"),
    "quantity_unmet_count": functools.partial(unmet_count, "quantities"),
    "yielding_unmet_count": functools.partial(unmet_count, "yielding"),
    "space_unmet_count": functools.partial(unmet_count, "spatial"),
    "physics_unmet_count": functools.partial(unmet_count, "physics"),
}
"""The registry of texts that are no single cell."""


def written(text: str) -> str:
    """A document with the values of the tables."""
    return MARK.sub(lambda mark: f"<!--= {mark['source']} -->{figure(mark['source'])}<!--/-->", text)


def unmarked(text: str) -> list[str]:
    """Numbers of a document that are neither between marks nor given."""
    text = re.sub(
        r"^(```|~~~).*?^\1[^\S\n]*$",
        "",
        MARK.sub("", text),
        flags=re.MULTILINE | re.DOTALL,
    )
    text = re.sub(r"`[^`\n]*`|(?<=\])\([^)]*\)", "", text)
    found = []
    for section in re.split(r"^(?=#+ )", text, flags=re.MULTILINE):
        given = {number.strip() for comment in GIVEN.findall(section) for number in comment.split(",")}
        if "all" not in given:
            found += [number for number in numbers(GIVEN.sub("", section)) if number not in given]
    return found


def numbers(section: str) -> list[str]:
    """Numbers with a unit, and cells of tables that are numbers, in the order of a section."""
    found, heads = [], []
    for line in section.splitlines():
        if not line.startswith("|"):
            heads = []
            found += QUANTITY.findall(line)
            continue
        cells = [cell.strip().strip("*") for cell in line.strip().strip("|").split("|")]
        heads = heads or cells
        for head, cell in zip(heads, cells, strict=False):
            if cell and (head.split() or [""])[0] not in GIVEN_COLUMNS:
                found += [cell] if re.fullmatch(rf"<? ?{NUMBER}", cell) else QUANTITY.findall(cell)
    return found


def problems(name: str, text: str) -> list[str]:
    """Differences of a document from the tables, and numbers without a source, one line each."""
    marks = [(mark["source"], mark["text"], figure(mark["source"])) for mark in MARK.finditer(text)]
    stale = [f"{name}: `{source}`: found {old!r}, expected {new!r}" for source, old, new in marks if old != new]
    broken = [f"{name}: `{source}`: a line begins with this mark, which ends the paragraph" for source in STARTS.findall(text)]
    return stale + broken + [f"{name}: found {number}, expected a mark or a `given` comment" for number in unmarked(text)]


def main() -> int:
    """Writes or checks the documents; returns the exit code."""
    parser = argparse.ArgumentParser(description="Write the measured values of the documentation from results/reference.")
    parser.add_argument("--check", action="store_true", help="write nothing; list what differs")
    options = parser.parse_args()
    found = []
    for name in DOCUMENTS:
        path = ROOT / name
        text = path.read_text(encoding="utf-8")
        try:
            if not options.check and written(text) != text:
                path.write_text(text := written(text), encoding="utf-8")
                print(f"{name}: written")
            found += problems(name, text)
        except FigureError as error:
            found.append(f"{name}: {error}")
    for problem in found:
        print(f"error: {problem}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
