//! Quantities over time, and their resampling to equal intervals.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::path::Path;
use std::rc::Rc;

use files::Error;

use super::mapping::{Gaps, Layout};

/// Deviation from equal intervals, in intervals, up to which the rows of a recording are kept as they are.
const EVEN: f64 = 0.05;

/// Largest ratio of the rate to the median rate of a recording.
const MOST_UPSAMPLING: f64 = 10.0;

/// Largest number of rows for each sample of a recording.
const MOST_ROWS_PER_SAMPLE: f64 = 20.0;

/// Longest recording.
const MOST_S: f64 = 1e10;

/// Ratio of a glitch to the steps of its column elsewhere.
const GLITCH: f64 = 10.0;

/// Share, and least number, of the largest steps of a column that are taken to be those of glitches.
const OF_GLITCHES: (usize, usize) = (100, 4);

/// Error of rounding of two equal times.
const ROUNDING_S: f64 = 1e-9;

/// A single value that differs strongly from both its neighbours, in the same direction.
#[derive(Debug)]
pub(crate) struct Glitch {
    /// Its line or message, from 1.
    pub(crate) line: u64,
    /// The value between those of its neighbours.
    pub(crate) values: [f64; 3],
    /// Largest difference from a neighbour that is usual.
    pub(crate) most: f64,
}

impl Glitch {
    /// The value and its neighbours in this unit.
    pub(crate) fn found(&self, unit: &str) -> String {
        let [before, value, after] = self.values;
        format!("{value} {unit} between {before} and {after} {unit}")
    }
}

/// Times of samples and their places in the file.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Clock {
    /// Times, strictly increasing.
    pub(crate) times_s: Vec<f64>,
    /// Line or message of each sample, from 1.
    pub(crate) places: Vec<u64>,
}

impl Clock {
    /// Appends a time, unless it equals the last one. Returns whether it was appended.
    ///
    /// # Errors
    /// [`Error::Table`] if the time decreases, or is too large.
    pub(crate) fn push(&mut self, path: &Path, place: u64, time_s: f64) -> Result<bool, Error> {
        let wrong = |found, expected| {
            let place_in_row = "time".into();
            Err(Error::Table { path: path.into(), line: place, place: place_in_row, found, expected })
        };
        match self.times_s.last() {
            _ if time_s > MOST_S => {
                let expected = format!("at most {MOST_S} s; compare the unit of the times");
                wrong(format!("{time_s} s after the first row"), expected)
            }
            Some(last) if time_s < *last => {
                wrong(format!("{time_s} s after {last} s"), "times that do not decrease".into())
            }
            Some(last) if time_s == *last => Ok(false),
            _ => {
                self.times_s.push(time_s);
                self.places.push(place);
                Ok(true)
            }
        }
    }
}

/// Values of one quantity over time.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub(crate) clock: Rc<Clock>,
    /// One entry for each time. `None` where the recording has no value.
    pub(crate) values: Vec<Option<f64>>,
}

