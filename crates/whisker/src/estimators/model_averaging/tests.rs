use std::sync::Mutex;

use filters::Innovation;
use nalgebra::{Matrix1, Vector1};

use super::*;
use crate::estimators::block::BlockSettings;
use crate::estimators::second::SecondSettings;
use crate::estimators::side::Side;
use crate::estimators::testing::knowledge;
use crate::estimators::{FrictionCoefficient, Installation, Radius, Uncertain, Velocity};
use crate::sensor::AlongAway;

/// A tracker of two candidates, of which the second is considered, with these probabilities.
fn tracker(shares: [f64; 2], face: &Arc<CalibratedFace>) -> AveragingTracker {
    let config = Config { evidence_power: 0.5, considered_power: 1e-6, ignored_share: 0.02, ..Config::among([]) };
    AveragingTracker {
        config: Arc::new(config),
        considered: vec![false, true],
        face: face.clone(),
        noise_n2_m2: 1e-10,
        weights: shares.to_vec(),
        methods: Arc::new([]),
        trackers: Vec::new(),
        alternative: None,
        right: Modes::new(shares),
        doubtful: Doubtful::default(),
        moves: false,
        signals_motion: false,
        second: Second::default(),
        touched: TouchedPlaces::new(None, face.face),
        has_returned: false,
        base: Pose::new(0.0, 0.0, 0.0),
        last: None,
        off_tip_m2: None,
        blocks: Blocks::new(Pose::new(0.0, 0.0, 0.0), 0.08),
        has_begun: false,
        late: None,
        stated: None,
        continues: false,
    }
}

#[test]
fn verif_a_considered_candidate_widens_the_covariance_and_moves_the_mean_only_if_it_leads() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let at = |x_m: f64| Some(side.estimate_at(Point::new(x_m, 0.0), true, Matrix2::identity() * 1e-8, None));
    let estimates = [at(0.05), at(0.051)];
    let stated = |shares| tracker(shares, &knowledge.faces[0]).together(&estimates, None).unwrap();
    let led = stated([0.6, 0.4]);
    assert_eq!(led.contact, Point::new(0.05, 0.0));
    let covariance_m2 = led.covariance_m2.unwrap();
    assert!((covariance_m2[(0, 0)] - (1e-8 + 0.4 * 1e-6)).abs() < 1e-14, "{covariance_m2}");
    assert!((covariance_m2[(1, 1)] - 1e-8).abs() < 1e-14, "{covariance_m2}");
    let mut led = tracker([0.4, 0.6], &knowledge.faces[0]);
    led.weights = vec![0.6, 0.4];
    let moved = led.together(&estimates, None).unwrap();
    assert!((moved.contact.x() - 0.051).abs() < 1e-12, "{moved:?}");
}

/// A candidate with this outline.
struct Carrier(Option<Vec<OutlinePoint>>);

/// A candidate whose filter has diverged: it has no estimate, and its systematic error is not a number.
struct Diverged;

impl Tracker for Diverged {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn systematic_m2(&self) -> Option<Matrix2<f64>> {
        Some(Matrix2::repeat(f64::NAN))
    }
}

#[test]
fn robust_a_candidate_without_an_estimate_adds_no_systematic_error() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let stated = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
    let mut tracker = tracker([0.999, 0.001], &knowledge.faces[0]);
    tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Diverged)];
    assert_eq!(tracker.with_systematic(stated, &[Some(stated), None]).covariance_m2, stated.covariance_m2);
}

/// A candidate with an outline that readings have contradicted.
struct Refuted(Carrier);

impl Tracker for Refuted {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        self.0.outline()
    }

    fn refutes_convexity(&self) -> bool {
        true
    }
}

#[test]
fn verif_a_refuted_outline_does_not_lead() {
    let knowledge = knowledge();
    let leads = |leading: Box<dyn Tracker>| {
        let mut tracker = tracker([0.9, 0.1], &knowledge.faces[0]);
        tracker.trackers = vec![leading, Box::new(Carrier(None))];
        tracker.outline_leads()
    };
    let carrier = || Carrier(Some(Vec::new()));
    assert!(leads(Box::new(carrier())) && !leads(Box::new(Refuted(carrier()))));
}

