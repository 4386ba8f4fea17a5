//! The exact whisker against published values, closed forms, itself and SciPy.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;
use std::time::Instant;

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use whisker::elastica::{
    Circle, Elastica, Ellipse, Failure, Friction, Load, Outline, PointContact, Polygon, Regime, Touch,
    natural_frequencies_hz,
};
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;
use whisker::{Curvature, Whisker};

const CLAMPED_N_M_RAD: f64 = 1e12;

fn with_curvature(curvature_per_m: f64) -> Whisker {
    Whisker { damping_s: 0.0, ..Whisker::straight() }.with_curvature([Curvature::new(0.08, curvature_per_m)])
}

fn straight() -> Whisker {
    with_curvature(0.0)
}

fn clamped() -> Whisker {
    Whisker { root_stiffness_n_m_rad: CLAMPED_N_M_RAD, ..straight() }
}

fn across(arc_m: f64, left_n: f64) -> Load {
    Load { arc_m, along_n: 0.0, left_n, couple_n_m: 0.0 }
}

fn solver(whisker: &Whisker) -> Elastica {
    Elastica::new(whisker).unwrap()
}

fn uniform(rng: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A whisker with one to four pieces of pre-curvature, a taper down to a quarter, and a soft to stiff root.
fn random_whisker(rng: &mut Pcg64Mcg) -> Whisker {
    let length_m = uniform(rng, 0.03, 0.12);
    let pieces = rng.random_range(1..5);
    let shares: Vec<f64> = (0..pieces).map(|_| uniform(rng, 0.2, 1.0)).collect();
    let total: f64 = shares.iter().sum();
    let curvature = shares
        .iter()
        .map(|share| Curvature {
            length_m: length_m * share / total,
            curvature_per_m: uniform(rng, -0.8, 0.8) / length_m,
        })
        .collect();
    let root_diameter_m = uniform(rng, 0.1e-3, 0.4e-3);
    let whisker = Whisker {
        length_m,
        root_diameter_m,
        tip_diameter_m: root_diameter_m * uniform(rng, 0.25, 1.0),
        curvature,
        ..straight()
    };
    let stiffness_n_m_rad = whisker.bending_stiffness_n_m2(0.0) / length_m * 10f64.powf(uniform(rng, -0.5, 2.0));
    Whisker { root_stiffness_n_m_rad: stiffness_n_m_rad, ..whisker }
}

/// A force across the whisker whose total rotation, if the whisker were straight, is about `angle_rad`.
fn random_load(rng: &mut Pcg64Mcg, whisker: &Whisker, angle_rad: f64) -> Load {
    let arc_m = whisker.length_m * uniform(rng, 0.15, 1.0);
    let steps = 200;
    let bend: f64 = (0..steps)
        .map(|i| {
            let s_m = arc_m * (f64::from(i) + 0.5) / f64::from(steps);
            (arc_m - s_m) / whisker.bending_stiffness_n_m2(s_m) * arc_m / f64::from(steps)
        })
        .sum();
    across(arc_m, uniform(rng, -angle_rad, angle_rad) / (bend + arc_m / whisker.root_stiffness_n_m_rad))
}

/// Mattiasson, "Numerical results from large deflection beam and frame problems analysed by means of elliptic
/// integrals", International Journal for Numerical Methods in Engineering 17, 1981: a cantilever under a load P of
/// constant direction at its tip. P L^2 / EI, and relative to the length the deflection w and the shortening u.
const MATTIASSON: [(f64, f64, f64); 4] =
    [(1.0, 0.30172, 0.05643), (2.0, 0.49346, 0.16064), (5.0, 0.71379, 0.38763), (10.0, 0.81061, 0.55500)];

#[test]
fn val_mattiasson() {
    let whisker = clamped();
    let elastica = solver(&whisker);
    let length_m = whisker.length_m;
    for (load, w, u) in MATTIASSON {
        let force_n = load * whisker.bending_stiffness_n_m2(0.0) / length_m.powi(2);
        // The force keeps its direction in Base: its components along the tip's tangent follow from the angle, by
        // bisection.
        let (mut low, mut high) = (0.0, FRAC_PI_2);
        let pressed = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            elastica
                .deflect(Load { arc_m: length_m, along_n: force_n * sin, left_n: force_n * cos, couple_n_m: 0.0 })
                .unwrap()
        };
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if pressed(middle).tangent_rad > middle { low = middle } else { high = middle }
        }
        let tip = pressed(low).point;
        println!("P L2/EI {load}: w/L {:.8}, u/L {:.8}", tip.y() / length_m, 1.0 - tip.x() / length_m);
        assert!((tip.y() / length_m - w).abs() < 0.6e-5, "{load}: {}", tip.y() / length_m);
        assert!((1.0 - tip.x() / length_m - u).abs() < 0.6e-5, "{load}: {}", 1.0 - tip.x() / length_m);
    }
}

