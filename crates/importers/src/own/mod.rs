//! Recordings of any laboratory: columns of a CSV, or fields of ROS 2 messages, by a mapping file.
//!
//! [`mapping`] names the columns with their units, signs and frames; [`columns`] and [`topics`] read them as [`series`]
//! over time; these are resampled to equal intervals, and [`sensor`] converts the readings to moments. The contact on
//! the centre line follows from the axis and the radius of the pin that was touched. `docs/own-data.md` specifies the
//! mapping.

pub(crate) mod columns;
mod mapping;
mod sensor;
mod series;
pub(crate) mod topics;
mod units;

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use files::{Digest, Error, FORMAT, sha256};
use nalgebra::Vector2;
use trace::{
    Characteristic, Contour, FARTHEST_M, Instant, LARGEST, Outline, Recorded, Recording, Role, Sidecar, Trace, Truth,
    TruthInstant,
};
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;

use self::mapping::{ContactColumns, Mapping, Moving, Quantity, RecordingEntry};
use self::sensor::{AtRest, Conversion, GLITCH, Known, sustained, touch};
use self::series::{Glitch, Grid, Series, table_error};
use self::units::{Reading, Unit};
use crate::provenance::generator;
use crate::{Imported, MOST_COUNTS, Progress};

/// Smallest difference of a single position from its neighbours that may be a glitch. It may also be a fast motion.
const GLITCH_M: f64 = 0.01;

/// Smallest difference of a single yaw from its neighbours that is a glitch.
const GLITCH_RAD: f64 = 0.1;

/// Largest yaw rate of a robot (rad/s). A difference that it explains is not a glitch.
const FASTEST_RAD_S: f64 = 10.0;

/// Vertices of the outline of a pin.
const VERTICES: usize = 96;

/// Iterations that find the tangent of the whisker at a pin of finite radius.
const ITERATIONS: usize = 5;

/// A column to be read.
#[derive(Clone, Copy, Debug)]
struct Wanted<'a> {
    name: &'a str,
    /// Whether values may be missing.
    may_be_empty: bool,
}

/// Columns of a recording.
struct ReadColumns {
    /// In the order in which they were wanted.
    series: Vec<Series>,
    sha256: String,
    /// Samples with the time of the sample before, which are left out.
    repeated: usize,
    /// Whether the last row has no line end, and is left out.
    is_cut_off: bool,
    has_clock: bool,
}

