"""Reference solver of the whisker in space, by SciPy: the boundary-value problem from the root to the contact.

The equations of the Kirchhoff rod in Base, with the force n constant along the rod,

    dp/ds = d1,  dq/ds = q (0, kappa) / 2,  dm/ds = -d1 x n,
    kappa_i = kappa0_i + m . di / C_i,  C = (GJ, EI, EI),

with the quaternion q of the directors, begin at the root with the rotation of the suspension, whose springs carry the moment m(0),
and end at the contact with m = 0 and the given components of n along the directors. The six unknowns m(0) and n are found by
shooting, continued from the unloaded whisker. Nothing but the parameters of the whisker is shared with the other two solvers
(`crates/whisker/src/rod`, `whisker_sim.rod`), which integrate from the contact.

`python -m whisker_sim.physics.scipy_rod` writes the golden cases that both languages test.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from whisker_sim.errors import SimulationError
from whisker_sim.paths import ROOT
from whisker_sim.physics.scipy_elastica import random_case, write_cases
from whisker_sim.rod import SpatiallyLoaded, Suspension, spatially_loaded
from whisker_sim.whisker import PRESETS, Arc, Array, Whisker

GOLDEN = ROOT / "datasets/golden/rod.csv"
GOLDEN_CASES = 100
GOLDEN_SEED = 1
HEADER = (
    "length_m,root_diameter_m,tip_diameter_m,youngs_modulus_pa,curvature,yaw_n_m_rad,pitch_n_m_rad,twist_n_m_rad,poisson_ratio,"
    "arc_m,along_n,left_n,up_n,point_x_m,point_y_m,point_z_m,tangent_x,tangent_y,tangent_z,moment_x_n_m,moment_y_n_m,moment_z_n_m"
)
_LOAD_STEPS = 8


@dataclass(frozen=True)
class Case:
    """A whisker in space and the load on it."""

    whisker: Whisker
    suspension: Suspension
    poisson_ratio: float
    arc_m: float
    force_n: Array
    """Components along the tangent and the left and upper normals at the contact."""

    def batched(self) -> SpatiallyLoaded:
        """Its solution by the solver for many loads at once."""
        loads = (np.array([self.arc_m]), self.force_n[None])
        return spatially_loaded(self.whisker, self.suspension, self.poisson_ratio, *loads)


def random_spatial_case(seed: int, index: int) -> Case:
    """A random whisker and load like those of the planar elastica, with the force turned about the wire.

    The springs of the root differ by up to a factor of 10 from that of the planar case.
    """
    whisker, arc_m, along_n, left_n = random_case(seed, index)
    rng = np.random.default_rng((seed, index, 3))
    yaw, pitch, twist = whisker.root_stiffness_n_m_rad * 10.0 ** rng.uniform(0.0, 1.0, 3)
    about_rad = rng.uniform(0.0, 2.0 * np.pi)
    force_n = np.array((along_n, left_n * np.cos(about_rad), left_n * np.sin(about_rad)))
    return Case(whisker, Suspension(yaw, pitch, twist), float(rng.uniform(0.0, 0.5)), arc_m, force_n)


def carried(case: Case, moment: Array, force: Array) -> tuple[Array, Array, Array]:
    """Point (3,), directors (3, 3) and moment (3,) at the contact, from a moment and a force (3,) in Base at the root."""
    whisker, arc_m = case.whisker, case.arc_m
    ends = np.cumsum([arc.length_m for arc in whisker.curvature])
    ends[-1] = whisker.length_m
    starts = np.concatenate(([0.0], ends[:-1]))

    def slope(s: float, state: Array, curvature_per_m: float) -> Array:
        (w, x, y, z), moment = state[3:7], state[7:]
        # The state of a trial step may leave the unit quaternions by its error.
        directors = Rotation.from_quat((x, y, z, w)).as_matrix()
        diameter_m = whisker.root_diameter_m + s / whisker.length_m * (whisker.tip_diameter_m - whisker.root_diameter_m)
        bending_n_m2 = whisker.youngs_modulus_pa * np.pi * diameter_m**4 / 64.0
        a, b, c = directors.T @ moment / bending_n_m2 * (1.0 + case.poisson_ratio, 1.0, 1.0) + (0.0, 0.0, curvature_per_m)
        turn = 0.5 * np.array((-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a))
        return np.concatenate((directors[:, 0], turn, np.cross(force, directors[:, 0])))

    x, y, z, w = _suspended(case.suspension, moment).as_quat()
    state = np.concatenate((np.zeros(3), (w, x, y, z), moment))
    size_n_m = float(np.linalg.norm(case.force_n)) * arc_m
    for start_m, end_m, arc in zip(starts, ends, whisker.curvature, strict=True):
        if arc_m > start_m:
            options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14 * np.array((1.0,) * 7 + (size_n_m,) * 3)}
            span_m = (start_m, min(arc_m, end_m))
            state = solve_ivp(slope, span_m, state, args=(arc.curvature_per_m,), **options).y[:, -1]
    w, x, y, z = state[3:7]
    return state[:3], Rotation.from_quat((x, y, z, w)).as_matrix(), state[7:]


def solve(case: Case) -> tuple[Array, Array, Array]:
    """Contact point, tangent there and moment at the root, each (3,) in Base."""
    whisker, arc_m = case.whisker, case.arc_m
    size_n = float(np.linalg.norm(case.force_n))
    scale = np.array((size_n * arc_m,) * 3 + (size_n,) * 3)
    rest_rad = whisker.rest_angle_rad(arc_m)
    force = Rotation.from_euler("z", float(rest_rad)).apply(case.force_n)
    unknown = np.concatenate((np.cross(np.append(whisker.rest_point_m(arc_m), 0.0), force), force)) / scale / _LOAD_STEPS
    for step in range(1, _LOAD_STEPS + 1):
        share = step / _LOAD_STEPS

        def miss(unknown: Array, share: float = share) -> Array:
            moment, force = (unknown * scale).reshape(2, 3)
            _, directors, rest = carried(case, moment, force)
            return np.concatenate((rest, directors.T @ force - share * case.force_n)) / scale

        solution = root(miss, unknown, tol=1e-12)
        if np.max(np.abs(solution.fun)) > 1e-9:
            raise SimulationError(f"{whisker.name}: SciPy finds no equilibrium in space: {solution.message}")
        unknown = solution.x * (share + 1.0 / _LOAD_STEPS) / share
    moment, force = (solution.x * scale).reshape(2, 3)
    point_m, directors, _ = carried(case, moment, force)
    return point_m, directors[:, 0], moment


def _suspended(suspension: Suspension, moment: Array) -> Rotation:
    """Rotation of the root whose springs carry a moment (3,) in Base, by iteration from no rotation."""
    stiffness = np.array((suspension.yaw_n_m_rad, suspension.pitch_n_m_rad, suspension.twist_n_m_rad))

    def miss(angles: Array) -> Array:
        yaw = Rotation.from_euler("z", angles[0])
        pitch = yaw * Rotation.from_euler("y", angles[1])
        axes = np.stack(((0.0, 0.0, 1.0), yaw.apply((0.0, 1.0, 0.0)), pitch.apply((1.0, 0.0, 0.0))))
        return angles - axes @ moment / stiffness

    angles = root(miss, np.array((moment[2], moment[1], moment[0])) / stiffness, tol=1e-14).x
    return Rotation.from_euler("ZYX", angles)


def row(case: Case, point_m: Array, tangent: Array, moment_n_m: Array) -> str:
    """One row of a file of cases."""
    whisker, suspension = case.whisker, case.suspension
    curvature = ";".join(f"{arc.length_m!r}:{arc.curvature_per_m!r}" for arc in whisker.curvature)
    wire = (whisker.length_m, whisker.root_diameter_m, whisker.tip_diameter_m, whisker.youngs_modulus_pa)
    springs = (suspension.yaw_n_m_rad, suspension.pitch_n_m_rad, suspension.twist_n_m_rad, case.poisson_ratio)
    numbers = (*springs, case.arc_m, *case.force_n, *point_m, *tangent, *moment_n_m)
    return ",".join([*(repr(float(number)) for number in wire), curvature, *(repr(float(number)) for number in numbers)])


def read_cases(path: Path) -> Iterator[tuple[Case, Array]]:
    """Case and solution (point, tangent, moment; 9 numbers) of every row."""
    for line in path.read_text(encoding="utf-8").splitlines()[1:]:
        fields = line.split(",")
        pieces = [[float(number) for number in piece.split(":")] for piece in fields[4].split(";")]
        wire = [float(field) for field in fields[:4]]
        numbers = np.array(fields[5:], dtype=float)
        whisker = msgspec.structs.replace(
            PRESETS["straight"][1],
            name="random",
            length_m=wire[0],
            root_diameter_m=wire[1],
            tip_diameter_m=wire[2],
            youngs_modulus_pa=wire[3],
            curvature=tuple(Arc(*piece) for piece in pieces),
        )
        case = Case(whisker, Suspension(*numbers[:3]), numbers[3], numbers[4], numbers[5:8])
        yield case, numbers[8:]


def deviation(case: Case, answer: Array) -> float:
    """Largest relative deviation of the solver for many loads at once from a solution: point, tangent and moment."""
    found = case.batched()
    point, tangent, moment = answer.reshape(3, 3)
    apart = np.linalg.norm(found.point_m[0] - point) / case.arc_m
    turned = np.linalg.norm(found.directors[0, :, 0] - tangent)
    return float(max(apart, turned, np.linalg.norm(found.moment_n_m[0] - moment) / np.linalg.norm(moment)))


if __name__ == "__main__":
    golden = (random_spatial_case(GOLDEN_SEED, index) for index in range(GOLDEN_CASES))
    write_cases(GOLDEN, HEADER, (row(case, *solve(case)) for case in golden))
