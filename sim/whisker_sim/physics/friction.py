"""Hysteresis of contacts with friction: MuJoCo against quasi-static stick and slip.

A whisker is pressed against a disc and released, and rubs lengthwise between; a few presses are oblique. The moment at the root
over the displacement of the base is a loop. The damping of the hinges makes it wider; the whiskers of this study have a tenth of
that of the presets, so that the loops are those of friction.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from whisker_sim.physics.cases import largest, rms
from whisker_sim.physics.stick_slip import stick_slip
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.runs import Run
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate
from whisker_sim.whisker import PRESETS, Array

TIMESTEP_S = 1e-4
RATE_HZ = 250.0
DAMPING_SHARE = 0.1
"""Damping of the hinges relative to that of the presets."""

_SIDES = (("straight", "left"), ("curved", "left"), ("curved", "right"))
_DISCS = {"pin": {"shape": "pin"}, "circle": {"shape": "circle", "radius_m": 0.015}}
_COEFFICIENTS = (0.3, 0.5)
_PRESS_M = {"straight": 0.02, "curved": 0.015}
"""Depth of the presses. In deeper ones the concave side may have no equilibrium with the whole friction towards the tip."""
_RUB = {"along_m": 0.006}
_OBLIQUE = {"oblique_rad": 0.5}
_DWELL_S = 0.2
_DRAWN = ("straight, pin, 0.5", "curved, concave side, circle, 0.3", "curved, convex side, pin, 0.5")
"""Cases whose instants the table `friction_instants` has, every `_DRAWN_ROWS`-th."""
_DRAWN_ROWS = 3

SETTLING_S = 0.1
"""Time after the first touch from which moments are compared: an impact is not quasi-static."""
_SLIPPING_S = 0.02
"""Time for which a contact slips to the same side before angles are compared: five time constants of the decay of slip."""
_SLIP_M_S = 1e-4
_WIDTH = 1e-3
"""Width of a loop, relative to the largest moment, below which it is of the size of the error that the moment may have."""


class Case(NamedTuple):
    """A scene by its name."""

    name: str
    whisker: str
    face: str
    disc: str
    coefficient: float
    oblique: bool


class Row(NamedTuple):
    """A case beside the quasi-static solution."""

    case: str
    coefficient: float
    instants: int
    sticking: int
    """Instants at which the quasi-static contact sticks."""
    range_n_m: float
    moment_rms: float
    """Relative to the range, as the following one."""
    moment_worst: float
    slipping: int
    """Instants at which the angle is compared."""
    angle_median_rad: float
    """Median deviation of the force's angle from the side of the cone while the contact slips."""
    angle_rms_rad: float
    angle_95_rad: float
    """95th percentile of the magnitude."""
    creep_m_s: float
    """Largest slip velocity in the second half of a rest."""


class Loop(NamedTuple):
    """Hysteresis loop of the moment over the displacement in one direction."""

    case: str
    direction: str
    """`press` or `lengthwise`."""
    area_n_m2: float
    """Of the quasi-static loop."""
    width: float
    """Mean width of the quasi-static loop relative to the largest moment."""
    deviation: float
    """Of the area of MuJoCo's loop, relative."""


class Instant(NamedTuple):
    """An instant of a case that is drawn; displacements of the base since the first touch."""

    case: str
    t_s: float
    press_m: float
    lengthwise_m: float
    friction_n_m: float
    """Moment less that of the quasi-static contact without friction."""
    static_friction_n_m: float
    angle_rad: float
    static_angle_rad: float


def cases() -> list[Case]:
    """All cases."""
    found = []
    for whisker, face in _SIDES:
        side = {"left": ", concave side", "right": ", convex side"}[face] if whisker == "curved" else ""
        for disc in _DISCS:
            for coefficient in _COEFFICIENTS:
                name = f"{whisker}{side}, {disc}, {coefficient}"
                found.append(Case(name, whisker, face, disc, coefficient, False))
                if coefficient == _COEFFICIENTS[-1] and face == "left":
                    found.append(Case(f"{name}, oblique", whisker, face, disc, coefficient, True))
    return found


def scene_of(case: Case) -> Scene:
    """The scene of a case."""
    preset = PRESETS[case.whisker][1]
    document = {
        "format": 1,
        "name": "friction",
        "role": "trial",
        "group": "physics",
        "face": case.face,
        "whisker": {"preset": case.whisker, "name": f"{case.whisker}_damped", "damping_s": DAMPING_SHARE * preset.damping_s},
        "object": _DISCS[case.disc],
        "motion": {
            "kind": "rub",
            "contact_arc_m": 0.05,
            "press_m": _PRESS_M[case.whisker],
            "strokes": 1,
            "peak_speed_m_s": 0.015,
            "dwell_s": _DWELL_S,
            **(_OBLIQUE if case.oblique else _RUB),
        },
        "friction": case.coefficient,
        "rate_hz": RATE_HZ,
        "simulation": {"timestep_s": TIMESTEP_S},
    }
    return msgspec.convert(document, Scene)