#[test]
fn verif_a_candidate_that_never_determines_the_contact_does_not_determine_the_outline() {
    let knowledge = knowledge();
    let leads = |mean_evidence: f64| {
        let mut tracker = tracker([0.4, 0.6], &knowledge.faces[0]);
        tracker.config = Arc::new(Config { mean_evidence, ..Config::among([]) });
        tracker.trackers = vec![Box::new(Carrier(Some(Vec::new()))), Box::new(Carrier(None))];
        tracker.outline_leads()
    };
    assert!(!leads(4.0) && leads(Config::hindsight().mean_evidence));
}

impl Tracker for Carrier {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        self.0.clone()
    }
}

/// A candidate whose object moves.
struct Mover;

impl Tracker for Mover {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn assumes_motion(&self) -> bool {
        true
    }
}

#[test]
fn verif_considered_candidates_do_not_count_for_the_probability_of_motion() {
    let knowledge = knowledge();
    let share = |shares: [f64; 3]| {
        let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
        tracker.right = Modes::new(shares);
        tracker.considered = vec![false, false, true];
        tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Mover), Box::new(Carrier(None))];
        tracker.moving_share()
    };
    // The last candidate is considered.
    assert!((share([0.125, 0.375, 0.5]) - 0.75).abs() < 1e-12 && share([0.0, 0.5, 0.5]) == 1.0);
}

#[test]
fn verif_the_signal_of_motion_lasts_until_a_lower_probability() {
    let mut is_raised = false;
    let mut advance = |share: f64| {
        is_raised = signals_motion(is_raised, share);
        is_raised
    };
    assert!(!advance(0.9999) && advance(1.0 - 1e-7) && advance(0.95) && !advance(0.5) && !advance(0.95));
}

/// A candidate that keeps its posterior from touch to touch.
struct Keeper;

impl Tracker for Keeper {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn resume(&mut self, _: &Touch<'_>) -> bool {
        true
    }
}

/// A method whose candidates have an outline, which shows that they have begun anew.
struct Anew;

impl Method for Anew {
    fn begin(&self, _: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Carrier(Some(Vec::new())))
    }
}

#[test]
fn verif_candidates_at_rest_restart_at_a_new_touch_if_the_object_probably_moves() {
    let knowledge = knowledge();
    let has_restarted = |shares: [f64; 2]| {
        let mut tracker = tracker(shares, &knowledge.faces[0]);
        tracker.considered = vec![false, false];
        tracker.methods = Arc::new([("keeper", Box::new(Anew)), ("mover", Box::new(Anew))]);
        tracker.trackers = vec![Box::new(Keeper), Box::new(Mover)];
        tracker.moves = probably_moves(false, tracker.moving_share());
        tracker.begin_again();
        tracker.trackers[0].outline().is_some()
    };
    assert!(has_restarted([0.05, 0.95]) && !has_restarted([0.6, 0.4]));
}

/// A candidate that shows a contact with the object of the last touch.
struct Expects(Option<Estimate>);

impl Tracker for Expects {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn expect_touch(&mut self, _: &Undetected) -> Option<Estimate> {
        self.0
    }
}

#[test]
fn verif_a_touch_that_was_expected_keeps_the_probabilities() {
    let knowledge = knowledge();
    let face = &knowledge.faces[0];
    let side = Side::new(face, &knowledge);
    let contact = face.contact_at(AlongAway::new(0.055, 3e-3));
    let known = Some(side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None));
    let shares = |expected: Option<Estimate>| {
        let mut tracker = tracker([0.5, 0.5], face);
        tracker.right = Modes::new([0.9, 0.1]);
        tracker.considered = vec![false, false];
        tracker.methods = Arc::new([("one", Box::new(Anew)), ("other", Box::new(Anew))]);
        tracker.trackers = vec![Box::new(Expects(expected)), Box::new(Expects(None))];
        let base = Pose::new(0.0, 0.0, 0.0);
        let stated = tracker.expect_touch(&Undetected { base, free_s: 0.1, dt_s: 4e-3, reading_n_m: 1e-5 });
        assert_eq!(stated.map(|estimate| estimate.contact), expected.map(|_| contact));
        let touch = Touch { face, history: &[], free_s: 0.1, before: base, contact_prior: None, seed: 0 };
        assert!(tracker.resume(&touch));
        tracker.right.probabilities()[0]
    };
    assert_eq!((shares(known), shares(None)), (0.9, 0.7));
}

