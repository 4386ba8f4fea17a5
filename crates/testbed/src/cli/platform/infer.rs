//! `whisker platform infer`: distances while samples come in.

use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::ValueEnum;
use platform::calibration::logs::LogReader;
use platform::calibration::{Calibration, Estimate, Live, Press, Said};
use serde_json::json;

use super::super::print;

/// Tell radial contact distances from samples as they come
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Calibration that `whisker platform fit` wrote
    #[arg(long)]
    calibration: PathBuf,
    /// Log of samples, or - for stdin
    log: PathBuf,
    /// How events are printed
    #[arg(long, value_enum, default_value_t = Form::Json)]
    format: Form,
    /// Say on stderr at the end how long it took from a sample to what it told
    #[arg(long)]
    latency: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Form {
    /// One JSON object a line
    Json,
    /// Comma-separated values with a header
    Csv,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let calibration = Calibration::read(&arguments.calibration)?;
    let Some(mut live) = Live::new(&calibration)? else {
        let path = arguments.calibration.display();
        bail!(
            "{path}: chain: found null, expected the chain of a calibration from logs of samples; this one is from a table of presses"
        );
    };
    let mut reader = if arguments.log == Path::new("-") {
        LogReader::new(Path::new("stdin"), BufReader::new(io::stdin()))
    } else {
        LogReader::open(&arguments.log)?
    };
    if arguments.format == Form::Csv {
        print("t_s,event,onset_s,distance_m,low_m,high_m,slope_counts_per_s\n")?;
    }
    let mut latencies = Vec::new();
    for sample in reader.by_ref() {
        let sample = sample?;
        let begin = Instant::now();
        if let Some(said) = live.step(&sample) {
            print(&line(&said, arguments.format))?;
        }
        if arguments.latency {
            latencies.push(begin.elapsed());
        }
    }
    if reader.cut_off() {
        eprintln!("{}: its last line was cut off and is left out", arguments.log.display());
    }
    if arguments.latency {
        eprintln!("{}", summary(latencies));
    }
    Ok(ExitCode::SUCCESS)
}

fn line(said: &Said, format: Form) -> String {
    match (said, format) {
        (Said::Pressed(press, estimate), Form::Json) => {
            let Press { t_s, onset_s, features, .. } = press;
            let (distance_m, interval_m) = (estimate.map(|e| e.distance_m), estimate.and_then(|e| e.interval_m));
            let event = json!({
                "t_s": t_s, "event": "pressed", "onset_s": onset_s, "distance_m": distance_m, "interval_m": interval_m,
                "features": features,
            });
            format!("{event}\n")
        }
        (Said::Pressed(press, estimate), Form::Csv) => {
            let cell = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.6}"));
            let interval_m = estimate.and_then(|Estimate { interval_m, .. }| interval_m);
            format!(
                "{:.6},pressed,{:.6},{},{},{},{:.3}\n",
                press.t_s,
                press.onset_s,
                cell(estimate.map(|estimate| estimate.distance_m)),
                cell(interval_m.map(|[low, _]| low)),
                cell(interval_m.map(|[_, high]| high)),
                press.features.slope_counts_per_s,
            )
        }
        (Said::Released(t_s), Form::Json) => format!("{}\n", json!({"t_s": t_s, "event": "released"})),
        (Said::Released(t_s), Form::Csv) => format!("{t_s:.6},released,,,,,\n"),
    }
}

/// Median, 99th percentile and worst, in milliseconds.
fn summary(mut latencies: Vec<Duration>) -> String {
    if latencies.is_empty() {
        return "no samples".into();
    }
    latencies.sort();
    let at = |share: f64| 1e3 * latencies[((latencies.len() - 1) as f64 * share).round() as usize].as_secs_f64();
    format!("{} samples: median {:.4}, 99 % {:.4}, worst {:.4} ms", latencies.len(), at(0.5), at(0.99), at(1.0))
}
