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


def test_regress_the_kind_of_a_column_does_not_depend_on_its_content(tmp_path):
    failures = tmp_path / "failures.csv"
    failures.write_text("trace,estimator,noise,seed,reason\n001,,0,3,17\n")
    table = wc.read_table(failures)
    assert [table.dtype[name].kind for name in table.dtype.names] == list("UUfuU")
    assert table[0].tolist() == ("001", "", 0.0, 3, "17")
    failures.write_text("trace,estimator,noise,seed,reason\n")
    empty = wc.read_table(failures)
    assert len(empty) == 0
    assert [empty.dtype[name].kind for name in empty.dtype.names] == list("UUfuU")
    head = ["trace", "group", "whisker", "object", "estimator", "noise", "seed", "touch_s", "samples", "missing", "models"]
    scores = [metric["name"] for metric in wc.metrics()]
    trials = tmp_path / "trials.csv"
    row = ["07", "1", "2", "3", "4", "0", "1", "0.5", "10", "0", "", *("" for _ in scores)]
    trials.write_text(",".join(head + scores) + "\n" + ",".join(row) + "\n")
    table = wc.read_table(trials)
    assert table.dtype.names == (*head, *scores)
    assert [table.dtype[name].kind for name in head] == list("UUUUUfufuuU")
    assert all(table.dtype[name].kind == "f" and np.isnan(table[name][0]) for name in scores)
    assert table[["trace", "models"]][0].tolist() == ("07", "")


def test_verif_names_of_columns_that_differ_between_tables(tmp_path):
    """`object` is a shape or an index, `touched` a flag or a count."""
    points = tmp_path / "maps" / "passage.ekf.points.csv"
    points.parent.mkdir()
    names = "t_s,whisker,array,object,x_m,y_m,normal_rad,cov_xx_m2,cov_xy_m2,cov_yy_m2"
    points.write_text(f"{names}\n0.5,1,2,,0,0,0,,,\n0.6,1,2,1,0,0,0,,,\n")
    table = wc.read_table(points)
    assert table["whisker"].tolist() == ["1", "1"]
    assert np.array_equal(table["object"], [np.nan, 1.0], equal_nan=True)
    outlines = tmp_path / "maps" / "passage.ekf.outlines.csv"
    outlines.write_text("object,x_m,y_m,normal_rad,cov_xx_m2,cov_xy_m2,cov_yy_m2,touched\n2,0,0,0,,,,true\n")
    table = wc.read_table(outlines)
    assert table[["object", "touched"]][0].tolist() == (2, 1)
    grid = tmp_path / "maps" / "passage.ekf.grid.csv"
    grid.write_text("x_m,y_m,swept,touched,occupied\n0,0,1,7,0.5\n")
    table = wc.read_table(grid)
    assert table["touched"].tolist() == [7]
    assert table.dtype["touched"] == np.uint64


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
