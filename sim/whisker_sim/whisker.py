"""Whiskers: parameters, undeflected shape, presets.

s is the arc length from the root, L the length, d(s) the diameter, linear between root and tip, kappa0(s) the piecewise constant
pre-curvature. The undeflected shape is given in Base, with the root at the origin and its tangent along +x.
"""

from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*\Z"
WORD = r"^[a-z][a-z0-9_]*\Z"
PATTERNS = {
    NAME: "letters, digits, '_' and '-', the first a letter or a digit",
    WORD: "lower-case letters, digits and '_', the first a letter",
}
"""Patterns of texts, in words."""
Name = Annotated[str, msgspec.Meta(pattern=NAME, max_length=100)]
"""Also used as part of file names."""
Length = Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]
LEAST_DIMENSION_M = 1e-5
"""Ten times the chord error of an outline, `shapes.base.CHORD_ERROR_M`."""
Dimension = Annotated[float, msgspec.Meta(ge=LEAST_DIMENSION_M, le=10.0)]
"""A dimension of an object."""
NotNegativeLength = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
Coordinate = Annotated[float, msgspec.Meta(ge=-10.0, le=10.0)]
Angle = Annotated[float, msgspec.Meta(ge=-4.0 * np.pi, le=4.0 * np.pi)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Array = NDArray[np.float64]


class Arc(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A piece of the undeflected whisker with constant curvature, positive to the left."""

    length_m: Length
    curvature_per_m: float


_PLAUSIBLE = {
    "root_diameter_m": (1e-6, 0.1, "m"),
    "tip_diameter_m": (1e-6, 0.1, "m"),
    "youngs_modulus_pa": (1e3, 1e13, "Pa"),
    "density_kg_m3": (1.0, 3e4, "kg/m3"),
}
"""Smallest and largest values with their unit: from soft gels to beyond diamond, and from aerogels to beyond osmium."""
_STEEPEST = 0.5
"""Largest slope of the radius (m per metre): the sine of the half angle of a cone, 30 degrees."""


class Whisker(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of a whisker, as stored in the sidecar of a trace.

    `damping_s` is the ratio of damping to stiffness of every hinge, including the root (a Kelvin-Voigt time constant). With time
    steps h, a mode of angular frequency w has the damping ratio w (damping_s + h) / 2.

    Raises `ValueError` for values that no whisker has: most are errors of the unit or of an exponent.
    """

    name: str
    length_m: Length
    root_diameter_m: Length
    tip_diameter_m: Length
    youngs_modulus_pa: Positive
    density_kg_m3: Positive
    curvature: tuple[Arc, ...]
    root_stiffness_n_m_rad: Positive
    segments: Annotated[int, msgspec.Meta(ge=2, le=400)]
    damping_s: NotNegative

    def __post_init__(self) -> None:
        total_m = sum(arc.length_m for arc in self.curvature)
        if abs(total_m - self.length_m) > 1e-9:
            raise ValueError(f"whisker.curvature: expected lengths that add up to length_m = {self.length_m}, found {total_m}")
        for key, (least, most, unit) in _PLAUSIBLE.items():
            value = getattr(self, key)
            if not least <= value <= most:
                raise ValueError(f"whisker.{key}: expected {least:g} to {most:g} {unit}, found {value:g}")
        if abs(self.radius_slope) >= _STEEPEST:
            raise ValueError(
                f"whisker.tip_diameter_m: expected a radius that changes by less than {_STEEPEST:g} m per metre of length_m, "
                f"found {abs(self.radius_slope):.3g}"
            )
        start_m = 0.0
        for arc in self.curvature:
            turn_rad = abs(arc.curvature_per_m) * arc.length_m
            if turn_rad > np.pi:
                raise ValueError(f"whisker.curvature: expected arcs that turn by at most pi rad, found {turn_rad:.4g}")
            thickest_m = float(np.max(self.radius_m((start_m, start_m + arc.length_m))))
            if abs(arc.curvature_per_m) * thickest_m >= 1.0:
                raise ValueError(
                    f"whisker.curvature: expected less than {1.0 / thickest_m:.4g} per metre, the inverse of the whisker's radius, "
                    f"found {abs(arc.curvature_per_m):g}"
                )
            start_m += arc.length_m

    @property
    def segment_m(self) -> float:
        """Length of one segment of the chain."""
        return self.length_m / self.segments

    def diameter_m(self, arc_m: ArrayLike) -> Array:
        """Diameter at the arc lengths `arc_m`; any shape."""
        share = np.asarray(arc_m) / self.length_m
        return self.root_diameter_m + share * (self.tip_diameter_m - self.root_diameter_m)

    def radius_m(self, arc_m: ArrayLike) -> Array:
        """Radius at the arc lengths `arc_m`; any shape."""
        return 0.5 * self.diameter_m(arc_m)

    @property
    def radius_slope(self) -> float:
        """Derivative of the radius with respect to arc length: the sine of the angle between surface and centre line."""
        return 0.5 * (self.tip_diameter_m - self.root_diameter_m) / self.length_m

    def compliance_rad_n_m(self, from_m: float, to_m: float) -> float:
        """Integral of ds / EI between two arc lengths, EI = E pi d^4 / 64: rotation per unit bending moment (rad/(N m)).

        With d linear, int ds/d^4 = (b - a) (da^2 + da db + db^2) / (3 da^3 db^3), exact and without cancellation.
        """
        da, db = self.diameter_m([from_m, to_m])
        integral = (to_m - from_m) * (da * da + da * db + db * db) / (3.0 * da**3 * db**3)
        return float(64.0 * integral / (np.pi * self.youngs_modulus_pa))

    def mass_kg(self, from_m: Array, to_m: Array) -> Array:
        """Masses between pairs of arc lengths, of any shape, by the volume of a frustum.

        rho pi/12 (b - a) (da^2 + da db + db^2).
        """
        da, db = self.diameter_m(from_m), self.diameter_m(to_m)
        return self.density_kg_m3 * np.pi / 12.0 * (to_m - from_m) * (da * da + da * db + db * db)

    def rest_angle_rad(self, arc_m: ArrayLike) -> Array:
        """Tangent angle of the undeflected whisker in Base at `arc_m`; any shape."""
        starts, curvatures, angles, _ = self._pieces()
        arc_m = np.asarray(arc_m, dtype=float)
        piece = self._piece(arc_m, starts)
        return angles[piece] + curvatures[piece] * (arc_m - starts[piece])

    def rest_point_m(self, arc_m: ArrayLike) -> Array:
        """Points (..., 2) of the undeflected centre line in Base at the arc lengths `arc_m` (...)."""
        starts, curvatures, angles, origins = self._pieces()
        arc_m = np.asarray(arc_m, dtype=float)
        piece = self._piece(arc_m, starts)
        return origins[piece] + _arc_chord(arc_m - starts[piece], curvatures[piece], angles[piece])

    def _piece(self, arc_m: Array, starts: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(starts, arc_m, side="right") - 1, 0, len(starts) - 1)

    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """Start, curvature, tangent angle and origin of each piece."""
        lengths = np.array([arc.length_m for arc in self.curvature])
        curvatures = np.array([arc.curvature_per_m for arc in self.curvature])
        starts = np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
        angles = np.concatenate(([0.0], np.cumsum(lengths * curvatures)[:-1]))
        chords = _arc_chord(lengths, curvatures, angles)
        origins = np.concatenate((np.zeros((1, 2)), np.cumsum(chords, axis=0)[:-1]))
        return starts, curvatures, angles, origins


def _arc_chord(length_m: Array, curvature_per_m: Array, angle_rad: Array) -> Array:
    """Vector (..., 2) from the start of a circular arc, in the direction `angle_rad`, to its point at `length_m`.

    The chord is l sinc(kappa l / 2) at the mean angle, which also holds for zero curvature.
    """
    half_turn = 0.5 * curvature_per_m * length_m
    chord_m = length_m * np.sinc(half_turn / np.pi)
    return np.stack((chord_m * np.cos(angle_rad + half_turn), chord_m * np.sin(angle_rad + half_turn)), axis=-1)


_PUBLISHED_DAMPING_S = 2.35e-3
"""The ringing of the straight whisker then decays to the noise level within 1.4 s, as in Lin et al. (IROS 2022)."""

_NITINOL_80 = Whisker(
    name="straight",
    length_m=0.08,
    root_diameter_m=0.25e-3,
    tip_diameter_m=0.25e-3,
    youngs_modulus_pa=60e9,
    density_kg_m3=6450.0,
    curvature=(Arc(0.08, 0.0),),
    root_stiffness_n_m_rad=0.17e-3,
    segments=40,
    damping_s=_PUBLISHED_DAMPING_S,
)

_GEL_DAMPING_S = 1e-3
"""Assumption for gel and plastic: the first mode of the released whisker has a damping ratio of 0.1."""

_PRINTED_150 = Whisker(
    name="printed",
    length_m=0.15,
    root_diameter_m=3e-3,
    tip_diameter_m=0.6e-3,
    youngs_modulus_pa=2e9,
    density_kg_m3=1270.0,
    curvature=(Arc(0.15, 0.0),),
    root_stiffness_n_m_rad=0.06,
    segments=40,
    damping_s=_GEL_DAMPING_S,
)
"""Shaft of the OpenWhisker calibration platform (TAROS 2024): 150 mm, tapered, printed, on a gel hinge.

Its length is published. Modulus and density are those of PETG, the material named in their figures; the root diameter is an
assumption. Taper and hinge stiffness are rounded values that fit all published recordings. By beam theory, a contact at the share x
of the length rotates the root, per push, 1 / (1 + K x / (1 - t x)) times as far as that of a rigid shaft, with t = 1 - tip / root
and K = k L / (3 EI). The published readings decrease towards the tip as for t = 0.8 and K = 0.36: a tip with a fifth of the root's
diameter, and a hinge of such a stiffness that both gel and shaft deflect."""

PRESETS: dict[str, tuple[str, Whisker]] = {
    whisker.name: (about, whisker)
    for about, whisker in (
        ("nitinol wire, 80 mm x 0.25 mm, straight", _NITINOL_80),
        (
            "the same wire with a radius of 80 mm, bends to the left",
            msgspec.structs.replace(_NITINOL_80, name="curved", curvature=(Arc(0.08, 12.5),)),
        ),
        (
            "nitinol wire, 50 mm x 0.2 mm: 20 mm straight, then an arc of radius 18 mm to the left",
            msgspec.structs.replace(
                _NITINOL_80,
                name="stanford",
                length_m=0.05,
                root_diameter_m=0.2e-3,
                tip_diameter_m=0.2e-3,
                youngs_modulus_pa=75e9,
                curvature=(Arc(0.02, 0.0), Arc(0.03, 1.0 / 0.018)),
            ),
        ),
        ("printed shaft, 150 mm, tapered from 3 to 0.6 mm, on a gel hinge", _PRINTED_150),
    )
}
"""Whiskers by name, each with a one-line description."""


class WhiskerOverride(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A preset with some parameters replaced.

    It needs a name of its own, because calibrations are identified by the name of the whisker.
    """

    preset: str
    name: Name
    length_m: Length | None = None
    root_diameter_m: Length | None = None
    tip_diameter_m: Length | None = None
    youngs_modulus_pa: Positive | None = None
    density_kg_m3: Positive | None = None
    curvature: tuple[Arc, ...] | None = None
    root_stiffness_n_m_rad: Positive | None = None
    segments: Annotated[int, msgspec.Meta(ge=2, le=400)] | None = None
    damping_s: NotNegative | None = None


def resolve_whisker(choice: str | WhiskerOverride) -> Whisker:
    """The whisker that a scene names; raises `ValueError` for an unknown preset or the name of a preset."""
    preset = choice if isinstance(choice, str) else choice.preset
    if preset not in PRESETS:
        key = "whisker" if isinstance(choice, str) else "whisker.preset"
        raise ValueError(f"{key}: expected one of {', '.join(PRESETS)}, found '{preset}'")
    _, whisker = PRESETS[preset]
    if isinstance(choice, str):
        return whisker
    if choice.name in PRESETS:
        raise ValueError(f"whisker.name: expected a name that no preset has, found '{choice.name}'")
    fields = msgspec.structs.asdict(choice)
    del fields["preset"]
    given = {key: value for key, value in fields.items() if value is not None}
    if "length_m" in given and "curvature" not in given and len(whisker.curvature) == 1:
        given["curvature"] = (Arc(given["length_m"], whisker.curvature[0].curvature_per_m),)
    return msgspec.structs.replace(whisker, **given)
