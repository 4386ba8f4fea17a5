"""Certificate of a trace in space: deviation of its ground truth from the exact quasi-static rod.

An instant is quasi-static if it is so by the rules of the plane (`whisker_sim.certificate`), and if the reading shows that inertia
and damping have been negligible for `CALM_S`. A frictionless contact holds the whisker in one direction only. Along the surface the
whisker is free, and rings for a second after a fast touch or start. To first order the reading differs from the static one by

    d2M/dt2 / w^2 + (damping_s + h) dM/dt,

with the angular frequency w of the first mode and the time step h (the integrator's damping). This estimate, from differences of
the reading over `_SPAN_S`, must not exceed `DYNAMIC_SHARE` of the largest moment of the trace.

At a sample of the quasi-static instants, the contact of the rod with the solid is solved for the pose of the base (`touching`) and
compared with the simulation.
"""

from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.certificate import calm, largest_figure, rms_figure
from whisker_sim.rod import spatially_loaded
from whisker_sim.space.rotation import undone, unit
from whisker_sim.space.simulate import SpatialSimulated
from whisker_sim.space.solids import Solid
from whisker_sim.space.touching import SpatiallyTouching, Touch
from whisker_sim.space.whisker import SpatialWhisker
from whisker_sim.whisker import Array

DYNAMIC_SHARE = 3e-4
_SPAN_S = 0.02
_SAMPLES = 50
_SLICES = 200
_MODE_MASS = 0.24
"""Share of the mass of a cantilever that, at its tip, gives its first frequency."""


class SpatialCertificate(msgspec.Struct, frozen=True):
    """Deviation from the rod at a sample of the quasi-static instants; `None` if there are no such instants."""

    touching: int
    """Number of rows in contact."""
    tip: int
    """Number of rows in contact at the tip."""
    split: int
    """Number of rows with contacts at separate points."""
    quasi_static: int
    sampled: int
    """Number of quasi-static rows compared with the rod, evenly spaced among them."""
    unsolved: int
    """Number of sampled rows for which the rod has no single-point contact."""
    moment_rms: float | None
    """Of the component with the largest deviation, relative to the largest moment of the trace."""
    moment_worst: float | None
    moment_jump: float | None
    """Largest change of the deviation of a component from a sampled row to the next one."""
    axial_rms: float | None
    """Of the axial force, relative to the largest force of the trace."""
    surface_rms_m: float | None
    surface_worst_m: float | None
    arc_rms_m: float | None
    arc_worst_m: float | None
    normal_rms_rad: float | None
    """Angle between the normals of the contact."""
    normal_worst_rad: float | None
    force_worst_rad: float | None
    """Largest angle between the simulated force and the normal of the contact."""
    penetration_worst_m: float | None
    """Of the smooth surface of the whisker."""


class SpatialDisagreement(NamedTuple):
    """Simulation minus rod at n instants; undefined where the rod has no solution."""

    moment_n_m: Array
    """(n, 3)."""
    axial_n: Array
    surface_m: Array
    """Distances (n,) between the surface points."""
    arc_m: Array
    normal_rad: Array
    """Angles (n,) between the normals."""
    exact: SpatiallyTouching


def quasi_static_rows(whisker: SpatialWhisker, simulated: SpatialSimulated, timestep_s: float) -> NDArray[np.intp]:
    """Quasi-static rows of a trace."""
    rows = np.flatnonzero(simulated.touching)
    on_the_side = ~(simulated.truth.tip | simulated.split)[rows] & (
        dynamic_share(whisker, simulated, timestep_s)[rows] <= DYNAMIC_SHARE
    )
    slow = calm(simulated.time_s[rows], simulated.truth.arc_m[rows], on_the_side, float(simulated.time_s[-1]))
    return rows[slow]


