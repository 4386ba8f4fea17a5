"""Certificates of the traces in space, which are those of the suite `spatial` beside the standard suite's traces."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.documents import read_document
from whisker_sim.errors import InputError
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.space.trace import SpatialSidecar

SUITE = "spatial"


class Row(NamedTuple):
    """Certificate of one trace; moments relative to the largest moment of the trace."""

    trace: str
    group: str
    whisker: str
    touching: int
    quasi_static: int
    unsolved: int
    moment_rms: float
    moment_jump: float
    surface_rms_m: float
    arc_rms_m: float
    normal_rms_rad: float
    force_worst_rad: float
    penetration_m: float


def certified(path: Path) -> Row:
    """The row of the trace whose sidecar is at `path`; figures that the certificate does not state are NaN."""
    sidecar = read_document(path, SpatialSidecar)
    found = sidecar.certificate

    def figure(value: float | None) -> float:
        return float("nan") if value is None else value

    return Row(
        sidecar.name,
        sidecar.group,
        sidecar.whisker.name,
        found.touching,
        found.quasi_static,
        found.unsolved,
        figure(found.moment_rms),
        figure(found.moment_jump),
        figure(found.surface_rms_m),
        figure(found.arc_rms_m),
        figure(found.normal_rms_rad),
        figure(found.force_worst_rad),
        figure(found.penetration_worst_m),
    )


def _tasks(dataset: Path) -> list[partial[Row]]:
    folder = dataset.parent / SUITE
    sidecars = sorted(folder.glob("*.json"))
    if not sidecars:
        raise InputError(f"{folder}: expected the traces of the suite '{SUITE}', found none; simulate the suite first")
    return [partial(certified, path) for path in sidecars]


def _conclude(rows: list[Row]) -> Findings:
    claims = []
    for field, figure, scale, bound, unit in (
        ("moment_rms", "worst component of the base moment, RMS", PERCENT, 0.05, "% of range"),
        ("moment_jump", "base moment, largest jump of the error", PERCENT, 0.1, "% of range"),
        ("surface_rms_m", "surface contact, RMS", 1e3, 0.02, "mm"),
        ("normal_rms_rad", "normal, RMS", float(np.degrees(1.0)), 0.2, "degrees"),
        ("penetration_m", "penetration", 1e6, 5.0, "um"),
        ("unsolved", "instants without a contact in one point", 1.0, 0.0, ""),
    ):
        # The first NaN, if there is one.
        worst = rows[int(np.argmax([getattr(row, field) for row in rows]))]
        claim = f"traces in space: {figure} ({worst.trace})"
        claims.append(Claim(f"space_suite_{field}", claim, scale * getattr(worst, field), "<=", bound, unit))
    fewest = min(rows, key=lambda row: row.quasi_static)
    claim = f"traces in space: fewest quasi-static instants of a trace ({fewest.trace})"
    claims.append(Claim("space_suite_quasi_static", claim, float(fewest.quasi_static), ">=", 50.0, ""))
    return Findings({"space_suite": rows}, claims)


STUDY = Study("space_suite", "traces in space against the Kirchhoff rod", _tasks, _conclude)
