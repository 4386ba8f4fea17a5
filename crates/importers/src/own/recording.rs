//! A recording at the instants of its trace.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use files::{Digest, Error};
use trace::LARGEST;

use super::mapping::{Channels, Keys, RecordingEntry};
use super::quantity::Quantity;
use super::rest::{AtRest, GLITCH, sustained};
use super::series::{Glitch, Grid, Interval, Series, join, named, table_error};
use super::units::{Reading, Unit};
use super::{Geometry, Laboratory, PoseKeys, Source, source_sha256};
use crate::MOST_COUNTS;

/// Smallest difference of a single position from its neighbours that may be a glitch. It may also be a fast motion.
const GLITCH_M: f64 = 0.01;

/// Length of an interpolated interval, in those of the nominal rate, above which a note states it.
const STATED_INTERVALS: f64 = 5.0;

/// Share of repeated readings at rest above which a note states it.
const STATED_REPEATS: f64 = 0.5;

/// A column to be read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted<'a> {
    pub(super) name: &'a str,
    /// Whether values may be missing.
    pub(super) may_be_empty: bool,
}

/// Columns of a recording.
pub(super) struct ReadColumns {
    /// In the order in which they were wanted.
    pub(super) series: Vec<Series>,
    pub(super) sha256: String,
    /// Samples with the time of the sample before, which are left out.
    pub(super) repeated: usize,
    /// Whether the last row has no line end, and is left out.
    pub(super) is_cut_off: bool,
    pub(super) has_clock: bool,
}

/// A channel of the sensor, relative to rest, in the unit of the recording.
struct Channel {
    at_rest: AtRest,
    /// At the instants of the recording ...
    samples: Series,
    /// ... and of the trace.
    rows: Vec<f64>,
}

/// A recording at the instants of its trace.
pub(crate) struct Sampled<'a, G: Geometry> {
    pub(super) entry: &'a RecordingEntry<G>,
    pub(super) path: PathBuf,
    pub(super) sha256: String,
    repeated: usize,
    is_cut_off: bool,
    has_clock: bool,
    /// Remarks about single positions that may be glitches, and about readings that are.
    glitches: Vec<String>,
    pub(super) grid: Grid,
    pub(super) base: Vec<G::BasePose>,
    reading: &'a G::Reading,
    pub(super) rate_hz: f64,
    channels: Vec<Channel>,
    /// Distance from rest beyond which a reading is a glitch.
    most: f64,
    /// Place of the contact or of the axis of the pin, if known.
    pub(super) places: Vec<Option<G::Place>>,
    /// Whether the whisker touches, if recorded.
    pub(super) touching: Vec<Option<bool>>,
}

impl<'a, G: Geometry> Sampled<'a, G> {
    /// Reads and resamples a recording.
    ///
    /// # Errors
    /// [`Error`] of the first value that is missing or implausible.
    pub(super) fn read(
        laboratory: &Laboratory<'a, G>,
        source: &Source,
        entry: &'a RecordingEntry<G>,
    ) -> Result<Self, Error> {
        let mapping = laboratory.mapping;
        let path = entry.path(laboratory.path);
        let wanted = wanted(laboratory, entry);
        let ReadColumns { series, sha256, repeated, is_cut_off, has_clock } =
            (source.read)(&path, &mapping.layout(), &wanted)?;
        let columns = Columns { wanted: &wanted, series: &series, longest_gap_s: mapping.layout().longest_gap_s };
        columns.check_readings(&path, &mapping.reading)?;
        let grid = Grid::new(&path, &mapping.layout(), &columns.complete())?;
        let clock_s = &grid.clock_s;
        let channels = channels(laboratory, &path, &columns, clock_s)?;
        let base = G::poses(laboratory, &path, &columns, clock_s)?;
        let places = match &entry.contact {
            None => clock_s.iter().map(|_| None).collect(),
            Some(contact) => G::places(laboratory, &path, contact, &columns, clock_s)?,
        };
        let touching = match &entry.touching {
            None => vec![None; clock_s.len()],
            Some(name) => {
                let flags = columns.series(name);
                flags.check_flags(&path, name)?;
                flags.held(clock_s).into_iter().map(|flag| flag.map(|flag| flag != 0.0)).collect()
            }
        };
        Ok(Self {
            entry,
            sha256,
            repeated,
            is_cut_off,
            has_clock,
            glitches: columns.glitches(&path, &mapping.pose.positions()),
            base,
            reading: &mapping.reading,
            rate_hz: mapping.rate_hz,
            channels,
            most: f64::INFINITY,
            places,
            touching,
            grid,
            path,
        })
    }

