//! Disturbance of free-standing objects: peak force above, displacement below, one column per kind of tip or mass.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::style::{CURVE_PX, INK, LegendEntry, Look, MUTED, legend};

/// Smallest stiffness of a root that counts as clamped.
const CLAMPED_N_M_RAD: f64 = 1.0;
/// Looks of the legend's hollow marker and of the force at which an object slides.
const GREY: usize = 6;
const VERMILION: usize = 4;

/// One sweep against one object.
#[derive(Deserialize)]
struct Row {
    whisker: String,
    root_stiffness_n_m_rad: f64,
    diameter_m: f64,
    mass_kg: f64,
    approach_rad: f64,
    tip_friction: f64,
    speed_m_s: f64,
    peak_force_n: f64,
    moved_m: f64,
    fell: u8,
    slides_at_n: f64,
    tips_at_n: f64,
}

/// Layout of the rows.
struct Layout {
    /// The column of a row, by its title.
    column: fn(&Row) -> String,
    /// The line of a row, by its name.
    line: fn(&Row) -> String,
    /// The horizontal axis, and where a row lies on it.
    x: Axis,
    x_of: fn(&Row) -> f64,
}

/// Lays out the figure over the angle of approach.
pub(crate) fn by_approach(data: &Data) -> Result<Option<Picture>> {
    let column = |row: &Row| {
        let tip = if row.tip_friction > 0.0 { "tip with friction" } else { "frictionless tip" };
        format!("{tip}, object of {} g", grams(row))
    };
    let layout = Layout {
        column,
        line: |row| row.whisker.clone(),
        x: Axis::linear("approach (degrees; 0: head-on, 90: from the side)", 0.0, 93.0),
        x_of: |row| row.approach_rad.to_degrees(),
    };
    picture(data, &data.table("disturbance_approach")?, layout)
}

/// Lays out the figure over the wire's diameter for a curved whisker from the side, its tip frictionless.
pub(crate) fn sideways(data: &Data) -> Result<Option<Picture>> {
    by_diameter(data, |row| row.tip_friction == 0.0)
}

/// Lays out the figure over the wire's diameter for a straight whisker head-on, with friction at the tip.
pub(crate) fn head_on(data: &Data) -> Result<Option<Picture>> {
    by_diameter(data, |row| row.tip_friction > 0.0)
}

/// Lays out the figure over the base's speed for whiskers that meet the object head-on, with friction at the tip.
pub(crate) fn by_speed(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("disturbance_speed")?;
    let layout = Layout {
        column: |row| format!("object of {} g", grams(row)),
        line: |row| row.whisker.clone(),
        x: Axis::marked("largest speed of the base (mm/s)", rows.iter().map(|row| 1e3 * row.speed_m_s).collect()),
        x_of: |row| 1e3 * row.speed_m_s,
    };
    picture(data, &rows, layout)
}

fn by_diameter(data: &Data, shown: fn(&Row) -> bool) -> Result<Option<Picture>> {
    let mut rows: Vec<Row> = data.table("disturbance_stiffness")?;
    rows.retain(shown);
    let line = |row: &Row| match row.root_stiffness_n_m_rad {
        clamped if clamped >= CLAMPED_N_M_RAD => "root clamped".to_owned(),
        stiffness => format!("root {} mN·m/rad", 1e3 * stiffness),
    };
    let layout = Layout {
        column: |row| format!("object of {} g", grams(row)),
        line,
        x: Axis::around("diameter of the wire (mm)", rows.iter().map(|row| 1e3 * row.diameter_m)),
        x_of: |row| 1e3 * row.diameter_m,
    };
    picture(data, &rows, layout)
}

fn grams(row: &Row) -> f64 {
    1e3 * row.mass_kg
}

/// One sweep as it is drawn.
struct Point {
    x: f64,
    force_mn: f64,
    moved_um: f64,
    fell: bool,
}

