//! The Kirchhoff rod as sensor model, with physical parameters fitted to the calibration.
//!
//! ```text
//! reading(p) = offset + gain [R M(R' (p - x); E, k, kappa)]    over the moments about y and z of Base
//! ```
//!
//! `M` is the moment of [`crate::rod`] at a contact, for Young's modulus `E`, stiffnesses `k` of the root in yaw and pitch and
//! pre-curvature `kappa = scale kappa0(s)`. The position `x` and the rotation `R` of the root in Base, given by a rotation
//! vector, allow for an imprecise mounting. The stiffnesses of wire and root in twist follow the nominal whisker.
//!
//! The prior of the parameters is that of the whisker that the calibration names, with the standard deviations of [`Config`].
//! The unknowns `c` are the deviations from it in these standard deviations, and the fit minimises
//!
//! ```text
//! |sqrt(n) (reading(p_i; c) - z_i)|^2 / v + |c|^2
//! ```
//!
//! over the contacts `p_i` with the mean `z_i` of `n` readings of variance `v`, by the Levenberg-Marquardt method; `v` is
//! estimated from the residuals of a first fit. A direction that the data do not determine keeps its prior mean, for example
//! the product of gain and stiffness. The fit without some lines is linearised about the fit to all.

use std::sync::Arc;

use filters::least_squares::{Evaluated, Residuals, minimise};
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Rotation3, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::tabulated::Tabulated;
use super::{
    Around, Axis, FittedSpatialModel, SpatialLoaded, SpatialModel, SpatialPrediction, SpatialRegion, SpatialSample,
    SpatialWhisker,
};
use crate::Whisker;
use crate::frames::Base;
use crate::rod::{Rod, SpatialLoad, Suspension};
use crate::sensor::ModelError;
use crate::sensor::physical::{INFORMED_SHARE, SETTINGS, check_sds, check_settled, moved, no_solution, read};
use crate::settings::typed;
use crate::space::frames::Point;

pub(super) const KIND: &str = "rod";

/// Number of parameters.
const COUNT: usize = 14;

/// Names of the parameters with their units, in order.
const NAMES: [&str; COUNT] = [
    "gain_y",
    "gain_z",
    "youngs_modulus_pa",
    "yaw_stiffness_n_m_rad",
    "pitch_stiffness_n_m_rad",
    "curvature_scale",
    "reading_offset_y_n_m",
    "reading_offset_z_n_m",
    "root_x_m",
    "root_y_m",
    "root_z_m",
    "root_roll_rad",
    "root_pitch_rad",
    "root_yaw_rad",
];

/// Number of leading parameters that are positive and fitted by their logarithms.
const POSITIVE: usize = 5;

/// Parameters whose derivatives are computed by differences: those of the mechanics.
const MECHANICAL: std::ops::Range<usize> = 2..6;

/// Step of these differences, in units of the parameter's logarithm or scale.
const STEP: f64 = 1e-4;

/// Angle below which the coefficients of the left Jacobian are those of its series, whose next terms are below 1e-9.
const SMALL_TURN_RAD: f64 = 1e-4;

/// Noise of the first fit, and lower bound of the estimated noise, relative to the largest reading.
const FIRST_NOISE: f64 = 1e-2;
const SMALLEST_NOISE: f64 = 1e-5;

type Vector = SVector<f64, COUNT>;

/// Prior standard deviations of the parameters; 0 holds a parameter fixed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Prior standard deviation of the logarithm of each gain.
    gain_sd: f64,
    /// Prior standard deviation of the logarithm of Young's modulus.
    youngs_modulus_sd: f64,
    /// Prior standard deviation of the logarithm of the root's stiffness in yaw and in pitch.
    root_stiffness_sd: f64,
    /// Prior standard deviation of the scale of the pre-curvature.
    curvature_scale_sd: f64,
    /// Prior standard deviation of each reading's offset, relative to the largest reading.
    reading_offset_sd: f64,
    /// Prior standard deviation of the root's position along each axis.
    root_sd_m: f64,
    /// Prior standard deviation of the root's rotation about each axis.
    root_turn_sd_rad: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            gain_sd: 0.5,
            youngs_modulus_sd: 0.2,
            root_stiffness_sd: 0.2,
            curvature_scale_sd: 0.1,
            reading_offset_sd: 0.01,
            root_sd_m: 1e-3,
            root_turn_sd_rad: 0.05,
        }
    }
}

