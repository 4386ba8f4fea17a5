//! The report of the physics study, whose tables `python -m whisker_sim.physics` writes. To add a figure: a file in this folder
//! and a row in [`FIGURES`].

use super::figure::Figure;

mod convergence;
mod data;
mod disturbance;
mod frequencies;
mod page;
mod panels;
mod rig;
mod ringing;
mod speeds;
mod steps;
mod sweeps;
#[cfg(test)]
mod tests;

pub(crate) use data::{Data, is_study};
pub(crate) use page::html;

/// All figures of the physics study, in the order of the page.
pub(crate) const FIGURES: &[Figure<Data>] = &[
    Figure {
        name: "convergence",
        title: "The chain at rest",
        caption: "Error of the chain at rest against the elastica over the number of its segments: root mean square over the \
                  places between two hinges, worst of all objects (pin, circles of 15 and 50 mm, corner) and of both \
                  deflections (2 and 10 mm). The order is the power of the segment's length with which the error falls, \
                  over all cases.",
        draw: convergence::draw,
    },
    Figure {
        name: "sweeps",
        title: "Along the sweeps",
        caption: "Error of the traces of the standard suite against the elastica, at the instants that are quasi-static: \
                  above, the base moment, relative to the largest of the trace; below, the contact on the object's surface and along the whisker. \
                  At a corner the contact on the surface is the corner itself, and its error lies below the picture. \
                  Dashed: bounds.",
        draw: sweeps::draw,
    },
    Figure {
        name: "frequencies",
        title: "Natural frequencies",
        caption: "Error of the chain's first three natural frequencies against those of the beam on its compliant root, over \
                  the number of segments.",
        draw: frequencies::draw,
    },
    Figure {
        name: "ringing",
        title: "Ringing after release",
        caption: "Reading of the straight whisker that was bent and let go: left, as it is; right, its magnitude. Without \
                  damping in the hinges only the integrator's own is left. Dashed: the time after which the ringing of \
                  the published sensor has died, and its noise at rest, scaled to the same start.",
        draw: ringing::draw,
    },
    Figure {
        name: "speeds",
        title: "Dynamic part of the reading",
        caption: "What the reading has beyond the elastica's in a stroke of 10 mm forth and back, over the largest speed of \
                  the base: root mean square, relative to the largest static reading, in the first 0.1 s of the contact and \
                  once it has settled.",
        draw: speeds::draw,
    },
    Figure {
        name: "steps",
        title: "Time step and segments",
        caption: "Largest change of the settled reading when the default of 40 segments and 0.5 ms is changed, relative to its \
                  range, for the same strokes. Dashed: bound for half the time step and for twice the segments.",
        draw: steps::draw,
    },
    Figure {
        name: "disturbance_approach",
        title: "Disturbance, by approach",
        caption: "Largest force on a cylinder that stands free, as the mean over 4 ms, and how far it moves, over the angle \
                  between the undeflected whisker and its motion: 30 mm into the object and back. The cylinder is 30 mm thick and 120 mm \
                  tall; the whisker meets it 80 mm above the table. Left, the whisker slips off; right, its tip rubs \
                  (friction 0.5) and sticks where it is pushed head-on. Displacements under 1 µm are the softness of the \
                  model's contacts.",
        draw: disturbance::by_approach,
    },
    Figure {
        name: "disturbance_sideways",
        title: "Disturbance from the side",
        caption: "The same for the curved whisker that meets the object with its convex side, its root and tip across the \
                  motion, over the diameter of the wire, for roots of four stiffnesses and objects of three masses.",
        draw: disturbance::sideways,
    },
    Figure {
        name: "disturbance_head_on",
        title: "Disturbance head-on",
        caption: "The same for the straight whisker with a tip that rubs, one degree off head-on: it hits like a rod before it \
                  buckles.",
        draw: disturbance::head_on,
    },
    Figure {
        name: "disturbance_speed",
        title: "Disturbance head-on, by speed",
        caption: "The same for the straight and the curved whisker with a tip that rubs, one degree off head-on, over the \
                  speed of the base. A curved wire gives way at once, and its force does not depend on the speed.",
        draw: disturbance::by_speed,
    },
    Figure {
        name: "rig",
        title: "The calibration rig",
        caption: "The printed whisker of the calibration platform under its ruler: above, how far the root turns per push, \
                  over the distance of the contact; below, by how much the simulation misses what it is held against. At rest \
                  the rotation of the whole push counts, against the elastica; while the ruler moves it is the slope between \
                  1 and 6 mm, against the beam's for a small push; the two nearly coincide. Grey: what the root would turn if \
                  only it gave way.",
        draw: rig::draw,
    },
];
