"""Whisker mechanics, sensor models and contact estimators.

A whisker is a thin elastic wire on a compliant root that a robot drags past objects. From the bending moment at the root and
the known motion of the root, an estimator computes the point of contact.

| task | functions and classes |
| --- | --- |
| mechanics | `Whisker`, `deflect`, `press`, `Contacts` |
| sensor models | `load_calibration`, `fit_calibration`, `Calibration`, `Prediction`, `Sensor`, `sensor_models` |
| recordings | `Trace`, `Dataset`, `Recording`, `simulate`, `Shape` |
| estimation | `Estimator`, `Estimate`, `Replay`, `Outline`, `estimators`, `detectors`, `front_ends` |
| evaluation | `Trial`, `evaluate`, `cramer_rao_bound`, `metrics` |
| several whiskers | `scene_map`, `SceneMap`, `MappedObject` |
| mechanics in space | `Rod`, `SpatialContacts` |
| recordings and sensor models in space | `SpatialTrace`, `load_spatial_calibration`, `fit_spatial_calibration`, \
`SpatialCalibration`, `SpatialPrediction`, `BendingSensor` |
| estimation in space | `SpatialEstimator`, `SpatialEstimate`, `SpatialReplay`, `spatial_estimators` |
| surfaces in space | `SpatialSurface` |
| evaluation in space | `SpatialTrial`, `evaluate`, `spatial_cramer_rao_bound`, `spatial_front_ends` |
| results | `read_table`, `read_results`, `Results`, `frame` |
| figures | `plot_sweep`, `plot_outline` |

Quantities are in SI units, named at the end of each name (`moment_n_m`). Shapes are given in brackets: (n, 2) is one point a
row. Frames: World is fixed; Base is that of the whisker's root, +x along the tangent of the undeflected root, +y to the left and
+z up; Start is the Base of the first sample. Angles are counter-clockwise.

An error is an exception with the message of the command `whisker`: `ValueError` for invalid input, and the exception of the
operating system (`FileNotFoundError`, ...) for files. Long calls release the interpreter lock, so that they run in parallel in
threads, and Ctrl-C ends them.
"""

from ._native import (
    BendingSensor,
    Calibration,
    Contacts,
    Dataset,
    Estimate,
    Estimator,
    MappedObject,
    Outline,
    Prediction,
    Recording,
    Replay,
    Rod,
    SceneMap,
    Sensor,
    Shape,
    SpatialCalibration,
    SpatialContacts,
    SpatialEstimate,
    SpatialEstimator,
    SpatialPrediction,
    SpatialReplay,
    SpatialSurface,
    SpatialTrace,
    SpatialTrial,
    Trace,
    Trial,
    Whisker,
    cramer_rao_bound,
    deflect,
    detectors,
    estimators,
    fit_calibration,
    fit_spatial_calibration,
    front_ends,
    load_calibration,
    load_spatial_calibration,
    metrics,
    press,
    scene_map,
    sensor_models,
    simulate,
    spatial_cramer_rao_bound,
    spatial_estimators,
    spatial_front_ends,
)
from .evaluation import SpatialStepper, Stepper, evaluate
from .figures import plot_outline, plot_sweep
from .results import Results, frame, read_results, read_table

__all__ = [
    "BendingSensor",
    "Calibration",
    "Contacts",
    "Dataset",
    "Estimate",
    "Estimator",
    "MappedObject",
    "Outline",
    "Prediction",
    "Recording",
    "Replay",
    "Results",
    "Rod",
    "SceneMap",
    "Sensor",
    "Shape",
    "SpatialCalibration",
    "SpatialContacts",
    "SpatialEstimate",
    "SpatialEstimator",
    "SpatialPrediction",
    "SpatialReplay",
    "SpatialStepper",
    "SpatialSurface",
    "SpatialTrace",
    "SpatialTrial",
    "Stepper",
    "Trace",
    "Trial",
    "Whisker",
    "cramer_rao_bound",
    "deflect",
    "detectors",
    "estimators",
    "evaluate",
    "fit_calibration",
    "fit_spatial_calibration",
    "frame",
    "front_ends",
    "load_calibration",
    "load_spatial_calibration",
    "metrics",
    "plot_outline",
    "plot_sweep",
    "press",
    "read_results",
    "read_table",
    "scene_map",
    "sensor_models",
    "simulate",
    "spatial_cramer_rao_bound",
    "spatial_estimators",
    "spatial_front_ends",
]
