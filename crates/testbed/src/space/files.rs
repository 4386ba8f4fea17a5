//! Table of the files of a run in space, from which `whisker check` and the replacement of a run are derived.

use super::SpatialEstimateRow;
use super::rows::{SpatialMapRow, SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow, VoxelRow};
use crate::results::files::{Per, Rows, RunFile, Writer, run_files, table};
use crate::results::{FailureRow, read_rows};

run_files! {
    /// The registry of the files of a run in space.
    SPATIAL_RUN_FILES;
    RUN = "space_run.json", Run, Evaluate, None,
        "watermark, noise, seeds, estimators with their settings, trials with their whiskers and solids";
    TRIALS = "space_trials.csv", Run, Evaluate, table!(SpatialTrialRow, "trials in space"),
        "one row per trace, estimator and seed";
    SUMMARY = "space_summary.csv", Run, Evaluate, table!(SpatialSummaryRow, "summary in space"),
        "one row per group, whisker and estimator";
    TIMES = "space_times.csv", Run, Evaluate, table!(SpatialTimesRow, "times in space"),
        "one row per estimator: times of its steps, which depend on the machine";
    FAILURES = "space_failures.csv", Run, Evaluate, table!(FailureRow, "failed trials in space", or_none),
        "one row per trial on which an external program failed, with the reason";
    ESTIMATES = "space_estimates/<trace>.<estimator>.csv", TraceAndEstimator, Evaluate, table!(SpatialEstimateRow, "estimates in space"),
        "one row per kept instant, at the first seed";
    MAP_SCORES = "space_maps.csv", Run, Evaluate, table!(SpatialMapRow, "maps in space"),
        "one row per solid and estimator: number of points, area of the surface, distance of each from the true solid, and number of objects";
    MAP_POINTS = "space_maps/<traces>.<estimator>.ply", SolidAndEstimator, Evaluate, None,
        "points of the touched surface of a solid";
    MAP_SURFACE = "space_maps/<traces>.<estimator>.surface.ply", SolidAndEstimator, Evaluate, None,
        "triangle mesh of that surface with its uncertainty";
    MAP_SCENE = "space_maps/<traces>.<estimator>.glb", SolidAndEstimator, Evaluate, None,
        "the same as a scene";
    MAP_VOXELS = "space_maps/<traces>.<estimator>.voxels.csv", SolidAndEstimator, Evaluate, table!(VoxelRow, "occupancy grid in space", or_none),
        "occupancy grid";
    FIGURES = "figures/", Run, Report, None, "figures as SVG and PNG";
    PAGE = "index.html", Run, Report, None, "report page";
}
