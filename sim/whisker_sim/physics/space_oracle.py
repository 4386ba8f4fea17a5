"""Kirchhoff rods ("oracles in space") against one another, closed forms and published values.

The solvers in Rust and NumPy integrate from the contact to the root; SciPy, from the root to the contact. The equilibria that NumPy
finds are integrated by SciPy with their moment and force at the root: at the contact no moment must remain, and point and directors
must be the same. The solver in Rust is compared by its own tests, whose output is parsed here.
"""

import re
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from whisker_sim.physics.cases import WHISKERS, largest
from whisker_sim.physics.rust_tests import NUMBER, rust_tests
from whisker_sim.physics.scipy_elastica import write_cases
from whisker_sim.physics.scipy_rod import HEADER, Case, carried, row
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.rod import SpatiallyLoaded, Suspension, spatially_loaded
from whisker_sim.whisker import Array, Whisker

CASES = 10_000
"""Number of random contacts, evenly divided among the whiskers."""
DEEPEST = 0.4
"""Largest displacement of the contact, relative to the length of the whisker."""
_SEED = 5
_TASKS = 7
"""Tasks for each whisker."""
_ARCS = (0.3, 1.0)
"""Range of the contacts, relative to the length of the whisker."""
_LINEAR = 1.3
"""Largest depth by the theory of small deflections, relative to `DEEPEST`."""
_POISSON_RATIO = 0.33
_AGREEMENT = 1e-9

_RUST_TESTS = (
    "verif_a_load_in_the_plane_gives_the_planar_elastica",
    "val_quarter_circle_under_a_force_out_of_its_plane",
    "val_bend_of_bathe_and_bolourchi",
    "val_agrees_with_scipy",
)
_RUST_CASES = re.compile(rf"(\d+) cases: worst relative error of point {NUMBER}, tangent {NUMBER}, moment {NUMBER}")
_RUST_FIGURES = {
    "planar": re.compile(rf"planar loads: worst relative deviation of the moment {NUMBER}"),
    "quarter_circle": re.compile(rf"quarter circle: relative error of the displacement {NUMBER}"),
    "bend": re.compile(rf"bend, force {NUMBER}: relative error of the displacement {NUMBER}"),
}


class Agreement(NamedTuple):
    """Largest deviation between two solvers, relative; angles in radians."""

    solvers: str
    whisker: str
    cases: int
    deepest: float
    """Largest displacement of the contact, relative to the length of the whisker; NaN where it is not known."""
    point: float
    directors: float
    moment: float


def contacts(whisker: Whisker, count: int, rng: np.random.Generator) -> tuple[Suspension, Array, Array, SpatiallyLoaded]:
    """Suspension, arc lengths (count,), forces (count, 3) in the frame of the contact, and their equilibria.

    The forces are across the wire in any direction. Their size is that of a random depth by the theory of small deflections, which
    exceeds the displacement; cases whose displacement is larger than `DEEPEST` are drawn again.
    """
    stiffness = whisker.root_stiffness_n_m_rad
    suspension = Suspension(stiffness, 1.7 * stiffness, 0.6 * stiffness)
    kept: list[tuple[Array, ...]] = []
    while sum(len(arc_m) for arc_m, *_ in kept) < count:
        arc_m = whisker.length_m * rng.uniform(*_ARCS, count)
        wire_m_n = np.array([_cantilever_m_n(whisker, float(at_m)) for at_m in arc_m])
        depth_m = DEEPEST * whisker.length_m * rng.uniform(0.0, _LINEAR, count)
        size_n = depth_m / (wire_m_n + arc_m**2 / stiffness)
        about_rad = rng.uniform(0.0, 2.0 * np.pi, count)
        force_n = np.stack((np.zeros(count), size_n * np.cos(about_rad), size_n * np.sin(about_rad)), axis=-1)
        found = spatially_loaded(whisker, suspension, _POISSON_RATIO, arc_m, force_n)
        shallow = _displacement_m(whisker, arc_m, found) <= DEEPEST * whisker.length_m
        kept.append(tuple(array[shallow] for array in (arc_m, force_n, *vars(found).values())))
    arc_m, force_n, *equilibrium = (np.concatenate(arrays)[:count] for arrays in zip(*kept, strict=True))
    return suspension, arc_m, force_n, SpatiallyLoaded(*equilibrium)


def _cantilever_m_n(whisker: Whisker, arc_m: float) -> float:
    """Deflection of the clamped straight wire at `arc_m` by a unit force there: int (a - s)^2 ds / EI by the midpoint rule."""
    cuts_m = np.linspace(0.0, arc_m, 17)
    slices = [whisker.compliance_rad_n_m(float(a), float(b)) for a, b in pairwise(cuts_m)]
    return float((arc_m - 0.5 * (cuts_m[1:] + cuts_m[:-1])) ** 2 @ np.array(slices))


