//! The exact quasi-static whisker as sensor model, with physical parameters fitted to the calibration.
//!
//! ```text
//! reading(p) = offset + gain k (w + r2 w^2 + r3 w^3)    w = M(q; E, k, kappa) / k    q = R(-yaw) (p - (x, y))
//! kappa(s) = scale kappa0(s) + shift
//! ```
//!
//! `M` is the moment of [`crate::elastica`] at a contact `q`, for Young's modulus `E`, stiffness `k` of the root and
//! pre-curvature `kappa`; `w` is the rotation of the root, which the sensor measures. A sensor linear in the moment has
//! `r2 = r3 = 0` (`response` 1); a Hall sensor under a rotating magnet does not (`response` 3). The position `(x, y)`
//! and `yaw` of the root in Base allow for an imprecise mounting.
//!
//! The prior of the parameters is that of the whisker that the calibration names, with the standard deviations of
//! [`Config`]. With residuals `e`, their derivatives `J` and the noise's variance `v`, the Gauss-Newton step solves
//!
//! ```text
//! (J' J / v + P^-1) dc = -J' e / v - P^-1 (c - c0)
//! ```
//!
//! (`P` diagonal); the inverse of its matrix is the parameters' covariance `C`, and `j' C j` is the variance of a
//! reading. A direction that the data do not determine keeps its prior mean and variance: `gain`, `E` and `k` are
//! multiplied by one another, so the data determine `gain k` and `E / k` only; a straight whisker's curvature has no
//! scale; a rotated root is nearly indistinguishable from an offset of the reading.

use std::sync::Arc;

use filters::least_squares::{Moves, Problem, Quadratic, minimise};
use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::mechanics::{Mechanics, Parameter, Sensitivities};
use super::physical::{INFORMED_SHARE, SETTINGS, check_sds, check_settled, moved, no_solution, read};
use super::{FittedModel, Loaded, ModelError, Prediction, Region, Sample, SensorModel};
use crate::Whisker;
use crate::frames::{Base, Point, Pose};
use crate::settings::typed;

pub(super) const KIND: &str = "elastica";

/// Number of parameters.
const COUNT: usize = 11;

/// Names of the parameters with their units, in order.
const NAMES: [&str; COUNT] = [
    "gain",
    "youngs_modulus_pa",
    "root_stiffness_n_m_rad",
    "curvature_scale",
    "curvature_shift_per_m",
    "reading_offset_n_m",
    "response_2_per_rad",
    "response_3_per_rad2",
    "root_x_m",
    "root_y_m",
    "root_yaw_rad",
];

/// Number of leading parameters that are positive and fitted by their logarithms.
const POSITIVE: usize = 3;

/// Lower bound of the noise, relative to the largest reading: the error of the tabulated mechanics.
const SMALLEST_NOISE: f64 = 1e-6;

type Vector = SVector<f64, COUNT>;
type Matrix = SMatrix<f64, COUNT, COUNT>;

/// Degree of the sensor's response, and prior standard deviations of the parameters; 0 holds a parameter fixed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Degree of the sensor's response to a rotation of its root: 1 (linear) or 3.
    response: usize,
    /// Prior standard deviation of the logarithm of the gain; the prior mean is fitted to the readings.
    gain_sd: f64,
    /// Prior standard deviation of the logarithm of Young's modulus.
    youngs_modulus_sd: f64,
    /// Prior standard deviation of the logarithm of the root's stiffness.
    root_stiffness_sd: f64,
    /// Prior standard deviation of the scale of the pre-curvature.
    curvature_scale_sd: f64,
    /// Prior standard deviation of the offset of the pre-curvature.
    curvature_shift_sd_per_m: f64,
    /// Prior standard deviation of the reading's offset, relative to the largest reading.
    reading_offset_sd: f64,
    /// Prior standard deviation of the coefficients of the second and third power of the rotation in radians, if `response` is 3.
    response_sd: f64,
    /// Prior standard deviation of the root's position along each axis.
    root_sd_m: f64,
    /// Prior standard deviation of the root's yaw.
    root_yaw_sd_rad: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            response: 1,
            gain_sd: 3.0,
            youngs_modulus_sd: 0.2,
            root_stiffness_sd: 0.2,
            curvature_scale_sd: 0.1,
            curvature_shift_sd_per_m: 1.0,
            reading_offset_sd: 0.01,
            response_sd: 0.5,
            root_sd_m: 1e-3,
            root_yaw_sd_rad: 0.05,
        }
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
    #[serde(rename = "told")]
    informed_by_data: bool,
    /// Correlations with the preceding parameters.
    correlations: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    response: usize,
    parameters: Vec<StoredParameter>,
}

