//! Estimation of the [`Chain`] from unlabelled recordings: sampling rate, moving axes, noise at rest and threshold of a press.

use signal::LONGEST_GAP_S;

use super::front::{Front, MOST_ORDER, MOST_RATE_HZ, MOST_SAMPLES};
use super::rate::hint;
use super::{Chain, Error, Intervals, Rate, is_same_rate};
use crate::Sample;

/// Standard deviation of a normal variable over its median absolute deviation.
pub(super) const SD_OVER_MAD: f64 = 1.4826;

/// Quantile of the absolute slope by which axes are compared: presses take more than the remaining share of the time.
const STEEP_QUANTILE: f64 = 0.999;

/// Smallest ratio between the weakest push and the strongest shake; below it there are no shakes.
const GAP: f64 = 3.0;

/// Smallest share of pushes among all bursts.
const PUSHES_SHARE: f64 = 0.2;

/// Ratio of the threshold to the strongest shake.
const ABOVE_SHAKES: f64 = 1.5;

/// Option that states the edge of the low-pass.
pub(super) const CUTOFF: &str = "--cutoff-hz";

/// Settings of the detection of presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Order of the low-pass.
    pub order: usize,
    /// Edge of the low-pass (Hz).
    pub cutoff_hz: f64,
    /// Smallest slope of a movement, in standard deviations at rest.
    pub noise_sds: f64,
    /// Duration without movement after which a whisker is at rest (s).
    pub quiet_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { order: 2, cutoff_hz: 10.0, noise_sds: 8.0, quiet_s: 0.1 }
    }
}

impl Settings {
    fn validate(&self) -> Result<(), Error> {
        let within = |key, found: f64, low: f64, high: f64| {
            if (low..=high).contains(&found) {
                return Ok(());
            }
            Err(Error::Setting { key, found, expected: format!("{low} to {high}") })
        };
        if !(self.cutoff_hz > 0.0 && self.cutoff_hz.is_finite()) {
            return Err(Error::Setting { key: CUTOFF, found: self.cutoff_hz, expected: "a frequency above 0".into() });
        }
        within("order", self.order as f64, 1.0, MOST_ORDER as f64)?;
        within("noise_sds", self.noise_sds, 1.0, 1e3)?;
        within("quiet_s", self.quiet_s, 1e-3, 10.0)
    }
}

/// Estimates the chain from recordings, each with its name.
///
/// The noise of the slope is estimated from its median absolute value, since the whisker rests, or is held still, most
/// of the time. Movements come in bursts. If the strengths of the bursts form two groups with a wide gap, the weaker
/// group are shakes, such as those of a starting stage, and the threshold is above them; otherwise it is above the
/// noise.
///
/// # Errors
/// If a setting is out of range, or the recordings are too short or differ in rate.
///
/// # Panics
/// If there are no recordings.
pub fn learn(logs: &[(&str, &[Sample])], settings: &Settings) -> Result<Chain, Error> {
    settings.validate()?;
    let rate_hz = common_rate_hz(logs, settings.cutoff_hz)?;
    let least_hz = rate_hz / MOST_SAMPLES;
    if settings.cutoff_hz < least_hz {
        let expected = format!("at least {least_hz:.3}, 1/{MOST_SAMPLES} of the sampling rate");
        return Err(Error::Setting { key: CUTOFF, found: settings.cutoff_hz, expected });
    }
    let mut moved = Vec::with_capacity(logs.len());
    for (_, log) in logs {
        let mut front = Front::new(settings.order, settings.cutoff_hz, rate_hz)?;
        moved.push(
            log.iter().map(|sample| front.step(sample).axes.map(|axis| axis.slope_counts_per_s)).collect::<Vec<_>>(),
        );
    }
    let steepness = [0, 1, 2].map(|axis| {
        let of_log =
            |slopes: &Vec<[f64; 3]>| quantile(slopes.iter().map(|slope| slope[axis].abs()).collect(), STEEP_QUANTILE);
        moved.iter().map(of_log).fold(0.0, f64::max)
    });
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| steepness[b].total_cmp(&steepness[a]));
    let [main_axis, second_axis, _] = axes;

    let slopes: Vec<Vec<f64>> =
        moved.iter().map(|log| log.iter().map(|slope| slope[main_axis].abs()).collect()).collect();
    let measured = SD_OVER_MAD * quantile(slopes.iter().flatten().copied().collect(), 0.5);
    // A constant reading has no noise. A step of one count gives a slope of at most about 2 pi times the edge.
    let noise_counts_per_s = measured.max(2.0 * std::f64::consts::PI * settings.cutoff_hz / settings.noise_sds);
    let moves = settings.noise_sds * noise_counts_per_s;
    let quiet_samples = (settings.quiet_s * rate_hz).round().max(1.0) as usize;
    let strengths = slopes.iter().flat_map(|log| bursts(log, moves, quiet_samples)).collect();
    let threshold_counts_per_s = strongest_shake(strengths).map_or(moves, |shake| moves.max(ABOVE_SHAKES * shake));
    Ok(Chain {
        rate_hz,
        order: settings.order,
        cutoff_hz: settings.cutoff_hz,
        main_axis,
        second_axis,
        noise_counts_per_s,
        threshold_counts_per_s,
        quiet_s: settings.quiet_s,
    })
}

