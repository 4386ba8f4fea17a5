"""Equality with the command `whisker`, to the bit."""

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import whisker_contact as wc

from conftest import GOLDEN, ROOT, same_bits

NAMES = [row["name"] for row in wc.estimators()]


def run(command: Path, *arguments: object) -> str:
    done = subprocess.run([command, *map(str, arguments)], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def check_equal(table: np.ndarray, path: Path) -> None:
    expected = wc.read_table(path)
    assert table.dtype.names == expected.dtype.names
    for name in table.dtype.names:
        found = table[name]
        # A column without any value has no type in a file.
        if expected[name].dtype.kind == "f" and found.dtype.kind in "Ui":
            assert np.isnan(expected[name]).all(), name
            assert (found == ("" if found.dtype.kind == "U" else -1)).all(), name
        else:
            assert same_bits(found, expected[name].astype(found.dtype)), f"{path}: {name}"


@pytest.mark.parametrize("name", NAMES)
def test_verif_a_replay_equals_that_of_the_command(tmp_path, command, calibration, name):
    trace = wc.Trace.read(GOLDEN / "golden_pin.csv")
    path = tmp_path / "straight.json"
    calibration.write(path)
    out = tmp_path / "estimates" / f"golden_pin.{name}.csv"
    out.parent.mkdir()
    options = ["--estimator", name, "--calibration", path, "--seed", "7", "--out", out]
    run(command, "replay", GOLDEN / "golden_pin.csv", *options)
    check_equal(wc.Trial(trace, wc.load_calibration(path), seed=7).replay(name).table, out)
    check_equal(wc.Trial(trace, calibration, seed=7).replay(name).table, out)


def check_suite(tmp_path: Path, command: Path, dataset: wc.Dataset, names: list[str], threads: int) -> int:
    """Compare replays of every trial of a dataset, in parallel, and return their number."""
    calibrations = {trace.whisker.name: dataset.calibration(trace.whisker.name) for trace in dataset.traces()}
    folder = tmp_path / "estimates"
    folder.mkdir()

    def compare(job: tuple[Path, str]) -> None:
        path, name = job
        trace = wc.Trace.read(path)
        out = folder / f"{trace.name}.{name}.csv"
        run(command, "replay", path, "--estimator", name, "--out", out)
        check_equal(wc.Trial(trace, calibrations[trace.whisker.name]).replay(name).table, out)

    jobs = [(path, name) for path in dataset.paths() for name in names]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(compare, jobs))
    return len(jobs)


@pytest.mark.parametrize("threads", [1, 4])
def test_verif_every_replay_of_a_suite_equals_that_of_the_command(request, tmp_path, command, in_repository, threads):
    chosen = request.config.getoption("suite")
    if chosen:
        # A suite that was asked for must be there.
        assert (ROOT / "datasets" / chosen / "calibrations").is_dir(), chosen
    dataset = wc.Dataset(in_repository(f"datasets/{chosen or 'smoke'}/calibrations").parent)
    assert len(dataset.paths()) >= 2
    assert check_suite(tmp_path, command, dataset, NAMES, threads) == len(dataset.paths()) * len(NAMES)


@pytest.mark.parametrize("settings", [{}, {"white_counts": 2}])
def test_verif_a_replay_through_a_hall_sensor_equals_that_of_the_command(tmp_path, command, in_repository, settings):
    traces = in_repository("datasets/smoke")
    options = ["--front-end", "hall", "--front-end-config", json.dumps(settings)]
    run(command, "fit", "scenes/suites/smoke.json", "--traces", traces, "--out", tmp_path, *options)
    path = tmp_path / "straight.json"
    out = tmp_path / "estimates" / "smoke_pin.ekf.csv"
    out.parent.mkdir()
    run(command, "replay", traces / "smoke_pin.csv", "--estimator", "ekf", "--calibration", path, "--out", out, *options)
    trace, calibration = wc.Trace.read(traces / "smoke_pin.csv"), wc.load_calibration(path)
    trial = wc.Trial(trace, calibration, front_end="hall", front_end_settings=settings)
    check_equal(trial.replay("ekf").table, out)
    with pytest.raises(ValueError, match=r"front_end\.name: found `hall`, expected `white`"):
        wc.Trial(trace, calibration)


def test_verif_scores_equal_those_of_the_command(in_repository):
    results = wc.read_results(in_repository("results/smoke"))
    dataset = wc.Dataset(in_repository("datasets/smoke"))
    expected = results["trials"]
    names = list(dict.fromkeys(expected["estimator"].tolist()))
    seeds = sorted(set(expected["seed"].tolist()))
    [noise] = set(expected["noise"].tolist())
    table = wc.evaluate(dataset.traces(), dataset.calibration("straight"), names, noise=noise, seeds=seeds)
    key = ("trace", "seed", "estimator")
    found = {tuple(row[name] for name in key): row for row in table}
    assert len(found) == len(expected)
    for row in expected:
        for metric in wc.metrics():
            name = metric["name"]
            one, other = found[tuple(row[part] for part in key)][name], row[name]
            assert one == other or (np.isnan(one) and np.isnan(other)), f"{row['trace']} {row['estimator']} {name}"