#[test]
fn val_small_deflection() {
    let whisker = straight();
    let stiffness_n_m2 = whisker.bending_stiffness_n_m2(0.0);
    let (a, force_n) = (0.05, 1e-8);
    let pressed = solver(&whisker).deflect(across(a, force_n)).unwrap();
    // Root and wire in series.
    let root_rad = force_n * a / whisker.root_stiffness_n_m_rad;
    let deflection_m = force_n * a.powi(3) / (3.0 * stiffness_n_m2) + root_rad * a;
    let angle_rad = force_n * a * a / (2.0 * stiffness_n_m2) + root_rad;
    let tip_m = deflection_m + angle_rad * (whisker.length_m - a);
    assert!((pressed.point.y() / deflection_m - 1.0).abs() < 1e-9);
    assert!((pressed.tangent_rad / angle_rad - 1.0).abs() < 1e-9);
    assert!((pressed.tip.y() / tip_m - 1.0).abs() < 1e-9);
    assert!((pressed.moment_n_m / (force_n * a) - 1.0).abs() < 1e-9);
    assert!((pressed.rotation_rad / root_rad - 1.0).abs() < 1e-9);
}

#[test]
fn val_tapered_cone() {
    // A cone from d0 to d1 under a small force F at its tip deflects by 64 F L^3 / (3 pi E d0^3 d1).
    let whisker = Whisker { tip_diameter_m: 0.05e-3, ..clamped() };
    let force_n = 1e-10;
    let pressed = solver(&whisker).deflect(across(whisker.length_m, force_n)).unwrap();
    let (d0, d1) = (whisker.root_diameter_m, whisker.tip_diameter_m);
    let expected_m =
        64.0 * force_n * whisker.length_m.powi(3) / (3.0 * PI * whisker.youngs_modulus_pa * d0.powi(3) * d1);
    assert!((pressed.point.y() / expected_m - 1.0).abs() < 1e-9, "{} {expected_m}", pressed.point.y());
}

#[test]
fn val_clamped_rod_by_polar_angle() {
    // M r / EI = 3.0063 th - 0.0341 th^2 - 0.6683 th^3, a fit over 0 to 60 degrees.
    let whisker = clamped();
    let elastica = solver(&whisker);
    for degrees in [5.0_f64, 15.0, 30.0, 45.0, 60.0] {
        let th = degrees.to_radians();
        let contact = elastica.at_point(Point::new(0.04 * th.cos(), 0.04 * th.sin())).unwrap();
        let found = contact.deflection.moment_n_m * 0.04 / whisker.bending_stiffness_n_m2(0.0);
        let expected = 3.0063 * th - 0.0341 * th * th - 0.6683 * th.powi(3);
        assert!((found / expected - 1.0).abs() < 3e-3, "{degrees}: {found} {expected}");
    }
}

#[test]
fn val_natural_frequencies() {
    let clamped_hz: [f64; 3] = natural_frequencies_hz(&clamped()).unwrap();
    for (ratio, root) in
        [(clamped_hz[0], 1.875_104_068_7), (clamped_hz[1], 4.694_091_133_0), (clamped_hz[2], 7.854_757_438_2)]
            .map(|(f, root): (f64, f64)| (f / clamped_hz[0], (root / 1.875_104_068_7).powi(2)))
    {
        assert!((ratio / root - 1.0).abs() < 1e-7, "{ratio} {root}");
    }
    assert!((clamped_hz[0] - 16.67).abs() < 0.005, "{}", clamped_hz[0]);
    let suspended_hz: [f64; 3] = natural_frequencies_hz(&straight()).unwrap();
    assert!((suspended_hz[0] - 7.89).abs() < 0.005, "{}", suspended_hz[0]);
    // A root without stiffness: rotation of a rigid rod about its end, and the higher modes of a pinned beam.
    let soft = Whisker { root_stiffness_n_m_rad: 1e-9, ..straight() };
    let soft_hz: [f64; 3] = natural_frequencies_hz(&soft).unwrap();
    let inertia_kg_m2 = soft.density_kg_m3 * PI / 4.0 * soft.root_diameter_m.powi(2) * soft.length_m.powi(3) / 3.0;
    assert!((soft_hz[0] / ((1e-9 / inertia_kg_m2).sqrt() / (2.0 * PI)) - 1.0).abs() < 1e-5);
    assert!((soft_hz[1] / clamped_hz[1] - (3.926_602_f64 / 4.694_091).powi(2)).abs() < 1e-5);
    let bent = natural_frequencies_hz::<3>(&with_curvature(12.5)).unwrap_err().to_string();
    assert!(bent.contains("curvature") && bent.contains("12.5"), "{bent}");
}

