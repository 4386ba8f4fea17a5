"""Files of a trace in space, format 2, as specified in `datasets/FORMAT.md`: rows (CSV) and sidecar."""

from pathlib import Path

import msgspec
import numpy as np

from whisker_sim.documents import to_json
from whisker_sim.rod import Suspension
from whisker_sim.runs import Run
from whisker_sim.space.certificate import SpatialCertificate, certify_in_space
from whisker_sim.space.rotation import continuous, quaternion_of
from whisker_sim.space.scene import SpatialScene
from whisker_sim.space.simulate import SpatialSimulated
from whisker_sim.trace import Generator, format_csv, generator, inputs_sha256, sha256, write_atomically
from whisker_sim.whisker import Array, Whisker

_POSE = tuple((f"base_{name}", decimals) for name, decimals in (("x_m", 10), ("y_m", 10), ("z_m", 10)))
_QUATERNION = tuple((f"base_q{name}", 12) for name in "wxyz")
_TWIST = tuple((f"base_{name}", 10) for name in ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"))


def _vector(name: str, unit: str, decimals: int) -> tuple[tuple[str, int], ...]:
    return tuple((f"{name}_{axis}{unit}", decimals) for axis in "xyz")


SPATIAL_COLUMNS = (
    ("t_s", 6),
    *_POSE,
    *_QUATERNION,
    *_TWIST,
    *_vector("moment", "_n_m", 15),
    ("force_x_n", 12),
    ("rotation_yaw_rad", 10),
    ("rotation_pitch_rad", 10),
    ("rotation_twist_rad", 10),
    ("truth_touching", 0),
    ("truth_tip", 0),
    ("truth_split", 0),
    ("truth_feature", 0),
    *_vector("truth_contact", "_m", 10),
    *_vector("truth_surface", "_m", 10),
    *_vector("truth_normal", "", 10),
    ("truth_arc_m", 10),
    *_vector("truth_force", "_n", 12),
    *_vector("truth_tangent", "", 10),
)
"""Columns of a trace in space in order, with their numbers of decimals."""


class SpatialSidecar(msgspec.Struct, frozen=True):
    """Metadata of a trace in space."""

    format: int
    kind: str
    name: str
    role: str
    group: str
    object: str
    seed: int
    rate_hz: float
    rows: int
    whisker: Whisker
    suspension: Suspension
    poisson_ratio: float
    scene: SpatialScene
    generator: Generator
    inputs_sha256: str
    csv_sha256: str
    certificate: SpatialCertificate


def write_spatial_trace(folder: Path, run: Run, simulated: SpatialSimulated, made_from: str | None = None) -> str:
    """Writes `<name>.csv` and, last, `<name>.json` into `folder`; returns one line of text for the user.

    `made_from` is the hash of the inputs, by default that of the run.
    """
    scene = run.scene
    certificate = certify_in_space(scene.spatial_whisker, simulated.solid, simulated, scene.simulation.timestep_s)
    csv = format_csv(spatial_columns(simulated), SPATIAL_COLUMNS)
    sidecar = SpatialSidecar(
        format=scene.format,
        kind="trace",
        name=run.name,
        role=scene.role,
        group=scene.group,
        object=scene.shape,
        seed=scene.seed,
        rate_hz=scene.rate_hz,
        rows=len(simulated.time_s),
        whisker=scene.resolved_whisker,
        suspension=scene.resolved_suspension,
        poisson_ratio=scene.poisson_ratio,
        scene=scene,
        generator=generator(),
        inputs_sha256=made_from or spatial_inputs_sha256(run),
        csv_sha256=sha256(csv),
        certificate=certificate,
    )
    folder.mkdir(parents=True, exist_ok=True)
    # An old sidecar must not remain beside rows that it does not describe.
    (folder / f"{run.name}.json").unlink(missing_ok=True)
    write_atomically(folder / f"{run.name}.csv", csv)
    write_atomically(folder / f"{run.name}.json", to_json(sidecar))
    return f"{run.name}: {simulated.time_s[-1]:.1f} s, {100 * simulated.touching.mean():.0f} % in contact"


def is_spatial_up_to_date(folder: Path, run: Run) -> bool:
    """Whether `folder` holds exactly the trace of `run`."""
    try:
        return is_spatial_complete(folder, run.name, spatial_inputs_sha256(run))
    except (OSError, ValueError):
        return False


def is_spatial_complete(folder: Path, name: str, made_from: str) -> bool:
    """Whether `folder` holds the trace `name` of inputs with the hash `made_from`, and rows that match their hash."""
    try:
        sidecar = msgspec.json.decode((folder / f"{name}.json").read_bytes())
        return bool(
            sidecar["inputs_sha256"] == made_from and sidecar["csv_sha256"] == sha256((folder / f"{name}.csv").read_bytes())
        )
    except (OSError, ValueError, msgspec.DecodeError, KeyError, TypeError):
        return False


def spatial_inputs_sha256(run: Run) -> str:
    """Hash of the inputs that determine a trace, with the content of the solid's files."""
    placed = run.scene.solid.placed(run.path.parent)
    if placed is run.scene.solid:
        return inputs_sha256(run.scene)
    return sha256(to_json([inputs_sha256(run.scene), placed]))


def spatial_columns(simulated: SpatialSimulated) -> list[Array]:
    """Values (n,) of all columns in order; NaN for unknown values."""
    touching, truth = simulated.touching, simulated.truth
    while_touching = [
        truth.tip.astype(float),
        simulated.split.astype(float),
        truth.feature.astype(float),
        *truth.contact_m.T,
        *truth.surface_m.T,
        *truth.normal.T,
        truth.arc_m,
        *simulated.force_n.T,
        *truth.tangent.T,
    ]
    return [
        simulated.time_s,
        *simulated.position_m.T,
        *continuous(quaternion_of(simulated.rotation)).T,
        *simulated.velocity_m_s.T,
        *simulated.angular_rad_s.T,
        *simulated.moment_n_m.T,
        simulated.axial_n,
        *simulated.root_rad.T,
        touching.astype(float),
        *(np.where(touching, values, np.nan) for values in while_touching),
    ]
