//! The figures of a report. To add one: a file in this folder and a row in [`FIGURES`].

use anyhow::Result;

use super::canvas::Picture;
use super::run_data::RunData;

mod contours;
mod error_over_time;
mod objects;
mod sample_trace;
mod sensor_model;
mod start_and_steady;

/// One figure of the report.
pub(crate) struct Figure {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// Its heading on the page.
    pub(crate) title: &'static str,
    /// What is seen, in plain text.
    pub(super) caption: &'static str,
    /// Lays it out; absent where the run holds nothing of the kind.
    pub(super) draw: fn(&RunData) -> Result<Option<Picture>>,
}

/// All figures, in the order of the page.
pub(crate) const FIGURES: &[Figure] = &[
    Figure {
        name: "error_over_time",
        title: "Error over time",
        caption: "Distance between estimated and true contact since the first touch: median over trials and noise \
                  seeds (lines), where at least half of them have an estimate. The bands hold 10 to 90 % of them, for \
                  the filter and the baseline with the smallest median error in steady state, both whiskers together. \
                  Above the whole trial, below its first second. Errors beyond 100 mm, more than the length of a \
                  whisker, leave the picture.",
        draw: error_over_time::draw,
    },
    Figure {
        name: "start_and_steady",
        title: "Start and steady state",
        caption: "Root mean square contact error of every trial under every noise seed (dots) and the median (bar), \
                  within the first two seconds of contact and after them. A dot counts from its estimator's own first \
                  estimate on, and the baselines are silent until the whisker has been pushed: at the start the dots \
                  of filters and baselines cover different times, and the table above compares them at common ones. \
                  Factor: error of the better baseline over that of the filter in steady state, as in that table.",
        draw: start_and_steady::draw,
    },
    Figure {
        name: "contours",
        title: "Reconstructed contours",
        caption: "Estimated surface points (dots) with 95 % ellipses over the true outline, for the filter whose \
                  points lie nearest to it: the smallest median distance, over trials and noise seeds, stands above \
                  the panel. Dark: the touched part of the outline, from its first to its last touched point; a \
                  single disc where only a corner was touched. Nothing is aligned. One trial a panel, after the \
                  first two seconds of contact.",
        draw: contours::draw,
    },
    Figure {
        name: "objects",
        title: "All objects",
        caption: "Above, steady root mean square contact error; below, median distance of the estimated surface \
                  points to the true outline. Medians over trials and noise seeds. Errors lie mostly along the outline, so an \
                  outline looks better than the contact: judge both.",
        draw: objects::draw,
    },
    Figure {
        name: "sample_trace",
        title: "One trial",
        caption: "The trial whose median error in steady state is the median of its set: the reading with measurement \
                  noise, position and yaw of the base since the start, and the contact error with the standard \
                  deviation that the filter claims. The filter is the one with the smallest median error in steady \
                  state, both whiskers together. Dashed: first touch.",
        draw: sample_trace::draw,
    },
    Figure {
        name: "sensor_model",
        title: "Sensor model",
        caption: "Left, the expected reading over the position of the contact in the frame of the base, on the \
                  calibrated domain; lines join contacts of equal reading, which one reading alone cannot tell \
                  apart; dark, the undeflected whisker. Right, residuals of each calibration trace under the model \
                  fitted to the others, relative to the largest reading.",
        draw: sensor_model::draw,
    },
];
