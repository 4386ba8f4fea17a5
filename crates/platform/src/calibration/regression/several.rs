//! Linear regression on several features, for presses of different depth.

use nalgebra::{DMatrix, DVector};

use super::regressor::{LiveFit, Regressor, Scale, log_slope};
use crate::calibration::least_squares::solve;
use crate::calibration::{Error, Features, LabelledPress};

const NAME: &str = "several";
const COLUMNS: usize = 5;

pub(super) const LIVE: LiveFit = LiveFit {
    coefficients: &[
        "log_slope_middle",
        "log_slope_half",
        "log_peak_middle",
        "log_peak_half",
        "slope_ratio_middle",
        "slope_ratio_half",
        "constant_m",
        "log_slope_m",
        "log_slope_squared_m",
        "log_peak_m",
        "slope_ratio_m",
    ],
    quantities: &[log_slope, log_peak, slope_ratio],
    fit,
    restore,
};

#[derive(Clone, Debug)]
struct Several {
    slope: Scale,
    peak: Scale,
    ratio: Scale,
    coefficients_m: DVector<f64>,
}

impl Several {
    fn row(&self, features: &Features) -> [f64; COLUMNS] {
        let slope = self.slope.scaled(log_slope(features));
        let peak = self.peak.scaled(log_peak(features));
        let ratio = self.ratio.scaled(slope_ratio(features));
        [1.0, slope, slope * slope, peak, ratio]
    }
}

/// Natural logarithm of the peak in counts; not a number without a peak, and so is the distance then.
fn log_peak(features: &Features) -> f64 {
    features.peak_counts.map_or(f64::NAN, f64::ln)
}

fn slope_ratio(features: &Features) -> f64 {
    features.slope_ratio.unwrap_or(f64::NAN)
}

impl Regressor for Several {
    fn distance_m(&self, features: &Features) -> f64 {
        self.row(features).iter().zip(&self.coefficients_m).map(|(x, coefficient)| x * coefficient).sum()
    }

    fn coefficients(&self) -> Vec<f64> {
        let scales = [self.slope, self.peak, self.ratio].into_iter().flat_map(|scale| [scale.middle, scale.half]);
        scales.chain(self.coefficients_m.iter().copied()).collect()
    }
}

fn restore(coefficients: &[f64]) -> Result<Box<dyn Regressor>, (usize, &'static str)> {
    let scale = |at: usize| {
        let scale = Scale { middle: coefficients[at], half: coefficients[at + 1] };
        if scale.half > 0.0 { Ok(scale) } else { Err((at + 1, Scale::HALF)) }
    };
    let coefficients_m = DVector::from_column_slice(&coefficients[6..]);
    Ok(Box::new(Several { slope: scale(0)?, peak: scale(2)?, ratio: scale(4)?, coefficients_m }))
}

fn fit(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    for (i, press) in presses.iter().enumerate() {
        let missing = match press.features {
            Features { peak_counts: None, .. } => "peak_counts",
            Features { slope_ratio: None, .. } => "slope_ratio",
            _ => continue,
        };
        return Err(Error::Feature { regression: NAME, feature: missing, press: i + 1 });
    }
    let scale = |of: fn(&Features) -> f64| {
        Scale::of(presses.iter().map(|press| of(&press.features))).ok_or(Error::Undetermined(NAME))
    };
    let mut fitted = Several {
        slope: scale(log_slope)?,
        peak: scale(log_peak)?,
        ratio: scale(slope_ratio)?,
        coefficients_m: DVector::zeros(COLUMNS),
    };
    let rows = DMatrix::from_row_iterator(
        presses.len(),
        COLUMNS,
        presses.iter().flat_map(|press| fitted.row(&press.features)),
    );
    let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
    let equal = DVector::repeat(presses.len(), 1.0);
    fitted.coefficients_m = solve(&rows, &distances_m, &equal).ok_or(Error::Undetermined(NAME))?;
    Ok(Box::new(fitted))
}
