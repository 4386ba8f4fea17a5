"""The schema of scene files, from which the Rust crates take the defaults of absent keys."""

import pytest

from whisker_sim.cli import main
from whisker_sim.schema import scene_schema

from conftest import REPOSITORY

STORED = REPOSITORY / "crates/trace/data/scene.schema.json"


def test_regress_the_stored_schema_is_current(capsys):
    """`whisker-sim schema > crates/trace/data/scene.schema.json` writes it again."""
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == STORED.read_text()


@pytest.mark.parametrize("kind", ["Scene", "ArmScene", "SpatialScene"])
def test_verif_the_schema_has_the_settings_of_every_name(kind):
    """A name of settings and the settings themselves are equal scenes."""
    assert scene_schema()["$defs"][kind]["properties"]["simulation"]["x-settings"]["fast"] == {"timestep_s": 0.001}
