//! Recordings in space.

mod contact;
mod mapping;
mod orientation;

use std::ops::Range;
use std::path::Path;

use files::{Error, sha256};
use nalgebra::{Isometry3, Matrix2, Unit, Vector2, Vector3};
use trace::{
    BendingResponse, FARTHEST_M, Role, SPATIAL_FORMAT, SpatialInstant, SpatialPose, SpatialRecorded, SpatialRecording,
    SpatialSidecar, SpatialTrace, SpatialTruth, SpatialTruthInstant, StatedSuspension,
};

use self::contact::{Mechanics, Pin, PinContact, Side};
use self::mapping::{SpatialContactColumns, SpatialPlacement, SpatialPoseColumns, SpatialReading};
use super::mapping::{Channels, Mapping, Moving};
use super::recording::{Columns, Sampled};
use super::rest::check_known_contacts;
use super::units::{Reading, Unit as _};
use super::{Geometry, Laboratory, source_sha256};
use crate::provenance::generator;
use crate::{Imported, POISSON_RATIO};

/// Key of the mapping that states the response of the sensor.
const RESPONSE: &str = "reading.counts_per_n_m";

/// Interval between rows, in nominal intervals, from which on it is a gap that ends a touch.
const MOST_INTERVALS: f64 = 1.5;

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
    /// Size of these residuals relative to that of the readings. `None` if the response is stated.
    residual: Option<f64>,
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
            check_place(path, "pose", &position)?;
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
            let (residual_counts, residual) = (Vector2::zeros(), None);
            return Ok(SpatialSensor { mechanics, touch, response, residual_counts, residual });
        }
        let calibration = sampled.iter().filter(|recording| recording.entry.role == Role::Calibration);
        let recordings = calibration.clone().count();
        let (mut residual_counts, mut residual) = (Vector2::zeros(), None);
        let contacts_of = |response: Option<&BendingResponse>| -> Vec<(Contact, Vector2<f64>)> {
            let of_recording = |recording: &Sampled<'_, Self>| {
                let contacts = recording.contacts(&mechanics, touch, response).into_iter();
                contacts.enumerate().map(|(row, contact)| (contact, recording.counts(row))).collect::<Vec<_>>()
            };
            calibration.clone().flat_map(of_recording).collect()
        };
        // Without a response, the side of a pin is that of its axis. With it, the readings decide, which may differ in light touches.
        let mut response = None;
        for _ in 0..2 {
            let contacts = contacts_of(response.as_ref());
            let known = contacts.iter().filter(|(contact, _)| *contact != Contact::Unknown).count();
            check_known_contacts(path, RESPONSE, recordings, known, touch)?;
            let pair = |(contact, counts): &(Contact, Vector2<f64>)| Some((contact.moment_n_m(&mechanics)?, *counts));
            let pairs: Vec<_> = contacts.iter().filter_map(pair).collect();
            let fitted = BendingResponse::fit(&pairs).ok_or_else(|| {
                let found =
                    format!("none, and {} of {known} contacts of the calibration within reach of the whisker", pairs.len());
                let cause = if pairs.is_empty() { "; compare units and `base` of the mapping" } else { "" };
                let expected = format!(
                    "contacts from several directions about the whisker, which determine the response to both bending moments, or \
                     a stated response{cause}"
                );
                Error::value(path, RESPONSE, found, expected)
            })?;
            response = Some(fitted);
            residual_counts = fitted.residual_counts(&pairs);
            let size: f64 = pairs.iter().map(|(_, counts)| counts.norm_squared()).sum();
            residual = Some(residual_counts.norm() / (size / pairs.len() as f64).sqrt());
        }
        let response = response.expect("it was fitted");
        Ok(SpatialSensor { mechanics, touch, response, residual_counts, residual })
    }

    fn remark(sensor: &SpatialSensor) -> Option<String> {
        let percent = 100.0 * sensor.residual?;
        Some(format!(
            "the moments of the rod at the known contacts of the calibration explain its readings to {percent:.1} % (RMS)"
        ))
    }

    fn add_trace(
        laboratory: &Laboratory<'_, Self>,
        sensor: &SpatialSensor,
        recording: &Sampled<'_, Self>,
        imported: &mut Imported,
    ) -> Result<usize, Error> {
        let SpatialSensor { mechanics, touch, response, .. } = sensor;
        recording
            .check_moments(|sample| response.moment_n_m(Vector2::new(sample[0], sample[1])).as_slice().to_vec())?;
        let (mut instants, mut truth) = (Vec::new(), Vec::new());
        let mut not_found = 0;
        for (row, contact) in recording.contacts(mechanics, *touch, Some(response)).into_iter().enumerate() {
            let base = recording.base[row];
            let moment_n_m = response.moment_n_m(recording.counts(row));
            instants.push(SpatialInstant::measured(recording.grid.t_s[row], base, moment_n_m));
            not_found += usize::from(contact == Contact::NotFound);
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
        Ok(not_found)
    }
}

