//! Reading of a whisker after its release.

use anyhow::{Context, Result};
use serde::Deserialize;

use super::data::Data;
use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::style::{CURVE_PX, INK, LegendEntry, Look, MUTED, legend};

/// Points of an exponential.
const DECAY_POINTS: u32 = 200;
/// Lower end of the logarithmic axis, as a share of the noise.
const SMALLEST_SHARE: f64 = 0.4;

/// One release.
#[derive(Deserialize)]
struct Release {
    case: String,
    damping_ratio: f64,
    amplitude_n_m: f64,
    decay_s: f64,
    published_dying_s: f64,
    published_fall: f64,
}

/// One instant of the ringing.
#[derive(Deserialize)]
struct Instant {
    case: String,
    t_s: f64,
    moment_n_m: f64,
}

/// A release with its reading: time in seconds, micronewton metres.
struct Ringing {
    release: Release,
    look: Look,
    reading: Vec<(f64, f64)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let releases: Vec<Release> = data.table("ringing")?;
    let instants: Vec<Instant> = data.table("ringing_signal")?;
    let ringings: Vec<Ringing> = releases
        .into_iter()
        .enumerate()
        .map(|(index, release)| {
            let of_release = instants.iter().filter(|instant| instant.case == release.case);
            let reading = of_release.map(|instant| (instant.t_s, 1e6 * instant.moment_n_m)).collect();
            Ringing { release, look: Look::of(index), reading }
        })
        .filter(|ringing: &Ringing| !ringing.reading.is_empty())
        .collect();
    let Some(first) = ringings.first() else {
        return Ok(None);
    };
    let all = || ringings.iter().flat_map(|ringing| &ringing.reading);
    let (_, end_s) = extent(all().map(|(t_s, _)| *t_s)).context("ringing_signal.csv: found no time")?;
    let noise = 1e6 * first.release.amplitude_n_m / first.release.published_fall;
    let dying_s = first.release.published_dying_s;
    let largest = all().map(|(_, reading)| reading.abs()).fold(noise, f64::max);
    let reading = Axis::around("reading (µN·m)", all().map(|(_, reading)| *reading));
    let magnitude = Axis::logarithmic("magnitude of the reading (µN·m)", [SMALLEST_SHARE * noise, largest]);
    let names: Vec<String> = ringings
        .iter()
        .map(|Ringing { release, .. }| format!("{}, damping ratio {:.3}", release.case, release.damping_ratio))
        .collect();

    let paint = move |canvas: &Canvas| {
        let curves =
            names.iter().zip(&ringings).map(|(name, ringing)| LegendEntry::line(name, ringing.look.color, CURVE_PX));
        let entries: Vec<_> = curves
            .chain([
                LegendEntry::line("exponential through the extremes", MUTED, CURVE_PX),
                LegendEntry::dashes("published: decay time, noise", INK),
            ])
            .collect();
        legend(canvas, (16.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [64.0, 46.0, 12.0, 48.0]).columns(&equal(2), 84.0);
        let time = Axis::linear("time since the release (s)", 0.0, end_s);
        let left = Panel::new(canvas, frames[0], "", time.clone(), reading.clone())?;
        let right = Panel::new(canvas, frames[1], "", time, magnitude.clone())?;
        // The first one, which rings as the traces do, is drawn on top.
        for ringing in ringings.iter().rev() {
            left.line(ringing.reading.iter().copied(), ringing.look.color, CURVE_PX)?;
            right.line(
                ringing.reading.iter().map(|(t_s, reading)| (*t_s, reading.abs())),
                ringing.look.color,
                CURVE_PX,
            )?;
        }
        for ringing in &ringings {
            left.line(ringing.release.decay(1.0, end_s), MUTED, CURVE_PX)?;
            left.line(ringing.release.decay(-1.0, end_s), MUTED, CURVE_PX)?;
            right.line(ringing.release.decay(1.0, end_s), MUTED, CURVE_PX)?;
        }
        right.level(noise, "", INK)?;
        left.instant(dying_s, INK)?;
        right.instant(dying_s, INK)
    };
    Ok(Some(Picture::new(1200, 430, paint)))
}

impl Release {
    /// The exponential through the extremes on one side, in micronewton metres.
    fn decay(&self, side: f64, end_s: f64) -> impl Iterator<Item = (f64, f64)> {
        (0..=DECAY_POINTS).map(move |step| {
            let t_s = end_s * f64::from(step) / f64::from(DECAY_POINTS);
            (t_s, side * 1e6 * self.amplitude_n_m * (-t_s / self.decay_s).exp())
        })
    }
}
