//! Streams in space with and without delays, against a replay of the same recording.

#[path = "../../whisker/tests/space_world/mod.rs"]
mod space_world;

use std::f64::consts::PI;
use std::sync::Arc;

use live::{
    Content, Disturbance, Event, LiveEstimator, Spatial, SpatialAnswer, SpatialMessage, SpatialOutput, SpatialPoses,
    Status, Timing, messages_in_space, play,
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use testbed::space::replay::SpatialSteps;
use trace::{SpatialInstant, SpatialPose, SpatialRecording};
use whisker::Whisker;
use whisker::events::TouchConfig;
use whisker::rod::Rod;
use whisker::space::estimators::{Estimate, Knowledge, SPATIAL_ESTIMATORS, SpatialEstimatorRow, spatial_estimator};
use whisker::space::sensor::Around;

use space_world::{RATE_HZ, knowledge};

const ROWS: usize = 400;

const QUIET: Disturbance = Disturbance { lost: 0.0, jitter_s: 0.0, swapped: 0.0 };

/// Pose of the base at a time: a push in half a second, then turns about all axes.
fn base(t_s: f64) -> SpatialPose {
    let push = 0.5 - 0.5 * (PI * (t_s / 0.5).min(1.0)).cos();
    // Without a jump of the velocity, between whose poses an interpolated one would be off.
    let since_s = (t_s - 0.5).max(0.0);
    let turn = Vector3::new(0.3, -0.2, 1.0) * 0.03 * (4.0 * since_s * since_s / (since_s + 0.2)).sin();
    SpatialPose {
        position: Vector3::new(0.0, 0.5e-3 - 5e-3 * push, 1e-3 * push),
        rotation: UnitQuaternion::from_scaled_axis(turn),
    }
}

/// Recording of a base that is pushed against a fixed point, with noisy readings.
struct Sweep {
    knowledge: Arc<Knowledge>,
    recording: SpatialRecording,
    readings_n_m: Vec<Vector2<f64>>,
}

impl Sweep {
    fn new(seed: u64) -> Self {
        let knowledge = knowledge(Whisker::straight());
        let whisker = &knowledge.calibrated.whisker;
        let rod = Rod::new(&whisker.whisker, whisker.suspension, whisker.poisson_ratio).unwrap();
        let place = Around::new(0.048, 0.0, 0.0).contact(&knowledge.calibrated.axis).vector();
        let mut random = Pcg64::seed_from_u64(seed);
        let mut draw = || knowledge.noise_sd_n_m * random.sample::<f64, _>(StandardNormal);
        let (mut instants, mut readings_n_m) = (Vec::new(), Vec::new());
        for row in 0..ROWS {
            let t_s = row as f64 / RATE_HZ;
            let base = base(t_s);
            let contact = base.rotation.inverse() * (place - base.position);
            let moment = match contact.y > 0.0 {
                true => rod.at_point(contact).unwrap().deflection.moment_n_m,
                false => Vector3::zeros(),
            };
            instants.push(SpatialInstant::measured(t_s, base, moment.yz()));
            readings_n_m.push(moment.yz() + Vector2::new(draw(), draw()));
        }
        Self { knowledge, recording: SpatialRecording { instants }, readings_n_m }
    }

    fn messages(&self, disturbance: &Disturbance, seed: u64) -> Vec<SpatialMessage> {
        messages_in_space(&[(&self.recording, &self.readings_n_m)], disturbance, seed)
    }

    fn replayed(&self, row: &'static SpatialEstimatorRow) -> Vec<Option<Estimate>> {
        let mut estimator = row.build(&row.defaults(), TouchConfig::default(), &self.knowledge).unwrap();
        let mut steps = SpatialSteps::default();
        let rows = self.recording.instants.iter().zip(&self.readings_n_m);
        let sample =
            |(now, reading_n_m): (&SpatialInstant, &Vector2<f64>)| steps.sample(now.t_s, &now.base, *reading_n_m);
        let samples: Vec<_> = rows.map(sample).collect();
        estimator.run(&samples)
    }

    fn live(&self, row: &'static SpatialEstimatorRow) -> LiveEstimator<SpatialPoses, Spatial> {
        let knowledge = self.knowledge.clone();
        let build = move || Ok(row.build(&row.defaults(), TouchConfig::default(), &knowledge)?);
        LiveEstimator::in_space(Box::new(build), &self.knowledge, Timing::default()).unwrap()
    }
}

/// Answers and events of a stream.
fn played(
    live: LiveEstimator<SpatialPoses, Spatial>,
    messages: &[SpatialMessage],
) -> (Vec<SpatialAnswer>, Vec<Event>, LiveEstimator<SpatialPoses, Spatial>) {
    let (mut live, mut all) = ([live], SpatialOutput::default());
    let take = |_: usize, out: &mut SpatialOutput| {
        all.answers.append(&mut out.answers);
        all.events.append(&mut out.events);
        Ok(())
    };
    play(&mut live, messages, |_| true, take).unwrap();
    let [live] = live;
    (all.answers, all.events, live)
}

fn line() -> &'static SpatialEstimatorRow {
    spatial_estimator("line").unwrap()
}