    /// Readings of all channels at rest.
    pub(super) fn rest(&self) -> Vec<f64> {
        self.channels.iter().map(|channel| channel.at_rest.rest).collect()
    }

    /// Standard deviations of the noise of all channels.
    pub(super) fn noise_sd(&self) -> Vec<f64> {
        self.channels.iter().map(|channel| channel.at_rest.noise_sd).collect()
    }

    /// Reading of each channel relative to rest in a row of the trace.
    pub(super) fn readings(&self, row: usize) -> impl Iterator<Item = f64> {
        self.channels.iter().map(move |channel| channel.rows[row])
    }

    /// Distance of the reading from rest in a row of the trace.
    pub(super) fn distance_from_rest(&self, row: usize) -> f64 {
        self.readings(row).fold(0.0, f64::hypot)
    }

    /// The samples relative to rest with their lines, if all channels have a value.
    pub(super) fn samples(&self) -> impl Iterator<Item = (Vec<f64>, u64)> {
        let places = self.channels[0].samples.clock.places.iter().enumerate();
        let sample =
            |i: usize| self.channels.iter().map(|channel| channel.samples.values[i]).collect::<Option<Vec<_>>>();
        places.filter_map(move |(i, line)| Some((sample(i)?, *line)))
    }

    /// Distances of the samples from rest.
    fn sizes(&self) -> Series {
        let samples = &self.channels[0].samples;
        let size = |i: usize| {
            let mut values = self.channels.iter().map(|channel| channel.samples.values[i]);
            values.try_fold(0.0, |size: f64, value| Some(size.hypot(value?)))
        };
        Series { clock: samples.clock.clone(), values: (0..samples.values.len()).map(size).collect() }
    }

    /// Largest reading relative to rest, without single glitches: of the samples, since interpolation spreads a sample over two
    /// rows, and of the rows, since a row may take one of several samples of a glitch.
    pub(super) fn largest(&self) -> f64 {
        let samples: Vec<f64> = self.sizes().values.into_iter().flatten().collect();
        let rows: Vec<f64> = (0..self.grid.t_s.len()).map(|row| self.distance_from_rest(row)).collect();
        sustained(&samples).min(sustained(&rows))
    }

    /// Smallest and largest reading of the first channel relative to rest, without single glitches, as [`Self::largest`].
    pub(super) fn extremes(&self) -> [f64; 2] {
        let Channel { samples, rows, .. } = &self.channels[0];
        [-1.0, 1.0].map(|sign: f64| {
            let most = |readings: &mut dyn Iterator<Item = f64>| {
                sustained(&readings.map(|reading| (sign * reading).max(0.0)).collect::<Vec<_>>())
            };
            sign * most(&mut samples.values.iter().flatten().copied()).min(most(&mut rows.iter().copied()))
        })
    }

    /// Finds the glitches of the reading, given the largest reading of the calibration. Interpolated rows take the value of the
    /// nearest sample there, so that a glitch remains a glitch, and its neighbours are not changed by it.
    pub(super) fn mark_glitches(&mut self, usual: f64) {
        let most = GLITCH * usual.max(self.largest());
        let sizes = self.sizes();
        let depends = sizes.depends_on(|size| size > most, &self.grid.clock_s);
        for Channel { samples, rows, .. } in &mut self.channels {
            for ((reading, time_s), depends) in rows.iter_mut().zip(&self.grid.clock_s).zip(&depends) {
                if let Some(nearest) = samples.nearest(*time_s).filter(|_| *depends) {
                    *reading = nearest;
                }
            }
        }
        self.most = most;
        let is_glitch = |(values, _): &(Vec<f64>, u64)| values.iter().copied().fold(0.0, f64::hypot) > most;
        let count = self.samples().filter(is_glitch).count();
        let first = self.samples().find(is_glitch);
        if let Some((values, line)) = first {
            let rest = self.rest();
            let found = join(values.iter().zip(&rest).map(|(value, rest)| (value + rest).to_string()));
            let remark = format!(
                "{}:{line}: {}: found {found}, the first of {count} such readings, expected at most {most:.3e} from rest ({}): \
                 their contacts are left out; remove such rows",
                self.path.display(),
                named(&self.reading.columns()),
                join(rest.iter().map(f64::to_string)),
            );
            self.glitches.push(remark);
        }
    }

