"""Elastica solvers ("oracles") against published values and against one another.

There are three independent solvers of the exact whisker: in Rust, for sensor models; in NumPy, for many base poses at once; and
with SciPy's integrator, the reference of the other two. The one in Rust is compared by its own tests, whose output is parsed here.
"""

import re
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.optimize import brentq

from whisker_sim.elastica import Loaded, loaded, touching
from whisker_sim.physics.cases import WHISKERS, largest
from whisker_sim.physics.rust_tests import NUMBER, rust_tests
from whisker_sim.physics.scipy_elastica import HEADER, StaticContact, push, solved_case, static_contact, write_cases
from whisker_sim.physics.study import Claim, Findings, Study
from whisker_sim.shapes.circle import Circle
from whisker_sim.whisker import PRESETS, Array, Whisker

CASES = 10_000
"""Number of random whiskers, contacts and loads that the solver in Rust is compared at."""
SEED = 2
LOADS = 500
"""Number of random loads on each whisker of the studies, for the solver in NumPy."""
CONTACTS = 100
"""Number of random contacts of each of those whiskers, on either side, with a disc of each of `RADII_M`."""
RADII_M = (0.001, 0.015, 0.05)
LARGEST_BEND_RAD = 1.0
"""Largest rotation of whisker and root under a random load, by the theory of small deflections."""

PUBLISHED = ((1.0, 0.30172, 0.05643), (2.0, 0.49346, 0.16064), (5.0, 0.71379, 0.38763), (10.0, 0.81061, 0.55500))
"""Cantilever under a load P of constant direction at its end: P L^2 / EI, deflection and shortening, in lengths (Mattiasson,
International Journal for Numerical Methods in Engineering 17, 1981)."""
_ROUNDING = 0.5e-5
_AGREEMENT = 1e-9

_CASES_A_TASK = 500
_RUST_TESTS = ("val_mattiasson", "val_agrees_with_scipy", "val_discs_agree_with_scipy")
_RUST_CANTILEVER = re.compile(rf"P L2/EI {NUMBER}: w/L {NUMBER}, u/L {NUMBER}")
_RUST_WORST = re.compile(rf"(\d+) cases: worst relative error of point {NUMBER}, tangent {NUMBER}, moment {NUMBER}, tip {NUMBER}")


class Cantilever(NamedTuple):
    """Deflection and shortening of the cantilever, in lengths."""

    oracle: str
    load: float
    """P L^2 / EI."""
    deflection: float
    published_deflection: float
    shortening: float
    published_shortening: float


class Agreement(NamedTuple):
    """Largest deviation from SciPy, relative; angles in radians."""

    oracle: str
    what: str
    cases: int
    worst: float


def cantilever(load: float) -> tuple[float, float]:
    """Deflection and shortening by SciPy, in lengths, under P L^2 / EI = `load`.

    The direction of the load is constant; its components along and across the end follow from the angle of the end.
    """
    straight = PRESETS["straight"][1]
    clamped = msgspec.structs.replace(straight, root_stiffness_n_m_rad=1e12)
    bending_n_m2 = straight.youngs_modulus_pa * np.pi * straight.root_diameter_m**4 / 64.0
    force_n = load * bending_n_m2 / straight.length_m**2

    def pressed(angle_rad: float) -> StaticContact:
        return static_contact(clamped, straight.length_m, force_n * np.cos(angle_rad), force_n * np.sin(angle_rad))

    angle_rad = brentq(lambda angle_rad: pressed(angle_rad).angle_rad - angle_rad, 0.0, 0.5 * np.pi, xtol=1e-12)
    x, y = pressed(angle_rad).point_m / straight.length_m
    return float(y), float(1.0 - x)


def _cantilevers() -> list[Cantilever]:
    rows = []
    for load, published_deflection, published_shortening in PUBLISHED:
        deflection, shortening = cantilever(load)
        rows.append(Cantilever("SciPy", load, deflection, published_deflection, shortening, published_shortening))
    return rows


def _solved(first: int) -> list[str]:
    return [solved_case(SEED, index) for index in range(first, first + _CASES_A_TASK)]


def _numpy_agreement(whisker_name: str) -> list[Agreement]:
    """Compares the solver in NumPy with SciPy's: random loads to either side, and random contacts with discs."""
    whisker = WHISKERS[whisker_name]
    rng = np.random.default_rng((SEED, list(WHISKERS).index(whisker_name)))
    arc_m, force_n = _random_loads(whisker, LOADS, rng)
    exact = _solved_loads(whisker, arc_m, force_n, np.zeros(LOADS))
    fast = loaded(whisker, arc_m, force_n)
    worst_load = largest(
        (
            np.hypot(*(fast.point_m - exact.point_m).T) / arc_m,
            fast.tangent_rad - exact.tangent_rad,
            fast.moment_n_m / exact.moment_n_m - 1.0,
        )
    )
    worst_contact = largest([_worst_contact(whisker, radius_m, face, rng) for radius_m in RADII_M for face in (1, -1)])
    return [
        Agreement("NumPy", f"random loads, {whisker_name}", LOADS, worst_load),
        Agreement("NumPy", f"random contacts with discs, {whisker_name}", 2 * len(RADII_M) * CONTACTS, worst_contact),
    ]


