//! The whisker in space against the planar elastica, closed forms and published results.

use std::f64::consts::{FRAC_PI_4, PI};
use std::path::PathBuf;

use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use whisker::elastica::{Elastica, Failure, Load};
use whisker::rod::{Rod, SpatialDeflection, SpatialLoad, Suspension};
use whisker::{Curvature, Whisker};

const POISSON_RATIO: f64 = 0.33;

fn tapered() -> Whisker {
    let curved = Whisker::curved();
    Whisker { tip_diameter_m: 0.4 * curved.root_diameter_m, ..curved }
}

fn whiskers() -> [Whisker; 3] {
    [Whisker::straight(), Whisker::curved(), tapered()]
}

/// Suspension that is stiffer in pitch and twist than in yaw.
fn uneven(whisker: &Whisker) -> Suspension {
    let stiffness = whisker.root_stiffness_n_m_rad;
    Suspension { yaw_n_m_rad: stiffness, pitch_n_m_rad: 1.7 * stiffness, twist_n_m_rad: 0.6 * stiffness }
}

/// Force of which the whisker's tip moves by about a third of its length.
fn scale_n(whisker: &Whisker) -> f64 {
    let bending = whisker.length_m / whisker.bending_stiffness_n_m2(0.0) + 3.0 / whisker.root_stiffness_n_m_rad;
    1.0 / (whisker.length_m * bending)
}

#[test]
fn verif_a_load_in_the_plane_gives_the_planar_elastica() {
    let mut worst = 0.0_f64;
    for whisker in whiskers() {
        let (rod, planar) =
            (Rod::new(&whisker, uneven(&whisker), POISSON_RATIO).unwrap(), Elastica::new(&whisker).unwrap());
        for share in [0.3, 0.55, 0.8, 1.0] {
            for force in [-1.0, -0.3, 0.2, 0.9] {
                let (arc_m, left_n) = (share * whisker.length_m, force * scale_n(&whisker) / share.powi(2));
                let along_n = 0.1 * left_n;
                let expected = planar.deflect(Load { arc_m, along_n, left_n, couple_n_m: 0.0 }).unwrap();
                let found = rod.deflect(SpatialLoad { arc_m, force_n: Vector3::new(along_n, left_n, 0.0) }).unwrap();
                let moment = found.moment_n_m / expected.moment_n_m;
                assert!((moment - Vector3::z()).norm() < 1e-12, "{}: {moment}", whisker.name);
                let point = expected.point.vector().push(0.0);
                assert!((found.point - point).norm() < 1e-13 * whisker.length_m, "{}: {}", whisker.name, found.point);
                let tangent = Vector3::new(expected.tangent_rad.cos(), expected.tangent_rad.sin(), 0.0);
                assert!((found.directors.column(0) - tangent).norm() < 1e-12, "{}", whisker.name);
                assert!((found.root.yaw_rad - expected.rotation_rad).abs() < 1e-12, "{}", whisker.name);
                worst = worst.max((moment - Vector3::z()).norm());
            }
        }
    }
    println!("planar loads: worst relative deviation of the moment {worst:.1e}");
}

#[test]
fn verif_a_clamped_straight_wire_is_alike_in_every_direction() {
    // The springs of a suspension in series are alike only for small angles.
    let whisker = Whisker { root_stiffness_n_m_rad: 1e9, ..Whisker::straight() };
    let rod = Rod::round(&whisker, POISSON_RATIO).unwrap();
    let force_n = scale_n(&whisker);
    let radius = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let load = SpatialLoad { arc_m: 0.9 * whisker.length_m, force_n: force_n * Vector3::new(0.0, cos, sin) };
        let found = rod.deflect(load).unwrap();
        let across = found.point.yz().norm();
        // The load is in a plane through the wire; so is the deflection. The moment is across it.
        assert!((found.point.z * cos - found.point.y * sin).abs() < 1e-12 * across);
        assert!(found.moment_n_m.x.abs() < 1e-12 * found.moment_n_m.norm());
        (found.point.x, across)
    };
    let expected = radius(0.0);
    for degrees in [30.0, 90.0, 200.0, 315.0] {
        let found = radius(degrees);
        assert!((found.0 - expected.0).abs() + (found.1 - expected.1).abs() < 1e-13, "{degrees}: {found:?}");
    }
}

