"""The preset whiskers against the table that the Rust crate `whisker` is compared with, too."""

from pathlib import Path

from whisker_sim.whisker import PRESETS, Whisker

GOLDEN = Path(__file__).resolve().parents[2] / "datasets/golden/whisker_presets.csv"

COLUMNS = (
    "name",
    "length_m",
    "root_diameter_m",
    "tip_diameter_m",
    "youngs_modulus_pa",
    "density_kg_m3",
    "curvature",
    "root_stiffness_n_m_rad",
    "segments",
    "damping_s",
)


def row(whisker: Whisker) -> str:
    """The whisker as a line of the table, its pre-curvature as `length_m:curvature_per_m` of each piece."""
    curvature = ";".join(f"{arc.length_m!r}:{arc.curvature_per_m!r}" for arc in whisker.curvature)
    cells = {name: str(getattr(whisker, name)) for name in COLUMNS} | {"curvature": curvature}
    return ",".join(cells.values())


def test_val_the_table_of_presets_holds_the_presets() -> None:
    expected = [",".join(COLUMNS), *(row(whisker) for _, whisker in PRESETS.values())]
    assert GOLDEN.read_text().splitlines() == expected