type ReadSource = fn(&Path, &Mapping, &[Wanted<'_>]) -> Result<ReadColumns, Error>;

/// Imports the recordings of a mapping from CSV files.
///
/// # Errors
/// [`Error`] of the mapping or of a calibration. Damaged trials are listed in `failures`.
pub(crate) fn import_columns(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import(columns::NAME, columns::read, path, progress)
}

/// Imports the recordings of a mapping from rosbag2 folders or MCAP files.
///
/// # Errors
/// As [`import_columns`].
pub(crate) fn import_topics(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import(topics::NAME, topics::read, path, progress)
}

fn import(format: &'static str, read: ReadSource, path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    let mapping = Mapping::read(path)?;
    let laboratory = Laboratory { format, path, whisker: mapping.whisker(path)?, mapping: &mapping };
    let mut imported = Imported::default();
    let mut sampled = Vec::new();
    for (done, entry) in mapping.recordings.iter().enumerate() {
        progress(done as u64, mapping.recordings.len() as u64);
        match Sampled::read(&laboratory, read, entry).and_then(|recording| {
            check_new(&laboratory, &recording, &sampled)?;
            Ok(recording)
        }) {
            Ok(recording) => sampled.push(recording),
            // All moments may depend on a calibration.
            Err(error) if entry.role == Role::Calibration => return Err(error),
            Err(error) => imported.failures.push(error),
        }
    }
    let usual = usual(&sampled);
    sampled.iter_mut().for_each(|recording| recording.mark_glitches(&mapping, usual));
    let Some(sensor) = Sensor::new(&laboratory, &sampled, usual)? else { return Ok(imported) };
    for recording in &sampled {
        match recording.trace(&laboratory, &sensor) {
            Ok((trace, outline)) => {
                imported.notes.extend(recording.notes());
                imported.outlines.extend(outline);
                imported.traces.push(trace);
            }
            Err(error) => imported.failures.push(error),
        }
    }
    Ok(imported)
}

/// Checks that a recording is none of those before it: a copy of a calibration would not be held out, one of a trial be scored
/// twice.
fn check_new(laboratory: &Laboratory<'_>, recording: &Sampled<'_>, before: &[Sampled<'_>]) -> Result<(), Error> {
    let Some(same) = before.iter().find(|before| before.sha256 == recording.sha256) else { return Ok(()) };
    let is_entry = |entry: &RecordingEntry| entry.name() == recording.entry.name();
    let place = laboratory.mapping.recordings.iter().position(is_entry).unwrap_or_default();
    let key = format!("recordings[{place}].file");
    Err(Error::value(
        laboratory.path,
        key,
        format!("the same content as the recording `{}`", same.entry.name()),
        "each recording once",
    ))
}

/// Largest reading relative to rest of the calibration, without glitches; of all recordings if there is no calibration. A trial
/// has no influence on the calibration.
fn usual(sampled: &[Sampled<'_>]) -> f64 {
    let of = |recordings: &mut dyn Iterator<Item = &Sampled<'_>>| recordings.map(Sampled::largest).reduce(f64::max);
    let is_calibration = |recording: &&Sampled<'_>| recording.entry.role == Role::Calibration;
    of(&mut sampled.iter().filter(is_calibration)).or_else(|| of(&mut sampled.iter())).unwrap_or_default()
}

/// Mapping and whisker, common to all recordings.
struct Laboratory<'a> {
    format: &'static str,
    /// Path of the mapping.
    path: &'a Path,
    mapping: &'a Mapping,
    whisker: Whisker,
}

/// A recording at the instants of its trace.
struct Sampled<'a> {
    entry: &'a RecordingEntry,
    path: PathBuf,
    sha256: String,
    repeated: usize,
    is_cut_off: bool,
    has_clock: bool,
    /// Remarks about single positions that may be glitches, and about readings that are.
    glitches: Vec<String>,
    grid: Grid,
    base: Vec<Pose<Base, World>>,
    at_rest: AtRest,
    /// Readings relative to rest, in the unit of the recording, at the instants of the recording ...
    samples: Series,
    /// ... and of the trace.
    readings: Vec<f64>,
    /// Distance from rest beyond which a reading is a glitch.
    most: f64,
    /// Place of the contact or of the axis of the pin, if known.
    places: Vec<Option<Point<World>>>,
    touching: Vec<Option<bool>>,
}

impl<'a> Sampled<'a> {
    fn read(laboratory: &Laboratory<'_>, read: ReadSource, entry: &'a RecordingEntry) -> Result<Self, Error> {
        let mapping = laboratory.mapping;
        let path = entry.path(laboratory.path);
        let wanted = wanted(mapping, entry);
        let ReadColumns { series, sha256, repeated, is_cut_off, has_clock } = read(&path, mapping, &wanted)?;
        let columns = Columns { wanted: &wanted, series: &series };
        columns.check(&path, mapping)?;
        let grid = Grid::new(&path, mapping, &columns.complete())?;
        let clock_s = &grid.clock_s;
        let pose = &mapping.pose;
        let (x, y) = (columns.lengths(&pose.x, clock_s), columns.lengths(&pose.y, clock_s));
        let yaw = columns.angles(&pose.yaw, clock_s);
        let reading = columns.series(&mapping.reading.column);
        let at_rest = AtRest::of(&path, &mapping.reading, reading)?;
        let known = |values: Vec<Option<f64>>| values.into_iter().map(Option::unwrap_or_default);
        let base = known(x).zip(known(y)).zip(known(yaw));
        let base: Vec<_> = base.map(|((x, y), yaw)| placed(mapping, x, y, yaw)).collect();
        check_poses(&path, &base)?;
        let places = match &entry.contact {
            None => vec![None; clock_s.len()],
            Some(ContactColumns { x, y, .. }) => {
                let pairs = columns.lengths(x, clock_s).into_iter().zip(columns.lengths(y, clock_s));
                pairs.map(|(x, y)| Some(Point::new(x?, y?))).collect()
            }
        };
        let radius_m = entry.contact.as_ref().and_then(ContactColumns::radius_m).unwrap_or_default();
        check_places(&path, &places, radius_m + laboratory.whisker.root_diameter_m)?;
        let flags = entry.touching.as_ref().map(|name| columns.series(name));
        if let Some((flags, name)) = flags.zip(entry.touching.as_ref()) {
            flags.check_flags(&path, name)?;
        }
        let flags = flags.map(|flags| flags.at(clock_s));
        let flag = |value: Option<f64>| value.map(|value| value >= 0.5);
        Ok(Self {
            entry,
            sha256,
            repeated,
            is_cut_off,
            has_clock,
            glitches: columns.glitches_of_positions(&path, mapping),
            base,
            readings: known(reading.at(clock_s)).map(|reading| reading - at_rest.rest).collect(),
            samples: reading.clone().shifted(-at_rest.rest),
            most: f64::INFINITY,
            at_rest,
            places,
            touching: flags.map_or(vec![None; clock_s.len()], |flags| flags.into_iter().map(flag).collect()),
            grid,
            path,
        })
    }

    /// Largest reading relative to rest, without single glitches: of the samples, since interpolation spreads a sample over two
    /// rows, and of the rows, since a row may take one of several samples of a glitch.
    fn largest(&self) -> f64 {
        let samples: Vec<f64> = self.samples.values.iter().flatten().copied().collect();
        sustained(&samples).min(sustained(&self.readings))
    }

    /// Finds the glitches of the reading, given the largest reading of the calibration. Interpolated rows take the value of the
    /// nearest sample there, so that a glitch remains a glitch, and its neighbours are not changed by it.
    fn mark_glitches(&mut self, mapping: &Mapping, usual: f64) {
        let most = GLITCH * usual.max(self.largest());
        let is_glitch = |reading: f64| reading.abs() > most;
        let depends = self.samples.depends_on(is_glitch, &self.grid.clock_s);
        for ((reading, time_s), depends) in self.readings.iter_mut().zip(&self.grid.clock_s).zip(depends) {
            if let Some(nearest) = self.samples.nearest(*time_s).filter(|_| depends) {
                *reading = nearest;
            }
        }
        let samples = self.samples.values.iter().zip(&self.samples.clock.places);
        let glitches: Vec<(f64, u64)> = samples
            .filter_map(|(value, line)| Some(((*value)?, *line)))
            .filter(|(value, _)| is_glitch(*value))
            .collect();
        if let Some((value, line)) = glitches.first() {
            let rest = self.at_rest.rest;
            self.glitches.push(format!(
                "{}:{line}: column `{}`: found {}, the first of {} such readings, expected at most {most:.3e} from rest ({rest}): \
                 their contacts are left out; remove such rows",
                self.path.display(),
                mapping.reading.column,
                value + rest,
                glitches.len()
            ));
        }
        self.most = most;
    }

    /// Remarks about the rows.
    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let name = self.entry.name();
        if self.grid.is_resampled {
            notes.push(format!("{name}: interpolated to equal intervals"));
        }
        if self.grid.gaps > 0 {
            notes.push(format!("{name}: {} gaps without rows", self.grid.gaps));
        }
        if self.is_cut_off {
            notes.push(format!(
                "{name}: last row left out, since it has no line end and its last number may be incomplete"
            ));
        }
        if self.repeated > 0 {
            notes.push(format!(
                "{name}: samples with the time of the one before, which are left out: {}",
                self.repeated
            ));
        }
        notes.extend(self.glitches.iter().map(|glitch| format!("{name}: {glitch}")));
        notes
    }

    /// Whether the whisker touches in a row: by its flag, if there is one, else by the reading.
    fn touches(&self, row: usize, touch: f64) -> bool {
        let size = self.readings[row].abs();
        size <= self.most && self.touching[row].unwrap_or(size > touch)
    }

    /// Contacts on the centre line and on the object in a row, if the whisker touches at a known place.
    fn contact(&self, row: usize, mechanics: &Mechanics<'_>, touch: f64) -> Option<Contact> {
        let place = self.places[row].filter(|_| self.touches(row, touch))?;
        let radius_m = self.entry.contact.as_ref().and_then(ContactColumns::radius_m);
        Some(mechanics.contact(&self.base[row], place, radius_m, self.entry.face))
    }

    fn trace(
        &self,
        laboratory: &Laboratory<'_>,
        sensor: &Sensor<'_>,
    ) -> Result<(Trace, Option<(String, Outline)>), Error> {
        let characteristic = &sensor.conversion.characteristic;
        self.check_moments(laboratory.mapping, characteristic)?;
        let (mut instants, mut truths) = (Vec::new(), Vec::new());
        for (row, t_s) in self.grid.t_s.iter().enumerate() {
            let moment_z_n_m = characteristic.moment_n_m(self.readings[row]);
            let base = self.base[row];
            instants.push(Instant { t_s: *t_s, base, twist: None, moment_z_n_m, rotation_z_rad: None });
            let contact = self.contact(row, &sensor.mechanics, sensor.touch);
            let touching = self.touching[row].or(contact.map(|_| true));
            truths.push(TruthInstant {
                touching,
                contact: contact.map(|contact| contact.centre_line),
                surface: contact.and_then(|contact| contact.surface),
                ..TruthInstant::default()
            });
        }
        let mut sidecar = self.sidecar(laboratory, sensor);
        let outline = self.outline();
        if let Some((file, outline)) = &outline {
            let radius_m = self.entry.contact.as_ref().and_then(ContactColumns::radius_m).unwrap_or_default();
            let chord_error_m = radius_m * (1.0 - (0.5 * TAU / VERTICES as f64).cos());
            sidecar.contour = Some(Contour { file: file.clone(), sha256: sha256(outline.to_csv()), chord_error_m });
        }
        let mut trace = Trace { sidecar, recording: Recording { instants }, truth: Truth { instants: truths } };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        Ok((trace, outline))
    }

    /// Checks that a reader of the trace accepts the moments: those of the samples, between which those of the rows lie.
    fn check_moments(&self, mapping: &Mapping, characteristic: &Characteristic) -> Result<(), Error> {
        let samples = self.samples.values.iter().zip(&self.samples.clock.places);
        for (value, line) in samples {
            let moment_n_m = characteristic.moment_n_m(value.unwrap_or_default());
            if !(moment_n_m.is_finite() && moment_n_m.abs() <= LARGEST) {
                let expected = format!("a magnitude of at most {LARGEST} N m; compare the units of the mapping");
                return Err(table_error(
                    &self.path,
                    &mapping.reading.column,
                    *line,
                    format!("{moment_n_m} N m from rest"),
                    expected,
                ));
            }
        }
        Ok(())
    }

    /// Outline of a pin of known radius at rest in World.
    fn outline(&self) -> Option<(String, Outline)> {
        let contact = self.entry.contact.as_ref()?;
        let (x_m, y_m, radius_m) = (contact.x.constant()?, contact.y.constant()?, contact.radius_m()?);
        let vertex = |i: usize| {
            let angle_rad = TAU * (i % VERTICES) as f64 / VERTICES as f64;
            Point::new(x_m + radius_m * angle_rad.cos(), y_m + radius_m * angle_rad.sin())
        };
        let outline = Outline::new((0..=VERTICES).map(vertex).collect())?;
        Some((format!("{}.contour.csv", self.entry.name()), outline))
    }

    fn sidecar(&self, laboratory: &Laboratory<'_>, sensor: &Sensor<'_>) -> Sidecar {
        let mapping = serde_json::to_vec(laboratory.mapping).expect("a mapping serialises");
        let coefficients = sensor.conversion.coefficients();
        let clock = match (self.has_clock, self.grid.is_resampled) {
            (false, _) => "nominal, a row a sample",
            (true, false) => "recorded",
            (true, true) => "recorded, interpolated to equal intervals",
        };
        let mut inputs = Digest::default();
        inputs.add(&self.sha256).add(mapping).add(format!("{coefficients:?}")).add(source_sha256());
        Sidecar {
            format: FORMAT,
            kind: "trace".into(),
            name: self.entry.name(),
            role: self.entry.role,
            group: self.entry.group().into(),
            object: self.entry.object.clone(),
            face: self.entry.face,
            seed: 0,
            rate_hz: laboratory.mapping.rate_hz,
            rows: self.grid.t_s.len(),
            whisker: laboratory.whisker.clone(),
            scene: serde_json::Value::Null,
            generator: generator(laboratory.format, source_sha256()),
            inputs_sha256: inputs.finish(),
            csv_sha256: String::new(),
            contour: None,
            certificate: None,
            recorded: Some(Recorded {
                clock: clock.into(),
                characteristic: coefficients,
                range_n_m: Some(sensor.conversion.characteristic.range_n_m),
                residual_counts: sensor.conversion.residual,
                rest_counts: self.at_rest.rest,
                noise_sd_n_m: self.at_rest.noise_sd / coefficients[0].abs(),
                touch_counts: sensor.touch,
                object_class: Some(self.entry.class()),
            }),
            recording: None,
            replay: None,
        }
    }
}

/// Columns of a mapping for one of its recordings, each once.
fn wanted<'a>(mapping: &'a Mapping, entry: &'a RecordingEntry) -> Vec<Wanted<'a>> {
    let pose = &mapping.pose;
    let needed =
        [&pose.x.column, &pose.y.column, &pose.yaw.column].into_iter().flatten().chain([&mapping.reading.column]);
    let contact = entry.contact.iter().flat_map(|contact| [&contact.x.column, &contact.y.column]).flatten();
    let optional = contact.chain(&entry.touching);
    let all = needed.map(|name| (name, false)).chain(optional.map(|name| (name, true)));
    let mut wanted: Vec<Wanted<'_>> = Vec::new();
    for (name, may_be_empty) in all {
        if wanted.iter().all(|known| known.name != name) {
            wanted.push(Wanted { name, may_be_empty });
        }
    }
    wanted
}

/// The columns that were read, by name.
struct Columns<'a> {
    wanted: &'a [Wanted<'a>],
    series: &'a [Series],
}

