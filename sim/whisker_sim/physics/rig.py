"""Calibration rig: MuJoCo's printed whisker under the moving ruler, against the elastica and the beam.

A small push at the distance d from the root of a tapering shaft is shared between the hinge of the root and the shaft. Under a
force F the hinge of stiffness k deflects by F d^2 / k, and the shaft by int_0^d F (d - s)^2 / EI ds = F d^3 / (3 EI0 (1 - t d /
L)), with EI0 at the root and t = 1 - tip / root in diameters. The root thus rotates, per push, by 1 / (d (1 + k d / (3 EI0 (1 - t d
/ L)))).
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whisker_sim.certificate import contacts_of, disagreement
from whisker_sim.paths import ROOT
from whisker_sim.physics.cases import largest
from whisker_sim.physics.study import PERCENT, Claim, Findings, Study
from whisker_sim.runs import Run, load_runs
from whisker_sim.simulate import simulate
from whisker_sim.whisker import Whisker

_SCENE = ROOT / "scenes/rig/increments_beam_test.json"
_FIRST_M, _LAST_M = 1e-3, 6e-3
"""Range of depths over which the slope is evaluated: after the initial impact and before the printer decelerates."""


class Row(NamedTuple):
    """One position of the routine."""

    distance_m: float
    """Distance of the ruler's edge from the root."""
    push_m: float
    """Depth of the ruler from the first contact."""
    rotation_rad: float
    """Rotation of the root at rest under the ruler."""
    elastica_rad: float
    error: float
    """Relative."""
    slope_rad_m: float
    """Rotation per push while the ruler moves."""
    beam_rad_m: float
    """The same for a small push, by the formula."""
    rigid_rad_m: float
    """The same for a rigid shaft."""


def beam_rad_m(whisker: Whisker, distance_m: float) -> float:
    """Rotation of the root of a straight `whisker` per small push at `distance_m`, by the formula above."""
    bending_n_m2 = whisker.youngs_modulus_pa * np.pi * whisker.root_diameter_m**4 / 64.0
    taper = 1.0 - whisker.tip_diameter_m / whisker.root_diameter_m
    shaft = distance_m / (3.0 * bending_n_m2 * (1.0 - taper * distance_m / whisker.length_m))
    return 1.0 / (distance_m * (1.0 + whisker.root_stiffness_n_m_rad * shaft))


def pushes(run: Run) -> list[Row]:
    """One row per position of the routine `run`."""
    scene, whisker, motion = run.scene, run.scene.resolved_whisker, run.scene.motion
    simulated = simulate(run)
    holds = scene.plan().touching
    contacts = contacts_of(whisker, simulated)
    at_rest = contacts.at(np.searchsorted(contacts.time_s, [end_s for _, end_s in holds]) - 1)
    exact = disagreement(whisker, scene.object, scene.face, at_rest).exact
    places_m = whisker.length_m - motion.tip_padding_m - np.linspace(0.0, motion.total_y_m, motion.increments_y + 1)
    rows = []
    for index, (place_m, (start_s, _)) in enumerate(zip(places_m.tolist(), holds, strict=True)):
        push_m = motion.total_x_m + motion.edge_ahead_m + float(whisker.radius_m(place_m))
        # The path to the hold is straight: the remaining path is the remaining push.
        left_m = np.hypot(*(simulated.base_pose - at_rest.base_pose[index])[:, :2].T)
        depth_m = push_m - left_m
        before = (simulated.time_s < start_s) & (simulated.time_s > (holds[index - 1][1] if index else 0.0))
        pushed = before & (depth_m > _FIRST_M) & (depth_m < _LAST_M)
        # Only the approach counts: the ruler also leaves along this path, from the preceding position.
        pushed &= simulated.time_s > simulated.time_s[before][np.argmin(depth_m[before])]
        slope_rad_m, _ = np.polyfit(depth_m[pushed], simulated.rotations_rad[pushed, 0], 1)
        rotation_rad = at_rest.moment_n_m[index] / whisker.root_stiffness_n_m_rad
        elastica_rad = exact.moment_n_m[index] / whisker.root_stiffness_n_m_rad
        beam = beam_rad_m(whisker, place_m)
        error = rotation_rad / elastica_rad - 1.0
        rows.append(Row(place_m, push_m, rotation_rad, elastica_rad, error, slope_rad_m, beam, 1.0 / place_m))
    return rows


def _routine() -> list[Row]:
    return pushes(load_runs(_SCENE)[1][0])


def _tasks(_: Path) -> list[partial[list[Row]]]:
    return [partial(_routine)]


def _conclude(results: list[list[Row]]) -> Findings:
    (rows,) = results
    claims = [
        Claim(
            "rig_rotation",
            "printed whisker at rest under the ruler: rotation of the root against the elastica, worst place",
            PERCENT * largest([row.error for row in rows]),
            "<=",
            0.1,
            "%",
        ),
        Claim(
            "rig_slope",
            "rotation per push while the ruler moves, against the beam's for a small push, worst place",
            PERCENT * largest([row.slope_rad_m / row.beam_rad_m - 1.0 for row in rows]),
            "<=",
            1.0,
            "%",
        ),
    ]
    return Findings({"rig": rows}, claims)


STUDY = Study("rig", "the calibration rig's whisker under the ruler, at rest and while it moves", _tasks, _conclude)
