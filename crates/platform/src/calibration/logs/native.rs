//! The project's own log.

use super::{Layout, counts, seconds};
use crate::Sample;

pub(super) const LAYOUT: Layout = Layout {
    name: "native",
    about: "the project's own: time and three axes, header `t_s,x_counts,y_counts,z_counts`",
    headers: &["t_s,x_counts,y_counts,z_counts"],
    columns: &["t_s", "x_counts", "y_counts", "z_counts"],
    parse,
};

fn parse(fields: &[&str]) -> Result<Sample, (usize, &'static str)> {
    let counts = [counts(fields, 1)?, counts(fields, 2)?, counts(fields, 3)?];
    Ok(Sample { t_s: seconds(fields, 0)?, counts })
}
