//! Hysteresis loops of contacts with friction, and the angle of their force.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::style::{CURVE_PX, DARK, LegendEntry, MUTED, ORANGE, legend};

/// Displacements below this value are no movement in a direction.
const STILL_MM: f64 = 1e-3;
/// Width of the quasi-static line, drawn below that of the simulation.
const WIDE_PX: f64 = 4.0;

/// An instant of a case.
#[derive(Deserialize)]
struct Instant {
    case: String,
    t_s: f64,
    press_m: f64,
    lengthwise_m: f64,
    friction_n_m: f64,
    static_friction_n_m: f64,
    angle_rad: f64,
    static_angle_rad: f64,
}

/// A case whose instants are drawn.
#[derive(Deserialize)]
struct Row {
    case: String,
    coefficient: f64,
    range_n_m: f64,
}

/// The lines of a case, each quasi-static and simulated; NaN where the base moves in the other direction.
struct Curves {
    title: String,
    press: [Vec<(f64, f64)>; 2],
    lengthwise: [Vec<(f64, f64)>; 2],
    angle: [Vec<(f64, f64)>; 2],
    cone_deg: f64,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let instants: Vec<Instant> = data.table("friction_instants")?;
    let rows: Vec<Row> = data.table("friction")?;
    let cases = names(instants.iter().map(|instant| instant.case.as_str()));
    let curves: Vec<Curves> =
        cases.iter().filter_map(|case| Some(curves(rows.iter().find(|row| &row.case == case)?, &instants))).collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let paint = move |canvas: &Canvas| {
        let entries = [
            LegendEntry::line("quasi-static stick and slip", ORANGE, WIDE_PX),
            LegendEntry::line("simulation", DARK, CURVE_PX),
            LegendEntry::dashes("friction cone", MUTED),
        ];
        legend(canvas, (64.0, 18.0), &entries)?;
        let columns = Rect::inside(canvas, [72.0, 68.0, 10.0, 48.0]).columns(&equal(curves.len()), 56.0);
        for (column, (curves, frame)) in curves.iter().zip(columns).enumerate() {
            let frames = frame.rows(&equal(3), 62.0);
            let label = |text: &'static str| if column == 0 { text } else { "" };
            for (lines, frame, title, x, y) in [
                (
                    &curves.press,
                    frames[0],
                    curves.title.as_str(),
                    "press (mm)",
                    label("moment by friction (% of range)"),
                ),
                (&curves.lengthwise, frames[1], "", "lengthwise (mm)", label("moment by friction (% of range)")),
                (&curves.angle, frames[2], "", "time (s)", label("angle of the force (degrees)")),
            ] {
                let finite = || lines.iter().flatten().filter(|point| point.1.is_finite());
                let axes =
                    (Axis::around(x, finite().map(|point| point.0)), Axis::around(y, finite().map(|point| point.1)));
                let panel = Panel::new(canvas, frame, title, axes.0, axes.1)?;
                if std::ptr::eq(lines, &curves.angle) {
                    for side in [-1.0, 1.0] {
                        panel.level(side * curves.cone_deg, "", MUTED)?;
                    }
                }
                panel.line(lines[0].iter().copied(), ORANGE, WIDE_PX)?;
                panel.line(lines[1].iter().copied(), DARK, CURVE_PX)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 980, paint)))
}

/// The lines of a case.
fn curves(row: &Row, instants: &[Instant]) -> Curves {
    let of_case: Vec<&Instant> = instants.iter().filter(|instant| instant.case == row.case).collect();
    let deepest_mm = of_case.iter().map(|instant| 1e3 * instant.press_m).fold(f64::NEG_INFINITY, f64::max);
    let lines = |point: &dyn Fn(&Instant, f64, f64) -> (f64, f64)| -> [Vec<(f64, f64)>; 2] {
        [
            of_case.iter().map(|at| point(at, at.static_friction_n_m, at.static_angle_rad)).collect(),
            of_case.iter().map(|at| point(at, at.friction_n_m, at.angle_rad)).collect(),
        ]
    };
    let percent = |moment_n_m: f64| 1e2 * moment_n_m / row.range_n_m;
    let where_true = |shown: bool, value: f64| if shown { value } else { f64::NAN };
    Curves {
        title: row.case.clone(),
        press: lines(&|at, moment_n_m, _| {
            let still = 1e3 * at.lengthwise_m.abs() < STILL_MM;
            (1e3 * at.press_m, where_true(still, percent(moment_n_m)))
        }),
        lengthwise: lines(&|at, moment_n_m, _| {
            let pressed = 1e3 * at.press_m > deepest_mm - STILL_MM;
            (1e3 * at.lengthwise_m, where_true(pressed, percent(moment_n_m)))
        }),
        angle: lines(&|at, _, angle_rad| (at.t_s, angle_rad.to_degrees())),
        cone_deg: row.coefficient.atan().to_degrees(),
    }
}