def dynamic_share(whisker: SpatialWhisker, simulated: SpatialSimulated, timestep_s: float) -> Array:
    """Estimated dynamic part of the reading at every row (n,), relative to the largest moment in contact; infinite at both ends."""
    moment_n_m, count = simulated.moment_n_m, len(simulated.time_s)
    range_n_m = np.max(np.linalg.norm(moment_n_m[simulated.touching], axis=1), initial=0.0)
    share = np.full(count, np.inf)
    if count < 3 or range_n_m == 0.0:
        return share
    step_s = float(simulated.time_s[1] - simulated.time_s[0])
    span = max(1, min(round(0.5 * _SPAN_S / step_s), (count - 1) // 2))
    before, middle, after = moment_n_m[: count - 2 * span], moment_n_m[span : count - span], moment_n_m[2 * span :]
    rate = (after - before) / (2.0 * span * step_s)
    acceleration = (after - 2.0 * middle + before) / (span * step_s) ** 2
    damping_s = whisker.whisker.damping_s + timestep_s
    dynamic_n_m = acceleration / first_mode_rad_s(whisker) ** 2 + damping_s * rate
    share[span : count - span] = np.linalg.norm(dynamic_n_m, axis=1) / range_n_m
    return share


def first_mode_rad_s(whisker: SpatialWhisker) -> float:
    """Angular frequency of the softer first mode of the straight wire, from the tip's stiffness and `_MODE_MASS` of the mass."""
    wire = whisker.whisker
    cuts_m = np.linspace(0.0, wire.length_m, _SLICES + 1)
    middles_m = 0.5 * (cuts_m[:-1] + cuts_m[1:])
    slices = [wire.compliance_rad_n_m(float(a), float(b)) for a, b in pairwise(cuts_m)]
    root = 1.0 / min(whisker.suspension.yaw_n_m_rad, whisker.suspension.pitch_n_m_rad)
    compliance_m_n = (wire.length_m - middles_m) ** 2 @ np.array(slices) + root * wire.length_m**2
    mass_kg = _MODE_MASS * float(np.sum(wire.mass_kg(cuts_m[:-1], cuts_m[1:])))
    return float(1.0 / np.sqrt(compliance_m_n * mass_kg))


def certify_in_space(whisker: SpatialWhisker, solid: Solid, simulated: SpatialSimulated, timestep_s: float) -> SpatialCertificate:
    """Compares a sample of the quasi-static instants of `simulated` with the rod."""
    slow = quasi_static_rows(whisker, simulated, timestep_s)
    sample = slow[np.linspace(0, len(slow) - 1, min(_SAMPLES, len(slow))).round().astype(int)]
    following = sample[np.isin(sample + 1, slow)] + 1
    rows = np.concatenate((sample, following))
    found = disagreement_in_space(whisker, solid, simulated, rows)
    touching = simulated.touching
    range_n_m = np.max(np.linalg.norm(simulated.moment_n_m[touching], axis=1), initial=0.0)
    range_n = np.max(np.linalg.norm(simulated.force_n[touching], axis=1), initial=0.0)
    relative = np.where(found.exact.solved[:, None], found.moment_n_m, np.nan) / range_n_m
    jumps = relative[len(sample) :] - relative[: len(sample)][np.isin(sample + 1, slow)]
    solved = np.flatnonzero(found.exact.solved[: len(sample)])
    moment = relative[solved]
    per_component = [rms_figure(component) for component in moment.T] if len(solved) else [None]
    truth = simulated.truth
    penetration_m = whisker.whisker.radius_m(truth.arc_m[sample]) - np.linalg.norm(
        truth.contact_m[sample] - truth.surface_m[sample], axis=1
    )
    return SpatialCertificate(
        touching=int(np.sum(touching)),
        tip=int(np.sum(truth.tip & touching)),
        split=int(np.sum(simulated.split & touching)),
        quasi_static=len(slow),
        sampled=len(sample),
        unsolved=len(sample) - len(solved),
        moment_rms=max(per_component),
        moment_worst=largest_figure(moment.ravel()),
        moment_jump=largest_figure(jumps[np.isfinite(jumps)]),
        axial_rms=rms_figure(found.axial_n[solved] / range_n),
        surface_rms_m=rms_figure(found.surface_m[solved]),
        surface_worst_m=largest_figure(found.surface_m[solved]),
        arc_rms_m=rms_figure(found.arc_m[solved]),
        arc_worst_m=largest_figure(found.arc_m[solved]),
        normal_rms_rad=rms_figure(found.normal_rad[solved]),
        normal_worst_rad=largest_figure(found.normal_rad[solved]),
        force_worst_rad=largest_figure(_angle(unit(simulated.force_n[sample]), truth.normal[sample])),
        penetration_worst_m=largest_figure(np.maximum(penetration_m, 0.0)),
    )


def disagreement_in_space(
    whisker: SpatialWhisker, solid: Solid, simulated: SpatialSimulated, rows: NDArray[np.intp]
) -> SpatialDisagreement:
    """Solves the rod at the instants `rows` from the simulated contact.

    The size of the initial force follows from the simulated reading, because the simulated contact force lags by the damping of
    whisker and solver. Its direction is the simulated normal, turned back from the bent to the undeflected wire; a few solutions
    for the load alone, in which the directors follow from the force, lead to the material's frame at the contact.
    """
    truth, rotation = simulated.truth, simulated.rotation[rows]
    moment_n_m, arc_m = simulated.moment_n_m[rows], truth.arc_m[rows]
    normal = undone(rotation, truth.normal[rows])
    size_n = np.linalg.norm(simulated.force_n[rows], axis=1)
    directors = np.broadcast_to(np.eye(3), (len(rows), 3, 3)) @ whisker.rest_frame(arc_m)
    for _ in range(8):
        along = undone(directors, normal) * size_n[:, None]
        load = spatially_loaded(whisker.whisker, whisker.suspension, whisker.poisson_ratio, arc_m, along, 32)
        directors = load.directors
        size_n = size_n * np.linalg.norm(moment_n_m, axis=1) / np.linalg.norm(load.moment_n_m, axis=1)
    touch = Touch(whisker, solid, simulated.position_m[rows], rotation)
    exact = touch.solved_from(arc_m, (undone(directors, normal) * size_n[:, None])[:, 1:])
    return SpatialDisagreement(
        moment_n_m=moment_n_m - exact.moment_n_m,
        axial_n=simulated.axial_n[rows] - undone(rotation, exact.force_n)[:, 0],
        surface_m=np.linalg.norm(truth.surface_m[rows] - exact.surface_m, axis=1),
        arc_m=arc_m - exact.arc_m,
        normal_rad=_angle(truth.normal[rows], exact.normal),
        exact=exact,
    )


def _angle(first: Array, second: Array) -> Array:
    """Angles (n,) between unit vectors (n, 3), also exact for small ones."""
    return 2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(first - second, axis=1)))