impl Series {
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        self.values.iter_mut().flatten().for_each(|value| *value *= factor);
        self
    }

    pub(crate) fn shifted(mut self, by: f64) -> Self {
        self.values.iter_mut().flatten().for_each(|value| *value += by);
        self
    }

    /// The angles (rad) made continuous: a step of more than half a turn is one across the end of the range.
    pub(crate) fn unwrapped(mut self) -> Self {
        let mut last: Option<f64> = None;
        for value in self.values.iter_mut().flatten() {
            if let Some(last) = last {
                *value -= TAU * ((*value - last) / TAU).round();
            }
            last = Some(*value);
        }
        self
    }

    /// Checks that the magnitude of each value is at most `most`.
    ///
    /// # Errors
    /// [`Error::Table`] at the first value that is larger.
    pub(crate) fn check_range(&self, path: &Path, column: &str, most: f64, unit: &str) -> Result<(), Error> {
        let is_larger = |value: &Option<f64>| value.is_some_and(|value| value.abs() > most);
        let Some(place) = self.values.iter().position(is_larger) else { return Ok(()) };
        let found = format!("{} {unit}", self.values[place].unwrap_or_default());
        let expected = format!("a magnitude of at most {most} {unit}; compare the units of the mapping");
        Err(table_error(path, &[column], self.clock.places[place], found, expected))
    }

    /// Checks that no single value differs from both its neighbours, in the same direction, by more than `least`, by more than ten
    /// times the steps of the series elsewhere, and by more than a motion of the speed `fastest` covers between the samples.
    ///
    /// # Errors
    /// [`Error::Table`] of the first one that does.
    pub(crate) fn check_glitches(
        &self,
        path: &Path,
        column: &str,
        least: f64,
        fastest: f64,
        unit: &str,
    ) -> Result<(), Error> {
        let Some(glitch) = self.glitches(least, fastest).next() else { return Ok(()) };
        let expected = format!("single values within {:.3} {unit} of their neighbours: remove the row", glitch.most);
        Err(table_error(path, &[column], glitch.line, glitch.found(unit), expected))
    }

    /// The single values that differ from both their neighbours, in the same direction, by more than `least`, by more than ten
    /// times the steps of the series elsewhere, and by more than a motion of the speed `fastest` covers between the samples.
    pub(crate) fn glitches(&self, least: f64, fastest: f64) -> impl Iterator<Item = Glitch> {
        let clock = &self.clock;
        let known: Vec<(usize, f64)> =
            self.values.iter().enumerate().filter_map(|(place, value)| Some((place, (*value)?))).collect();
        let mut steps: Vec<f64> = known.windows(2).map(|pair| (pair[1].1 - pair[0].1).abs()).collect();
        let (part, fewest) = OF_GLITCHES;
        let usual = steps.len().checked_sub(1 + fewest.max(steps.len() / part));
        let most = usual
            .map_or(f64::INFINITY, |usual| least.max(GLITCH * *steps.select_nth_unstable_by(usual, f64::total_cmp).1));
        (1..known.len().saturating_sub(1)).filter_map(move |middle| {
            let [before, at, after] = [middle - 1, middle, middle + 1].map(|i| known[i]);
            let [before_s, at_s, after_s] = [before, at, after].map(|(place, _)| clock.times_s[place]);
            let most = most.max(fastest * (at_s - before_s).max(after_s - at_s));
            let (there, back) = (at.1 - before.1, after.1 - at.1);
            let size = there.abs().min(back.abs());
            let is_glitch = there * back < 0.0 && size > most && (there + back).abs() < 0.5 * size;
            is_glitch.then(|| Glitch { line: clock.places[at.0], values: [before.1, at.1, after.1], most })
        })
    }

    /// Checks that each value is 0 or 1.
    ///
    /// # Errors
    /// [`Error::Table`] at the first value that is not.
    pub(crate) fn check_flags(&self, path: &Path, column: &str) -> Result<(), Error> {
        let is_wrong = |value: &Option<f64>| value.is_some_and(|value| value != 0.0 && value != 1.0);
        let Some(place) = self.values.iter().position(is_wrong) else { return Ok(()) };
        let found = self.values[place].unwrap_or_default().to_string();
        Err(table_error(path, &[column], self.clock.places[place], found, "0, 1 or an empty field".into()))
    }

    /// Value of the sample with the nearest time. `None` if the recording has no value there.
    pub(crate) fn nearest(&self, time_s: f64) -> Option<f64> {
        let times_s = &self.clock.times_s;
        let next = times_s.partition_point(|sample_s| *sample_s < time_s);
        let places = [next.checked_sub(1), Some(next)].into_iter().flatten().filter(|place| *place < times_s.len());
        let distance_s = |place: usize| (times_s[place] - time_s).abs();
        self.values[places.min_by(|a, b| distance_s(*a).total_cmp(&distance_s(*b)))?]
    }

    /// For each of the increasing times, whether the interpolated value depends on a value that meets a condition.
    pub(crate) fn depends_on(&self, condition: impl Fn(f64) -> bool, times_s: &[f64]) -> Vec<bool> {
        let flag = |value: &Option<f64>| value.map(|value| f64::from(u8::from(condition(value))));
        let flags = Self { clock: self.clock.clone(), values: self.values.iter().map(flag).collect() };
        flags.at(times_s).into_iter().map(|share| share.is_some_and(|share| share > 0.0)).collect()
    }

    /// Values of the last samples before or at increasing times. `None` before the first sample, or if the recording has no value
    /// there.
    pub(crate) fn held(&self, times_s: &[f64]) -> Vec<Option<f64>> {
        let own = &self.clock.times_s;
        let last = |time_s: &f64| {
            self.values[own.partition_point(|sample_s| *sample_s <= time_s + ROUNDING_S).checked_sub(1)?]
        };
        times_s.iter().map(last).collect()
    }

    /// Values at increasing times, interpolated linearly between known ones.
    pub(crate) fn at(&self, times_s: &[f64]) -> Vec<Option<f64>> {
        self.within(times_s, f64::INFINITY)
    }

    /// As [`Self::at`], without values where the samples around the time are more than `longest_gap_s` apart.
    pub(crate) fn within(&self, times_s: &[f64], longest_gap_s: f64) -> Vec<Option<f64>> {
        let own = &self.clock.times_s;
        let mut next = 0;
        let interpolate = |time_s: &f64| {
            while next < own.len() && own[next] < *time_s {
                next += 1;
            }
            if own.get(next) == Some(time_s) {
                return self.values[next];
            }
            let (from, to) = (next.checked_sub(1)?, next);
            if *own.get(to)? - own[from] > longest_gap_s {
                return None;
            }
            let (first, second) = (self.values[from]?, self.values[to]?);
            Some(first + (second - first) * (time_s - own[from]) / (own[to] - own[from]))
        };
        times_s.iter().map(interpolate).collect()
    }
}

