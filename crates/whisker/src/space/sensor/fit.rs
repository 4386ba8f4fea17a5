//! Fit of a sensor model in space, with cross-validation over whole lines and their neighbours.

use nalgebra::{Vector2, Vector3};
use serde_json::Value;

use super::correlation;
use super::error::Residual;
use super::neighbours::neighbours_of;
use super::{
    Across, Around, Axis, CalibratedSpace, SpatialDomain, SpatialErrorMap, SpatialModelRow, SpatialRegion,
    SpatialSample, SpatialWhisker,
};
use crate::sensor::{ModelError, least_error_n2_m2};
use crate::space::frames::Point;

/// Way of the contact over which readings are averaged.
const BLOCK_M: f64 = 0.25e-3;

/// Smallest number of lines that can be cross-validated.
const LEAST_LINES: usize = 4;

/// A fitted model and its error on held-out lines.
#[derive(Clone, Debug)]
pub struct SpatialFit {
    /// The calibrated model.
    pub calibrated: CalibratedSpace,
    /// Number of fitted samples.
    pub samples: usize,
    /// Number of lines of contacts.
    pub lines: usize,
}

/// Data of a fit.
#[derive(Clone, Copy, Debug)]
pub struct SpatialFitData<'a> {
    /// The whisker.
    pub whisker: &'a SpatialWhisker,
    /// Samples of each line of contacts, in order of time.
    pub lines: &'a [Vec<SpatialSample>],
    /// Standard deviation of the remaining noise of each reference reading (N m).
    pub reference_noise_sd_n_m: f64,
    /// Direction in which the coordinates displace contacts.
    pub across: Across,
    /// Whether the sensor is a real one ([`CalibratedSpace::real_sensor`]).
    pub real_sensor: bool,
}

