"""Certificate of a trace: deviation of its ground truth from the exact quasi-static whisker.

An instant is quasi-static if

- the whisker has touched without interruption for `SETTLING_S` before and `LEAVING_S` after it, and
- for `CALM_S` before it there was a single contact, not at the tip, that moved along the whisker at `CONTACT_SPEED_M_S` at most. On
  an object that is not convex there may be two such contacts; the exact whisker then has two loads.

A faster contact lags behind the quasi-static one, because the whisker's hinges are damped. When a straight whisker passes over the
flat of a polygon, from one corner to the next within about 30 ms, its inertia matters and the position of the contact on the flat
is ill-conditioned.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.elastica import Touching, loaded, touching
from whisker_sim.shapes import Shape
from whisker_sim.simulate import Simulated
from whisker_sim.two_loads import TouchingTwice, loaded_twice, touching_twice
from whisker_sim.whisker import Array, Whisker

SETTLING_S = 0.3
LEAVING_S = 0.02
CALM_S = 0.05
CONTACT_SPEED_M_S = 0.1
_SAMPLES = 50


class Certificate(msgspec.Struct, frozen=True):
    """Deviation from the elastica at a sample of the quasi-static instants; `None` if there are no such instants."""

    touching: int
    """Number of rows in contact."""
    tip: int
    """Number of rows in contact at the tip."""
    split: int
    """Number of rows with contacts at separate points."""
    quasi_static: int
    sampled: int
    """Number of quasi-static rows compared with the elastica, evenly spaced among them."""
    unsolved: int
    """Number of sampled rows for which the elastica has no single-point contact."""
    moment_rms: float | None
    """Relative to the largest moment of the trace."""
    moment_worst: float | None
    surface_rms_m: float | None
    surface_worst_m: float | None
    arc_rms_m: float | None
    arc_worst_m: float | None
    penetration_worst_m: float | None
    """Of the smooth surface of the whisker."""
    sampled_twice: int | msgspec.UnsetType = msgspec.UNSET
    """Number of sampled rows with two contacts, compared with the elastica under two loads; omitted for convex objects."""


class Contacts(NamedTuple):
    """Simulated states at the n instants of contact of a trace, in World."""

    time_s: Array
    base_pose: Array
    """Poses (n, 3) of the base: x, y (m), yaw (rad)."""
    moment_n_m: Array
    contact_m: Array
    """Contact points (n, 2) on the centre line."""
    surface_m: Array
    """Contact points (n, 2) on the object's surface."""
    arc_m: Array
    force_n: Array
    friction_rad: Array
    """Angles (n,) of the force to the normal, positive if the friction on the whisker is towards its tip; zero without friction."""
    on_the_side: NDArray[np.bool_]
    """Whether there is a single contact, not at the tip (n,)."""
    recording_end_s: float

    def at(self, rows: NDArray[np.intp]) -> "Contacts":
        """The instants `rows`."""
        return Contacts(*(values[rows] for values in self[:-1]), self.recording_end_s)


class Disagreement(NamedTuple):
    """Simulation minus elastica at n instants; undefined where the elastica has no solution."""

    moment_n_m: Array
    surface_m: Array
    """Distances (n,) between the surface points."""
    arc_m: Array
    penetration_m: Array
    """Penetration (n,) of the smooth surface of the simulated whisker."""
    exact: Touching | TouchingTwice


def certify(whisker: Whisker, shapes: Sequence[Shape], face: str, simulated: Simulated, vibrates: bool) -> Certificate:
    """Compares a sample of the quasi-static instants of `simulated` with the elastica, each for the nearest of `shapes`.

    If the base vibrates, no instant is quasi-static, because the whisker never comes to rest.
    """
    simulated = simulated.relative_to_object()
    contacts = contacts_of(whisker, simulated)
    slow = np.flatnonzero(quasi_static(contacts) & (not vibrates))
    sample = _sample(slow)
    nearest = simulated.nearest[simulated.touching][sample]
    found = [disagreement(whisker, shape, face, contacts.at(sample[nearest == index])) for index, shape in enumerate(shapes)]

    twice = np.flatnonzero(quasi_static_twice(simulated) & (not vibrates))
    sampled_twice = _sample(twice)
    if len(sampled_twice):
        (shape,) = shapes
        found.append(disagreement_twice(whisker, shape, simulated, sampled_twice))

    def solved(values: Callable[[Disagreement], Array]) -> Array:
        return np.concatenate([values(part)[part.exact.solved] for part in found])

    range_n_m = np.max(np.abs(contacts.moment_n_m), initial=0.0)
    moment = solved(lambda part: part.moment_n_m) / range_n_m
    surface_m, arc_m = solved(lambda part: part.surface_m), solved(lambda part: part.arc_m)
    penetration_m = np.concatenate([part.penetration_m for part in found])
    return Certificate(
        touching=len(contacts.time_s),
        tip=int(np.sum(simulated.truth.tip & simulated.touching)),
        split=int(np.sum(simulated.split & simulated.touching)),
        quasi_static=len(slow) + len(twice),
        sampled=len(sample) + len(sampled_twice),
        unsolved=len(sample) + len(sampled_twice) - len(moment),
        moment_rms=rms_figure(moment),
        moment_worst=largest_figure(moment),
        surface_rms_m=rms_figure(surface_m),
        surface_worst_m=largest_figure(surface_m),
        arc_rms_m=rms_figure(arc_m),
        arc_worst_m=largest_figure(arc_m),
        penetration_worst_m=largest_figure(np.maximum(penetration_m, 0.0)),
        sampled_twice=msgspec.UNSET if simulated.second is None else len(sampled_twice),
    )


