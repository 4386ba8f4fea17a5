//! Recordings in space.

mod contact;
mod mapping;
mod orientation;

use std::path::Path;

use files::{Error, sha256};
use nalgebra::{Isometry3, Matrix2, Unit, Vector2, Vector3};
use trace::{
    BendingResponse, FARTHEST_M, Role, SPATIAL_FORMAT, SpatialInstant, SpatialPose, SpatialRecorded, SpatialRecording,
    SpatialSidecar, SpatialTrace, SpatialTruth, SpatialTruthInstant, StatedSuspension,
};

use self::contact::{Mechanics, Pin, PinContact};
use self::mapping::{SpatialContactColumns, SpatialPlacement, SpatialPoseColumns, SpatialReading};
use super::mapping::{Channels, Mapping, Moving};
use super::recording::{Columns, Sampled};
use super::rest::known_contacts;
use super::units::{Reading, Unit as _};
use super::{Geometry, Laboratory, source_sha256};
use crate::Imported;
use crate::provenance::generator;

/// Key of the mapping that states the response of the sensor.
const RESPONSE: &str = "reading.counts_per_n_m";

/// Poisson ratio of nitinol.
const POISSON_RATIO: f64 = 0.33;

/// Recordings in space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space;

/// Sensor of all recordings.
pub(crate) struct SpatialSensor {
    mechanics: Mechanics,
    /// Distance from rest, in the unit of the recordings, beyond which the whisker touches.
    touch: f64,
    response: BendingResponse,
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
        let rotations = orientation.at(path, columns, clock_s)?;
        let mut last: Option<SpatialPose> = None;
        let mut poses = Vec::with_capacity(clock_s.len());
        for (row, rotation) in rotations.into_iter().enumerate() {
            let [x, y, z] = [&x, &y, &z].map(|place| place[row].unwrap_or_default());
            let recorded = Isometry3::from_parts(Vector3::new(x, y, z).into(), rotation);
            let Isometry3 { rotation, translation } = match of {
                Moving::Whisker => recorded * base,
                Moving::Object => recorded.inverse() * base,
            };
            let position = translation.vector;
            if !position.iter().all(|coordinate| coordinate.abs() <= FARTHEST_M) {
                let found = format!("{} m, {} m, {} m", position.x, position.y, position.z);
                let expected = format!("magnitudes of at most {FARTHEST_M} m; compare the units of the mapping");
                return Err(Error::value(path, "pose", found, expected));
            }
            // The sign of a trace's quaternions is continuous, and w is not negative at first.
            let is_opposite = match &last {
                Some(last) => last.rotation.coords.dot(&rotation.coords) < 0.0,
                None => rotation.w < 0.0,
            };
            let rotation = if is_opposite { Unit::new_unchecked(-rotation.into_inner()) } else { rotation };
            let pose = SpatialPose { position, rotation };
            poses.push(pose);
            last = Some(pose);
        }
        Ok(poses)
    }

    fn places(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        contact: &SpatialContactColumns,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Option<Vector3<f64>>>, Error> {
        let [x, y, z] = [&contact.x, &contact.y, &contact.z].map(|place| columns.at(place, clock_s));
        let place = |row: usize| Some(Vector3::new(x[row]?, y[row]?, z[row]?));
        let places: Vec<_> = (0..clock_s.len()).map(place).collect();
        let around_m = contact.radius_m().unwrap_or_default() + laboratory.whisker.length_m;
        let most_m = FARTHEST_M - around_m;
        let is_far = |place: &&Vector3<f64>| !place.iter().all(|coordinate| coordinate.abs() <= most_m);
        if let Some(far) = places.iter().flatten().find(is_far) {
            let found = format!("{} m, {} m, {} m", far.x, far.y, far.z);
            let expected = format!("magnitudes of at most {most_m} m; compare the units of the mapping");
            return Err(Error::value(path, "contact", found, expected));
        }
        Ok(places)
    }

    fn sensor(
        laboratory: &Laboratory<'_, Self>,
        sampled: &[Sampled<'_, Self>],
        touch: f64,
    ) -> Result<SpatialSensor, Error> {
        let (path, mapped) = (laboratory.path, &laboratory.mapping.reading);
        let mechanics = Mechanics::new(path, &laboratory.whisker, suspension(laboratory), poisson_ratio(laboratory))?;
        let signs = Matrix2::from_diagonal(&Vector2::from(mapped.channels.each_ref().map(|channel| channel.sign)));
        let stated = match (mapped.unit(), &mapped.counts_per_n_m) {
            (Reading::Counts, None) => None,
            (Reading::Counts, Some(stated)) => BendingResponse::new(signs * stated.response()),
            (unit, _) => BendingResponse::new(signs / unit.si()),
        };
        if let Some(response) = stated {
            return Ok(SpatialSensor { mechanics, touch, response, residual_counts: Vector2::zeros() });
        }
        let calibration = sampled.iter().filter(|recording| recording.entry.role == Role::Calibration);
        let recordings = calibration.clone().count();
        let (mut contacts, mut pairs) = (0, Vec::new());
        for recording in calibration {
            for (row, contact) in recording.contacts(&mechanics, touch).into_iter().enumerate() {
                contacts += usize::from(contact != Contact::None);
                let moment_n_m = contact.point().and_then(|contact| mechanics.moment_n_m(contact));
                pairs.extend(moment_n_m.map(|moment_n_m| (moment_n_m, recording.counts(row))));
            }
        }
        known_contacts(path, RESPONSE, recordings, contacts, touch)?;
        let response = fitted(&pairs).ok_or_else(|| {
            let found =
                format!("none, and {} of {contacts} contacts of the calibration within reach of the whisker", pairs.len());
            let expected = "contacts on different sides of the whisker, which determine the response to both bending moments; \
                            compare units and `base` of the mapping, or state the response";
            Error::value(path, RESPONSE, found, expected)
        })?;
        let square = |(moment_n_m, counts): &(Vector2<f64>, Vector2<f64>)| {
            (response.counts(*moment_n_m) - counts).map(|residual| residual * residual)
        };
        let residual_counts = (pairs.iter().map(square).sum::<Vector2<f64>>() / pairs.len() as f64).map(f64::sqrt);
        Ok(SpatialSensor { mechanics, touch, response, residual_counts })
    }

    fn add_trace(
        laboratory: &Laboratory<'_, Self>,
        sensor: &SpatialSensor,
        recording: &Sampled<'_, Self>,
        imported: &mut Imported,
    ) -> Result<(), Error> {
        let SpatialSensor { mechanics, touch, response, .. } = sensor;
        recording
            .check_moments(|sample| response.moment_n_m(Vector2::new(sample[0], sample[1])).as_slice().to_vec())?;
        let (mut instants, mut truth) = (Vec::new(), Vec::new());
        let mut out_of_reach = 0;
        for (row, contact) in recording.contacts(mechanics, *touch).into_iter().enumerate() {
            let base = recording.base[row];
            let moment_n_m = response.moment_n_m(recording.counts(row));
            instants.push(SpatialInstant::measured(recording.grid.t_s[row], base, moment_n_m));
            out_of_reach += usize::from(contact == Contact::OutOfReach);
            let place = contact.point().map(|point| base.position + base.rotation * point);
            let touching = recording.touching[row].or(place.map(|_| true));
            truth.push(SpatialTruthInstant { touching, contact: None, place });
        }
        if out_of_reach > 0 {
            imported.notes.push(format!(
                "{}: {out_of_reach} rows without their contact, since the pin does not push the whisker there; compare `contact` \
                 and `base` of the mapping",
                recording.entry.name()
            ));
        }
        let sidecar = sidecar(laboratory, sensor, recording);
        let (recording, truth) = (SpatialRecording { instants }, SpatialTruth { instants: truth });
        let mut trace = SpatialTrace { sidecar, recording, truth };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        imported.spatial_traces.push(trace);
        Ok(())
    }
}

/// Contact in a row, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contact {
    /// The whisker is free, or the place is not known.
    None,
    /// The reading is that of a touch, but the pin does not push the whisker.
    OutOfReach,
    /// Contact on the centre line (m).
    At(Vector3<f64>),
}

