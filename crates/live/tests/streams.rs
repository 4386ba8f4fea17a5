//! Streams with and without delays, against a replay of the same recording.

#[path = "../../whisker/tests/world/mod.rs"]
mod world;

use std::cell::Cell;
use std::sync::Arc;

use live::{
    Answer, Content, Disturbance, Event, Lack, LiveEstimator, Message, Output, Status, Stream, Timing, messages, play,
};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use testbed::replay::samples;
use trace::{Instant, Recording};
use whisker::estimators::{self, ESTIMATORS, Estimate, EstimatorRow, Knowledge, MethodClass};
use whisker::frames::{Base, Pose, World};

/// Measurement noise.
const NOISE_N_M: f64 = 3e-7;

/// Duration of the recording.
const DURATION_S: f64 = 1.4;

const QUIET: Disturbance = Disturbance { lost: 0.0, jitter_s: 0.0, swapped: 0.0 };

/// Recording of the world with noisy readings.
struct Sweep {
    knowledge: Arc<Knowledge>,
    recording: Recording,
    readings_n_m: Vec<f64>,
}

impl Sweep {
    fn new(seed: u64) -> Self {
        Self::lasting(seed, DURATION_S)
    }

    /// The recording of this duration.
    fn lasting(seed: u64, duration_s: f64) -> Self {
        let knowledge = world::knowledge(NOISE_N_M);
        let samples = world::samples(&knowledge, duration_s, |_| true).into_iter();
        let rows = samples.map(|(t_s, sample)| (t_s, world::base(t_s), sample.reading_n_m));
        Self::of(seed, &knowledge, rows)
    }

    /// A recording with these times, poses and readings without noise.
    fn of(seed: u64, knowledge: &Arc<Knowledge>, rows: impl Iterator<Item = (f64, Pose<Base, World>, f64)>) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let (mut instants, mut readings_n_m) = (Vec::new(), Vec::new());
        for (t_s, base, moment_z_n_m) in rows {
            let noise: f64 = rng.sample(StandardNormal);
            instants.push(Instant { t_s, base, twist: None, moment_z_n_m, rotation_z_rad: None });
            readings_n_m.push(moment_z_n_m + NOISE_N_M * noise);
        }
        Self { knowledge: knowledge.clone(), recording: Recording { instants }, readings_n_m }
    }

    fn messages(&self, disturbance: &Disturbance, seed: u64) -> Vec<Message> {
        messages(&[(&self.recording, &self.readings_n_m)], disturbance, seed)
    }

    fn replayed(&self, row: &'static EstimatorRow) -> Vec<Option<Estimate>> {
        build(row, &self.knowledge)().unwrap().run(&samples(&self.recording, &self.readings_n_m))
    }

    fn live(&self, row: &'static EstimatorRow, timing: Timing) -> LiveEstimator {
        let looks_back = row.class == MethodClass::Hindsight;
        LiveEstimator::new(Box::new(build(row, &self.knowledge)), &self.knowledge, looks_back, timing).unwrap()
    }
}

fn build(
    row: &'static EstimatorRow,
    knowledge: &Arc<Knowledge>,
) -> impl Fn() -> anyhow::Result<estimators::Estimator> + Send + use<> {
    let knowledge = knowledge.clone();
    move || Ok(world::estimator(row, &knowledge, 1))
}

fn ekf() -> &'static EstimatorRow {
    estimators::estimator("ekf").unwrap()
}

/// Answers and events of a stream.
fn played(live: LiveEstimator, messages: &[Message]) -> (Vec<Answer>, Vec<Event>, LiveEstimator) {
    let (mut live, mut all) = ([live], Output::default());
    let take = |_: usize, out: &mut Output| {
        all.answers.append(&mut out.answers);
        all.events.append(&mut out.events);
        Ok(())
    };
    play(&mut live, messages, |_| true, take).unwrap();
    let [live] = live;
    (all.answers, all.events, live)
}

fn estimates(answers: &[Answer]) -> Vec<Option<Estimate>> {
    answers.iter().map(|answer| answer.estimate).collect()
}

/// Number of answers with a status.
fn count(answers: &[Answer], status: Status) -> usize {
    answers.iter().filter(|answer| answer.status == status).count()
}