/// Moment, force and pose in equilibrium: the moment at the root is that of the force about it, and the directors are orthonormal.
#[test]
fn verif_force_and_moment_balance_about_the_root() {
    for whisker in whiskers() {
        let rod = Rod::new(&whisker, uneven(&whisker), POISSON_RATIO).unwrap();
        let force_n = scale_n(&whisker) * Vector3::new(0.2, -0.7, 0.9);
        let found = rod.deflect(SpatialLoad { arc_m: 0.8 * whisker.length_m, force_n }).unwrap();
        let moment = found.point.cross(&found.force_n);
        assert!((moment - found.moment_n_m).norm() < 1e-12 * moment.norm(), "{}", whisker.name);
        let error = found.directors.tr_mul(&found.directors) - Matrix3::identity();
        assert!(error.norm() < 1e-12 && found.directors.determinant() > 0.0, "{}", whisker.name);
    }
}

/// A cantilever bent to a quarter of a circle under a small force out of its plane at its tip: Castigliano's theorem gives the
/// displacement `P R^3 (pi / (4 EI) + (3 pi / 4 - 2) / GJ)` (Timoshenko, "Strength of Materials" II, 1941, curved bars).
#[test]
fn val_quarter_circle_under_a_force_out_of_its_plane() {
    let radius_m: f64 = 0.05;
    let length_m = 0.5 * PI * radius_m;
    let whisker = Whisker {
        length_m,
        curvature: vec![Curvature::new(length_m, 1.0 / radius_m)],
        root_stiffness_n_m_rad: 1e9,
        ..Whisker::straight()
    };
    let rod = Rod::round(&whisker, POISSON_RATIO).unwrap();
    let stiffness = whisker.bending_stiffness_n_m2(0.0);
    let force_n = 1e-4 * stiffness / radius_m.powi(2);
    let found = rod.deflect(SpatialLoad { arc_m: length_m, force_n: Vector3::new(0.0, 0.0, force_n) }).unwrap();
    let twist = (1.0 + POISSON_RATIO) * (0.75 * PI - 2.0);
    let expected_m = force_n * radius_m.powi(3) * (0.25 * PI + twist) / stiffness;
    let error = (found.point.z / expected_m - 1.0).abs();
    assert!(error < 1e-3, "{} against {expected_m}", found.point.z);
    println!("quarter circle: relative error of the displacement {error:.1e}");
}

/// Equilibrium under a force that is fixed in Base, by continuation in its size and Newton's method with differences.
fn under_fixed_force(rod: &Rod, arc_m: f64, force: Vector3<f64>) -> SpatialDeflection {
    let deflect = |force_n: Vector3<f64>| rod.deflect(SpatialLoad { arc_m, force_n }).unwrap();
    let mut along_directors = Vector3::zeros();
    for share in (1..=50).map(|step| f64::from(step) / 50.0) {
        for _ in 0..20 {
            let residual = deflect(along_directors).force_n - share * force;
            let step = 1e-6 * force.norm();
            let column = |axis| {
                (deflect(along_directors + step * Vector3::ith(axis, 1.0)).force_n - share * force - residual) / step
            };
            let jacobian = Matrix3::from_columns(&[column(0), column(1), column(2)]);
            along_directors -= jacobian.try_inverse().unwrap() * residual;
        }
    }
    deflect(along_directors)
}