/// The points of every line against one kind of object.
struct Column {
    title: String,
    lines: Vec<Vec<Point>>,
    slides_at_mn: f64,
    tips_at_mn: f64,
}

fn picture(data: &Data, rows: &[Row], Layout { column, line, x, x_of }: Layout) -> Result<Option<Picture>> {
    let lines = names(rows.iter().map(line).collect::<Vec<_>>().iter().map(String::as_str));
    let titles = names(rows.iter().map(column).collect::<Vec<_>>().iter().map(String::as_str));
    let point = |row: &Row| Point {
        x: x_of(row),
        force_mn: 1e3 * row.peak_force_n,
        moved_um: 1e6 * row.moved_m,
        fell: row.fell == 1,
    };
    let columns: Vec<Column> = titles
        .into_iter()
        .filter_map(|title| {
            let of_column: Vec<&Row> = rows.iter().filter(|row| column(row) == title).collect();
            let first = *of_column.first()?;
            let of_line =
                |name: &String| of_column.iter().filter(|row| line(row) == *name).map(|row| point(row)).collect();
            Some(Column {
                lines: lines.iter().map(of_line).collect(),
                slides_at_mn: 1e3 * first.slides_at_n,
                tips_at_mn: 1e3 * first.tips_at_n,
                title,
            })
        })
        .collect();
    if columns.is_empty() {
        return Ok(None);
    }
    let bound_um = 1e3 * data.bound("disturbance_curved")?;
    let limits = columns.iter().flat_map(|column| [column.slides_at_mn, column.tips_at_mn]);
    let points = || columns.iter().flat_map(|column| column.lines.iter().flatten());
    let force = Axis::logarithmic("peak force (mN)", points().map(|point| point.force_mn).chain(limits));
    let way = Axis::logarithmic("displacement (µm)", points().map(|point| point.moved_um).chain([bound_um]));

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            lines.iter().enumerate().map(|(index, name)| LegendEntry::curve(name, Look::of(index))).collect();
        entries.push(LegendEntry::marker("hollow: the object fell", Look::of(GREY), false));
        entries.push(LegendEntry::dashes("force at which it tips", INK));
        entries.push(LegendEntry::dashes("force at which it slides", Look::of(VERMILION).color));
        entries.push(LegendEntry::dashes("claimed bound on the displacement", MUTED));
        legend(canvas, (16.0, 18.0), &entries)?;
        let rows = Rect::inside(canvas, [84.0, 90.0, 14.0, 48.0]).rows(&equal(2), 26.0);
        let frames = |row: usize| rows[row].columns(&equal(columns.len()), 20.0);
        for (index, (column, (above, below))) in columns.iter().zip(frames(0).into_iter().zip(frames(1))).enumerate() {
            let shared = |axis: &Axis| if index == 0 { axis.clone() } else { axis.clone().bare() };
            let forces = Panel::new(canvas, above, &column.title, x.clone().bare(), shared(&force))?;
            forces.level(column.slides_at_mn, "", Look::of(VERMILION).color)?;
            forces.level(column.tips_at_mn, "", INK)?;
            let ways = Panel::new(canvas, below, "", x.clone(), shared(&way))?;
            ways.level(bound_um, "", MUTED)?;
            for (index, points) in column.lines.iter().enumerate() {
                draw_line(&forces, index, points, |point| point.force_mn)?;
                draw_line(&ways, index, points, |point| point.moved_um)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 760, paint)))
}

/// A line with its markers, hollow where the object fell.
fn draw_line(panel: &Panel, index: usize, points: &[Point], y_of: fn(&Point) -> f64) -> Result<()> {
    let look = Look::of(index);
    panel.line(points.iter().map(|point| (point.x, y_of(point))), look.color, CURVE_PX)?;
    points.iter().try_for_each(|point| panel.marks(&[(point.x, y_of(point))], look, !point.fell))
}
