//! How far a push at some distance turns the root of the calibration rig's whisker.

use anyhow::Result;
use serde::Deserialize;

use super::data::Data;
use crate::report::axes::{Axis, Panel, Rect, equal};
use crate::report::canvas::{Canvas, Picture};
use crate::report::style::{CURVE_PX, LegendEntry, Look, MUTED, legend};

/// One place of the routine.
#[derive(Deserialize)]
struct Row {
    distance_m: f64,
    slope_rad_m: f64,
    beam_rad_m: f64,
    rigid_rad_m: f64,
}

/// Lays the figure out.
pub(super) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("rig")?;
    if rows.is_empty() {
        return Ok(None);
    }
    // A radian a metre is a milliradian a millimetre.
    let over_distance = |value: fn(&Row) -> f64| -> Vec<(f64, f64)> {
        rows.iter().map(|row| (1e3 * row.distance_m, value(row))).collect()
    };
    let slopes = [
        over_distance(|row| row.slope_rad_m),
        over_distance(|row| row.beam_rad_m),
        over_distance(|row| row.rigid_rad_m),
    ];
    let shares = [
        over_distance(|row| row.slope_rad_m / row.rigid_rad_m),
        over_distance(|row| row.beam_rad_m / row.rigid_rad_m),
        over_distance(|_| 1.0),
    ];
    let distance = Axis::around("distance from the root (mm)", slopes[0].iter().map(|(distance_mm, _)| *distance_mm));
    let slope =
        Axis::around("rotation per push (mrad/mm)", slopes.iter().flatten().map(|(_, slope)| *slope).chain([0.0]));
    let share = Axis::linear("share of the push that the gel takes", 0.0, 1.05);

    let paint = move |canvas: &Canvas| {
        let look = Look::of(0);
        let entries = [
            LegendEntry::marker("MuJoCo, while the ruler moves", look, true),
            LegendEntry::line("beam on a hinge, small push", look.color, CURVE_PX),
            LegendEntry::line("rigid shaft on a hinge", MUTED, CURVE_PX),
        ];
        legend(canvas, (64.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [64.0, 46.0, 12.0, 48.0]).columns(&equal(2), 84.0);
        for (frame, axis, [simulated, beam, rigid]) in [(frames[0], &slope, &slopes), (frames[1], &share, &shares)] {
            let panel = Panel::new(canvas, frame, "", distance.clone(), axis.clone())?;
            panel.line(rigid.iter().copied(), MUTED, CURVE_PX)?;
            panel.line(beam.iter().copied(), look.color, CURVE_PX)?;
            panel.marks(simulated, look, true)?;
        }
        Ok(())
    };
    Ok(Some(Picture { width_px: 1000, height_px: 400, paint: Box::new(paint) }))
}