#[test]
fn verif_without_delays_every_estimator_gives_the_estimates_of_a_replay() {
    let sweep = Sweep::new(1);
    let messages = sweep.messages(&QUIET, 1);
    for row in ESTIMATORS {
        let (answers, events, live) = played(sweep.live(row, Timing::default()), &messages);
        assert_eq!(estimates(&answers), sweep.replayed(row), "{}", row.name);
        assert!(events.is_empty() && live.counters().matched == sweep.readings_n_m.len() as u64);
        assert!(answers.windows(2).all(|pair| pair[0].t_s < pair[1].t_s));
        assert!(live.counters().estimates > 100, "{}", row.name);
    }
}

#[test]
fn verif_whiskers_do_not_influence_one_another() {
    let sweeps = [Sweep::new(1), Sweep::new(2)];
    let recordings: Vec<_> = sweeps.iter().map(|sweep| (&sweep.recording, &sweep.readings_n_m[..])).collect();
    let mut live = sweeps.each_ref().map(|sweep| sweep.live(ekf(), Timing::default()));
    let mut answers = [Vec::new(), Vec::new()];
    let take = |whisker: usize, out: &mut Output| {
        answers[whisker].append(&mut out.answers);
        Ok(())
    };
    play(&mut live, &messages(&recordings, &QUIET, 1), |_| true, take).unwrap();
    for (sweep, answers) in sweeps.iter().zip(&answers) {
        assert_eq!(estimates(answers), sweep.replayed(ekf()));
    }
}

#[test]
fn verif_poses_that_are_late_within_the_wait_change_no_estimate() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if let Content::Pose(_) = message.content {
            message.at_s += 0.03;
        }
    }
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let (answers, events, _) = played(sweep.live(ekf(), Timing::default()), &messages);
    assert!(events.is_empty());
    assert_eq!(estimates(&answers), sweep.replayed(ekf()));
}

#[test]
fn verif_poses_at_other_times_are_interpolated() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if let Content::Pose(pose) = &mut message.content {
            message.t_s += 1.7e-3;
            message.at_s = message.t_s;
            *pose = world::base(message.t_s);
        }
    }
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let (answers, ..) = played(sweep.live(ekf(), Timing::default()), &messages);
    let replayed = sweep.replayed(ekf());
    let pairs = answers[1..].iter().zip(&replayed[1..]).skip(200);
    let off_m = pairs.filter_map(|(answer, other)| Some(answer.estimate?.contact.distance(&other.as_ref()?.contact)));
    let worst_m = off_m.fold(0.0, f64::max);
    assert!(worst_m > 0.0 && worst_m < 2e-5, "{worst_m} m");
}

/// Distances of the estimated contacts from the true one (m), from a time on.
fn errors_m(answers: &[Answer], from_s: f64) -> Vec<f64> {
    let late = answers.iter().filter(|answer| answer.t_s > from_s);
    late.filter_map(|answer| Some(answer.base?.apply(answer.estimate?.contact).distance(&world::contact()))).collect()
}

/// RMS distance of the estimated contacts of the last half second from the true one (m).
fn rmse_m(answers: &[Answer]) -> f64 {
    let errors_m = errors_m(answers, DURATION_S - 0.5);
    (errors_m.iter().map(|error_m| error_m * error_m).sum::<f64>() / errors_m.len() as f64).sqrt()
}

#[test]
fn robust_losses_jitter_and_disorder_hardly_increase_the_error() {
    let disturbance = Disturbance { lost: 0.05, jitter_s: 0.02, swapped: 0.01 };
    let (mut quiet_m2, mut disturbed_m2) = (0.0, 0.0);
    for seed in 1..=24 {
        let sweep = Sweep::new(seed);
        let of = |disturbance| played(sweep.live(ekf(), Timing::default()), &sweep.messages(disturbance, seed));
        let (answers, _, live) = of(&disturbance);
        let counters = live.counters();
        let unused = counters.late + counters.stale;
        assert!(counters.missing > 0 && counters.readings >= counters.matched + counters.stale, "{counters}");
        assert!(unused < counters.readings / 20 && counters.repeated + counters.jumps == 0, "{counters}");
        assert_eq!(answers.len() as u64, counters.readings);
        quiet_m2 += rmse_m(&of(&QUIET).0).powi(2);
        disturbed_m2 += rmse_m(&answers).powi(2);
    }
    let growth = (disturbed_m2 / quiet_m2).sqrt();
    assert!(growth < 1.1, "{growth}");
}

