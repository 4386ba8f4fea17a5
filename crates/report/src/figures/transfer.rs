//! Sensor characteristic: counts over the rotation of the root.

use anyhow::Result;
use testbed::results::TransferRow;

use crate::axes::{Axis, Panel, Rect};
use crate::canvas::{Canvas, Picture};
use crate::color::Rgb;
use crate::run_data::RunData;
use crate::style::{BLUE, CURVE_PX, LegendEntry, Look, MUTED, ORANGE, STATED, legend, plain};

/// Names and colours of the axes. The reading is that of the second.
const AXES: [(&str, Rgb, Value); 3] = [
    ("x, along the root", STATED, |row| row.x_counts),
    ("y, in the plane (reading)", BLUE, |row| row.y_counts),
    ("z, out of the plane", ORANGE, |row| row.z_counts),
];
/// The axis that is read.
const READ: usize = 1;
const THOUSAND: f64 = 1e-3;

/// The counts of a row.
type Value = fn(&TransferRow) -> f64;

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let Some(sensor) = data.run.front_end.sensors.first() else { return Ok(None) };
    let Some(rows) = data.transfer(sensor)? else { return Ok(None) };
    let sensor = sensor.name.clone();
    // The table is in the order of the gains.
    let gains: Vec<Vec<TransferRow>> = rows.chunk_by(|a, b| a.amplified == b.amplified).map(<[_]>::to_vec).collect();
    let Some(own) = gains.first().cloned() else { return Ok(None) };
    let paint = move |canvas: &Canvas| {
        let plot = Rect::inside(canvas, [64.0, 64.0, 16.0, 48.0]);
        let frames = plot.columns(&[1.0, 1.0], 70.0);
        let rotation = Axis::around("rotation of the root (°)", rows.iter().map(degrees));
        let entries = AXES.map(|(name, color, _)| LegendEntry::line(name, color, CURVE_PX));
        legend(canvas, (60.0, 18.0), &entries)?;
        let counts = Axis::around("counts", own.iter().flat_map(|row| AXES.map(|(.., value)| value(row))));
        let title = format!("sensor {}: its three axes", plain(&sensor));
        let panel = Panel::new(canvas, frames[0], &title, rotation.clone(), counts)?;
        for (_, color, value) in AXES {
            panel.line(own.iter().map(|row| (degrees(row), value(row))), color, CURVE_PX)?;
        }
        let value = AXES[READ].2;
        let names: Vec<String> = gains.iter().map(|rows| format!("gain {}", rows[0].amplified)).collect();
        let entries: Vec<_> =
            names.iter().enumerate().map(|(i, name)| LegendEntry::line(name, Look::of(i).color, CURVE_PX)).collect();
        legend(canvas, (frames[1].left, 18.0), &entries)?;
        let all = Axis::around("thousand counts", rows.iter().map(|row| THOUSAND * value(row)));
        let title = "y after an amplifier, saturating at the ends of its range";
        let panel = Panel::new(canvas, frames[1], title, rotation.clone(), all)?;
        for end in [f64::min, f64::max].map(|pick| rows.iter().map(value).fold(0.0, pick)) {
            panel.level(THOUSAND * end, "", MUTED)?;
        }
        for (i, rows) in gains.iter().enumerate() {
            let color = Look::of(i).color;
            panel.line(rows.iter().map(|row| (degrees(row), THOUSAND * value(row))), color, CURVE_PX)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 480, paint)))
}

fn degrees(row: &TransferRow) -> f64 {
    row.rotation_rad.to_degrees()
}
