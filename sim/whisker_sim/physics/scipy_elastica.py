"""Reference solver of the exact quasi-static whisker, by SciPy.

A point contact at the arc length a loads the rod with a force (f_t, f_n) along its tangent and its left normal, and with a couple
c; beyond the contact the rod is unloaded. With the contact at the origin and the tangent along +x, the equations are integrated
back to the root:

    dx/ds = cos t,  dy/ds = sin t,  dt/ds = kappa0(s) + m(s) / EI(s),  m(s) = c + y(s) f_t - x(s) f_n.

Without friction the force is normal to the surface. On the side of the whisker f_t is the force times the slope r' of the radius,
zero without taper; at the tip it depends on the object. Friction acts on the surface, at the radius from the centre line, which
gives the couple. The bending moment m(0) at the root rotates the compliant root by m(0) / k.
Only the parameters of the whisker are shared with the simulator, and nothing with the two other solvers: the one in Rust, which
sums Taylor series, and the one for many base poses at once (`whisker_sim.elastica`), which takes equal steps. The study `oracle`
compares all three.

`python -m whisker_sim.physics.scipy_elastica` writes the golden cases that both languages test.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from whisker_sim.errors import SimulationError
from whisker_sim.paths import ROOT
from whisker_sim.trace import write_atomically
from whisker_sim.whisker import PRESETS, Arc, Array, Whisker

GOLDEN = ROOT / "datasets/golden/elastica.csv"
GOLDEN_CASES = 200
GOLDEN_SEED = 1
HEADER = (
    "length_m,root_diameter_m,tip_diameter_m,youngs_modulus_pa,root_stiffness_n_m_rad,curvature,arc_m,along_n,left_n,couple_n_m,"
    "point_x_m,point_y_m,tangent_rad,moment_n_m,tip_x_m,tip_y_m"
)


@dataclass(frozen=True)
class StaticContact:
    """A loaded whisker, in Base."""

    point_m: Array
    angle_rad: float
    moment_n_m: float
    tip_m: Array


def static_contact(whisker: Whisker, arc_m: float, force_n: float, along_n: float = 0.0, couple_n_m: float = 0.0) -> StaticContact:
    """The whisker under a force at the arc length `arc_m`: `force_n` to the left, `along_n` towards the tip; and a couple there."""

    def slope(s: float, state: Array, curvature_per_m: float) -> tuple[float, float, float]:
        x, y, t = state
        diameter_m = whisker.root_diameter_m + s / whisker.length_m * (whisker.tip_diameter_m - whisker.root_diameter_m)
        bending_n_m2 = whisker.youngs_modulus_pa * np.pi * diameter_m**4 / 64.0
        return np.cos(t), np.sin(t), curvature_per_m + (couple_n_m + y * along_n - x * force_n) / bending_n_m2

    ends = np.cumsum([arc.length_m for arc in whisker.curvature])
    # Avoid the rounding error of the sum.
    ends[-1] = whisker.length_m
    starts = np.concatenate(([0.0], ends[:-1]))
    state = np.zeros(3)
    # One integration per piece: the step control does not cross jumps of the curvature.
    for start_m, end_m, arc in reversed(list(zip(starts, ends, whisker.curvature, strict=True))):
        if arc_m > start_m:
            span_m = (min(arc_m, end_m), start_m)
            tolerance = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
            state = solve_ivp(slope, span_m, state, args=(arc.curvature_per_m,), **tolerance).y[:, -1]
    x, y, t = state
    moment_n_m = couple_n_m + y * along_n - x * force_n
    angle_rad = moment_n_m / whisker.root_stiffness_n_m_rad - t
    point_m = _turned(angle_rad, np.array((-x, -y)))
    beyond_m = whisker.rest_point_m(whisker.length_m) - whisker.rest_point_m(arc_m)
    tip_m = point_m + _turned(angle_rad - float(whisker.rest_angle_rad(arc_m)), beyond_m)
    return StaticContact(point_m, angle_rad, moment_n_m, tip_m)


def _turned(angle_rad: float, vector: Array) -> Array:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array((cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]))


def push(whisker: Whisker, face: int, friction_rad: float = 0.0) -> tuple[float, float]:
    """Direction in which an object on the side `face` (+1 left) pushes the whisker: components to the left and along.

    It is at the angle `friction_rad` to the normal of the surface of the whisker, positive towards the tip.
    """
    angle_rad = friction_rad + float(np.arcsin(whisker.radius_slope))
    return -face * float(np.cos(angle_rad)), float(np.sin(angle_rad))


def pushed(whisker: Whisker, face: int, arc_m: float, force_n: float, friction_rad: float) -> StaticContact:
    """The whisker under a force of magnitude `force_n` of an object, as in `push`, at its surface."""
    left, along = push(whisker, face, friction_rad)
    couple_n_m = -face * float(whisker.radius_m(arc_m)) * force_n * np.sin(friction_rad)
    return static_contact(whisker, arc_m, left * force_n, along * force_n, couple_n_m)


def contact_with_disc(
    whisker: Whisker, center_m: Array, radius_m: float, face: int, guess: tuple[float, float], friction_rad: float = 0.0
) -> tuple[float, float, StaticContact]:
    """Solves for the contact with a disc at `center_m` (in Base) on the side `face` (+1 left) of the whisker.

    `friction_rad` is the force's angle to the normal. Returns arc length, magnitude of the force and the loaded whisker. `guess`
    contains the first two.
    """
    left, along = push(whisker, face)

    def miss(unknown: Array) -> Array:
        arc_m, force_n = unknown * (1e-2, 1e-3)
        contact = pushed(whisker, face, arc_m, force_n, friction_rad)
        # The normal is the direction of a frictionless force; the disc is on the side from which it acts.
        towards_disc = _turned(contact.angle_rad, np.array((-along, -left)))
        return 1e3 * (contact.point_m + (radius_m + whisker.radius_m(arc_m)) * towards_disc - center_m)

    solution = root(miss, np.array(guess) / (1e-2, 1e-3), tol=1e-12)
    if not (solution.success or np.max(np.abs(solution.fun)) < 1e-8):
        raise SimulationError(f"{whisker.name}: SciPy finds no contact with the disc: {solution.message}")
    arc_m, force_n = solution.x * (1e-2, 1e-3)
    return arc_m, force_n, pushed(whisker, face, arc_m, force_n, friction_rad)


def random_case(seed: int, index: int) -> tuple[Whisker, float, float, float]:
    """A random whisker with the arc length of its contact and the force, along and to the left; one in four is oblique at the tip.

    One to four pieces of pre-curvature, taper down to a quarter, soft to stiff root, deflections up to 2.5 rad in total.
    """
    rng = np.random.default_rng((seed, index))
    length_m = rng.uniform(0.03, 0.12)
    shares = rng.uniform(0.2, 1.0, rng.integers(1, 5))
    root_diameter_m = rng.uniform(0.1e-3, 0.4e-3)
    stiffness_n_m = 60e9 * np.pi * root_diameter_m**4 / 64.0 / length_m
    whisker = msgspec.structs.replace(
        PRESETS["straight"][1],
        name="random",
        length_m=length_m,
        root_diameter_m=root_diameter_m,
        tip_diameter_m=root_diameter_m * rng.uniform(0.25, 1.0),
        curvature=tuple(Arc(float(part), rng.uniform(-0.8, 0.8) / length_m) for part in length_m * shares / shares.sum()),
        root_stiffness_n_m_rad=float(stiffness_n_m * 10.0 ** rng.uniform(-0.5, 2.0)),
    )
    at_tip = index % 4 == 0
    arc_m = length_m if at_tip else length_m * rng.uniform(0.1, 1.0)
    middles_m = arc_m * (np.arange(200) + 0.5) / 200
    bending_n_m2 = whisker.youngs_modulus_pa * np.pi * whisker.diameter_m(middles_m) ** 4 / 64.0
    bend_rad_n = np.sum((arc_m - middles_m) / bending_n_m2) * arc_m / 200 + arc_m / whisker.root_stiffness_n_m_rad
    force_n = rng.uniform(-2.5, 2.5) / bend_rad_n
    tilt_rad = rng.uniform(0.0, 0.8) if at_tip else 0.0
    return whisker, float(arc_m), float(-abs(force_n) * np.sin(tilt_rad)), float(force_n * np.cos(tilt_rad))


def random_friction(seed: int, index: int) -> tuple[Whisker, float, float, float, float]:
    """As `random_case`, with the couple; in two of four cases friction turns the force by up to 45 degrees."""
    whisker, arc_m, along_n, left_n = random_case(seed, index)
    friction_rad = np.random.default_rng((seed, index, 1)).uniform(-0.25 * np.pi, 0.25 * np.pi) if index % 4 in (1, 2) else 0.0
    cos, sin = np.cos(friction_rad), np.sin(friction_rad)
    face = -float(np.sign(left_n))
    couple_n_m = -face * float(whisker.radius_m(arc_m)) * np.hypot(along_n, left_n) * sin
    return whisker, arc_m, float(cos * along_n - face * sin * left_n), float(cos * left_n + face * sin * along_n), float(couple_n_m)


def solved_case(seed: int, index: int) -> str:
    """One row: a random case and its solution."""
    whisker, arc_m, along_n, left_n, couple_n_m = random_friction(seed, index)
    contact = static_contact(whisker, arc_m, left_n, along_n, couple_n_m)
    curvature = ";".join(f"{arc.length_m!r}:{arc.curvature_per_m!r}" for arc in whisker.curvature)
    wire = (whisker.length_m, whisker.root_diameter_m, whisker.tip_diameter_m, whisker.youngs_modulus_pa)
    answer = (*contact.point_m, contact.angle_rad, contact.moment_n_m, *contact.tip_m)
    numbers = [repr(float(number)) for number in (*wire, whisker.root_stiffness_n_m_rad)]
    numbers += [curvature] + [repr(float(number)) for number in (arc_m, along_n, left_n, couple_n_m, *answer)]
    return ",".join(numbers)


def read_cases(path: Path) -> Iterator[tuple[Whisker, tuple[float, float, float, float], Array]]:
    """Whisker, load (arc length, along, left, couple) and solution (point, tangent, moment, tip) of every row."""
    for line in path.read_text(encoding="utf-8").splitlines()[1:]:
        fields = line.split(",")
        pieces = [[float(number) for number in piece.split(":")] for piece in fields[5].split(";")]
        length_m, root_diameter_m, tip_diameter_m, modulus_pa, stiffness_n_m_rad = map(float, fields[:5])
        whisker = msgspec.structs.replace(
            PRESETS["straight"][1],
            name="random",
            length_m=length_m,
            root_diameter_m=root_diameter_m,
            tip_diameter_m=tip_diameter_m,
            youngs_modulus_pa=modulus_pa,
            root_stiffness_n_m_rad=stiffness_n_m_rad,
            curvature=tuple(Arc(*piece) for piece in pieces),
        )
        arc_m, along_n, left_n, couple_n_m = map(float, fields[6:10])
        yield whisker, (arc_m, along_n, left_n, couple_n_m), np.array(fields[10:], dtype=float)


def write_cases(path: Path, header: str, rows: Iterable[str]) -> None:
    """Writes solved cases below their header."""
    write_atomically(path, "\n".join((header, *rows, "")).encode())


if __name__ == "__main__":
    write_cases(GOLDEN, HEADER, (solved_case(GOLDEN_SEED, index) for index in range(GOLDEN_CASES)))
