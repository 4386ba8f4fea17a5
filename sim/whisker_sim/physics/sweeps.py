"""Traces of the standard suite against the elastica at every quasi-static instant."""

import hashlib
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.certificate import Contacts, disagreement, quasi_static
from whisker_sim.documents import read_document
from whisker_sim.errors import InputError
from whisker_sim.physics.cases import largest, rms
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.scene import Scene
from whisker_sim.trace import Sidecar
from whisker_sim.whisker import Array


class Row(NamedTuple):
    """One trace against the elastica; moments relative to the largest moment of the trace."""

    trace: str
    role: str
    touching: int
    """Number of instants in contact."""
    quasi_static: int
    unsolved: int
    """Number of quasi-static instants for which the elastica has no single-point contact."""
    range_n_m: float
    moment_rms: float
    moment_worst: float
    moment_jump: float
    """Largest change of the error between consecutive quasi-static instants."""
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
    """Columns of a trace by name, NaN for empty fields, and the hash of the file; raises `InputError` for a damaged file."""
    path = folder / f"{sidecar.name}.csv"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected the rows of the trace, found {error.strerror}") from None
    found = hashlib.sha256(content).hexdigest()
    if found != sidecar.csv_sha256:
        raise InputError(f"{path}: expected the SHA-256 {sidecar.csv_sha256} that its sidecar states, found {found}")
    header, *rows = content.decode().splitlines()
    values = np.genfromtxt(rows, delimiter=",")
    return {name: values[:, index] for index, name in enumerate(header.split(","))}, found


def compare(path: Path) -> tuple[Row, list[Instant]]:
    """Compares the trace whose sidecar is at `path`."""
    sidecar = read_document(path, Sidecar[Scene])
    columns, digest = read_columns(path.parent, sidecar)
    return compare_contacts(sidecar.name, sidecar.scene, contacts_of_columns(columns), digest)


def contacts_of_columns(columns: dict[str, Array]) -> Contacts:
    """Instants of contact of a trace."""

    def stacked(*names: str) -> Array:
        return np.stack([columns[name] for name in names], axis=-1)[rows]

    rows = np.flatnonzero(columns["truth_touching"] == 1.0)
    return Contacts(
        time_s=columns["t_s"][rows],
        base_pose=stacked("base_x_m", "base_y_m", "base_yaw_rad"),
        moment_n_m=columns["moment_z_n_m"][rows],
        contact_m=stacked("truth_contact_x_m", "truth_contact_y_m"),
        surface_m=stacked("truth_surface_x_m", "truth_surface_y_m"),
        arc_m=columns["truth_arc_m"][rows],
        force_n=columns["truth_force_n"][rows],
        friction_rad=columns.get("truth_friction_angle_rad", np.zeros(len(columns["t_s"])))[rows],
        on_the_side=((columns["truth_tip"] == 0.0) & (columns["truth_split"] == 0.0))[rows],
        recording_end_s=float(columns["t_s"][-1]),
    )


def compare_contacts(trace: str, scene: Scene, contacts: Contacts, trace_sha256: str) -> tuple[Row, list[Instant]]:
    """Compares the instants of contact of a trace; the errors of the instants are returned for lateral sweeps only."""
    slow = quasi_static(contacts)
    found = disagreement(scene.resolved_whisker, scene.object, scene.face, contacts)
    solved = found.exact.solved
    good = slow & solved
    range_n_m = largest(contacts.moment_n_m)
    moment_error = found.moment_n_m / range_n_m
    gaps_s = np.diff(contacts.time_s)
    following = good[1:] & good[:-1] & (gaps_s < 1.5 * np.min(gaps_s))
    row = Row(
        trace=trace,
        role=scene.role,
        touching=len(slow),
        quasi_static=int(np.sum(slow)),
        unsolved=int(np.sum(slow & ~solved)),
        range_n_m=range_n_m,
        moment_rms=rms(moment_error[good]),
        moment_worst=largest(moment_error[good]),
        moment_jump=largest(np.diff(moment_error)[following]),
        surface_rms_m=rms(found.surface_m[good]),
        surface_worst_m=largest(found.surface_m[good]),
        arc_rms_m=rms(found.arc_m[good]),
        arc_worst_m=largest(found.arc_m[good]),
        penetration_m=float(np.max(found.penetration_m[slow])),
        trace_sha256=trace_sha256,
    )
    if scene.motion_kind != "lateral_sweep":
        return row, []
    values = (contacts.time_s, contacts.moment_n_m, found.moment_n_m, found.surface_m, found.arc_m, slow.astype(int))
    instants = zip(*(array[solved].tolist() for array in values), strict=True)
    return row, [Instant(trace, *instant) for instant in instants]


def _tasks(dataset: Path) -> list[partial[tuple[Row, list[Instant]]]]:
    sidecars = sorted(dataset.glob("*.json"))
    if not sidecars:
        raise InputError(f"{dataset}: expected the traces of the standard suite, found none; simulate the suite first")
    return [partial(compare, path) for path in sidecars]


def claims_about(name: str, subject: str, rows: list[Row], times: float) -> list[Claim]:
    """Claims about the worst of some traces, `subject`, with bounds that are `times` those of the default simulation settings."""
    claims = []
    for field, figure, scale, bound, unit in (
        ("moment_rms", "base moment, RMS", PERCENT, 0.05, "% of range"),
        ("moment_jump", "base moment, largest jump of the error", PERCENT, 0.1, "% of range"),
        ("surface_rms_m", "surface contact, RMS", 1e3, 0.005, "mm"),
        ("surface_worst_m", "surface contact, worst", 1e3, 0.03, "mm"),
        ("arc_rms_m", "arc length, RMS", 1e3, 0.02, "mm"),
        ("penetration_m", "penetration", 1e6, 5.0, "um"),
        ("unsolved", "instants without a contact in one point", 1.0, 0.0, ""),
    ):
        if rows:
            # The first NaN, if there is one.
            worst = rows[int(np.argmax([getattr(row, field) for row in rows]))]
            claim = f"{subject}: {figure} ({worst.trace})"
            claims.append(Claim(f"{name}_{field}", claim, scale * getattr(worst, field), "<=", times * bound, unit))
    return claims


def _conclude(results: list[tuple[Row, list[Instant]]]) -> Findings:
    rows = [row for row, _ in results]
    claims = [
        claim
        for role, subject in (("trial", "trials"), ("calibration", "calibrations"))
        for claim in claims_about(role, subject, [row for row in rows if row.role == role], 1.0)
    ]
    return Findings({"sweeps": rows, "sweep_errors": [instant for _, instants in results for instant in instants]}, claims)


STUDY = Study("sweeps", "traces of the standard suite against the elastica", _tasks, _conclude)