#[test]
fn robust_repeated_messages_are_counted_and_change_nothing() {
    let sweep = Sweep::new(1);
    let messages: Vec<Message> = sweep.messages(&QUIET, 1).into_iter().flat_map(|message| [message; 2]).collect();
    let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    let used: Vec<Answer> = answers.iter().filter(|answer| answer.status == Status::Used).copied().collect();
    assert_eq!(estimates(&used), sweep.replayed(ekf()));
    assert_eq!(count(&answers, Status::Repeated), used.len());
    assert!(events.is_empty() && live.counters().repeated == 2 * used.len() as u64);
}

#[test]
fn robust_overtaken_readings_are_used_if_there_is_time_to_wait() {
    let sweep = Sweep::new(1);
    let is_pose = |message: &Message| matches!(message.content, Content::Pose(_));
    let swapped = sweep.messages(&Disturbance { swapped: 0.05, ..QUIET }, 3);
    let mut messages: Vec<Message> = sweep.messages(&QUIET, 1).into_iter().filter(is_pose).collect();
    messages.extend(swapped.into_iter().filter(|message| !is_pose(message)));
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let (answers, _, live) = played(sweep.live(ekf(), Timing { reorder_s: 0.02, ..Timing::default() }), &messages);
    assert!(live.counters().overtaken > 10 && live.counters().late == 0, "{}", live.counters());
    assert_eq!(estimates(&answers), sweep.replayed(ekf()));
    let (answers, _, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    assert!(live.counters().late > 5 && count(&answers, Status::Late) > 5, "{}", live.counters());
}

/// The messages with other times of the arrivals of readings.
fn with_arrivals(sweep: &Sweep, arrival_s: impl Fn(f64) -> f64) -> Vec<Message> {
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if let Content::Reading(_) = message.content {
            message.at_s = arrival_s(message.t_s);
        }
    }
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    messages
}

#[test]
fn regress_readings_that_are_delayed_or_sent_in_batches_are_used() {
    let sweep = Sweep::new(1);
    let replayed = sweep.replayed(ekf());
    let batches = |t_s: f64| 0.2 * (t_s / 0.2).floor() + 0.2;
    let delayed = |t_s: f64| t_s + 0.3;
    let arrivals: [&dyn Fn(f64) -> f64; 2] = [&batches, &delayed];
    for arrival_s in arrivals {
        let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &with_arrivals(&sweep, arrival_s));
        assert!(events.is_empty() && live.counters().late == 0, "{events:?} {}", live.counters());
        assert_eq!(estimates(&answers), replayed);
        assert!(live.counters().remarks().is_empty(), "{:?}", live.counters().remarks());
    }
}

#[test]
fn regress_readings_on_another_clock_than_the_poses_are_noted() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if let Content::Pose(_) = message.content {
            message.t_s += 1.7e9;
        }
    }
    let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    assert_eq!(count(&answers, Status::Stale), answers.len());
    assert!(matches!(events[..], [Event::Stale { lack: Some(Lack::BeforeAll { .. }), .. }]), "{events:?}");
    assert!(events[0].to_string().contains("compare the clocks of readings and poses"), "{}", events[0]);
    let remarks = live.counters().remarks();
    assert!(remarks.len() == 1 && remarks[0].contains("compare the clocks"), "{remarks:?}");
}

#[test]
fn robust_a_sender_that_hangs_is_no_jump_of_its_clock() {
    let sweep = Sweep::new(1);
    // A reading and a pose are stamped, and sent 0.2 s later; the messages in between are missing.
    let hangs_s = sweep.recording.instants[CHANGE].t_s;
    let mut messages = sweep.messages(&QUIET, 1);
    messages.retain(|message| !(hangs_s + 0.002..hangs_s + 0.2).contains(&message.t_s));
    for message in &mut messages {
        if message.t_s == hangs_s {
            message.at_s += 0.2;
        }
    }
    messages.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    assert!(events.is_empty() && live.counters().jumps == 0, "{events:?}");
    let last = answers.last().unwrap();
    assert!(last.estimate.is_some() && errors_m(&answers, hangs_s + 0.3).iter().all(|error_m| *error_m < 1e-3));
}

