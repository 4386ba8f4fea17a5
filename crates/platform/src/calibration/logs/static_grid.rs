//! Static readings at known places of the OpenWhisker rig.
//!
//! The whisker is held still during the samples, and movements of the edge are not recorded, so such a log has no presses.

use super::{Layout, three_axes};

pub(super) const LAYOUT: Layout = Layout {
    name: "static-grid",
    about: "static readings of OpenWhisker, header `timestamp,ss.x,ss.y,ss.z,Dist,Bend`: no movement, hence no presses",
    headers: &["timestamp,ss.x,ss.y,ss.z,Dist,Bend"],
    columns: &["timestamp", "ss.x", "ss.y", "ss.z", "Dist", "Bend"],
    parse: three_axes,
};
