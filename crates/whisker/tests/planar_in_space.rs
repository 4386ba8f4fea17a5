//! Planar contacts through the estimators in space: a planar motion is one in space, in which nothing leaves the plane.

mod space_world;

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use whisker::elastica::Elastica;
use whisker::estimators::{self, Runner};
use whisker::events::TouchConfig;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::{self, Face, FitData};
use whisker::space::estimators as in_space;
use whisker::{Whisker, space};

use space_world::{RATE_HZ, knowledge};

const ROWS: u32 = 750;
const SEEDS: u64 = 10;

/// Arc length at which the undeflected whisker first touches the pin.
const TOUCHED_M: f64 = 0.048;

/// Rows after which errors count: half a second after the touch.
const COUNTED: usize = 175;

/// The calibration in the plane with the same domain and noise as that in space.
fn planar_knowledge(in_space: &in_space::Knowledge) -> Arc<estimators::Knowledge> {
    let whisker = in_space.calibrated.whisker.whisker.clone();
    let (mechanics, rest) = (Elastica::new(&whisker).unwrap(), whisker.rest_shape());
    let line = |along_m: f64| {
        let at = |step: u32| {
            let away_m = 3.0 * along_m * along_m * f64::from(step) / 20.0;
            let contact = rest.beside(along_m, away_m);
            let reading_n_m = mechanics.at_point(contact).unwrap().deflection.moment_n_m;
            sensor::Sample { contact, reading_n_m }
        };
        (1..=20).map(at).collect::<Vec<_>>()
    };
    let lines: Vec<Vec<sensor::Sample>> = (0..9).map(|node| line(0.03 + 0.004 * f64::from(node))).collect();
    let row = sensor::model("elastica").unwrap();
    let data = FitData {
        whisker: &whisker,
        face: Face::Right,
        measured: &lines,
        reference: &lines,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    let face = sensor::fit(row, &(row.defaults)(), &data).unwrap().face;
    Arc::new(estimators::Knowledge {
        rest,
        whisker,
        faces: vec![Arc::new(face)],
        noise_sd_n_m: in_space.noise_sd_n_m,
        base_noise: Default::default(),
        rate_hz: RATE_HZ,
        contact_prior: None,
    })
}

/// Pose of the base at a row: a push of 5 mm in 0.5 s, then slow strokes and turns in the plane.
fn base(row: u32) -> Pose<Base, World> {
    let t_s = f64::from(row) / RATE_HZ;
    let push = 0.5 - 0.5 * (PI * (t_s / 0.5).min(1.0)).cos();
    let roam = (t_s - 0.5).max(0.0).powi(2) / ((t_s - 0.5).max(0.0) + 0.2);
    let y_m = 0.5e-3 - 5e-3 * push - 0.8e-3 * (7.0 * roam).sin();
    Pose::new(1.5e-3 * (5.0 * roam).sin(), y_m, 0.03 * (4.0 * roam).sin())
}

/// The same pose in space.
fn raised(base: &Pose<Base, World>) -> space::frames::Pose<Base, World> {
    let position = Vector3::new(base.origin().x(), base.origin().y(), 0.0);
    space::frames::Pose::new(position, Rotation3::new(Vector3::z() * base.yaw_rad()))
}

/// RMS errors in the plane of an estimator in the plane and of one in space on the same pin, over all noise seeds.
fn errors_m(whisker: Whisker, planar: &str, spatial: &str) -> [f64; 2] {
    let of_space = knowledge(whisker);
    let of_plane = planar_knowledge(&of_space);
    let mechanics = Elastica::new(&of_plane.whisker).unwrap();
    let first = of_plane.rest.beside(TOUCHED_M, 0.0);
    let pin: Point<World> = Point::new(first.x(), first.y());
    let mut sums = [(0.0, 0); 2];
    for seed in 1..=SEEDS {
        let mut random = Pcg64::seed_from_u64(seed);
        let row = estimators::estimator(planar).unwrap();
        let method = (row.build)(&(row.defaults)(), &of_plane).unwrap();
        let runner = Runner::new(method, of_plane.clone(), seed);
        let mut in_plane = estimators::Estimator::new(runner, TouchConfig::default());
        let row = in_space::spatial_estimator(spatial).unwrap();
        let mut spatial_estimator = row.build(&row.defaults(), TouchConfig::default(), &of_space).unwrap();
        let (mut touched, mut before) = (0, base(0));
        for i in 0..ROWS {
            let (base, dt_s) = (base(i), if i == 0 { 0.0 } else { 1.0 / RATE_HZ });
            let contact = base.inverse().apply(pin);
            let is_touching = contact.y() > first.y() + 1e-6 || touched > 0;
            let reading_n_m =
                if is_touching { mechanics.at_point(contact).unwrap().deflection.moment_n_m } else { 0.0 };
            touched += usize::from(is_touching);
            let mut draw = || of_plane.noise_sd_n_m * random.sample::<f64, _>(StandardNormal);
            let readings = Vector2::new(draw(), reading_n_m + draw());
            let motion = before.then(&base.inverse());
            let planar = in_plane.step(&estimators::Sample { motion, dt_s, reading_n_m: readings.y });
            let motion = raised(&before).then(&raised(&base).inverse());
            let spatial = spatial_estimator.step(&in_space::Sample { motion, dt_s, reading_n_m: readings });
            before = base;
            if touched > COUNTED {
                let spatial =
                    spatial.map(|estimate| Point::new(estimate.contact.vector().x, estimate.contact.vector().y));
                for (sum, found) in sums.iter_mut().zip([planar.map(|estimate| estimate.contact), spatial]) {
                    let error_m = found.expect("an estimate").distance(&contact);
                    *sum = (sum.0 + error_m * error_m, sum.1 + 1);
                }
            }
        }
    }
    sums.map(|(sum, count)| (sum / f64::from(count)).sqrt())
}

#[test]
fn val_planar_contacts_are_located_nearly_as_in_the_plane() {
    for whisker in [Whisker::straight(), Whisker::curved()] {
        let [planar, spatial] = errors_m(whisker.clone(), "recommended", "line-fit");
        // In space the direction of the rod is unknown, too.
        assert!(spatial < 1.2 * planar, "{}: {spatial} in space, {planar} in the plane", whisker.name);
    }
}