#[test]
fn verif_unloaded_is_the_rest_shape() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for _ in 0..50 {
        let whisker = random_whisker(&mut rng);
        let arc_m = whisker.length_m * uniform(&mut rng, 0.1, 1.0);
        let pressed = solver(&whisker).deflect(across(arc_m, 0.0)).unwrap();
        let rest = whisker.rest_shape();
        assert!(pressed.point.distance(&rest.point(arc_m)) < 1e-15);
        assert!(pressed.tip.distance(&rest.point(whisker.length_m)) < 1e-15);
        assert!((pressed.tangent_rad - rest.tangent_rad(arc_m)).abs() < 1e-14);
        assert_eq!(pressed.moment_n_m, 0.0);
    }
}

#[test]
fn verif_centre_line_runs_from_root_to_tip_through_the_contact() {
    let mut rng = Pcg64Mcg::seed_from_u64(6);
    for _ in 0..100 {
        let whisker = random_whisker(&mut rng);
        let load = random_load(&mut rng, &whisker, 2.0);
        let elastica = solver(&whisker);
        let (pressed, line) = (elastica.deflect(load).unwrap(), elastica.line(load).unwrap());
        let near = |a: Point<Base>, b: Point<Base>| a.distance(&b) < 1e-14;
        assert!(near(line.at(0.0).0, Point::new(0.0, 0.0)));
        assert!((line.at(0.0).1 - pressed.rotation_rad).abs() < 1e-13);
        assert!(near(line.at(load.arc_m).0, pressed.point) && near(line.at(whisker.length_m).0, pressed.tip));
        // Inextensible: chords of a fine division add up to the length.
        let steps = 2000;
        let at = |i: i32| line.at(whisker.length_m * f64::from(i) / f64::from(steps)).0;
        let length_m: f64 = (0..steps).map(|i| at(i).distance(&at(i + 1))).sum();
        assert!((length_m / whisker.length_m - 1.0).abs() < 1e-5, "{length_m}");
    }
}

#[test]
fn verif_mirror() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for _ in 0..100 {
        let whisker = random_whisker(&mut rng);
        let load = random_load(&mut rng, &whisker, 2.0);
        let flipped =
            whisker.curvature.iter().map(|c| Curvature { curvature_per_m: -c.curvature_per_m, ..*c }).collect();
        let mirrored = Whisker { curvature: flipped, ..whisker.clone() };
        let here = solver(&whisker).deflect(load).unwrap();
        let there = solver(&mirrored).deflect(Load { left_n: -load.left_n, ..load }).unwrap();
        assert_eq!((here.point.x(), here.point.y()), (there.point.x(), -there.point.y()));
        assert_eq!((here.moment_n_m, here.tangent_rad), (-there.moment_n_m, -there.tangent_rad));
    }
}

#[test]
fn verif_point_inverts_deflect() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut worst: f64 = 0.0;
    for case in 0..2000 {
        let whisker = random_whisker(&mut rng);
        let load = random_load(&mut rng, &whisker, 1.2);
        let elastica = solver(&whisker);
        let pressed = elastica.deflect(load).unwrap();
        let contact = elastica.at_point(pressed.point).unwrap_or_else(|e| panic!("{case}: {e} {whisker:?} {load:?}"));
        let scale_n_m = whisker.bending_stiffness_n_m2(0.0) / whisker.length_m;
        let miss_m = contact.deflection.point.distance(&pressed.point) / whisker.length_m;
        let miss_arc = (contact.load.arc_m - load.arc_m).abs() / whisker.length_m;
        let miss_moment = (contact.deflection.moment_n_m - pressed.moment_n_m).abs() / scale_n_m;
        worst = worst.max(miss_m).max(miss_arc).max(miss_moment);
        assert!(worst < 1e-10, "{case}: {miss_m:e} {miss_arc:e} {miss_moment:e} {whisker:?} {load:?}");
        let again = elastica.at_point_near(pressed.point, &contact.load).unwrap();
        assert!((again.load.arc_m - load.arc_m).abs() < 1e-10 * whisker.length_m);
    }
    println!("at_point(deflect) over 2,000 whiskers: worst {worst:.1e}");
}

