"""Evaluation of estimators, registered or written in Python, against the truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from os import PathLike
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._native import Calibration, SpatialCalibration, SpatialTrace, SpatialTrial, Trace, Trial

#: Measurement noise of a simulated trace that states none, as a fraction of the largest reading of its set.
DEFAULT_NOISE = 0.01

_LARGEST_SEED = 2**64 - 1

_AnyTrace: TypeAlias = Trace | SpatialTrace
_AnyCalibration: TypeAlias = Calibration | SpatialCalibration
_Calibrations: TypeAlias = _AnyCalibration | Mapping[str, _AnyCalibration]


class Stepper(Protocol):
    """Estimator written in Python."""

    def step(self, motion: tuple[float, float, float], dt_s: float, reading_n_m: float, /) -> Any:
        """Take one sample; see `Trial.run`."""


class SpatialStepper(Protocol):
    """Estimator in space written in Python."""

    def step(
        self,
        motion: tuple[float, float, float, float, float, float, float],
        dt_s: float,
        reading_n_m: tuple[float, float],
        /,
    ) -> Any:
        """Take one sample; see `SpatialTrial.run`."""


def evaluate(
    traces: Iterable[_AnyTrace],
    calibrations: Calibration | SpatialCalibration | Mapping[str, Calibration] | Mapping[str, SpatialCalibration],
    estimators: Sequence[str]
    | Mapping[str, str | Callable[[Trial], Stepper]]
    | Mapping[str, str | Callable[[SpatialTrial], SpatialStepper]],
    noise: float | None = None,
    seeds: int | Sequence[int] = 1,
    threads: int = 1,
) -> NDArray[np.void]:
    """Scores of estimators on every trace, with the noise, the seeds and the metrics of `whisker evaluate`.

    `traces` are planar ones or ones in space, not both. `calibrations` is one calibration, or one for each whisker by its name.
    `estimators` are names of registered estimators, or a dictionary from the name of a row to a registered name or to a function
    that makes an estimator from a `Trial`, in space from a `SpatialTrial`; what it makes has a method `step` (see `Trial.run`) and
    must not use `Trial.trace`, which holds the truth. `noise` is a fraction of the largest reading of all traces with the same
    group and whisker. By default it is the noise that each trace states (`replay` of its sidecar) if all traces state theirs,
    otherwise 0.01, and 0 for recordings of real sensors. A miscalibration that a trace states is not applied, with any `noise`:
    such traces are a `ValueError`. `seeds` are a number of seeds from 1 on, or the seeds themselves. Registered estimators run in
    parallel on `threads` threads, with the same result.

    An exception of an estimator has a note with the estimator, the trace and the seed.

    Returns a structured array with a row for each trace, seed and estimator: `trace`, `group`, `whisker`, `seed`, `estimator`,
    then the scores, those of `Trial.score` or `SpatialTrial.score`.
    """
    traces = _checked_traces(traces)
    if isinstance(estimators, str):
        raise TypeError(f"estimators: found the text `{estimators}`, expected names in a list, or a dictionary")
    if threads < 1:
        raise ValueError(f"threads: found {threads}, expected at least 1")
    chosen: Mapping[str, Any] = estimators if isinstance(estimators, Mapping) else {name: name for name in estimators}
    if not traces or not chosen:
        raise ValueError(f"evaluate: found {len(traces)} traces and {len(chosen)} estimators, expected at least one of each")
    _check_kinds(traces, calibrations)
    each_seed = range(1, int(seeds) + 1) if isinstance(seeds, (int, np.integer)) else seeds
    if len(each_seed) == 0:
        raise ValueError("seeds: found none, expected at least one")
    for seed in each_seed:
        if not 0 <= seed <= _LARGEST_SEED:
            raise ValueError(f"seeds: found {seed}, expected 0 to {_LARGEST_SEED}")
    states_noise = all("replay" in trace.sidecar for trace in traces)
    largest_n_m = _largest_readings(traces, calibrations)

    def trial_rows(trace: _AnyTrace, seed: int) -> list[dict[str, object]]:
        fraction = noise if noise is not None else _default_noise(trace, states_noise)
        added_n_m = fraction * largest_n_m[trace.group, trace.whisker.name]
        trial = _trial(trace, _calibration(calibrations, trace.whisker.name), seed, added_n_m)
        head = {"trace": trace.name, "group": trace.group, "whisker": trace.whisker.name, "seed": seed}
        rows: list[dict[str, object]] = []
        for name, estimator in chosen.items():
            try:
                rows.append({**head, "estimator": name, **_scores(trial, estimator)})
            except Exception as error:
                error.add_note(f"estimator `{name}`, trace {trace.name}, seed {seed}")
                raise
        return rows

    jobs = [(trace, seed) for trace in traces for seed in each_seed]
    if threads == 1:
        rows = [trial_rows(*job) for job in jobs]
    else:
        with ThreadPoolExecutor(threads) as pool:
            rows = list(pool.map(lambda job: trial_rows(*job), jobs))
    return _table([row for of_trial in rows for row in of_trial])


def _checked_traces(traces: Iterable[_AnyTrace]) -> list[_AnyTrace]:
    """List of traces that state no miscalibration."""
    expected = "expected traces, such as those of `Dataset(folder).traces()`"
    if isinstance(traces, (str, bytes, PathLike)):
        raise TypeError(f"traces: found the path `{traces!s}`, {expected}")
    if isinstance(traces, (Trace, SpatialTrace)):
        raise TypeError(f"traces: found the trace {traces.name} alone, {expected}")
    checked = list(traces)
    for trace in checked:
        if not isinstance(trace, (Trace, SpatialTrace)):
            found = f"the path `{trace!s}`" if isinstance(trace, (str, bytes, PathLike)) else type(trace).__name__
            raise TypeError(f"traces: found {found} among them, {expected}")
        stated = trace.sidecar.get("replay", {}).get("miscalibration", {})
        if deviations := [name for name, value in stated.items() if value]:
            raise ValueError(
                f"traces: {trace.name}: found a stated miscalibration ({', '.join(deviations)}), expected none, since it would not "
                "be applied; `whisker evaluate` applies it"
            )
    return checked


def _default_noise(trace: _AnyTrace, states_noise: bool) -> float:
    """Fraction of the set's largest reading: the stated one if all traces state theirs."""
    if states_noise:
        stated: float = trace.sidecar["replay"]["noise"]
        return stated
    return 0.0 if "recorded" in trace.sidecar else DEFAULT_NOISE


