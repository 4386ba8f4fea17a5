//! `whisker mount`: the mounting of a sensor in space, learnt from touches at known places.

use std::path::PathBuf;
use std::process::ExitCode;

use evaluation::space::mount::mount;
use nalgebra::Vector3;

use super::output::reserve;
use super::played::check_trace;
use super::{print, table};

/// Learn how a sensor in space is mounted, relative to its calibration, from touches at known places
///
/// Writes the calibration with the deviation of the mounting, for which all estimators then correct, and prints the deviation with
/// its standard deviations. The traces contain the contacts in the columns truth_contact_x_m, _y_m and _z_m.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Traces in space with touches at known places (.csv, the sidecar of each beside it)
    #[arg(required = true)]
    traces: Vec<PathBuf>,
    /// Calibration in space of the whisker
    #[arg(long)]
    calibration: PathBuf,
    /// Calibration to write
    #[arg(long)]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { traces, calibration, out } = arguments;
    traces.iter().try_for_each(|trace| check_trace(trace))?;
    let inputs: Vec<PathBuf> = traces.iter().chain([calibration]).cloned().collect();
    let _lock = reserve(out, &inputs)?;
    let learnt = mount(calibration, traces, out)?;
    let sds = learnt.covariance.diagonal().map(f64::sqrt);
    let row = |what: &str, unit: &str, value: Vector3<f64>, sd: Vector3<f64>| {
        let cells = value.iter().zip(&sd).map(|(value, sd)| format!("{value:.3} +- {sd:.3}"));
        [format!("{what}, {unit}")].into_iter().chain(cells).collect::<Vec<_>>()
    };
    let rows = [
        row("translation", "mm", learnt.shift_m * 1e3, sds.fixed_rows::<3>(0) * 1e3),
        row("rotation", "deg", learnt.turn_rad.map(f64::to_degrees), sds.fixed_rows::<3>(3).map(f64::to_degrees)),
    ];
    print(&table::render(&["deviation", "x", "y", "z"], &rows, 1))?;
    print(&format!("{}\n", out.display()))?;
    Ok(ExitCode::SUCCESS)
}