/// Contact in a row, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contact {
    /// The whisker is free, or the place is not known.
    Unknown,
    /// The reading is that of a touch, but there is no contact with the pin.
    NotFound,
    /// Contact on the centre line (m), and the moments of the rod about y and z (N m) if they are known already.
    At(Vector3<f64>, Option<Vector2<f64>>),
}

impl Contact {
    fn point(self) -> Option<Vector3<f64>> {
        match self {
            Self::At(point, _) => Some(point),
            Self::Unknown | Self::NotFound => None,
        }
    }

    /// Moments of the rod about y and z (N m), 2x1. `None` if the whisker does not reach the contact.
    fn moment_n_m(self, mechanics: &Mechanics) -> Option<Vector2<f64>> {
        match self {
            Self::At(point, moment_n_m) => moment_n_m.or_else(|| mechanics.moment_n_m(point)),
            Self::Unknown | Self::NotFound => None,
        }
    }
}

impl From<Option<PinContact>> for Contact {
    fn from(contact: Option<PinContact>) -> Self {
        contact.map_or(Self::NotFound, |contact| Self::At(contact.point, Some(contact.moment_n_m)))
    }
}

impl Sampled<'_, Space> {
    /// Reading of both channels relative to rest in a row, 2x1.
    fn counts(&self, row: usize) -> Vector2<f64> {
        Vector2::from_iterator(self.readings(row))
    }

    /// Contacts of all rows. The side of a pin is that which agrees with the readings, if the response of the sensor is known.
    fn contacts(&self, mechanics: &Mechanics, touch: f64, response: Option<&BendingResponse>) -> Vec<Contact> {
        let rows = self.places.len();
        let place_in_base = |row: usize| {
            let place = self.places[row].filter(|_| self.touches(row, touch))?;
            let base = &self.base[row];
            Some(base.rotation.inverse() * (place - base.position))
        };
        let places: Vec<Option<Vector3<f64>>> = (0..rows).map(place_in_base).collect();
        let Some((axis, radius_m)) = self.entry.contact.as_ref().and_then(|of| Some((of.axis()?, of.radius_m())))
        else {
            return places
                .into_iter()
                .map(|place| place.map_or(Contact::Unknown, |at| Contact::At(at, None)))
                .collect();
        };
        let pin = |row: usize| {
            let axis = Unit::new_unchecked(self.base[row].rotation.inverse() * axis.into_inner());
            places[row].map(|place| Pin { place, axis, radius_m })
        };
        let agrees = |row: usize, contact: &PinContact| {
            response.is_none_or(|response| response.moment_n_m(self.counts(row)).dot(&contact.moment_n_m) > 0.0)
        };
        // Side and contact in a row on whose side nothing is known.
        let begun = |row: usize| {
            let pin = pin(row)?;
            let sides = if response.is_some() { Side::BOTH.to_vec() } else { vec![mechanics.side_of_axis(&pin)?] };
            let contact = |side| Some((side, mechanics.with_pin(&pin, side, None)?));
            sides.into_iter().filter_map(contact).find(|(_, contact)| agrees(row, contact))
        };
        let mut contacts = vec![Contact::Unknown; rows];
        for touched in self.touches_of(&places) {
            contacts[touched.clone()].fill(Contact::NotFound);
            // From the deepest row with a contact on, where the side is most certain.
            let mut by_depth: Vec<usize> = touched.clone().collect();
            by_depth.sort_by(|a, b| self.distance_from_rest(*b).total_cmp(&self.distance_from_rest(*a)));
            let Some((deepest, (side, first))) = by_depth.into_iter().find_map(|row| Some((row, begun(row)?))) else {
                continue;
            };
            contacts[deepest] = Some(first).into();
            let mut follow = |rows: &mut dyn Iterator<Item = usize>| {
                let mut near = first.place;
                for row in rows {
                    let contact = pin(row).and_then(|pin| mechanics.with_pin(&pin, side, Some(&near)));
                    let contact = contact.filter(|contact| agrees(row, contact));
                    near = contact.map_or(near, |contact| contact.place);
                    contacts[row] = contact.into();
                }
            };
            follow(&mut (touched.start..deepest).rev());
            follow(&mut (deepest + 1..touched.end));
        }
        contacts
    }

    /// Rows of each touch: consecutive ones with a place, without a gap in the times.
    fn touches_of(&self, places: &[Option<Vector3<f64>>]) -> Vec<Range<usize>> {
        let t_s = &self.grid.t_s;
        let mut touches: Vec<Range<usize>> = Vec::new();
        for row in (0..places.len()).filter(|row| places[*row].is_some()) {
            match touches.last_mut() {
                Some(last) if last.end == row && t_s[row] - t_s[row - 1] < MOST_INTERVALS / self.rate_hz => {
                    last.end += 1
                }
                _ => touches.push(row..row + 1),
            }
        }
        touches
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
    let round = || StatedSuspension::round(laboratory.whisker.root_stiffness_n_m_rad);
    laboratory.mapping.suspension.unwrap_or_else(round)
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
