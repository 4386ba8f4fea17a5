//! Panels of errors that decrease with the number of segments.

use anyhow::Result;

use crate::axes::Panel;
use crate::canvas::{Canvas, Px};
use crate::style::{CURVE_PX, INK, LegendEntry, Look, MUTED, legend};

/// Segments of the default chain, for which the bounds hold.
const DEFAULT_SEGMENTS: f64 = 40.0;
/// The stroke of a bound reaches from this share of the default to its inverse.
const BOUND_REACH: f64 = 0.75;

/// The guide starts at this share of the first line's error, so that they do not coincide.
const GUIDE_SHARE: f64 = 0.6;

/// Errors over the number of segments, in the order of the looks.
pub(crate) type Lines = Vec<Vec<(f64, f64)>>;

/// The legend of such panels.
pub(crate) fn falling_legend(canvas: &Canvas, at: Px, names: &[String]) -> Result<()> {
    let curves = names.iter().enumerate().map(|(index, name)| LegendEntry::curve(name, Look::of(index)));
    let entries: Vec<_> = curves
        .chain([LegendEntry::dashes("second order", MUTED), LegendEntry::line("bound at 40 segments", INK, CURVE_PX)])
        .collect();
    legend(canvas, at, &entries)?;
    Ok(())
}

/// The errors, a guide of second order below the first line's start, and the bound for the default chain.
pub(crate) fn falling_errors(panel: &Panel, lines: &Lines, bound: Option<f64>) -> Result<()> {
    if let [Some(&(first, error)), Some(&(last, _))] = [lines[0].first(), lines[0].last()] {
        let guide = GUIDE_SHARE * error;
        panel.dashes((first, guide), (last, guide * (first / last).powi(2)), MUTED)?;
    }
    if let Some(bound) = bound {
        let ends = [BOUND_REACH, 1.0 / BOUND_REACH].map(|share| (share * DEFAULT_SEGMENTS, bound));
        panel.line(ends, INK, CURVE_PX)?;
    }
    for (index, line) in lines.iter().enumerate() {
        panel.line(line.iter().copied(), Look::of(index).color, CURVE_PX)?;
        panel.marks(line, Look::of(index), true)?;
    }
    Ok(())
}
