use super::*;
use crate::elastica::{Circle, Elastica};
use crate::estimators::extended::Extended;
use crate::estimators::motion::Round;
use crate::estimators::testing::knowledge;
use crate::frames::{Point, World};
use crate::sensor::Face;

/// The first touch of the left face.
fn touch(knowledge: &Knowledge, before: Pose<Base, Start>) -> Touch<'_> {
    Touch { face: &knowledge.faces[0], history: &[], free_s: 0.0, before, contact_prior: None, seed: 0 }
}

/// A follower of any round object.
type AnyRound = Follower<Extended, Round, 4>;

/// The follower at its first touch.
fn begun(knowledge: &Knowledge) -> AnyRound {
    let touch = touch(knowledge, Pose::new(0.0, 0.0, 0.0));
    let motion = Round::of_any_scale().beyond_pin(touch.face);
    Follower::new(Config::<Extended>::round(), motion, &touch, knowledge)
}

/// A thin object that deflects the whisker at an arc length.
fn thin(knowledge: &Knowledge, arc_m: f64) -> Circle {
    Circle { center: Point::from_vector(knowledge.rest.beside(arc_m, -4e-3).vector()), radius_m: 1e-4 }
}

/// A base that moves to and fro.
fn base(i: usize) -> Pose<Base, World> {
    let t = i as f64 / 15.0;
    Pose::new(2e-3 * (t.cos() - 1.0), 1.5e-3 * t.sin(), 0.02 * (2.0 * t).sin())
}

fn noise_n_m(knowledge: &Knowledge, i: usize) -> f64 {
    knowledge.noise_sd_n_m * [0.6, -1.2, 0.1, 1.5, -0.4, -0.9, 1.0, -0.7][i % 8]
}

/// Errors of a contact that jumps from one thin object to another after 150 samples and back after 300. With `told`, the follower
/// learns at the first jump where the contact has gone.
fn errors_m(jumps: bool, told: bool) -> Vec<f64> {
    let knowledge = knowledge();
    let elastica = Elastica::new(&knowledge.whisker).unwrap();
    let (one, other) = (thin(&knowledge, 0.058), thin(&knowledge, 0.045));
    let mut follower = begun(&knowledge);
    if jumps {
        follower.expect_jumps(true);
    }
    let step = |i: usize| {
        let circle = if (150..300).contains(&i) { &other } else { &one };
        let exact = elastica.against(circle, &base(i), Face::Left).unwrap().unwrap().deflection;
        let motion = base(i.saturating_sub(1)).then(&base(i).inverse());
        let sample = Sample { motion, dt_s: 4e-3, reading_n_m: exact.moment_n_m + noise_n_m(&knowledge, i) };
        if told && i == 150 {
            follower.expect_return(motion.inverse().apply(exact.point));
        }
        follower.step(&sample).map_or(f64::INFINITY, |estimate| estimate.contact.distance(&exact.point))
    };
    (0..330).map(step).collect()
}

fn worst_m(errors_m: &[f64]) -> f64 {
    errors_m.iter().copied().fold(0.0, f64::max)
}

#[test]
fn verif_a_place_of_which_the_follower_is_told_is_a_hypothesis_only_if_jumps_are_expected() {
    let [told, sought] = [true, false].map(|told| errors_m(true, told));
    assert_eq!(told[..150], sought[..150]);
    assert!(worst_m(&told[155..300]) < 0.5e-3, "{:?}", &told[150..170]);
    assert!(worst_m(&sought[155..300]) > 1e-3, "{:?}", &sought[150..170]);
    assert_eq!(errors_m(false, true), errors_m(false, false));
}