/// A candidate for a moving object that shows a contact with the object of the last touch.
struct Follows(Expects);

impl Tracker for Follows {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        self.0.expect_touch(undetected)
    }

    fn assumes_motion(&self) -> bool {
        true
    }
}

#[test]
fn regress_the_contact_of_a_moving_object_is_expected_where_it_has_moved_to() {
    let knowledge = knowledge();
    let face = &knowledge.faces[0];
    let side = Side::new(face, &knowledge);
    let at = |arc_m: f64| face.contact_at(AlongAway::new(arc_m, 3e-3));
    let known = |arc_m: f64| Some(side.estimate_at(at(arc_m), true, Matrix2::identity() * 1e-8, None));
    let mut tracker = tracker([0.5, 0.5], face);
    tracker.considered = vec![false, false];
    tracker.methods = Arc::new([("rests", Box::new(Anew)), ("moves", Box::new(Anew))]);
    tracker.trackers = vec![Box::new(Expects(known(0.05))), Box::new(Follows(Expects(known(0.055))))];
    tracker.right = Modes::new([0.1, 0.9]);
    (tracker.moves, tracker.off_tip_m2) = (true, Some(Matrix2::identity() * 1e-6));
    let base = Pose::new(0.0, 0.0, 0.0);
    let undetected = Undetected { base, free_s: 0.1, dt_s: 4e-3, reading_n_m: 1e-5 };
    let stated = tracker.expect_touch(&undetected).unwrap();
    assert_eq!(stated.contact, at(0.055));
    assert!((stated.covariance_m2.unwrap() - Matrix2::identity() * 1.01e-6).norm() < 1e-18);
    let touch = Touch { face, history: &[], free_s: 0.1, before: base, contact_prior: None, seed: 0 };
    assert!(tracker.resume(&touch));
    assert!((tracker.right.probabilities()[1] - 0.7).abs() < 1e-12, "it may have come to rest");
}

#[test]
fn verif_motion_shows_where_candidates_at_rest_are_calibrated() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
    tracker.right = Modes::new([0.1, 0.9]);
    tracker.considered = vec![false, false];
    tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Mover)];
    let calibrated = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
    let outside = Estimate { calibrated: false, ..calibrated };
    assert!(tracker.shows_motion(&[Some(calibrated), None]));
    assert!(!tracker.shows_motion(&[Some(outside), Some(calibrated)]));
    // At the tip there is no estimate.
    assert!(!tracker.shows_motion(&[None, Some(calibrated)]));
}

#[test]
fn verif_the_outline_is_that_of_the_most_probable_candidate_that_carries_one() {
    let knowledge = knowledge();
    let point = OutlinePoint {
        surface: Point::new(0.05, 0.0),
        normal: Vector2::y(),
        covariance_m2: Matrix2::identity() * 1e-10,
    };
    let carried = |shares| {
        let mut tracker = tracker(shares, &knowledge.faces[0]);
        tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Carrier(Some(vec![point])))];
        tracker.last = Some((Point::new(0.05, 1e-3), Matrix2::new(1e-4, 0.0, 0.0, 1e-8)));
        (tracker.outline(), tracker.outline_leads())
    };
    assert_eq!(carried([0.4, 0.6]), (Some(vec![point]), true));
    // The band of another candidate's outline contains the variance of the mixture across the outline, not that along it.
    let (outline, leads) = carried([0.6, 0.4]);
    let covariance_m2 = outline.unwrap()[0].covariance_m2;
    assert!(!leads && (covariance_m2 - Matrix2::new(1e-10, 0.0, 0.0, 1.01e-8)).norm() < 1e-16, "{covariance_m2}");
    // A candidate that does not count for the estimate may give the outline, one that is refuted does not.
    assert!(carried([0.99, 0.01]).0.is_some());
    assert_eq!(carried([1.0 - 1e-7, 1e-7]), (None, false));
}