impl Columns<'_> {
    fn series(&self, name: &str) -> &Series {
        let place = self.wanted.iter().position(|wanted| wanted.name == name);
        &self.series[place.expect("every column of the mapping is wanted")]
    }

    /// The columns of the position of the pose (m), by name.
    fn positions<'a>(&'a self, mapping: &'a Mapping) -> impl Iterator<Item = (&'a str, Series)> {
        [&mapping.pose.x, &mapping.pose.y].into_iter().filter_map(|place| {
            let name = place.column.as_deref()?;
            Some((name, self.series(name).clone().scaled(place.factor())))
        })
    }

    /// Remarks about single positions of the pose that may be glitches: for each column, the number and the first.
    fn glitches_of_positions(&self, path: &Path, mapping: &Mapping) -> Vec<String> {
        let remark = |(name, series): (&str, Series)| {
            let glitches: Vec<Glitch> = series.glitches(GLITCH_M, 0.0).collect();
            let first = glitches.first()?;
            Some(format!(
                "{}:{}: column `{name}`: found {}, the first of {} such values; remove such rows unless the robot moved so fast",
                path.display(),
                first.line,
                first.found("m"),
                glitches.len()
            ))
        };
        self.positions(mapping).filter_map(remark).collect()
    }

    /// Checks the ranges of the columns, and that the yaw has no glitches.
    fn check(&self, path: &Path, mapping: &Mapping) -> Result<(), Error> {
        for (name, series) in self.positions(mapping) {
            series.check_range(path, name, FARTHEST_M, "m")?;
        }
        let pose = &mapping.pose;
        if let Some(name) = &pose.yaw.column {
            let series = self.series(name).clone().scaled(pose.yaw.factor());
            series.check_range(path, name, LARGEST, "rad")?;
            series.unwrapped().check_glitches(path, name, GLITCH_RAD, FASTEST_RAD_S, "rad")?;
        }
        let reading = &mapping.reading;
        let readings = self.series(&reading.column);
        match reading.unit {
            Reading::Counts => readings.check_range(path, &reading.column, MOST_COUNTS, "counts"),
            unit => readings.clone().scaled(unit.si()).check_range(path, &reading.column, LARGEST, "N m"),
        }
    }

    /// The columns that must have a value at each instant.
    fn complete(&self) -> Vec<&Series> {
        let pairs = self.wanted.iter().zip(self.series);
        pairs.filter(|(wanted, _)| !wanted.may_be_empty).map(|(_, series)| series).collect()
    }

    fn lengths<U: Unit>(&self, quantity: &Quantity<U>, clock_s: &[f64]) -> Vec<Option<f64>> {
        match &quantity.column {
            Some(name) => self.series(name).clone().scaled(quantity.factor()).at(clock_s),
            None => vec![quantity.constant(); clock_s.len()],
        }
    }

    fn angles<U: Unit>(&self, quantity: &Quantity<U>, clock_s: &[f64]) -> Vec<Option<f64>> {
        match &quantity.column {
            Some(name) => self.series(name).clone().scaled(quantity.factor()).unwrapped().at(clock_s),
            None => vec![quantity.constant(); clock_s.len()],
        }
    }
}

