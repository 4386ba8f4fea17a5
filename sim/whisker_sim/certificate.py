"""What every trace says of its own truth: how far it lies from the exact quasi-static whisker.

An instant counts as quasi-static when the whisker has touched for `SETTLING_S` without a break and does so for another `LEAVING_S`,
and when for `CALM_S` the contact has been a single one, not at the tip, that runs along the whisker no faster than
`CONTACT_SPEED_M_S`. A faster contact lags, for the whisker's hinges are damped; and where a straight whisker runs over the flat of
a polygon, from one corner to the next within some 30 ms, its inertia counts and the place of the contact on the flat is all but
undetermined.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.elastica import Touching, loaded, touching
from whisker_sim.shapes import Shape
from whisker_sim.simulate import Simulated
from whisker_sim.whisker import Array, Whisker

SETTLING_S = 0.3
LEAVING_S = 0.02
CALM_S = 0.05
CONTACT_SPEED_M_S = 0.1
_SAMPLES = 50


class Certificate(msgspec.Struct, frozen=True):
    """Disagreement with the elastica at a sample of the quasi-static instants; null where there are none."""

    touching: int
    """Rows in contact."""
    tip: int
    """Rows in contact at the tip."""
    split: int
    """Rows in contact in places apart from one another."""
    quasi_static: int
    sampled: int
    """Quasi-static rows that were solved again, spread evenly over them."""
    unsolved: int
    """Sampled rows for which the elastica finds no contact in one place."""
    moment_rms: float | None
    """Relative to the trace's largest moment."""
    moment_worst: float | None
    surface_rms_m: float | None
    surface_worst_m: float | None
    arc_rms_m: float | None
    arc_worst_m: float | None
    penetration_worst_m: float | None
    """Of the smooth whisker."""


class Contacts(NamedTuple):
    """The instants of contact of a trace, n of them, as the simulator had them; World."""

    time_s: Array
    base_pose: Array
    """(n, 3): x, y, yaw."""
    moment_n_m: Array
    contact_m: Array
    """Points (n, 2) of the centre line."""
    surface_m: Array
    """Points (n, 2) of the object's surface."""
    arc_m: Array
    force_n: Array
    on_the_side: NDArray[np.bool_]
    """Whether the contact is a single one and not at the tip (n,)."""
    recording_end_s: float

    def at(self, rows: NDArray[np.intp]) -> "Contacts":
        """The instants `rows` alone."""
        return Contacts(*(values[rows] for values in self[:-1]), self.recording_end_s)


class Disagreement(NamedTuple):
    """Simulator minus elastica, at n instants; it means nothing where the elastica has no solution."""

    moment_n_m: Array
    surface_m: Array
    """Distances (n,) of the surface points."""
    arc_m: Array
    penetration_m: Array
    """Penetration of the simulated whisker's smooth surface (n,)."""
    exact: Touching


def certify(whisker: Whisker, shapes: Sequence[Shape], face: str, simulated: Simulated, vibrates: bool) -> Certificate:
    """Solves a sample of the quasi-static instants of `simulated` again, each with the one of `shapes` that is nearest.

    On a base that vibrates none is quasi-static, for the whisker never comes to rest.
    """
    contacts = contacts_of(whisker, simulated)
    slow = np.flatnonzero(quasi_static(contacts) & (not vibrates))
    sample = slow[np.linspace(0, len(slow) - 1, min(_SAMPLES, len(slow))).round().astype(int)]
    nearest = simulated.nearest[simulated.touching][sample]
    found = [disagreement(whisker, shape, face, contacts.at(sample[nearest == index])) for index, shape in enumerate(shapes)]

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
        quasi_static=len(slow),
        sampled=len(sample),
        unsolved=len(sample) - len(moment),
        moment_rms=_rms(moment),
        moment_worst=_largest(moment),
        surface_rms_m=_rms(surface_m),
        surface_worst_m=_largest(surface_m),
        arc_rms_m=_rms(arc_m),
        arc_worst_m=_largest(arc_m),
        penetration_worst_m=_largest(np.maximum(penetration_m, 0.0)),
    )


def contacts_of(whisker: Whisker, simulated: Simulated) -> Contacts:
    """The instants of contact of `simulated`."""
    rows = np.flatnonzero(simulated.touching)
    return Contacts(
        time_s=simulated.time_s[rows],
        base_pose=simulated.base_pose[rows],
        moment_n_m=whisker.root_stiffness_n_m_rad * simulated.rotations_rad[rows, 0],
        contact_m=simulated.truth.contact_m[rows],
        surface_m=simulated.truth.surface_m[rows],
        arc_m=simulated.truth.arc_m[rows],
        force_n=simulated.force_n[rows],
        on_the_side=~(simulated.truth.tip | simulated.split)[rows],
        recording_end_s=float(simulated.time_s[-1]),
    )


def quasi_static(contacts: Contacts) -> NDArray[np.bool_]:
    """Which of the instants (n,) are quasi-static."""
    time_s, arc_m = contacts.time_s, contacts.arc_m
    if len(time_s) < 2:
        return np.zeros(len(time_s), dtype=bool)
    interval_s = np.min(np.diff(time_s))
    broken = np.diff(time_s, prepend=-np.inf) > 1.5 * interval_s
    speed_m_s = np.abs(np.diff(arc_m, prepend=arc_m[0])) / interval_s
    hasty = ~contacts.on_the_side | ((speed_m_s > CONTACT_SPEED_M_S) & ~broken)
    started_s = np.maximum.accumulate(np.where(broken, time_s, -np.inf))
    hasty_s = np.maximum.accumulate(np.where(hasty, time_s, -np.inf))
    # The instant before a fast one belongs to it.
    calm = (time_s - hasty_s >= CALM_S) & ~np.append(hasty[1:], False)
    ends = np.append(broken[1:], True)
    ended_s = np.minimum.accumulate(np.where(ends, time_s, np.inf)[::-1])[::-1]
    # A contact that lasts to the end of the recording does not break there.
    lasts = (ended_s - time_s >= LEAVING_S) | (ended_s == contacts.recording_end_s)
    return (time_s - started_s >= SETTLING_S) & lasts & calm


def disagreement(whisker: Whisker, shape: Shape, face: str, contacts: Contacts) -> Disagreement:
    """Solves every instant again: looked for near the simulator's contact, then near those of the solved neighbours.

    The force to begin with is that of the simulator's reading, for the contact's own force lags by the damping of whisker and
    solver, and a per cent of force moves a deflected whisker by more than its thickness.
    """
    side = 1 if face == "left" else -1

    def solved_at(rows: NDArray[np.intp], arc_m: Array, force_n: Array) -> Touching:
        return touching(whisker, shape, side, contacts.base_pose[rows], arc_m, force_n)

    force_n = contacts.force_n
    for _ in range(2):
        force_n = force_n * contacts.moment_n_m / loaded(whisker, contacts.arc_m, -side * force_n).moment_n_m
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


def _rms(values: Array) -> float | None:
    return _figure(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def _largest(values: Array) -> float | None:
    return _figure(np.max(np.abs(values))) if len(values) else None


def _figure(value: float) -> float:
    """To four significant digits: what is left beyond them differs from one machine to another."""
    return float(f"{value:.3e}")