def _displacement_m(whisker: Whisker, arc_m: Array, found: SpatiallyLoaded) -> Array:
    rest_m = whisker.rest_point_m(arc_m)
    return np.linalg.norm(found.point_m - np.column_stack((rest_m, np.zeros(len(arc_m)))), axis=1)


def compare(name: str, task: int, count: int) -> tuple[Agreement, list[str]]:
    """Deviation of SciPy from NumPy at `count` contacts, and their rows for the test in Rust."""
    whisker = WHISKERS[name]
    rng = np.random.default_rng((_SEED, list(WHISKERS).index(name), task))
    suspension, arc_m, force_n, found = contacts(whisker, count, rng)
    deviations, rows = [], []
    for index in range(count):
        case = Case(whisker, suspension, _POISSON_RATIO, float(arc_m[index]), force_n[index])
        point_m, directors, moment_n_m = found.point_m[index], found.directors[index], found.moment_n_m[index]
        reached_m, turned, rest_n_m = carried(case, moment_n_m, directors @ force_n[index])
        deviations.append(
            (
                np.linalg.norm(reached_m - point_m) / case.arc_m,
                np.linalg.norm(turned - directors),
                np.linalg.norm(rest_n_m) / np.linalg.norm(moment_n_m),
            )
        )
        rows.append(row(case, point_m, directors[:, 0], moment_n_m))
    deepest = np.max(_displacement_m(whisker, arc_m, found)) / whisker.length_m
    return Agreement("SciPy, NumPy", name, count, float(deepest), *(largest(column) for column in np.transpose(deviations))), rows


def _tasks(_: Path) -> list[partial[tuple[Agreement, list[str]]]]:
    names = [name for name in WHISKERS for _ in range(_TASKS)]
    counts = [CASES // len(names) + (index < CASES % len(names)) for index in range(len(names))]
    return [partial(compare, name, index % _TASKS, count) for index, (name, count) in enumerate(zip(names, counts, strict=True))]


def _rust(rows: list[str]) -> tuple[list[Agreement], dict[str, float]]:
    """Deviation of the solver in Rust from NumPy, and its figures against closed forms; empty if one of its tests fails."""
    with TemporaryDirectory() as folder:
        cases = Path(folder) / "cases.csv"
        write_cases(cases, HEADER, rows)
        printed = rust_tests("rod", _RUST_TESTS, {"ROD_CASES": str(cases)})
    if printed is None:
        return [], {}
    agreements = [
        Agreement("Rust, NumPy", "all", int(count), float("nan"), *map(float, figures))
        for count, *figures in _RUST_CASES.findall(printed)
    ]
    found = {name: pattern.findall(printed) for name, pattern in _RUST_FIGURES.items()}
    # Of a test with several cases the figure is the last number.
    figures = {
        name: [float(match[-1] if isinstance(match, tuple) else match) for match in matches] for name, matches in found.items()
    }
    return agreements, {name: largest(values) for name, values in figures.items()}


def _conclude(results: list[tuple[Agreement, list[str]]]) -> Findings:
    scipy = [agreement for agreement, _ in results]
    rust, figures = _rust([line for _, lines in results for line in lines])
    claims = []
    for solver, agreements in (("SciPy", scipy), ("Rust", rust)):
        count = sum(agreement.cases for agreement in agreements)
        worst = largest([figure for agreement in agreements for figure in (agreement.point, agreement.directors, agreement.moment)])
        claim = f"oracle in space by {solver} against NumPy: {count} random contacts, relative"
        claims.append(
            Claim(f"space_oracle_{solver.lower()}", claim, worst if count == CASES else float("nan"), "<=", _AGREEMENT, "")
        )
    deepest = min(max(agreement.deepest for agreement in scipy if agreement.whisker == name) for name in WHISKERS)
    claim = "oracles in space: displacement of the deepest contact of each whisker, of its length"
    claims.append(Claim("space_oracle_deepest", claim, PERCENT * deepest, ">=", 39.0, "%"))
    for name, claim, scale, bound, unit in (
        ("planar", "oracle in space by Rust against the planar elastica: moment, relative", 1.0, 1e-9, ""),
        ("quarter_circle", "oracle in space by Rust: quarter circle loaded out of its plane, displacement", PERCENT, 0.1, "%"),
        ("bend", "oracle in space by Rust: bend of Bathe and Bolourchi, displacement of the tip", PERCENT, 0.5, "%"),
    ):
        claims.append(Claim(f"space_oracle_{name}", claim, scale * figures.get(name, float("nan")), "<=", bound, unit))
    return Findings({"space_oracle": scipy + rust}, claims)


STUDY = Study("space_oracle", "the oracles in space against one another, closed forms and published values", _tasks, _conclude)