def _check_kinds(traces: list[_AnyTrace], calibrations: _Calibrations) -> None:
    """Check that traces and calibrations are either planar or in space."""
    in_space = isinstance(traces[0], SpatialTrace)
    kinds = ("a planar trace", "a trace in space")
    for trace in traces:
        if isinstance(trace, SpatialTrace) != in_space:
            found, expected = kinds[not in_space], kinds[in_space]
            raise ValueError(f"traces: {trace.name}: found {found}, expected {expected}, as {traces[0].name} is")
    expected_class = SpatialCalibration if in_space else Calibration
    for whisker in dict.fromkeys(trace.whisker.name for trace in traces):
        calibration = _calibration(calibrations, whisker)
        if not isinstance(calibration, expected_class):
            found, name = type(calibration).__name__, expected_class.__name__
            raise TypeError(f"calibrations: {whisker}: found {found}, expected {name}, as for {kinds[in_space]}")


def _largest_readings(traces: list[_AnyTrace], calibrations: _Calibrations) -> dict[tuple[str, str], float]:
    largest_n_m: dict[tuple[str, str], float] = {}
    for trace in traces:
        key = (trace.group, trace.whisker.name)
        moments_n_m = _moments_n_m(trace, _calibration(calibrations, trace.whisker.name))
        largest_n_m[key] = max(largest_n_m.get(key, 0.0), float(moments_n_m.max(initial=0.0)))
    return largest_n_m


def _moments_n_m(trace: _AnyTrace, calibration: _AnyCalibration) -> NDArray[np.float64]:
    """Magnitudes of the bending moments, in the plane of those that a contact may explain."""
    known = trace.recording
    if isinstance(calibration, SpatialCalibration):
        # A square root of squares, as in Rust: `np.hypot` differs in the last bit.
        squares: NDArray[np.float64] = known["moment_y_n_m"] ** 2 + known["moment_z_n_m"] ** 2
        return np.sqrt(squares)
    moments_n_m: NDArray[np.float64] = np.abs(known["moment_z_n_m"])
    return moments_n_m[moments_n_m <= calibration.gate_n_m]


def _calibration(calibrations: _Calibrations, whisker: str) -> _AnyCalibration:
    if isinstance(calibrations, (Calibration, SpatialCalibration)):
        return calibrations
    if whisker not in calibrations:
        raise ValueError(f"calibrations: found {', '.join(calibrations) or 'none'}, expected `{whisker}` among them")
    return calibrations[whisker]


def _trial(trace: _AnyTrace, calibration: Any, seed: int, noise_sd_n_m: float) -> Any:
    if isinstance(trace, SpatialTrace):
        return SpatialTrial(trace, calibration, seed=seed, noise_sd_n_m=noise_sd_n_m)
    return Trial(trace, calibration, seed=seed, noise_sd_n_m=noise_sd_n_m)


def _scores(trial: Any, estimator: Any) -> dict[str, float]:
    replay = trial.replay(estimator) if isinstance(estimator, str) else trial.run(estimator(trial))
    scores: dict[str, float] = trial.score(replay)
    return scores


def _table(rows: list[dict[str, object]]) -> NDArray[np.void]:
    texts = ("trace", "group", "whisker", "estimator")
    width = {name: max(len(str(row[name])) for row in rows) for name in texts}
    kinds: dict[str, Any] = {name: f"U{width[name]}" for name in texts} | {"seed": np.uint64}
    columns = [(name, kinds.get(name, np.float64)) for name in rows[0]]
    return np.array([tuple(row.values()) for row in rows], dtype=columns)