    /// Remarks about the rows, given the distance from rest beyond which the whisker touches.
    pub(super) fn notes(&self, touch: f64) -> Vec<String> {
        let mut notes = Vec::new();
        let name = self.entry.name();
        let change = self.channels.iter().map(|channel| channel.at_rest.change).fold(0.0, f64::hypot);
        if change > touch {
            notes.push(format!(
                "{name}: reading at rest: found a change of {change:.3e} within `rest_s`, expected at most {touch:.3e} (`touch`); the \
                 whisker must be free during this time"
            ));
        }
        let repeats = self.channels.iter().map(|channel| channel.at_rest.repeats).fold(0.0, f64::max);
        if repeats > STATED_REPEATS {
            notes.push(format!(
                "{name}: reading at rest: found {:.0} % of the consecutive readings equal, expected a new reading in each row: the sensor \
                 is slower than the recording, or its readings are frozen; the noise is that of the readings that differ",
                100.0 * repeats
            ));
        }
        if self.grid.is_resampled {
            let long = self.grid.longest.filter(|longest| longest.duration_s * self.rate_hz > STATED_INTERVALS);
            let longest = long.map_or_else(String::new, |Interval { start_s, duration_s }| {
                format!(", up to {duration_s:.3} s without a sample (from {start_s:.3} s on)")
            });
            notes.push(format!("{name}: interpolated to equal intervals{longest}"));
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
    pub(super) fn touches(&self, row: usize, touch: f64) -> bool {
        let size = self.distance_from_rest(row);
        size <= self.most && self.touching[row].unwrap_or(size > touch)
    }

    /// Checks that a reader of the trace accepts the moments of the samples, between which those of the rows lie.
    ///
    /// # Errors
    /// [`Error::Table`] of the first one that it does not.
    pub(super) fn check_moments(&self, moments_n_m: impl Fn(&[f64]) -> Vec<f64>) -> Result<(), Error> {
        for (sample, line) in self.samples() {
            let is_far = |moment_n_m: &f64| !(moment_n_m.is_finite() && moment_n_m.abs() <= LARGEST);
            if let Some(moment_n_m) = moments_n_m(&sample).into_iter().find(is_far) {
                let expected = format!("a magnitude of at most {LARGEST} N m; compare the units of the mapping");
                let found = format!("{moment_n_m} N m from rest");
                return Err(table_error(&self.path, &self.reading.columns(), line, found, expected));
            }
        }
        Ok(())
    }

    /// Source of the times.
    pub(super) fn clock(&self) -> &'static str {
        match (self.has_clock, self.grid.is_resampled) {
            (false, _) => "nominal, a row a sample",
            (true, false) => "recorded",
            (true, true) => "recorded, interpolated to equal intervals",
        }
    }

    /// Hash of everything that determines the trace, with the response of the sensor and the distance from rest beyond which the
    /// whisker touches.
    pub(super) fn inputs_sha256(&self, laboratory: &Laboratory<'_, G>, response: &str, touch: f64) -> String {
        let mapping = serde_json::to_vec(laboratory.mapping).expect("a mapping serialises");
        let mut inputs = Digest::default();
        inputs.add(&self.sha256).add(mapping).add(response).add(format!("{touch} {}", self.most)).add(source_sha256());
        inputs.finish()
    }
}

/// The channels of the reading.
fn channels<G: Geometry>(
    laboratory: &Laboratory<'_, G>,
    path: &Path,
    columns: &Columns<'_>,
    clock_s: &[f64],
) -> Result<Vec<Channel>, Error> {
    let reading = &laboratory.mapping.reading;
    let names = reading.columns();
    columns.check_one_clock(laboratory.path, path, "reading.channels", &names)?;
    let channel = |(channel, name): (usize, &&str)| {
        let series = columns.series(name);
        let at_rest = AtRest::of(path, reading.stated(channel), reading.rest_s(), series)?;
        let rows = series.at(clock_s).into_iter().map(|reading| reading.unwrap_or_default() - at_rest.rest).collect();
        Ok(Channel { at_rest, samples: series.clone().shifted(-at_rest.rest), rows })
    };
    names.iter().enumerate().map(channel).collect()
}

/// Columns of a mapping for one of its recordings, each once.
fn wanted<'a, G: Geometry>(laboratory: &Laboratory<'a, G>, entry: &'a RecordingEntry<G>) -> Vec<Wanted<'a>> {
    let mapping = laboratory.mapping;
    let needed = mapping.pose.columns().into_iter().chain(mapping.reading.columns());
    let contact = entry.contact.iter().flat_map(Keys::columns);
    let optional = contact.chain(entry.touching.as_deref());
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
pub(crate) struct Columns<'a> {
    wanted: &'a [Wanted<'a>],
    series: &'a [Series],
    /// Longest interval between samples that is interpolated.
    longest_gap_s: f64,
}

