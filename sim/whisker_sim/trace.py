"""Files of a trace: rows (CSV), outline and sidecar, as specified in `datasets/FORMAT.md`."""

import functools
import hashlib
import os
import subprocess
import tempfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np

import whisker_sim
from whisker_sim.certificate import Certificate, certify
from whisker_sim.documents import to_json
from whisker_sim.paths import IN_REPOSITORY
from whisker_sim.replay import Replay
from whisker_sim.runs import Run
from whisker_sim.shapes import Shape
from whisker_sim.simulate import Simulated
from whisker_sim.whisker import Array, Whisker

COLUMNS = (
    ("t_s", 6),
    ("base_x_m", 10),
    ("base_y_m", 10),
    ("base_yaw_rad", 10),
    ("base_vx_m_s", 10),
    ("base_vy_m_s", 10),
    ("base_wz_rad_s", 10),
    ("moment_z_n_m", 15),
    ("rotation_z_rad", 10),
    ("truth_touching", 0),
    ("truth_tip", 0),
    ("truth_split", 0),
    ("truth_contact_x_m", 10),
    ("truth_contact_y_m", 10),
    ("truth_surface_x_m", 10),
    ("truth_surface_y_m", 10),
    ("truth_arc_m", 10),
    ("truth_force_n", 12),
    ("truth_tangent_rad", 10),
)
"""Columns of a trace in order, with their numbers of decimals."""
FRICTION_COLUMNS = (("truth_friction_angle_rad", 10), ("truth_slip_m_s", 10), ("truth_sticking", 0))
"""Further columns of a trace of a scene with friction."""
SECOND_COLUMNS = (
    ("truth_second_contact_x_m", 10),
    ("truth_second_contact_y_m", 10),
    ("truth_second_surface_x_m", 10),
    ("truth_second_surface_y_m", 10),
    ("truth_second_arc_m", 10),
    ("truth_second_force_n", 12),
)
"""Further columns of a trace with an object that is not convex."""
YIELDING_COLUMNS = (
    ("truth_object_x_m", 10),
    ("truth_object_y_m", 10),
    ("truth_object_yaw_rad", 10),
    ("truth_indentation_m", 10),
)
"""Further columns of a trace with an object that gives way."""

_PACKAGE = Path(whisker_sim.__file__).parent
_WITHOUT_INFLUENCE = {
    "__main__.py",
    "arm/picture.py",
    "cli.py",
    "cluster.py",
    "drawing.py",
    "export.py",
    "jobs.py",
    "lock.py",
    "paths.py",
    "physics",
    "products.py",
    "progress.py",
    "random_suite/picture.py",
    "render.py",
    "rig",
    "schema.py",
    "space/picture.py",
    "space/replay.py",
    "space/statics.py",
    "startup.py",
}
"""Modules and packages that do not influence the bytes of a trace; a change in them makes no trace out of date."""


class Generator(msgspec.Struct, frozen=True):
    """Versions of the program that made a trace."""

    name: str
    version: str
    mujoco: str
    git_commit: str | None
    source_sha256: str


class Contour(msgspec.Struct, frozen=True):
    """Outline of the object of a trace."""

    file: str
    sha256: str
    chord_error_m: float


AnyScene = TypeVar("AnyScene")


class Sidecar(msgspec.Struct, Generic[AnyScene], frozen=True):
    """Metadata of a trace."""

    format: int
    kind: str
    name: str
    role: str
    group: str
    object: str
    face: str
    seed: int
    rate_hz: float
    rows: int
    whisker: Whisker
    scene: AnyScene
    generator: Generator
    inputs_sha256: str
    csv_sha256: str
    contour: Contour | None
    """`None` in a trace of a recording, which has the outlines of all its objects."""
    certificate: Certificate
    recording: str | msgspec.UnsetType = msgspec.UNSET
    """Name of the recording of several whiskers to which the trace belongs; omitted if there is none."""
    replay: Replay | msgspec.UnsetType = msgspec.UNSET
    """Effects to be added at replay; omitted if the scene states none."""