#[test]
fn verif_gradients_against_central_differences() {
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    for case in 0..200 {
        let whisker = random_whisker(&mut rng);
        let mut load = random_load(&mut rng, &whisker, 1.2);
        // Derivatives by arc length jump where the pre-curvature does; at the tip they are one-sided.
        load.arc_m = load.arc_m.min(0.95 * whisker.length_m);
        let mut end_m = 0.0;
        let near_a_jump = whisker.curvature.iter().any(|piece| {
            end_m += piece.length_m;
            (end_m - load.arc_m).abs() < 0.01 * whisker.length_m
        });
        if near_a_jump {
            continue;
        }
        let elastica = solver(&whisker);
        let point = elastica.deflect(load).unwrap().point;
        let at = |dx: f64, dy: f64| elastica.at_point_near(point.shifted(Vector2::new(dx, dy)), &load).unwrap();
        let here = at(0.0, 0.0);
        let h = 1e-4 * whisker.length_m;
        let differences = |value: fn(&PointContact) -> f64| {
            let central = |h: f64| {
                Vector2::new(value(&at(h, 0.0)) - value(&at(-h, 0.0)), value(&at(0.0, h)) - value(&at(0.0, -h)))
                    / (2.0 * h)
            };
            // Richardson's extrapolation: the error decreases with the fourth power of h.
            (4.0 * central(0.5 * h) - central(h)) / 3.0
        };
        for (name, found, expected) in [
            ("moment", here.moment_gradient_n, differences(|c| c.deflection.moment_n_m)),
            ("tangent", here.tangent_gradient_rad_m, differences(|c| c.deflection.tangent_rad)),
            ("arc", here.arc_gradient, differences(|c| c.load.arc_m)),
        ] {
            let error = (found - expected).norm() / found.norm();
            assert!(error < 1e-6, "{case} {name}: {found} {expected} {error:e}");
        }
    }
}

/// Conditions of a contact: the whisker's surface on the outline's support, the force along both normals, the
/// equilibrium under the load.
fn assert_touches(
    elastica: &Elastica,
    whisker: &Whisker,
    outline: &dyn Outline,
    base: &Pose<Base, World>,
    face: Face,
    touch: &Touch,
) {
    let side = -face.away_sign();
    let tolerance_m = 1e-12 * whisker.length_m;
    let pressed = elastica.deflect(touch.load).unwrap();
    assert!(pressed.point.distance(&touch.deflection.point) < tolerance_m);
    let radius_m = 0.5 * whisker.diameter_m(touch.load.arc_m);
    let normal = Vector2::new(touch.normal_rad.cos(), touch.normal_rad.sin());
    assert!(touch.surface.shifted(radius_m * normal).distance(&pressed.point) < tolerance_m);
    let surface = base.apply(touch.surface);
    let normal_rad = touch.normal_rad + base.yaw_rad();
    let world_normal = Vector2::new(normal_rad.cos(), normal_rad.sin());
    // On the supporting line, and not before or behind the outline.
    let support = outline.support(normal_rad).point;
    assert!(world_normal.dot(&(surface.vector() - support.vector())).abs() < 10.0 * tolerance_m);
    let (before, after) = (outline.support(normal_rad - 1e-6).point, outline.support(normal_rad + 1e-6).point);
    let along = Vector2::new(-world_normal.y, world_normal.x);
    let place = along.dot(&surface.vector());
    let room_m = 1e-6 * whisker.length_m;
    assert!(place > along.dot(&before.vector()) - room_m && place < along.dot(&after.vector()) + room_m);
    let (sin, cos) = (touch.normal_rad - pressed.tangent_rad).sin_cos();
    assert!((touch.load.along_n - touch.force_n * cos).abs() < 1e-12 * touch.force_n);
    assert!((touch.load.left_n - touch.force_n * sin).abs() < 1e-12 * touch.force_n);
    assert!(touch.force_n > 0.0);
    let slope = 0.5 * (whisker.tip_diameter_m - whisker.root_diameter_m) / whisker.length_m;
    match touch.regime {
        Regime::Side => {
            // Normal to the surface, which is inclined to the centre line by the slope of the radius.
            assert!((touch.load.along_n - touch.force_n * slope).abs() < 1e-12 * touch.force_n);
            assert!(touch.load.left_n * side < 0.0 && touch.load.arc_m <= whisker.length_m);
        }
        Regime::Tip => {
            assert!(touch.load.along_n <= touch.force_n * (slope + 1e-12) && touch.load.arc_m == whisker.length_m);
        }
    }
}

fn square(center: (f64, f64), half_m: f64, yaw_rad: f64) -> Polygon {
    let pose: Pose<Base, World> = Pose::new(center.0, center.1, yaw_rad);
    Polygon::new(
        &[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| pose.apply(Point::new(half_m * x, half_m * y))),
    )
    .unwrap()
}