#[test]
fn robust_notes_on_missing_poses_name_the_setting() {
    let sweep = Sweep::new(1);
    let noted = |is_kept: fn(f64) -> bool| {
        let mut messages = sweep.messages(&QUIET, 1);
        messages.retain(|message| matches!(message.content, Content::Reading(_)) || is_kept(message.t_s));
        let (_, events, _) = played(sweep.live(ekf(), Timing { wait_s: 0.5, ..Timing::default() }), &messages);
        events.first().map(ToString::to_string).unwrap_or_default()
    };
    let gap = noted(|t_s| !(0.5..0.7).contains(&t_s));
    assert!(gap.contains("0.204 s apart, more than --gap (gap_s of a mapping)"), "{gap}");
    let none = noted(|t_s| t_s < 0.5);
    assert!(none.contains("within --wait (wait_s of a mapping), the newest of 0.496 s"), "{none}");
}

/// Rows of a sensor that holds its reading for half a second while the whisker touches.
const HELD: std::ops::Range<usize> = 200..325;

#[test]
fn robust_a_frozen_sensor_costs_its_readings_alone() {
    let (mut quiet_m2, mut frozen_m2) = (0.0, 0.0);
    for seed in 1..=8 {
        let mut sweep = Sweep::lasting(seed, 2.4);
        let errors_of = |sweep: &Sweep| {
            let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &sweep.messages(&QUIET, 1));
            let errors_m = errors_m(&answers, 1.4);
            assert!(errors_m.len() > 240, "{}", errors_m.len());
            (answers, events, live, errors_m.iter().map(|error_m| error_m * error_m).sum::<f64>())
        };
        let (_, events, live, squares_m2) = errors_of(&sweep);
        assert!(events.is_empty() && live.counters().frozen == 0, "{events:?}");
        quiet_m2 += squares_m2;
        let held_n_m = sweep.readings_n_m[HELD.start];
        sweep.readings_n_m[HELD].fill(held_n_m);
        let (answers, events, live, squares_m2) = errors_of(&sweep);
        frozen_m2 += squares_m2;
        let [Event::Frozen { count: found, .. }, Event::Thawed { t_s }] = events[..] else { panic!("{events:?}") };
        assert!((5..15).contains(&found), "{found}");
        assert_eq!(t_s, sweep.recording.instants[HELD.end].t_s);
        let left_out = count(&answers, Status::Frozen);
        assert_eq!((left_out, live.counters().frozen), (HELD.len() + 1 - found as usize, left_out as u64));
        assert!(live.counters().remarks().iter().any(|remark| remark.contains("stay the same")));
        // Until they are found, the base moves little.
        let worst_m = errors_m(&answers, 0.7).into_iter().fold(0.0, f64::max);
        assert!(worst_m < 2e-3, "{worst_m} m");
    }
    let growth = (frozen_m2 / quiet_m2).sqrt();
    assert!(growth < 1.3, "{growth}");
}

/// First row of the changed part of a recording: the whisker touches before and after it.
const CHANGE: usize = 200;

/// The messages with the times of those from [`CHANGE`] on shifted.
fn shifted(sweep: &Sweep, by_s: f64, is_meant: impl Fn(&Content) -> bool) -> Vec<Message> {
    let from_s = sweep.recording.instants[CHANGE].t_s;
    let mut messages = sweep.messages(&QUIET, 1);
    for message in &mut messages {
        if message.at_s >= from_s && is_meant(&message.content) {
            message.t_s += by_s;
        }
    }
    messages
}

#[test]
fn robust_a_jump_of_the_clock_restarts_the_estimator() {
    let sweep = Sweep::new(1);
    for (by_s, lost) in [(100.0, 0), (0.3, 0), (-0.5017, 4)] {
        let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &shifted(&sweep, by_s, |_| true));
        assert!(matches!(events[..], [Event::Jumped { .. }]), "{by_s}: {events:?}");
        assert_eq!(live.counters().jumps, 1);
        assert_eq!(count(&answers, Status::Late), lost, "{by_s}");
        // From the jump on it is an estimator that has just been started.
        let first = CHANGE + lost;
        let fresh = Sweep {
            knowledge: sweep.knowledge.clone(),
            recording: Recording { instants: sweep.recording.instants[first..].to_vec() },
            readings_n_m: sweep.readings_n_m[first..].to_vec(),
        };
        let replayed = fresh.replayed(ekf());
        assert!(replayed.iter().flatten().count() > 50);
        for (answer, other) in answers[first..].iter().zip(&replayed) {
            assert_eq!(answer.estimate.is_some(), other.is_some());
            let off_m = answer.estimate.zip(*other).map_or(0.0, |(a, b)| a.contact.distance(&b.contact));
            assert!(off_m < 1e-9, "{by_s}: {off_m} m");
        }
    }
}

