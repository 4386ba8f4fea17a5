"""The tutorial: its code runs and prints what the notebook shows."""

import contextlib
import io
import json
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[1] / "tutorial.ipynb"


def test_regress_the_tutorial_prints_what_it_shows():
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    namespace = {"__name__": "tutorial"}
    for number, cell in enumerate(cell for cell in cells if cell["cell_type"] == "code"):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, code cell {number}", "exec"), namespace)
        stored = [output["text"] for output in cell["outputs"] if output["output_type"] == "stream"]
        assert printed.getvalue() == "".join(text if isinstance(text, str) else "".join(text) for text in stored)
