//! Recordings in space.

mod contact;
mod mapping;
mod orientation;
mod pin;
mod response;

use std::path::Path;

use files::{Error, sha256};
use nalgebra::{Isometry3, Matrix2, Unit, Vector2, Vector3};
use trace::{
    BendingResponse, FARTHEST_M, Role, SPATIAL_FORMAT, SpatialInstant, SpatialPose, SpatialRecorded, SpatialRecording,
    SpatialSidecar, SpatialTrace, SpatialTruth, SpatialTruthInstant, StatedSuspension,
};

use self::contact::Contact;
use self::mapping::{SpatialContactColumns, SpatialPlacement, SpatialPoseColumns, SpatialReading};
use self::pin::Mechanics;
use self::response::{Fitted, scale};
use super::mapping::{Channels, Mapping, Moving};
use super::recording::{Columns, Sampled};
use super::units::{Reading, Unit as _};
use super::{Geometry, Laboratory, Lacking, Remark, source_sha256};
use crate::provenance::generator;
use crate::{Imported, POISSON_RATIO};

/// Recordings in space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space;

/// Sensor of all recordings.
pub(crate) struct SpatialSensor {
    mechanics: Mechanics,
    /// Distance from rest, in the unit of the recordings, beyond which the whisker touches.
    touch: f64,
    response: BendingResponse,
    /// Response with the scale of the known contacts, by which they are found.
    scaled: BendingResponse,
    residual_counts: Vector2<f64>,
}

impl Geometry for Space {
    const FORMAT: u32 = SPATIAL_FORMAT;
    const FORMAT_EXPECTED: &'static str =
        "2, a mapping in space; without `--space`, mappings in the plane are imported, of format 1";
    type Pose = SpatialPoseColumns;
    type Base = SpatialPlacement;
    type Reading = SpatialReading;
    type Contact = SpatialContactColumns;
    type BasePose = SpatialPose;
    type Place = Vector3<f64>;
    type Sensor = SpatialSensor;

    fn validate(mapping: &Mapping<Self>, path: &Path) -> Result<(), Error> {
        match mapping.recordings.iter().position(|recording| recording.face.is_some()) {
            Some(i) => Err(Error::value(path, format!("recordings[{i}].face"), "a value", "none in space")),
            None => Ok(()),
        }
    }

