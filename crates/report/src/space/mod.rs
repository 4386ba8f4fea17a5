//! The report of a run in space. To add a figure: a function that lays it out and a row in [`FIGURES`].

use super::figure::Figure;

mod data;
mod page;
mod replay;
mod scores;
mod surfaces;
#[cfg(test)]
mod tests;

pub(crate) use data::Data;
pub(crate) use page::html;

/// All figures of a run in space, in the order of the page.
pub(crate) const FIGURES: &[Figure<Data>] = &[
    Figure {
        name: "space_errors",
        title: "Error of the contact",
        caption: "Root mean square error of the contact over the trials of each group, from one second after the touch, and the \
                  posterior Cramér–Rao bound, which takes the sliding of the contact as known.",
        draw: scores::errors,
    },
    Figure {
        name: "space_surfaces",
        title: "Distance of the surface",
        caption: "Mean distance of the estimated points of the surface from the true solid, inside or outside, from one second \
                  after the touch. It says nothing about the place along the surface, which the error of the contact includes.",
        draw: scores::surfaces,
    },
    Figure {
        name: "space_maps",
        title: "Estimated surfaces",
        caption: "In each group, the surface of the largest area, estimated from all sweeps over the solid with the first seed and \
                  viewed along the mean normal. Colour: distance from the true solid. Grey: the true solid. The mesh covers the part \
                  where the standard deviation along the normal is at most 1 mm. Solids given as meshes are not shown.",
        draw: surfaces::draw,
    },
    Figure {
        name: "space_coverage",
        title: "Coverage",
        caption: "Share of the instants from one second after the touch at which the 95 % ellipsoid of the estimate contains the \
                  true contact.",
        draw: scores::coverage,
    },
    Figure {
        name: "space_normals",
        title: "Error of the normal",
        caption: "Root mean square angle between the estimated and the true normal of the surface, from one second after the \
                  touch.",
        draw: scores::normals,
    },
    Figure {
        name: "space_directions",
        title: "Error of the direction",
        caption: "Root mean square angle between the estimated and the true direction of the edge or rod, where the touched \
                  points of a trial lie on a straight line and the method estimates a direction.",
        draw: scores::directions,
    },
];