#[test]
fn verif_radius_and_friction_are_those_of_the_candidates_that_estimate_them() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let thin = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
    let friction = Some(FrictionCoefficient { coefficient: 0.3, sd: 0.05 });
    let round = Estimate { radius: Some(Radius { radius_m: 0.01, sd_m: 1e-3 }), friction, ..thin };
    let mut tracker = tracker([0.9, 0.1], &knowledge.faces[0]);
    tracker.considered = vec![false, false];
    let stated = tracker.together(&[Some(thin), Some(round)], None).unwrap();
    let (radius, found) = (stated.radius.unwrap(), stated.friction.unwrap());
    assert!((found.coefficient - 0.3).abs() < 1e-12 && (found.sd - 0.05).abs() < 1e-12, "{found:?}");
    assert!((radius.radius_m - 0.01).abs() < 1e-12 && (radius.sd_m - 1e-3).abs() < 1e-12, "{radius:?}");
    assert_eq!(tracker.together(&[Some(thin), Some(thin)], None).unwrap().radius, None);
}

/// They hold under their assumption, also while another candidate determines the contact.
#[test]
fn verif_velocity_and_deviation_are_those_of_the_candidates_that_state_them() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let at_rest = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
    let velocity = Velocity { velocity_m_s: Vector2::new(1e-3, -2e-3), covariance_m2_s2: Matrix2::identity() * 1e-8 };
    let deviation = Uncertain { value: 0.02, sd: 0.01 };
    let installation =
        Installation { gain: deviation, mount_rad: deviation, mount_x_m: deviation, mount_y_m: deviation };
    let other = Estimate { velocity: Some(velocity), installation: Some(installation), ..at_rest };
    let mut tracker = tracker([0.9, 0.1], &knowledge.faces[0]);
    let stated = tracker.together(&[Some(at_rest), Some(other)], None).unwrap();
    let found = stated.velocity.unwrap();
    assert!((found.velocity_m_s - velocity.velocity_m_s).norm() < 1e-15, "{found:?}");
    assert!((found.covariance_m2_s2 - velocity.covariance_m2_s2).norm() < 1e-15, "{found:?}");
    assert_eq!(stated.installation, Some(installation));
    // A candidate that is too improbable is ignored.
    tracker.right = Modes::new([1.0, 1e-12]);
    let stated = tracker.together(&[Some(at_rest), Some(other)], None).unwrap();
    assert_eq!((stated.velocity, stated.installation), (None, None));
}

#[test]
fn verif_the_mean_is_shared_at_the_stated_evidence() {
    let knowledge = knowledge();
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let at = |x_m: f64| Some(side.estimate_at(Point::new(x_m, 0.0), true, Matrix2::identity() * 1e-8, None));
    let estimates = [at(0.05), at(0.051)];
    let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
    let config = Config { considered_power: 0.01, mean_power: 0.5, mean_evidence: 4.0, ..(*tracker.config).clone() };
    // Log-likelihood ratio at which the two have equal parts.
    let evidence = config.mean_evidence / config.mean_power;
    tracker.right = Modes::new([1.0, (config.considered_power * evidence).exp()]);
    tracker.config = Arc::new(config);
    let stated = tracker.together(&estimates, None).unwrap();
    assert!((stated.contact.x() - 0.0505).abs() < 1e-12, "{stated:?}");
}

#[test]
fn verif_evidence_has_its_power_within_a_group_and_another_between_them() {
    let knowledge = knowledge();
    let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
    tracker.considered = vec![false, false, true];
    tracker.right = Modes::new([0.3, 0.3, 0.4]);
    let tempered = tracker.tempered(&[Some(0.0), Some(-2.0), Some(5.0)]);
    tracker.right.reweight(&tempered);
    let shares = tracker.right.probabilities();
    assert!((shares[2] - 0.4).abs() < 1e-5, "{shares:?}");
    assert!((shares[0] / shares[1] - 1.0_f64.exp()).abs() < 1e-9, "{shares:?}");
}

