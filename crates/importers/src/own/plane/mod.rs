//! Recordings in the plane.

mod contact;
mod conversion;
mod mapping;

use std::f64::consts::TAU;
use std::path::Path;

use files::{Error, FORMAT, sha256};
use trace::{
    Contour, FARTHEST_M, Instant, LARGEST, Outline, Recorded, Recording, Role, Sidecar, Trace, Truth, TruthInstant,
};
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;

use self::contact::{Contact, Mechanics};
use self::conversion::{Conversion, Known};
use self::mapping::{ContactColumns, Placement, PoseColumns, ReadingColumn};
use super::mapping::{Mapping, Moving, RecordingEntry};
use super::recording::{Columns, Sampled};
use super::{Geometry, Laboratory, Lacking, Remark, source_sha256};
use crate::Imported;
use crate::provenance::generator;

/// Smallest difference of a single yaw from its neighbours that is a glitch.
const GLITCH_RAD: f64 = 0.1;

/// Largest yaw rate of a robot (rad/s). A difference that it explains is not a glitch.
const FASTEST_RAD_S: f64 = 10.0;

/// Vertices of the outline of a pin.
const VERTICES: usize = 96;

/// Recordings in the plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane;

/// Sensor of all recordings.
pub(crate) struct Sensor {
    mechanics: Mechanics,
    /// Distance from rest, in the unit of the recordings, beyond which the whisker touches.
    touch: f64,
    conversion: Conversion,
}

impl Geometry for Plane {
    const FORMAT: u32 = FORMAT;
    const FORMAT_EXPECTED: &'static str = "1, a mapping in the plane; `--space` imports those in space, of format 2";
    type Pose = PoseColumns;
    type Base = Placement;
    type Reading = ReadingColumn;
    type Contact = ContactColumns;
    type BasePose = Pose<Base, World>;
    type Place = Point<World>;
    type Sensor = Sensor;

    fn validate(mapping: &Mapping<Self>, path: &Path) -> Result<(), Error> {
        for (key, is_stated) in
            [("suspension", mapping.suspension.is_some()), ("poisson_ratio", mapping.poisson_ratio.is_some())]
        {
            if is_stated {
                return Err(Error::value(path, key, "a value", "none in the plane"));
            }
        }
        match mapping.recordings.iter().position(|recording| recording.face.is_none()) {
            Some(i) => Err(Error::value(path, format!("recordings[{i}].face"), "none", "`left` or `right`")),
            None => Ok(()),
        }
    }

