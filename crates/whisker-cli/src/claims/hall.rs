//! The Hall sensor: residual of the earth's field after compensation, and loss of accuracy on pins.

use std::path::Path;

use anyhow::Context as _;
use evaluation::evaluate::{EvaluateSettings, evaluate};
use indicatif::ProgressBar;
use testbed::dataset::Dataset;
use testbed::front_end::{FRONT_ENDS, shift_counts};
use testbed::metrics::{consistency, error};
use testbed::results::TurnRow;
use trace::SensorFile;

use super::{Claim, Context, Evaluation, RECOMMENDED, WHISKERS, arm, monte_carlo, worst};

/// Run of the Monte-Carlo pins through the Hall sensor, with and without the noise of the Monte-Carlo.
pub(super) const RUN: &str = "hall";

/// No noise in addition to that of the sensor.
const ALONE: f64 = 0.0;

pub(super) fn claims() -> Vec<Claim> {
    let of_whiskers = WHISKERS.into_iter().flat_map(|whisker| [earth(whisker), pins(whisker)].into_iter().flatten());
    of_whiskers.chain([arrays()]).collect()
}

/// Half a turn of the free sensor, as published: a shift of 10 to 15 counts, removed by the reference sensor.
fn earth(whisker: &'static str) -> Vec<Claim> {
    let shift =
        move |context: &Context, counts: fn(&TurnRow) -> f64| shift_counts(context.run(RUN).turns_of(whisker)?, counts);
    let before = move |context: &Context| Ok(shift(context, |row| row.counts));
    let about = format!("Hall sensor of the {whisker} whisker, turned by half a circle");
    vec![
        Claim::at_least(
            format!("hall_{whisker}_shift_low"),
            format!("{about}: uncompensated shift"),
            10.0,
            "counts",
            before,
        ),
        Claim::at_most(
            format!("hall_{whisker}_shift_high"),
            format!("{about}: uncompensated shift"),
            15.0,
            "counts",
            before,
        ),
        Claim::at_most(
            format!("hall_{whisker}_shift_left"),
            format!("{about}: residual shift after compensation"),
            10.0,
            "%",
            move |context| {
                let left = shift(context, |row| row.compensated_counts);
                Ok(left.zip(shift(context, |row| row.counts)).map(|(left, whole)| 100.0 * left / whole))
            },
        ),
    ]
}

/// Residual shift of the sensors on the arm, which share references.
fn arrays() -> Claim {
    Claim::at_most(
        "hall_arm_shift_left".into(),
        "Hall sensors of the arm, turned by half a circle: residual shift after compensation, worst sensor".into(),
        10.0,
        "%",
        |context| {
            let Evaluation { run, turns, .. } = context.run(arm::RUN);
            let left = |sensor: &SensorFile| {
                let rows = turns.get(&sensor.label())?;
                let (left, whole) =
                    (shift_counts(rows, |row| row.compensated_counts)?, shift_counts(rows, |row| row.counts)?);
                Some(100.0 * left / whole)
            };
            Ok(worst(run.front_end.sensors.iter().map(left)))
        },
    )
}

/// Pins: loss of accuracy by the sensor, in addition to the noise of the Monte-Carlo and compared with white noise of
/// its level; consistency of innovations and ellipses.
fn pins(whisker: &'static str) -> Vec<Claim> {
    let about = format!("100 trials on a pin through the Hall sensor, {whisker} whisker, {RECOMMENDED}");
    let nis = move |context: &Context| {
        let row = context.run(RUN).summary(monte_carlo::GROUP, whisker, RECOMMENDED);
        Ok(row.and_then(|row| row.get(&consistency::NIS)))
    };
    let coverage = move |context: &Context| {
        let row = context.run(RUN).summary(monte_carlo::GROUP, whisker, RECOMMENDED);
        Ok(row.and_then(|row| row.get(&consistency::COVERAGE)).map(|share| 100.0 * share))
    };
    vec![
        Claim::at_least(
            format!("hall_{whisker}_coverage_low"),
            format!("{about}, noise 1 %: truth in the 95 % ellipses"),
            90.0,
            "%",
            coverage,
        ),
        Claim::at_most(
            format!("hall_{whisker}_coverage_high"),
            format!("{about}, noise 1 %: truth in the 95 % ellipses"),
            98.0,
            "%",
            coverage,
        ),
        Claim::at_most(
            format!("hall_{whisker}_price"),
            format!("{about}, noise 1 %: steady RMSE over that without the sensor, medians"),
            1.1,
            "times",
            move |context| {
                let rmse_m =
                    |run| context.run(run).summary(monte_carlo::GROUP, whisker, RECOMMENDED)?.get(&error::RMSE);
                Ok(rmse_m(RUN).zip(rmse_m(monte_carlo::RUN)).map(|(through, without)| through / without))
            },
        ),
        Claim::at_least(
            format!("hall_{whisker}_nis_low"),
            format!("{about}, noise 1 %: average NIS"),
            0.9,
            "times",
            nis,
        ),
        Claim::at_most(
            format!("hall_{whisker}_nis_high"),
            format!("{about}, noise 1 %: average NIS"),
            1.1,
            "times",
            nis,
        ),
        Claim::at_most(
            format!("hall_{whisker}_alone"),
            format!("{about}, no other noise: steady RMSE over that with white noise of the same level, medians"),
            2.0,
            "times",
            move |context| {
                let row = context.run(RUN).summary_at(monte_carlo::GROUP, whisker, RECOMMENDED, ALONE);
                let through_m = row.and_then(|row| row.get(&error::RMSE));
                Ok(through_m.zip(white_rmse_m(context, whisker)?).map(|(through, white)| through / white))
            },
        ),
    ]
}

/// Error on the same pins with white noise of the level of the sensor.
fn white_rmse_m(context: &Context, whisker: &str) -> anyhow::Result<Option<f64>> {
    let Evaluation { run, .. } = context.run(RUN);
    let set = run.sets.iter().find(|set| set.whisker == whisker);
    let sensor = run.front_end.sensors.iter().find(|sensor| sensor.name == whisker);
    let (set, sensor) = set.zip(sensor).with_context(|| format!("{whisker}: not in the run `{RUN}`"))?;
    let pins = Dataset::open(&Path::new("scenes/suites").join(monte_carlo::RUN).with_extension("json"), None)?;
    let folder = tempfile::tempdir()?;
    let settings = EvaluateSettings {
        name: format!("white-{whisker}"),
        estimators: Some(vec![RECOMMENDED.into()]),
        touch: run.touch,
        noise: vec![sensor.noise_sd_n_m / set.largest_reading_n_m],
        seeds: run.seeds.clone(),
        calibrations: Some(context.dataset().calibrations(FRONT_ENDS[0].name)),
        results: folder.path().into(),
        ..Default::default()
    };
    let evaluated = evaluate(&[pins.only(&set.traces)], &settings, &ProgressBar::hidden())?;
    Ok(evaluated.summary.first().and_then(|row| row.get(&error::RMSE)))
}