#[test]
fn verif_without_delays_every_estimator_in_space_gives_the_estimates_of_a_replay() {
    let sweep = Sweep::new(1);
    let messages = sweep.messages(&QUIET, 1);
    for row in SPATIAL_ESTIMATORS {
        let (answers, events, live) = played(sweep.live(row), &messages);
        let estimates: Vec<_> = answers.iter().map(|answer| answer.estimate).collect();
        assert_eq!(estimates, sweep.replayed(row), "{}", row.name);
        assert!(events.is_empty() && live.counters().matched == ROWS as u64);
        assert!(live.counters().estimates > 100, "{}: {}", row.name, live.counters());
    }
}

#[test]
fn verif_poses_in_space_at_other_times_are_interpolated() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if let Content::Pose(pose) = &mut message.content {
            message.t_s -= 1.7e-3;
            message.at_s = message.t_s;
            *pose = base(message.t_s);
        }
    }
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let (answers, ..) = played(sweep.live(line()), &messages);
    let replayed = sweep.replayed(line());
    let mut compared = 0;
    for (answer, replayed) in answers.iter().zip(&replayed) {
        if let (Some(found), Some(expected)) = (answer.estimate, replayed) {
            let distance_m = found.contact.distance(&expected.contact);
            // Readings whose base moves by less than 20 um count as their mean. With interpolated poses, others belong together.
            assert!(distance_m < 4e-5, "{distance_m} m at {} s", answer.t_s);
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn robust_lost_messages_and_wrong_values_in_space_are_counted() {
    let sweep = Sweep::new(2);
    let disturbance = Disturbance { lost: 0.05, jitter_s: 0.01, swapped: 0.01 };
    let mut messages = sweep.messages(&disturbance, 1);
    let bad = SpatialMessage { content: Content::Reading(Vector2::new(f64::NAN, 0.0)), ..messages[20] };
    messages.insert(21, bad);
    let (answers, events, live) = played(sweep.live(line()), &messages);
    assert!(live.counters().missing > 0 && live.counters().not_finite == 1, "{}", live.counters());
    assert!(events.iter().any(|event| matches!(event, Event::NotFinite { .. })));
    assert_eq!(answers.iter().filter(|answer| answer.status == Status::NotFinite).count(), 1);
    // The losses hardly change the estimate.
    let last = answers.iter().rev().find_map(|answer| Some((answer.t_s, answer.estimate?))).expect("an estimate");
    let complete = sweep.replayed(line())[(last.0 * RATE_HZ).round() as usize].expect("an estimate");
    let apart_m = last.1.contact.distance(&complete.contact);
    assert!(apart_m < 5e-4, "{apart_m} m at {} s", last.0);
}

#[test]
fn robust_a_base_in_space_that_moves_or_turns_implausibly_fast_is_noted() {
    let sweep = Sweep::new(3);
    let noted = |change: fn(SpatialPose, usize) -> SpatialPose| {
        let mut messages = sweep.messages(&QUIET, 1);
        let mut row = 0;
        for message in &mut messages {
            if let Content::Pose(pose) = &mut message.content {
                *pose = change(*pose, row);
                row += 1;
            }
        }
        let (_, events, live) = played(sweep.live(line()), &messages);
        (events.iter().filter(|event| matches!(event, Event::Fast { .. })).count(), live.counters().fast)
    };
    assert_eq!(noted(|pose, _| pose), (0, 0));
    let in_millimetres = noted(|pose, _| SpatialPose { position: 1e3 * pose.position, ..pose });
    assert!(in_millimetres.0 == 1 && in_millimetres.1 > 10, "{in_millimetres:?}");
    let spinning = noted(|pose, row| SpatialPose {
        rotation: UnitQuaternion::from_scaled_axis(Vector3::z() * (0.5 * row as f64)),
        ..pose
    });
    assert!(spinning.0 == 1 && spinning.1 > 10, "{spinning:?}");
    // A single wrong pose is counted, but no event.
    let outlier = noted(|pose, row| match row {
        200 => SpatialPose { position: pose.position + Vector3::repeat(1.0), ..pose },
        _ => pose,
    });
    assert!(outlier.0 == 0, "{outlier:?}");
}

#[test]
fn robust_a_frozen_sensor_in_space_is_left_out() {
    let mut sweep = Sweep::new(1);
    let held_n_m = sweep.readings_n_m[200];
    sweep.readings_n_m[200..300].fill(held_n_m);
    let (answers, events, live) = played(sweep.live(line()), &sweep.messages(&QUIET, 1));
    let [Event::Frozen { .. }, Event::Thawed { .. }] = events[..] else { panic!("{events:?}") };
    let left_out = answers.iter().filter(|answer| answer.status == Status::Frozen).count();
    assert!((85..=96).contains(&left_out) && live.counters().frozen == left_out as u64, "{left_out}");
    assert!(answers[310..].iter().all(|answer| answer.estimate.is_some()));
}