    fn poses(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Pose<Base, World>>, Error> {
        let PoseColumns { x, y, yaw, .. } = &laboratory.mapping.pose;
        columns.check_ranges(path, &[x, y], FARTHEST_M, "m")?;
        columns.check_ranges(path, &[yaw], LARGEST, "rad")?;
        let yaws = match &yaw.column {
            None => vec![yaw.constant(); clock_s.len()],
            Some(name) => {
                let series = columns.series(name).clone().scaled(yaw.factor()).unwrapped();
                series.check_glitches(path, name, GLITCH_RAD, FASTEST_RAD_S, "rad")?;
                series.at(clock_s)
            }
        };
        let known = |values: Vec<Option<f64>>| values.into_iter().map(Option::unwrap_or_default);
        let poses = known(columns.at(x, clock_s)).zip(known(columns.at(y, clock_s))).zip(known(yaws));
        let base: Vec<_> = poses.map(|((x, y), yaw)| placed(laboratory.mapping, x, y, yaw)).collect();
        check_poses(path, &base)?;
        Ok(base)
    }

    fn places(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        contact: &ContactColumns,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Option<Point<World>>>, Error> {
        let pairs = columns.at(&contact.x, clock_s).into_iter().zip(columns.at(&contact.y, clock_s));
        let places: Vec<_> = pairs.map(|(x, y)| Some(Point::new(x?, y?))).collect();
        check_places(path, &places, contact.radius_m().unwrap_or_default() + laboratory.whisker.root_diameter_m)?;
        Ok(places)
    }

    fn sensor(
        laboratory: &Laboratory<'_, Self>,
        sampled: &[Sampled<'_, Self>],
        touch: f64,
    ) -> Result<(Sensor, Option<Remark>), Error> {
        let (path, mapped) = (laboratory.path, &laboratory.mapping.reading);
        let mechanics = Mechanics::new(path, &laboratory.whisker)?;
        let largest = sampled.iter().map(Sampled::largest).fold(0.0, f64::max);
        let extremes = [f64::min, f64::max].map(|of| sampled.iter().flat_map(Sampled::extremes).fold(0.0, of));
        let conversion = match Conversion::stated(path, mapped, largest, extremes)? {
            Some(stated) => stated,
            None => {
                let calibration = sampled.iter().filter(|recording| recording.entry.role == Role::Calibration);
                let recordings = calibration.clone().count();
                let contacts: Vec<(&Sampled<'_, Self>, usize, Contact)> = calibration
                    .flat_map(|recording| (0..recording.grid.t_s.len()).map(move |row| (recording, row)))
                    .filter_map(|(recording, row)| Some((recording, row, recording.contact(row, &mechanics, touch)?)))
                    .collect();
                let pair = |(recording, row, contact): (&Sampled<'_, Self>, usize, Contact)| {
                    Some((mechanics.moment_n_m(&recording.base[row], &contact)?, recording.reading(row)))
                };
                let known = contacts.len();
                let pairs = contacts.into_iter().filter_map(pair).collect();
                Conversion::fitted(path, mapped, &Known { recordings, contacts: known, pairs }, touch)?
            }
        };
        let remark = conversion.remark.clone();
        Ok((Sensor { mechanics, touch, conversion }, remark))
    }

    fn add_trace(
        laboratory: &Laboratory<'_, Self>,
        sensor: &Sensor,
        recording: &Sampled<'_, Self>,
        imported: &mut Imported,
    ) -> Result<Lacking, Error> {
        let characteristic = &sensor.conversion.characteristic;
        recording.check_moments(|sample| vec![characteristic.moment_n_m(sample[0])])?;
        let (mut instants, mut truths) = (Vec::new(), Vec::new());
        for (row, t_s) in recording.grid.t_s.iter().enumerate() {
            let moment_z_n_m = characteristic.moment_n_m(recording.reading(row));
            let base = recording.base[row];
            instants.push(Instant { t_s: *t_s, base, twist: None, moment_z_n_m, rotation_z_rad: None });
            let contact = recording.contact(row, &sensor.mechanics, sensor.touch);
            let touching = recording.touching[row].or(contact.map(|_| true));
            truths.push(TruthInstant {
                touching,
                contact: contact.map(|contact| contact.centre_line),
                surface: contact.and_then(|contact| contact.surface),
                ..TruthInstant::default()
            });
        }
        let mut sidecar = sidecar(laboratory, sensor, recording);
        if let Some((file, outline)) = outline(recording.entry) {
            let radius_m = recording.radius_m().unwrap_or_default();
            let chord_error_m = radius_m * (1.0 - (0.5 * TAU / VERTICES as f64).cos());
            sidecar.contour = Some(Contour { file: file.clone(), sha256: sha256(outline.to_csv()), chord_error_m });
            imported.outlines.push((file, outline));
        }
        let mut trace = Trace { sidecar, recording: Recording { instants }, truth: Truth { instants: truths } };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        imported.traces.push(trace);
        Ok(Lacking::default())
    }
}

impl Sampled<'_, Plane> {
    /// Reading relative to rest in a row.
    fn reading(&self, row: usize) -> f64 {
        self.readings(row).next().expect("the reading has a channel")
    }

    fn radius_m(&self) -> Option<f64> {
        self.entry.contact.as_ref().and_then(ContactColumns::radius_m)
    }

    /// Contacts on the centre line and on the object in a row, if the whisker touches at a known place.
    fn contact(&self, row: usize, mechanics: &Mechanics, touch: f64) -> Option<Contact> {
        let place = self.places[row].filter(|_| self.touches(row, touch))?;
        Some(mechanics.contact(&self.base[row], place, self.radius_m(), face(self.entry)))
    }
}

fn face(entry: &RecordingEntry<Plane>) -> Face {
    entry.face.expect("it was validated")
}

/// Outline of a pin of known radius at rest in World.
fn outline(entry: &RecordingEntry<Plane>) -> Option<(String, Outline)> {
    let contact = entry.contact.as_ref()?;
    let (x_m, y_m, radius_m) = (contact.x.constant()?, contact.y.constant()?, contact.radius_m()?);
    let vertex = |i: usize| {
        let angle_rad = TAU * (i % VERTICES) as f64 / VERTICES as f64;
        Point::new(x_m + radius_m * angle_rad.cos(), y_m + radius_m * angle_rad.sin())
    };
    let outline = Outline::new((0..=VERTICES).map(vertex).collect())?;
    Some((format!("{}.contour.csv", entry.name()), outline))
}

fn sidecar(laboratory: &Laboratory<'_, Plane>, sensor: &Sensor, recording: &Sampled<'_, Plane>) -> Sidecar {
    let coefficients = sensor.conversion.coefficients();
    let entry = recording.entry;
    Sidecar {
        format: FORMAT,
        kind: "trace".into(),
        name: entry.name(),
        role: entry.role,
        group: entry.group().into(),
        object: entry.object.clone(),
        face: face(entry),
        seed: 0,
        rate_hz: laboratory.mapping.rate_hz,
        rows: recording.grid.t_s.len(),
        whisker: laboratory.whisker.clone(),
        scene: serde_json::Value::Null,
        generator: generator(laboratory.format, source_sha256()),
        inputs_sha256: recording.inputs_sha256(laboratory, &format!("{coefficients:?}"), sensor.touch),
        csv_sha256: String::new(),
        contour: None,
        certificate: None,
        recorded: Some(Recorded {
            clock: recording.clock().into(),
            characteristic: coefficients,
            range_n_m: Some(sensor.conversion.characteristic.range_n_m),
            residual_counts: sensor.conversion.residual,
            rest_counts: recording.rest()[0],
            noise_sd_n_m: recording.noise_sd()[0] / coefficients[0].abs(),
            touch_counts: sensor.touch,
            object_class: Some(entry.class()),
        }),
        recording: None,
        replay: None,
    }
}

/// Pose of the base in World, the frame in which the object rests.
fn placed(mapping: &Mapping<Plane>, x_m: f64, y_m: f64, yaw_rad: f64) -> Pose<Base, World> {
    let base = mapping.base.pose::<Base, Base>();
    match mapping.pose.of {
        Moving::Whisker => base.then(&Pose::new(x_m, y_m, yaw_rad)),
        Moving::Object => base.then(&Pose::<World, Base>::new(x_m, y_m, yaw_rad).inverse()),
    }
}

fn check_poses(path: &Path, base: &[Pose<Base, World>]) -> Result<(), Error> {
    let is_far = |pose: &&Pose<Base, World>| {
        let origin = pose.origin();
        !(origin.x().abs() <= FARTHEST_M && origin.y().abs() <= FARTHEST_M && pose.yaw_rad().abs() <= LARGEST)
    };
    let Some(far) = base.iter().find(is_far) else { return Ok(()) };
    let found = format!("{} m, {} m, {} rad", far.origin().x(), far.origin().y(), far.yaw_rad());
    Err(Error::value(
        path,
        "pose",
        found,
        format!("magnitudes of at most {FARTHEST_M} m and {LARGEST} rad; compare the units of the mapping"),
    ))
}

/// Checks that the points within `around_m` of the places are in the range of a trace.
fn check_places(path: &Path, places: &[Option<Point<World>>], around_m: f64) -> Result<(), Error> {
    let most_m = FARTHEST_M - around_m;
    let is_far = |place: &&Point<World>| !(place.x().abs() <= most_m && place.y().abs() <= most_m);
    let Some(far) = places.iter().flatten().find(is_far) else { return Ok(()) };
    let found = format!("{} m, {} m", far.x(), far.y());
    let expected = format!("magnitudes of at most {most_m} m; compare the units of the mapping");
    Err(Error::value(path, "contact", found, expected))
}