#[test]
fn verif_contacts_satisfy_the_contact_conditions() {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let (mut touches, mut tips, mut flats, mut lost, mut bridged) = (0, 0, 0, 0, 0);
    for case in 0..1500 {
        let curvature_per_m = [0.0, 12.5, -12.5][case % 3];
        let whisker = Whisker { tip_diameter_m: 0.15e-3, ..with_curvature(curvature_per_m) };
        let elastica = solver(&whisker);
        let face = if rng.random() { Face::Left } else { Face::Right };
        let side = -face.away_sign();
        let arc_m = uniform(&mut rng, 0.03, 0.082);
        let size_m = uniform(&mut rng, 0.0, 0.02);
        let base = Pose::new(uniform(&mut rng, -0.1, 0.1), uniform(&mut rng, -0.1, 0.1), uniform(&mut rng, -7.0, 7.0));
        let place = whisker.rest_shape().beside(arc_m, side * (size_m - uniform(&mut rng, 0.0, 0.01)));
        let center = base.apply(place);
        let yaw_rad = uniform(&mut rng, -3.0, 3.0);
        let outline: Box<dyn Outline> = match case % 4 {
            0 => Box::new(Circle { center, radius_m: size_m }),
            1 => Box::new(Ellipse { center, semi_axes_m: [size_m + 1e-3, 0.6 * size_m + 1e-3], yaw_rad }),
            2 => Box::new(square((center.x(), center.y()), size_m + 1e-4, yaw_rad)),
            _ => Box::new(Circle { center, radius_m: 0.0 }),
        };
        match elastica.against(outline.as_ref(), &base, face) {
            Ok(None) => {}
            Ok(Some(touch)) => {
                touches += 1;
                tips += usize::from(touch.regime == Regime::Tip);
                let normal_rad = touch.normal_rad + base.yaw_rad();
                let off = |flat: &whisker::elastica::Flat| ((flat.normal_rad - normal_rad) / 2.0).sin().abs();
                flats += usize::from(outline.flats().iter().any(|flat| off(flat) < 1e-12));
                assert_touches(&elastica, &whisker, outline.as_ref(), &base, face, &touch);
                let again = elastica.against_near(outline.as_ref(), &base, face, &touch).unwrap().unwrap();
                assert!(again.surface.distance(&touch.surface) < 1e-12, "{case}");
            }
            Err(Failure::Bridged { .. }) => bridged += 1,
            Err(Failure::SlippedOff { .. } | Failure::Buckled { .. }) => lost += 1,
            Err(error) => panic!("{case}: {error}"),
        }
    }
    println!(
        "{touches} touch, {tips} of them at the tip, {flats} on a flat; {lost} have no equilibrium, {bridged} bridge"
    );
    assert!(touches > 800 && tips > 20 && flats > 20, "{touches} {tips} {flats}");
}

#[test]
fn verif_a_thin_pin_equals_a_point() {
    let whisker = Whisker {
        root_diameter_m: 1e-8,
        tip_diameter_m: 1e-8,
        youngs_modulus_pa: 60e9 * (0.25e-3f64 / 1e-8).powi(4),
        ..straight()
    };
    let elastica = solver(&whisker);
    let pin = Circle { center: Point::new(0.05, -0.01), radius_m: 0.0 };
    let touch = elastica.against(&pin, &Pose::new(0.0, 0.0, 0.0), Face::Left).unwrap().unwrap();
    let contact = elastica.at_point(touch.deflection.point).unwrap();
    assert!(
        (contact.load.arc_m - touch.load.arc_m).abs() < 1e-12 && (contact.load.left_n + touch.force_n).abs() < 1e-12
    );
    assert!(touch.surface.distance(&Point::new(0.05, -0.01)) < 1e-14);
}

#[test]
fn verif_a_sweep_is_continuous_from_side_to_tip() {
    sweep_off(&straight());
    // A steep taper, on which a gap between side and tip would show.
    sweep_off(&Whisker { root_diameter_m: 0.4e-3, tip_diameter_m: 0.1e-3, ..straight() });
}