impl Config {
    fn standard_deviations(&self, largest_n_m: f64) -> Result<Vector, ModelError> {
        let values = [
            ("gain_sd", self.gain_sd, 2),
            ("youngs_modulus_sd", self.youngs_modulus_sd, 1),
            ("root_stiffness_sd", self.root_stiffness_sd, 2),
            ("curvature_scale_sd", self.curvature_scale_sd, 1),
            ("reading_offset_sd", self.reading_offset_sd * largest_n_m, 2),
            ("root_sd_m", self.root_sd_m, 3),
            ("root_turn_sd_rad", self.root_turn_sd_rad, 3),
        ];
        check_sds(values.iter().map(|&(key, sd, _)| (key, sd)))?;
        let each = values.iter().flat_map(|&(_, sd, count)| std::iter::repeat_n(sd, count));
        Ok(Vector::from_iterator(each))
    }
}

/// One fitted parameter, as stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredParameter {
    name: String,
    value: f64,
    /// Posterior standard deviation; of a positive parameter, that of the logarithm times the value.
    sd: f64,
    /// Prior standard deviation, likewise.
    prior_sd: f64,
    /// Whether the calibration determines it; otherwise it stays near its prior, alone or in combination with others.
    informed_by_data: bool,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    parameters: Vec<StoredParameter>,
}

/// Values of the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Parameters(Vector);

impl Parameters {
    fn nominal(whisker: &SpatialWhisker) -> Self {
        let SpatialWhisker { whisker, suspension, .. } = whisker;
        let mut values = Vector::zeros();
        values.fixed_rows_mut::<6>(0).copy_from_slice(&[
            1.0,
            1.0,
            whisker.youngs_modulus_pa,
            suspension.yaw_n_m_rad,
            suspension.pitch_n_m_rad,
            1.0,
        ]);
        Self(values)
    }

    /// The parameters changed by a step, which is one of the logarithm for a positive parameter.
    fn moved(&self, step: Vector) -> Self {
        Self(moved(&self.0, POSITIVE, &step))
    }

    /// Rotation vector of the root in Base.
    fn rotation_vector(&self) -> Vector3<f64> {
        self.0.fixed_rows::<3>(11).into_owned()
    }

    /// Mechanics with these parameters. `None` if there is no such whisker.
    fn rod(&self, nominal: &SpatialWhisker) -> Option<Rod> {
        let SpatialWhisker { whisker, suspension, poisson_ratio } = nominal;
        let mut curvature = whisker.curvature.clone();
        curvature.iter_mut().for_each(|piece| piece.curvature_per_m *= self.0[5]);
        let whisker = Whisker { youngs_modulus_pa: self.0[2], curvature, ..whisker.clone() };
        let suspension = Suspension { yaw_n_m_rad: self.0[3], pitch_n_m_rad: self.0[4], ..*suspension };
        Rod::new(&whisker, suspension, *poisson_ratio).ok()
    }
}

/// The sensor model of one set of parameters.
struct Tuned {
    parameters: Parameters,
    rod: Rod,
    /// Rotation of the root in Base.
    rotation: Matrix3<f64>,
}

/// Reading of a contact with what its derivatives consist of, in Base.
struct Response {
    reading_n_m: Vector2<f64>,
    /// Moment at the root and its derivatives by the contact, before the gain.
    moment_n_m: Vector3<f64>,
    gradient_n: Matrix3<f64>,
    load: SpatialLoad,
}

impl Tuned {
    fn new(nominal: &SpatialWhisker, parameters: Parameters) -> Option<Self> {
        let rotation = Rotation3::new(parameters.rotation_vector()).into_inner();
        Some(Self { rod: parameters.rod(nominal)?, parameters, rotation })
    }

    fn origin_m(&self) -> Vector3<f64> {
        self.parameters.0.fixed_rows::<3>(8).into_owned()
    }

    /// The gains, as the matrix from the moment in Base to the readings without their offsets.
    fn gains(&self) -> Matrix2x3<f64> {
        Matrix2x3::new(0.0, self.parameters.0[0], 0.0, 0.0, 0.0, self.parameters.0[1])
    }

    fn offsets_n_m(&self) -> Vector2<f64> {
        Vector2::new(self.parameters.0[6], self.parameters.0[7])
    }

