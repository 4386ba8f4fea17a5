"""The standard suite's traces, as they were written, against the elastica at every quasi-static instant.

An instant counts as quasi-static when the contact has lasted without a break for `SETTLING_S` and lasts for another `LEAVING_S`,
and when the elastica's contact has not run along the whisker faster than `CONTACT_SPEED_M_S` for `CALM_S`: a straight whisker runs
over the flat of a polygon, from one corner to the next, in some 30 ms, in which its inertia counts and the place of the contact on
the flat is all but undetermined.
"""

import hashlib
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whisker_sim.documents import read_document
from whisker_sim.errors import InputError
from whisker_sim.physics.cases import largest, rms
from whisker_sim.physics.elastica import Touching, touching
from whisker_sim.physics.study import PERCENT, Bar, Findings, Study
from whisker_sim.trace import COLUMNS, Sidecar
from whisker_sim.whisker import Array

SETTLING_S = 0.3
LEAVING_S = 0.02
CALM_S = 0.05
CONTACT_SPEED_M_S = 0.1


class Row(NamedTuple):
    """One trace against the elastica; moments relative to the trace's largest."""

    trace: str
    role: str
    touching: int
    """Instants in contact."""
    quasi_static: int
    unsolved: int
    """Quasi-static instants for which the elastica finds no contact in one point."""
    range_n_m: float
    moment_rms: float
    moment_worst: float
    moment_jump: float
    """Largest change of the error from one quasi-static instant to the next."""
    surface_rms_m: float
    surface_worst_m: float
    arc_rms_m: float
    arc_worst_m: float
    penetration_m: float
    """Largest penetration of the smooth whisker at quasi-static instants."""
    trace_sha256: str


class Instant(NamedTuple):
    """Errors at one instant of a lateral sweep."""

    trace: str
    t_s: float
    moment_n_m: float
    moment_error_n_m: float
    surface_error_m: float
    arc_error_m: float
    quasi_static: int


def read_columns(folder: Path, sidecar: Sidecar) -> tuple[dict[str, Array], str]:
    """Columns of a trace by name, NaN where a field is empty, and the file's hash; raises `InputError` on a damaged file."""
    path = folder / f"{sidecar.name}.csv"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected the rows of the trace, found {error.strerror}") from None
    found = hashlib.sha256(content).hexdigest()
    if found != sidecar.csv_sha256:
        raise InputError(f"{path}: expected the SHA-256 {sidecar.csv_sha256} that its sidecar states, found {found}")
    values = np.genfromtxt(content.decode().splitlines()[1:], delimiter=",")
    return {name: values[:, index] for index, (name, _) in enumerate(COLUMNS)}, found


def solve(sidecar: Sidecar, columns: dict[str, Array], rows: NDArray[np.intp]) -> Touching:
    """The elastica at the base poses of `rows`, looked for near the trace's contact and then near the solved neighbours'."""
    scene = sidecar.scene
    face = 1 if scene.face == "left" else -1
    poses = np.stack([columns[name] for name in ("base_x_m", "base_y_m", "base_yaw_rad")], axis=-1)[rows]
    found = touching(sidecar.whisker, scene.object, face, poses, columns["truth_arc_m"][rows], columns["truth_force_n"][rows])
    missing = np.flatnonzero(~found.solved)
    if 0 < len(missing) < len(rows):
        known = np.flatnonzero(found.solved)
        guess = [np.interp(missing, known, values[known]) for values in (found.arc_m, found.force_n)]
        found = found.replaced(missing, touching(sidecar.whisker, scene.object, face, poses[missing], *guess))
    return found


def quasi_static(time_s: Array, arc_m: Array, recording_end_s: float) -> NDArray[np.bool_]:
    """Which of the instants in contact are quasi-static, from their times (n,) and the elastica's arc lengths (n,).

    An arc length that is not known counts as one that does not move.
    """
    interval_s = np.min(np.diff(time_s))
    gap_s = np.diff(time_s, prepend=-np.inf)
    broken = gap_s > 1.5 * interval_s
    speed_m_s = np.nan_to_num(np.abs(np.diff(arc_m, prepend=arc_m[0])) / interval_s)
    started_s = np.maximum.accumulate(np.where(broken, time_s, -np.inf))
    hurried_s = np.maximum.accumulate(np.where((speed_m_s > CONTACT_SPEED_M_S) & ~broken, time_s, -np.inf))
    # The instant before a fast one belongs to it.
    hurried = (time_s - hurried_s < CALM_S) | np.append(speed_m_s[1:] > CONTACT_SPEED_M_S, False)
    ends = np.append(broken[1:], True)
    ended_s = np.minimum.accumulate(np.where(ends, time_s, np.inf)[::-1])[::-1]
    # A contact that lasts to the end of the recording does not break there.
    lasts = (ended_s - time_s >= LEAVING_S) | (ended_s == recording_end_s)
    return (time_s - started_s >= SETTLING_S) & lasts & ~hurried


