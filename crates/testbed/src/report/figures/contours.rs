//! Estimated surface points over the true outlines, one panel a set.

use std::f64::consts::TAU;

use anyhow::Result;
use plotters::style::Color;

use crate::metrics::consistency::CHI2_95;
use crate::metrics::error;
use crate::report::axes::{Panel, Rect, equal, extent};
use crate::report::canvas::{Canvas, Picture};
use crate::report::outline::touched_stretch;
use crate::report::run_data::{RunData, smallest};
use crate::report::style::{
    FRAME, INK, LegendEntry, Look, OBJECT, PANEL_TITLE, SMALL, legend, plain, stretch_end, two_digits,
};
use crate::results::{EstimateRow, RunSet};

/// Ellipses drawn in a panel.
const ELLIPSES: usize = 12;
/// Estimated points drawn in a panel.
const POINTS: usize = 300;
/// Time after the touch from which estimates are drawn.
const STEADY_S: f64 = 2.0;
/// Least width and height of the view: a sharp corner is touched in one point.
const LEAST_VIEW_MM: f64 = 4.0;
/// Panels in a row.
const COLUMNS: usize = 4;
/// Width of the touched part.
const TOUCHED_PX: f64 = 3.5;
/// Radius of the estimated points.
const DOT_PX: f64 = 1.4;

/// Points in millimetres of the world.
type Points = Vec<(f64, f64)>;

/// One panel.
struct Contour {
    title: String,
    subtitle: String,
    look: Look,
    outline: Points,
    /// Along the outline from one end to the other.
    touched: Points,
    estimated: Points,
    ellipses: Vec<Points>,
}

/// Lays the figure out.
pub(super) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let mut sets = data.outline_sets();
    let whiskers: Vec<&str> = data.run.sets.iter().map(|set| set.whisker.as_str()).collect();
    sets.sort_by_key(|set| whiskers.iter().position(|whisker| *whisker == set.whisker));
    let mut contours = Vec::new();
    for set in sets {
        contours.extend(contour(data, set)?);
    }
    if contours.is_empty() {
        return Ok(None);
    }
    let columns = contours.len().min(COLUMNS);
    let rows = contours.len().div_ceil(columns);
    let looks: Vec<(String, Look)> = data
        .estimators()
        .enumerate()
        .map(|(index, name)| (name.to_owned(), Look::of(index)))
        .filter(|(_, look)| contours.iter().any(|contour| contour.look == *look))
        .collect();

    let paint = move |canvas: &Canvas| {
        let mut entries =
            vec![LegendEntry::line("true outline", FRAME, 1.5), LegendEntry::stretch("touched part", INK, TOUCHED_PX)];
        entries.extend(looks.iter().map(|(name, look)| LegendEntry::dots(name, look.color, DOT_PX)));
        legend(canvas, (56.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [60.0, 84.0, 14.0, 48.0]);
        let frames = plot.rows(&equal(rows), 92.0).into_iter().flat_map(|row| row.columns(&equal(columns), 44.0));
        for (index, (contour, frame)) in contours.iter().zip(frames).enumerate() {
            let x_name = if index + columns >= contours.len() { "x (mm)" } else { "" };
            let y_name = if index % columns == 0 { "y (mm)" } else { "" };
            contour.paint(canvas, frame, (x_name, y_name))?;
        }
        Ok(())
    };
    Ok(Some(Picture {
        width_px: 1200,
        height_px: 84 + 48 + rows as u32 * 180 + (rows as u32 - 1) * 92,
        paint: Box::new(paint),
    }))
}

fn contour(data: &RunData, set: &RunSet) -> Result<Option<Contour>> {
    // Not the smallest distance to the outline: a filter that rests in one place near it has that too.
    let Some(best) = smallest(data.filters(), |name| data.contact_error_m(set, name)) else {
        return Ok(None);
    };
    let Some(trial) = data.typical_trial(set, best, &error::RMSE) else {
        return Ok(None);
    };
    let (Some(outline), Some(rows)) = (data.outline(&trial.head.trace)?, data.estimates(&trial.head.trace, best)?)
    else {
        return Ok(None);
    };
    let outline: Points = outline.iter().map(|(x, y)| (1e3 * x, 1e3 * y)).collect();
    let steady: Vec<&EstimateRow> = rows.iter().filter(|row| row.t_s >= trial.head.touch_s + STEADY_S).collect();
    let touched = steady.iter().map(|row| point_mm(row.truth_surface_x_m, row.truth_surface_y_m));
    let seen: Vec<&EstimateRow> = steady.iter().copied().filter(|row| row.surface_x_m.is_some()).collect();
    let distance = data
        .outline_distance_m(set, best)
        .map_or_else(String::new, |distance| format!(": median distance {} mm", two_digits(1e3 * distance)));
    Ok(Some(Contour {
        title: format!("{}, {} whisker", plain(&set.group), set.whisker),
        subtitle: format!("{best}{distance}"),
        look: Look::of(data.place_of(best)),
        touched: touched_stretch(&outline, touched),
        outline,
        estimated: thin(&seen, POINTS).map(|row| point_mm(row.surface_x_m, row.surface_y_m)).collect(),
        ellipses: thin(&seen, ELLIPSES).filter_map(ellipse).collect(),
    }))
}