/// The error of columns in a line.
pub(crate) fn table_error(path: &Path, columns: &[&str], line: u64, found: String, expected: String) -> Error {
    Error::Table { path: path.into(), line, place: named(columns), found, expected }
}

/// Names of columns, as the place of an error.
pub(crate) fn named(columns: &[&str]) -> String {
    match columns {
        [column] => format!("column `{column}`"),
        _ => format!("columns {}", join(columns.iter().map(|column| format!("`{column}`")))),
    }
}

pub(crate) fn join(texts: impl Iterator<Item = String>) -> String {
    texts.collect::<Vec<_>>().join(", ")
}

/// Instants of a trace.
#[derive(Debug)]
pub(crate) struct Grid {
    /// Times since the first row.
    pub(crate) t_s: Vec<f64>,
    /// The same on the clock of the recording.
    pub(crate) clock_s: Vec<f64>,
    /// Whether values are interpolated.
    pub(crate) is_resampled: bool,
    /// Gaps without rows.
    pub(crate) gaps: usize,
    /// Longest interval between two samples that is interpolated, with the time at which it begins on the clock of the recording.
    pub(crate) longest: Option<Interval>,
}

/// An interval of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub(crate) start_s: f64,
    pub(crate) duration_s: f64,
}

impl Grid {
    /// Instants at the rate of the layout at which all series have values.
    ///
    /// # Errors
    /// [`Error`] if the series do not overlap, have a gap that is refused, or have another order of magnitude of rate.
    pub(crate) fn new(path: &Path, layout: &Layout<'_>, series: &[&Series]) -> Result<Self, Error> {
        let rate_hz = layout.rate_hz;
        let clocks = distinct(series);
        let first = clocks.iter().filter_map(|clock| clock.times_s.first()).copied().fold(f64::NEG_INFINITY, f64::max);
        let last = clocks.iter().filter_map(|clock| clock.times_s.last()).copied().fold(f64::INFINITY, f64::min);
        if clocks.iter().any(|clock| clock.times_s.is_empty()) || first > last {
            return Err(Error::value(path, "times", "no instant at which all columns have values", "an overlap"));
        }
        if let [clock] = clocks.as_slice()
            && is_even(&clock.times_s, rate_hz)
        {
            let t_s = (0..clock.times_s.len()).map(|row| row as f64 / rate_hz).collect();
            return Ok(Self { t_s, clock_s: clock.times_s.clone(), is_resampled: false, gaps: 0, longest: None });
        }
        for clock in &clocks {
            check_rate(path, rate_hz, clock)?;
        }
        let gaps = gaps(path, layout, &clocks, [first, last])?;
        let samples: usize = clocks.iter().map(|clock| clock.times_s.len()).sum();
        let covered_s = last - first - gaps.iter().map(|[from, to]| to - from).sum::<f64>();
        if covered_s * rate_hz > MOST_ROWS_PER_SAMPLE * samples as f64 {
            let found = format!("{rate_hz}, which needs {:.0} rows for {samples} samples", covered_s * rate_hz);
            return Err(Error::value(path, "rate_hz", found, "about the rate of the recording"));
        }
        let longest = longest_interval(&clocks, layout.longest_gap_s);
        let mut grid = Self { t_s: Vec::new(), clock_s: Vec::new(), is_resampled: true, gaps: gaps.len(), longest };
        let mut open = gaps.iter().peekable();
        let mut row: u64 = 0;
        loop {
            let time_s = first + row as f64 / rate_hz;
            if time_s > last {
                return Ok(grid);
            }
            while open.next_if(|[_, to]| *to <= time_s).is_some() {}
            match open.peek() {
                Some([from, to]) if *from < time_s => row = (((to - first) * rate_hz).ceil() as u64).max(row + 1),
                _ => {
                    grid.t_s.push(row as f64 / rate_hz);
                    grid.clock_s.push(time_s);
                    row += 1;
                }
            }
        }
    }
}