def compare(path: Path) -> tuple[Row, list[Instant]]:
    """Compares the trace whose sidecar is at `path`."""
    sidecar = read_document(path, Sidecar)
    columns, digest = read_columns(path.parent, sidecar)
    rows = np.flatnonzero(columns["truth_touching"] == 1.0)
    exact = solve(sidecar, columns, rows)
    time_s, moment_n_m = columns["t_s"][rows], columns["moment_z_n_m"][rows]
    slow = quasi_static(time_s, np.where(exact.solved, exact.arc_m, np.nan), columns["t_s"][-1])
    good = slow & exact.solved
    range_n_m = largest(moment_n_m)
    surface_m = np.stack((columns["truth_surface_x_m"], columns["truth_surface_y_m"]), axis=-1)[rows]
    contact_m = np.stack((columns["truth_contact_x_m"], columns["truth_contact_y_m"]), axis=-1)[rows]
    moment_error = (moment_n_m - exact.moment_n_m) / range_n_m
    surface_error_m = np.hypot(*(surface_m - exact.surface_m).T)
    arc_error_m = columns["truth_arc_m"][rows] - exact.arc_m
    penetration_m = sidecar.whisker.radius_m(columns["truth_arc_m"][rows]) - np.hypot(*(contact_m - surface_m).T)
    following = good[1:] & good[:-1] & (np.diff(rows) == 1)
    row = Row(
        trace=sidecar.name,
        role=sidecar.role,
        touching=len(rows),
        quasi_static=int(np.sum(slow)),
        unsolved=int(np.sum(slow & ~exact.solved)),
        range_n_m=range_n_m,
        moment_rms=rms(moment_error[good]),
        moment_worst=largest(moment_error[good]),
        moment_jump=largest(np.diff(moment_error)[following]),
        surface_rms_m=rms(surface_error_m[good]),
        surface_worst_m=largest(surface_error_m[good]),
        arc_rms_m=rms(arc_error_m[good]),
        arc_worst_m=largest(arc_error_m[good]),
        penetration_m=float(np.max(penetration_m[slow])),
        trace_sha256=digest,
    )
    if sidecar.scene.motion_kind != "lateral_sweep":
        return row, []
    values = (time_s, moment_n_m, moment_error * range_n_m, surface_error_m, arc_error_m, slow.astype(int))
    instants = zip(*(array[exact.solved].tolist() for array in values), strict=True)
    return row, [Instant(sidecar.name, *instant) for instant in instants]


def _tasks(dataset: Path) -> list[partial[tuple[Row, list[Instant]]]]:
    sidecars = sorted(dataset.glob("*.json"))
    if not sidecars:
        raise InputError(f"{dataset}: expected the traces of the standard suite, found none; simulate the suite first")
    return [partial(compare, path) for path in sidecars]


def _conclude(results: list[tuple[Row, list[Instant]]]) -> Findings:
    rows = [row for row, _ in results]
    bars = []
    for role, what in (("trial", "trials"), ("calibration", "calibrations")):
        of_role = [row for row in rows if row.role == role]
        for field, figure, scale, bound, unit in (
            ("moment_rms", "base moment, RMS", PERCENT, 0.05, "% of range"),
            ("moment_jump", "base moment, largest jump of the error", PERCENT, 0.1, "% of range"),
            ("surface_rms_m", "surface contact, RMS", 1e3, 0.005, "mm"),
            ("surface_worst_m", "surface contact, worst", 1e3, 0.03, "mm"),
            ("arc_rms_m", "arc length, RMS", 1e3, 0.02, "mm"),
            ("penetration_m", "penetration", 1e6, 5.0, "um"),
            ("unsolved", "instants without a contact in one point", 1.0, 0.0, ""),
        ):
            worst = max(of_role, key=lambda row, field=field: getattr(row, field), default=None)
            if worst is not None:
                claim = f"{what}: {figure} ({worst.trace})"
                bars.append(Bar(f"{role}_{field}", claim, scale * getattr(worst, field), "<=", bound, unit))
    return Findings({"sweeps": rows, "sweep_errors": [instant for _, instants in results for instant in instants]}, bars)


STUDY = Study("sweeps", "traces of the standard suite against the elastica", _tasks, _conclude)