#[test]
fn verif_a_return_to_a_place_that_was_left_is_found_within_a_few_samples() {
    let [found, sought] = [true, false].map(|jumps| errors_m(jumps, false));
    assert!(worst_m(&found[140..150]) < 0.2e-3, "{:?}", &found[140..150]);
    assert!(worst_m(&found[290..300]) < 0.2e-3, "{:?}", &found[290..300]);
    // The first jump leads to a place that is not known.
    assert_eq!(found[..300], sought[..300]);
    assert!(worst_m(&found[310..]) < 0.3e-3, "{:?}", &found[300..]);
    assert!(worst_m(&sought[310..]) > 1e-3, "{:?}", &sought[300..]);
}

/// Samples of a thin object on which the whisker slides while the base retreats by `way_m` along the whisker's tangent and
/// returns. Beyond the tip the reading stays constant, as where the tip itself rests on an object.
fn drawn_back(knowledge: &Knowledge, way_m: f64, count: usize) -> Vec<Sample> {
    let elastica = Elastica::new(&knowledge.whisker).unwrap();
    let thin = thin(knowledge, 0.062);
    let share = |i: usize| 1.0 - (2.0 * i as f64 / count as f64 - 1.0).abs();
    let back = -knowledge.rest.tangent(0.07);
    let base = |i: usize| -> Pose<Base, World> {
        let at = back * (way_m * share(i));
        Pose::new(at.x, at.y, 0.0)
    };
    let mut reading_n_m = 0.0;
    let mut sample = |i: usize| {
        if let Ok(Some(exact)) = elastica.against(&thin, &base(i), Face::Left) {
            reading_n_m = exact.deflection.moment_n_m;
        }
        Sample { motion: base(i.saturating_sub(1)).then(&base(i).inverse()), dt_s: 4e-3, reading_n_m }
    };
    (0..count).map(&mut sample).collect()
}

#[test]
fn verif_past_the_tip_there_is_no_estimate_until_the_contact_is_on_the_side_again() {
    let knowledge = knowledge();
    let mut follower = begun(&knowledge);
    let samples = drawn_back(&knowledge, 40e-3, 400);
    let stated: Vec<bool> = samples.iter().map(|sample| follower.step(sample).is_some()).collect();
    assert!(stated[..80].iter().all(|&is| is), "{stated:?}");
    // The tip is reached after 84 samples; the base turns back after 200, and the contact is on the side again after 316.
    assert!(stated[100..316].iter().all(|&is| !is) && stated[330..].iter().all(|&is| is), "{stated:?}");
}

#[test]
fn verif_past_the_tip_a_reading_that_contradicts_the_belief_gives_no_estimate_until_the_next_touch() {
    let knowledge = knowledge();
    let mut follower = begun(&knowledge);
    let samples = drawn_back(&knowledge, 40e-3, 400);
    // The tip rests on the object all the way back, with another reading than a contact on the side would have.
    let beyond_n_m = 0.5 * samples[200].reading_n_m;
    let held = |(i, sample): (usize, &Sample)| Sample {
        reading_n_m: if i < 200 { sample.reading_n_m } else { beyond_n_m },
        ..*sample
    };
    let stated: Vec<bool> = samples.iter().enumerate().map(|sample| follower.step(&held(sample)).is_some()).collect();
    let last = stated.iter().rposition(|&is| is).unwrap();
    assert!((80..100).contains(&last) && follower.is_past_tip, "{last}");
    // By then the belief predicts a contact on the side again.
    let belief = follower.bank.as_ref().unwrap().most_probable().unwrap().belief;
    assert!(!follower.side.is_tip(AlongAway::of_state(&belief.mean)));
    assert!(follower.resume(&touch(&knowledge, follower.base)) && !follower.is_past_tip);
    assert!(follower.step(&samples[0]).is_some());
}