/// Values of the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Parameters(Vector);

impl Parameters {
    fn nominal(whisker: &Whisker, gain: f64) -> Self {
        let (modulus, stiffness) = (whisker.youngs_modulus_pa, whisker.root_stiffness_n_m_rad);
        Self(Vector::from([gain, modulus, stiffness, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    }

    /// The parameters changed by a step, which is one of the logarithm for a positive parameter.
    fn moved(&self, step: Vector) -> Self {
        Self(moved(&self.0, POSITIVE, &step))
    }

    /// The step from other parameters to these.
    fn step_from(&self, other: &Self) -> Vector {
        Vector::from_fn(|i, _| if i < POSITIVE { (self.0[i] / other.0[i]).ln() } else { self.0[i] - other.0[i] })
    }

    /// The nominal whisker with these parameters.
    fn whisker(&self, nominal: &Whisker) -> Whisker {
        let scaled = Parameter::CurvatureScale.changed(nominal, self.0[3] - 1.0);
        let shifted = Parameter::CurvatureOffset.changed(&scaled, self.0[4]);
        Whisker { youngs_modulus_pa: self.0[1], root_stiffness_n_m_rad: self.0[2], ..shifted }
    }

    /// Pose of the root's frame in Base; both frames have the type of Base, the only one that the mechanics use.
    fn root(&self) -> Pose<Base, Base> {
        Pose::new(self.0[8], self.0[9], self.0[10])
    }

    /// Reading at a moment, and its derivative.
    fn respond(&self, moment_n_m: f64) -> (f64, f64) {
        let [gain, _, stiffness, _, _, offset, r2, r3, ..]: [f64; COUNT] = self.0.into();
        let w = moment_n_m / stiffness;
        let (value, slope) = (w * (1.0 + w * (r2 + w * r3)), 1.0 + w * (2.0 * r2 + w * 3.0 * r3));
        (offset + gain * stiffness * value, gain * slope)
    }
}

/// The sensor model of one set of parameters.
struct Tuned {
    parameters: Parameters,
    base_in_root: Pose<Base, Base>,
    mechanics: Mechanics,
}

impl Tuned {
    fn new(region: &Region<'_>, parameters: Parameters) -> Option<Self> {
        Some(Self::with(parameters, Mechanics::new(region, &parameters.whisker(region.whisker))?))
    }

    fn rough(region: &Region<'_>, parameters: Parameters) -> Option<Self> {
        Some(Self::with(parameters, Mechanics::rough(region, &parameters.whisker(region.whisker))?))
    }

    fn with(parameters: Parameters, mechanics: Mechanics) -> Self {
        Self { parameters, base_in_root: parameters.root().inverse(), mechanics }
    }

    /// Reading of a contact and its derivatives by the parameters.
    fn derivatives(&self, sensitivities: &Sensitivities, contact: Point<Base>) -> (f64, Vector) {
        let Parameters(values) = self.parameters;
        let seen = self.base_in_root.apply(contact);
        let Prediction { reading_n_m: moment, gradient_n: gradient } = self.mechanics.predict(seen);
        let [by_modulus, by_scale, by_shift] = sensitivities.at(seen);
        let (reading, slope) = self.parameters.respond(moment);
        let without_offset = reading - values[5];
        let (gain, stiffness) = (values[0], values[2]);
        let w = moment / stiffness;
        let by_root = -slope * (self.parameters.root().rotation() * gradient);
        let derivatives = [
            without_offset,
            slope * by_modulus,
            // Scaling the stiffness of wire and root alike scales the moment and leaves the root's rotation unchanged.
            without_offset - slope * by_modulus,
            slope * by_scale,
            slope * by_shift,
            1.0,
            gain * stiffness * w * w,
            gain * stiffness * w * w * w,
            by_root.x,
            by_root.y,
            slope * gradient.dot(&Vector2::new(seen.y(), -seen.x())),
        ];
        (reading, Vector::from(derivatives))
    }
}

/// The whisker with fitted parameters.
pub(super) struct ElasticaModel {
    response: usize,
    tuned: Arc<Tuned>,
    stated: Vec<StoredParameter>,
}

impl std::fmt::Debug for ElasticaModel {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("ElasticaModel").field("parameters", &self.stated).finish_non_exhaustive()
    }
}

impl SensorModel for ElasticaModel {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn label(&self) -> String {
        if self.response > 1 { format!("{KIND}-{}", self.response) } else { KIND.into() }
    }

    fn reading_n_m(&self, contact: Point<Base>) -> f64 {
        let Tuned { parameters, base_in_root, mechanics } = &*self.tuned;
        parameters.respond(mechanics.moment_n_m(base_in_root.apply(contact))).0
    }

    fn to_json(&self) -> Value {
        let stored = Stored { kind: KIND.into(), response: self.response, parameters: self.stated.clone() };
        serde_json::to_value(stored).expect("numbers and names serialise")
    }

    fn about(&self) -> String {
        let informed = self.stated.iter().filter(|parameter| parameter.informed_by_data).count();
        let response = if self.response > 1 { "cubic" } else { "linear" };
        format!(
            "exact quasi-static whisker with a {response} response, {informed} of its {COUNT} parameters determined by \
            the calibration"
        )
    }

    fn predict(&self, contact: Point<Base>) -> Prediction {
        let Tuned { parameters, base_in_root, mechanics } = &*self.tuned;
        let moment = mechanics.predict(base_in_root.apply(contact));
        let (reading_n_m, slope) = parameters.respond(moment.reading_n_m);
        Prediction { reading_n_m, gradient_n: base_in_root.rotation().tr_mul(&moment.gradient_n) * slope }
    }

    fn extrapolates(&self) -> bool {
        true
    }

    fn tangent_rad(&self, contact: Point<Base>) -> Option<f64> {
        let Tuned { parameters, base_in_root, mechanics } = &*self.tuned;
        Some(mechanics.tangent_rad(base_in_root.apply(contact)) + parameters.root().yaw_rad())
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

pub(super) fn candidates() -> Vec<Value> {
    vec![json!({ "response": 1 }), json!({ "response": 3 })]
}

fn check_response(response: usize) -> Result<(), ModelError> {
    if response == 1 || response == 3 {
        return Ok(());
    }
    Err(ModelError::Data(format!("`response`: found {response}, expected 1 or 3")))
}

pub(super) fn fit(region: &Region<'_>, samples: &[Sample], config: &Value) -> Result<FittedModel, ModelError> {
    let config: Config = typed(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_response(config.response)?;
    if samples.len() <= COUNT {
        let found = samples.len();
        return Err(ModelError::Data(format!("samples of the calibration: found {found}, expected more than {COUNT}")));
    }
    let largest_n_m = samples.iter().map(|sample| sample.reading_n_m.abs()).fold(0.0, f64::max);
    let prior = Prior { mean: first_guess(region, samples)?, sd: config.standard_deviations(largest_n_m)? };

    let calibration = Calibration { prior: &prior, region, samples, largest_n_m };
    let start = calibration.look(prior.mean).ok_or_else(no_solution)?;
    let solution = minimise(&calibration, start, &SETTINGS).ok_or_else(no_solution)?;
    check_settled(solution.outcome)?;
    prior.learnt(region, config.response, solution.state)
}

/// The nominal whisker, with the gain that fits the readings best.
fn first_guess(region: &Region<'_>, samples: &[Sample]) -> Result<Parameters, ModelError> {
    let nominal = Mechanics::rough(region, region.whisker).ok_or_else(no_solution)?;
    let (mut products, mut squares) = (0.0, 0.0);
    for sample in samples {
        let moment = nominal.predict(sample.contact).reading_n_m;
        products += moment * sample.reading_n_m;
        squares += moment * moment;
    }
    let gain = products / squares;
    if gain > 0.0 && gain.is_finite() {
        return Ok(Parameters::nominal(region.whisker, gain));
    }
    let sign = if region.face.away_sign() > 0.0 { "positive" } else { "negative" };
    Err(ModelError::Data(format!("readings of the face {} are expected to be {sign}", region.face.name())))
}

impl Config {
    fn standard_deviations(&self, largest_n_m: f64) -> Result<Vector, ModelError> {
        let response_sd = if self.response > 1 { self.response_sd } else { 0.0 };
        let values = [
            ("gain_sd", self.gain_sd),
            ("youngs_modulus_sd", self.youngs_modulus_sd),
            ("root_stiffness_sd", self.root_stiffness_sd),
            ("curvature_scale_sd", self.curvature_scale_sd),
            ("curvature_shift_sd_per_m", self.curvature_shift_sd_per_m),
            ("reading_offset_sd", self.reading_offset_sd),
            ("response_sd", response_sd),
            ("response_sd", response_sd),
            ("root_sd_m", self.root_sd_m),
            ("root_sd_m", self.root_sd_m),
            ("root_yaw_sd_rad", self.root_yaw_sd_rad),
        ];
        check_sds(values)?;
        let mut sd = Vector::from(values.map(|(_, sd)| sd));
        sd[5] *= largest_n_m;
        Ok(sd)
    }
}

/// Prior of the parameters.
struct Prior {
    mean: Parameters,
    sd: Vector,
}

/// A set of parameters with the linearised residuals. Derivatives are by the parameters in units of their prior
/// standard deviations, so that those of a fixed one vanish.
struct Look {
    tuned: Tuned,
    sensitivities: Sensitivities,
    /// `J' J`, `J' e` and `e' e`.
    squares: Matrix,
    products: Vector,
    misses: f64,
    noise_variance: f64,
}

/// Fit of the parameters to samples under a prior, by steps in units of the prior standard deviations.
struct Calibration<'a> {
    prior: &'a Prior,
    region: &'a Region<'a>,
    samples: &'a [Sample],
    largest_n_m: f64,
}

impl Calibration<'_> {
    /// `None` if the parameters have no equilibrium over the widened domain.
    fn look(&self, parameters: Parameters) -> Option<Look> {
        let tuned = Tuned::rough(self.region, parameters)?;
        let sensitivities = Sensitivities::new(self.region, &parameters.whisker(self.region.whisker))?;
        let (mut squares, mut products, mut misses) = (Matrix::zeros(), Vector::zeros(), 0.0);
        for sample in self.samples {
            let (reading_n_m, derivatives) = tuned.derivatives(&sensitivities, sample.contact);
            let row = derivatives.component_mul(&self.prior.sd);
            let miss = reading_n_m - sample.reading_n_m;
            squares += row * row.transpose();
            products += row * miss;
            misses += miss * miss;
        }
        let left = (self.samples.len() - COUNT) as f64;
        let noise_variance = (misses / left).max((SMALLEST_NOISE * self.largest_n_m).powi(2));
        Some(Look { tuned, sensitivities, squares, products, misses, noise_variance })
    }
}

impl Moves for Calibration<'_> {
    type State = Look;

    fn moved(&self, look: &Look, step: &DVector<f64>) -> Option<Look> {
        let step = Vector::from_column_slice(step.as_slice());
        self.look(look.tuned.parameters.moved(step.component_mul(&self.prior.sd)))
    }
}

impl Problem for Calibration<'_> {
    fn approximate(&self, look: &Look) -> Option<Quadratic> {
        let gradient = look.products / look.noise_variance + self.prior.moved(look);
        let information = Prior::information(look);
        Some(Quadratic {
            cost: self.cost(look, look)?,
            gradient: DVector::from_column_slice(gradient.as_slice()),
            curvature: DMatrix::from_column_slice(COUNT, COUNT, information.as_slice()),
        })
    }

    /// Negative logarithm of the posterior density with the noise's variance at `current`, up to a constant.
    fn cost(&self, look: &Look, current: &Look) -> Option<f64> {
        Some(0.5 * (look.misses / current.noise_variance + self.prior.moved(look).norm_squared()))
    }
}

impl Prior {
    /// Distance from the prior mean, in prior standard deviations.
    fn moved(&self, look: &Look) -> Vector {
        let moved = look.tuned.parameters.step_from(&self.mean);
        moved.zip_map(&self.sd, |moved, sd| if sd > 0.0 { moved / sd } else { 0.0 })
    }

