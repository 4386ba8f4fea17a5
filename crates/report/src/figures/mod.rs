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
        name: "physical_limit",
        title: "Error against the Cramér–Rao bound",
        caption: "Above, RMS contact error over trials and noise seeds, and the posterior Cramér–Rao bound (black): \
                  the smallest RMS error that any estimator can reach from the readings so far, for the same traces, \
                  sensor model and noise, if the sliding of the contact is known. Below, the ratio of the error to the \
                  bound. The bound holds on average: with few trials a curve can temporarily lie below it. Methods \
                  with hindsight also use later readings and have no ratio.",
        draw: physical_limit::draw,
    },
    Figure {
        name: "error_over_time",
        title: "Contact error over time",
        caption: "Distance between estimated and true contact since the first touch: median over trials and noise seeds, at the \
                  times at which at least half of them have an estimate. Above, the whole trial; below, the first second. Errors \
                  above 100 mm, more than the length of a whisker, are not shown.",
        draw: error_over_time::draw,
    },
    Figure {
        name: "start_and_steady",
        title: "Start-up and steady state",
        caption: "RMS contact error of every trial under every noise seed (dots), within the first two seconds of contact and \
                  after them, and the median over all trials (bar), of which those without a score count as the largest: a trial \
                  has none if estimates are missing at more than a tenth of the instants at which one is expected. The dots of \
                  filters and baselines in start-up may refer to different times. Factor: ratio of the error of the better \
                  baseline to that of the method in steady state, at common times.",
        draw: start_and_steady::draw,
    },
    Figure {
        name: "consistency",
        title: "Consistency (NEES, NIS)",
        caption: "Normalised estimation error squared (NEES) and normalised innovation squared (NIS), averages over \
                  trials and noise seeds. Band: 95 % interval of the chi-square distribution for that many independent \
                  runs; above it an estimator is overconfident, below it underconfident. Bars: coverage, the share of \
                  the stated 95 % ellipses that contain the true contact, over the whole contact; band from 90 to 98 \
                  %. The verdict is on NEES and coverage over the whole contact, with intervals that count effective \
                  samples.",
        draw: consistency::draw,
    },
    Figure {
        name: "observability",
        title: "Observability along the motion",
        caption: "One trial per whisker. Left, the path of the base, coloured by the error bound given the readings of \
                  the last half second alone: dark for a fraction of a millimetre, pale for a large one. Right, the \
                  reading; the ratio of the semi-axes of the uncertainty given that half second, which is the root of \
                  the condition number of its information matrix and large if only one direction is observable; and \
                  the error bounds given that half second and given all readings so far, beside the error of the \
                  filter.",
        draw: observability::draw,
    },
    Figure {
        name: "published",
        title: "Comparison with published figures",
        caption: "The filters configured as published (Lin et al. 2022). Left, median error over trials and noise seeds; hollow \
                  markers are read off the published plots: from that time on the error stays below that value. Right, steady \
                  state: RMS errors of each trial (dots), their median (bars) and the published range (boxes). Sensor, motions and \
                  noise of the publication are not known exactly, so that the comparison is qualitative.",
        draw: published::draw,
    },
    Figure {
        name: "contact_events",
        title: "Contact detection",
        caption: "The first trial in which a contact is lost, for each detector: reading, detection signal, and the thresholds for \
                  a touch and, lower, for its end. Bars at the top: contacts detected; shaded: true contacts. The ringing of a \
                  released whisker must neither start nor end a detected contact.",
        draw: contact_events::draw,
    },
    Figure {
        name: "contours",
        title: "Reconstructed outlines",
        caption: "Outlines estimated from all contacts and strokes of one trial per panel, with their 95 % bands, over \
                  the true outline. The trial has the median contact error of the best method drawn. Above each panel: \
                  contact error after the first second and mean distance of the estimated outline from the true one, \
                  medians over trials and noise seeds. Dark: the touched part of the true outline, a single disc if \
                  only a corner was touched. Estimates are not aligned with the truth.",
        draw: contours::draw,
    },
    Figure {
        name: "real_objects",
        title: "Outlines without known contacts",
        caption: "Outlines estimated from single sweeps over objects without known contacts, with their 95 % bands, \
                  for the recommended filter and that for general outlines, or for the first filters of the run. If \
                  the object's own outline could be placed, it is drawn, with the mean distance from it; for a round \
                  object also the radius of the fitted circle with its 95 % interval and the RMS distance from that \
                  circle. Dots: touched points, between which the outline is interpolated.",
        draw: real_objects::draw,
    },
    Figure {
        name: "scene_map",
        title: "Map from several whiskers",
        caption: "Plan view of a recording as mapped by the filter in the title from all whiskers, under one noise \
                  seed: contact points by array, assigned to convex objects without use of the truth; the estimated \
                  outline of each object with its 95 % band, often narrower than the line; and the occupancy grid, \
                  white if unobserved. Points in front of their object's other tangents, and those of very short \
                  touches, are left out of the outlines: at a corner, an estimator extends the face until readings \
                  contradict it. On each object, the mean distance of its outline from the true one and, for a round \
                  object, the fitted circle. Without alignment. As data: maps.csv, whose distances of points include \
                  those left out, and map_objects.csv.",
        draw: scene_map::draw,
    },
    Figure {
        name: "array_signals",
        title: "Signals of all whiskers",
        caption: "Readings of all whiskers of a recording, with measurement noise, on a common clock. Bars: contacts \
                  detected; shaded: true contacts.",
        draw: array_signals::draw,
    },
    Figure {
        name: "encoder_noise",
        title: "Joint encoder noise",
        caption: "Errors as a function of the error of the arm's joint encoders, whose covariance the estimators are \
                  given. Left, contact error in steady state: median over the whiskers and noise seeds of a set, mean \
                  over the sets; right, distance of the contact points of all whiskers from the nearest true outline, \
                  mean over the maps. Both in World, with the base pose according to the encoders. Dashed: perfect \
                  encoders. Hollow marker on the upper edge: no score, because estimates are missing.",
        draw: encoder_noise::draw,
    },
    Figure {
        name: "objects",
        title: "Accuracy by object",
        caption: "Above, RMS contact error in steady state; below, mean distance of the estimated outline from the true one. \
                  Medians over trials and noise seeds. Contact errors lie mostly along the outline, so that the distance of the \
                  outline is smaller.",
        draw: objects::draw,
    },
    Figure {
        name: "sample_trace",
        title: "Example trial",
        caption: "The trial whose median error in steady state is the median of its set: reading with measurement \
                  noise, position and yaw of the base since the start, and contact error of the filter with the \
                  standard deviation that it states. Dashed: first touch.",
        draw: sample_trace::draw,
    },
    Figure {
        name: "sensor_model",
        title: "Sensor model",
        caption: "Left, expected reading over the position of the contact in Base, on the calibrated domain. White lines join \
                  contacts of equal reading, which a single reading cannot distinguish; black: undeflected whisker. Right, \
                  residuals of each calibration trace under the model fitted to the others, relative to the largest reading.",
        draw: sensor_model::draw,
    },
    Figure {
        name: "transfer",
        title: "Sensor characteristic",
        caption: "Counts of one sensor over the rotation of the whisker's root, without noise and without the earth's \
                  field. Left, its three axes, none of which is linear, because the magnet both rotates and translates \
                  over the sensor. Right, the axis of the reading after amplifiers of several gains, saturating at the \
                  ends of the converter's range.",
        draw: transfer::draw,
    },
    Figure {
        name: "common_mode",
        title: "Compensation of the earth's magnetic field",
        caption: "Counts of sensors at rest that are rotated by half a turn and back, relative to the start, with the \
                  shift by half a turn in the title: samples (pale) and means of a fifth of a second. Orange: \
                  uncompensated; the earth's field rotates in the axes of the sensor. Blue: with the common mode \
                  subtracted, which was estimated from the reference sensor at other headings and adds the noise of \
                  that sensor.",
        draw: common_mode::draw,
    },
];
