"""Evaluation of estimators, registered or written in Python, against the truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ._native import Calibration, Replay, Trace, Trial, metrics

#: Measurement noise of a simulated trace, as a fraction of the largest reading of its set.
DEFAULT_NOISE = 0.01


class Stepper(Protocol):
    """Estimator written in Python."""

    def step(self, motion: tuple[float, float, float], dt_s: float, reading_n_m: float, /) -> Any:
        """Take one sample; see `Trial.run`."""


def evaluate(
    traces: Iterable[Trace],
    calibrations: Calibration | Mapping[str, Calibration],
    estimators: Sequence[str] | Mapping[str, str | Callable[[Trial], Stepper]],
    noise: float | None = None,
    seeds: int | Sequence[int] = 1,
    threads: int = 1,
) -> NDArray[np.void]:
    """Scores of estimators on every trace, with the noise, the seeds and the metrics of `whisker evaluate`.

    `calibrations` is one calibration, or one for each whisker by its name. `estimators` are names of registered estimators, or a
    dictionary from the name of a row to a registered name or to a function that makes an estimator from a `Trial`; what it
    makes has a method `step` (see `Trial.run`) and must not use `Trial.trace`, which holds the truth. `noise` is a fraction of
    the largest reading of all traces with the same group and whisker, by default 0.01, and 0 for recordings of real sensors.
    `seeds` are a number of seeds from 1 on, or the seeds themselves. Registered estimators run in parallel on `threads` threads,
    with the same result.

    Returns a structured array with a row for each trace, seed and estimator: `trace`, `group`, `whisker`, `seed`, `estimator`,
    then the metrics.
    """
    traces = list(traces)
    if isinstance(estimators, str):
        raise TypeError(f"estimators: found the text `{estimators}`, expected names in a list, or a dictionary")
    if threads < 1:
        raise ValueError(f"threads: found {threads}, expected at least 1")
    chosen = estimators if isinstance(estimators, Mapping) else {name: name for name in estimators}
    if not traces or not chosen:
        raise ValueError(f"evaluate: found {len(traces)} traces and {len(chosen)} estimators, expected at least one of each")
    each_seed = range(1, int(seeds) + 1) if isinstance(seeds, (int, np.integer)) else seeds
    if len(each_seed) == 0:
        raise ValueError("seeds: found none, expected at least one")
    largest_n_m = _largest_readings(traces, calibrations)

    def trial_rows(trace: Trace, seed: int) -> list[tuple[object, ...]]:
        calibration = _calibration(calibrations, trace.whisker.name)
        recorded = "recorded" in trace.sidecar
        fraction = noise if noise is not None else (0.0 if recorded else DEFAULT_NOISE)
        added_n_m = fraction * largest_n_m[trace.group, trace.whisker.name]
        trial = Trial(trace, calibration, seed=seed, noise_sd_n_m=added_n_m)
        rows = []
        for name, estimator in chosen.items():
            scores = trial.score(_replay(trial, estimator))
            rows.append((trace.name, trace.group, trace.whisker.name, seed, name, *scores.values()))
        return rows

    jobs = [(trace, seed) for trace in traces for seed in each_seed]
    if threads == 1:
        rows = [trial_rows(*job) for job in jobs]
    else:
        with ThreadPoolExecutor(threads) as pool:
            rows = list(pool.map(lambda job: trial_rows(*job), jobs))
    return _table([row for of_trial in rows for row in of_trial])


def _largest_readings(traces: list[Trace], calibrations: Calibration | Mapping[str, Calibration]) -> dict[tuple[str, str], float]:
    largest_n_m: dict[tuple[str, str], float] = {}
    for trace in traces:
        key = (trace.group, trace.whisker.name)
        moments_n_m = np.abs(trace.recording["moment_z_n_m"])
        admitted_n_m = moments_n_m[moments_n_m <= _calibration(calibrations, trace.whisker.name).gate_n_m]
        largest_n_m[key] = max(largest_n_m.get(key, 0.0), float(admitted_n_m.max(initial=0.0)))
    return largest_n_m


def _calibration(calibrations: Calibration | Mapping[str, Calibration], whisker: str) -> Calibration:
    if isinstance(calibrations, Calibration):
        return calibrations
    if whisker not in calibrations:
        raise ValueError(f"calibrations: found {', '.join(calibrations) or 'none'}, expected `{whisker}` among them")
    return calibrations[whisker]


def _replay(trial: Trial, estimator: str | Callable[[Trial], Stepper]) -> Replay:
    return trial.replay(estimator) if isinstance(estimator, str) else trial.run(estimator(trial))


def _table(rows: list[tuple[object, ...]]) -> NDArray[np.void]:
    texts = [("trace", 0), ("group", 1), ("whisker", 2), ("estimator", 4)]
    width = {name: max(len(str(row[place])) for row in rows) for name, place in texts}
    head = [(name, f"U{width[name]}") for name in ("trace", "group", "whisker")]
    scores = [(metric["name"], np.float64) for metric in metrics()]
    return np.array(rows, dtype=[*head, ("seed", np.uint64), ("estimator", f"U{width['estimator']}"), *scores])