def _worst_contact(whisker: Whisker, radius_m: float, face: int, rng: np.random.Generator) -> float:
    """Largest deviation at `CONTACTS` random contacts with a disc at the origin of World on the side `face` of the whisker.

    The base is placed such that the disc touches the whisker as bent by SciPy, so that contact and force are known.
    """
    arc_m, force_n = _random_loads(whisker, CONTACTS, rng)
    force_n = np.abs(force_n)
    left, along = push(whisker, face)
    exact = _solved_loads(whisker, arc_m, left * force_n, along * force_n)
    cos, sin = np.cos(exact.tangent_rad), np.sin(exact.tangent_rad)
    # The disc is on the side from which the force acts.
    towards_disc = np.stack((sin * left - cos * along, -sin * along - cos * left), axis=-1)
    center_m = exact.point_m + (radius_m + whisker.radius_m(arc_m))[:, None] * towards_disc
    yaw_rad = rng.uniform(-np.pi, np.pi, CONTACTS)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = center_m.T
    poses = np.stack((sin * y - cos * x, -sin * x - cos * y, yaw_rad), axis=-1)
    guess = arc_m * rng.uniform(0.98, 1.02, CONTACTS), force_n * rng.uniform(0.95, 1.05, CONTACTS)
    found = touching(whisker, Circle(radius_m=radius_m), face, poses, *guess)
    pairs = ((found.arc_m, arc_m), (found.force_n, force_n), (found.moment_n_m, exact.moment_n_m))
    worst = largest([value / expected - 1.0 for value, expected in pairs])
    return worst if np.all(found.solved) else float("inf")


def _random_loads(whisker: Whisker, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Arc lengths (count,) of random loads, and forces (count,) to the left."""
    arc_m = whisker.length_m * rng.uniform(0.2, 0.95, count)
    bending_rad_n_m = np.array([whisker.compliance_rad_n_m(0.0, place_m) for place_m in arc_m])
    bend_rad_n = arc_m * (0.5 * bending_rad_n_m + 1.0 / whisker.root_stiffness_n_m_rad)
    return arc_m, rng.uniform(-LARGEST_BEND_RAD, LARGEST_BEND_RAD, count) / bend_rad_n


def _solved_loads(whisker: Whisker, arc_m: Array, left_n: Array, along_n: Array) -> Loaded:
    """SciPy's solutions for loads (n,)."""
    cases = [static_contact(whisker, *load) for load in zip(arc_m, left_n, along_n, strict=True)]
    return Loaded(*(np.array([getattr(case, name) for case in cases]) for name in ("point_m", "angle_rad", "moment_n_m")))


def _rust_agreement(rows: list[str]) -> tuple[list[Cantilever], list[Agreement]]:
    """Results of the solver in Rust in its own tests, given the solved cases `rows`; empty if a test fails.

    Raises `SimulationError` if the tests do not run.
    """
    with TemporaryDirectory() as folder:
        cases = Path(folder) / "cases.csv"
        write_cases(cases, HEADER, rows)
        printed = rust_tests("elastica", _RUST_TESTS, {"ELASTICA_CASES": str(cases)})
    if printed is None:
        return [], []
    published = {load: values for load, *values in PUBLISHED}
    cantilevers = []
    for found in _RUST_CANTILEVER.findall(printed):
        load, deflection, shortening = map(float, found)
        published_deflection, published_shortening = published[load]
        cantilevers.append(Cantilever("Rust", load, deflection, published_deflection, shortening, published_shortening))
    agreements = [
        Agreement("Rust", f"random whiskers and loads, {what}", int(count), float(worst))
        for count, *found in _RUST_WORST.findall(printed)
        for what, worst in zip(("point", "tangent", "moment", "tip"), found, strict=True)
    ]
    return cantilevers, agreements


def _tasks(_: Path) -> list[partial[list[Any]]]:
    return [
        partial(_cantilevers),
        *(partial(_numpy_agreement, whisker) for whisker in WHISKERS),
        *(partial(_solved, first) for first in range(0, CASES, _CASES_A_TASK)),
    ]


def _conclude(results: list[list[Any]]) -> Findings:
    cantilevers, *results = results
    agreements = [row for rows in results[: len(WHISKERS)] for row in rows]
    rust_cantilevers, rust_agreements = _rust_agreement([row for rows in results[len(WHISKERS) :] for row in rows])
    cantilevers, agreements = cantilevers + rust_cantilevers, rust_agreements + agreements
    claims = []
    for oracle in ("SciPy", "Rust"):
        of_oracle = [row for row in cantilevers if row.oracle == oracle]
        misses = [abs(row.deflection - row.published_deflection) for row in of_oracle]
        misses += [abs(row.shortening - row.published_shortening) for row in of_oracle]
        # All published values are required.
        worst = largest(misses) if len(of_oracle) == len(PUBLISHED) else float("nan")
        claim = f"oracle by {oracle}: cantilever against Mattiasson's four loads, in lengths"
        claims.append(Claim(f"oracle_mattiasson_{oracle.lower()}", claim, worst, "<=", _ROUNDING, ""))
    for oracle, what in (("Rust", "random whiskers, contacts and loads"), ("NumPy", "loads and contacts with discs")):
        of_oracle = [row for row in agreements if row.oracle == oracle]
        worst = largest([row.worst for row in of_oracle])
        # The solver in Rust has four results per case.
        count = sum({row.what: row.cases for row in of_oracle}.values()) // (4 if oracle == "Rust" else 1)
        claim = f"oracle by {oracle} against SciPy: {count} {what}, relative"
        claims.append(Claim(f"oracle_{oracle.lower()}", claim, worst, "<=", _AGREEMENT, ""))
    return Findings({"cantilever": cantilevers, "oracle": agreements}, claims)


STUDY = Study("oracle", "the oracles against published values and one another", _tasks, _conclude)