impl Contact {
    fn point(self) -> Option<Vector3<f64>> {
        match self {
            Self::At(point) => Some(point),
            Self::None | Self::OutOfReach => None,
        }
    }
}

impl Sampled<'_, Space> {
    /// Reading of both channels relative to rest in a row, 2x1.
    fn counts(&self, row: usize) -> Vector2<f64> {
        Vector2::from_iterator(self.readings(row))
    }

    /// Contacts of all rows.
    fn contacts(&self, mechanics: &Mechanics, touch: f64) -> Vec<Contact> {
        let rows = self.places.len();
        let place_in_base = |row: usize| {
            let place = self.places[row].filter(|_| self.touches(row, touch))?;
            let base = &self.base[row];
            Some(base.rotation.inverse() * (place - base.position))
        };
        let places: Vec<Option<Vector3<f64>>> = (0..rows).map(place_in_base).collect();
        let Some((axis, radius_m)) = self.entry.contact.as_ref().and_then(|of| Some((of.axis()?, of.radius_m())))
        else {
            return places.into_iter().map(|place| place.map_or(Contact::None, Contact::At)).collect();
        };
        let mut contacts = vec![Contact::None; rows];
        let mut found = |row: usize, near: Option<&PinContact>| {
            let axis = Unit::new_unchecked(self.base[row].rotation.inverse() * axis.into_inner());
            let pin = Pin { place: places[row]?, axis, radius_m };
            let contact = mechanics.with_pin(&pin, near);
            contacts[row] = contact.map_or(Contact::OutOfReach, |contact| Contact::At(contact.point));
            contact
        };
        // In each touch from its deepest row on, where the side of the whisker is certain.
        let mut row = 0;
        while row < rows {
            let end = (row..rows).find(|at| places[*at].is_none()).unwrap_or(rows);
            if let Some(deepest) = (row..end).max_by(|a, b| self.size(*a).total_cmp(&self.size(*b))) {
                let first = found(deepest, None);
                let mut near = first;
                for at in (row..deepest).rev() {
                    near = found(at, near.as_ref()).or(near);
                }
                near = first;
                for at in deepest + 1..end {
                    near = found(at, near.as_ref()).or(near);
                }
            }
            row = end + 1;
        }
        contacts
    }
}

/// Response of a sensor to the moments of the rod. Contacts whose reading has the opposite direction are left out of a second fit: in
/// touches that deflect the whisker by less than the radius of the pin, its side is not certain.
fn fitted(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<BendingResponse> {
    let first = BendingResponse::fit(pairs)?;
    let is_consistent =
        |(moment_n_m, counts): &&(Vector2<f64>, Vector2<f64>)| first.moment_n_m(*counts).dot(moment_n_m) > 0.0;
    let consistent: Vec<_> = pairs.iter().filter(is_consistent).copied().collect();
    if consistent.len() == pairs.len() { Some(first) } else { BendingResponse::fit(&consistent) }
}

fn suspension(laboratory: &Laboratory<'_, Space>) -> StatedSuspension {
    let stiffness = laboratory.whisker.root_stiffness_n_m_rad;
    let round = StatedSuspension { yaw_n_m_rad: stiffness, pitch_n_m_rad: stiffness, twist_n_m_rad: stiffness };
    laboratory.mapping.suspension.unwrap_or(round)
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
        inputs_sha256: recording.inputs_sha256(laboratory, &format!("{:?}", response.counts_per_n_m)),
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