/// Clocks of series, each once.
fn distinct<'a>(series: &[&'a Series]) -> Vec<&'a Clock> {
    let mut seen = BTreeSet::new();
    series.iter().filter(|series| seen.insert(Rc::as_ptr(&series.clock))).map(|series| &*series.clock).collect()
}

fn is_even(times_s: &[f64], rate_hz: f64) -> bool {
    times_s.iter().enumerate().all(|(row, time_s)| ((time_s - times_s[0]) * rate_hz - row as f64).abs() < EVEN)
}

/// Longest interval between two samples of a clock, of those up to `most_s`.
fn longest_interval(clocks: &[&Clock], most_s: f64) -> Option<Interval> {
    let steps = clocks.iter().flat_map(|clock| clock.times_s.windows(2));
    let intervals = steps.map(|pair| Interval { start_s: pair[0], duration_s: pair[1] - pair[0] });
    intervals
        .filter(|interval| interval.duration_s <= most_s)
        .max_by(|one, other| one.duration_s.total_cmp(&other.duration_s))
}

/// Compares the rate with the median rate of a clock.
fn check_rate(path: &Path, rate_hz: f64, clock: &Clock) -> Result<(), Error> {
    let mut steps_s: Vec<f64> = clock.times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps_s.is_empty() {
        return Ok(());
    }
    let middle = steps_s.len() / 2;
    let step_s = *steps_s.select_nth_unstable_by(middle, f64::total_cmp).1;
    if step_s * rate_hz > MOST_UPSAMPLING {
        let found = format!("{rate_hz} for samples every {step_s} s");
        let expected = format!("at most {MOST_UPSAMPLING} rows a sample; compare the unit of the times");
        return Err(Error::value(path, "rate_hz", found, expected));
    }
    Ok(())
}

