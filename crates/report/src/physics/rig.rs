//! The calibration rig's whisker under the ruler: root rotation per push, at rest and while the ruler moves.

use anyhow::Result;
use serde::Deserialize;

use super::data::Data;
use crate::axes::{Axis, Panel, Rect};
use crate::canvas::{Canvas, Picture};
use crate::style::{CURVE_PX, LegendEntry, Look, MUTED, legend};

/// One place of the routine.
#[derive(Deserialize)]
struct Row {
    distance_m: f64,
    push_m: f64,
    rotation_rad: f64,
    elastica_rad: f64,
    slope_rad_m: f64,
    beam_rad_m: f64,
    rigid_rad_m: f64,
}

/// A state of the whisker and the theory for it. Rotations are per push \[rad/m\].
struct State {
    simulated_as: &'static str,
    expected_as: &'static str,
    claim: &'static str,
    simulated_rad_m: fn(&Row) -> f64,
    expected_rad_m: fn(&Row) -> f64,
}

const STATES: [State; 2] = [
    State {
        simulated_as: "at rest after the push, simulated",
        expected_as: "elastica",
        claim: "rig_rotation",
        simulated_rad_m: |row| row.rotation_rad / row.push_m,
        expected_rad_m: |row| row.elastica_rad / row.push_m,
    },
    State {
        simulated_as: "while the ruler moves, simulated",
        expected_as: "beam, small push",
        claim: "rig_slope",
        simulated_rad_m: |row| row.slope_rad_m,
        expected_rad_m: |row| row.beam_rad_m,
    },
];

/// Curves of a state over the distance in millimetres.
struct Shown {
    simulated: Vec<(f64, f64)>,
    expected: Vec<(f64, f64)>,
    miss_percent: Vec<(f64, f64)>,
    bound_percent: f64,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("rig")?;
    if rows.is_empty() {
        return Ok(None);
    }
    let over_distance = |value: &dyn Fn(&Row) -> f64| -> Vec<(f64, f64)> {
        rows.iter().map(|row| (1e3 * row.distance_m, value(row))).collect()
    };
    let shown = STATES.iter().map(|state| {
        let miss = |row: &Row| 1e2 * ((state.simulated_rad_m)(row) / (state.expected_rad_m)(row) - 1.0).abs();
        Ok(Shown {
            simulated: over_distance(&state.simulated_rad_m),
            expected: over_distance(&state.expected_rad_m),
            miss_percent: over_distance(&miss),
            bound_percent: data.bound(state.claim)?,
        })
    });
    let shown: Vec<Shown> = shown.collect::<Result<_>>()?;
    let rigid = over_distance(&|row| row.rigid_rad_m);
    let values = |lines: &[(f64, f64)]| lines.iter().map(|(_, value)| *value).collect::<Vec<_>>();
    let distance =
        Axis::around("contact distance from the root (mm)", rigid.iter().map(|(distance_mm, _)| *distance_mm));
    let turns = shown.iter().flat_map(|state| values(&state.simulated)).chain(values(&rigid));
    // A milliradian a millimetre is a radian a metre.
    let turn = Axis::linear("root rotation per push (mrad/mm)", 0.0, 1.05 * turns.fold(0.0, f64::max));
    let misses = shown.iter().flat_map(|state| values(&state.miss_percent).into_iter().chain([state.bound_percent]));
    let miss = Axis::logarithmic("deviation (%)", misses);

    let paint = move |canvas: &Canvas| {
        let mut entries = Vec::new();
        for (index, state) in STATES.iter().enumerate() {
            entries.push(LegendEntry::marker(state.simulated_as, Look::of(index), true));
            entries.push(LegendEntry::line(state.expected_as, Look::of(index).color, CURVE_PX));
        }
        entries.push(LegendEntry::line("rigid shaft", MUTED, CURVE_PX));
        entries.push(LegendEntry::dashes("bound", MUTED));
        let legend_px = legend(canvas, (64.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [72.0, legend_px + 28.0, 16.0, 48.0]);
        let frames = plot.rows(&[1.6, 1.0], 28.0);
        let above = Panel::new(canvas, frames[0], "", distance.clone().unnamed(), turn.clone())?;
        let below = Panel::new(canvas, frames[1], "", distance.clone(), miss.clone())?;
        above.line(rigid.iter().copied(), MUTED, CURVE_PX)?;
        for (index, state) in shown.iter().enumerate() {
            let look = Look::of(index);
            above.line(state.expected.iter().copied(), look.color, CURVE_PX)?;
            above.marks(&state.simulated, look, true)?;
            below.level(state.bound_percent, "", look.color)?;
            below.line(state.miss_percent.iter().copied(), look.color, CURVE_PX)?;
            below.marks(&state.miss_percent, look, true)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(900, 620, paint)))
}
