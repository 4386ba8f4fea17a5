//! Settings of the Hall front end.

use serde::{Deserialize, Serialize};
use whisker::estimators::{Settings, SettingsError, within};

/// Settings of the Hall front end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Seed of the individual sensors: another seed gives other sensors.
    pub seed: u64,
    /// Magnetic moment. The default 6.5e-3 is that of a neodymium cylinder of 2 mm diameter and 1.8 mm height.
    pub magnet_moment_a_m2: f64,
    /// Distance from the root's axis of rotation to the magnet.
    pub lever_m: f64,
    /// Distance from the magnet at rest to the sensor.
    pub gap_m: f64,
    /// Distance from the centre of the board's sensors to the reference sensor, out of the plane.
    pub reference_distance_m: f64,
    /// Nominal gain of every axis.
    pub gain_counts_per_t: f64,
    /// Relative standard deviation of the gain between axes.
    pub gain_spread: f64,
    /// Standard deviation, between axes, of the counts without field.
    pub offset_spread_counts: f64,
    /// Standard deviation of the tilt of an axis about each of the other two.
    pub misalignment_rad: f64,
    /// Resolution of the counts in bits, including the sign; counts saturate at the range.
    pub bits: u32,
    /// Standard deviation of the white noise per axis and sample.
    pub white_counts: f64,
    /// Standard deviation of each octave of the 1/f noise per axis; one-sided spectrum `flicker_counts^2 / (f ln 2)`.
    pub flicker_counts: f64,
    /// Stationary standard deviation of a board's temperature.
    pub temperature_sd_k: f64,
    /// Correlation time of the temperature.
    pub temperature_time_s: f64,
    /// Relative change of the gain with temperature, including that of the magnet.
    pub gain_drift_per_k: f64,
    /// Standard deviation, between axes, of the temperature coefficient of the counts without field.
    pub offset_drift_counts_per_k: f64,
    /// Magnitude of the earth's field.
    pub earth_t: f64,
    /// Inclination of the earth's field below the horizontal plane.
    pub earth_inclination_rad: f64,
    /// Direction of magnetic north in World.
    pub north_rad: f64,
    /// Whether common-mode compensation is applied.
    pub compensated: bool,
    /// Duration of the zeroing before a recording; the mean reading at rest becomes zero.
    pub zeroing_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            magnet_moment_a_m2: 6.5e-3,
            lever_m: 0.5e-3,
            gap_m: 4e-3,
            reference_distance_m: 20e-3,
            gain_counts_per_t: 2.8e5,
            gain_spread: 0.03,
            offset_spread_counts: 20.0,
            misalignment_rad: 0.01,
            bits: 16,
            white_counts: 1.1,
            flicker_counts: 0.05,
            temperature_sd_k: 1.0,
            temperature_time_s: 600.0,
            gain_drift_per_k: -1e-3,
            offset_drift_counts_per_k: 0.3,
            earth_t: 48e-6,
            earth_inclination_rad: 1.065,
            north_rad: std::f64::consts::FRAC_PI_2,
            compensated: true,
            zeroing_s: 1.0,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("magnet_moment_a_m2", self.magnet_moment_a_m2, 1e-6..=1.0)?;
        within("lever_m", self.lever_m, 0.0..=0.1)?;
        within("gap_m", self.gap_m, 1e-4..=0.1)?;
        within("reference_distance_m", self.reference_distance_m, 1e-3..=1.0)?;
        within("gain_counts_per_t", self.gain_counts_per_t, 1.0..=1e12)?;
        within("gain_spread", self.gain_spread, 0.0..=0.2)?;
        within("offset_spread_counts", self.offset_spread_counts, 0.0..=1e6)?;
        within("misalignment_rad", self.misalignment_rad, 0.0..=0.2)?;
        within("bits", f64::from(self.bits), 2.0..=32.0)?;
        within("white_counts", self.white_counts, 0.0..=1e6)?;
        within("flicker_counts", self.flicker_counts, 0.0..=1e6)?;
        within("temperature_sd_k", self.temperature_sd_k, 0.0..=100.0)?;
        within("temperature_time_s", self.temperature_time_s, 1.0..=1e6)?;
        within("gain_drift_per_k", self.gain_drift_per_k, -0.01..=0.01)?;
        within("offset_drift_counts_per_k", self.offset_drift_counts_per_k, 0.0..=1e6)?;
        within("earth_t", self.earth_t, 0.0..=1e-3)?;
        let quarter = std::f64::consts::FRAC_PI_2;
        within("earth_inclination_rad", self.earth_inclination_rad, -quarter..=quarter)?;
        within("north_rad", self.north_rad, -4.0 * quarter..=4.0 * quarter)?;
        within("zeroing_s", self.zeroing_s, 0.01..=60.0)
    }
}