fn common_rate_hz(logs: &[(&str, &[Sample])], cutoff_hz: f64) -> Result<f64, Error> {
    const FEWEST: usize = 100;
    if let Some((name, log)) = logs.iter().find(|(_, log)| log.len() < FEWEST) {
        return Err(Error::Short { log: (*name).into(), found: log.len(), expected: FEWEST });
    }
    let expected_s = 0.5 / cutoff_hz;
    for (name, log) in logs {
        let mut intervals = Intervals::default();
        for sample in *log {
            intervals.step(sample.t_s);
        }
        if let Some(interval_s) = intervals.mean_s().filter(|interval_s| *interval_s > expected_s) {
            // A rate that suffices for the default is not due to another unit of the times.
            if cutoff_hz > Settings::default().cutoff_hz && interval_s <= 0.5 / Settings::default().cutoff_hz {
                let expected = format!("below {:.1}, half the sampling rate of {name}", 0.5 / interval_s);
                return Err(Error::Setting { key: CUTOFF, found: cutoff_hz, expected });
            }
            // Magnetometers have rates about 800 Hz.
            return Err(Error::Slow { log: (*name).into(), interval_s, expected_s, hint: hint(800.0 * interval_s) });
        }
    }
    let rate_hz = |log: &[Sample]| {
        let mut rate = Rate::default();
        log.iter().for_each(|sample| rate.step(sample.t_s));
        rate.hz()
    };
    let rates: Vec<f64> = logs.iter().map(|(_, log)| rate_hz(log)).collect();
    if let Some(i) = rates.iter().position(|rate| !rate.is_finite()) {
        let found = match rates[i].is_nan() {
            true => format!("no sample at most {LONGEST_GAP_S} s after the one before"),
            false => "all times equal".into(),
        };
        return Err(Error::Times { log: logs[i].0.into(), found });
    }
    if let Some(i) = rates.iter().position(|rate| *rate > MOST_RATE_HZ) {
        return Err(Error::Fast { log: logs[i].0.into(), found_hz: rates[i], most_hz: MOST_RATE_HZ });
    }
    let median = quantile(rates.clone(), 0.5);
    match rates.iter().position(|rate| !is_same_rate(*rate, median)) {
        Some(i) => Err(Error::Rate { log: logs[i].0.into(), found_hz: rates[i], expected_hz: median }),
        None => Ok(median),
    }
}

/// Steepest slope of each burst of movement. Bursts are separated by `quiet_samples` without movement.
fn bursts(slopes: &[f64], moves: f64, quiet_samples: usize) -> Vec<f64> {
    let mut strengths: Vec<f64> = Vec::new();
    let mut quiet = quiet_samples;
    for &slope in slopes {
        if slope <= moves {
            quiet += 1;
            continue;
        }
        match strengths.last_mut().filter(|_| quiet < quiet_samples) {
            Some(strongest) => *strongest = strongest.max(slope),
            None => strengths.push(slope),
        }
        quiet = 0;
    }
    strengths
}

/// Strongest shake: the strength below the widest gap. `None` if there are no shakes.
fn strongest_shake(mut strengths: Vec<f64>) -> Option<f64> {
    strengths.sort_by(f64::total_cmp);
    let fewest_pushes = (PUSHES_SHARE * strengths.len() as f64).ceil() as usize;
    let gaps = strengths.windows(2).enumerate().filter(|(i, _)| strengths.len() - (i + 1) >= fewest_pushes);
    let (_, widest) = gaps.max_by(|(_, a), (_, b)| (a[1] / a[0]).total_cmp(&(b[1] / b[0])))?;
    (widest[1] / widest[0] >= GAP).then_some(widest[0])
}

/// Empirical quantile at this share, without interpolation.
///
/// # Panics
/// If there are no values.
pub(super) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    let place = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}
