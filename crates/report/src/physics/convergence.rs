//! Error of the chain at rest against the number of its segments.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use super::panels::{Lines, falling_errors, falling_legend};
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Lettering, Picture};
use crate::style::{LABEL, Look};

/// Height of a line of text.
const TEXT_LINE_PX: f64 = 18.0;

/// The chain at rest in one case.
#[derive(Deserialize)]
struct Row {
    whisker: String,
    segments: f64,
    moment_error: f64,
    surface_error_m: f64,
    arc_error_m: f64,
    tip_error_m: f64,
}

/// Power of the segment's length with which an error falls.
#[derive(Deserialize)]
struct Order {
    whisker: String,
    figure: String,
    order: f64,
}

/// One panel: its figure as the tables name it, title, name of the axis, and the error in the axis' unit.
struct Quantity {
    figure: &'static str,
    title: &'static str,
    label: &'static str,
    error: fn(&Row) -> f64,
}

const QUANTITIES: [Quantity; 4] = [
    Quantity { figure: "moment", title: "base moment", label: "error (%)", error: |row| 1e2 * row.moment_error },
    Quantity {
        figure: "surface",
        title: "surface contact",
        label: "error (mm)",
        error: |row| 1e3 * row.surface_error_m,
    },
    Quantity {
        figure: "arc",
        title: "arc length of the contact",
        label: "error (mm)",
        error: |row| 1e3 * row.arc_error_m,
    },
    Quantity { figure: "tip", title: "position of the tip", label: "error (mm)", error: |row| 1e3 * row.tip_error_m },
];

/// Content of one panel.
struct Shown {
    quantity: &'static Quantity,
    /// One line per whisker.
    lines: Lines,
    /// A sentence a whisker.
    orders: Vec<String>,
    bound: Option<f64>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("convergence")?;
    let orders: Vec<Order> = data.table("convergence_orders")?;
    let whiskers = names(rows.iter().map(|row| row.whisker.as_str()));
    let Some(first) = whiskers.first() else {
        return Ok(None);
    };
    let mut segments: Vec<f64> = rows.iter().map(|row| row.segments).collect();
    segments.sort_by(f64::total_cmp);
    segments.dedup();
    let mut panels = Vec::new();
    for quantity in &QUANTITIES {
        let worst = |whisker: &String, segments: f64| -> (f64, f64) {
            let of_chain = rows.iter().filter(|row| &row.whisker == whisker && row.segments == segments);
            (segments, of_chain.map(quantity.error).fold(0.0, f64::max))
        };
        let order_of = |whisker: &String| {
            let found = orders.iter().find(|row| &row.whisker == whisker && row.figure == quantity.figure);
            found.map_or_else(String::new, |row| format!("{whisker}: order {:.2}", row.order))
        };
        // The position of the tip has no bound of its own.
        let bound = (quantity.figure != "tip").then(|| data.bound(&format!("rest_{first}_{}", quantity.figure)));
        panels.push(Shown {
            quantity,
            lines: whiskers.iter().map(|name| segments.iter().map(|count| worst(name, *count)).collect()).collect(),
            orders: whiskers.iter().map(order_of).collect(),
            bound: bound.transpose()?,
        });
    }

    let paint = move |canvas: &Canvas| {
        falling_legend(canvas, (64.0, 18.0), &whiskers)?;
        let plot = Rect::inside(canvas, [72.0, 68.0, 10.0, 48.0]);
        let frames: Vec<Rect> =
            plot.rows(&equal(2), 62.0).iter().flat_map(|row| row.columns(&equal(2), 92.0)).collect();
        for (index, (shown, frame)) in panels.iter().zip(frames).enumerate() {
            let chains = Axis::marked("number of segments", segments.clone());
            let chains = if index < 2 { chains.unnamed() } else { chains };
            shown.paint(canvas, frame, chains)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 840, paint)))
}

impl Shown {
    fn paint(&self, canvas: &Canvas, frame: Rect, chains: Axis) -> Result<()> {
        let values = self.lines.iter().flatten().map(|(_, error)| *error).chain(self.bound);
        let error = Axis::logarithmic(self.quantity.label, values);
        let panel = Panel::new(canvas, frame, self.quantity.title, chains, error)?;
        falling_errors(&panel, &self.lines, self.bound)?;
        // The lines leave the lower left corner free.
        for (index, order) in self.orders.iter().enumerate() {
            let y = frame.bottom - TEXT_LINE_PX * (self.orders.len() - index) as f64 + 2.0;
            canvas.text(order, (frame.left + 14.0, y), Lettering { color: Look::of(index).color, ..LABEL })?;
        }
        Ok(())
    }
}
