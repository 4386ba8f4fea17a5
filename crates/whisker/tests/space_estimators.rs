//! Estimators in space on exact contacts of the rod: a fixed point, a straight rod, registry and refused settings.

mod space_world;

use std::sync::{Arc, LazyLock};

use filters::quantile::CHI2_3_95;
use nalgebra::{Matrix2, Matrix3, Matrix6, Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde_json::json;
use whisker::Whisker;
use whisker::events::TouchConfig;
use whisker::frames::{Base, World};
use whisker::rod::{Rod, SpatialContact, SpatialDeflection};
use whisker::space::estimators::{Estimate, Knowledge, SPATIAL_ESTIMATORS, Sample, spatial_estimator};
use whisker::space::frames::{Point, Pose};
use whisker::space::sensor::{Around, CalibratedSpace, FittedTouch, KnownContact, Mounting, SpatialErrorMap};

use space_world::{RATE_HZ, knowledge};

const ROWS: u32 = 500;

static STRAIGHT: LazyLock<Arc<Knowledge>> = LazyLock::new(|| knowledge(Whisker::straight()));
static CURVED: LazyLock<Arc<Knowledge>> = LazyLock::new(|| knowledge(Whisker::curved()));

/// Pose of World in Base at a row: a push of 5 mm in 0.5 s, then slow turns and strokes.
fn to_base(row: u32) -> Pose<World, Base> {
    let t_s = f64::from(row) / RATE_HZ;
    let push = 0.5 - 0.5 * (std::f64::consts::PI * (t_s / 0.5).min(1.0)).cos();
    let roam = (t_s - 0.5).max(0.0).powi(2) / ((t_s - 0.5).max(0.0) + 0.2);
    let position = Vector3::new(
        1.5e-3 * (5.0 * roam).sin(),
        5.5e-3 * push - 0.5e-3 + 0.8e-3 * (7.0 * roam).sin(),
        1.5e-3 * push + 1.5e-3 * (6.0 * roam).sin(),
    );
    let turned = Rotation3::new(Vector3::new(0.03, 0.02, 0.03) * (4.0 * roam).sin());
    Pose::<Base, World>::new(position, turned).inverse()
}

/// The same: a push of 2.7 mm in 0.5 s, then a stroke of 2.8 mm to and fro, in which the whisker is hardly deflected at one end.
fn stroke_to_base(row: u32) -> Pose<World, Base> {
    let t_s = f64::from(row) / RATE_HZ;
    let push = 0.5 - 0.5 * (std::f64::consts::PI * (t_s / 0.5).min(1.0)).cos();
    let stroke = 0.5 - 0.5 * (std::f64::consts::PI * (t_s - 0.5).max(0.0) / 0.8).cos();
    let position = Vector3::new(0.0, 1.35e-3, 2.35e-3) * (push - 0.02) + Vector3::new(3e-4, 2.5e-4, -2.75e-3) * stroke;
    Pose::<Base, World>::new(position, Rotation3::identity()).inverse()
}

/// A push from -0.5 to 4 mm in 0.5 s, then strokes of 16 mm across the whisker while it turns by up to 0.25 rad to either side
/// about a contact at 40 mm.
fn turning_to_base(row: u32) -> Pose<World, Base> {
    let t_s = f64::from(row) / RATE_HZ;
    let push = 0.5 - 0.5 * (std::f64::consts::PI * (t_s / 0.5).min(1.0)).cos();
    let roam_s = (t_s - 0.5).max(0.0);
    let turned = Rotation3::new(Vector3::z() * (0.25 * (3.0 * roam_s).sin()));
    let about_m = Vector3::x() * 0.040;
    let stroke_m = Vector3::z() * (8e-3 * (1.0 - (2.0 * roam_s).cos()));
    let position = Vector3::y() * (4.5e-3 * push - 0.5e-3) + stroke_m + about_m - turned * about_m;
    Pose::<Base, World>::new(position, turned).inverse()
}

/// Contact of the whisker with the point of a line at which the force is across `along`, sought from the distance `shift_m` along
/// it. A zero direction stands for a point.
fn touched(
    rod: &Rod,
    to_base: &Pose<World, Base>,
    point: Vector3<f64>,
    along: Vector3<f64>,
    shift_m: &mut f64,
) -> SpatialContact {
    let along = to_base.turn_vector(along);
    let from = to_base.apply(Point::from_vector(point)).vector();
    let at = |shift_m: f64| rod.at_point(from + along * shift_m).unwrap();
    if along != Vector3::zeros() {
        let across = |shift_m: f64| at(shift_m).deflection.force_n.normalize().dot(&along);
        for _ in 0..30 {
            let here = across(*shift_m);
            let step_m = (here / ((across(*shift_m + 1e-6) - here) / 1e-6)).clamp(-5e-4, 5e-4);
            *shift_m -= step_m;
            if step_m.abs() < 1e-8 {
                break;
            }
        }
    }
    at(*shift_m)
}

/// Contact of a damped whisker with a line. The force on the line is the elastic force plus the ratio of damping to stiffness
/// `lag_s` times its rate of change since the last row, at which it was `before_n`.
fn touched_with_lag(
    rod: &Rod,
    to_base: &Pose<World, Base>,
    (point, along): (Vector3<f64>, Vector3<f64>),
    (lag_s, before_n): (f64, &mut Option<Vector3<f64>>),
    shift_m: &mut f64,
) -> SpatialContact {
    let along_base = to_base.turn_vector(along);
    let from = to_base.apply(Point::from_vector(point)).vector();
    let at = |shift_m: f64| rod.at_point(from + along_base * shift_m).unwrap();
    let across = |shift_m: f64| {
        let force_n = at(shift_m).deflection.force_n;
        let change_n = before_n.map_or(Vector3::zeros(), |before_n| force_n - before_n);
        (force_n + change_n * lag_s * RATE_HZ).dot(&along_base) / force_n.norm()
    };
    for _ in 0..30 {
        let here = across(*shift_m);
        let step_m = (here / ((across(*shift_m + 1e-6) - here) / 1e-6)).clamp(-5e-4, 5e-4);
        *shift_m -= step_m;
        if step_m.abs() < 1e-8 {
            break;
        }
    }
    assert!(across(*shift_m).abs() < 1e-5);
    let contact = at(*shift_m);
    *before_n = Some(contact.deflection.force_n);
    contact
}

/// Contact of the whisker with a sphere about `center`, of this radius with that of the wire, sought from the contact `near` in
/// Base.
fn touched_sphere(
    rod: &Rod,
    to_base: &Pose<World, Base>,
    center: Vector3<f64>,
    radius_m: f64,
    near: &mut Vector3<f64>,
) -> SpatialContact {
    let center = to_base.apply(Point::from_vector(center)).vector();
    let off = |p: Vector3<f64>| p - center - rod.at_point(p).unwrap().deflection.force_n.normalize() * radius_m;
    solved(&off, near);
    rod.at_point(*near).unwrap()
}

/// A cone that widens along its axis. Its radius includes that of the wire.
struct Cone {
    /// A point of the axis, and its direction.
    foot: Vector3<f64>,
    along: Vector3<f64>,
    /// Radius at that point, and half angle.
    radius_m: f64,
    half_angle_rad: f64,
}

/// Contact of the whisker with a cone, sought from the point `near` in Base. The normal at the contact meets the axis.
fn touched_cone(rod: &Rod, to_base: &Pose<World, Base>, cone: &Cone, near: &mut Vector3<f64>) -> SpatialContact {
    let foot = to_base.apply(Point::from_vector(cone.foot)).vector();
    let along = to_base.turn_vector(cone.along);
    let (tan, cos) = (cone.half_angle_rad.tan(), cone.half_angle_rad.cos());
    let off = |p: Vector3<f64>| {
        let at_m = along.dot(&(p - foot));
        let radius_m = cone.radius_m + at_m * tan;
        let normal = rod.at_point(p).unwrap().deflection.force_n.normalize();
        p - foot - along * (at_m + radius_m * tan) - normal * (radius_m / cos)
    };
    solved(&off, near);
    rod.at_point(*near).unwrap()
}

/// Replaces `near` by the zero of `off` that Newton's method finds from it.
fn solved(off: &dyn Fn(Vector3<f64>) -> Vector3<f64>, near: &mut Vector3<f64>) {
    for _ in 0..30 {
        let here = off(*near);
        let columns = [0, 1, 2].map(|axis| (off(*near + Vector3::ith(axis, 1e-7)) - here) / 1e-7);
        let step = Matrix3::from_columns(&columns).try_inverse().unwrap() * here;
        *near -= step * (5e-4 / step.norm()).min(1.0);
        if step.norm() < 1e-8 {
            break;
        }
    }
}

/// Replays a point or line that is touched at 48 mm; estimates with the true contacts and the rows.
fn replayed(
    knowledge: &Arc<Knowledge>,
    name: &str,
    along: Vector3<f64>,
    noise: f64,
) -> Vec<(Estimate, SpatialContact, u32)> {
    let point = Around::new(0.048, 0.0, 0.0).contact(&knowledge.calibrated.axis).vector();
    let mut shift_m = 0.0;
    let found = replayed_contacts(knowledge, name, (3, ROWS), noise, to_base, |rod, to_base| {
        Some(touched(rod, to_base, point, along, &mut shift_m))
    });
    assert!(found.len() > 350, "{} estimates", found.len());
    found
}

/// Replays the contacts that `touched` gives, `None` for a free whisker, in a number of rows; estimates with the true
/// contacts and the rows.
fn replayed_contacts(
    knowledge: &Arc<Knowledge>,
    name: &str,
    (seed, rows): (u64, u32),
    noise: f64,
    path: fn(u32) -> Pose<World, Base>,
    mut touched: impl FnMut(&Rod, &Pose<World, Base>) -> Option<SpatialContact>,
) -> Vec<(Estimate, SpatialContact, u32)> {
    let rod = knowledge.calibrated.whisker.rod().unwrap();
    let mut random = Pcg64::seed_from_u64(seed);
    let row = spatial_estimator(name).unwrap();
    let mut estimator = row.build(&row.defaults(), TouchConfig::default(), knowledge).unwrap();
    let (mut samples, mut truths) = (Vec::new(), Vec::new());
    for i in 0..rows {
        // The object is touched after a tenth of the push.
        let to_base = path(i.max(50));
        let truth = (i >= 50).then(|| touched(&rod, &to_base)).flatten();
        let moment = truth.map_or(Vector2::zeros(), |truth| truth.deflection.moment_n_m.yz());
        let mut draw = || noise * knowledge.noise_sd_n_m * random.sample::<f64, _>(StandardNormal);
        let motion = path(i.max(51) - 1).inverse().then(&to_base);
        samples.push(Sample { motion, dt_s: 1.0 / RATE_HZ, reading_n_m: moment + Vector2::new(draw(), draw()) });
        truths.push(truth);
    }
    let rows = estimator.run(&samples).into_iter().zip(truths).zip(0..);
    rows.filter_map(|((estimate, truth), row)| Some((estimate?, truth?, row))).collect()
}

fn error(estimate: &Estimate, truth: &SpatialContact) -> Vector3<f64> {
    estimate.contact.vector() - truth.deflection.point
}

#[test]
fn verif_a_fixed_point_is_located_with_its_covariance() {
    for (knowledge, name) in
        [(&*STRAIGHT, "point"), (&*CURVED, "point"), (&*STRAIGHT, "point-fit"), (&*CURVED, "point-fit")]
    {
        let found = replayed(knowledge, name, Vector3::zeros(), 1.0);
        let late = &found[found.len() - 100..];
        for (estimate, truth, _) in late {
            let error = error(estimate, truth);
            let nees = error.dot(&estimate.covariance_m2.cholesky().unwrap().solve(&error));
            assert!(error.norm() < 0.3e-3 && nees < 25.0, "{error} {nees}");
            let normal = truth.deflection.force_n.normalize();
            assert!(normal.angle(&estimate.normal) < 0.02);
        }
    }
}

/// A damped whisker slides along a line, for an estimator that knows the damping and one that assumes none.
#[test]
fn verif_the_lag_of_a_damped_whisker_is_accounted_for() {
    const LAG_S: f64 = 10e-3;
    let along = Vector3::new(0.1, 0.2, 0.97).normalize();
    for knowledge in [&*STRAIGHT, &*CURVED] {
        let point = Around::new(0.048, 0.0, 0.0).contact(&knowledge.calibrated.axis).vector();
        let [known, unknown] = [LAG_S, 0.0].map(|damping_s| {
            let mut calibrated = (*knowledge.calibrated).clone();
            calibrated.whisker.whisker.damping_s = damping_s;
            let knowledge = Arc::new(Knowledge { calibrated: Arc::new(calibrated), ..(**knowledge).clone() });
            let (mut shift_m, mut before_n) = (0.0, None);
            let found = replayed_contacts(&knowledge, "line-fit", (3, ROWS), 0.01, to_base, |rod, to_base| {
                let line = (point, along);
                Some(touched_with_lag(rod, to_base, line, (LAG_S, &mut before_n), &mut shift_m))
            });
            let late = &found[found.len() - 200..];
            let squares: f64 = late.iter().map(|(estimate, truth, _)| error(estimate, truth).norm_squared()).sum();
            (squares / late.len() as f64).sqrt()
        });
        assert!(known < 0.5 * unknown, "{known} {unknown}");
    }
}

#[test]
fn verif_hindsight_halves_the_error_of_the_first_contacts_of_a_touch() {
    let along = Vector3::new(0.1, 0.2, 0.97).normalize();
    for knowledge in [&*STRAIGHT, &*CURVED] {
        let [so_far, revised] = ["recommended", "batch-recommended"].map(|name| replayed(knowledge, name, along, 1.0));
        let rms_m = |found: &[(Estimate, SpatialContact, u32)], rows: std::ops::Range<u32>| {
            let squares: Vec<f64> = found
                .iter()
                .filter(|(.., row)| rows.contains(row))
                .map(|(estimate, truth, _)| error(estimate, truth).norm_squared())
                .collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        assert!(revised.len() >= so_far.len(), "{} {}", revised.len(), so_far.len());
        let [first, of_revised] = [&so_far, &revised].map(|found| rms_m(found, 60..200));
        assert!(of_revised < 0.5 * first, "{of_revised} {first}");
        let [last, of_revised] = [&so_far, &revised].map(|found| rms_m(found, ROWS - 50..ROWS));
        assert!(of_revised < 1.2 * last, "{of_revised} {last}");
        let is_covered = |(estimate, truth, _): &&(Estimate, SpatialContact, u32)| {
            let error = error(estimate, truth);
            error.dot(&estimate.covariance_m2.cholesky().unwrap().solve(&error)) < 7.81
        };
        let covered = revised.iter().filter(is_covered).count() as f64 / revised.len() as f64;
        assert!(covered > 0.9, "{covered}");
    }
}

#[test]
fn verif_hindsight_locates_another_object_at_the_next_touch_from_its_beginning() {
    let [so_far, revised] = ["recommended", "batch-recommended"].map(|name| touched_again(name, 0.046));
    assert!(revised.len() > so_far.len() + 50, "{} {}", revised.len(), so_far.len());
    let wrong = revised.iter().filter(|(estimate, truth, _)| error(estimate, truth).norm() > 1e-3).count();
    // While the whisker is hardly deflected, the readings hardly determine the contact.
    assert!(wrong < revised.len() / 5, "{wrong} of {}", revised.len());
}

/// Two touches of a rod, between which the whisker is free, with a reading beyond the gate in the first one, by a sensor whose
/// mounting deviates.
#[test]
fn verif_hindsight_revises_a_touch_when_it_has_ended() {
    const GATED: usize = 200;
    let along = Vector3::new(0.1, 0.2, 0.97).normalize();
    let calibrated = CalibratedSpace { mounting: Some(deviation()), ..(*STRAIGHT.calibrated).clone() };
    let knowledge = Arc::new(Knowledge { calibrated: Arc::new(calibrated), ..(**STRAIGHT).clone() });
    let rod = STRAIGHT.calibrated.whisker.rod().unwrap();
    let point = Around::new(0.048, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
    let mut shift_m = 0.0;
    let row = spatial_estimator("batch-recommended").unwrap();
    let mut estimator = row.build(&row.defaults(), TouchConfig::default(), &knowledge).unwrap();
    let (mut estimates, mut before, mut truths_m) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..500 {
        let pose = nominal_to_base(i.max(50));
        let is_touching = (50..300).contains(&i) || i >= 400;
        let as_calibrated = pose.then(&deviation().pose());
        let touched = is_touching.then(|| touched(&rod, &as_calibrated, point, along, &mut shift_m));
        let moment = touched.map_or(Vector2::zeros(), |contact| contact.deflection.moment_n_m.yz());
        truths_m.push(
            touched.map(|contact| deviation().pose().inverse().apply(Point::from_vector(contact.deflection.point))),
        );
        let motion = nominal_to_base(i.max(51) - 1).inverse().then(&pose);
        let reading_n_m = if i as usize == GATED { Vector2::repeat(1.0) } else { moment };
        estimator.push(&Sample { motion, dt_s: 1.0 / RATE_HZ, reading_n_m }, &mut estimates);
        assert_eq!(estimates.len(), i as usize + 1);
        if i == 299 {
            assert!(estimator.is_following());
            before.clone_from(&estimates);
        }
        if i == 380 {
            assert!(!estimator.is_following() && estimates[350..].iter().all(Option::is_none));
            assert!(estimates[GATED].is_none());
            assert!((60..300).any(|i| estimates[i] != before[i]));
            before.clone_from(&estimates);
        }
    }
    assert!(estimator.is_following());
    estimator.end(&mut estimates);
    assert!(!estimator.is_following());
    assert_eq!(estimates[..380], before[..380], "each touch is revised once");
    let of = |i: usize| (estimates[i].unwrap().contact, truths_m[i].unwrap());
    for i in (100..290).chain(420..499).filter(|i| *i != GATED) {
        let (estimate, truth) = of(i);
        assert!(estimate.distance(&truth) < 0.1e-3, "{i}: {}", estimate.distance(&truth));
    }
    // On both sides of the gated reading, the estimates are those of their own samples: the contact moves by 25 um from row to row.
    let ((before, true_before), (after, true_after)) = (of(GATED - 1), of(GATED + 1));
    let moved_m = (after.vector() - before.vector()) - (true_after.vector() - true_before.vector());
    assert!(true_after.distance(&true_before) > 40e-6 && moved_m.norm() < 5e-6, "{moved_m}");
}

#[test]
fn verif_particles_locate_a_rod() {
    let along = Vector3::new(0.1, 0.2, 0.97).normalize();
    for knowledge in [&*STRAIGHT, &*CURVED] {
        let found = replayed(knowledge, "particle", along, 1.0);
        for (estimate, truth, _) in &found[found.len() - 50..] {
            assert!(error(estimate, truth).norm() < 0.5e-3, "{}", error(estimate, truth));
            assert!(estimate.innovation.is_some() && estimate.direction.is_some());
        }
    }
}

/// At this rate of readings, the published noise allows for errors of millimetres along the whisker, among contacts with nearly the
/// same readings.
#[test]
fn verif_the_published_filter_explains_the_readings_of_a_fixed_point() {
    for knowledge in [&*STRAIGHT, &*CURVED] {
        let found = replayed(knowledge, "paper-ukf-3d", Vector3::zeros(), 1.0);
        for (estimate, truth, _) in &found[found.len() - 100..] {
            let expected_n_m = knowledge.calibrated.model.predict(estimate.contact).reading_n_m;
            let off = (expected_n_m - truth.deflection.moment_n_m.yz()).norm();
            assert!(off < 0.04 * knowledge.calibrated.largest_reading_n_m, "{off}");
            assert!(estimate.innovation.is_some() && estimate.model_doubtful.is_none());
        }
    }
}

#[test]
fn verif_particles_with_the_same_seed_give_the_same_estimates() {
    let row = spatial_estimator("particle").unwrap();
    let estimates = [1, 1, 2].map(|seed| {
        let mut config = row.defaults();
        config["seed"] = json!(seed);
        let mut estimator = row.build(&config, TouchConfig::default(), &STRAIGHT).unwrap();
        let sample = Sample { motion: Pose::identity(), dt_s: 1.0 / RATE_HZ, reading_n_m: Vector2::new(-4e-6, 3e-6) };
        (0..50).filter_map(|_| estimator.step(&sample)).last().expect("a touch is detected").contact
    });
    assert_eq!(estimates[0], estimates[1]);
    assert_ne!(estimates[0], estimates[2]);
}

/// The same readings, of a sensor that is stated to be a real one and of a simulated one.
#[test]
fn verif_a_contact_that_sticks_is_located_on_a_real_sensor() {
    let real = CalibratedSpace { real_sensor: true, ..(*STRAIGHT.calibrated).clone() };
    let real = Arc::new(Knowledge { calibrated: Arc::new(real), ..(**STRAIGHT).clone() });
    let errors = [&real, &*STRAIGHT].map(|knowledge| {
        let found = replayed(knowledge, "recommended", Vector3::zeros(), 1.0);
        let (estimate, truth, _) = *found.last().unwrap();
        let share = estimate.models.unwrap().of("point-fit");
        assert_eq!(share.map(|share| share > 0.5), knowledge.calibrated.real_sensor.then_some(true), "{share:?}");
        (error(&estimate, &truth), estimate)
    });
    let [(of_real, estimate), (of_simulated, simulated)] = errors;
    assert!(of_real.norm() < 0.3e-3 && of_real.norm() < of_simulated.norm(), "{of_real} {of_simulated}");
    // The mounting: 0.2 mm along each axis, and 6 mrad at a distance of 48 mm from the root.
    let sd_m = estimate.covariance_m2.diagonal().map(f64::sqrt);
    assert!(sd_m.min() >= 0.2e-3 && sd_m.max() > 0.3e-3, "{sd_m} {}", simulated.covariance_m2);
}

/// A contact that slides along a line. Near the tip the sensor has large errors: a point at rest there explains all readings, though
/// the readings are improbable there.
#[test]
fn regress_a_place_with_large_errors_does_not_explain_the_readings_best() {
    let calibrated = &*STRAIGHT.calibrated;
    let variance_of = |node: usize| (if node == 3 { 2e-6_f64 } else { 5e-8 }).powi(2);
    let covariances_n2_m2 =
        (0..8).map(|node| variance_of(node / 2)).map(|variance| [variance, 0.0, variance]).collect();
    let error_map = SpatialErrorMap { along: 4, away: 2, covariances_n2_m2, correlation_m: Some(5e-3) };
    let calibrated =
        CalibratedSpace { error: error_map, heldout_rms_n_m: 1e-7, real_sensor: true, ..calibrated.clone() };
    let knowledge = Arc::new(Knowledge { calibrated: Arc::new(calibrated), ..(**STRAIGHT).clone() });
    for along in [Vector3::new(0.3, 0.0, 1.0), Vector3::new(-0.5, 0.0, 1.0), Vector3::z()] {
        let found = replayed(&knowledge, "recommended", along.normalize(), 1.0);
        let (estimate, truth, _) = found.last().unwrap();
        let off_m = error(estimate, truth).norm();
        assert!(off_m < 0.5e-3, "{along}: {off_m} m, {:?}", estimate.models);
    }
}

/// A constant error of one moment: with independent errors the covariance shrinks with every reading, with correlated ones it does
/// not.
#[test]
fn verif_correlated_errors_of_the_model_are_part_of_the_covariance() {
    const ERROR_N_M: f64 = 6e-7;
    let with = |correlation_m: Option<f64>| {
        let calibrated = &*STRAIGHT.calibrated;
        let covariances_n2_m2 = vec![[ERROR_N_M.powi(2), 0.0, ERROR_N_M.powi(2)]; 4];
        let error = SpatialErrorMap { covariances_n2_m2, correlation_m, ..calibrated.error.clone() };
        let calibrated = CalibratedSpace { error, ..calibrated.clone() };
        Arc::new(Knowledge { calibrated: Arc::new(calibrated), ..(**STRAIGHT).clone() })
    };
    let point = Around::new(0.048, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
    let sd_m = |name: &str, correlation_m: Option<f64>| {
        let off = |truth: SpatialContact| {
            let moment_n_m = truth.deflection.moment_n_m + Vector3::new(0.0, 0.0, ERROR_N_M);
            let deflection = SpatialDeflection { moment_n_m, ..truth.deflection };
            SpatialContact { deflection, ..truth }
        };
        let found = replayed_contacts(&with(correlation_m), name, (3, ROWS), 1.0, to_base, |rod, to_base| {
            Some(off(touched(rod, to_base, point, Vector3::zeros(), &mut 0.0)))
        });
        let (estimate, truth, _) = found.last().unwrap();
        let error = error(estimate, truth);
        let nees = error.dot(&estimate.covariance_m2.cholesky().unwrap().solve(&error)) / 3.0;
        (estimate.covariance_m2.trace().sqrt(), nees)
    };
    let [(filtered_m, of_filter), (independent_m, _)] = [Some(10e-3), None].map(|length_m| sd_m("point", length_m));
    assert!(filtered_m > 3.0 * independent_m && of_filter < 3.0, "{filtered_m} {of_filter} {independent_m}");
    let (fitted_m, of_fit) = sd_m("point-fit", Some(10e-3));
    assert!(fitted_m < filtered_m && of_fit < 3.0, "{fitted_m} {of_fit} {filtered_m}");
}

/// A mounting that deviates by some tenths of a millimetre and half a degree.
fn deviation() -> Mounting {
    Mounting {
        shift_m: Vector3::new(0.4e-3, -0.3e-3, 0.5e-3),
        turn_rad: Vector3::new(0.01, -0.008, 0.01),
        covariance: Matrix6::identity() * 1e-18,
    }
}

/// Pose of World in Base, given the nominal mounting of the sensor.
fn nominal_to_base(row: u32) -> Pose<World, Base> {
    to_base(row).then(&deviation().pose().inverse())
}

/// Touches of two points determine the mounting, with which a third one is located.
#[test]
fn verif_touches_at_known_places_determine_the_mounting() {
    let known = |along_m: f64| {
        let rod = STRAIGHT.calibrated.whisker.rod().unwrap();
        let point = Around::new(along_m, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
        let contact = |row: u32| {
            let truth = touched(&rod, &to_base(row), point, Vector3::zeros(), &mut 0.0).deflection;
            let contact = deviation().pose().inverse().apply(Point::from_vector(truth.point));
            KnownContact { contact, reading_n_m: truth.moment_n_m.yz() }
        };
        (60..500).step_by(5).map(contact).collect::<Vec<_>>()
    };
    let learnt = Mounting::learnt(&STRAIGHT.calibrated, &[known(0.042), known(0.056)], 0.0).unwrap();
    for FittedTouch { contacts, used, residuals_n_m, disagreement } in learnt.touches {
        let [before_n_m, after_n_m] = residuals_n_m.unwrap();
        assert!((Mounting::LEAST_CONTACTS..=contacts).contains(&used) && contacts <= 40, "{used} {contacts}");
        assert!(
            after_n_m < 0.1 * before_n_m && disagreement.unwrap() < 1.5,
            "{before_n_m} {after_n_m} {disagreement:?}"
        );
    }
    let learnt = learnt.mounting;
    assert!((learnt.size() - deviation().size()).abs() < 0.1, "{}", learnt.size());
    // One of three places is known wrongly, by 2 mm.
    let mut wrong = known(0.049);
    wrong.iter_mut().for_each(|one| one.contact = one.contact.shifted(Vector3::new(0.0, 2e-3, 0.0)));
    let found = Mounting::learnt(&STRAIGHT.calibrated, &[known(0.042), known(0.056), wrong], 0.0).unwrap();
    let disagreements: Vec<f64> = found.touches.iter().map(|touch| touch.disagreement.unwrap()).collect();
    assert!(disagreements[2] > 10.0, "{disagreements:?}");
    let alone = Mounting::learnt(&STRAIGHT.calibrated, &[known(0.042)], 0.0).unwrap();
    assert_eq!(alone.touches[0].disagreement, None);
    let calibrated = CalibratedSpace { mounting: Some(deviation()), ..(*STRAIGHT.calibrated).clone() };
    let one = known(0.048)[20];
    let predicted = calibrated.predict(one.contact).unwrap();
    assert!((predicted.reading_n_m - one.reading_n_m).norm() < 1e-4 * one.reading_n_m.norm());
    let step = Vector3::new(1e-6, -2e-6, 1.5e-6);
    let change_n_m = calibrated.predict(one.contact.shifted(step)).unwrap().reading_n_m - predicted.reading_n_m;
    assert!((change_n_m - predicted.gradient_n * step).norm() < 1e-2 * change_n_m.norm());
    let too_few = Mounting::learnt(&STRAIGHT.calibrated, &[known(0.042)[..5].to_vec()], 0.0);
    assert_eq!(too_few, None);
    let located = |mounting: Option<Mounting>| {
        let calibrated = CalibratedSpace { mounting, ..(*STRAIGHT.calibrated).clone() };
        let knowledge = Arc::new(Knowledge { calibrated: Arc::new(calibrated), ..(**STRAIGHT).clone() });
        let point = Around::new(0.048, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
        let found = replayed_contacts(&knowledge, "point", (3, ROWS), 1.0, nominal_to_base, |rod, to_base| {
            let as_calibrated = to_base.then(&deviation().pose());
            Some(touched(rod, &as_calibrated, point, Vector3::zeros(), &mut 0.0))
        });
        let (estimate, truth, _) = found.last().unwrap();
        let error = deviation().pose().apply(estimate.contact).vector() - truth.deflection.point;
        (error.norm(), estimate.covariance_m2.trace().sqrt())
    };
    let [(of_learnt_m, sd_m), (of_nominal_m, _)] = [Some(learnt), None].map(located);
    assert!(of_learnt_m < 0.15e-3 && of_learnt_m < 3.0 * sd_m, "{of_learnt_m} {sd_m}");
    assert!(of_nominal_m > 3.0 * of_learnt_m, "{of_nominal_m} {of_learnt_m}");
}

#[test]
fn verif_without_noise_the_errors_of_point_and_rod_vanish() {
    let rod = Vector3::new(0.2, -0.3, 0.9).normalize();
    // The evidence by which `recommended` chooses assumes the noise.
    let methods = ["line", "line-fit", "cylinder-fit", "patch-fit"].map(|name| (name, rod));
    for (name, along) in [("point", Vector3::zeros())].into_iter().chain(methods) {
        let found = replayed(&STRAIGHT, name, along, 0.0);
        let (estimate, truth, _) = found.last().unwrap();
        // Where the radius is unknown, its prior remains in the estimate.
        let most_m = if ["cylinder-fit", "patch-fit"].contains(&name) { 0.3e-3 } else { 0.1e-3 };
        assert!(error(estimate, truth).norm() < most_m, "{name}: {}", error(estimate, truth));
    }
}

#[test]
fn verif_a_rod_is_located_with_its_direction() {
    for along in [Vector3::new(0.1, 0.2, 0.97), Vector3::new(0.3, -0.2, 0.9)] {
        let along = along.normalize();
        for (knowledge, name) in
            [(&*STRAIGHT, "line"), (&*CURVED, "line"), (&*STRAIGHT, "line-fit"), (&*CURVED, "recommended")]
        {
            let found = replayed(knowledge, name, along, 1.0);
            for (estimate, truth, row) in &found[found.len() - 50..] {
                assert!(error(estimate, truth).norm() < 0.4e-3, "{name} {along}: {}", error(estimate, truth));
                let direction = estimate.direction.unwrap();
                let cosine = to_base(*row).turn_vector(along).dot(&direction.along).abs().min(1.0);
                assert!(cosine.acos() < (5.0 * direction.sd_rad).max(0.02), "{name} {along}: {direction:?}");
            }
        }
    }
}

#[test]
fn verif_early_estimates_include_a_contact_that_slides() {
    /// Share of the 95 % ellipsoids from 0.1 to 0.3 s after the touch that contain the contact with a rod of this direction.
    fn coverage(name: &str, along: Vector3<f64>) -> f64 {
        let found = replayed(&STRAIGHT, name, along.normalize(), 1.0);
        let is_covered = |(estimate, truth, _): &(Estimate, SpatialContact, u32)| {
            let error = error(estimate, truth);
            error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error)) <= CHI2_3_95
        };
        found[25..75].iter().filter(|one| is_covered(one)).count() as f64 / 50.0
    }
    // Oblique to the push, so that the contact slides from the touch on.
    for along in [Vector3::new(0.1, 0.4, 0.9), Vector3::new(-0.7, 0.2, 0.7)] {
        // The filter with which a fit begins, of a contact at rest, becomes overconfident.
        let [stated, at_rest] = ["recommended", "line-fit"].map(|name| coverage(name, along));
        assert!(stated > 0.85 && at_rest < 0.5, "{along}: {stated} {at_rest}");
    }
}

/// The push of [`to_base`], which ends soon after the touch.
fn short_push_to_base(row: u32) -> Pose<World, Base> {
    to_base(row.min(54))
}

#[test]
fn regress_readings_at_rest_do_not_determine_the_place_along_the_whisker() {
    for (name, seed) in
        ["line", "cylinder", "recommended"].into_iter().flat_map(|name| [(name, 1), (name, 2), (name, 3)])
    {
        let point = Around::new(0.030, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
        let (along, mut shift_m) = (Vector3::new(0.1, 0.2, 1.0).normalize(), 0.0);
        let found = replayed_contacts(&STRAIGHT, name, (seed, ROWS), 1.0, short_push_to_base, |rod, to_base| {
            Some(touched(rod, to_base, point, along, &mut shift_m))
        });
        let [early, (estimate, truth, _)] = [&found[20], found.last().unwrap()];
        let sd_m = |estimate: &Estimate| estimate.covariance_m2.trace().sqrt();
        assert!(sd_m(estimate) > 0.5 * sd_m(&early.0), "{name} {seed}: {} {}", sd_m(estimate), sd_m(&early.0));
        let error = error(estimate, truth);
        let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
        assert!(squared < 16.0, "{name} {seed}: {error} {squared}");
    }
}

/// The same, which then goes on by 7 µm from row to row: three readings are those of one stay.
fn slow_to_base(row: u32) -> Pose<World, Base> {
    let way =
        Pose::<Base, Base>::new(Vector3::new(0.0, -4e-6, 6e-6) * f64::from(row.max(80) - 80), Rotation3::identity());
    to_base(row.min(80)).then(&way)
}

#[test]
fn verif_no_motion_is_lost_between_slow_readings() {
    let point = Around::new(0.048, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
    let found = replayed_contacts(&STRAIGHT, "point", (3, 3 * ROWS), 0.1, slow_to_base, |rod, to_base| {
        Some(touched(rod, to_base, point, Vector3::zeros(), &mut 0.0))
    });
    for (estimate, truth, row) in &found[found.len() - 100..] {
        let error = error(estimate, truth);
        assert!(error.norm() < 0.2e-3, "{row}: {error}");
    }
}

#[test]
fn verif_a_rod_is_located_after_the_whisker_has_slipped_to_another_one() {
    let axis = &STRAIGHT.calibrated.axis;
    let (first, second) = (Around::new(0.040, 0.0, 0.0), Around::new(0.046, 0.0, 0.0));
    let (mut shift_m, mut row) = (0.0, 0);
    let found = replayed_contacts(&STRAIGHT, "line-fit", (3, 2 * ROWS), 1.0, to_base, |rod, to_base| {
        row += 1;
        let at = if row < 200 { first } else { second };
        Some(touched(rod, to_base, at.contact(axis).vector(), Vector3::new(0.1, 0.2, 1.0).normalize(), &mut shift_m))
    });
    for (estimate, truth, _) in &found[found.len() - 50..] {
        let error = error(estimate, truth);
        let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
        assert!(error.norm() < 1e-3 && squared < 16.0, "{error} {squared}");
    }
}

/// Row at which the contact jumps from one rod to another.
const JUMP_ROW: u32 = 190;

/// The whisker touches a rod at 46 mm, then a parallel one nearer to the root. At the jump both give the same reading, so that the
/// innovations grow slowly.
fn touched_after_a_jump(name: &str) -> Vec<(Estimate, SpatialContact, u32)> {
    let rod = STRAIGHT.calibrated.whisker.rod().unwrap();
    let along = Vector3::new(0.1, 0.2, 1.0).normalize();
    let first = Around::new(0.046, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
    let mut shift_m = 0.0;
    let before = touched(&rod, &to_base(JUMP_ROW), first, along, &mut shift_m).deflection;
    let mut nearer = before.point * 0.8;
    for _ in 0..10 {
        let read = |p: Vector3<f64>| rod.at_point(p).unwrap().deflection.moment_n_m.yz();
        let here = read(nearer);
        let columns = [1, 2].map(|axis| (read(nearer + Vector3::ith(axis, 1e-7)) - here) / 1e-7);
        let step = Matrix2::from_columns(&columns).try_inverse().unwrap() * (here - before.moment_n_m.yz());
        nearer -= Vector3::new(0.0, step.x, step.y);
    }
    let second = to_base(JUMP_ROW).inverse().apply(Point::from_vector(nearer)).vector();
    let (mut shift_m, mut row) = ([0.0; 2], 49);
    replayed_contacts(&STRAIGHT, name, (3, 2 * ROWS), 1.0, to_base, |rod, to_base| {
        row += 1;
        let (point, side) = if row < JUMP_ROW { (first, 0) } else { (second, 1) };
        Some(touched(rod, to_base, point, along, &mut shift_m[side]))
    })
}

#[test]
fn verif_a_rod_is_located_after_a_jump_that_the_readings_hardly_show() {
    let found = touched_after_a_jump("line-fit");
    for (estimate, truth, row) in found.iter().filter(|(.., row)| *row >= 600) {
        let error = error(estimate, truth);
        let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
        assert!(error.norm() < 1e-3 && squared < 25.0, "{row}: {error} {squared}");
        assert_eq!(estimate.model_doubtful, Some(false), "{row}");
    }
}

#[test]
fn verif_hindsight_locates_both_rods_before_and_after_a_jump_that_the_readings_hardly_show() {
    let [so_far, revised] = ["recommended", "batch-recommended"].map(|name| {
        let found = touched_after_a_jump(name);
        let wrong = found.iter().filter(|(estimate, truth, _)| error(estimate, truth).norm() > 1e-3).count();
        (wrong, found.len())
    });
    assert!(so_far.0 > so_far.1 / 3 && revised.0 < revised.1 / 8, "{so_far:?} {revised:?}");
}

/// Rows of a touch with the way to the object and back.
const TOUCH_ROWS: u32 = 500;

/// Share of the way to the object at a row, 1 while it is touched.
fn pressed(row: u32) -> f64 {
    let row = row % TOUCH_ROWS;
    let way = f64::from(row.min(TOUCH_ROWS - row)) / 100.0;
    0.5 - 0.5 * (std::f64::consts::PI * way.min(1.0)).cos()
}

/// The same, with a push of 5 mm, strokes, and the way back, again and again.
fn pressed_to_base(row: u32) -> Pose<World, Base> {
    let t_s = f64::from(row) / RATE_HZ;
    let stroke = Vector3::new(1.5e-3 * (5.0 * t_s).sin(), 0.8e-3 * (7.0 * t_s).sin(), 1.5e-3 * (6.0 * t_s).sin());
    let position = (Vector3::new(0.0, 5.5e-3, 1.5e-3) + stroke) * pressed(row) - Vector3::y() * 0.5e-3;
    Pose::<Base, World>::new(position, Rotation3::identity()).inverse()
}

/// Touches a rod at 40 mm, then a parallel one at `again_m`. Estimates of the second touch with the true contacts.
fn touched_again(name: &str, again_m: f64) -> Vec<(Estimate, SpatialContact, u32)> {
    let (mut shift_m, mut row) = (0.0, 49);
    let found = replayed_contacts(&STRAIGHT, name, (3, 2 * TOUCH_ROWS), 1.0, pressed_to_base, |rod, to_base| {
        row += 1;
        let along_m = if row < TOUCH_ROWS { 0.040 } else { again_m };
        let point = Around::new(along_m, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
        let contact = touched(rod, to_base, point, Vector3::new(0.1, 0.2, 1.0).normalize(), &mut shift_m);
        (pressed(row) > 0.12).then_some(contact)
    });
    found.into_iter().filter(|(.., row)| *row >= TOUCH_ROWS).collect()
}

#[test]
fn verif_an_object_is_known_at_the_next_touch() {
    for name in ["line-fit", "recommended"] {
        let found = touched_again(name, 0.040);
        assert!(found.len() > 300, "{} estimates", found.len());
        for (estimate, truth, _) in &found {
            let error = error(estimate, truth);
            let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
            assert!(error.norm() < 1e-3 && squared < 16.0, "{name}: {error} {squared}");
        }
    }
}

/// After the first touch the whisker rests on the rod with a moment below the threshold of the detector.
fn lightly_held_to_base(row: u32) -> Pose<World, Base> {
    if row < TOUCH_ROWS {
        return pressed_to_base(row);
    }
    Pose::<Base, World>::new(Vector3::new(0.0, 0.19e-3, 0.0), Rotation3::identity()).inverse()
}

#[test]
fn verif_a_contact_with_a_known_object_is_stated_where_it_is_not_detected() {
    // The same moments with a contact, and without one.
    let held = |name: &str, is_held: bool| {
        let (mut shift_m, mut row) = (0.0, 49);
        let rows = (3, TOUCH_ROWS + 200);
        let found = replayed_contacts(&STRAIGHT, name, rows, 1.0, lightly_held_to_base, |rod, to_base| {
            row += 1;
            let point = Around::new(0.040, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
            let contact = touched(rod, to_base, point, Vector3::new(0.1, 0.2, 1.0).normalize(), &mut shift_m);
            let touches = if row < TOUCH_ROWS { pressed(row) > 0.12 } else { is_held };
            touches.then_some(contact)
        });
        found.into_iter().filter(|(.., row)| *row >= TOUCH_ROWS + 20).collect::<Vec<_>>()
    };
    for name in ["line-fit", "recommended"] {
        let found = held(name, true);
        let light =
            found.iter().filter(|(_, truth, _)| truth.deflection.moment_n_m.norm() < 5.0 * STRAIGHT.noise_sd_n_m);
        assert_eq!(light.count(), found.len());
        assert!(found.len() > 150, "{name}: {} estimates", found.len());
        for (estimate, truth, row) in &found {
            let error = error(estimate, truth);
            let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
            assert!(error.norm() < 2e-3 && squared < 16.0, "{name}, {row}: {error} {squared}");
        }
        assert_eq!(held(name, false).len(), 0, "{name}");
    }
}

#[test]
fn verif_another_object_is_located_at_the_next_touch() {
    for name in ["line-fit", "recommended"] {
        let found = touched_again(name, 0.046);
        // Towards the release the readings hardly determine the contact.
        for (estimate, truth, row) in &found[found.len() - 250..found.len() - 100] {
            let error = error(estimate, truth);
            let squared = error.dot(&(estimate.covariance_m2.try_inverse().unwrap() * error));
            assert!(error.norm() < 1e-3 && squared < 16.0, "{name}, {row}: {error} {squared}");
        }
    }
}

#[test]
fn verif_a_sphere_is_located_whatever_branch_the_push_suggests() {
    // A push alone hardly determines the radius; below the deflection the contact would be unstable, and would slide the other way.
    const RADIUS_M: f64 = 0.02;
    for seed in 1..=6 {
        let first = Around::new(0.048, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
        let mut near = first + Vector3::new(0.0, -1e-4, -3e-5);
        let inwards = Vector3::new(0.0, 5.0, 1.5).normalize();
        let center = first + inwards * RADIUS_M;
        let found = replayed_contacts(&STRAIGHT, "sphere-fit", (seed, ROWS), 1.0, to_base, |rod, to_base| {
            Some(touched_sphere(rod, to_base, center, RADIUS_M, &mut near))
        });
        assert!(found.len() > 350, "{} estimates", found.len());
        for (estimate, truth, _) in &found[found.len() - 50..] {
            assert!(error(estimate, truth).norm() < 0.5e-3, "seed {seed}: {}", error(estimate, truth));
            let radius_m = estimate.radius.unwrap().radius_m;
            assert!((radius_m / RADIUS_M - 1.0).abs() < 0.1, "seed {seed}: {radius_m}");
        }
    }
}

#[test]
fn regress_a_sphere_explains_the_readings_of_contacts_that_slid_far_apart() {
    const RADIUS_M: f64 = 8e-3;
    let first = Around::new(0.0295, 0.0, 0.0).contact(&CURVED.calibrated.axis).vector();
    let inwards = Vector3::new(0.0, 1.35, 2.35).normalize();
    let center = first + inwards * RADIUS_M;
    let mut near = first - inwards * 1e-4;
    let found = replayed_contacts(&CURVED, "sphere-fit", (1, 2 * ROWS), 1.0, stroke_to_base, |rod, to_base| {
        Some(touched_sphere(rod, to_base, center, RADIUS_M, &mut near))
    });
    for (estimate, truth, _) in &found[found.len() - 400..] {
        assert!(error(estimate, truth).norm() < 0.3e-3, "{}", error(estimate, truth));
        assert_eq!(estimate.model_doubtful, Some(false));
    }
}

#[test]
fn verif_a_cone_is_located() {
    let half_angle_rad = 0.3_f64;
    let first = Around::new(0.040, 0.0, 0.0).contact(&STRAIGHT.calibrated.axis).vector();
    let (inwards, generatrix) = (Vector3::y(), Vector3::new(0.2, 0.0, 1.0).normalize());
    let along = generatrix * half_angle_rad.cos() + inwards * half_angle_rad.sin();
    let cone = Cone { foot: first + inwards * 0.01, along, radius_m: 0.01 / half_angle_rad.cos(), half_angle_rad };
    let [cone, cylinder] = ["cone-fit", "cylinder-fit"].map(|name| {
        let mut near = first - inwards * 1e-4;
        let found = replayed_contacts(&STRAIGHT, name, (3, 2 * ROWS), 0.1, turning_to_base, |rod, to_base| {
            Some(touched_cone(rod, to_base, &cone, &mut near))
        });
        let late = &found[found.len() - 100..];
        let squares: f64 = late.iter().map(|(estimate, truth, _)| error(estimate, truth).norm_squared()).sum();
        (squares / late.len() as f64).sqrt()
    });
    assert!(cone < 0.1e-3 && cylinder > 2.0 * cone, "{cone} {cylinder}");
}

#[test]
fn robust_every_estimator_survives_glitches_and_the_free_whisker() {
    for row in SPATIAL_ESTIMATORS {
        let mut estimator = row.build(&row.defaults(), TouchConfig::default(), &STRAIGHT).unwrap();
        let sample = |reading_n_m| Sample { motion: Pose::identity(), dt_s: 1.0 / RATE_HZ, reading_n_m };
        for i in 0..20 {
            let reading = if i % 5 == 4 { Vector2::new(f64::NAN, 1.0) } else { Vector2::zeros() };
            assert!(estimator.step(&sample(reading)).is_none(), "{}", row.name);
        }
        let touched = (0..60).filter_map(|i| {
            let reading = if i % 7 == 6 { Vector2::new(0.0, 1.0) } else { Vector2::new(-4e-6, 3e-6) };
            estimator.step(&sample(reading))
        });
        let last = touched.last().expect("a touch is detected");
        assert!(last.covariance_m2.cholesky().is_some() && (last.normal.norm() - 1.0).abs() < 1e-9, "{}", row.name);
    }
}

#[test]
fn robust_wrong_settings_are_refused() {
    let row = spatial_estimator("line").unwrap();
    for (key, value) in [("gate_sds", json!(0.0)), ("hypotheses", json!(0)), ("other", json!(1))] {
        let mut config = row.defaults();
        config[key] = value;
        let refused = row.build(&config, TouchConfig::default(), &STRAIGHT);
        assert!(refused.err().is_some_and(|error| error.to_string().contains(key)), "{key}");
    }
    assert!(spatial_estimator("edge").is_none());
}

#[test]
fn robust_candidates_of_an_average_without_evidence_are_refused() {
    let row = spatial_estimator("recommended").unwrap();
    for (name, expected) in [("line", "expected a fit"), ("edge", "expected one of"), ("recommended", "expected a fit")]
    {
        let config = json!({"candidates": [{"name": name, "weight": 1.0}]});
        let refused = row.build(&config, TouchConfig::default(), &STRAIGHT);
        assert!(refused.err().is_some_and(|error| error.to_string().contains(expected)), "{name}");
    }
}
