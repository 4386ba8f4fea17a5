//! Dataset in space with a synthetic calibration and a trial.

use std::f64::consts::TAU;
use std::path::Path;

use evaluation::fit::Models;
use evaluation::space::fit::SpatialFitSettings;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use serde_json::json;
use testbed::dataset::Dataset;
use testbed::front_end::FrontEndConfig;
use trace::{
    Feature, Role, SpatialContactTruth, SpatialInstant, SpatialPose, SpatialRecording, SpatialTrace, SpatialTruth,
    SpatialTruthInstant,
};
use whisker::rod::Rod;
use whisker::space::sensor::{Across, Around, Axis};

/// The golden trace in space.
pub(crate) fn golden() -> SpatialTrace {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space.csv");
    SpatialTrace::read(&path).unwrap()
}

/// A trace of a base at rest whose contacts are those of the rod at places about the whisker; `None` while it is free.
pub(crate) fn trace(name: &str, role: Role, rod: &Rod, places: &[Option<Around>]) -> SpatialTrace {
    let mut sidecar = golden().sidecar;
    (sidecar.name, sidecar.role, sidecar.rate_hz) = (name.into(), role, 250.0);
    let axis = Axis::new(&sidecar.whisker, Across::Normal);
    let (mut instants, mut truths) = (Vec::new(), Vec::new());
    for (row, place) in places.iter().enumerate() {
        let contact = place.map(|at| rod.at_point(at.contact(&axis).vector()).unwrap());
        let moment = contact.map_or(Vector3::zeros(), |contact| contact.deflection.moment_n_m);
        let rotation = UnitQuaternion::from(Rotation3::identity());
        let base = SpatialPose { position: Vector3::zeros(), rotation };
        instants.push(SpatialInstant::measured(row as f64 / 250.0, base, moment.yz()));
        let contact = contact.map(|contact| SpatialContactTruth {
            tip: false,
            split: false,
            feature: Feature::Face,
            contact: contact.deflection.point,
            surface: contact.deflection.point,
            normal: contact.deflection.force_n.normalize(),
            arc_m: contact.load.arc_m,
            force: contact.deflection.force_n,
            tangent: contact.deflection.directors.column(0).into_owned(),
        });
        truths.push(SpatialTruthInstant { touching: Some(contact.is_some()), contact, place: None });
    }
    let (recording, truth) = (SpatialRecording { instants }, SpatialTruth { instants: truths });
    SpatialTrace { sidecar, recording, truth }
}

/// Lines at six arc lengths in `directions` directions, with pauses.
pub(crate) fn lines(directions: u32) -> Vec<Option<Around>> {
    let mut places = vec![None; 5];
    for node in 0..6 {
        for turn in 0..directions {
            let (along_m, azimuth) = (0.032 + 0.005 * f64::from(node), TAU * f64::from(turn) / f64::from(directions));
            places.extend((1..=8).map(|step| {
                let away_m = 2.4 * along_m * along_m * f64::from(step) / 8.0;
                Some(Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin()))
            }));
            places.extend([None; 3]);
        }
    }
    places
}

pub(crate) fn fit_settings() -> SpatialFitSettings {
    let models = Models::One { kind: "polynomial".into(), config: json!({"degree": 4}) };
    SpatialFitSettings { models, noise: 0.01, seed: 1, front_end: FrontEndConfig::default() }
}

/// A folder with a calibration trace and a trial.
pub(crate) fn dataset(folder: &Path, directions: u32) -> Dataset {
    let rod = golden().sidecar.rod().unwrap();
    trace("lines", Role::Calibration, &rod, &lines(directions)).write(folder).unwrap();
    let mut places = vec![None; 50];
    places.extend([Some(Around::new(0.045, 2e-3, 1.2e-3)); 500]);
    trace("press", Role::Trial, &rod, &places).write(folder).unwrap();
    Dataset::open(folder, None).unwrap()
}
