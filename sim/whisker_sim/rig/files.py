"""Files `rig.csv` and `rig.json`, as specified in `datasets/FORMAT.md`."""

from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from whisker_sim.documents import to_json
from whisker_sim.errors import InputError
from whisker_sim.physics.frequencies import chain_hz
from whisker_sim.physics.ringing import fit, free_vibration
from whisker_sim.rig.magnet import Field, Magnet, Magnetometer, field_of
from whisker_sim.rig.table import COLUMNS, CONTACT_M, PUSH_M, Axis, grid
from whisker_sim.scene import Scene
from whisker_sim.shapes import AnyShape
from whisker_sim.trace import Generator, format_csv, generator, sha256, sources_sha256, write_atomically
from whisker_sim.whisker import Whisker

_SOURCES = ("physics/cases.py", "physics/frequencies.py", "physics/ringing.py", "rig/files.py", "rig/magnet.py", "rig/table.py")
"""Modules on which only the table depends; the hash of the generator in traces leaves them out."""
_NOT_AT_REST = ("vibration", "friction", "object_velocity_m_s", "object_stand", "object_stiffness_n_m")
"""Keys of a scene whose effects a table of readings at rest, under a rigid ruler without friction, does not have."""
_BENT_N_M = 5e-3
"""Moment from which the whisker is released, about that of the routine at the middle of the shaft."""
_PERIODS = 10
_PERIODS_OF_HIGH_MODES = 2


class Axes(msgspec.Struct, frozen=True):
    """Grid of the table."""

    contact_m: Axis = CONTACT_M
    push_m: Axis = PUSH_M


class Table(msgspec.Struct, frozen=True):
    """Table of the rig."""

    file: str
    sha256: str
    rows: int
    axes: Axes


class Rig(msgspec.Struct, frozen=True):
    """Metadata of the rig beside the rows of its table."""

    format: int
    kind: str
    table: Table
    ring_hz: float
    """Frequency of the released whisker."""
    decay_s: float
    """Time constant of its amplitude."""
    field: Field
    face: str
    """Side of the whisker on which the ruler is."""
    ruler: AnyShape
    whisker: Whisker
    scene: str
    """Name of the scene that defines whisker and ruler."""
    generator: Generator
    inputs_sha256: str


class Ringing(NamedTuple):
    """Frequency and time constant of a released whisker."""

    ring_hz: float
    decay_s: float


def ringing_of(whisker: Whisker, timestep_s: float) -> Ringing:
    """Releases `whisker` in MuJoCo with its base held, and evaluates its slowest mode over some periods."""
    period_s = 1.0 / float(chain_hz(whisker, 1)[0])
    time_s, moment_n_m, _ = free_vibration(whisker, timestep_s, _BENT_N_M, _PERIODS * period_s)
    slowest = time_s > _PERIODS_OF_HIGH_MODES * period_s
    ring_hz, _, decay_s = fit(time_s[slowest], moment_n_m[slowest])
    return Ringing(ring_hz, decay_s)


def write_rig(folder: Path, scene: Scene) -> Rig:
    """Writes `rig.csv` and, last, `rig.json` for whisker and object of `scene` into `folder`.

    Raises what `make_rig` does, and `OSError` if a file cannot be written.
    """
    rig, rows = make_rig(scene, Axes())
    folder.mkdir(parents=True, exist_ok=True)
    # An old description must not remain beside the new table.
    (folder / "rig.json").unlink(missing_ok=True)
    write_atomically(folder / rig.table.file, rows)
    write_atomically(folder / "rig.json", to_json(rig))
    return rig


def make_rig(scene: Scene, axes: Axes) -> tuple[Rig, bytes]:
    """Content of `rig.json`, and the bytes of its table.

    Raises `InputError`, which states the key but not the file, if the scene has effects that the table does not have, and
    `SimulationError` if the physics has no contact.
    """
    for key in _NOT_AT_REST:
        value = getattr(scene, key)
        if value is not None and value is not msgspec.UNSET:
            found = msgspec.json.encode(value).decode()
            raise InputError(
                f"{key}: expected no such key, since the readings are those of a fixed, rigid edge at rest, found {found}"
            )
    stage = scene.stage()
    contacts_m, pushes_m = axes.contact_m.values, axes.push_m.values
    rows = format_csv(grid(stage, contacts_m, pushes_m).columns(contacts_m, pushes_m), COLUMNS)
    ringing = ringing_of(stage.whisker, stage.timestep_s)
    field = field_of(Magnet(), Magnetometer())
    own = generator()
    rig = Rig(
        format=1,
        kind="rig",
        table=Table("rig.csv", sha256(rows), rows.count(b"\n") - 1, axes),
        ring_hz=_figure(ringing.ring_hz),
        decay_s=_figure(ringing.decay_s),
        field=field,
        face=scene.face,
        ruler=scene.object,
        whisker=stage.whisker,
        scene=scene.name,
        generator=own,
        inputs_sha256=sha256(
            to_json([scene, axes, field, own.source_sha256, sources_sha256(_SOURCES), own.mujoco, version("numpy")])
        ),
    )
    return rig, rows


def _figure(value: float) -> float:
    """Rounds to five significant digits; further digits may differ between machines."""
    return float(np.format_float_positional(value, precision=5, fractional=False))