def compare(case: Case) -> tuple[Row, list[Loop], list[Instant]]:
    """Simulates a case and solves it quasi-statically at the same poses of the base."""
    scene = scene_of(case)
    plan = scene.plan()
    simulated = simulate(Run(scene.name, scene, Path(scene.name)))
    rows = np.flatnonzero(simulated.touching)
    poses, time_s = simulated.base_pose[rows], simulated.time_s[rows]
    moment_n_m = scene.resolved_whisker.root_stiffness_n_m_rad * simulated.rotations_rad[rows, 0]
    angle_rad, slip_m_s = simulated.friction.angle_rad[rows], simulated.friction.slip_m_s[rows]
    face = 1 if case.face == "left" else -1
    guess = simulated.truth.arc_m[rows], simulated.force_n[rows]
    static = stick_slip(scene.resolved_whisker, scene.object, face, poses, case.coefficient, *guess)

    range_n_m = largest(static.moment_n_m)
    settled = time_s > time_s[0] + SETTLING_S
    error = ((moment_n_m - static.moment_n_m) / range_n_m)[settled]
    slipping = _held(
        np.where(np.abs(static.slip_m) > _SLIP_M_S / RATE_HZ, np.sign(static.slip_m), 0.0), round(_SLIPPING_S * RATE_HZ)
    )
    miss_rad = (angle_rad - static.friction_rad)[slipping & settled]
    planned = plan.poses[:: scene.steps_per_row][rows]
    at_rest = np.all(np.diff(planned, axis=0, prepend=np.nan) == 0.0, axis=1)
    resting = _held(at_rest.astype(float), round(0.5 * _DWELL_S * RATE_HZ))
    row = Row(
        case=case.name,
        coefficient=case.coefficient,
        instants=int(np.sum(settled)),
        sticking=int(np.sum(static.sticking & settled)),
        range_n_m=range_n_m,
        moment_rms=rms(error),
        moment_worst=largest(error),
        slipping=len(miss_rad),
        angle_median_rad=float(np.median(miss_rad)),
        angle_rms_rad=rms(miss_rad),
        angle_95_rad=float(np.percentile(np.abs(miss_rad), 95)),
        creep_m_s=largest(slip_m_s[resting]),
    )
    normal = _normal(scene)
    moved_m = poses[:, :2] - poses[0, :2]
    press_m, lengthwise_m = moved_m @ normal, moved_m @ (face * np.array((normal[1], -normal[0])))
    touched = time_s >= plan.touching[0][0]
    loops = []
    for direction, way_m in (("press", press_m), ("lengthwise", lengthwise_m))[: 1 if case.oblique else 2]:
        area, found = (_area(values[touched], way_m[touched]) for values in (static.moment_n_m, moment_n_m))
        width = abs(area) / float(np.ptp(way_m[touched])) / range_n_m
        loops.append(Loop(case.name, direction, area, width, found / area - 1.0))
    by_friction_n_m, static_n_m = moment_n_m - static.frictionless_n_m, static.moment_n_m - static.frictionless_n_m
    columns = (time_s, press_m, lengthwise_m, by_friction_n_m, static_n_m, angle_rad, static.friction_rad)
    instants = zip(*(column[::_DRAWN_ROWS].tolist() for column in columns), strict=True) if case.name in _DRAWN else ()
    return row, loops, [Instant(case.name, *instant) for instant in instants]


def _normal(scene: Scene) -> Array:
    """Direction (2,) of the press: the normal of the undeflected whisker at the contact, towards the object."""
    angle_rad = float(scene.resolved_whisker.rest_angle_rad(scene.motion.contact_arc_m))
    return (1.0 if scene.face == "left" else -1.0) * np.array((-np.sin(angle_rad), np.cos(angle_rad)))


def _held(state: Array, count: int) -> NDArray[np.bool_]:
    """Mask (n,) of instants at which `state` (n,) is not zero and equal to its values at the `count` instants before."""
    held = state != 0.0
    for shift in range(1, count + 1):
        held[:shift] = False
        held[shift:] &= state[shift:] == state[:-shift]
    return held


def _area(values: Array, way: Array) -> float:
    """Integral of `values` over a closed way, by the trapezoidal rule."""
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(way)))


def _tasks(_: Path) -> list[partial[tuple[Row, list[Loop], list[Instant]]]]:
    return [partial(compare, case) for case in cases()]


def _conclude(results: list[tuple[Row, list[Loop], list[Instant]]]) -> Findings:
    rows = [row for row, _, _ in results]
    loops = [loop for _, of_case, _ in results for loop in of_case]
    claims = []
    for field, figure, scale, bound, unit in (
        ("moment_rms", "base moment against stick and slip, RMS", PERCENT, 0.1, "% of range"),
        ("angle_median_rad", "angle of the slipping force, median", float(np.degrees(1.0)), 0.5, "degrees"),
        ("angle_rms_rad", "angle of the slipping force, RMS", float(np.degrees(1.0)), 0.5, "degrees"),
        ("angle_95_rad", "angle of the slipping force, 95th percentile", float(np.degrees(1.0)), 0.5, "degrees"),
        ("creep_m_s", "creep of the resting contact", 1e6, 1.0, "um/s"),
    ):
        values = np.abs([getattr(row, field) for row in rows])
        # The first NaN, if there is one.
        largest_at = int(np.argmax(values))
        claim = f"friction: {figure} ({rows[largest_at].case})"
        claims.append(Claim(f"friction_{field}", claim, scale * float(values[largest_at]), "<=", bound, unit))
    wide = [loop for loop in loops if loop.width >= _WIDTH]
    narrow = [loop for loop in loops if loop.width < _WIDTH]
    for name, words, chosen in (("friction_loop", "wider", wide), ("friction_loop_narrow", "narrower", narrow)):
        if chosen:
            worst = chosen[int(np.argmax([abs(loop.deviation) for loop in chosen]))]
            about = f"area of {len(chosen)} hysteresis loops {words} than {PERCENT * _WIDTH:g} % of the range"
            claim = f"friction: {about} ({worst.case}, {worst.direction})"
            claims.append(Claim(name, claim, PERCENT * abs(worst.deviation), "<=", 2.0, "%"))
    tables = {"friction": rows, "friction_loops": loops, "friction_instants": [row for _, _, drawn in results for row in drawn]}
    return Findings(tables, claims)


STUDY = Study("friction", "contacts with friction against quasi-static stick and slip", _tasks, _conclude)