def write_trace(folder: Path, run: Run, simulated: Simulated) -> str:
    """Writes the files of the trace `run` into `folder`; returns one line of text for the user."""
    scene = run.scene
    certificate = certify(scene.resolved_whisker, [scene.object], scene.face, simulated, scene.vibration is not None)
    write_files(folder, run, simulated, certificate, inputs_sha256(scene))
    return f"{run.name}: {simulated.time_s[-1]:.1f} s, {100 * simulated.touching.mean():.0f} % in contact"


def write_files(folder: Path, run: Run, simulated: Simulated, certificate: Certificate, made_from: str) -> None:
    """Writes `<name>.csv`, `<name>.contour.csv` and, last, `<name>.json` into `folder`; `made_from` is the hash of the inputs.

    The sidecar is last, so that its presence shows that the trace is complete.
    """
    scene = run.scene
    columns = COLUMNS
    if simulated.friction is not None:
        columns += FRICTION_COLUMNS
    if simulated.second is not None:
        columns += SECOND_COLUMNS
    if simulated.yielding is not None:
        columns += YIELDING_COLUMNS
    csv = format_csv(trace_columns(simulated, scene.resolved_whisker), columns)
    contour, outline = contour_of(run.name, scene.object)
    sidecar = sidecar_of(run.name, scene, scene.shape, scene.face, csv, contour, certificate)
    sidecar = msgspec.structs.replace(sidecar, inputs_sha256=made_from, replay=scene.replay)
    folder.mkdir(parents=True, exist_ok=True)
    # An old sidecar must not remain beside rows that it does not describe.
    (folder / f"{run.name}.json").unlink(missing_ok=True)
    write_atomically(folder / f"{run.name}.csv", csv)
    write_atomically(folder / contour.file, outline)
    write_atomically(folder / f"{run.name}.json", to_json(sidecar))


def contour_of(name: str, shape: Shape) -> tuple[Contour, bytes]:
    """Outline of `shape` as the file `<name>.contour.csv`, and its content."""
    outline_m = shape.outline_m()
    outline = format_csv([outline_m[:, 0], outline_m[:, 1]], (("x_m", 10), ("y_m", 10)))
    return Contour(f"{name}.contour.csv", sha256(outline), shape.chord_error_m()), outline


def sidecar_of(
    name: str,
    scene: AnyScene,
    shape: str,
    face: str,
    csv: bytes,
    contour: Contour | None,
    certificate: Certificate,
    recording: str | msgspec.UnsetType = msgspec.UNSET,
) -> Sidecar[AnyScene]:
    """Sidecar of the trace `name` with the rows `csv`."""
    return Sidecar(
        format=scene.format,
        kind="trace",
        name=name,
        role=scene.role,
        group=scene.group,
        object=shape,
        face=face,
        seed=scene.seed,
        rate_hz=scene.rate_hz,
        rows=csv.count(b"\n") - 1,
        whisker=scene.resolved_whisker,
        scene=scene,
        generator=generator(),
        inputs_sha256=inputs_sha256(scene),
        csv_sha256=sha256(csv),
        contour=contour,
        certificate=certificate,
        recording=recording,
    )


