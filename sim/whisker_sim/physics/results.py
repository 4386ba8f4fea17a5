"""Files of a run: one CSV file per table, the claims, and the provenance."""

import csv
import io
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import msgspec

from whisker_sim.documents import to_json
from whisker_sim.physics.study import Claim, Findings
from whisker_sim.physics.sweeps import Row as SweepRow
from whisker_sim.trace import Generator, generator, write_atomically


class ClaimRow(NamedTuple):
    """A row of `claims.csv`."""

    id: str
    claim: str
    measured: float
    relation: str
    bound: float
    unit: str
    holds: str


class Watermark(msgspec.Struct, frozen=True):
    """Provenance of the tables."""

    format: int
    kind: str
    generator: Generator
    numpy: str
    scipy: str
    traces: dict[str, str]
    """Hashes of the compared traces, by name."""


def write_results(folder: Path, findings: list[Findings]) -> None:
    """Writes `<table>.csv` for every table, `claims.csv` and `watermark.json` into `folder`.

    Numbers have nine significant digits: more than any claim needs, and few enough to agree between machines.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {name: rows for found in findings for name, rows in found.tables.items()}
    tables["claims"] = [claim_row(claim) for found in findings for claim in found.claims]
    for name, rows in tables.items():
        write_atomically(folder / f"{name}.csv", _csv(rows))
    traces = {row.trace: row.trace_sha256 for row in tables.get("sweeps", []) if isinstance(row, SweepRow)}
    watermark = Watermark(1, "physics", generator(), version("numpy"), version("scipy"), traces)
    write_atomically(folder / "watermark.json", to_json(watermark))


def claim_row(claim: Claim) -> ClaimRow:
    """The row of `claims.csv` about a claim."""
    return ClaimRow(*claim, "true" if claim.holds else "false")


def _csv(rows: Sequence[NamedTuple]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if rows:
        writer.writerow(rows[0]._fields)
    writer.writerows([_field(value) for value in row] for row in rows)
    return text.getvalue().encode()


def _field(value: object) -> object:
    """A value as its field; NaN becomes an empty field."""
    if not isinstance(value, float):
        return value
    return f"{value:.9g}" if value == value else ""
