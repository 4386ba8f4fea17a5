//! `whisker platform cross-validate`: errors of regressions on presses held out.

use std::process::ExitCode;

use platform::calibration::regression::{Fit, REGRESSIONS};
use platform::calibration::{CrossValidation, LabelledPress, cross_validate};

use super::super::table::{millimetres, render};
use super::super::{FINISHED_WITH_FAILURES, diagnose, print};
use super::logs::{LogArguments, Validating, row};

/// Cross-validate regressions and print the errors of held-out presses by log
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    logs: LogArguments,
    /// Regression; may be repeated [default: all]
    #[arg(long)]
    regression: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let rows = if arguments.regression.is_empty() {
        REGRESSIONS.iter().collect()
    } else {
        arguments.regression.iter().map(|name| row(name)).collect::<Result<Vec<_>, _>>()?
    };
    let (mut failed, mut gathered, mut validating) = (false, [None, None], Validating::new());
    for row in rows {
        // The published regression has its own detection of presses; all others share one.
        let detected = &mut gathered[usize::from(matches!(row.fit, Fit::Leaking(_)))];
        let presses = match detected {
            Some(presses) => presses,
            None => detected.insert(arguments.logs.gather(row)?.presses),
        };
        let validated =
            cross_validate(row, presses, arguments.logs.hold_out, &mut |done, all| validating.show(done, all));
        validating.clear();
        match validated {
            Ok(validation) => print(&format!("{}\n{}\n", row.name, scores(presses, &validation)))?,
            Err(error) => {
                diagnose(&format!("error: {error}"));
                failed = true;
            }
        }
    }
    Ok(if failed { ExitCode::from(FINISHED_WITH_FAILURES) } else { ExitCode::SUCCESS })
}

/// Table of errors (mm), one row per log and one for all, and a line per suspicious press.
fn scores(presses: &[LabelledPress], validation: &CrossValidation) -> String {
    let mut logs: Vec<&str> = Vec::new();
    for press in presses {
        if !logs.contains(&press.log.as_str()) {
            logs.push(&press.log);
        }
    }
    let of = |name: &str, which: &dyn Fn(usize) -> bool| {
        let count = (0..presses.len()).filter(|&i| which(i)).count();
        let errors = [validation.rmse_m(which), validation.median_m(which), validation.worst_m(which)];
        [name.into(), count.to_string()].into_iter().chain(errors.map(millimetres)).collect::<Vec<String>>()
    };
    let mut rows: Vec<_> = logs.iter().map(|log| of(log, &|i| presses[i].log == *log)).collect();
    rows.push(of("all", &|_| true));
    let mut text = render(&["log", "presses", "RMSE mm", "median mm", "worst mm"], &rows, 1);
    for (i, held_out) in validation.held_out.iter().enumerate().filter(|(_, held_out)| held_out.is_suspicious()) {
        let [label, estimate] = [presses[i].distance_m, held_out.estimated_m].map(|m| millimetres(Some(m)));
        let score = held_out.score;
        text.push_str(&format!(
            "press {}: labelled {label} mm, estimated {estimate} mm, {score:.1} sd: suspicious\n",
            i + 1
        ));
    }
    text
}