/// Fits the model `row` with `config`.
///
/// Each line of contacts is compared with the model fitted without it and without its neighbours, the lines that are at most
/// 1.5 times as far away as the nearest one: a line between two others of the training data would show interpolation
/// only.
///
/// # Errors
/// [`ModelError`] if the settings are invalid or the data do not determine the model: for example, if no contacts lie out of the
/// plane of the whisker.
pub fn fit(row: &SpatialModelRow, config: &Value, data: &SpatialFitData<'_>) -> Result<SpatialFit, ModelError> {
    let axis = Axis::new(&data.whisker.whisker, data.across);
    let all: Vec<SpatialSample> = data.lines.concat();
    let around: Vec<Around> = all.iter().map(|sample| Around::of(&axis, sample.contact)).collect();
    let domain = SpatialDomain::covering(&around, data.across);
    let length_m = data.whisker.whisker.length_m;
    let away_m = around.iter().map(|at| at.away_m()).fold(0.0, f64::max);
    if away_m > length_m || domain.as_ref().is_some_and(|domain| !domain.is_valid(length_m)) {
        let low_m = around.iter().map(|at| at.along_m).fold(f64::INFINITY, f64::min);
        let high_m = around.iter().map(|at| at.along_m).fold(f64::NEG_INFINITY, f64::max);
        return Err(ModelError::Data(format!(
            "the calibration's contacts are not those of a whisker of {:.3} mm: found contacts up to {:.3} mm away from the \
            undeflected whisker, at {:.3} mm to {:.3} mm along it, expected both within its length; the coordinates of the \
            contacts, or the poses, may be in another unit than metres",
            1e3 * length_m,
            1e3 * away_m,
            1e3 * low_m,
            1e3 * high_m
        )));
    }
    let domain = domain.ok_or_else(|| {
        let most_mm = 1e3 * around.iter().map(|at| at.up_m.abs()).fold(0.0, f64::max);
        ModelError::Data(format!(
            "the calibration's contacts do not surround the whisker: found contacts up to {most_mm:.3} mm out of its plane, \
            expected lines of contacts in several directions, and at several distances from the root, as in the scenes \
            `calibration_space_*`"
        ))
    })?;
    let lines: Vec<Vec<SpatialSample>> = data.lines.iter().map(|line| blocks(line)).collect();
    if lines.len() < LEAST_LINES {
        let found = lines.len();
        return Err(ModelError::Data(format!(
            "the calibration has {found} lines of contacts, expected at least {LEAST_LINES}"
        )));
    }
    let region = SpatialRegion { whisker: data.whisker, domain: &domain };
    let learnt = (row.fit)(&region, &lines, config)?;
    let neighbours = neighbours(&lines);
    let residuals_of = |(line, samples): (usize, &Vec<SpatialSample>)| {
        let predicted = (learnt.without)(line, &neighbours[line])?;
        let residual = |(sample, predicted_n_m): (&SpatialSample, Vector2<f64>)| {
            let at = Around::of(&axis, sample.contact);
            Residual {
                contact: sample.contact,
                at,
                error_n_m: predicted_n_m - sample.reference_n_m,
                sd_n_m: learnt.model.sd_n_m(domain.clamp(at)),
                noise_n2_m2: data.reference_noise_sd_n_m.powi(2) / sample.count,
            }
        };
        Ok(samples.iter().zip(predicted).map(residual).collect())
    };
    let by_line: Vec<Vec<Residual>> = lines.iter().enumerate().map(residuals_of).collect::<Result<_, ModelError>>()?;
    let residuals: Vec<Residual> = by_line.concat();
    let largest_reading_n_m = all.iter().map(|sample| sample.reference_n_m.norm()).fold(0.0, f64::max);
    let count = residuals.len() as f64;
    let noise_n2_m2 = residuals.iter().map(|residual| residual.noise_n2_m2).sum::<f64>() / count;
    let least_n2_m2 = least_error_n2_m2(noise_n2_m2, count, largest_reading_n_m);
    let mean_square = residuals.iter().map(|residual| residual.error_n_m.norm_squared()).sum::<f64>() / (2.0 * count);
    let mut error = SpatialErrorMap::new(&domain, &residuals, least_n2_m2);
    if data.real_sensor {
        let correlations = learnt.correlations.unwrap_or_else(|| correlation::of_residuals(&by_line));
        error = error.with_correlation(correlation::length_m(&correlations));
    }
    let calibrated = CalibratedSpace {
        whisker: data.whisker.clone(),
        axis,
        domain,
        label: learnt.model.label(),
        model: learnt.model.into(),
        error,
        heldout_rms_n_m: (mean_square - noise_n2_m2).max(least_n2_m2).sqrt(),
        heldout_worst_n_m: residuals.iter().map(|residual| residual.error_n_m.amax()).fold(0.0, f64::max),
        largest_reading_n_m,
        real_sensor: data.real_sensor,
        mounting: None,
        geometry: Default::default(),
    };
    Ok(SpatialFit { calibrated, samples: all.len(), lines: lines.len() })
}

/// Means of consecutive samples over which the contact moved by less than [`BLOCK_M`].
fn blocks(line: &[SpatialSample]) -> Vec<SpatialSample> {
    let mut found: Vec<SpatialSample> = Vec::new();
    let mut start: Option<Point<_>> = None;
    for sample in line {
        let joins = start.is_some_and(|start: Point<_>| start.distance(&sample.contact) < BLOCK_M);
        match found.last_mut().filter(|_| joins) {
            Some(block) => {
                let share = sample.count / (block.count + sample.count);
                block.contact = Point::from_vector(block.contact.vector().lerp(&sample.contact.vector(), share));
                block.reading_n_m = block.reading_n_m.lerp(&sample.reading_n_m, share);
                block.reference_n_m = block.reference_n_m.lerp(&sample.reference_n_m, share);
                block.count += sample.count;
            }
            None => {
                found.push(*sample);
                start = Some(sample.contact);
            }
        }
    }
    found
}

/// Indices of each line and its neighbours.
pub(super) fn neighbours(lines: &[Vec<SpatialSample>]) -> Vec<Vec<usize>> {
    let center = |line: &Vec<SpatialSample>| {
        line.iter().map(|sample| sample.contact.vector()).sum::<Vector3<f64>>() / line.len() as f64
    };
    neighbours_of(&lines.iter().map(center).collect::<Vec<_>>())
}
