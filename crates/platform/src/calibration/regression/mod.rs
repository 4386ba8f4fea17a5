//! Regressions: radial distance of the features of a press.
//!
//! To add one: one file with its `fit` and one row in [`REGRESSIONS`]. A fit must not depend on the order of the presses.

mod beam;
mod gaussian_process;
mod monotone;
mod polynomial;
mod robust;
mod several;

use std::fmt::Debug;

use super::{Error, Features, LabelledPress, published};

/// A fitted regression. It may be asked anywhere; a [`Calibration`](super::Calibration) asks it only near the features that it was fitted to.
pub trait Regressor: Debug + Send + Sync {
    /// Radial distance of the contact from the whisker's root.
    fn distance_m(&self, features: &Features) -> f64;
}

/// A fitted regression that must be told the true distance to tell the distance.
pub trait LeakingRegressor: Debug + Send + Sync {
    /// What it makes of features and truth.
    fn distance_m(&self, press: &LabelledPress) -> f64;
}

/// Fits a regression to labelled presses.
pub type Fitter<R> = fn(&[LabelledPress]) -> Result<Box<R>, Error>;

/// How a regression is fitted, and to what.
#[derive(Clone, Copy, Debug)]
pub enum Fit {
    /// To features that exist at run time.
    Live(Fitter<dyn Regressor>),
    /// To the truth as well, as was published: to be judged, never to be used.
    Leaking(Fitter<dyn LeakingRegressor>),
}

/// A row of the registry of regressions.
#[derive(Debug)]
pub struct RegressionRow {
    /// Name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Fewest labelled presses that determine it.
    pub fewest: usize,
    /// Its fit.
    pub fit: Fit,
}

/// The registry of regressions.
pub const REGRESSIONS: &[RegressionRow] = &[
    RegressionRow {
        name: "robust",
        about: "polynomial of third order in the logarithm of the slope, by Tukey's biweight: mislabelled presses do not count",
        fewest: 5,
        fit: Fit::Live(robust::fit),
    },
    RegressionRow {
        name: "logarithmic",
        about: "polynomial of third order in the logarithm of the slope",
        fewest: 5,
        fit: Fit::Live(polynomial::logarithmic),
    },
    RegressionRow {
        name: "cubic",
        about: "polynomial of third order in the slope: the published one made honest",
        fewest: 5,
        fit: Fit::Live(polynomial::cubic),
    },
    RegressionRow {
        name: "monotone",
        about: "Bernstein polynomial of sixth order in the logarithm of the slope that falls everywhere",
        fewest: 4,
        fit: Fit::Live(monotone::fit),
    },
    RegressionRow {
        name: "gaussian-process",
        about: "Gaussian process about a straight line in the logarithm of the slope, scales by their likelihood",
        fewest: 5,
        fit: Fit::Live(gaussian_process::fit),
    },
    RegressionRow {
        name: "several",
        about: "second order in the logarithm of the slope, first in that of the peak and in the slope ratio of the axes",
        fewest: 7,
        fit: Fit::Live(several::fit),
    },
    RegressionRow {
        name: "beam",
        about: "physics: a conical beam on a gel hinge, three constants",
        fewest: 4,
        fit: Fit::Live(beam::fit),
    },
    RegressionRow {
        name: published::NAME,
        about: "as published: third order in slope times true distance; cross-validated only, as nothing live knows the true distance",
        fewest: 5,
        fit: Fit::Leaking(published::fit),
    },
];

/// The registry's row of this name.
pub fn regression(name: &str) -> Option<&'static RegressionRow> {
    REGRESSIONS.iter().find(|row| row.name == name)
}

impl RegressionRow {
    /// # Errors
    /// [`Error::Few`] where there are fewer presses than the regression needs.
    pub(super) fn enough(&self, presses: &[LabelledPress]) -> Result<(), Error> {
        if presses.len() < self.fewest {
            return Err(Error::Few { regression: self.name, found: presses.len(), expected: self.fewest });
        }
        Ok(())
    }
}

/// Values brought to -1 .. 1 over those that were fitted, so that powers stay apart.
#[derive(Clone, Copy, Debug)]
struct Scale {
    middle: f64,
    half: f64,
}

impl Scale {
    /// None where all values are the same.
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        (high > low).then_some(Self { middle: 0.5 * (low + high), half: 0.5 * (high - low) })
    }

    fn scaled(&self, value: f64) -> f64 {
        (value - self.middle) / self.half
    }
}

fn log_slope(features: &Features) -> f64 {
    features.slope_counts_per_s.ln()
}

#[cfg(test)]
mod exam {
    //! What every regression must pass.

    use super::*;

    /// Presses along the whisker with the slopes of a beam on a hinge, and what the features say besides.
    pub(super) fn presses(count: usize) -> Vec<LabelledPress> {
        let press = |i: usize| {
            let distance_m = 0.045 + 0.1 * i as f64 / (count - 1) as f64;
            let slope_counts_per_s = 4e3 / (distance_m + 6.0 * distance_m * distance_m);
            let features = Features {
                slope_counts_per_s,
                peak_counts: Some(0.02 * slope_counts_per_s * (1.0 + 0.3 * (7.0 * i as f64).sin())),
                slope_ratio: Some(0.1 + 0.02 * (3.0 * i as f64).cos()),
            };
            LabelledPress { log: "exam".into(), onset_s: Some(i as f64), features, distance_m }
        };
        (0..count).map(press).collect()
    }

    #[test]
    fn val_every_live_regression_follows_a_smooth_curve_between_its_presses() {
        let all = presses(41);
        let (even, odd): (Vec<_>, Vec<_>) = all.into_iter().enumerate().partition(|(i, _)| i % 2 == 0);
        let fitted: Vec<LabelledPress> = even.into_iter().map(|(_, press)| press).collect();
        for row in REGRESSIONS {
            let Fit::Live(fit) = row.fit else { continue };
            let regressor = fit(&fitted).unwrap();
            for (_, press) in &odd {
                let error_m = regressor.distance_m(&press.features) - press.distance_m;
                assert!(error_m.abs() < 2e-3, "{}: {error_m} at {}", row.name, press.distance_m);
            }
        }
    }

    #[test]
    fn robust_presses_that_are_all_the_same_are_an_error() {
        let same = vec![presses(5)[2].clone(); 12];
        for row in REGRESSIONS {
            let undetermined = match row.fit {
                Fit::Live(fit) => fit(&same).is_err(),
                Fit::Leaking(fit) => fit(&same).is_err(),
            };
            assert!(undetermined, "{}", row.name);
        }
    }

    #[test]
    fn verif_names_are_their_own() {
        for row in REGRESSIONS {
            assert_eq!(regression(row.name).unwrap().about, row.about, "{}", row.name);
        }
    }
}
