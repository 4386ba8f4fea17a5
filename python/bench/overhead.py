"""Times of `Estimator.step` and `Estimator.replay` beside those of Rust: overhead.py TRACE CALIBRATION [ESTIMATOR ...].

Least time of several runs per sample. Build the Rust side first:
cargo build --release --package whisker-python --example step_times
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import whisker_contact as wc

RUNS = 30
RUST = Path(__file__).resolve().parents[2] / "target" / "release" / "examples" / "step_times"


def least_ns(run, samples: int) -> float:
    """Least time of a run per sample."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter_ns()
        run()
        times.append((time.perf_counter_ns() - start) / samples)
    return min(times)


def times_ns(trace: wc.Trace, calibration: wc.Calibration, name: str) -> tuple[float, float, float]:
    """Times per sample of step, of the same loop without it, and of replay."""
    trial = wc.Trial(trace, calibration, noise_sd_n_m=0.0)
    samples = list(zip(map(tuple, trial.motions.tolist()), trial.dt_s.tolist(), trial.readings_n_m.tolist(), strict=True))
    recording = trace.recording
    base = np.column_stack([recording["base_x_m"], recording["base_y_m"], recording["base_yaw_rad"]])
    t_s = recording["t_s"].copy()
    estimator = wc.Estimator(name, calibration, 1e-7, trace.rate_hz)

    def step() -> None:
        estimator.reset()
        for motion, dt_s, reading_n_m in samples:
            estimator.step(motion, dt_s, reading_n_m)

    def loop() -> None:
        for _motion, _dt_s, _reading_n_m in samples:
            pass

    readings_n_m = trial.readings_n_m
    count = len(samples)
    return least_ns(step, count), least_ns(loop, count), least_ns(lambda: estimator.replay(t_s, base, readings_n_m), count)


def main(trace: str, calibration: str, *names: str) -> None:
    """Print a row for each estimator."""
    print("estimator      Rust step   step   above   Rust replay   replay   ratio   (ns a sample)")
    for name in names or ("paper-ekf", "ekf", "recommended"):
        rust = subprocess.run([RUST, trace, calibration, name], check=True, capture_output=True, text=True).stdout
        rust_step, rust_replay = map(float, rust.split())
        step, loop, replay = times_ns(wc.Trace.read(trace), wc.load_calibration(calibration), name)
        print(
            f"{name:14} {rust_step:9.0f} {step - loop:6.0f} {step - loop - rust_step:7.0f}"
            f" {rust_replay:13.0f} {replay:8.0f} {replay / rust_replay:7.3f}"
        )


main(*sys.argv[1:])
