//! Distribution of the contact error over trials against time since the touch, one column per whisker.

use anyhow::Result;
use whisker::estimators::MethodClass;

use crate::axes::{Axis, Panel, Rect, equal, without_dips};
use crate::canvas::{Canvas, Picture};
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, LegendEntry, Look, MUTED, legend, plain};

/// End of the lower row of panels.
const ZOOM_S: f64 = 1.0;
/// Largest error drawn, longer than a whisker.
const LARGEST_MM: f64 = 100.0;
/// Opacity of the bands.
const BAND_OPACITY: f64 = 0.2;
/// Distance between the markers on a curve.
const MARKER_SPACING_PX: f64 = 110.0;

/// The error of one estimator: (seconds since touch, 10th percentile, median, 90th percentile), in millimetres.
struct Curve {
    look: Look,
    banded: bool,
    rows: Vec<[f64; 4]>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, methods: Vec<Method>) -> Result<Option<Picture>> {
    let of_class = |class: MethodClass| methods.iter().filter(move |method| method.class == class);
    let steadiest = |class| data.steadiest(of_class(class).map(|method| method.name.as_str()));
    // More than two bands hide each other.
    let banded: Vec<&str> = [MethodClass::Recursive, MethodClass::Baseline].into_iter().filter_map(steadiest).collect();
    let sets: Vec<(String, Vec<Curve>)> = data
        .leading_sets()
        .into_iter()
        .map(|set| {
            let trials = set.traces.len() * data.run.seeds.len();
            let curves = methods.iter().map(|method| Curve {
                look: method.look,
                banded: banded.contains(&method.name.as_str()),
                rows: data
                    .bands_of(set, &method.name)
                    .iter()
                    // A median over the few trials that estimate early would flatter the estimator.
                    .filter(|row| 2 * row.trials >= trials)
                    .map(|row| [row.t_contact_s, 1e3 * row.p10_m, 1e3 * row.median_m, 1e3 * row.p90_m])
                    .collect(),
            });
            let title = format!("{} whisker, {}, {}", set.whisker, plain(&set.group), data.trials_in_words(set));
            (title, curves.collect())
        })
        .collect();
    let values = || sets.iter().flat_map(|(_, curves)| curves.iter().flat_map(|curve| &curve.rows));
    if values().next().is_none() {
        return Ok(None);
    }
    let end_s = values().map(|row| row[0]).fold(0.0, f64::max);
    let errors = values().flat_map(|row| row[1..].to_vec()).filter(|error| *error < LARGEST_MM);
    let error = Axis::logarithmic("contact error (mm)", without_dips(errors));
    let of_bands = methods.iter().filter(|method| banded.contains(&method.name.as_str()));
    let bands: Vec<_> = of_bands.map(|method| method.look.color.mix(2.0 * BAND_OPACITY)).collect();
    let bands_text = format!("10th to 90th percentile: {}", banded.join(", "));
    let note = if banded.is_empty() {
        String::new()
    } else {
        format!("Bands: 10th to 90th percentile of {}.", methods::in_words(banded.iter().copied()))
    };

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> = methods.iter().map(|method| LegendEntry::curve(&method.label, method.look)).collect();
        if !bands.is_empty() {
            entries.push(LegendEntry::bands(&bands_text, bands.clone()));
        }
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [64.0, below + 46.0, 56.0, 48.0]).columns(&equal(sets.len()), 62.0);
        for (column, ((title, curves), frame)) in sets.iter().zip(frames).enumerate() {
            let error = if column == 0 { error.clone() } else { error.clone().bare() };
            for (row, (frame, until_s)) in frame.rows(&equal(2), 60.0).into_iter().zip([end_s, ZOOM_S]).enumerate() {
                let title = if row == 0 { title } else { "first second" };
                let time = Axis::linear(if row == 0 { "" } else { "time since the first touch (s)" }, 0.0, until_s);
                let panel = Panel::new(canvas, frame, title, time, error.clone())?;
                paint_curves(&panel, curves)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 820, paint).noted(note)))
}

fn paint_curves(panel: &Panel, curves: &[Curve]) -> Result<()> {
    for (level_mm, word) in [(1.0, "1 mm"), (0.3, "0.3 mm")] {
        panel.level(level_mm, word, MUTED)?;
    }
    for curve in curves.iter().filter(|curve| curve.banded) {
        let rows: Vec<_> = curve.rows.iter().map(|&[t, low, _, high]| (t, low, high)).collect();
        panel.band(&rows, curve.look.color.mix(BAND_OPACITY))?;
    }
    for (index, curve) in curves.iter().enumerate() {
        let rows: Vec<_> = curve.rows.iter().map(|&[t, _, median, _]| (t, median)).collect();
        let offset_px = 24.0 + MARKER_SPACING_PX * index as f64 / curves.len() as f64;
        panel.marked_line(&rows, curve.look, CURVE_PX, (offset_px, MARKER_SPACING_PX))?;
    }
    Ok(())
}
