//! Recordings played as streams.

use trace::Recording;
use whisker::frames::{Base, Pose, World};

use crate::disturbance::Disturbance;
use crate::estimator::{LiveEstimator, Output};

/// Content of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// Reading of the sensor (N m).
    Reading(f64),
    /// Pose of the base.
    Pose(Pose<Base, World>),
}

/// Message of a whisker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message {
    /// Index of the whisker.
    pub whisker: usize,
    /// Time of the message.
    pub t_s: f64,
    /// Time of its arrival.
    pub at_s: f64,
    /// Content.
    pub content: Content,
}

/// Messages of the recordings of some whiskers with their readings, in order of arrival. Without disturbance each arrives at
/// its own time, poses before readings. The seed is that of the disturbance.
pub fn messages(recordings: &[(&Recording, &[f64])], disturbance: &Disturbance, seed: u64) -> Vec<Message> {
    let mut all = Vec::new();
    for (whisker, (recording, readings_n_m)) in recordings.iter().enumerate() {
        let times_s: Vec<f64> = recording.instants.iter().map(|instant| instant.t_s).collect();
        let mut add = |stream: u64, content: &dyn Fn(usize) -> Content| {
            let seed = seed.wrapping_mul(2 * recordings.len() as u64).wrapping_add(2 * whisker as u64 + stream);
            let arrivals = disturbance.arrivals(&times_s, seed).into_iter();
            all.extend(arrivals.map(|(row, at_s)| Message { whisker, t_s: times_s[row], at_s, content: content(row) }));
        };
        add(0, &|row| Content::Pose(recording.instants[row].base));
        add(1, &|row| Content::Reading(readings_n_m[row]));
    }
    all.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    all
}

/// Plays messages in order of arrival to the estimators of the whiskers, and ends their streams. `pace` is called before each
/// instant of arrival, and ends the streams if it returns `false`; `take` receives the index of a whisker and its output.
///
/// # Errors
/// If an estimator cannot be built again after a jump of a clock, or those of `take`.
pub fn play(
    estimators: &mut [LiveEstimator],
    messages: &[Message],
    mut pace: impl FnMut(f64) -> bool,
    mut take: impl FnMut(usize, &mut Output) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut out = Output::default();
    'streams: for message in messages {
        while let Some((due_s, whisker)) = first_due(estimators).filter(|(due_s, _)| *due_s < message.at_s) {
            if !pace(due_s) {
                break 'streams;
            }
            estimators[whisker].poll(due_s, &mut out);
            take(whisker, &mut out)?;
        }
        if !pace(message.at_s) {
            break;
        }
        let Message { whisker, t_s, at_s, content } = *message;
        match content {
            Content::Reading(reading_n_m) => estimators[whisker].reading(t_s, reading_n_m, at_s, &mut out)?,
            Content::Pose(pose) => estimators[whisker].pose(t_s, pose, at_s, &mut out)?,
        }
        take(whisker, &mut out)?;
    }
    for (whisker, estimator) in estimators.iter_mut().enumerate() {
        estimator.finish(&mut out);
        take(whisker, &mut out)?;
    }
    Ok(())
}

/// The earliest time at which a whisker is to be polled, and its index.
fn first_due(estimators: &[LiveEstimator]) -> Option<(f64, usize)> {
    let due = estimators.iter().enumerate().filter_map(|(whisker, of)| Some((of.deadline_s()?, whisker)));
    due.min_by(|a, b| a.0.total_cmp(&b.0))
}
