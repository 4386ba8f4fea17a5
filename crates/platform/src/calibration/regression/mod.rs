//! Regressions: the radial distance of a contact from the features of its press.
//!
//! To add a regression: one file with its [`LiveFit`] and one row in [`REGRESSIONS`]. A fit must not depend on the
//! order of the presses.

mod beam;
mod choice;
mod published;
mod regressor;
mod robust;
mod several;

pub use choice::{Candidate, by_places};
pub use regressor::{Fit, Fitter, LeakingRegressor, LiveFit, Quantity, Regressor, Restorer};

use super::{Error, HoldOut, LabelledPress};

/// Row of the registry of regressions.
#[derive(Debug)]
pub struct RegressionRow {
    /// Name.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Smallest number of labelled presses that determines it.
    pub fewest: usize,
    /// Its fit.
    pub fit: Fit,
}

/// Registry of regressions.
pub const REGRESSIONS: &[RegressionRow] = &[
    RegressionRow {
        name: "robust",
        about: "polynomial of third order in the logarithm of the slope by Tukey's biweight: mislabelled presses have zero weight",
        fewest: 5,
        fit: Fit::Live(robust::LIVE),
    },
    RegressionRow {
        name: "several",
        about: "second order in the logarithm of the slope, first in that of the peak and in the slope ratio of the axes",
        fewest: 7,
        fit: Fit::Live(several::LIVE),
    },
    RegressionRow {
        name: "beam",
        about: "physics: a conical beam on a gel hinge, three constants",
        fewest: 4,
        fit: Fit::Live(beam::LIVE),
    },
    RegressionRow {
        name: "robust-ramp",
        about: "as robust, with the slope before the low-pass: pushes of different depth that are short for the low-pass",
        fewest: 5,
        fit: Fit::Live(robust::RAMP),
    },
    RegressionRow {
        name: "beam-ramp",
        about: "as beam, with the slope before the low-pass: pushes of different depth that are short for the low-pass",
        fewest: 4,
        fit: Fit::Live(beam::RAMP),
    },
    RegressionRow {
        name: published::NAME,
        about: "as published: third order in slope times true distance; cross-validated only, as the true distance is \
            unknown at run time",
        fewest: 5,
        fit: Fit::Leaking(published::fit),
    },
];

/// Row of the registry with this name.
pub fn regression(name: &str) -> Option<&'static RegressionRow> {
    REGRESSIONS.iter().find(|row| row.name == name)
}

impl RegressionRow {
    /// # Errors
    /// [`Error::Few`] if there are fewer presses than the regression needs, [`Error::OnePlace`] if all are at one place.
    pub(super) fn enough(&self, presses: &[LabelledPress]) -> Result<(), Error> {
        if presses.len() < self.fewest {
            return Err(Error::Few { regression: self.name, found: presses.len(), expected: self.fewest });
        }
        match HoldOut::Place.groups(presses).iter().max() {
            Some(0) => Err(Error::OnePlace { regression: self.name, distance_m: presses[0].distance_m }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod exam {
    //! Requirements on every regression of the registry.

    use super::*;
    use crate::calibration::Features;

    /// Presses along the whisker with the slopes of a beam on a hinge, and peaks and slope ratios that vary.
    fn presses(count: usize) -> Vec<LabelledPress> {
        let press = |i: usize| {
            let distance_m = 0.045 + 0.1 * i as f64 / (count - 1) as f64;
            let slope_counts_per_s = 4e3 / (distance_m + 6.0 * distance_m * distance_m);
            let features = Features {
                slope_counts_per_s,
                peak_counts: Some(0.02 * slope_counts_per_s * (1.0 + 0.3 * (7.0 * i as f64).sin())),
                slope_ratio: Some(0.1 + 0.02 * (3.0 * i as f64).cos()),
                ramp_counts_per_s: Some(1.1 * slope_counts_per_s),
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
            let Fit::Live(live) = row.fit else { continue };
            let regressor = (live.fit)(&fitted).unwrap();
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
                Fit::Live(live) => (live.fit)(&same).is_err(),
                Fit::Leaking(fit) => fit(&same).is_err(),
            };
            assert!(undetermined, "{}", row.name);
        }
    }

    #[test]
    fn verif_every_live_regression_is_restored_from_its_coefficients_bit_for_bit() {
        let all = presses(23);
        for row in REGRESSIONS {
            let Fit::Live(live) = row.fit else { continue };
            let fitted = (live.fit)(&all).unwrap();
            let coefficients = fitted.coefficients();
            assert_eq!(coefficients.len(), live.coefficients.len(), "{}", row.name);
            let restored = (live.restore)(&coefficients).unwrap();
            assert_eq!(restored.coefficients(), coefficients, "{}", row.name);
            for press in presses(57) {
                let [fitted_m, restored_m] = [&fitted, &restored].map(|one| one.distance_m(&press.features));
                assert_eq!(fitted_m.to_bits(), restored_m.to_bits(), "{} at {}", row.name, press.distance_m);
            }
        }
    }

    #[test]
    fn verif_names_are_unique() {
        for row in REGRESSIONS {
            assert_eq!(regression(row.name).unwrap().about, row.about, "{}", row.name);
        }
    }
}