    fn information(look: &Look) -> Matrix {
        look.squares / look.noise_variance + Matrix::identity()
    }

    fn learnt(&self, region: &Region<'_>, response: usize, look: Look) -> Result<FittedModel, ModelError> {
        // The sum of squares and the identity is positive definite, but rounding may make it singular.
        let factor = Self::information(&look).cholesky();
        let not_determined = || ModelError::Data("the contacts do not determine the parameters of the elastica".into());
        let covariance = factor.ok_or_else(not_determined)?.inverse();
        let parameters = look.tuned.parameters;
        let own_sd = covariance.diagonal().map(f64::sqrt);
        let stated = (0..COUNT)
            .map(|i| {
                let value = parameters.0[i];
                let unit = if i < POSITIVE { value } else { 1.0 };
                StoredParameter {
                    name: NAMES[i].into(),
                    value,
                    sd: own_sd[i] * self.sd[i] * unit,
                    prior_sd: self.sd[i] * unit,
                    informed_by_data: self.sd[i] > 0.0 && own_sd[i] <= INFORMED_SHARE,
                    correlations: (0..i).map(|j| covariance[(i, j)] / (own_sd[i] * own_sd[j])).collect(),
                }
            })
            .collect();
        let tuned = Arc::new(Tuned::new(region, parameters).ok_or_else(no_solution)?);
        let (of_variance, sensitivities, sd) = (tuned.clone(), look.sensitivities, self.sd);
        let variance_n2_m2 = move |contact| {
            let (_, derivatives) = of_variance.derivatives(&sensitivities, contact);
            let row = derivatives.component_mul(&sd);
            row.dot(&(covariance * row))
        };
        let model = Box::new(ElasticaModel { response, tuned, stated });
        Ok(FittedModel { model, variance_n2_m2: Box::new(variance_n2_m2) })
    }
}

pub(super) fn load(region: &Region<'_>, value: &Value) -> Loaded {
    let Stored { response, parameters: stated, .. } =
        typed::<Stored>(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_response(response)?;
    let stored = stated.iter().map(|parameter| (parameter.name.as_str(), parameter.value));
    let parameters = Parameters(read(&NAMES, POSITIVE, stored)?);
    let tuned = Arc::new(Tuned::new(region, parameters).ok_or_else(no_solution)?);
    Ok(Box::new(ElasticaModel { response, tuned, stated }))
}
