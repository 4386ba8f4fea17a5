//! `whisker mount`: the mounting of a sensor in space, learnt from touches at known places.

use std::path::PathBuf;
use std::process::ExitCode;

use evaluation::space::mount::{Mounted, mount};
use nalgebra::Vector3;
use whisker::space::sensor::{FittedTouch, Mounting, MountingFit};

use super::output::reserve;
use super::played::check_trace;
use super::{print, table};

/// Deviation in its standard deviations, and residual in expected ones, above which a note is printed.
const UNEXPECTED: f64 = 2.0;

/// Learn how a sensor in space is mounted, relative to its calibration, from touches at known places
///
/// Writes the calibration with the deviation of the mounting, for which all estimators then correct, in place of an earlier
/// mounting. Prints the deviation with its standard deviations and, for each touch, the root mean square residual of the readings
/// before and after the correction, relative to the largest reading of the calibration, and the residual with the mounting by the
/// other touches, relative to the expected one (disagreement). Refuses touches that contradict one another. The traces contain the
/// contacts in the columns truth_contact_x_m, _y_m and _z_m.
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
    let Mounted { learnt, trace_of_touch, largest_reading_n_m, expected_residual_n_m, replaced } =
        mount(calibration, traces, out)?;
    let MountingFit { mounting, touches } = learnt;
    let sds = mounting.covariance.diagonal().map(f64::sqrt);
    let row = |what: &str, unit: &str, value: Vector3<f64>, sd: Vector3<f64>| {
        let cells = value.iter().zip(&sd).map(|(value, sd)| format!("{value:.3} +- {sd:.3}"));
        [format!("{what}, {unit}")].into_iter().chain(cells).collect::<Vec<_>>()
    };
    let rows = [
        row("translation", "mm", mounting.shift_m * 1e3, sds.fixed_rows::<3>(0) * 1e3),
        row("rotation", "deg", mounting.turn_rad.map(f64::to_degrees), sds.fixed_rows::<3>(3).map(f64::to_degrees)),
    ];
    print(&table::render(&["deviation", "x", "y", "z"], &rows, 1))?;
    let of_touch = |(touch, trace): (&FittedTouch, &String)| {
        let share = |residual_n_m: f64| format!("{:.2} %", 100.0 * residual_n_m / largest_reading_n_m);
        let [before, after] = touch.residuals_n_m.map_or_else(|| ["-", "-"].map(String::from), |both| both.map(share));
        let disagreement = touch.disagreement.map_or_else(|| "-".into(), |found| format!("{found:.1}"));
        vec![trace.clone(), touch.used.to_string(), touch.contacts.to_string(), before, after, disagreement]
    };
    let of_touches: Vec<_> = touches.iter().zip(&trace_of_touch).map(of_touch).collect();
    let header = ["touch", "contacts used", "of", "residual before", "after", "disagreement"];
    print(&table::render(&header, &of_touches, 1))?;
    if mounting.size() > UNEXPECTED {
        eprintln!(
            "the mounting deviates by {:.1} times the standard deviations that are expected of a remounted sensor ({} mm and {:.1} \
            degrees): a known place, a unit or a frame may be wrong",
            mounting.size(),
            1e3 * Mounting::SHIFT_SD_M,
            Mounting::TURN_SD_RAD.to_degrees()
        );
    }
    for (touch, trace) in touches.iter().zip(&trace_of_touch) {
        let ratio = touch.residuals_n_m.map_or(0.0, |[_, after_n_m]| after_n_m / expected_residual_n_m);
        if ratio > UNEXPECTED {
            eprintln!(
                "{trace}: the residual after the correction is {ratio:.1} times the one expected from the sensor model and the \
                noise: the known place of this touch may be wrong, and the mounting less certain than stated"
            );
        }
    }
    if !replaced.is_empty() {
        eprintln!("replaced: the mounting learnt from {}", replaced.join(", "));
    }
    print(&format!("{}\n", out.display()))?;
    Ok(ExitCode::SUCCESS)
}