impl Columns<'_> {
    pub(super) fn series(&self, name: &str) -> &Series {
        let place = self.wanted.iter().position(|wanted| wanted.name == name);
        &self.series[place.expect("every column of the mapping is wanted")]
    }

    /// Checks that columns of the recording at `path`, those of a key of the mapping, have the same times.
    ///
    /// # Errors
    /// [`Error::Value`] with the key.
    pub(super) fn check_one_clock(&self, mapping: &Path, path: &Path, key: &str, names: &[&str]) -> Result<(), Error> {
        let mut clocks = names.iter().map(|name| &self.series(name).clock);
        let first = clocks.next();
        if clocks.all(|clock| first.is_none_or(|first| Rc::ptr_eq(clock, first))) {
            return Ok(());
        }
        let names = join(names.iter().map(|name| format!("`{name}`")));
        let found = format!("fields with times of their own in {}: {names}", path.display());
        Err(Error::value(mapping, key, found, "fields of the same messages"))
    }

    /// The quantities that are columns, in SI units, by name.
    pub(super) fn scaled<'a, U: Unit>(
        &'a self,
        quantities: &'a [&Quantity<U>],
    ) -> impl Iterator<Item = (&'a str, Series)> {
        quantities.iter().filter_map(|quantity| {
            let name = quantity.column.as_deref()?;
            Some((name, self.series(name).clone().scaled(quantity.factor())))
        })
    }

    /// Remarks about single positions of the pose that may be glitches: for each column, the number and the first.
    fn glitches<U: Unit>(&self, path: &Path, positions: &[&Quantity<U>]) -> Vec<String> {
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
        self.scaled(positions).filter_map(remark).collect()
    }

    /// Checks that quantities are at most `most` in SI units, with this name.
    pub(super) fn check_ranges<U: Unit>(
        &self,
        path: &Path,
        quantities: &[&Quantity<U>],
        most: f64,
        unit: &str,
    ) -> Result<(), Error> {
        self.scaled(quantities).try_for_each(|(name, series)| series.check_range(path, name, most, unit))
    }

    fn check_readings(&self, path: &Path, reading: &impl Channels) -> Result<(), Error> {
        for name in reading.columns() {
            let readings = self.series(name);
            match reading.unit() {
                Reading::Counts => readings.check_range(path, name, MOST_COUNTS, "counts"),
                unit => readings.clone().scaled(unit.si()).check_range(path, name, LARGEST, "N m"),
            }?;
        }
        Ok(())
    }

    /// The columns that must have a value at each instant.
    fn complete(&self) -> Vec<&Series> {
        let pairs = self.wanted.iter().zip(self.series);
        pairs.filter(|(wanted, _)| !wanted.may_be_empty).map(|(_, series)| series).collect()
    }

    /// Values of a quantity (SI units) at increasing times. `None` where the recording has no value, or where the samples around
    /// the time are farther apart than the longest gap; of the columns that must be complete, such times are not among those of the
    /// grid.
    pub(super) fn at<U: Unit>(&self, quantity: &Quantity<U>, clock_s: &[f64]) -> Vec<Option<f64>> {
        match &quantity.column {
            Some(name) => {
                let series = self.series(name).clone().scaled(quantity.factor());
                let may_be_empty = self.wanted.iter().any(|wanted| wanted.name == name && wanted.may_be_empty);
                series.within(clock_s, if may_be_empty { self.longest_gap_s } else { f64::INFINITY })
            }
            None => vec![quantity.constant(); clock_s.len()],
        }
    }
}
