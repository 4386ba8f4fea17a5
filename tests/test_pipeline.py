"""Command `whisker` on the smoke suite, which the end-to-end run has simulated and fitted."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

from whisker_sim.paths import whisker_program

ROOT = Path(__file__).resolve().parents[1]
SUITE = "scenes/suites/smoke.json"
TRACE = "datasets/smoke/smoke_pin.csv"


def whisker(*arguments: str | Path, code: int = 0) -> str:
    """Standard output of the command, which must end with this exit code."""
    done = subprocess.run([whisker_program(), *map(str, arguments)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    return done.stdout


@pytest.fixture(scope="module", autouse=True)
def simulated() -> None:
    """Skips the tests if traces or calibration are missing."""
    if not (ROOT / "datasets/smoke/calibrations/straight.json").is_file():
        pytest.skip("datasets/smoke is missing: run cargo xtask test")


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def without_timing(path: Path) -> list[dict[str, str]]:
    return [{key: value for key, value in row.items() if key != "step_ns"} for row in rows(path)]


def test_verif_results_do_not_depend_on_the_number_of_threads(tmp_path: Path) -> None:
    for threads in (1, 2):
        arguments = ["--threads", str(threads), "--name", f"threads_{threads}", "--results", tmp_path, "--seeds", "3"]
        whisker("evaluate", SUITE, *arguments)
    one, two = tmp_path / "threads_1", tmp_path / "threads_2"
    assert (one / "trials.csv").read_bytes() == (two / "trials.csv").read_bytes()
    assert (one / "error_over_time.csv").read_bytes() == (two / "error_over_time.csv").read_bytes()
    assert without_timing(one / "summary.csv") == without_timing(two / "summary.csv")


def test_verif_up_to_date_results_are_reused(tmp_path: Path) -> None:
    arguments = ["evaluate", SUITE, "--results", tmp_path, "--estimators", "ekf", "--seeds", "1"]
    assert "up to date" not in whisker(*arguments)
    before = (tmp_path / "smoke" / "summary.csv").read_bytes()
    assert "up to date" in whisker(*arguments)
    assert (tmp_path / "smoke" / "summary.csv").read_bytes() == before
    whisker(*arguments, "--noise", "0.02", code=1)
    assert (tmp_path / "smoke" / "summary.csv").read_bytes() == before
    assert "up to date" not in whisker(*arguments, "--noise", "0.02", "--force")
    fit = ["fit", SUITE, "--out", tmp_path / "calibrations"]
    assert "up to date" not in whisker(*fit)
    assert "up to date" in whisker(*fit)
    assert "up to date" not in whisker(*fit, "--model", "polynomial", "--config", '{"degree": 4}')


def test_verif_settings_take_effect_and_are_recorded(tmp_path: Path) -> None:
    settings = tmp_path / "settings.json"
    settings.write_text(json.dumps({"ekf": {"fading": 1.5}}))
    arguments = ["evaluate", SUITE, "--results", tmp_path, "--estimators", "ekf,ukf", "--seeds", "1"]
    whisker(*arguments, "--name", "plain")
    whisker(*arguments, "--name", "changed", "--config", settings)
    run = json.loads((tmp_path / "changed" / "run.json").read_text())
    assert [estimator["config"]["fading"] for estimator in run["estimators"]] == [1.5, 1.0]
    plain, changed = (
        {(row["trace"], row["estimator"]): row["rmse_m"] for row in rows(tmp_path / name / "trials.csv")}
        for name in ("plain", "changed")
    )
    assert plain["smoke_pin", "ekf"] != changed["smoke_pin", "ekf"]
    assert plain["smoke_pin", "ukf"] == changed["smoke_pin", "ukf"]


def test_verif_replay_gives_the_estimates_that_evaluate_scores(tmp_path: Path) -> None:
    """Without noise the readings, and hence the estimates, are the same."""
    whisker("evaluate", SUITE, "--results", tmp_path, "--estimators", "ukf", "--noise", "0", "--seeds", "1")
    out = tmp_path / "replay.csv"
    whisker("replay", TRACE, "--estimator", "ukf", "--noise", "0", "--out", out)
    assert out.read_bytes() == (tmp_path / "smoke" / "estimates" / "smoke_pin.ukf.csv").read_bytes()
    assert whisker("replay", TRACE, "--estimator", "ukf", "--noise", "0") == out.read_text()


def test_verif_a_hall_sensor_is_calibrated_evaluated_and_reported(tmp_path: Path) -> None:
    calibrations, front_end = tmp_path / "calibrations", ["--front-end", "hall"]
    whisker("fit", SUITE, *front_end, "--out", calibrations, "--model", "elastica")
    arguments = ["--calibrations", calibrations, "--results", tmp_path, "--estimators", "ukf", "--seeds", "1"]
    whisker("evaluate", SUITE, *front_end, *arguments)
    run = tmp_path / "smoke"
    calibration = calibrations / "straight.json"
    replayed = whisker("replay", TRACE, *front_end, "--calibration", calibration, "--estimator", "ukf")
    assert replayed == (run / "estimates" / "smoke_pin.ukf.csv").read_text()
    whisker("report", run)
    assert (run / "figures" / "common_mode.svg").is_file()
    assert (run / "figures" / "transfer.svg").is_file()
    checked = whisker("check", calibration, run / "sensors")
    for kind in ("through `hall`, sensors straight", "turned sensor with", "counts over rotations with"):
        assert kind in checked


def test_verif_an_external_program_is_evaluated_and_finds_the_pin(tmp_path: Path) -> None:
    program = ["--estimators", "ekf", "--exec", f"{sys.executable} examples/my_filter.py"]
    for threads in (1, 2):
        arguments = ["--threads", str(threads), "--name", f"threads_{threads}", "--results", tmp_path, "--seeds", "2"]
        whisker("evaluate", SUITE, *program, *arguments)
    one, two = tmp_path / "threads_1", tmp_path / "threads_2"
    assert (one / "trials.csv").read_bytes() == (two / "trials.csv").read_bytes()
    assert rows(one / "failures.csv") == []
    scores = [row for row in rows(one / "trials.csv") if row["estimator"] == "my_filter"]
    pins = [row for row in scores if row["group"] == "pin"]
    assert len(pins) == 2
    assert all(float(row["rmse_m"]) < 1e-3 for row in pins)
    recorded = json.loads((one / "run.json").read_text())["estimators"][1]
    assert len(recorded["config"]["files_sha256"]["examples/my_filter.py"]) == 64
    whisker("report", one)
    assert "my_filter" in (one / "index.html").read_text()


def test_robust_a_program_that_fails_is_recorded(tmp_path: Path) -> None:
    arguments = ["--estimators", "ekf", "--results", tmp_path, "--seeds", "1"]
    whisker("evaluate", SUITE, *arguments, "--exec", f"mute={sys.executable} -c pass", code=3)
    failures = rows(tmp_path / "smoke" / "failures.csv")
    assert {failure["trace"] for failure in failures} == {"smoke_pin", "smoke_circle"}
    for failure in failures:
        assert (failure["estimator"], failure["seed"]) == ("mute", "1")
        assert "before its answer to row 1" in failure["reason"]


def test_robust_estimators_without_their_sensor_model_are_omitted_unless_requested(tmp_path: Path) -> None:
    calibrations = tmp_path / "calibrations"
    whisker("fit", SUITE, "--out", calibrations, "--model", "elastica")
    arguments = ["evaluate", SUITE, "--calibrations", calibrations, "--results", tmp_path, "--seeds", "1"]
    whisker(*arguments)
    names = [estimator["name"] for estimator in json.loads((tmp_path / "smoke" / "run.json").read_text())["estimators"]]
    assert "ekf" in names
    assert not [name for name in names if name.startswith("paper-")]
    whisker(*arguments, "--estimators", "paper-ekf", code=1)


def test_verif_check_recognises_every_kind_of_file() -> None:
    run = Path("results/smoke")
    tables = [run / folder for folder in ("bounds", "contours", "estimates", "events", "models", "outlines")]
    checked = whisker("check", "datasets/smoke", "datasets/smoke/calibrations", SUITE, run, *tables)
    for kind in ("trace `smoke_pin`", "outline with", "calibration of `straight`", "suite `smoke`", "run `smoke`", "trials"):
        assert kind in checked
    for kind in ("scores of outlines", "estimates", "contact events", "bound", "outline found", "true outline"):
        assert kind in checked


def test_verif_list_prints_every_registry() -> None:
    overview = whisker("list")
    for name in ("euler-bernoulli-calibrated", "polynomial", "hall", "error_over_time", "claims", "generator"):
        assert name in overview
    for registry, name in (("estimators", "euler-bernoulli-calibrated"), ("claims", "determinism"), ("generator", "lateral_sweep")):
        assert name in whisker("list", registry)