/// Moves the base back along the whisker until the contact reaches the tip and slips off.
fn sweep_off(whisker: &Whisker) {
    let elastica = solver(whisker);
    let circle = Circle { center: Point::new(0.06, 0.01), radius_m: 0.015 };
    let mut last: Option<Touch> = None;
    let (mut seen_tip, mut lost) = (false, None);
    for step in 0..4000 {
        let base = Pose::new(-1e-5 * f64::from(step), 0.0, 0.0);
        match elastica.against(&circle, &base, Face::Left) {
            Ok(Some(touch)) => {
                if let Some(last) = last {
                    assert!(touch.deflection.point.distance(&last.deflection.point) < 1e-3, "{step}");
                    let change = (touch.deflection.moment_n_m - last.deflection.moment_n_m).abs();
                    assert!(change < 1e-6, "{step}: {last:?} {touch:?}");
                    assert!(!(seen_tip && touch.regime == Regime::Side), "{step}");
                    let turn = (touch.normal_rad - last.normal_rad).abs();
                    assert!(turn < 2e-3, "{step}: {turn}");
                }
                seen_tip |= touch.regime == Regime::Tip;
                last = Some(touch);
            }
            other => {
                lost = Some(other);
                break;
            }
        }
    }
    assert!(seen_tip);
    println!("{lost:?} after {last:?}");
    assert!(matches!(lost, Some(Err(Failure::SlippedOff { .. }) | Ok(None))), "{lost:?}");
}

#[test]
fn verif_a_polygon_with_many_sides_tends_to_a_circle() {
    let elastica = solver(&with_curvature(-12.5));
    let (center, radius_m) = (Point::new(0.045, -0.005), 0.012);
    let circle = Circle { center, radius_m };
    let sides = 4000;
    let vertices: Vec<Point<World>> =
        (0..sides).map(|i| circle.support(2.0 * PI * f64::from(i) / f64::from(sides)).point).collect();
    let base = Pose::new(0.0, 0.0, 0.05);
    let smooth = elastica.against(&circle, &base, Face::Left).unwrap().unwrap();
    let faceted = elastica.against(&Polygon::new(&vertices).unwrap(), &base, Face::Left).unwrap().unwrap();
    assert!(smooth.surface.distance(&faceted.surface) < 2e-5);
    assert!((smooth.deflection.moment_n_m / faceted.deflection.moment_n_m - 1.0).abs() < 1e-4);
}

#[test]
fn robust_no_contact_is_none() {
    let elastica = solver(&straight());
    let base = Pose::new(0.0, 0.0, 0.0);
    for (x, y) in [(0.05, 0.03), (0.2, 0.0), (-0.05, 0.0)] {
        let circle = Circle { center: Point::new(x, y), radius_m: 0.01 };
        assert_eq!(elastica.against(&circle, &base, Face::Left), Ok(None), "{x} {y}");
    }
}

#[test]
fn robust_a_missing_equilibrium_is_an_error() {
    let elastica = solver(&straight());
    assert!(matches!(elastica.at_point(Point::new(0.09, 0.01)), Err(Failure::OutOfReach { .. })));
    let base = Pose::new(0.0, 0.0, 0.0);
    let deep = Circle { center: Point::new(0.079, -0.04), radius_m: 0.0 };
    assert!(matches!(elastica.against(&deep, &base, Face::Left), Err(Failure::SlippedOff { .. })));
    // A whisker with a bump and a hooked tip under a flat that touches both.
    let pieces = [(0.02, 25.0), (0.03, -25.0), (0.025, 25.0)];
    let curvature = pieces.map(|(length_m, curvature_per_m)| Curvature { length_m, curvature_per_m }).to_vec();
    let wavy = Whisker { length_m: 0.075, curvature, ..straight() };
    let bridged = solver(&wavy).against(&square((0.045, 0.058), 0.05, 0.0), &base, Face::Left);
    assert!(matches!(bridged, Err(Failure::Bridged { .. })), "{bridged:?}");
}