#[test]
fn robust_times_in_milliseconds_are_named() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    messages.iter_mut().for_each(|message| message.t_s *= 1e3);
    let (_, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    // One such jump may be that of a clock which was set.
    let named: Vec<bool> = events.iter().take(4).map(|event| event.to_string().contains("milliseconds")).collect();
    assert_eq!(named, [false, false, true, true], "{events:?}");
    let remarks = live.counters().remarks();
    assert!(remarks[0].contains("the times look like milliseconds; state them in seconds"), "{remarks:?}");
}

#[test]
fn robust_a_jump_in_a_light_contact_keeps_the_rest_reading() {
    // The whisker is free, touches lightly while the clock jumps, and presses then.
    let base = |t_s: f64| {
        let ramp = |from_s: f64, to_s: f64| ((t_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        Pose::new(0.0, -1e-3 + 1.5e-3 * ramp(0.2, 0.4) + 4e-3 * ramp(1.2, 1.5), 0.03 * ramp(1.5, 1.8))
    };
    let knowledge = world::knowledge(NOISE_N_M);
    let row = |row: u32| {
        let base = base(f64::from(row) / world::RATE_HZ);
        let predicted = knowledge.faces[0].predict(base.inverse().apply(world::contact()));
        (f64::from(row) / world::RATE_HZ, base, predicted.map_or(0.0, |predicted| predicted.reading_n_m))
    };
    let sweep = Sweep::of(1, &knowledge, (0..500).map(row));
    let largest_n_m = sweep.knowledge.faces[0].largest_reading_n_m;
    let share = sweep.recording.instants[CHANGE].moment_z_n_m.abs() / largest_n_m;
    assert!((0.01..0.029).contains(&share), "{share}: as large as an offset may be");
    let error_m = |messages: &[Message]| {
        let (answers, events, _) = played(sweep.live(ekf(), Timing::default()), messages);
        let answered = answers.len() == sweep.readings_n_m.len();
        assert!(answered && events.len() < 2);
        let errors_m = errors_m(&answers[answers.len() - 30..], 0.0);
        assert_eq!(errors_m.len(), 30);
        errors_m.into_iter().fold(0.0, f64::max)
    };
    let (quiet_m, jumped_m) = (error_m(&sweep.messages(&QUIET, 1)), error_m(&shifted(&sweep, 100.0, |_| true)));
    assert!(jumped_m < quiet_m + 1e-3, "{jumped_m} m, {quiet_m} m without a jump");
}

/// Asserts that a jump of the clock of one stream is found and that no contact is estimated after it.
fn jump_of(stream: Stream, by_s: f64, is_meant: impl Fn(&Content) -> bool) {
    let sweep = Sweep::new(1);
    let (answers, events, _) = played(sweep.live(ekf(), Timing::default()), &shifted(&sweep, by_s, is_meant));
    let is_jump = |event: &&Event| matches!(event, Event::Jumped { stream: of, .. } if *of == stream);
    assert_eq!(events.iter().filter(is_jump).count(), 1, "{by_s}, {stream}: {events:?}");
    assert!(answers[CHANGE..].iter().all(|answer| answer.estimate.is_none()), "{by_s}, {stream}");
}

#[test]
fn robust_a_jump_of_one_of_two_clocks_gives_no_contact() {
    for by_s in [-0.5017, 0.3] {
        jump_of(Stream::Readings, by_s, |content| matches!(content, Content::Reading(_)));
        jump_of(Stream::Poses, by_s, |content| matches!(content, Content::Pose(_)));
    }
}

#[test]
fn robust_stale_poses_stop_the_estimates_within_a_tenth_of_a_second() {
    let sweep = Sweep::new(1);
    let gone_s = sweep.recording.instants[CHANGE].t_s;
    let back_s = gone_s + 0.4;
    let mut messages = sweep.messages(&QUIET, 1);
    messages
        .retain(|message| matches!(message.content, Content::Reading(_)) || !(gone_s..back_s).contains(&message.t_s));
    let (now_s, mut told_s) = (Cell::new(0.0), Vec::new());
    let mut answers: Vec<(f64, Answer)> = Vec::new();
    let pace = |at_s: f64| {
        now_s.set(at_s);
        true
    };
    let take = |_: usize, out: &mut Output| {
        told_s.extend(out.events.drain(..).map(|event| (now_s.get(), event)));
        answers.extend(out.answers.drain(..).map(|answer| (now_s.get(), answer)));
        Ok(())
    };
    let mut live = [sweep.live(ekf(), Timing::default())];
    play(&mut live, &messages, pace, take).unwrap();
    let last_pose_s = sweep.recording.instants[CHANGE - 1].t_s;
    assert!(
        matches!(told_s[..], [(stale_s, Event::Stale { .. }), (_, Event::Recovered { .. })] if stale_s - last_pose_s < 0.1),
        "{told_s:?}"
    );
    let in_the_gap = |t_s: f64| t_s > last_pose_s && t_s < back_s;
    for (at_s, answer) in &answers {
        assert!(at_s - answer.t_s < 0.1, "answered after {} s", at_s - answer.t_s);
        if in_the_gap(answer.t_s) {
            assert!(answer.status == Status::Stale && answer.estimate.is_none(), "{answer:?}");
        }
    }
    let again = answers.iter().filter(|(_, answer)| answer.t_s >= back_s && answer.estimate.is_some()).count();
    assert!(again > 30, "{again}");
    assert_eq!(live[0].counters().stale_intervals, 1);
}

#[test]
fn robust_values_that_are_not_finite_are_left_out_and_counted() {
    let sweep = Sweep::new(1);
    let mut messages = sweep.messages(&QUIET, 1);
    let at = |content: fn(&Content) -> bool| {
        messages.iter().position(|message| message.t_s > 1.0 && content(&message.content)).unwrap()
    };
    let (reading, pose) = (at(|of| matches!(of, Content::Reading(_))), at(|of| matches!(of, Content::Pose(_))));
    messages[reading].content = Content::Reading(f64::NAN);
    messages[pose].content = Content::Pose(Pose::new(0.0, f64::INFINITY, 0.0));
    messages[pose + 4].t_s = f64::NAN;
    let (answers, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
    assert_eq!(live.counters().not_finite, 3);
    assert!(events.len() == 3 && events.iter().all(|event| matches!(event, Event::NotFinite { .. })), "{events:?}");
    assert!(
        answers.iter().filter_map(|answer| answer.estimate).all(|of| of.contact.vector().iter().all(|x| x.is_finite()))
    );
    let off_m = answers
        .last()
        .unwrap()
        .estimate
        .unwrap()
        .contact
        .distance(&sweep.replayed(ekf()).last().unwrap().unwrap().contact);
    assert!(off_m < 1e-4, "{off_m} m");
}

#[test]
fn robust_timing_out_of_range_is_refused() {
    let sweep = Sweep::new(1);
    let timing = Timing { wait_s: -1.0, ..Timing::default() };
    let error =
        LiveEstimator::new(Box::new(build(ekf(), &sweep.knowledge)), &sweep.knowledge, false, timing).err().unwrap();
    assert_eq!(error.to_string(), "wait: found -1 s, expected 0 to 10 s");
}

#[test]
fn robust_poses_in_another_unit_are_noted_once_and_counted() {
    let sweep = Sweep::new(1);
    let changed = |change: fn(Pose<Base, World>) -> Pose<_, _>| {
        let mut messages = sweep.messages(&QUIET, 1);
        for message in &mut messages {
            if let Content::Pose(pose) = &mut message.content {
                *pose = change(*pose);
            }
        }
        let (_, events, live) = played(sweep.live(ekf(), Timing::default()), &messages);
        (events.iter().filter(|event| matches!(event, Event::Fast { .. })).count(), live.counters().fast)
    };
    assert_eq!(changed(|pose| pose), (0, 0));
    let (events, fast) = changed(|pose| Pose::new(1e3 * pose.origin().x(), 1e3 * pose.origin().y(), pose.yaw_rad()));
    assert!(events == 1 && fast > 20, "{events} {fast}");
}
