//! The project's own log.

use super::{Layout, three_axes};

pub(super) const LAYOUT: Layout = Layout {
    name: "native",
    about: "the project's own: time and three axes, header `t_s,x_counts,y_counts,z_counts`",
    headers: &["t_s,x_counts,y_counts,z_counts"],
    columns: &["t_s", "x_counts", "y_counts", "z_counts"],
    parse: three_axes,
};