/// Bend of 45 degrees, radius 100 in, of a square inch of a material with E = 10 Mpsi and no lateral contraction, under
/// a vertical force at its tip: positions of the tip (in), to half a percent of its displacement. Bathe and Bolourchi,
/// "Large displacement analysis of three-dimensional beam structures", Int. J. Numer. Methods Eng. 14 (1979); Simo and
/// Vu-Quoc, Comput. Methods Appl. Mech. Eng. 58 (1986), whose rod has the same stiffness in twist as in bending, as the
/// round wire here.
#[test]
fn val_bend_of_bathe_and_bolourchi() {
    let (radius, length) = (100.0, 100.0 * FRAC_PI_4);
    let (modulus, second_moment): (f64, f64) = (1e7, 1.0 / 12.0);
    let diameter = (64.0 * second_moment / PI).powf(0.25);
    let whisker = Whisker {
        length_m: length,
        root_diameter_m: diameter,
        tip_diameter_m: diameter,
        youngs_modulus_pa: modulus,
        curvature: vec![Curvature::new(length, 1.0 / radius)],
        root_stiffness_n_m_rad: 1e15,
        ..Whisker::straight()
    };
    let rod = Rod::round(&whisker, 0.0).unwrap();
    for (force, published) in [(300.0, [22.33, 58.84, 40.08]), (600.0, [15.79, 47.23, 53.37])] {
        let vertical = Vector3::new(0.0, 0.0, force);
        let found = under_fixed_force(&rod, length, vertical);
        assert!((found.force_n - vertical).norm() < 1e-6 * force, "{}", found.force_n);
        // The published axes: from the centre of the circle, x across the root's tangent, y along it, z up.
        let tip = [radius * (1.0 - 0.5_f64.sqrt()), radius * 0.5_f64.sqrt()];
        let rest = rod.deflect(SpatialLoad { arc_m: length, force_n: Vector3::zeros() }).unwrap().point;
        assert!((rest.x - tip[1]).abs() + (rest.y - tip[0]).abs() < 1e-9);
        let position = Vector3::new(found.point.y, found.point.x, found.point.z);
        let displacement = position - Vector3::new(tip[0], tip[1], 0.0);
        let error = (position - Vector3::from(published)).norm() / displacement.norm();
        assert!(error < 5e-3, "{force}: {position}, published {published:?}");
        println!("bend, force {force}: relative error of the displacement {error:.1e}");
    }
}

#[test]
fn robust_loads_off_the_whisker_and_not_finite_are_refused() {
    let whisker = Whisker::curved();
    let rod = Rod::round(&whisker, POISSON_RATIO).unwrap();
    let force_n = Vector3::new(0.0, 1e-3, 0.0);
    for arc_m in [-0.01, 0.0, 1.01 * whisker.length_m] {
        let refused = rod.deflect(SpatialLoad { arc_m, force_n });
        assert!(matches!(refused, Err(Failure::OffTheWhisker { .. })), "{refused:?}");
    }
    let refused = rod.deflect(SpatialLoad { arc_m: 0.05, force_n: Vector3::new(0.0, f64::NAN, 0.0) });
    assert!(matches!(refused, Err(Failure::NotFinite { what: "force_n.y", .. })), "{refused:?}");
    let refused = rod.deflect(SpatialLoad { arc_m: 0.05, force_n: Vector3::new(0.0, 0.0, 1e12) });
    assert!(matches!(refused, Err(Failure::TooStrong { .. })), "{refused:?}");
    let far = rod.at_point(Vector3::new(0.0, 0.0, 1.1 * whisker.length_m));
    assert!(matches!(far, Err(Failure::OutOfReach { .. })), "{far:?}");
    let stiffness = Suspension { twist_n_m_rad: 0.0, ..uneven(&whisker) };
    assert_eq!(Rod::new(&whisker, stiffness, POISSON_RATIO).unwrap_err().key, "suspension.twist_n_m_rad");
    assert_eq!(Rod::round(&whisker, 0.6).unwrap_err().key, "poisson_ratio");
}

