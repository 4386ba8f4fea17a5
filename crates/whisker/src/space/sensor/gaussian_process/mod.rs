//! Gaussian process from a contact to both bending moments, for readings of real sensors.
//!
//! A reading is the sum of a quadratic trend, a Gaussian process of the contact, an error common to each line of the calibration
//! and white noise. The error of a line represents friction, stick-slip and hysteresis, which are not functions of the contact;
//! without this term, they would distort the smooth map. Correlation lengths and standard deviations are those that predict
//! held-out lines best, and samples that contradict all others are left out. Nothing is assumed about the mechanics of the whisker.
//!
//! The expected reading is a sum over all samples, and the variance of its error one over all pairs of samples. Readings and
//! standard deviations are tabulated over the calibrated domain, so that a prediction takes the same time for any number of
//! samples. The standard deviation is small near the samples and grows with the distance from them.
//!
//! | module | contents |
//! | --- | --- |
//! | `kernel` | covariance of the readings: map, error of a line, noise |
//! | `trend` | the quadratic trend |
//! | `process` | fit to samples, predictions with their covariance, held-out lines |
//! | `mean` | expected readings |
//! | `selection` | selection of the covariance |

mod kernel;
mod mean;
mod process;
mod selection;
mod trend;

use std::fmt;

use nalgebra::{Matrix2x3, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::table::{Grid, Table};
use super::tabulated::Tabulated;
use super::{
    Around, Axis, Correlation, FittedSpatialModel, SpatialLoaded, SpatialModel, SpatialPrediction, SpatialRegion,
    SpatialSample,
};
use crate::frames::Base;
use crate::sensor::ModelError;
use crate::settings::typed;
use crate::space::frames::Point;
use mean::Mean;

pub use kernel::{Kernel, Place, Sample};
pub use process::{HeldOut, Predictor, Process, neighbours};
pub use selection::selected;

pub(super) const KIND: &str = "gaussian-process";

/// Smallest number of samples that a process is fitted to.
pub const LEAST_SAMPLES: usize = 100;

/// Largest number of samples that can be configured and stored: the fit keeps a few square matrices of this size.
const MOST_SAMPLES: usize = 10_000;

/// Number of contacts whose covariances are computed together.
const TOGETHER: usize = 32;

/// Steps of the stored logarithms of standard deviations, per unit.
const STEPS: f64 = 1000.0;

/// Largest absolute value of such a logarithm in a stored model.
const MOST_LOG_SD: f64 = 50.0;

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Largest number of samples of the fit, whose time grows with the third power of this number. Of more samples, an evenly
    /// spaced part is taken.
    most_samples: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self { most_samples: 2000 }
    }
}

/// The stored model.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    /// Largest absolute reading of a channel among the samples, by which the readings of `mean` are divided.
    largest_reading_n_m: f64,
    mean: Mean,
    /// Natural logarithms of the predicted standard deviations of both moments, relative to the largest reading, at the nodes of
    /// the table ([`Grid::nodes`]).
    log_sds: Vec<[f64; 2]>,
}

impl Stored {
    fn new(region: &SpatialRegion<'_>, process: &Process) -> Self {
        let (axis, predictor) = (region.domain.axis(&region.whisker.whisker), process.predictor());
        let largest_reading_n_m = process.largest_reading;
        let place = |at: Around| {
            let contact_m = at.contact(&axis).vector();
            Place::of(contact_m, &predictor.predict(&contact_m).0, largest_reading_n_m)
        };
        let places: Vec<Place> = Grid::new(region.domain).nodes().map(place).collect();
        let log_sd = |sd_n_m: f64| ((sd_n_m / largest_reading_n_m).ln() * STEPS).round() / STEPS;
        let log_sds = sds_n_m(&predictor, &places).into_iter().map(|sd_n_m| sd_n_m.map(log_sd).into()).collect();
        Self { kind: KIND.into(), largest_reading_n_m, mean: process.mean(), log_sds }
    }

    /// Expected bending moments at a contact (N m), 2x1.
    fn reading_n_m(&self, contact: Point<Base>) -> Vector2<f64> {
        self.mean.at(&contact.vector()).0 * self.largest_reading_n_m
    }
}

/// A fitted process, with its expected readings and their standard deviations tabulated.
struct GaussianProcess {
    stored: Stored,
    tabulated: Tabulated,
    log_sds: Table<2>,
    /// Smallest and largest of them.
    range: [Vector2<f64>; 2],
}

