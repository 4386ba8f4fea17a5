//! Contact and map errors against the error of the arm's joint encoders.

use anyhow::Result;
use testbed::metrics::error;
use testbed::results::RunRecording;
use testbed::statistics::mean;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, LegendEntry, Look, legend, two_digits};

/// Fewest levels that make a curve.
const LEAST_LEVELS: usize = 2;

/// One estimator in one panel.
struct Curve {
    look: Look,
    /// Error in mm over the encoders' error in rad. NaN if the estimator has no error at that level.
    points: Vec<(f64, f64)>,
    /// The same with perfect encoders.
    perfect_mm: Option<f64>,
}

/// Mean of the values. `None` if one is missing: an estimator that fails where noise is largest would otherwise have
/// the smaller mean.
fn mean_of_all(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    mean(values.collect::<Option<Vec<f64>>>()?)
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, methods: Vec<Method>) -> Result<Option<Picture>> {
    let levels = levels(data);
    if levels.iter().filter(|(level_rad, _)| *level_rad > 0.0).count() < LEAST_LEVELS {
        return Ok(None);
    }
    let maps = data.maps()?;
    let contact_m = |recordings: &[&RunRecording], estimator: &str| {
        let is_one = |group: &str| recordings.iter().any(|recording| recording.group == group);
        let rows = data
            .summary
            .iter()
            .filter(|row| is_one(&row.head.group) && row.head.estimator == estimator && row.head.noise == data.noise());
        mean_of_all(rows.map(|row| row.get(&error::MEDIAN)))
    };
    let map_m = |recordings: &[&RunRecording], estimator: &str| {
        let is_one = |name: &str| recordings.iter().any(|recording| recording.name == name);
        let rows =
            maps.iter().filter(|row| is_one(&row.recording) && row.estimator == estimator && row.noise == data.noise());
        mean_of_all(rows.map(|row| row.points_mean_m))
    };
    let curves = |value_m: &dyn Fn(&[&RunRecording], &str) -> Option<f64>| -> Vec<Curve> {
        let curve = |method: &Method| {
            let at = |(level_rad, recordings): &(f64, Vec<&RunRecording>)| {
                (*level_rad, 1e3 * value_m(recordings, &method.name).unwrap_or(f64::NAN))
            };
            let (perfect, points): (Vec<_>, Vec<_>) =
                levels.iter().map(at).partition(|(level_rad, _)| *level_rad == 0.0);
            Curve {
                look: method.look,
                points,
                perfect_mm: perfect.first().map(|(_, mm)| *mm).filter(|mm| mm.is_finite()),
            }
        };
        methods.iter().map(curve).collect()
    };
    let panels = [
        ("contact", "median contact error (mm)", curves(&contact_m)),
        ("map", "mean distance of contact points from true outlines (mm)", curves(&map_m)),
    ];
    let marks: Vec<f64> = levels.iter().map(|(level_rad, _)| *level_rad).filter(|level_rad| *level_rad > 0.0).collect();
    let paint = move |canvas: &Canvas| {
        let entries: Vec<_> = methods.iter().map(|method| LegendEntry::curve(&method.label, method.look)).collect();
        let below = legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, below + 46.0, 96.0, 48.0]);
        for ((title, label, curves), frame) in panels.iter().zip(plot.columns(&equal(panels.len()), 150.0)) {
            let values =
                curves.iter().flat_map(|curve| curve.points.iter().map(|point| point.1).chain(curve.perfect_mm));
            let levels = Axis::marked("standard deviation of each joint angle (rad)", marks.clone());
            let panel = Panel::new(canvas, frame, title, levels, Axis::logarithmic(label, values))?;
            for curve in curves {
                let look = curve.look;
                if let Some(perfect_mm) = curve.perfect_mm {
                    panel.level(perfect_mm, &format!("perfect: {}", two_digits(perfect_mm)), look.color)?;
                }
                panel.line(curve.points.iter().copied(), look.color, CURVE_PX)?;
                let (found, lost): (Vec<_>, Vec<_>) = curve.points.iter().partition(|(_, mm)| mm.is_finite());
                panel.marks(&found, look, true)?;
                panel.marks_on_top(lost.iter().map(|(level_rad, _)| *level_rad), look)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 470, paint)))
}

/// The recordings under each error of an encoder's angle: noise and the rounding to steps (a step over the root of 12),
/// from the smallest on.
fn levels(data: &RunData) -> Vec<(f64, Vec<&RunRecording>)> {
    let mut levels: Vec<(f64, Vec<&RunRecording>)> = Vec::new();
    for recording in &data.run.recordings {
        let level_rad = recording.encoders.sd_rad();
        match levels.iter_mut().find(|level| level.0 == level_rad) {
            Some((_, recordings)) => recordings.push(recording),
            None => levels.push((level_rad, vec![recording])),
        }
    }
    levels.sort_by(|a, b| a.0.total_cmp(&b.0));
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_missing_value_leaves_no_mean() {
        assert_eq!(mean_of_all([Some(1.0), Some(3.0)].into_iter()), Some(2.0));
        assert_eq!(mean_of_all([Some(1.0), None].into_iter()), None);
    }
}
