"""Pins in random directions of the suite `spatial`: `python -m whisker_sim.physics.space_pins DIR` writes their scenes.

A pin is drawn again only if its trace cannot be simulated: the motion does not fit the scene, the contact is lost or slips to the
tip, or the penetration exceeds its limit. The deviation from the rod plays no part.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from whisker_sim.errors import WhiskerSimError
from whisker_sim.runs import load_runs
from whisker_sim.space.simulate import simulate_in_space

PINS = 20
SEED = 3
"""The settings of the whisker's surface (`space.model`) were chosen on the pins of the seeds 18 and 2026."""
_STEEPEST = 0.6
"""Largest share of the axis along the whisker at the start, along which a pin would be missed."""
_ALONG = 0.5
"""Largest share of the direction of the push along the pin."""
_ARCS_M = (0.043, 0.055)
_STROKE_M = 0.003


def stream(whisker: str) -> np.random.Generator:
    """The random stream of the pins of a whisker."""
    return np.random.Generator(np.random.PCG64([SEED, len(whisker)]))


def drawn(rng: np.random.Generator, name: str, whisker: str) -> dict[str, Any]:
    """A scene with a random pin: any direction of its axis and of the push that is across whisker and pin."""
    while True:
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        angle_rad = rng.uniform(0.0, 2.0 * np.pi)
        direction = np.array((0.0, np.cos(angle_rad), np.sin(angle_rad)))
        if abs(axis[0]) <= _STEEPEST and abs(axis @ direction) <= _ALONG:
            break
    return {
        "format": 2,
        "name": name,
        "role": "trial",
        "group": "pins",
        "whisker": whisker,
        "solid": {"shape": "pin", "axis": _rounded(axis, 3)},
        "motion": {
            "kind": "sweep",
            "contact_arc_m": round(rng.uniform(*_ARCS_M), 4),
            "depth_m": 0.005,
            "direction": _rounded(direction, 3),
            "stroke_m": _rounded(_STROKE_M * axis, 5),
            "tilt_rad": [0.02, 0.02, 0.02],
        },
    }


def write_pins(folder: Path) -> int:
    """Writes the scenes of all pins into `folder`; returns the number of drawn pins that are not possible."""
    impossible = 0
    for whisker in ("straight", "curved"):
        rng = stream(whisker)
        for number in range(PINS):
            path = folder / f"pin_{number:02d}_{whisker}.json"
            while True:
                path.write_text(_text(drawn(rng, path.stem, whisker)))
                try:
                    simulate_in_space(load_runs(path)[1][0])
                    break
                except WhiskerSimError as error:
                    print(f"{path.stem}: {error}", file=sys.stderr)
                    impossible += 1
    return impossible


def _rounded(vector: np.ndarray, decimals: int) -> list[float]:
    return [float(value) for value in np.round(vector, decimals)]


def _text(scene: dict[str, Any]) -> str:
    """The scene as JSON with one line a key."""
    return "{\n" + ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in scene.items()) + "\n}\n"


if __name__ == "__main__":
    print(f"{write_pins(Path(sys.argv[1]))} pins were drawn again, because their motion is not possible")