impl Contour {
    fn paint(&self, canvas: &Canvas, frame: Rect, labels: (&str, &str)) -> Result<()> {
        let near = self.touched.iter().chain(&self.estimated);
        let (left, right) = extent(near.clone().map(|point| point.0)).unwrap_or((-1.0, 1.0));
        let (low, high) = extent(near.map(|point| point.1)).unwrap_or((-1.0, 1.0));
        let (width, height) = (1.16 * (right - left), 1.16 * (high - low));
        let half = |extent: f64| 0.5 * extent.max(LEAST_VIEW_MM);
        let (x, y) = (0.5 * (left + right), 0.5 * (low + high));
        let bounds = [x - half(width), x + half(width), y - half(height), y + half(height)];
        let panel = Panel::with_equal_scales(canvas, frame, "", labels, bounds)?;
        canvas.text(&self.title, (frame.left, frame.top - 30.0), PANEL_TITLE)?;
        canvas.text(&self.subtitle, (frame.left, frame.top - 13.0), SMALL)?;
        panel.area(self.outline.iter().copied(), OBJECT.to_rgba())?;
        panel.line(self.outline.iter().copied(), FRAME, 1.5)?;
        panel.line(self.touched.iter().copied(), INK, TOUCHED_PX)?;
        for ellipse in &self.ellipses {
            panel.area(ellipse.iter().copied(), self.look.color.mix(0.07))?;
            panel.line(ellipse.iter().copied(), self.look.color.mix(0.4), 0.75)?;
        }
        panel.discs(self.estimated.iter().copied(), DOT_PX, self.look.color.to_rgba())?;
        // On top, since estimates on a corner would hide that it alone was touched.
        for end in self.touched.first().into_iter().chain(self.touched.last()) {
            stretch_end(canvas, panel.at(*end), INK)?;
        }
        Ok(())
    }
}

/// At most about `count` of the rows, evenly spread.
fn thin<'a>(rows: &'a [&'a EstimateRow], count: usize) -> impl Iterator<Item = &'a EstimateRow> {
    rows.iter().copied().step_by(rows.len().div_ceil(count).max(1))
}

/// A point in millimetres; not finite where it is absent.
fn point_mm(x_m: Option<f64>, y_m: Option<f64>) -> (f64, f64) {
    (1e3 * x_m.unwrap_or(f64::NAN), 1e3 * y_m.unwrap_or(f64::NAN))
}

/// The ellipse that holds 95 % of the probability around the estimated surface point, in millimetres: the points
/// c + sqrt(chi2) A u on the unit circle u, with A A' the covariance (Cholesky).
fn ellipse(row: &EstimateRow) -> Option<Points> {
    let (center_x, center_y) = point_mm(row.surface_x_m, row.surface_y_m);
    let (xx, xy, yy) = (row.cov_xx_m2?, row.cov_xy_m2?, row.cov_yy_m2?);
    if xx <= 0.0 {
        return None;
    }
    let a = xx.sqrt();
    let b = xy / a;
    let c = (yy - b * b).max(0.0).sqrt();
    let scale = 1e3 * CHI2_95.sqrt();
    let around = (0..=48).map(|step| {
        let (sin, cos) = (TAU * f64::from(step) / 48.0).sin_cos();
        (center_x + scale * a * cos, center_y + scale * (b * cos + c * sin))
    });
    Some(around.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_95_percent_ellipse_of_a_circular_covariance() {
        // A circle of standard deviation 1 mm holds 95 % within 2.4477 mm (Rayleigh distribution).
        let row = EstimateRow {
            t_s: 0.0,
            base_x_m: 0.0,
            base_y_m: 0.0,
            base_yaw_rad: 0.0,
            reading_n_m: 0.0,
            contact_x_m: None,
            contact_y_m: None,
            surface_x_m: Some(0.010),
            surface_y_m: Some(0.020),
            cov_xx_m2: Some(1e-6),
            cov_xy_m2: Some(0.0),
            cov_yy_m2: Some(1e-6),
            calibrated: None,
            at_tip: None,
            radius_m: None,
            radius_sd_m: None,
            models: None,
            truth_contact_x_m: None,
            truth_contact_y_m: None,
            truth_surface_x_m: None,
            truth_surface_y_m: None,
        };
        for (x, y) in ellipse(&row).expect("a covariance") {
            assert!(((x - 10.0).hypot(y - 20.0) - 2.4477).abs() < 1e-4);
        }
    }
}