    /// Response at a contact, sought from the load of a near one.
    fn respond(&self, contact: Point<Base>, near: Option<SpatialLoad>) -> Option<Response> {
        let seen = self.rotation.tr_mul(&(contact.vector() - self.origin_m()));
        let found = self.rod.near(seen, near)?;
        let moment_n_m = self.rotation * found.deflection.moment_n_m;
        let gradient_n = self.rotation * found.moment_gradient_n * self.rotation.transpose();
        let reading_n_m = self.offsets_n_m() + self.gains() * moment_n_m;
        Some(Response { reading_n_m, moment_n_m, gradient_n, load: found.load })
    }

    /// Derivatives of the readings by the parameters that are not mechanical; the others are left zero.
    fn derivatives(&self, contact: Point<Base>, response: &Response) -> Matrix2xCount {
        let mut found = Matrix2xCount::zeros();
        let gains = self.gains();
        let without_offset = response.reading_n_m - self.offsets_n_m();
        found[(0, 0)] = without_offset[0];
        found[(1, 1)] = without_offset[1];
        found[(0, 6)] = 1.0;
        found[(1, 7)] = 1.0;
        found.fixed_columns_mut::<3>(8).copy_from(&(-gains * response.gradient_n));
        let arm = contact.vector() - self.origin_m();
        let turned = response.gradient_n * arm.cross_matrix() - response.moment_n_m.cross_matrix();
        found
            .fixed_columns_mut::<3>(11)
            .copy_from(&(gains * turned * left_jacobian(&self.parameters.rotation_vector())));
        found
    }
}

/// Left Jacobian of SO(3): the rotation in Base that a change of the rotation vector adds to the rotation, 3x3 (Sola, Deray and
/// Atchuthan, "A micro Lie theory for state estimation in robotics", 2018, equation 145).
fn left_jacobian(vector: &Vector3<f64>) -> Matrix3<f64> {
    let (angle, cross) = (vector.norm(), vector.cross_matrix());
    let (first, second) = if angle < SMALL_TURN_RAD {
        (0.5, 1.0 / 6.0)
    } else {
        ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

type Matrix2xCount = nalgebra::SMatrix<f64, 2, COUNT>;

/// The least-squares problem.
struct Calibration<'a> {
    whisker: &'a SpatialWhisker,
    nominal: Parameters,
    sd: Vector,
    samples: &'a [SpatialSample],
    /// Loads of the nominal whisker at the samples.
    loads: Vec<SpatialLoad>,
    noise_sd_n_m: f64,
}

impl Calibration<'_> {
    fn step(&self, x: &DVector<f64>) -> Vector {
        Vector::from_fn(|i, _| x[i] * self.sd[i])
    }

    fn parameters(&self, x: &DVector<f64>) -> Parameters {
        self.nominal.moved(self.step(x))
    }

    fn responses(&self, parameters: Parameters) -> Option<(Tuned, Vec<Response>)> {
        let tuned = Tuned::new(self.whisker, parameters)?;
        let found = self.samples.iter().zip(&self.loads);
        let found = found.map(|(sample, load)| tuned.respond(sample.contact, Some(*load)));
        let found = found.collect::<Option<Vec<_>>>()?;
        Some((tuned, found))
    }

    /// Weight of a residual.
    fn weight(&self, sample: &SpatialSample) -> f64 {
        sample.count.sqrt() / self.noise_sd_n_m
    }
}

impl Residuals for Calibration<'_> {
    fn residuals(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        let (_, responses) = self.responses(self.parameters(x))?;
        let mut residuals = DVector::zeros(2 * self.samples.len() + COUNT);
        for (i, (sample, response)) in self.samples.iter().zip(&responses).enumerate() {
            let misfit = (response.reading_n_m - sample.reading_n_m) * self.weight(sample);
            residuals.fixed_rows_mut::<2>(2 * i).copy_from(&misfit);
        }
        residuals.rows_mut(2 * self.samples.len(), COUNT).copy_from(x);
        Some(residuals)
    }

    fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>> {
        let parameters = self.parameters(&at.x);
        let (tuned, responses) = self.responses(parameters)?;
        let mut changed = Vec::new();
        for i in MECHANICAL.filter(|&i| self.sd[i] > 0.0) {
            let step = Vector::ith(i, STEP);
            let (_, after) = self.responses(parameters.moved(step))?;
            let (_, before) = self.responses(parameters.moved(-step))?;
            changed.push((i, after, before));
        }
        let mut jacobian = DMatrix::zeros(at.residuals.len(), COUNT);
        for (row, (sample, response)) in self.samples.iter().zip(&responses).enumerate() {
            let mut slopes = tuned.derivatives(sample.contact, response);
            for (i, after, before) in &changed {
                slopes.set_column(*i, &((after[row].reading_n_m - before[row].reading_n_m) / (2.0 * STEP)));
            }
            for i in 0..COUNT {
                let column = slopes.column(i) * (self.sd[i] * self.weight(sample));
                jacobian.fixed_view_mut::<2, 1>(2 * row, i).copy_from(&column);
            }
        }
        jacobian.view_mut((2 * self.samples.len(), 0), (COUNT, COUNT)).fill_with_identity();
        Some(jacobian)
    }
}

