//! Live estimation through a disturbed connection: error relative to that of a replay.

use anyhow::Context as _;
use live::{Disturbance, LiveEstimator, Timing, messages, play};
use rayon::prelude::*;
use testbed::front_end::{FRONT_ENDS, FrontEnd, FrontEndConfig};
use testbed::metrics::{GroundTruth, Scored, Trial, error};
use testbed::replay::{Replay, estimator, knowledge};
use testbed::statistics::mean;
use trace::{CalibrationFile, Role, Trace};
use whisker::estimators::{self, Estimate};
use whisker::events::TouchConfig;

use super::{Claim, Context, RECOMMENDED, WHISKERS};

/// Number of seeds of the noise and of the disturbance.
const SEEDS: u64 = 4;

const DISTURBED: Disturbance = Disturbance { lost: 0.05, jitter_s: 0.02, swapped: 0.01 };

pub(super) fn claims() -> Vec<Claim> {
    let of_whisker = |whisker: &'static str| {
        Claim::at_most(
            format!("live_disturbed_{whisker}"),
            format!(
                "every standard trial, {whisker} whisker, {RECOMMENDED}, live: steady RMSE with 5 % of messages lost, \
                 20 ms of jitter and 1 % swapped, over that without, geometric mean over trials and {SEEDS} seeds"
            ),
            1.1,
            "times",
            move |context| growth(context, whisker),
        )
    };
    let mut claims: Vec<Claim> = WHISKERS.into_iter().map(of_whisker).collect();
    claims.push(Claim::at_most(
        "live_equals_replay".into(),
        format!(
            "every standard trial, {RECOMMENDED}, live without delays: largest distance from the replayed contacts"
        ),
        1e-12,
        "m",
        |context| largest_difference_m(context).map(Some),
    ));
    claims
}

/// Geometric mean, over trials and seeds, of the steady RMSE through a disturbed connection relative to that without. `None` if
/// a trial has no steady RMSE.
fn growth(context: &Context, whisker: &str) -> anyhow::Result<Option<f64>> {
    let mut trials = context.dataset().read(Role::Trial)?;
    trials.retain(|trace| trace.sidecar.whisker.name == whisker);
    let jobs: Vec<_> = trials.iter().flat_map(|trace| (1..=SEEDS).map(move |seed| (trace, seed))).collect();
    let ratios: Vec<Option<f64>> = jobs
        .par_iter()
        .map(|(trace, seed)| {
            let sensed = Sensed::new(context, trace, *seed)?;
            let [disturbed, quiet] =
                [DISTURBED, Disturbance::default()].map(|disturbance| sensed.rmse_m(trace, &disturbance));
            Ok(disturbed?.zip(quiet?).map(|(disturbed, quiet)| disturbed / quiet))
        })
        .collect::<anyhow::Result<_>>()?;
    let logarithms: Option<Vec<f64>> = ratios.into_iter().map(|ratio| Some(ratio?.ln())).collect();
    Ok(logarithms.and_then(mean).map(f64::exp))
}

/// Largest distance between the contacts of a live stream without delays and those of a replay. Infinite if only one has an
/// estimate.
fn largest_difference_m(context: &Context) -> anyhow::Result<f64> {
    let differences: Vec<f64> = context
        .dataset()
        .read(Role::Trial)?
        .par_iter()
        .map(|trace| {
            let sensed = Sensed::new(context, trace, 1)?;
            let samples = testbed::replay::samples(&trace.recording, &sensed.readings_n_m);
            let replayed = sensed.build(trace)()?.run(&samples);
            let live = sensed.estimates(trace, &Disturbance::default())?;
            let distance_m = |pair: (&Option<Estimate>, &Option<Estimate>)| match pair {
                (Some(own), Some(other)) => own.contact.distance(&other.contact),
                (None, None) => 0.0,
                _ => f64::INFINITY,
            };
            Ok(live.iter().zip(&replayed).map(distance_m).fold(0.0, f64::max))
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(differences.into_iter().fold(0.0, f64::max))
}

/// Readings of a trace, and the prior information of an estimator.
struct Sensed {
    knowledge: std::sync::Arc<estimators::Knowledge>,
    readings_n_m: Vec<f64>,
    seed: u64,
}

impl Sensed {
    /// Measurement noise of the default front end under a seed.
    fn new(context: &Context, trace: &Trace, seed: u64) -> anyhow::Result<Self> {
        let folder = context.dataset().calibrations(FRONT_ENDS[0].name);
        let path = folder.join(format!("{}.json", trace.sidecar.whisker.name));
        let faces = CalibrationFile::read(&path)?.calibrated(&path, None)?;
        let front_end = FrontEnd::new(&FrontEndConfig::default())?;
        let largest_n_m = trace.recording.instants.iter().map(|instant| instant.moment_z_n_m.abs()).fold(0.0, f64::max);
        let noise_sd_n_m = front_end.row.noise * largest_n_m;
        let reader = front_end.reader(&trace.sidecar, noise_sd_n_m, seed);
        let readings_n_m = trace.recording.instants.iter().map(reader.context("a front end that streams")?).collect();
        Ok(Self { knowledge: knowledge(&trace.sidecar, &faces, noise_sd_n_m), readings_n_m, seed })
    }

    fn build(&self, trace: &Trace) -> impl Fn() -> anyhow::Result<estimators::Estimator> + Send + use<> {
        let (knowledge, name, seed) = (self.knowledge.clone(), trace.sidecar.name.clone(), self.seed);
        move || {
            let row = estimators::estimator(RECOMMENDED).context("a registered estimator")?;
            estimator(row, &(row.defaults)(), TouchConfig::default(), &knowledge, &name, seed)
        }
    }

    /// Estimates of a live stream, one entry per row of the trace.
    fn estimates(&self, trace: &Trace, disturbance: &Disturbance) -> anyhow::Result<Vec<Option<Estimate>>> {
        let instants = &trace.recording.instants;
        let mut estimates = vec![None; instants.len()];
        let messages = messages(&[(&trace.recording, &self.readings_n_m)], disturbance, self.seed);
        let mut live = [LiveEstimator::new(Box::new(self.build(trace)), &self.knowledge, false, Timing::default())?];
        play(
            &mut live,
            &messages,
            |_| true,
            |_, out| {
                for answer in out.answers.drain(..) {
                    let row = instants.partition_point(|instant| instant.t_s < answer.t_s);
                    estimates[row] = answer.estimate;
                }
                Ok(())
            },
        )?;
        Ok(estimates)
    }

    /// Steady RMSE of a live stream. `None` if too many estimates are missing.
    fn rmse_m(&self, trace: &Trace, disturbance: &Disturbance) -> anyhow::Result<Option<f64>> {
        let estimates = self.estimates(trace, disturbance)?;
        let replay = Replay { estimates, outline: None, elapsed_ns: 0, failure: None };
        let ground_truth = GroundTruth::new(trace, None, &self.knowledge.rest);
        let trial = Trial {
            trace,
            outline: None,
            knowledge: &self.knowledge,
            readings_n_m: &self.readings_n_m,
            events: None,
            bound: None,
            ground_truth: &ground_truth,
        };
        Ok((error::RMSE.measure)(&Scored::new(&trial, &replay, &[], None)?))
    }
}