/// A follower of the contact with a thin object at rest after 150 samples, and the contacts and readings at all samples.
fn settled(knowledge: &Knowledge) -> (AnyRound, impl Fn(usize) -> (Point<Base>, f64)) {
    let (elastica, thin) = (Elastica::new(&knowledge.whisker).unwrap(), thin(knowledge, 0.058));
    let exact = move |i: usize| {
        let found = elastica.against(&thin, &base(i), Face::Left).unwrap().unwrap().deflection;
        (found.point, found.moment_n_m)
    };
    let mut follower = begun(knowledge);
    for i in 0..=150_usize {
        let motion = base(i.saturating_sub(1)).then(&base(i).inverse());
        follower.step(&Sample { motion, dt_s: 4e-3, reading_n_m: exact(i).1 });
    }
    (follower, exact)
}

/// The pose in the frame of the start, which is that of World here.
fn in_start(pose: Pose<Base, World>) -> Pose<Base, Start> {
    Pose::new(pose.origin().x(), pose.origin().y(), pose.yaw_rad())
}

#[test]
fn verif_a_touch_of_the_known_object_is_expected_before_it_is_detected() {
    let knowledge = knowledge();
    let (mut follower, exact) = settled(&knowledge);
    let mut expected = |pose: Pose<Base, World>, free_s: f64, reading_n_m: f64| {
        follower.expect_touch(&Undetected { base: in_start(pose), free_s, dt_s: 4e-3, reading_n_m })
    };
    let noise_n_m = |i| noise_n_m(&knowledge, i);
    // The whisker is in front of the object, at a distance of a millimetre.
    let in_front = Pose::new(0.0, -5e-3, 0.0);
    assert!((0..50).all(|i| expected(in_front, 4e-3 * i as f64, noise_n_m(i)).is_none()));
    // The object is not there any more.
    assert!((0..50).all(|i| expected(base(i), 0.2, noise_n_m(i)).is_none()));
    let touches: Vec<_> = (151..180).map(|i| (expected(base(i), 0.4, exact(i).1 + noise_n_m(i)), exact(i).0)).collect();
    for (estimate, contact) in &touches[5..] {
        assert!(estimate.is_some_and(|estimate| estimate.contact.distance(contact) < 0.2e-3), "{estimate:?}");
    }
    assert!(expected(in_front, 0.6, 0.0).is_none());
}

#[test]
fn verif_a_touch_that_was_expected_begins_with_the_known_object() {
    let knowledge = knowledge();
    let worst_m = |is_expected: bool| {
        let (mut follower, exact) = settled(&knowledge);
        for i in 151..160 {
            let reading_n_m = if is_expected { exact(i).1 } else { 0.0 };
            let free_s = 4e-3 * (i - 150) as f64;
            follower.expect_touch(&Undetected { base: in_start(base(i)), free_s, dt_s: 4e-3, reading_n_m });
        }
        let touch = Touch { free_s: 36e-3, ..touch(&knowledge, in_start(base(159))) };
        assert!(follower.resume(&touch));
        let motion = base(159).then(&base(160).inverse());
        let estimate = follower.step(&Sample { motion, dt_s: 4e-3, reading_n_m: exact(160).1 }).unwrap();
        estimate.covariance_m2.unwrap().trace().sqrt()
    };
    assert!(worst_m(true) < 0.3 * worst_m(false), "{} {}", worst_m(true), worst_m(false));
}

#[test]
fn regress_a_contact_that_was_lost_is_regained_where_the_readings_agree_with_it() {
    let knowledge = knowledge();
    let (mut follower, exact) = settled(&knowledge);
    follower.is_lost = true;
    let mut step = |i: usize, reading_n_m: f64| {
        follower.step(&Sample { motion: base(i - 1).then(&base(i).inverse()), dt_s: 4e-3, reading_n_m })
    };
    assert!((151..200).all(|i| step(i, 0.0).is_none()));
    let regained: Vec<_> = (200..230).map(|i| (step(i, exact(i).1), exact(i).0)).collect();
    for (estimate, contact) in &regained[5..] {
        assert!(estimate.is_some_and(|estimate| estimate.contact.distance(contact) < 0.2e-3), "{estimate:?}");
    }
}