/// The inverse map returns the load, and its derivatives are those of differences.
#[test]
fn verif_the_contact_at_a_point_inverts_the_forward_map() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for whisker in whiskers().iter().cycle().take(150) {
        let rod = Rod::new(whisker, uneven(whisker), POISSON_RATIO).unwrap();
        let [share, size, direction] =
            [(0.35, 0.95), (0.02, 0.6), (0.0, 2.0 * PI)].map(|(low, high)| rng.random_range(low..high));
        let across = Vector3::new(0.0, direction.cos(), direction.sin());
        let force_n = size * scale_n(whisker) / (share * share) * across;
        let pressed = rod.deflect(SpatialLoad { arc_m: share * whisker.length_m, force_n }).unwrap();
        let contact = rod.at_point(pressed.point).unwrap();
        let case = format!("{} {share} {size} {direction}", whisker.name);
        assert!(
            (contact.deflection.moment_n_m - pressed.moment_n_m).norm() < 1e-9 * pressed.moment_n_m.norm(),
            "{case}"
        );
        assert!((contact.load.force_n - force_n).norm() < 1e-8 * force_n.norm(), "{case}");

        let step_m = 1e-6 * whisker.length_m;
        for axis in 0..3 {
            let offset = step_m * Vector3::ith(axis, 1.0);
            let [after, before] = [offset, -offset].map(|offset| rod.at_point(pressed.point + offset).unwrap());
            let moment = (after.deflection.moment_n_m - before.deflection.moment_n_m) / (2.0 * step_m);
            let expected = contact.moment_gradient_n.column(axis);
            assert!(
                (moment - expected).norm() < 1e-5 * contact.moment_gradient_n.norm(),
                "{case}: {moment} {expected}"
            );
            let force = (after.load.force_n - before.load.force_n).yz() / (2.0 * step_m);
            let expected = contact.force_gradient_n_m.column(axis);
            assert!((force - expected).norm() < 1e-5 * contact.force_gradient_n_m.norm(), "{case}: {force} {expected}");
        }
    }
}

/// Random whiskers and loads, solved by SciPy (`sim/whisker_sim/physics/scipy_rod.py`). The environment variable names another file
/// of solved cases, as the study `space_oracle` writes it, with solutions by NumPy.
#[test]
fn val_agrees_with_scipy() {
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/rod.csv");
    let path = std::env::var_os("ROD_CASES").map_or(golden, PathBuf::from);
    let text = std::fs::read_to_string(&path).unwrap();
    let mut worst = [0.0_f64; 3];
    let mut count = 0;
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| -> f64 { fields[i].parse().unwrap() };
        let vector = |i: usize| Vector3::new(number(i), number(i + 1), number(i + 2));
        let pieces = fields[4].split(';').map(|piece| {
            let (length, curvature) = piece.split_once(':').unwrap();
            Curvature::new(length.parse().unwrap(), curvature.parse().unwrap())
        });
        let whisker = Whisker {
            length_m: number(0),
            root_diameter_m: number(1),
            tip_diameter_m: number(2),
            youngs_modulus_pa: number(3),
            curvature: pieces.collect(),
            ..Whisker::straight()
        };
        let suspension = Suspension { yaw_n_m_rad: number(5), pitch_n_m_rad: number(6), twist_n_m_rad: number(7) };
        let load = SpatialLoad { arc_m: number(9), force_n: vector(10) };
        let pressed = Rod::new(&whisker, suspension, number(8)).unwrap().deflect(load).unwrap();
        let errors = [
            (pressed.point - vector(13)).norm() / load.arc_m,
            (pressed.directors.column(0) - vector(16)).norm(),
            (pressed.moment_n_m - vector(19)).norm() / vector(19).norm(),
        ];
        worst = std::array::from_fn(|i| worst[i].max(errors[i]));
        count += 1;
        assert!(errors.iter().all(|&error| error < 1e-9), "line {}: {errors:?}", count + 1);
    }
    assert!(count >= 100, "{count} cases");
    println!(
        "{count} cases: worst relative error of point {:.1e}, tangent {:.1e}, moment {:.1e}",
        worst[0], worst[1], worst[2]
    );
}
