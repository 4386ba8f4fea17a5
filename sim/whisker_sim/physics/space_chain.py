"""Statics of the chain in space against the Kirchhoff rod, for 12 to 96 segments and three orders of the joints of a hinge.

The chain is loaded at three quarters of its length by forces in all directions across it. A rotation about one axis after another
depends on their order. With the same order at every hinge the error is of the first power of the segment length.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from whisker_sim.physics.cases import WHISKERS
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.rod import Suspension, spatially_loaded
from whisker_sim.space.statics import Order, chain_under_load
from whisker_sim.space.whisker import PITCH, TWIST, YAW, SpatialWhisker, hinge_order

SEGMENTS = (12, 24, 48, 96)
DEFAULT_SEGMENTS = 24
ARRANGEMENTS: dict[str, Callable[[int], Order]] = {
    "same order": lambda _: (YAW, PITCH, TWIST),
    "twist between": lambda _: (YAW, TWIST, PITCH),
    "alternating": hinge_order,
}
LOADS = 100
_SEED = 1
_PLACE = 0.75
_SHARES = (0.2, 1.0)
"""Range of the forces, as shares of the one that turns the root by about 20 degrees."""


class Row(NamedTuple):
    """Error of the chain, RMS over the loads."""

    whisker: str
    arrangement: str
    segments: int
    segment_m: float
    moment_error: float
    """Of the component with the largest error, relative to the largest moment."""
    point_error_m: float
    tangent_error_rad: float


class Convergence(NamedTuple):
    """Order of convergence in the segment length."""

    whisker: str
    arrangement: str
    figure: str
    order: float


_FIGURES = {"moment_error": "moment", "point_error_m": "point", "tangent_error_rad": "tangent"}


def whisker_in_space(name: str, segments: int) -> SpatialWhisker:
    """The whisker with a root whose stiffness differs between its axes."""
    wire = msgspec.structs.replace(WHISKERS[name], segments=segments)
    stiffness = wire.root_stiffness_n_m_rad
    return SpatialWhisker(wire, Suspension(stiffness, 1.3 * stiffness, 0.8 * stiffness), 0.33)


def loads_n(whisker: SpatialWhisker, seed: int = _SEED) -> np.ndarray:
    """Forces (`LOADS`, 3) in the frame of the contact, in random directions across the wire."""
    rng = np.random.default_rng(seed)
    largest_n = 0.35 * whisker.whisker.root_stiffness_n_m_rad / (_PLACE * whisker.whisker.length_m)
    size_n = largest_n * rng.uniform(*_SHARES, LOADS)
    about_rad = rng.uniform(0.0, 2.0 * np.pi, LOADS)
    return np.stack((np.zeros(LOADS), size_n * np.cos(about_rad), size_n * np.sin(about_rad)), axis=-1)


def compare(name: str, arrangement: str) -> list[Row]:
    """One row per number of segments."""
    rows = []
    for segments in SEGMENTS:
        whisker = whisker_in_space(name, segments)
        force_n, node = loads_n(whisker), round(_PLACE * segments)
        chain, _ = chain_under_load(whisker, node, force_n, ARRANGEMENTS[arrangement])
        arc_m = np.full(LOADS, whisker.node_arcs_m[node])
        exact = spatially_loaded(whisker.whisker, whisker.suspension, whisker.poisson_ratio, arc_m, force_n)
        range_n_m = np.max(np.linalg.norm(exact.moment_n_m, axis=1))
        moment = np.sqrt(np.mean((chain.moment_n_m - exact.moment_n_m) ** 2, axis=0))
        point_m = np.sqrt(np.mean(np.sum((chain.point_m - exact.point_m) ** 2, axis=1)))
        tangent = np.sqrt(np.mean(np.sum((chain.directors - exact.directors)[:, :, 0] ** 2, axis=1)))
        figures = (float(np.max(moment) / range_n_m), float(point_m), float(tangent))
        rows.append(Row(name, arrangement, segments, whisker.whisker.segment_m, *figures))
    return rows


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(compare, whisker, arrangement) for whisker in WHISKERS for arrangement in ARRANGEMENTS]


def _conclude(results: list[list[Row]]) -> Findings:
    orders, claims = [], []
    for rows in results:
        lengths = np.log([row.segment_m for row in rows])
        for field, figure in _FIGURES.items():
            slope = float(np.polyfit(lengths, np.log([getattr(row, field) for row in rows]), 1)[0])
            orders.append(Convergence(rows[0].whisker, rows[0].arrangement, figure, slope))
    for fit in orders:
        if fit.arrangement == "alternating":
            claim = f"{fit.whisker} chain in space: order of the {fit.figure}'s error in segment length"
            claims.append(Claim(f"space_order_{fit.whisker}_{fit.figure}", claim, fit.order, ">=", 1.8, ""))
    default = [row for rows in results for row in rows if row.segments == DEFAULT_SEGMENTS and row.arrangement == "alternating"]
    for row in default:
        claim = f"{row.whisker} chain in space, {DEFAULT_SEGMENTS} segments, {LOADS} loads: moment, RMS"
        claims.append(Claim(f"space_chain_{row.whisker}", claim, PERCENT * row.moment_error, "<=", 0.02, "% of range"))
    return Findings({"space_chain": [row for rows in results for row in rows], "space_chain_orders": orders}, claims)


STUDY = Study("space_chain", "chain in space against the Kirchhoff rod, 12 to 96 segments", _tasks, _conclude)