    fn poses(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<SpatialPose>, Error> {
        let SpatialPoseColumns { of, x, y, z, orientation } = &laboratory.mapping.pose;
        columns.check_ranges(path, &[x, y, z], FARTHEST_M, "m")?;
        let base = laboratory.mapping.base.pose();
        let [x, y, z] = [x, y, z].map(|place| columns.at(place, clock_s));
        let rotations = orientation.at(laboratory.path, path, columns, clock_s)?;
        let mut poses: Vec<SpatialPose> = Vec::with_capacity(clock_s.len());
        for (row, rotation) in rotations.into_iter().enumerate() {
            let [x, y, z] = [&x, &y, &z].map(|place| place[row].unwrap_or_default());
            let recorded = Isometry3::from_parts(Vector3::new(x, y, z).into(), rotation);
            let Isometry3 { rotation, translation } = match of {
                Moving::Whisker => recorded * base,
                Moving::Object => recorded.inverse() * base,
            };
            let position = translation.vector;
            check_place(path, "pose", &position)?;
            // The sign of a trace's quaternions is continuous, and w is not negative at first.
            let is_opposite = match poses.last() {
                Some(last) => last.rotation.coords.dot(&rotation.coords) < 0.0,
                None => rotation.w < 0.0,
            };
            let rotation = if is_opposite { Unit::new_unchecked(-rotation.into_inner()) } else { rotation };
            poses.push(SpatialPose { position, rotation });
        }
        Ok(poses)
    }

    fn places(
        _laboratory: &Laboratory<'_, Self>,
        path: &Path,
        contact: &SpatialContactColumns,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Option<Vector3<f64>>>, Error> {
        let [x, y, z] = [&contact.x, &contact.y, &contact.z].map(|place| columns.at(place, clock_s));
        let place = |row: usize| Some(Vector3::new(x[row]?, y[row]?, z[row]?));
        let places: Vec<_> = (0..clock_s.len()).map(place).collect();
        places.iter().flatten().try_for_each(|place| check_place(path, "contact", place))?;
        Ok(places)
    }

    fn sensor(
        laboratory: &Laboratory<'_, Self>,
        sampled: &[Sampled<'_, Self>],
        touch: f64,
    ) -> Result<(SpatialSensor, Option<Remark>), Error> {
        let (path, mapped) = (laboratory.path, &laboratory.mapping.reading);
        let mechanics = Mechanics::new(path, &laboratory.whisker, suspension(laboratory), poisson_ratio(laboratory))?;
        let signs = Matrix2::from_diagonal(&Vector2::from(mapped.channels.each_ref().map(|channel| channel.sign)));
        let stated = match (mapped.unit(), &mapped.counts_per_n_m) {
            (Reading::Counts, None) => None,
            (Reading::Counts, Some(stated)) => BendingResponse::new(signs * stated.response()),
            (unit, _) => BendingResponse::new(signs / unit.si()),
        };
        let calibration: Vec<_> =
            sampled.iter().filter(|recording| recording.entry.role == Role::Calibration).collect();
        if let Some(response) = stated {
            let known = if calibration.is_empty() { sampled.iter().collect() } else { calibration };
            let scale = scale(&known, &mechanics, touch, &response);
            let scaled = BendingResponse::new(scale * response.response()).unwrap_or(response);
            let residual_counts = Vector2::zeros();
            return Ok((SpatialSensor { mechanics, touch, response, scaled, residual_counts }, None));
        }
        let fitted = Fitted::new(path, &calibration, &mechanics, touch)?;
        let Fitted { response, residual_counts, .. } = fitted;
        Ok((SpatialSensor { mechanics, touch, response, scaled: response, residual_counts }, Some(fitted.remark())))
    }

    fn add_trace(
        laboratory: &Laboratory<'_, Self>,
        sensor: &SpatialSensor,
        recording: &Sampled<'_, Self>,
        imported: &mut Imported,
    ) -> Result<Lacking, Error> {
        let SpatialSensor { mechanics, touch, response, scaled, .. } = sensor;
        recording
            .check_moments(|sample| response.moment_n_m(Vector2::new(sample[0], sample[1])).as_slice().to_vec())?;
        let (mut instants, mut truth) = (Vec::new(), Vec::new());
        let mut lacking = Lacking::default();
        for (row, contact) in recording.contacts(mechanics, *touch, Some(scaled)).into_iter().enumerate() {
            let base = recording.base[row];
            let moment_n_m = response.moment_n_m(recording.counts(row));
            instants.push(SpatialInstant::measured(recording.grid.t_s[row], base, moment_n_m));
            lacking.not_found += usize::from(contact == Contact::NotFound);
            lacking.weak += usize::from(contact == Contact::Weak);
            let place = contact.point().map(|point| base.position + base.rotation * point);
            place.iter().try_for_each(|place| check_place(&recording.path, "contact", place))?;
            let touching = recording.touching[row].or(place.map(|_| true));
            truth.push(SpatialTruthInstant { touching, contact: None, place });
        }
        let sidecar = sidecar(laboratory, sensor, recording);
        let (recording, truth) = (SpatialRecording { instants }, SpatialTruth { instants: truth });
        let mut trace = SpatialTrace { sidecar, recording, truth };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        imported.spatial_traces.push(trace);
        Ok(lacking)
    }
}

/// Checks that a place is in the range of a trace.
fn check_place(path: &Path, key: &str, place: &Vector3<f64>) -> Result<(), Error> {
    if place.iter().all(|coordinate| coordinate.abs() <= FARTHEST_M) {
        return Ok(());
    }
    let found = format!("{} m, {} m, {} m", place.x, place.y, place.z);
    let expected = format!("magnitudes of at most {FARTHEST_M} m; compare the units of the mapping");
    Err(Error::value(path, key, found, expected))
}

fn suspension(laboratory: &Laboratory<'_, Space>) -> StatedSuspension {
    let isotropic = || StatedSuspension::isotropic(laboratory.whisker.root_stiffness_n_m_rad);
    laboratory.mapping.suspension.unwrap_or_else(isotropic)
}

fn poisson_ratio(laboratory: &Laboratory<'_, Space>) -> f64 {
    laboratory.mapping.poisson_ratio.unwrap_or(POISSON_RATIO)
}

fn sidecar(
    laboratory: &Laboratory<'_, Space>,
    sensor: &SpatialSensor,
    recording: &Sampled<'_, Space>,
) -> SpatialSidecar {
    let SpatialSensor { touch, response, residual_counts, .. } = sensor;
    let entry = recording.entry;
    let both = |values: Vec<f64>| [values[0], values[1]];
    SpatialSidecar {
        format: SPATIAL_FORMAT,
        kind: "trace".into(),
        name: entry.name(),
        role: entry.role,
        group: entry.group().into(),
        object: entry.object.clone(),
        seed: 0,
        rate_hz: laboratory.mapping.rate_hz,
        rows: recording.grid.t_s.len(),
        whisker: laboratory.whisker.clone(),
        suspension: suspension(laboratory),
        poisson_ratio: poisson_ratio(laboratory),
        scene: serde_json::Value::Null,
        generator: generator(laboratory.format, source_sha256()),
        inputs_sha256: recording.inputs_sha256(laboratory, &format!("{:?}", response.counts_per_n_m), *touch),
        csv_sha256: String::new(),
        certificate: None,
        recorded: Some(SpatialRecorded {
            clock: recording.clock().into(),
            counts_per_n_m: *response,
            residual_counts: (*residual_counts).into(),
            rest_counts: both(recording.rest()),
            noise_sd_n_m: response.noise_sd_n_m(Vector2::from(both(recording.noise_sd()))).into(),
            touch_counts: *touch,
            object_class: entry.class(),
        }),
    }
}