/// Pose of the base in World, the frame in which the object rests.
fn placed(mapping: &Mapping, x_m: f64, y_m: f64, yaw_rad: f64) -> Pose<Base, World> {
    match mapping.pose.of {
        Moving::Whisker => mapping.base::<Base, Base>().then(&Pose::new(x_m, y_m, yaw_rad)),
        Moving::Object => mapping.base::<Base, Base>().then(&Pose::<World, Base>::new(x_m, y_m, yaw_rad).inverse()),
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

/// Contact of a whisker with a pin.
#[derive(Clone, Copy, Debug)]
struct Contact {
    centre_line: Point<World>,
    /// `None` if the radius of the pin is not known.
    surface: Option<Point<World>>,
}

/// Mechanics of a whisker.
struct Mechanics<'a> {
    whisker: &'a Whisker,
    elastica: Elastica,
}

impl Mechanics<'_> {
    /// Contact at a place, or with a pin of this radius whose axis is the place: along the normal of the deflected
    /// whisker. Its tangent is that of the elastica through the contact, found by iteration, or else that of the
    /// undeflected whisker.
    fn contact(&self, base: &Pose<Base, World>, place: Point<World>, radius_m: Option<f64>, face: Face) -> Contact {
        let Some(radius_m) = radius_m else { return Contact { centre_line: place, surface: None } };
        let rest = self.whisker.rest_shape();
        let axis = base.inverse().apply(place);
        let away = |tangent_rad: f64| Vector2::new(-tangent_rad.sin(), tangent_rad.cos()) * face.away_sign();
        let mut contact = axis;
        let mut normal = Vector2::zeros();
        for _ in 0..ITERATIONS {
            let foot = rest.foot(contact);
            let tangent_rad = self
                .elastica
                .at_point(contact)
                .map_or_else(|_| rest.tangent_rad(foot.arc_m), |contact| contact.deflection.tangent_rad);
            normal = away(tangent_rad);
            contact = axis.shifted(normal * (radius_m + 0.5 * self.whisker.diameter_m(foot.arc_m)));
        }
        Contact { centre_line: base.apply(contact), surface: Some(base.apply(axis.shifted(normal * radius_m))) }
    }

    /// Moment of the elastica through a contact. `None` if the whisker does not reach it.
    fn moment_n_m(&self, base: &Pose<Base, World>, contact: &Contact) -> Option<f64> {
        let contact = self.elastica.at_point(base.inverse().apply(contact.centre_line)).ok()?;
        Some(contact.deflection.moment_n_m)
    }
}

