//! The figures of an evaluated run. To add one: a file in this folder and a row in [`FIGURES`].

use super::figure::Figure;
use super::run_data::RunData;

mod array_signals;
mod common_mode;
mod consistency;
mod contact_events;
mod contours;
mod encoder_noise;
mod error_over_time;
mod objects;
mod observability;
mod physical_limit;
mod published;
mod real_objects;
mod sample_trace;
mod scene_map;
mod sensor_model;
mod start_and_steady;
mod transfer;

/// All figures, in the order of the page.
pub(crate) const FIGURES: &[Figure<RunData>] = &[
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
        name: "physical_limit",
        title: "Against the physical limit",
        caption: "Above, the root mean square error over trials and noise seeds, and the least that the readings so far allow \
                  whatever the estimator: the posterior Cramér–Rao bound for the same traces, sensor model and noise, of one \
                  who is told how the contact slides. Below, their ratio: 1 is the physical limit. It is a limit on the average: \
                  with few trials a curve strays about it, and long, since an error lives on in a filter. Hindsight knows the \
                  readings that were still to come, and has no ratio.",
        draw: physical_limit::draw,
    },
    Figure {
        name: "consistency",
        title: "As sure as they may be",
        caption: "Errors and innovations in units of the standard deviations that the filter states, squared, average over trials \
                  and noise seeds. In the band they are consistent (95 % interval of the chi-square distribution over that many \
                  independent runs); above it the filter is overconfident, below it underconfident. Bars: share of the \
                  stated 95 % ellipses that hold the truth, over the whole contact, between 90 and 98 % in the band; the \
                  verdict is that of the average over the whole contact, with each run as one sample.",
        draw: consistency::draw,
    },
    Figure {
        name: "observability",
        title: "When the motion tells where the contact is",
        caption: "One trial a whisker. Left, the path of the base: dark where the readings of the last half second by \
                  themselves tell the contact's place to a fraction of a millimetre, pale where they tell little. Right, the reading; how \
                  much longer than wide the ellipse is in which that half second leaves the contact, the root of the condition \
                  number of its information: large where it tells of one direction only; and the least error that it \
                  allows, beside that of all readings so far and the filter's.",
        draw: observability::draw,
    },
    Figure {
        name: "published",
        title: "Beside the published figures",
        caption: "The filters configured as published (Lin et al. 2022). Left, median error over trials and noise seeds; hollow \
                  markers are read off the published plots: from that time on the error stays below that value. Right, steady \
                  state: dots are root mean square errors of each trial, bars their median, boxes the published range. Sensor, motions \
                  and noise of the publication are not known exactly: compare the picture, not the digits.",
        draw: published::draw,
    },
    Figure {
        name: "contact_events",
        title: "Touches and lost contacts",
        caption: "The first trial in which a contact is lost, as each detector sees it: the reading, the filtered reading \
                  that the detector watches and the thresholds it holds that against, one for a touch and a lower one for \
                  its end. Bars on top: contacts found; ground: true contacts. A released whisker rings, which neither ends nor \
                  begins a contact.",
        draw: contact_events::draw,
    },
    Figure {
        name: "contours",
        title: "Reconstructed contours",
        caption: "The outlines merged from all contacts and strokes of one trial, each with its 95 % band, over the true outline: of the first \
                  filter, of the filter with the smallest contact error and of the best that looks back. Above the panel, contact \
                  error after the first second and mean distance of the outline, medians over trials and noise seeds. Dark: the touched part \
                  of the outline, from its first to its last touched point; a single disc where only a corner was touched. Nothing is \
                  aligned.",
        draw: contours::draw,
    },
    Figure {
        name: "real_objects",
        title: "Objects without a known contact",
        caption: "The outlines merged from single sweeps over objects of which nobody knows where they were touched, each with its 95 % band, for the \
                  first two filters of the run. Where the object's own outline could be placed it is drawn, and the mean distance from it \
                  stands above; of a round object, the radius of the circle through the outline with its 95 % interval and the root mean \
                  square distance from that circle, too. Dots were touched; between them the outline is bridged.",
        draw: real_objects::draw,
    },
    Figure {
        name: "scene_map",
        title: "Map of several whiskers",
        caption: "The scene of a recording from above as the run's first filter maps it from all whiskers, under one noise seed: contact points by array, told apart \
                  by what convex objects can be and not by the truth; the outline of each object found with its 95 % band, often narrower than the line; \
                  and the occupancy grid, free where a whisker was, occupied where it touched, white where nothing was seen. On each object, how far its outline \
                  lies from the true one on the mean and, where the data say that it is round, the circle through it. Nothing is aligned. As data: maps.csv and map_objects.csv.",
        draw: scene_map::draw,
    },
    Figure {
        name: "array_signals",
        title: "Signals of all whiskers",
        caption: "The readings of all whiskers of a recording, with measurement noise, on its common clock. Bars: where the first filter follows a contact; ground: true contacts.",
        draw: array_signals::draw,
    },
    Figure {
        name: "encoder_noise",
        title: "Imperfect proprioception",
        caption: "Errors against the error of the arm's joint encoders, of which estimators know the data sheet. Left, contact error in steady state: the median over the whiskers and \
                  noise seeds of a set, and the mean of that over the sets; right, the contact points of all whiskers from the nearest true outline, mean over the maps. Both in World, \
                  where the base is where the encoders put it. Dashed: perfect encoders. A hollow marker on the upper edge: too often silent for an error there.",
        draw: encoder_noise::draw,
    },
    Figure {
        name: "objects",
        title: "All objects",
        caption: "Above, steady root mean square contact error; below, mean distance of the outline found from the true one. \
                  Medians over trials and noise seeds. Errors lie mostly along the outline, so an \
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
    Figure {
        name: "transfer",
        title: "From the root to counts",
        caption: "Counts of one sensor over the rotation of the whisker's root, without noise and without the earth's \
                  field. Left, its three axes: the magnet turns and swings over the sensor, so that no axis is straight. \
                  Right, the axis that is read, behind amplifiers of several gains: its counts end where their bits do.",
        draw: transfer::draw,
    },
    Figure {
        name: "common_mode",
        title: "The earth's field, and what is left of it",
        caption: "Counts of resting sensors that are turned by half a circle and back, from zero: each (pale), and means of \
                  a fifth of a second. Orange, as read: the earth's field turns in the sensor's axes. Blue, with the common \
                  mode taken out, as it was learnt from the reference sensor at other headings before; of both sensors' \
                  noise that leaves the sum.",
        draw: common_mode::draw,
    },
];
