"""Butterworth filters of SciPy, the reference of the design in Rust.

`python sim/tests/test_butterworth.py` writes the three golden files, with which the Rust crates are tested.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

GOLDEN = Path(__file__).resolve().parents[2] / "datasets" / "golden"
SECTIONS = GOLDEN / "butterworth_sections.csv"
FILTERED = GOLDEN / "butterworth_filtered.csv"
LOW_PASS = GOLDEN / "butterworth_low_pass.csv"

DESIGNS = {
    "published": (3, 4.0, 16.0, 250.0),
    "high_order": (6, 4.0, 16.0, 250.0),
    "wide_with_real_poles": (3, 1.0, 100.0, 250.0),
    "first_order": (1, 5.0, 12.0, 888.0),
    "even_order": (4, 20.0, 60.0, 1000.0),
}
"""Order of the prototype, edges of the band (Hz), sampling rate (Hz)."""

LOW_PASS_DESIGNS = {
    "published": (2, 5.0, 888.0),
    "published_live": (2, 2.0, 888.0),
    "odd": (3, 30.0, 800.0),
    "high_order": (6, 40.0, 800.0),
}
"""Order, edge (Hz), sampling rate (Hz)."""


def sections(design):
    """Second-order sections (order, 6) of a design: b0, b1, b2, 1, a1, a2."""
    order, low_hz, high_hz, rate_hz = DESIGNS[design]
    return signal.butter(order, [low_hz, high_hz], "bandpass", fs=rate_hz, output="sos")


def filtered():
    """An input (200,) and its output of every design, by name."""
    values = np.random.default_rng(4).standard_normal(200)
    return {"input": values} | {design: signal.sosfilt(sections(design), values) for design in DESIGNS}


def low_passed():
    """The same input and its output of every low-pass, causal and with zero phase (forwards and backwards)."""
    values = filtered()["input"]
    columns = {"input": values}
    for design, (order, edge_hz, rate_hz) in LOW_PASS_DESIGNS.items():
        low_pass = signal.butter(order, edge_hz, fs=rate_hz, output="sos")
        columns[design] = signal.sosfilt(low_pass, values)
        columns[f"{design}_zero_phase"] = signal.sosfiltfilt(low_pass, values)
    return columns


def write_columns(path, columns):
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def write():
    """Writes the golden files."""
    with SECTIONS.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["design", "order", "low_hz", "high_hz", "rate_hz", "b0", "b1", "b2", "a1", "a2"])
        for design, parameters in DESIGNS.items():
            rows.writerows([design, *parameters, *section[:3], *section[4:]] for section in sections(design).tolist())
    write_columns(FILTERED, filtered())
    write_columns(LOW_PASS, low_passed())


@pytest.mark.parametrize("design", DESIGNS)
def test_regress_golden_filters(design):
    """The files equal the results of the installed SciPy, to rounding."""
    with SECTIONS.open(newline="") as file:
        kept = [
            [float(row[key]) for key in ("b0", "b1", "b2", "a1", "a2")] for row in csv.DictReader(file) if row["design"] == design
        ]
    np.testing.assert_allclose(kept, np.delete(sections(design), 3, axis=1), rtol=1e-12, atol=1e-15)
    with FILTERED.open(newline="") as file:
        kept = [float(row[design]) for row in csv.DictReader(file)]
    np.testing.assert_allclose(kept, filtered()[design], rtol=0.0, atol=1e-13)


def test_regress_golden_low_passes():
    """As above."""
    with LOW_PASS.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for column, expected in low_passed().items():
        np.testing.assert_allclose([float(row[column]) for row in rows], expected, rtol=0.0, atol=1e-13)


if __name__ == "__main__":
    write()