/// The rod with fitted parameters, its readings tabulated.
struct RodModel {
    tabulated: Tabulated,
    stated: Vec<StoredParameter>,
}

impl RodModel {
    fn new(region: &SpatialRegion<'_>, parameters: Parameters, stated: Vec<StoredParameter>) -> Option<Self> {
        let tuned = Tuned::new(region.whisker, parameters)?;
        let reading = |contact, near| {
            let found = tuned.respond(contact, near)?;
            Some((found.reading_n_m, found.load))
        };
        Some(Self { tabulated: Tabulated::new(region, reading)?, stated })
    }
}

impl std::fmt::Debug for RodModel {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("RodModel").field("parameters", &self.stated).finish_non_exhaustive()
    }
}

impl SpatialModel for RodModel {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        self.tabulated.predict(contact)
    }

    fn predict_around(&self, _: &Axis, at: Around) -> (Vector2<f64>, Matrix2x3<f64>) {
        self.tabulated.predict_around(at)
    }

    fn to_json(&self) -> Value {
        let stored = Stored { kind: KIND.into(), parameters: self.stated.clone() };
        serde_json::to_value(stored).expect("numbers and names serialise")
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

/// The fit of a rod to recordings takes minutes, and friction and hysteresis are not among its parameters.
pub(super) fn candidates(real_sensor: bool) -> Vec<Value> {
    if real_sensor { Vec::new() } else { vec![json!({})] }
}

pub(super) fn fit(
    region: &SpatialRegion<'_>,
    lines: &[Vec<SpatialSample>],
    config: &Value,
) -> Result<FittedSpatialModel, ModelError> {
    let config: Config = typed(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    let samples = lines.concat();
    if 2 * samples.len() <= COUNT {
        let found = samples.len();
        return Err(ModelError::Data(format!("the calibration has only {found} places, expected more than {COUNT}")));
    }
    let largest_n_m = samples.iter().map(|sample| sample.reading_n_m.amax()).fold(0.0, f64::max);
    let nominal = Parameters::nominal(region.whisker);
    let tuned = Tuned::new(region.whisker, nominal).ok_or_else(no_solution)?;
    let load = |sample: &SpatialSample| Some(tuned.respond(sample.contact, None)?.load);
    let mut calibration = Calibration {
        whisker: region.whisker,
        nominal,
        sd: config.standard_deviations(largest_n_m)?,
        samples: &samples,
        loads: samples.iter().map(load).collect::<Option<Vec<_>>>().ok_or_else(no_solution)?,
        noise_sd_n_m: FIRST_NOISE * largest_n_m,
    };
    let first = solved(&calibration, DVector::zeros(COUNT))?;
    let rows = 2 * samples.len();
    let rms = (first.residuals.rows(0, rows).norm_squared() / rows as f64).sqrt();
    calibration.noise_sd_n_m *= rms.max(SMALLEST_NOISE / FIRST_NOISE);
    let found = solved(&calibration, first.x)?;
    let jacobian = calibration.jacobian(&found).ok_or_else(no_solution)?;
    let covariance = (jacobian.tr_mul(&jacobian)).cholesky().ok_or_else(no_solution)?.inverse();
    let parameters = calibration.parameters(&found.x);
    let model =
        RodModel::new(region, parameters, stated(&calibration, parameters, &covariance)).ok_or_else(no_solution)?;
    let weights: Vec<f64> = samples.iter().map(|sample| calibration.weight(sample)).collect();
    let linearised = Arc::new(Linearised { jacobian, residuals: found.residuals, weights });
    let lines = lines.to_vec();
    let without =
        move |line: usize, heldout: &[usize]| linearised.without(&lines, line, heldout).ok_or_else(no_solution);
    Ok(FittedSpatialModel { model: Box::new(model), without: Box::new(without), correlations: None })
}

fn solved(calibration: &Calibration<'_>, start: DVector<f64>) -> Result<Evaluated, ModelError> {
    let start = Evaluated::new(calibration, start).ok_or_else(no_solution)?;
    let solution = minimise(calibration, start, &SETTINGS).ok_or_else(no_solution)?;
    check_settled(solution.outcome)?;
    Ok(solution.state)
}

fn stated(calibration: &Calibration<'_>, parameters: Parameters, covariance: &DMatrix<f64>) -> Vec<StoredParameter> {
    let parameter = |i: usize| {
        let value = parameters.0[i];
        let unit = calibration.sd[i] * if i < POSITIVE { value } else { 1.0 };
        let share = covariance[(i, i)].sqrt();
        StoredParameter {
            name: NAMES[i].into(),
            value,
            sd: share * unit,
            prior_sd: unit,
            informed_by_data: calibration.sd[i] > 0.0 && share <= INFORMED_SHARE,
        }
    };
    (0..COUNT).map(parameter).collect()
}

/// The fit linearised about its solution.
struct Linearised {
    jacobian: DMatrix<f64>,
    residuals: DVector<f64>,
    /// Weight of the residuals of each sample.
    weights: Vec<f64>,
}

impl Linearised {
    /// Predictions at the samples of a line by the fit without some lines: a Gauss-Newton step without their residuals.
    fn without(&self, lines: &[Vec<SpatialSample>], line: usize, heldout: &[usize]) -> Option<Vec<Vector2<f64>>> {
        let mut kept = vec![1.0; self.residuals.len()];
        let mut start = 0;
        let mut first = 0;
        for (i, samples) in lines.iter().enumerate() {
            let end = start + samples.len();
            if i == line {
                first = start;
            }
            if heldout.contains(&i) {
                kept[2 * start..2 * end].fill(0.0);
            }
            start = end;
        }
        let weighted = DMatrix::from_fn(self.jacobian.nrows(), COUNT, |row, i| kept[row] * self.jacobian[(row, i)]);
        let (gradient, curvature) = (weighted.tr_mul(&self.residuals), weighted.tr_mul(&self.jacobian));
        let step = -curvature.cholesky()?.solve(&gradient);
        let misfit = &self.residuals + &self.jacobian * step;
        let predicted = |(i, sample): (usize, &SpatialSample)| {
            let row = first + i;
            sample.reading_n_m + misfit.fixed_rows::<2>(2 * row) / self.weights[row]
        };
        Some(lines[line].iter().enumerate().map(predicted).collect())
    }
}

pub(super) fn load(region: &SpatialRegion<'_>, value: &Value) -> SpatialLoaded {
    let Stored { parameters: stated, .. } =
        typed::<Stored>(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    let stored = stated.iter().map(|parameter| (parameter.name.as_str(), parameter.value));
    let parameters = Parameters(read(&NAMES, POSITIVE, stored)?);
    Ok(Box::new(RodModel::new(region, parameters, stated).ok_or_else(no_solution)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::sensor::Across;

    #[test]
    fn verif_derivatives_by_the_parameters_are_those_of_differences() {
        let whisker = Whisker::curved();
        let k = whisker.root_stiffness_n_m_rad;
        let suspension = Suspension { yaw_n_m_rad: k, pitch_n_m_rad: 1.3 * k, twist_n_m_rad: 0.8 * k };
        let whisker = SpatialWhisker { whisker, suspension, poisson_ratio: 0.33 };
        let nominal = Parameters::nominal(&whisker);
        let at = Around::new(0.05, 4e-3, -3e-3).contact(&Axis::new(&whisker.whisker, Across::Normal)).vector();
        for turn in [Vector3::zeros(), Vector3::new(0.5, -0.4, 0.7)] {
            let mut parameters = nominal;
            parameters.0.fixed_rows_mut::<3>(11).copy_from(&turn);
            // The same contact relative to the root.
            let contact = Point::from_vector(Rotation3::new(turn) * at);
            let tuned = Tuned::new(&whisker, parameters).unwrap();
            let response = tuned.respond(contact, None).unwrap();
            let slopes = tuned.derivatives(contact, &response);
            for i in (0..COUNT).filter(|i| !MECHANICAL.contains(i)) {
                let step = Vector::ith(i, 1e-6);
                let [after, before] = [step, -step].map(|step| {
                    let tuned = Tuned::new(&whisker, parameters.moved(step)).unwrap();
                    tuned.respond(contact, Some(response.load)).unwrap().reading_n_m
                });
                let expected = (after - before) / 2e-6;
                let error = (slopes.column(i) - expected).norm();
                assert!(error < 1e-5 * expected.norm() + 1e-12, "{} at {turn}: {expected}", NAMES[i]);
            }
        }
    }
}
