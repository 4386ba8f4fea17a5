//! Recordings played as streams.

use nalgebra::Vector2;
use trace::{Recording, SpatialPose, SpatialRecording};
use whisker::frames::{Base, Pose, World};

use crate::disturbance::Disturbance;
use crate::estimator::{LiveEstimator, Output};
use crate::kind::Kind;
use crate::motion::Motion;

/// Content of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content<R = f64, P = Pose<Base, World>> {
    /// Reading of the sensor (N m).
    Reading(R),
    /// Pose of the base.
    Pose(P),
}

/// Message of a whisker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message<R = f64, P = Pose<Base, World>> {
    /// Index of the whisker.
    pub whisker: usize,
    /// Time of the message.
    pub t_s: f64,
    /// Time of its arrival.
    pub at_s: f64,
    /// Content.
    pub content: Content<R, P>,
}

/// Time, pose of the base and reading of an instant.
type Row<P, R> = (f64, P, R);

/// Message of a whisker in space.
pub type SpatialMessage = Message<Vector2<f64>, SpatialPose>;

/// Messages of the recordings of some whiskers with their readings, in order of arrival. Without disturbance each arrives at
/// its own time, poses before readings. The seed is that of the disturbance.
pub fn messages(recordings: &[(&Recording, &[f64])], disturbance: &Disturbance, seed: u64) -> Vec<Message> {
    let of = |(recording, readings_n_m): &(&Recording, &[f64])| {
        rows(&recording.instants, readings_n_m, |now| (now.t_s, now.base))
    };
    let streams: Vec<_> = recordings.iter().map(of).collect();
    arriving(&streams, disturbance, seed)
}

/// The same of recordings in space.
pub fn messages_in_space(
    recordings: &[(&SpatialRecording, &[Vector2<f64>])],
    disturbance: &Disturbance,
    seed: u64,
) -> Vec<SpatialMessage> {
    let of = |(recording, readings_n_m): &(&SpatialRecording, &[Vector2<f64>])| {
        rows(&recording.instants, readings_n_m, |now| (now.t_s, now.base))
    };
    let streams: Vec<_> = recordings.iter().map(of).collect();
    arriving(&streams, disturbance, seed)
}

/// Rows of a recording's instants, of which `of` is time and pose, with their readings.
fn rows<I, R: Copy, P>(instants: &[I], readings_n_m: &[R], of: impl Fn(&I) -> (f64, P)) -> Vec<Row<P, R>> {
    let row = |(now, reading_n_m): (&I, &R)| {
        let (t_s, base) = of(now);
        (t_s, base, *reading_n_m)
    };
    instants.iter().zip(readings_n_m).map(row).collect()
}

/// Messages of the rows of some whiskers.
fn arriving<R: Copy, P: Copy>(whiskers: &[Vec<Row<P, R>>], disturbance: &Disturbance, seed: u64) -> Vec<Message<R, P>> {
    let mut all = Vec::new();
    for (whisker, rows) in whiskers.iter().enumerate() {
        let times_s: Vec<f64> = rows.iter().map(|(t_s, ..)| *t_s).collect();
        let mut add = |stream: u64, content: &dyn Fn(usize) -> Content<R, P>| {
            let seed = seed.wrapping_mul(2 * whiskers.len() as u64).wrapping_add(2 * whisker as u64 + stream);
            let arrivals = disturbance.arrivals(&times_s, seed).into_iter();
            all.extend(arrivals.map(|(row, at_s)| Message { whisker, t_s: times_s[row], at_s, content: content(row) }));
        };
        add(0, &|row| Content::Pose(rows[row].1));
        add(1, &|row| Content::Reading(rows[row].2));
    }
    all.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    all
}

/// Plays messages in order of arrival to the estimators of the whiskers, and ends their streams. `pace` is called before each
/// instant of arrival, and ends the streams if it returns `false`; `take` receives the index of a whisker and its output.
///
/// # Errors
/// If an estimator cannot be built again after a jump of a clock, or those of `take`.
pub fn play<K: Kind, M: Motion<Measured = K::Base, Base = K::Base>>(
    estimators: &mut [LiveEstimator<M, K>],
    messages: &[Message<K::Reading, K::Base>],
    mut pace: impl FnMut(f64) -> bool,
    mut take: impl FnMut(usize, &mut Output<K::Reading, K::Base, K::Estimate>) -> anyhow::Result<()>,
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
            Content::Reading(reading) => estimators[whisker].reading(t_s, reading, at_s, &mut out)?,
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
fn first_due<K: Kind, M: Motion<Base = K::Base>>(estimators: &[LiveEstimator<M, K>]) -> Option<(f64, usize)> {
    let due = estimators.iter().enumerate().filter_map(|(whisker, of)| Some((of.deadline_s()?, whisker)));
    due.min_by(|a, b| a.0.total_cmp(&b.0))
}
