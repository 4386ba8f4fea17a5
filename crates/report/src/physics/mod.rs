//! The report of the physics study, whose tables `python -m whisker_sim.physics` writes. To add a figure: a file in this folder
//! and a row in [`FIGURES`].

use super::figure::Figure;

mod convergence;
mod data;
mod disturbance;
mod frequencies;
mod friction;
mod page;
mod panels;
mod rig;
mod ringing;
mod space;
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
        title: "Convergence at rest",
        caption: "Error of the chain at rest relative to the elastica as a function of the number of its segments: \
                  root mean square over the places between two hinges, worst of all objects (pin, circles of 15 and 50 \
                  mm, corner) and of both deflections (2 and 10 mm). The order is the power of the segment length with \
                  which the error decreases, over all cases.",
        draw: convergence::draw,
    },
    Figure {
        name: "sweeps",
        title: "Errors along the sweeps",
        caption: "Error of the traces of the standard suite against the elastica, at the instants that are \
                  quasi-static: above, the base moment, relative to the largest of the trace; below, the contact on \
                  the object's surface and along the whisker. At a corner the contact on the surface is the corner \
                  itself, and its error lies below the axis. Dashed: bounds.",
        draw: sweeps::draw,
    },
    Figure {
        name: "frequencies",
        title: "Natural frequencies",
        caption: "Error of the chain's first three natural frequencies relative to those of the beam on its compliant root, as a \
                  function of the number of segments.",
        draw: frequencies::draw,
    },
    Figure {
        name: "ringing",
        title: "Ringing after release",
        caption: "Reading of the straight whisker after release from a deflection: left, the signal; right, its magnitude. Without \
                  damping in the hinges only the numerical damping of the integrator remains. Dashed: decay time of the \
                  published sensor and its noise at rest, scaled to the same initial amplitude.",
        draw: ringing::draw,
    },
    Figure {
        name: "speeds",
        title: "Dynamic part of the reading",
        caption: "Difference of the reading from that of the elastica in a stroke of 10 mm forwards and back, as a \
                  function of the largest speed of the base: RMS, relative to the largest static reading, in the first \
                  0.1 s of the contact and after it has settled.",
        draw: speeds::draw,
    },
    Figure {
        name: "steps",
        title: "Time step and number of segments",
        caption: "Largest change of the settled reading when the default of 40 segments and 0.5 ms is changed, relative to its \
                  range, for the same strokes. Dashed: bound for half the time step and for twice the segments.",
        draw: steps::draw,
    },
    Figure {
        name: "disturbance_approach",
        title: "Disturbance by angle of approach",
        caption: "Largest force on a free-standing cylinder, averaged over 4 ms, and its displacement, as functions of \
                  the angle between the undeflected whisker and its motion: 30 mm into the object and back. The \
                  cylinder is 30 mm thick and 120 mm tall; the whisker meets it 80 mm above the table. Left, \
                  frictionless tip: the whisker slips off; right, tip with friction 0.5, which sticks in head-on \
                  contact. Displacements under 1 µm are due to the compliance of the contact model.",
        draw: disturbance::by_approach,
    },
    Figure {
        name: "disturbance_sideways",
        title: "Disturbance in lateral contact",
        caption: "Peak force and displacement for the curved whisker with its convex side towards the object, with the \
                  line from root to tip perpendicular to the motion, as functions of the diameter of the wire, for \
                  four root stiffnesses and three object masses.",
        draw: disturbance::sideways,
    },
    Figure {
        name: "disturbance_head_on",
        title: "Disturbance in head-on contact",
        caption: "Peak force and displacement for the straight whisker with friction at the tip, one degree off \
                  head-on: it acts like a rigid rod until it buckles.",
        draw: disturbance::head_on,
    },
    Figure {
        name: "disturbance_speed",
        title: "Disturbance by speed",
        caption: "Peak force and displacement for the straight and the curved whisker with friction at the tip, one \
                  degree off head-on, as functions of the speed of the base. A curved wire yields at once, and its \
                  force does not depend on the speed.",
        draw: disturbance::by_speed,
    },
    Figure {
        name: "rig",
        title: "Calibration rig",
        caption: "The printed whisker of the calibration platform under its ruler: above, root rotation per push as a \
                  function of the distance of the contact; below, relative deviation of the simulation from theory. At \
                  rest, the rotation of the whole push is compared with the elastica; while the ruler moves, the slope \
                  between 1 and 6 mm with that of the linear beam. The two nearly coincide. Grey: rotation with a \
                  rigid shaft.",
        draw: rig::draw,
    },
    Figure {
        name: "friction",
        title: "Hysteresis by friction",
        caption: "Moment at the root less that of the frictionless contact at the same pose of the base, relative to \
                  the largest moment: while the whisker is pressed against the object and released (above), and while \
                  it is moved lengthwise between, first towards the tip (middle). Below, angle of the force to the \
                  normal, positive if the friction on the whisker is towards its tip. Simulation and quasi-static \
                  solution with stick and slip.",
        draw: friction::draw,
    },
    Figure {
        name: "space_chain",
        title: "Convergence of the chain in space",
        caption: "Error of the chain at rest relative to the Kirchhoff rod, RMS over 100 loads in all directions, as a \
                  function of the number of its segments. Grey: the same chains with one order of the joints at every \
                  hinge, which converge with the first order only.",
        draw: space::chain,
    },
    Figure {
        name: "space_scenes",
        title: "Convergence of scenes in space",
        caption: "Change of the reading, RMS over the settled contact and relative to its largest value, if the number \
                  of segments is doubled (left) or the time step is halved (right), as functions of the coarser \
                  value.",
        draw: space::scenes,
    },
    Figure {
        name: "space_suite",
        title: "Errors of the suite in space",
        caption: "Deviation of every trace of the suite of scenes in space from the Kirchhoff rod at quasi-static \
                  instants, RMS: worst component of the base moment, contact on the surface, and normal.",
        draw: space::suite,
    },
];