impl GaussianProcess {
    /// `None` if a reading is not finite, or if there is not one pair of standard deviations for each node of the table.
    fn new(region: &SpatialRegion<'_>, stored: Stored) -> Option<Self> {
        let reading = |contact, _: Option<()>| {
            let reading_n_m = stored.reading_n_m(contact);
            reading_n_m.iter().all(|moment_n_m| moment_n_m.is_finite()).then_some((reading_n_m, ()))
        };
        let tabulated = Tabulated::new(region, reading)?;
        let nodes = stored.log_sds.iter().copied().map(Vector2::from);
        let range = [nodes.clone().reduce(|a, b| a.inf(&b))?, nodes.reduce(|a, b| a.sup(&b))?];
        let log_sds = Table::of_nodes(Grid::new(region.domain), stored.log_sds.clone())?;
        Some(Self { stored, tabulated, log_sds, range })
    }
}

impl fmt::Debug for GaussianProcess {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("GaussianProcess").field("kernels", &self.stored.mean.kernels).finish_non_exhaustive()
    }
}

impl SpatialModel for GaussianProcess {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        self.tabulated.predict(contact)
    }

    fn predict_around(&self, _: &Axis, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        self.tabulated.predict_around(at)
    }

    fn sd_n_m(&self, at: Around) -> Vector2<f64> {
        // Between the nodes, the cubic polynomials may exceed their range.
        let [least, most] = &self.range;
        self.log_sds.look(at).values.sup(least).inf(most).map(f64::exp) * self.stored.largest_reading_n_m
    }

    fn to_json(&self) -> Value {
        serde_json::to_value(&self.stored).expect("numbers and names serialise")
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

/// Simulated traces have none of the line errors that the process models.
pub(super) fn candidates(real_sensor: bool) -> Vec<Value> {
    if real_sensor { vec![json!({})] } else { Vec::new() }
}

/// Evenly spaced samples of all lines, at most this many.
fn thinned(lines: &[Vec<SpatialSample>], most: usize) -> Vec<Sample> {
    indexed(lines, most).map(|(_, sample)| sample).collect()
}

/// Evenly spaced samples of all lines, at most this many, each with its index among all samples.
fn indexed(lines: &[Vec<SpatialSample>], most: usize) -> impl Iterator<Item = (usize, Sample)> {
    let all = lines.iter().enumerate().flat_map(|(line, samples)| {
        samples.iter().map(move |sample| Sample {
            contact_m: sample.contact.vector(),
            reading: sample.reading_n_m,
            line,
        })
    });
    let count = lines.iter().map(Vec::len).sum::<usize>();
    let most = most.min(count);
    // Number of samples kept among the first `i`: their share of the largest number.
    let kept = move |i: usize| i * most / count;
    all.enumerate().filter(move |(i, _)| kept(i + 1) > kept(*i))
}

/// Indices of the samples, among those of all lines, that the others contradict. Of many samples, only an evenly spaced part is
/// examined. Empty if there are too few samples for a process, or if its covariance is singular.
pub(super) fn contradicted(lines: &[Vec<SpatialSample>]) -> Vec<usize> {
    let (indices, samples): (Vec<usize>, Vec<Sample>) = indexed(lines, Config::default().most_samples).unzip();
    if samples.len() < LEAST_SAMPLES {
        return Vec::new();
    }
    let found = Process::robust(&samples, [Kernel::START; 2]).map(|(_, outliers)| outliers);
    found.unwrap_or_default().into_iter().map(|i| indices[i]).collect()
}

/// Predicted standard deviations of both moments at contacts (N m), 2x1 each: of the map, the error of a line, and the noise.
fn sds_n_m(predictor: &Predictor<'_>, places: &[Place]) -> Vec<Vector2<f64>> {
    let Process { kernels, largest_reading, .. } = predictor.process;
    let of_part = |part: &[Place]| {
        let covariances = [0, 1].map(|channel| predictor.covariance(channel, part));
        let sd_n_m = |i: usize| {
            // Rounding may make the variance of the map negative.
            let least = |channel: usize| {
                let (kernel, load) = (&kernels[channel], part[i].load);
                (kernel.line_sd(load).powi(2) + kernel.noise_variance(load)) * largest_reading.powi(2)
            };
            Vector2::from_fn(|channel, _| covariances[channel][(i, i)].max(least(channel)).sqrt())
        };
        (0..part.len()).map(sd_n_m).collect::<Vec<_>>()
    };
    places.chunks(TOGETHER).flat_map(of_part).collect()
}

/// Predicted correlations of the errors of a new touch at pairs of contacts of each line. The noise, which differs from contact to
/// contact, reduces them.
fn correlations(process: &Process, lines: &[Vec<SpatialSample>]) -> Vec<Correlation> {
    let predictor = process.predictor();
    let place =
        |sample: &SpatialSample| Place::of(sample.contact.vector(), &sample.reading_n_m, process.largest_reading);
    let of_line = |line: &Vec<SpatialSample>| {
        let places: Vec<Place> = line.iter().map(place).collect();
        let covariance = predictor.covariance(0, &places) + predictor.covariance(1, &places);
        let pair = |(i, j): (usize, usize)| Correlation {
            distance_m: (places[i].contact_m - places[j].contact_m).norm(),
            value: 2.0 * covariance[(i, j)] / (covariance[(i, i)] + covariance[(j, j)]),
        };
        (0..places.len()).flat_map(|i| (0..i).map(move |j| (i, j))).map(pair).collect::<Vec<_>>()
    };
    lines.iter().flat_map(of_line).collect()
}

fn singular() -> ModelError {
    ModelError::Data("the calibration's places do not determine a Gaussian process: its covariance is singular".into())
}

pub(super) fn fit(
    region: &SpatialRegion<'_>,
    lines: &[Vec<SpatialSample>],
    config: &Value,
) -> Result<FittedSpatialModel, ModelError> {
    let Config { most_samples } =
        typed::<Config>(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    if !(LEAST_SAMPLES..=MOST_SAMPLES).contains(&most_samples) {
        return Err(ModelError::Data(format!(
            "`most_samples`: found {most_samples}, expected {LEAST_SAMPLES} to {MOST_SAMPLES}"
        )));
    }
    let samples = thinned(lines, most_samples);
    if samples.len() < LEAST_SAMPLES {
        let found = samples.len();
        return Err(ModelError::Data(format!(
            "the calibration has only {found} places, expected at least {LEAST_SAMPLES}"
        )));
    }
    if samples.iter().all(|sample| sample.reading == Vector2::zeros()) {
        return Err(ModelError::Data(
            "the calibration: found no reading other than 0, expected bending moments".into(),
        ));
    }
    let kernels = selected(&samples).ok_or_else(singular)?;
    let (process, _) = Process::robust(&samples, kernels).ok_or_else(singular)?;
    let model = GaussianProcess::new(region, Stored::new(region, &process)).ok_or_else(singular)?;
    let (correlations, lines) = (Some(correlations(&process, lines)), lines.to_vec());
    let without = move |line: usize, heldout: &[usize]| {
        let predictor = process.without(heldout).ok_or_else(singular)?;
        Ok(lines[line].iter().map(|sample| predictor.predict(&sample.contact.vector()).0).collect())
    };
    Ok(FittedSpatialModel { model: Box::new(model), without: Box::new(without), correlations })
}

pub(super) fn load(region: &SpatialRegion<'_>, value: &Value) -> SpatialLoaded {
    let stored: Stored = typed(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    stored.mean.check().map_err(|reason| ModelError::Data(format!("`mean`: {reason}")))?;
    let (found, expected) = (stored.log_sds.len(), Grid::COUNT);
    if found != expected {
        return Err(ModelError::Data(format!("`log_sds`: found {found} pairs of numbers, expected {expected}")));
    }
    if let Some(found) = stored.log_sds.iter().flatten().find(|log_sd| log_sd.abs() > MOST_LOG_SD) {
        return Err(ModelError::Data(format!("`log_sds`: found {found}, expected -{MOST_LOG_SD} to {MOST_LOG_SD}")));
    }
    let largest_n_m = stored.largest_reading_n_m;
    if !(largest_n_m.is_finite() && largest_n_m > 0.0) {
        return Err(ModelError::Data(format!(
            "`largest_reading_n_m`: found {largest_n_m}, expected a positive number"
        )));
    }
    let model = GaussianProcess::new(region, stored).ok_or_else(|| {
        ModelError::Data("`mean`: found numbers whose readings are not finite, expected those of a fitted model".into())
    })?;
    Ok(Box::new(model))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::Whisker;
    use crate::space::sensor::testing::evenly_suspended;
    use crate::space::sensor::{Across, SpatialDomain, SpatialWhisker};

    fn whisker() -> SpatialWhisker {
        evenly_suspended(Whisker::curved())
    }

    /// Lines of contacts in all directions, with the readings of a smooth map.
    fn lines() -> Vec<Vec<SpatialSample>> {
        let axis = Axis::new(&whisker().whisker, Across::Normal);
        let line = |i: i32| {
            let (along_m, azimuth) = (0.032 + 0.006 * f64::from(i / 8), TAU * f64::from(i % 8) / 8.0);
            let sample = |step: i32| {
                let away_m = 0.4 * along_m.powi(2) * f64::from(step);
                let at = Around::new(along_m, away_m * azimuth.cos(), away_m * azimuth.sin());
                let (u, v) = (at.left_m / along_m, at.up_m / along_m);
                let reading_n_m = Vector2::new(-v * (1.0 + u), (2.0 * u).sin()) * 0.03;
                SpatialSample { contact: at.contact(&axis), reading_n_m, reference_n_m: reading_n_m, count: 1.0 }
            };
            (0..6).map(sample).collect()
        };
        (0..40).map(line).collect()
    }

    fn domain() -> SpatialDomain {
        let axis = Axis::new(&whisker().whisker, Across::Normal);
        let around: Vec<Around> = lines().iter().flatten().map(|sample| Around::of(&axis, sample.contact)).collect();
        SpatialDomain::covering(&around, Across::Normal).unwrap()
    }

    fn process() -> Process {
        Process::new(&thinned(&lines(), 200), [Kernel::START; 2]).unwrap()
    }

    fn stored() -> Stored {
        let (whisker, domain) = (whisker(), domain());
        Stored::new(&SpatialRegion { whisker: &whisker, domain: &domain }, &process())
    }

    #[test]
    fn verif_the_table_holds_the_readings_and_derivatives_of_the_process() {
        let (whisker, domain, process) = (whisker(), domain(), process());
        let model = GaussianProcess::new(&SpatialRegion { whisker: &whisker, domain: &domain }, stored()).unwrap();
        let axis = Axis::new(&whisker.whisker, Across::Normal);
        for at in
            [Around::new(0.0341, 1.5e-3, -1e-3), Around::new(0.047, -2.2e-3, 3e-3), Around::new(0.0549, 0.0, -5e-3)]
        {
            let contact = at.contact(&axis);
            let (reading_n_m, gradient_n) = process.predictor().predict(&contact.vector());
            assert_eq!(model.stored.reading_n_m(contact), reading_n_m, "{at:?}");
            let found = model.predict(contact);
            let error = (found.reading_n_m - reading_n_m).norm() / process.largest_reading;
            assert!(error < 1e-4, "{at:?}: {error}");
            let error = (found.gradient_n - gradient_n).norm() / gradient_n.norm();
            assert!(error < 5e-3, "{at:?}: {error}");
            let place = Place::of(contact.vector(), &reading_n_m, process.largest_reading);
            let sd_n_m = sds_n_m(&process.predictor(), &[place])[0];
            let ratio = model.sd_n_m(at).component_div(&sd_n_m);
            assert!(ratio.iter().all(|ratio| (0.9..1.1).contains(ratio)), "{at:?}: {ratio}");
        }
    }

    #[test]
    fn verif_the_standard_deviation_grows_where_the_calibration_has_no_contacts() {
        let (whisker, domain, lines) = (whisker(), domain(), lines());
        let region = SpatialRegion { whisker: &whisker, domain: &domain };
        let sd_n_m = |lines: &[Vec<SpatialSample>], at: Around| {
            let process = Process::new(&thinned(lines, 1000), [Kernel::START; 2]).unwrap();
            let model = GaussianProcess::new(&region, Stored::new(&region, &process)).unwrap();
            model.sd_n_m(at) / process.largest_reading
        };
        // Without the lines to the left, of which there are eight in each node along the whisker.
        let others: Vec<Vec<SpatialSample>> = lines
            .iter()
            .enumerate()
            .filter(|(i, _)| !matches!(i % 8, 0 | 1 | 7))
            .map(|(_, line)| line.clone())
            .collect();
        let (left, right) = (Around::new(0.047, 4e-3, 0.0), Around::new(0.047, -4e-3, 0.0));
        let ratio = |at: Around| sd_n_m(&others, at).component_div(&sd_n_m(&lines, at));
        assert!(ratio(left).min() > 2.0, "{}", ratio(left));
        assert!((0.8..1.3).contains(&ratio(right).min()), "{}", ratio(right));
    }

    #[test]
    fn verif_the_correlations_are_those_of_a_line_where_the_map_is_known() {
        let certain = Kernel { map_sd: 1e-9, line: [2e-3, 0.0], noise: [1e-9, 0.0], ..Kernel::START };
        let process = Process::new(&thinned(&lines(), 1000), [certain; 2]).unwrap();
        let found = correlations(&process, &lines()[..3]);
        assert_eq!(found.len(), 3 * 15);
        for Correlation { distance_m, value } in found {
            assert!((value - certain.along(distance_m)).abs() < 1e-6, "{distance_m}: {value}");
        }
    }

    #[test]
    fn verif_of_many_samples_an_evenly_spaced_part_is_taken() {
        let lines = lines();
        let all = thinned(&lines, 1000);
        assert_eq!(all.len(), 240);
        let part = thinned(&lines, 101);
        assert_eq!(part.len(), 101);
        let indices: Vec<usize> =
            part.iter().map(|sample| all.iter().position(|other| other == sample).unwrap()).collect();
        assert!(indices.windows(2).all(|pair| (2..=3).contains(&(pair[1] - pair[0]))), "{indices:?}");
    }

    #[test]
    fn robust_too_few_samples_are_refused() {
        let (whisker, domain) = (whisker(), domain());
        let region = SpatialRegion { whisker: &whisker, domain: &domain };
        let refused = |lines: &[Vec<SpatialSample>], config: Value| match fit(&region, lines, &config) {
            Err(ModelError::Data(reason)) => reason,
            other => panic!("{:?}", other.err()),
        };
        let reason = refused(&lines()[..8], json!({}));
        assert_eq!(reason, "the calibration has only 48 places, expected at least 100");
        let reason = refused(&lines(), json!({ "most_samples": 99 }));
        assert_eq!(reason, "`most_samples`: found 99, expected 100 to 10000");
        let without_readings: Vec<Vec<SpatialSample>> = lines()
            .into_iter()
            .map(|line| {
                line.into_iter().map(|sample| SpatialSample { reading_n_m: Vector2::zeros(), ..sample }).collect()
            })
            .collect();
        assert!(refused(&without_readings, json!({})).contains("found no reading other than 0"));
    }

    #[test]
    fn robust_damaged_stored_models_are_refused() {
        let (whisker, domain) = (whisker(), domain());
        let region = SpatialRegion { whisker: &whisker, domain: &domain };
        let whole = serde_json::to_value(stored()).unwrap();
        assert!(load(&region, &whole).is_ok());
        let mut shortened = stored();
        shortened.mean.weights[1].pop();
        let mut without_last = stored();
        without_last.log_sds.pop();
        let damaged = |pointer: &str, value: f64| {
            let mut damaged = whole.clone();
            *damaged.pointer_mut(pointer).unwrap() = json!(value);
            damaged
        };
        let cases = [
            (
                serde_json::to_value(shortened).unwrap(),
                "`mean`: `weights`: found 199 numbers, expected 200 finite ones",
            ),
            (damaged("/largest_reading_n_m", 0.0), "`largest_reading_n_m`: found 0, expected a positive number"),
            (
                damaged("/mean/kernels/0/line_length_m", 0.0),
                "line_length_m: 0.0, noise: [0.0012, 0.002] }, expected finite",
            ),
            (damaged("/mean/trend/scale_m/2", -1.0), "-1.0], expected finite ones, the scales positive"),
            (damaged("/mean/kernels/0/map_sd", 1e200), "`mean`: found numbers whose readings are not finite"),
            (serde_json::to_value(without_last).unwrap(), "`log_sds`: found 3210 pairs of numbers, expected 3211"),
            (damaged("/log_sds/17/1", 400.0), "`log_sds`: found 400, expected -50 to 50"),
        ];
        for (value, expected) in cases {
            let reason = load(&region, &value).err().unwrap().to_string();
            assert!(reason.contains(expected), "{reason}");
        }
    }
}
