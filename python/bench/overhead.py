"""Times of `Estimator.step` and `Estimator.replay` and those in Rust: overhead.py RUST CALIBRATIONS TRACE [TRACE ...].

RUST is the program `step_times`: cargo build --release --package whisker-python --example step_times. CALIBRATIONS is the
folder of the calibrations, named after the whiskers of the traces. Writes CSV to stdout: least times of several runs per
sample, in nanoseconds.
"""

import csv
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import whisker_contact as wc

RUNS = 30
NOISE = 0.01
ESTIMATORS = ("paper-ekf", "recommended")
COLUMNS = ("trace", "estimator", "rust_step", "step", "rust_replay", "replay", "rust_step_p99", "rust_step_largest")


def least_ns(run: Callable[[], object], samples: int) -> float:
    """Least time of a run per sample."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter_ns()
        run()
        times.append((time.perf_counter_ns() - start) / samples)
    return min(times)


def times_ns(trace: wc.Trace, calibration: wc.Calibration, name: str) -> tuple[float, float]:
    """Times per sample of step, less that of the same loop without it, and of replay."""
    trial = wc.Trial(trace, calibration, NOISE)
    samples = list(zip(map(tuple, trial.motions.tolist()), trial.dt_s.tolist(), trial.readings_n_m.tolist(), strict=True))
    recording = trace.recording
    base = np.column_stack([recording["base_x_m"], recording["base_y_m"], recording["base_yaw_rad"]])
    t_s = recording["t_s"].copy()
    estimator = wc.Estimator(name, calibration, trial.noise_sd_n_m, trace.rate_hz)

    def step() -> None:
        estimator.reset()
        for motion, dt_s, reading_n_m in samples:
            estimator.step(motion, dt_s, reading_n_m)

    def loop() -> None:
        for _motion, _dt_s, _reading_n_m in samples:
            pass

    readings_n_m = trial.readings_n_m
    count = len(samples)
    step_ns = least_ns(step, count) - least_ns(loop, count)
    return step_ns, least_ns(lambda: estimator.replay(t_s, base, readings_n_m), count)


def main(rust: str, calibrations: str, *traces: str) -> None:
    """Write a row for each trace and estimator."""
    writer = csv.writer(sys.stdout)
    writer.writerow(COLUMNS)
    for path in traces:
        trace = wc.Trace.read(path)
        calibration = Path(calibrations) / f"{trace.whisker.name}.json"
        for name in ESTIMATORS:
            command = [rust, path, str(calibration), name]
            found = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
            rust_step, rust_replay, p99, largest = map(float, found)
            step, replay = times_ns(trace, wc.load_calibration(calibration), name)
            values = (rust_step, step, rust_replay, replay, p99, largest)
            writer.writerow((Path(path).stem, name, *(f"{value:.0f}" for value in values)))
            sys.stdout.flush()


main(*sys.argv[1:])