def is_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the trace of `run`: same inputs, and files that match their hashes."""
    return is_complete(folder, run.name, inputs_sha256(run.scene))


def is_complete(folder: Path, name: str, made_from: str) -> bool:
    """Whether `folder` holds the trace `name` of inputs with the hash `made_from`, and files that match their hashes."""
    try:
        sidecar = msgspec.json.decode((folder / f"{name}.json").read_bytes())
        return bool(
            sidecar["inputs_sha256"] == made_from
            and sidecar["csv_sha256"] == sha256((folder / f"{name}.csv").read_bytes())
            and sidecar["contour"]["sha256"] == sha256((folder / f"{name}.contour.csv").read_bytes())
        )
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return False


def trace_columns(simulated: Simulated, whisker: Whisker) -> list[Array]:
    """Values (n,) of all columns of the trace in order; NaN for unknown values."""
    touching, truth = simulated.touching, simulated.truth
    root_rad = simulated.rotations_rad[:, 0]
    while_touching = [
        truth.tip.astype(float),
        simulated.split.astype(float),
        *truth.contact_m.T,
        *truth.surface_m.T,
        truth.arc_m,
        simulated.force_n,
        truth.tangent_rad,
    ]
    if simulated.friction is not None:
        friction = simulated.friction
        while_touching += [friction.angle_rad, friction.slip_m_s, friction.sticking.astype(float)]
    if simulated.second is not None:
        second = simulated.second
        while_touching += [*second.contact_m.T, *second.surface_m.T, second.arc_m, second.force_n]
    always = []
    if simulated.yielding is not None:
        given = simulated.yielding
        always = [*given.stand_m.T, given.yaw_rad, np.where(touching, np.hypot(*given.indentation_m.T), 0.0)]
    return [
        simulated.time_s,
        *simulated.base_pose.T,
        *simulated.base_twist.T,
        whisker.root_stiffness_n_m_rad * root_rad,
        root_rad,
        touching.astype(float),
        *(np.where(touching, values, np.nan) for values in while_touching),
        *always,
    ]


def format_csv(values: list[Array], columns: tuple[tuple[str, int], ...]) -> bytes:
    """CSV with a header and a fixed number of decimals per column; NaN becomes an empty field and -0 becomes 0."""
    fields = [_format(column, decimals) for column, (_, decimals) in zip(values, columns, strict=True)]
    lines = [",".join(name for name, _ in columns), *map(",".join, zip(*fields, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _format(values: Array, decimals: int) -> list[str]:
    negative_zero = f"{-0.0:.{decimals}f}"
    texts = ("" if value != value else f"{value:.{decimals}f}" for value in values.tolist())
    return [text.removeprefix("-") if text == negative_zero else text for text in texts]


def write_atomically(path: Path, content: bytes) -> None:
    """Writes a temporary file in the same folder and renames it, so that existing files are complete.

    Raises `OSError` with the name `path` instead of that of the temporary file.
    """
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def remove_leftovers(folder: Path, name: str) -> None:
    """Removes temporary files of the trace `name` that a killed generator left."""
    for path in folder.glob(f".{name}.*.tmp"):
        path.unlink(missing_ok=True)


def inputs_sha256(scene: msgspec.Struct) -> str:
    """Hash of the inputs that determine a trace: scene with seed, sources of the generator, versions of the libraries."""
    own = generator()
    return sha256(to_json([scene, own.source_sha256, own.mujoco, version("numpy")]))


@functools.cache
def generator() -> Generator:
    """The running generator."""
    modules = (path.relative_to(_PACKAGE) for path in _PACKAGE.rglob("*.py"))
    digest = sources_sha256(m.as_posix() for m in modules if _WITHOUT_INFLUENCE.isdisjoint((m.parts[0], m.as_posix())))
    commit = _git_commit(_PACKAGE) if IN_REPOSITORY else None
    return Generator("whisker_sim", whisker_sim.__version__, version("mujoco"), commit, digest)


def sources_sha256(modules: Iterable[str]) -> str:
    """Hash of the sources of modules, given by their paths in this package."""
    digest = hashlib.sha256()
    for module in sorted(modules, key=Path):
        digest.update(module.encode() + b"\0" + (_PACKAGE / module).read_bytes() + b"\0")
    return digest.hexdigest()


def _git_commit(folder: Path) -> str | None:
    try:
        described: Any = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip()


def sha256(content: bytes) -> str:
    """SHA-256 of `content`, in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()