#[test]
fn robust_invalid_input_is_named() {
    let elastica = solver(&straight());
    for (load, expected) in [
        (across(0.0, 1e-3), "arc length of the contact: found 0 m"),
        (across(0.081, 1e-3), "found 0.081 m, expected more than 0 and at most the whisker's length of 0.08 m"),
        (across(f64::NAN, 1e-3), "arc_m: found NaN, expected a finite number"),
        (across(0.05, 1e12), "exceeds the capacity of the whisker"),
    ] {
        let message = elastica.deflect(load).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    assert!(elastica.at_point(Point::new(f64::INFINITY, 0.0)).is_err());
    let base = Pose::new(0.0, 0.0, 0.0);
    let nowhere = Circle { center: Point::new(f64::NAN, 0.0), radius_m: 0.01 };
    let message = elastica.against(&nowhere, &base, Face::Left).unwrap_err().to_string();
    assert!(message.contains("outline: found NaN"), "{message}");
    // A contact with one object is a valid initial guess for another one.
    let touch = elastica.against(&square((0.05, 0.005), 0.01, 0.1), &base, Face::Left).unwrap().unwrap();
    let circle = Circle { center: Point::new(0.05, 0.005), radius_m: 0.01 };
    let near = elastica.against_near(&circle, &base, Face::Left, &touch).unwrap().unwrap();
    let cold = elastica.against(&circle, &base, Face::Left).unwrap().unwrap();
    assert!(near.surface.distance(&cold.surface) < 1e-12);
    let clockwise = [Point::new(0.0, 0.0), Point::new(0.0, 1.0), Point::new(1.0, 0.0)];
    assert_eq!(Polygon::new(&clockwise).unwrap_err().vertex, 0);
}

/// Random whiskers and loads, solved by SciPy (`sim/whisker_sim/physics/scipy_elastica.py`). The environment variable
/// names another file of such cases.
#[test]
fn val_agrees_with_scipy() {
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/elastica.csv");
    let path = std::env::var_os("ELASTICA_CASES").map_or(golden, PathBuf::from);
    let text = std::fs::read_to_string(&path).unwrap();
    let mut worst = [0.0_f64; 4];
    let mut count = 0;
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| -> f64 { fields[i].parse().unwrap() };
        let pieces = fields[5].split(';').map(|piece| {
            let (length, curvature) = piece.split_once(':').unwrap();
            Curvature { length_m: length.parse().unwrap(), curvature_per_m: curvature.parse().unwrap() }
        });
        let whisker = Whisker {
            length_m: number(0),
            root_diameter_m: number(1),
            tip_diameter_m: number(2),
            youngs_modulus_pa: number(3),
            root_stiffness_n_m_rad: number(4),
            curvature: pieces.collect(),
            ..straight()
        };
        let load = Load { arc_m: number(6), along_n: number(7), left_n: number(8), couple_n_m: number(9) };
        let pressed = solver(&whisker).deflect(load).unwrap();
        let errors = [
            pressed.point.distance(&Point::new(number(10), number(11))) / load.arc_m,
            (pressed.tangent_rad - number(12)).abs(),
            (pressed.moment_n_m / number(13) - 1.0).abs(),
            pressed.tip.distance(&Point::new(number(14), number(15))) / whisker.length_m,
        ];
        worst = std::array::from_fn(|i| worst[i].max(errors[i]));
        count += 1;
        assert!(errors.iter().all(|&error| error < 1e-9), "line {}: {errors:?}", count + 1);
    }
    assert!(count >= 200, "{count} cases");
    println!(
        "{count} cases: worst relative error of point {:.1e}, tangent {:.1e}, moment {:.1e}, tip {:.1e}",
        worst[0], worst[1], worst[2], worst[3]
    );
}

/// Discs, solved by SciPy (`contact_with_disc` of `sim/whisker_sim/physics/scipy_elastica.py`): arc length, force,
/// moment.
#[test]
fn val_discs_agree_with_scipy() {
    let tapered = Whisker {
        tip_diameter_m: 0.1e-3,
        curvature: [(0.03, 0.0), (0.05, 12.5)]
            .map(|(length_m, curvature_per_m)| Curvature { length_m, curvature_per_m })
            .to_vec(),
        ..straight()
    };
    let cases = [
        (
            straight(),
            (0.05, 0.005, 0.015),
            Face::Left,
            [0.04763115912555724, 5.957330728150167e-4, -2.8365669470095293e-5],
        ),
        (
            tapered.clone(),
            (0.055, 0.016, 0.015),
            Face::Left,
            [0.05954852128479336, 1.2687084084503982e-4, -7.267156954969564e-6],
        ),
        (
            tapered,
            (0.05, -0.004, 0.01),
            Face::Right,
            [0.04735426011732761, 2.1249902139614365e-4, 9.845821176456112e-6],
        ),
    ];
    for (whisker, (x, y, radius_m), face, expected) in cases {
        let disc = Circle { center: Point::new(x, y), radius_m };
        let touch = solver(&whisker).against(&disc, &Pose::new(0.0, 0.0, 0.0), face).unwrap().unwrap();
        let found = [touch.load.arc_m, touch.force_n, touch.deflection.moment_n_m];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found / expected - 1.0).abs() < 1e-9), "{found:?}");
    }
}

