//! Common interface of the estimators of the plane and of space: their lines, and checks of their first lines.

use std::path::Path;

use anyhow::{anyhow, bail};
use live::counts::{MODULI, ZEROINGS_S};
use live::wire::{BadLine, Line, SampleLine};
use live::{Answer, Kind, LiveEstimator, Motion, Timing};
use strict_json::shown_number;
use testbed::protocol::space::SPATIAL_PROTOCOL;
use trace::RATES_HZ;

/// Estimators of the plane or of space, and their lines.
pub(super) trait Method: 'static {
    type Kind: Kind;
    type Motion: Motion<Measured = <Self::Kind as Kind>::Base, Base = <Self::Kind as Kind>::Base> + 'static;
    type Prior;
    type Calibration;
    /// A reading as a line gives it.
    type Given;
    /// Conversion of the readings of a whisker.
    type Conversion;

    /// Version of the protocol.
    const PROTOCOL: u32;

    /// Reads a calibration.
    fn read(path: &Path) -> anyhow::Result<Self::Calibration>;

    /// Parses a line.
    fn parse(line: &str) -> Result<LineOf<Self>, BadLine>;

    /// Name of the whisker in its first line.
    fn name(prior: &Self::Prior) -> Option<&str>;

    /// The estimator of a whisker, and the conversion of its readings.
    fn begin(
        &self,
        calibration: &Self::Calibration,
        path: &Path,
        prior: &Self::Prior,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>>;

    /// Converts a reading of the time `t_s` that arrives at `at_s`.
    ///
    /// # Errors
    /// The text found and the text expected, if it cannot be converted.
    fn convert(
        conversion: &mut Self::Conversion,
        t_s: f64,
        given: Self::Given,
        at_s: f64,
    ) -> Result<Taken<<Self::Kind as Kind>::Reading>, String>;

    /// Number of times that the zeroing of counts was repeated, see [`live::counts::Conversion::zeroings_repeated`].
    fn zeroings_repeated(conversion: &Self::Conversion) -> u64;
}

/// A line, and a later one, of a method.
pub(super) type LineOf<T> = Line<<T as Method>::Prior, <T as Method>::Given, <<T as Method>::Kind as Kind>::Base>;
pub(super) type SampleOf<T> = SampleLine<<T as Method>::Given, <<T as Method>::Kind as Kind>::Base>;

/// Estimator of a whisker, and the conversion of its readings.
pub(super) type Begun<T> = (LiveEstimator<<T as Method>::Motion, <T as Method>::Kind>, <T as Method>::Conversion);

/// A reading that has been converted.
pub(super) enum Taken<R> {
    /// For the estimator.
    Reading(R),
    /// Left out, with its status.
    LeftOut(&'static str),
}

/// Answer of a kind of estimator.
pub(super) type Answered<K> = Answer<<K as Kind>::Reading, <K as Kind>::Base, <K as Kind>::Estimate>;

/// Checks what the first lines of both protocols have in common.
pub(super) fn check_prior(protocol: (u32, u32), rate_hz: f64) -> anyhow::Result<()> {
    let (found, expected) = protocol;
    if found != expected {
        let kind = if expected == SPATIAL_PROTOCOL { "in space" } else { "in the plane" };
        bail!("protocol: found {found}, expected {expected}, the version for a calibration {kind}");
    }
    let [least, most] = RATES_HZ;
    if !(least..=most).contains(&rate_hz) {
        bail!("rate_hz: found {}, expected {least} to {most}", shown_number(rate_hz));
    }
    Ok(())
}

/// As [`live::check_noise`], of the noise that a first line states.
pub(super) fn check_noise(stated: Option<f64>, of_sensor: Option<f64>, largest_n_m: f64) -> anyhow::Result<()> {
    live::check_noise(stated, of_sensor, largest_n_m)
        .map_err(|(found, expected)| anyhow!("noise_sd_n_m: found {found}, expected {expected}"))
}

/// Checks the settings of counts in the first lines of both protocols.
pub(super) fn check_counts(zeroing_s: Option<f64>, modulo: Option<f64>) -> anyhow::Result<()> {
    for (key, found, [least, most]) in [("zeroing_s", zeroing_s, ZEROINGS_S), ("modulo", modulo, MODULI)] {
        if let Some(found) = found.filter(|found| !(least..=most).contains(found)) {
            bail!("{key}: found {}, expected {least} to {most}", shown_number(found));
        }
    }
    Ok(())
}
