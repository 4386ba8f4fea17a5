//! Errors of the traces along the sweeps of the standard suite.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::style::{LegendEntry, Look, MUTED, legend, plain};

/// Width of a line.
const LINE_PX: f64 = 1.25;
/// Lower end of the axes of lengths; smaller errors are those of contacts at a corner, at rounding level.
const SMALLEST_MM: f64 = 2e-5;

/// One instant of a sweep.
#[derive(Deserialize)]
struct Instant {
    trace: String,
    t_s: f64,
    moment_error_n_m: f64,
    surface_error_m: f64,
    arc_error_m: f64,
    quasi_static: u8,
}

/// One trace.
#[derive(Deserialize)]
struct Sweep {
    trace: String,
    range_n_m: f64,
}

/// A whisker's sweep over an object: (time, error), NaN at instants that are not quasi-static.
struct Curves {
    look: Look,
    moment_percent: Vec<(f64, f64)>,
    surface_mm: Vec<(f64, f64)>,
    arc_mm: Vec<(f64, f64)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let instants: Vec<Instant> = data.table("sweep_errors")?;
    let sweeps: Vec<Sweep> = data.table("sweeps")?;
    // A trace of a sweep is called after its object and its whisker.
    let parts = |trace: &'_ str| -> (String, String) {
        let (object, whisker) = trace.rsplit_once('_').unwrap_or((trace, ""));
        (object.to_owned(), whisker.to_owned())
    };
    let traces = names(instants.iter().map(|instant| instant.trace.as_str()));
    let pairs: Vec<(String, String)> = traces.iter().map(|trace| parts(trace)).collect();
    let objects = names(pairs.iter().map(|pair| pair.0.as_str()));
    let mut whiskers = names(pairs.iter().map(|pair| pair.1.as_str()));
    // As in every other figure, the straight whisker comes first.
    whiskers.sort_by_key(|whisker| whisker != "straight");
    if traces.is_empty() {
        return Ok(None);
    }
    let panels: Vec<(String, Vec<Curves>)> =
        objects.iter().map(|object| (title_of(object), curves(object, &whiskers, &instants, &sweeps))).collect();
    let bounds = Bounds::read(data)?;
    let all = |series: fn(&Curves) -> &Vec<(f64, f64)>| -> Vec<f64> {
        panels.iter().flat_map(|(_, curves)| curves).flat_map(series).map(|(_, error)| *error).collect()
    };
    let largest = extent(all(|curves| &curves.moment_percent)).map_or(0.0, |(low, high)| high.max(-low));
    let largest = 1.1 * largest.max(bounds.moment_rms);
    let moment = Axis::linear("moment error (% of range)", -largest, largest);
    let distances = all(|curves| &curves.surface_mm).into_iter().chain(all(|curves| &curves.arc_mm));
    let largest_mm = distances.chain([bounds.surface_worst]).fold(0.0, f64::max);
    let surface = Axis::logarithmic("surface contact error (mm)", [SMALLEST_MM, largest_mm]);
    let arc = Axis::logarithmic("arc length error (mm)", [SMALLEST_MM, largest_mm]);

    let paint = move |canvas: &Canvas| {
        let texts: Vec<String> = whiskers.iter().map(|whisker| format!("{whisker} whisker")).collect();
        let entries: Vec<_> = texts
            .iter()
            .enumerate()
            .map(|(index, text)| LegendEntry::line(text, Look::of(index).color, LINE_PX))
            .chain([LegendEntry::dashes("bound", MUTED)])
            .collect();
        legend(canvas, (64.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [72.0, 68.0, 50.0, 48.0]);
        let columns = plot.columns(&equal(panels.len()), 22.0);
        for (column, ((title, curves), frame)) in panels.iter().zip(columns).enumerate() {
            let end_s = curves.iter().flat_map(|curves| &curves.surface_mm).map(|(t_s, _)| *t_s).fold(0.0, f64::max);
            let time = Axis::linear("time (s)", 0.0, end_s);
            let rows = frame.rows(&equal(3), 34.0);
            let axis = |axis: &Axis| if column == 0 { axis.clone() } else { axis.clone().bare() };
            let last = column + 1 == panels.len();
            let moment = Panel::new(canvas, rows[0], title, time.clone().unnamed(), axis(&moment))?;
            let surface = Panel::new(canvas, rows[1], "", time.clone().unnamed(), axis(&surface))?;
            let arc = Panel::new(canvas, rows[2], "", time, axis(&arc))?;
            bounds.paint(&moment, &surface, &arc, last)?;
            // The straight whisker, whose errors are the smoothest, is drawn on top.
            for curves in curves.iter().rev() {
                let rows = [(&moment, &curves.moment_percent), (&surface, &curves.surface_mm), (&arc, &curves.arc_mm)];
                for (panel, errors) in rows {
                    panel.line(errors.iter().copied(), curves.look.color, LINE_PX)?;
                }
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 860, paint)))
}

/// The errors of each whisker's sweep over an object.
fn curves(object: &str, whiskers: &[String], instants: &[Instant], sweeps: &[Sweep]) -> Vec<Curves> {
    let of_object = whiskers.iter().enumerate().map(|(index, whisker)| {
        let trace = format!("{object}_{whisker}");
        let range_n_m = sweeps.iter().find(|sweep| sweep.trace == trace).map_or(f64::NAN, |sweep| sweep.range_n_m);
        let of_trace = || instants.iter().filter(|instant| instant.trace == trace);
        let series = |error: &dyn Fn(&Instant) -> f64| -> Vec<(f64, f64)> {
            of_trace().map(|row| (row.t_s, if row.quasi_static == 1 { error(row) } else { f64::NAN })).collect()
        };
        Curves {
            look: Look::of(index),
            moment_percent: series(&|row| 1e2 * row.moment_error_n_m / range_n_m),
            surface_mm: series(&|row| 1e3 * row.surface_error_m),
            arc_mm: series(&|row| 1e3 * row.arc_error_m.abs()),
        }
    });
    of_object.collect()
}

/// Title of an object.
fn title_of(object: &str) -> String {
    object.strip_prefix("circle_").map_or_else(|| plain(object), |radius_mm| format!("circle, R {radius_mm} mm"))
}

/// Bounds on the errors.
struct Bounds {
    moment_rms: f64,
    surface_rms: f64,
    surface_worst: f64,
    arc_rms: f64,
}

impl Bounds {
    fn read(data: &Data) -> Result<Self> {
        Ok(Self {
            moment_rms: data.bound("trial_moment_rms")?,
            surface_rms: data.bound("trial_surface_rms_m")?,
            surface_worst: data.bound("trial_surface_worst_m")?,
            arc_rms: data.bound("trial_arc_rms_m")?,
        })
    }

    /// Draws the bounds into the panels of an object, with their names in the `last` ones.
    fn paint(&self, moment: &Panel, surface: &Panel, arc: &Panel, last: bool) -> Result<()> {
        let word = |word: &'static str| if last { word } else { "" };
        for bound in [self.moment_rms, -self.moment_rms] {
            moment.level(bound, word("RMS"), MUTED)?;
        }
        surface.level(self.surface_rms, word("RMS"), MUTED)?;
        surface.level(self.surface_worst, word("worst"), MUTED)?;
        arc.level(self.arc_rms, word("RMS"), MUTED)
    }
}