/// Derivatives at fixed positions by coordinates and by the ratio of friction to normal force, and its sign: friction
/// towards the root on a straight whisker lowers the reading of a contact at the same place.
#[test]
fn verif_friction_derivatives_are_differences() {
    let tapered = Whisker { tip_diameter_m: 0.1e-3, ..with_curvature(12.5) };
    for (whisker, face, y) in
        [(straight(), Face::Left, -0.012), (tapered.clone(), Face::Left, 0.004), (tapered, Face::Right, 0.028)]
    {
        let elastica = solver(&whisker);
        let point = Point::new(0.05, y);
        for ratio in [-0.6, 0.0, 0.4] {
            let at = |point, ratio| elastica.at_point_with_friction(point, Friction { face, ratio }).unwrap();
            let found = at(point, ratio);
            let load = found.load;
            assert_eq!(load.couple_n_m, ratio * 0.5 * whisker.diameter_m(load.arc_m) * load.left_n);
            let step = 1e-5;
            let slope = |of: &dyn Fn(&PointContact) -> f64| {
                (of(&at(point, ratio + step)) - of(&at(point, ratio - step))) / (2.0 * step)
            };
            let near = |found: f64, expected: f64, scale: f64| (found - expected).abs() < 1e-7 * scale;
            let moment = found.deflection.moment_n_m.abs();
            assert!(near(found.moment_by_friction_n_m, slope(&|it| it.deflection.moment_n_m), moment));
            assert!(near(found.tangent_by_friction_rad, slope(&|it| it.deflection.tangent_rad), 1.0));
            assert!(near(found.arc_by_friction_m, slope(&|it| it.load.arc_m), 0.05));
            let step_m = 1e-7;
            let ahead = |dx: f64, dy: f64| at(Point::new(0.05 + dx, y + dy), ratio).deflection.moment_n_m;
            let by_x = (ahead(step_m, 0.0) - ahead(-step_m, 0.0)) / (2.0 * step_m);
            let by_y = (ahead(0.0, step_m) - ahead(0.0, -step_m)) / (2.0 * step_m);
            assert!(
                near(found.moment_gradient_n.x, by_x, 100.0 * moment)
                    && near(found.moment_gradient_n.y, by_y, 100.0 * moment)
            );
        }
    }
}

/// A disc with friction gives the load that the point contact has at the same place.
#[test]
fn verif_a_disc_with_friction_is_a_point_with_friction() {
    for (whisker, y, face) in [(straight(), 0.005, Face::Left), (with_curvature(12.5), 0.0105, Face::Right)] {
        let disc = Circle { center: Point::new(0.05, y), radius_m: 0.01 };
        let elastica = solver(&whisker);
        for ratio in [-0.8, -0.3, 0.0, 0.5] {
            let touch = elastica.against_with_friction(&disc, &Pose::new(0.0, 0.0, 0.0), face, ratio).unwrap().unwrap();
            let point = elastica.at_point_with_friction(touch.deflection.point, Friction { face, ratio }).unwrap();
            assert!(
                (point.load.arc_m - touch.load.arc_m).abs() < 1e-12
                    && (point.load.left_n / touch.load.left_n - 1.0).abs() < 1e-9
            );
            assert!((point.load.couple_n_m - touch.load.couple_n_m).abs() < 1e-9 * touch.deflection.moment_n_m.abs());
            assert!((touch.force_n - touch.load.left_n.hypot(touch.load.along_n)).abs() < 1e-15);
        }
    }
}

/// `cargo test --release -p whisker --test elastica -- --ignored --nocapture`
#[test]
#[ignore = "a measurement of time, for a release build"]
fn speed() {
    let circle = Circle { center: Point::new(0.05, 0.005), radius_m: 0.015 };
    let base = Pose::new(0.0, 0.0, 0.0);
    for (name, whisker) in [
        ("straight", straight()),
        ("curved", with_curvature(12.5)),
        ("tapered", Whisker { tip_diameter_m: 0.1e-3, ..straight() }),
    ] {
        let elastica = solver(&whisker);
        let pressed = elastica.deflect(across(0.05, -3e-3)).unwrap();
        let touch = elastica.against(&circle, &base, Face::Left).unwrap().unwrap();
        let near = Load { arc_m: 0.0501, ..across(0.05, -3.03e-3) };
        let moved = Pose::new(0.0, 1e-4, 0.0);
        let time = |what: &str, run: &dyn Fn()| {
            let start = Instant::now();
            (0..20_000).for_each(|_| run());
            println!("{name:9} {what:24} {:6.2} us", start.elapsed().as_secs_f64() * 50.0);
        };
        time("deflect", &|| {
            std::hint::black_box(elastica.deflect(std::hint::black_box(across(0.05, -3e-3)))).unwrap();
        });
        time("at_point", &|| {
            std::hint::black_box(elastica.at_point(std::hint::black_box(pressed.point))).unwrap();
        });
        time("at_point_near", &|| {
            std::hint::black_box(elastica.at_point_near(std::hint::black_box(pressed.point), &near)).unwrap();
        });
        time("against circle", &|| {
            std::hint::black_box(elastica.against(&circle, std::hint::black_box(&base), Face::Left)).unwrap();
        });
        time("against_near circle", &|| {
            std::hint::black_box(elastica.against_near(&circle, std::hint::black_box(&moved), Face::Left, &touch))
                .unwrap();
        });
    }
}
