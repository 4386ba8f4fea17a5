//! Estimates that are exported with a trace.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{bail, ensure};
use nalgebra as na;
use serde::Serialize;
use serde::de::DeserializeOwned;
use testbed::results::{csv_bytes, read_rows};

use super::read;
use super::rows::time_ns;

/// Contents of an instant by which a trace and its estimates agree.
pub(super) struct Mark {
    /// Time (s).
    pub(super) t_s: f64,
    /// Position of the base (m), 3x1.
    pub(super) base_m: na::Vector3<f64>,
    /// True contact (m), 3x1, if it is known.
    pub(super) contact_m: Option<na::Vector3<f64>>,
}

/// Largest distance between the same points of a trace and of its estimates (m).
const SAME_M: f64 = 1e-9;

/// Estimates of a trace by time (ns), from a table whose instants must be among those of the trace; empty without one.
///
/// Their true contacts must be those of the trace. If the trace states none, the positions of the base must be the same;
/// otherwise they may have the noise of joint encoders.
pub(super) fn estimates_by_time<One: Default + Serialize + DeserializeOwned>(
    path: &Path,
    marks: impl Iterator<Item = Mark>,
    table: Option<&Path>,
    kind: &str,
    mark: impl Fn(&One) -> Mark,
) -> anyhow::Result<BTreeMap<u64, One>> {
    let mut of_time = BTreeMap::new();
    let Some(table) = table else { return Ok(of_time) };
    let known: BTreeMap<u64, Mark> =
        marks.map(|mark| Ok((time_ns(mark.t_s, path)?, mark))).collect::<anyhow::Result<_>>()?;
    let has_truth = known.values().any(|mark| mark.contact_m.is_some());
    for estimate in estimates_of(table, kind)? {
        let found = mark(&estimate);
        let time_ns = time_ns(found.t_s, table)?;
        let (place, t_s) = (table.display(), found.t_s);
        let Some(expected) = known.get(&time_ns) else {
            bail!("{place}: t_s: found {t_s} s, expected a time of {}", path.display());
        };
        let is_same = match (found.contact_m, expected.contact_m) {
            (Some(found_m), Some(expected_m)) => (found_m - expected_m).norm() <= SAME_M,
            (None, None) => has_truth || (found.base_m - expected.base_m).norm() <= SAME_M,
            _ => false,
        };
        let what = if has_truth { "true contact" } else { "position of the base" };
        ensure!(is_same, "{place}: {t_s} s: found another {what}, expected that of {}", path.display());
        ensure!(
            of_time.insert(time_ns, estimate).is_none(),
            "{place}: t_s: found {t_s} s twice, expected each time once"
        );
    }
    Ok(of_time)
}

/// Reads a table of estimates, whose columns must be those of the rows.
fn estimates_of<One: Default + Serialize + DeserializeOwned>(path: &Path, kind: &str) -> anyhow::Result<Vec<One>> {
    let expected = csv_bytes(&[One::default()])?;
    let header = |bytes: &[u8]| bytes.split(|byte| *byte == b'\n').next().map(<[u8]>::to_vec);
    ensure!(
        header(&read(path)?) == header(&expected),
        "{}:1: found other columns than those of the estimates of {kind}, expected a table of `whisker evaluate`",
        path.display()
    );
    read_rows(path)
}
