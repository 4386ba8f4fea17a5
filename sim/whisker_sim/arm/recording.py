"""Files of a recording of several whiskers, as specified in `datasets/FORMAT.md`."""

from pathlib import Path

import msgspec
import numpy as np

from whisker_sim.arm import panda
from whisker_sim.arm.scene import ArmScene, trace_name
from whisker_sim.arm.simulate import SimulatedPassage, seen_from_objects
from whisker_sim.arm.tool import FACE, MOUNTS
from whisker_sim.certificate import certify
from whisker_sim.documents import to_json
from whisker_sim.runs import Run
from whisker_sim.trace import (
    COLUMNS,
    Contour,
    Generator,
    contour_of,
    format_csv,
    generator,
    inputs_sha256,
    remove_leftovers,
    sha256,
    sidecar_of,
    trace_columns,
    write_atomically,
)
from whisker_sim.whisker import Array


class File(msgspec.Struct, frozen=True):
    """A file of the recording and its hash."""

    file: str
    sha256: str


class WhiskerMount(msgspec.Struct, frozen=True):
    """One whisker of the recording, which has a trace of its own."""

    name: str
    trace: str
    array: str
    mount: tuple[float, ...]
    """Pose (4, 4), row by row, of the whisker's Base in the frame of the flange."""


class Kinematics(msgspec.Struct, frozen=True):
    """Kinematics of the arm in Craig's convention with theta = q."""

    name: str
    base: tuple[float, ...]
    """Pose (4, 4), row by row, of the arm's base in World."""
    links: tuple[panda.Link, ...]
    flange_d_m: float


class RecordedObject(msgspec.Struct, frozen=True):
    """One object of the recording."""

    name: str
    shape: str
    mass_kg: float
    height_m: float
    friction: float
    contour: Contour


class Recording(msgspec.Struct, frozen=True):
    """Metadata of a recording, with references to its traces."""

    format: int
    kind: str
    name: str
    seed: int
    rate_hz: float
    rows: int
    whiskers: tuple[WhiskerMount, ...]
    arm: Kinematics
    objects: tuple[RecordedObject, ...]
    joints: File
    poses: File
    scene: ArmScene
    generator: Generator
    inputs_sha256: str


def write_recording(folder: Path, run: Run, passed: SimulatedPassage) -> str:
    """Writes a trace per whisker, joints, displacements and outlines of the objects and, last, `<name>.json` into `folder`.

    Returns one line of text for the user.
    """
    scene, name = run.scene, run.name
    files: dict[str, bytes] = {}

    def add(file: str, content: bytes) -> File:
        files[file] = content
        return File(file, sha256(content))

    joints = add(f"{name}.joints.csv", _joints_csv(passed))
    poses = add(f"{name}.objects.csv", _objects_csv(passed))
    objects = []
    for free in scene.objects:
        contour, outline = contour_of(f"{name}.{free.name}", free.object)
        add(contour.file, outline)
        shape = free.object.__struct_config__.tag
        objects.append(RecordedObject(free.name, shape, free.mass_kg, free.height_m, free.friction, contour))
    for whisker, simulated in passed.whiskers.items():
        trace = trace_name(name, whisker)
        csv = format_csv(trace_columns(simulated, scene.resolved_whisker), COLUMNS)
        add(f"{trace}.csv", csv)
        shapes = [free.object for free in scene.objects]
        seen = seen_from_objects(scene, passed.objects, simulated)
        certificate = certify(scene.resolved_whisker, shapes, FACE, seen, scene.vibration is not None)
        add(f"{trace}.json", to_json(sidecar_of(trace, scene, "several", FACE, csv, None, certificate, name)))
    recording = Recording(
        format=scene.format,
        kind="recording",
        name=name,
        seed=scene.seed,
        rate_hz=scene.rate_hz,
        rows=len(passed.time_s),
        whiskers=tuple(
            WhiskerMount(mount.name, trace_name(name, mount.name), mount.array, _numbers(mount.in_flange)) for mount in MOUNTS
        ),
        arm=Kinematics(panda.NAME, _numbers(scene.arm.base), panda.LINKS, panda.FLANGE_D_M),
        objects=tuple(objects),
        joints=joints,
        poses=poses,
        scene=scene,
        generator=generator(),
        inputs_sha256=inputs_sha256(scene),
    )
    folder.mkdir(parents=True, exist_ok=True)
    # Old descriptions must not remain beside new files.
    for made in scene.names(name):
        (folder / f"{made}.json").unlink(missing_ok=True)
        remove_leftovers(folder, made)
    for file, content in files.items():
        write_atomically(folder / file, content)
    write_atomically(folder / f"{name}.json", to_json(recording))
    shares = [f"{100 * whisker.touching.mean():.0f}" for whisker in passed.whiskers.values()]
    return f"{run.name}: {passed.time_s[-1]:.1f} s, {', '.join(shares)} % in contact"


def is_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the recording of `run`: same inputs, and files that match their hashes."""
    try:
        recording = msgspec.json.decode((folder / f"{run.name}.json").read_bytes())
        hashes = [recording["joints"], recording["poses"], *(one["contour"] for one in recording["objects"])]
        for one in recording["whiskers"]:
            sidecar = msgspec.json.decode((folder / f"{one['trace']}.json").read_bytes())
            hashes.append({"file": f"{one['trace']}.csv", "sha256": sidecar["csv_sha256"]})
            if sidecar["inputs_sha256"] != recording["inputs_sha256"]:
                return False
        return recording["inputs_sha256"] == inputs_sha256(run.scene) and all(
            entry["sha256"] == sha256((folder / entry["file"]).read_bytes()) for entry in hashes
        )
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return False


def _joints_csv(passed: SimulatedPassage) -> bytes:
    angles = [(f"q{joint}_rad", 12) for joint in range(1, panda.JOINTS + 1)]
    speeds = [(f"dq{joint}_rad_s", 12) for joint in range(1, panda.JOINTS + 1)]
    return format_csv([passed.time_s, *passed.q_rad.T, *passed.dq_rad_s.T], (("t_s", 6), *angles, *speeds))


def _objects_csv(passed: SimulatedPassage) -> bytes:
    columns, values = [("t_s", 6)], [passed.time_s]
    for name, moved in passed.objects.items():
        columns += [(f"{name}_{key}", 10) for key in ("x_m", "y_m", "z_m", "yaw_rad", "tilt_rad")]
        values += [*moved.T]
    return format_csv(values, tuple(columns))


def _numbers(pose: Array) -> tuple[float, ...]:
    """A pose (4, 4) row by row; rounding errors of rotations are replaced by exact zeros."""
    return tuple(np.where(np.abs(pose) < 1e-15, 0.0, pose).ravel().tolist())