/// Gaps of all clocks within a range of time, in order of time and disjoint.
fn gaps(path: &Path, layout: &Layout<'_>, clocks: &[&Clock], [first, last]: [f64; 2]) -> Result<Vec<[f64; 2]>, Error> {
    let mut gaps: Vec<[f64; 2]> = Vec::new();
    for clock in clocks {
        for (i, pair) in clock.times_s.windows(2).enumerate() {
            let [from, to] = [pair[0].max(first), pair[1].min(last)];
            if pair[1] - pair[0] <= layout.longest_gap_s || to <= from {
                continue;
            }
            if layout.gaps == Gaps::Refuse {
                return Err(Error::Table {
                    path: path.into(),
                    line: clock.places[i + 1],
                    place: "time".into(),
                    found: format!("a gap of {:.6} s after {} s", pair[1] - pair[0], pair[0]),
                    expected: format!(
                        "at most {} s; state `\"gaps\": \"leave\"` to leave gaps without rows, or a larger `longest_gap_s`",
                        layout.longest_gap_s
                    ),
                });
            }
            gaps.push([from, to]);
        }
    }
    gaps.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for gap in gaps {
        match joined.last_mut() {
            Some(last) if gap[0] <= last[1] => last[1] = last[1].max(gap[1]),
            _ => joined.push(gap),
        }
    }
    Ok(joined)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(times_s: &[f64], values: &[Option<f64>]) -> Series {
        let places = (2..).take(times_s.len()).collect();
        Series { clock: Rc::new(Clock { times_s: times_s.into(), places }), values: values.into() }
    }

    #[test]
    fn verif_values_are_interpolated_between_known_ones() {
        let series = series(&[0.0, 1.0, 2.0, 3.0], &[Some(1.0), Some(3.0), None, Some(7.0)]);
        let found = series.at(&[0.0, 0.25, 1.0, 1.5, 3.0, 3.5]);
        assert_eq!(found, [Some(1.0), Some(1.5), Some(3.0), None, Some(7.0), None]);
    }

    #[test]
    fn verif_flags_are_held_and_long_gaps_have_no_values() {
        let series = series(&[1.0, 2.0, 5.0, 6.0], &[Some(0.0), Some(1.0), Some(0.0), None]);
        let times_s = [0.5, 1.0, 1.9, 2.0, 4.9, 5.0, 5.5, 6.0, 7.0];
        let (free, touches) = (Some(0.0), Some(1.0));
        assert_eq!(series.held(&times_s), [None, free, free, touches, touches, free, free, None, None]);
        assert_eq!(series.within(&[1.5, 2.0, 3.5, 5.0], 2.0), [Some(0.5), touches, None, free]);
        assert_eq!(series.within(&[3.5], 3.0), [Some(0.5)]);
    }

    #[test]
    fn verif_wrapped_angles_become_continuous() {
        let wrapped = series(&[0.0, 1.0, 2.0, 3.0], &[Some(3.0), Some(-3.0), None, Some(3.1)]);
        let found: Vec<f64> = wrapped.unwrapped().values.into_iter().flatten().collect();
        assert!((found[1] - (TAU - 3.0)).abs() < 1e-12 && (found[2] - 3.1).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn robust_glitches_and_large_values_are_named_with_their_row() {
        let path = Path::new("log.csv");
        let of = |values: &[f64]| {
            let clock = Clock { times_s: (0..20).map(f64::from).collect(), places: (2..22).collect() };
            Series { clock: Rc::new(clock), values: values.iter().map(|value| Some(*value)).collect() }
        };
        let mut values: Vec<f64> = (0..20).map(|row| 0.01 * f64::from(row)).collect();
        let check = |values: &[f64], fastest| of(values).check_glitches(path, "yaw", 0.1, fastest, "rad");
        assert!(check(&values, 1.0).is_ok());
        // A lasting change is not a glitch.
        let stepped: Vec<f64> = values.iter().map(|value| if *value > 0.1 { value + 3.0 } else { *value }).collect();
        assert!(check(&stepped, 1.0).is_ok());
        values[7] += 3.0;
        let error = check(&values, 1.0).unwrap_err().to_string();
        assert!(error.starts_with("log.csv:9: column `yaw`: found 3.07 rad between 0.06 and 0.08 rad, expected single values within 1.000 rad"), "{error}");
        // A fast motion between samples of 1 s.
        assert!(check(&values, 4.0).is_ok());
        values[3] = 1e30;
        let error = of(&values).check_range(path, "yaw", 1e6, "rad").unwrap_err().to_string();
        assert!(
            error.starts_with(
                "log.csv:5: column `yaw`: found 1000000000000000000000000000000 rad, expected a magnitude of at most"
            ),
            "{error}"
        );
    }

    #[test]
    fn robust_times_out_of_order_and_repeated() {
        let mut clock = Clock::default();
        let path = Path::new("log.csv");
        assert!(clock.push(path, 2, 0.5).unwrap());
        assert!(!clock.push(path, 3, 0.5).unwrap());
        let error = clock.push(path, 4, 0.4).unwrap_err().to_string();
        assert_eq!(error, "log.csv:4: time: found 0.4 s after 0.5 s, expected times that do not decrease");
        let error = clock.push(path, 5, 1e11).unwrap_err().to_string();
        assert!(
            error.starts_with("log.csv:5: time: found 100000000000 s after the first row, expected at most"),
            "{error}"
        );
    }
}