/// At residuals of the mean size, a slightly different variance makes no difference to first order.
#[test]
fn verif_overstated_variances_are_no_evidence() {
    let knowledge = knowledge();
    let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
    let innovation = |factor: f64| Innovation::of(Vector1::new(0.5), Matrix1::new(factor)).unwrap();
    for _ in 0..10_000 {
        tracker.doubtful.advance(&tracker.config.doubt, 0.01, Some(innovation(1.0)));
    }
    let gained = tracker.log_evidence(&innovation(0.99)) - tracker.log_evidence(&innovation(1.01));
    assert!(gained.abs() < 1e-5, "{gained}");
}

/// A candidate that states a contact at one place in Base, records the means that it takes, and is surprised by negative readings.
struct Recorder(Arc<Mutex<Vec<(f64, f64)>>>, Estimate);

impl Tracker for Recorder {
    fn step(&mut self, _: &Sample) -> Option<Estimate> {
        None
    }

    fn step_mean(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        self.0.lock().unwrap().push((count, sample.reading_n_m));
        let innovation = Innovation::of(Vector1::new(0.5), Matrix1::new(1.0));
        Some(Estimate { innovation, ..self.1 })
    }

    fn look_ahead(&self, sample: &Sample) -> Ahead {
        Ahead { nis: Some(if sample.reading_n_m < 0.0 { 100.0 } else { 1.0 }), ..Ahead::default() }
    }
}

/// Feeds samples of a base that moves by `WAY_M` a sample until three are collected in a block, and then one that surprises.
/// Returns the blocks that this ends, the estimates of the last two samples, and the place of the recorded contact.
fn blocks_at_a_surprise(alert_s: f64) -> (Vec<(f64, f64)>, [Estimate; 2], Point<Base>) {
    let knowledge = Arc::new(knowledge());
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let contact = knowledge.faces[0].contact_at(AlongAway::new(0.055, 3e-3));
    let at = side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None);
    let row = estimator("ekf").unwrap();
    let taken = Arc::new(Mutex::new(Vec::new()));
    let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
    let block = BlockSettings { samples: 8, alert_s, ..BlockSettings::default() };
    tracker.config = Arc::new(Config { block, ..(*tracker.config).clone() });
    (tracker.considered, tracker.weights, tracker.right) = (vec![false], vec![1.0], Modes::new([1.0]));
    tracker.methods = Arc::new([("ekf", (row.build)(&(row.defaults)(), &knowledge).unwrap())]);
    tracker.trackers = vec![Box::new(Recorder(taken.clone(), at))];
    let sample = |reading_n_m| Sample { motion: Pose::new(-WAY_M, 0.0, 0.0), dt_s: 4e-3, reading_n_m };
    let collected = |fed: u32| f64::from(fed) - taken.lock().unwrap().iter().map(|(count, _)| count).sum::<f64>();
    let mut fed = 0;
    let mut before = None;
    while fed < 60 || collected(fed) < 3.0 {
        before = tracker.step(&sample(1.0));
        fed += 1;
    }
    taken.lock().unwrap().clear();
    let after = tracker.step(&sample(-1.0));
    let taken = taken.lock().unwrap().clone();
    (taken, [before.unwrap(), after.unwrap()], contact)
}

const WAY_M: f64 = 1e-5;