/// Sensor of all recordings.
struct Sensor<'a> {
    mechanics: Mechanics<'a>,
    /// Distance from rest, in the unit of the recordings, beyond which the whisker touches.
    touch: f64,
    conversion: Conversion,
}

impl<'a> Sensor<'a> {
    /// Sensor as stated by the mapping, or fitted to the calibration, whose largest reading is `usual`. `None` without recordings.
    fn new(laboratory: &'a Laboratory<'_>, sampled: &[Sampled<'_>], usual: f64) -> Result<Option<Self>, Error> {
        if sampled.is_empty() {
            return Ok(None);
        }
        let (path, mapped) = (laboratory.path, &laboratory.mapping.reading);
        let elastica = Elastica::new(&laboratory.whisker)
            .map_err(|error| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected))?;
        let mechanics = Mechanics { whisker: &laboratory.whisker, elastica };
        let largest = sampled.iter().map(Sampled::largest).fold(0.0, f64::max);
        let touch = touch(mapped, usual);
        let conversion = match Conversion::stated(path, mapped, largest)? {
            Some(stated) => stated,
            None => {
                let calibration = sampled.iter().filter(|recording| recording.entry.role == Role::Calibration);
                let recordings = calibration.clone().count();
                let contacts: Vec<(&Sampled<'_>, usize, Contact)> = calibration
                    .flat_map(|recording| (0..recording.readings.len()).map(move |row| (recording, row)))
                    .filter_map(|(recording, row)| Some((recording, row, recording.contact(row, &mechanics, touch)?)))
                    .collect();
                let pair = |(recording, row, contact): (&Sampled<'_>, usize, Contact)| {
                    Some((mechanics.moment_n_m(&recording.base[row], &contact)?, recording.readings[row]))
                };
                let known = contacts.len();
                let pairs = contacts.into_iter().filter_map(pair).collect();
                Conversion::fitted(path, mapped, &Known { recordings, contacts: known, pairs }, touch)?
            }
        };
        Ok(Some(Self { mechanics, touch, conversion }))
    }
}

/// Hash of the sources that determine a trace.
fn source_sha256() -> String {
    let mut sources = Digest::default();
    for source in [
        &include_bytes!("mod.rs")[..],
        include_bytes!("columns.rs"),
        include_bytes!("mapping.rs"),
        include_bytes!("sensor.rs"),
        include_bytes!("series.rs"),
        include_bytes!("topics.rs"),
        include_bytes!("units.rs"),
    ] {
        sources.add(source);
    }
    sources.finish()
}
