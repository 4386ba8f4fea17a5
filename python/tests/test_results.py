"""Readers of results, data frames and figures."""

import numpy as np
import pytest

import whisker_contact as wc

BOUNDS = "t_s,bound_m,window_m,condition\n0.5,0.001,,\n0.504,0.0009,0.002,1.5\n"


def test_verif_a_table_has_typed_columns_with_missing_values(tmp_path):
    path = tmp_path / "bounds" / "pin.csv"
    path.parent.mkdir()
    path.write_text(BOUNDS)
    table = wc.read_table(path)
    assert table.dtype.names == ("t_s", "bound_m", "window_m", "condition")
    assert table["bound_m"].tolist() == [0.001, 0.0009]
    assert np.isnan(table["window_m"][0])
    assert table["window_m"][1] == 0.002


def test_robust_a_damaged_table_is_refused_with_line_and_column(tmp_path):
    path = tmp_path / "bounds" / "pin.csv"
    path.parent.mkdir()
    path.write_text(BOUNDS.replace("0.0009", "much"))
    with pytest.raises(ValueError, match=r"pin.csv:3: column `bound_m`: found `much`"):
        wc.read_table(path)
    path.write_text(BOUNDS.replace("0.0009", "inf"))
    with pytest.raises(ValueError, match=r"pin.csv:3: column `bound_m`: found inf, expected a finite number"):
        wc.read_table(path)
    with pytest.raises(ValueError, match="found no table of a run, expected one"):
        wc.read_table(tmp_path / "notes.csv")


def test_robust_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"found no run, expected run\.json or space_run\.json"):
        wc.read_results(tmp_path)
    (tmp_path / "space_settings.json").write_text("{}")
    with pytest.raises(ValueError, match=r"found tables of `whisker recordings` \(space_settings\.json\), expected run\.json"):
        wc.read_results(tmp_path)


def test_verif_every_table_of_a_run_is_read(in_repository):
    results = wc.read_results(in_repository("results/smoke"))
    assert len(results) > 10
    assert {"trials", "summary"} <= set(results)
    for name, table in results.items():
        assert table.dtype.names, name
    with pytest.raises(KeyError, match="found no table `absent`"):
        results["absent"]


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_verif_a_structured_array_becomes_a_data_frame(simulated, library):
    pytest.importorskip(library)
    frame = wc.frame(simulated.recording, library)
    assert list(frame.columns) == list(simulated.recording.dtype.names)
    assert frame["t_s"].to_numpy().tolist() == simulated.recording["t_s"].tolist()


def test_robust_frames_of_other_arrays_or_libraries_are_refused(simulated):
    with pytest.raises(ValueError, match="expected a structured array"):
        wc.frame(np.zeros(3))
    with pytest.raises(ValueError, match="library: found `excel`"):
        wc.frame(simulated.recording, "excel")


def test_verif_figures_draw_bound_errors_and_outline(trial):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    replay = trial.replay("recommended")
    axes = wc.plot_sweep(trial, {"recommended": replay})
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["recommended", "recommended, stated", "Cramér–Rao bound"]
    axes.figure.canvas.draw()
    assert not axes.bbox.overlaps(axes.get_legend().get_window_extent())
    axes = wc.plot_outline(trial, replay)
    assert "true outline" in [text.get_text() for text in axes.get_legend().get_texts()]