def _sample(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """At most `_SAMPLES` of the rows, evenly spaced."""
    return rows[np.linspace(0, len(rows) - 1, min(_SAMPLES, len(rows))).round().astype(int)]


def contacts_of(whisker: Whisker, simulated: Simulated) -> Contacts:
    """States of `simulated` at its instants of contact."""
    rows = np.flatnonzero(simulated.touching)
    return Contacts(
        time_s=simulated.time_s[rows],
        base_pose=simulated.base_pose[rows],
        moment_n_m=whisker.root_stiffness_n_m_rad * simulated.rotations_rad[rows, 0],
        contact_m=simulated.truth.contact_m[rows],
        surface_m=simulated.truth.surface_m[rows],
        arc_m=simulated.truth.arc_m[rows],
        force_n=simulated.force_n[rows],
        friction_rad=np.zeros(len(rows)) if simulated.friction is None else simulated.friction.angle_rad[rows],
        on_the_side=~(simulated.truth.tip | simulated.split)[rows],
        recording_end_s=float(simulated.time_s[-1]),
    )


def quasi_static(contacts: Contacts) -> NDArray[np.bool_]:
    """Mask (n,) of the quasi-static instants."""
    return calm(contacts.time_s, contacts.arc_m, contacts.on_the_side, contacts.recording_end_s)


def quasi_static_twice(simulated: Simulated) -> NDArray[np.bool_]:
    """Mask (n,) of the quasi-static instants of a trace at which there are two contacts."""
    slow = np.zeros(len(simulated.time_s), dtype=bool)
    if simulated.second is None:
        return slow
    rows = np.flatnonzero(simulated.touching)
    one, other = simulated.truth.arc_m[rows], simulated.second.arc_m[rows]
    exists = simulated.second.exists[rows]
    # In the order along the whisker: which of the two is the nearest may change at any time.
    arcs_m = np.sort(np.stack((one, np.where(exists, other, one)), axis=-1), axis=1)
    slow[rows] = exists & calm(simulated.time_s[rows], arcs_m, ~simulated.truth.tip[rows], float(simulated.time_s[-1]))
    return slow


def calm(time_s: Array, arc_m: Array, on_the_side: NDArray[np.bool_], recording_end_s: float) -> NDArray[np.bool_]:
    """Mask (n,) of the quasi-static instants among the n instants of contact of a recording, at the arc lengths (n,) or (n, k)."""
    if len(time_s) < 2:
        return np.zeros(len(time_s), dtype=bool)
    interval_s = np.min(np.diff(time_s))
    broken = np.diff(time_s, prepend=-np.inf) > 1.5 * interval_s
    speed_m_s = np.max(np.abs(np.diff(arc_m, axis=0, prepend=arc_m[:1])).reshape(len(time_s), -1), axis=1) / interval_s
    hasty = ~on_the_side | ((speed_m_s > CONTACT_SPEED_M_S) & ~broken)
    started_s = np.maximum.accumulate(np.where(broken, time_s, -np.inf))
    hasty_s = np.maximum.accumulate(np.where(hasty, time_s, -np.inf))
    # The row before a fast one counts as fast, because the speed is a difference of two rows.
    slow = (time_s - hasty_s >= CALM_S) & ~np.append(hasty[1:], False)
    ends = np.append(broken[1:], True)
    ended_s = np.minimum.accumulate(np.where(ends, time_s, np.inf)[::-1])[::-1]
    # A contact that lasts until the end of the recording is not interrupted there.
    lasts = (ended_s - time_s >= LEAVING_S) | (ended_s == recording_end_s)
    return (time_s - started_s >= SETTLING_S) & lasts & slow


def disagreement(whisker: Whisker, shape: Shape, face: str, contacts: Contacts) -> Disagreement:
    """Solves the elastica at every instant from the simulated contact; retries unsolved instants from solved neighbours.

    The initial force follows from the simulated reading, because the simulated contact force lags by the damping of whisker and
    solver, and an error of 1 % in the force displaces a deflected whisker by more than its diameter.
    """
    side = 1 if face == "left" else -1

    def solved_at(rows: NDArray[np.intp], arc_m: Array, force_n: Array) -> Touching:
        return touching(whisker, shape, side, contacts.base_pose[rows], arc_m, force_n, contacts.friction_rad[rows])

    force_n = contacts.force_n
    for _ in range(2):
        load = loaded(whisker, contacts.arc_m, -side * force_n, side * contacts.friction_rad)
        force_n = force_n * contacts.moment_n_m / load.moment_n_m
    exact = solved_at(np.arange(len(force_n)), contacts.arc_m, force_n)
    missing, known = np.flatnonzero(~exact.solved), np.flatnonzero(exact.solved)
    if len(missing) and len(known):
        guess = [np.interp(missing, known, values[known]) for values in (exact.arc_m, exact.force_n)]
        exact = exact.replaced(missing, solved_at(missing, *guess))
    return Disagreement(
        moment_n_m=contacts.moment_n_m - exact.moment_n_m,
        surface_m=np.hypot(*(contacts.surface_m - exact.surface_m).T),
        arc_m=contacts.arc_m - exact.arc_m,
        penetration_m=whisker.radius_m(contacts.arc_m) - np.hypot(*(contacts.contact_m - contacts.surface_m).T),
        exact=exact,
    )


def disagreement_twice(whisker: Whisker, shape: Shape, simulated: Simulated, rows: NDArray[np.intp]) -> Disagreement:
    """Solves the elastica under two loads at the instants `rows` (n,), at which there are two contacts.

    The deviations are the larger of those of the two contacts. As with one contact, the initial forces are scaled to the simulated
    reading.
    """
    first, second = simulated.truth, simulated.second

    def pairs(of_first: Array, of_second: Array) -> Array:
        pair = np.stack((of_first[rows], of_second[rows]), axis=1)
        order = np.argsort(np.stack((first.arc_m[rows], second.arc_m[rows]), axis=1), axis=1)
        return np.take_along_axis(pair, order.reshape(order.shape + (1,) * (pair.ndim - 2)), axis=1)

    arc_m, force_n = pairs(first.arc_m, second.arc_m), pairs(simulated.force_n, second.force_n)
    contact_m, surface_m = pairs(first.contact_m, second.contact_m), pairs(first.surface_m, second.surface_m)
    tangent_rad = pairs(first.tangent_rad, second.tangent_rad)
    toward_m = surface_m - contact_m
    sides = np.sign(np.cos(tangent_rad) * toward_m[..., 1] - np.sin(tangent_rad) * toward_m[..., 0])
    moment_n_m = whisker.root_stiffness_n_m_rad * simulated.rotations_rad[rows, 0]
    load = loaded_twice(whisker, arc_m, -sides * force_n, sides * float(np.arcsin(whisker.radius_slope)))
    force_n = force_n * (moment_n_m / load.moment_n_m)[:, None]
    exact = touching_twice(whisker, shape, sides, simulated.base_pose[rows], arc_m, force_n)
    apart_m = whisker.radius_m(arc_m) - np.linalg.norm(toward_m, axis=-1)
    return Disagreement(
        moment_n_m=moment_n_m - exact.moment_n_m,
        surface_m=np.max(np.linalg.norm(surface_m - exact.surface_m, axis=-1), axis=1),
        arc_m=np.max(np.abs(arc_m - exact.arc_m), axis=1),
        penetration_m=np.max(apart_m, axis=1),
        exact=exact,
    )


def rms_figure(values: Array) -> float | None:
    """Root mean square of `values` (n,) as a figure of a certificate; `None` if there are none."""
    return _figure(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def largest_figure(values: Array) -> float | None:
    """Largest magnitude of `values` (n,) as a figure of a certificate; `None` if there are none."""
    return _figure(np.max(np.abs(values))) if len(values) else None


def _figure(value: float) -> float:
    """Rounds to four significant digits; further digits may differ between machines."""
    return float(f"{value:.3e}")