#[test]
fn verif_an_improbable_candidate_takes_the_onset_in_blocks() {
    let knowledge = Arc::new(knowledge());
    let side = Side::new(&knowledge.faces[0], &knowledge);
    let contact = knowledge.faces[0].contact_at(AlongAway::new(0.055, 3e-3));
    let at = side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None);
    let mut tracker = tracker([0.999, 0.001], &knowledge.faces[0]);
    let block = BlockSettings { samples: 4, alert_s: 0.022, ..BlockSettings::default() };
    let config = Config { block, second: SecondSettings::NONE, ..(*tracker.config).clone() };
    (tracker.config, tracker.considered) = (Arc::new(config), vec![false, false]);
    let taken = [(); 2].map(|()| Arc::new(Mutex::new(Vec::new())));
    let recorders = taken.each_ref().map(|taken| Recorder(taken.clone(), at));
    tracker.trackers = recorders.into_iter().map(|recorder| Box::new(recorder) as Box<dyn Tracker>).collect();
    tracker.methods = Arc::new([("one", Box::new(Anew)), ("other", Box::new(Anew))]);
    let sample = Sample { motion: Pose::new(-WAY_M, 0.0, 0.0), dt_s: 4e-3, reading_n_m: 1.0 };
    (0..10).for_each(|_| _ = tracker.step(&sample));
    let counts = taken.map(|taken| taken.lock().unwrap().iter().map(|(count, _)| *count).collect::<Vec<_>>());
    assert_eq!(counts, [vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0], vec![1.0, 5.0, 4.0]]);
}

#[test]
fn verif_a_surprising_sample_ends_the_block_before_it() {
    let (taken, [before, after], contact) = blocks_at_a_surprise(0.1);
    assert_eq!(taken, [(3.0, 1.0), (1.0, -1.0)]);
    // The innovation is that of a block, at its end.
    assert!(before.innovation.is_none() && after.innovation.is_some());
    assert_eq!(after.contact, contact);
}

#[test]
fn verif_within_a_block_the_contact_moves_with_the_base_since_the_last_mean() {
    let (taken, [_, after], contact) = blocks_at_a_surprise(0.0);
    assert_eq!(taken, [(3.0, 1.0)]);
    // The mean of three samples lies two samples before the surprising one.
    assert!((after.contact.x() - (contact.x() - 2.0 * WAY_M)).abs() < 1e-12, "{after:?}");
}

#[test]
fn robust_methods_that_smooth_take_no_blocks() {
    let knowledge = Arc::new(knowledge());
    let config = |samples| {
        let block = BlockSettings { samples, ..BlockSettings::default() };
        serde_json::to_value(Config { block, ..Config::hindsight() }).unwrap()
    };
    assert!(build_hindsight(&config(1), &knowledge).is_ok());
    let refused = build_hindsight(&config(2), &knowledge).err().unwrap().to_string();
    assert!(refused.contains("block.samples"), "{refused}");
    // Settings in part leave the others at the defaults of hindsight.
    let in_part = serde_json::json!({"candidates": [{"name": "batch", "weight": 1.0}]});
    assert!(build_hindsight(&in_part, &knowledge).is_ok());
}

#[test]
fn verif_a_candidate_without_evidence_keeps_its_probability() {
    let knowledge = knowledge();
    let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
    tracker.considered = vec![false, false, false, true];
    tracker.right = Modes::new([0.3, 0.2, 0.1, 0.4]);
    tracker.right.reweight(&tracker.completed(&tracker.tempered(&[None, Some(1.0), Some(3.0), Some(5.0)])));
    let shares = tracker.right.probabilities();
    assert!((shares[0] - 0.3).abs() < 1e-12, "{shares:?}");
    assert!((shares[1] / shares[2] - 2.0 * (-1.0_f64).exp()).abs() < 1e-9, "{shares:?}");
}

#[test]
fn verif_candidates_of_friction_and_motion_do_not_count_by_their_priors() {
    let config = Config::default();
    let most = config.candidates.iter().map(|candidate| candidate.weight).fold(0.0, f64::max);
    for candidate in config.candidates.iter().filter(|candidate| !candidate.considered) {
        let is_rare = ["rubbing", "drifting"].contains(&candidate.name.as_str());
        assert_eq!(candidate.weight < config.ignored_share * most, is_rare, "{}", candidate.name);
    }
}

#[test]
fn verif_an_object_that_moved_still_moves_at_the_next_touch() {
    assert!(!probably_moves(false, 0.5) && probably_moves(false, 0.95));
    // The mean of certainty at the release and a small prior.
    assert!(probably_moves(true, 0.5) && !probably_moves(true, 0.1));
}
