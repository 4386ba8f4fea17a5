//! Conversion of readings to moments: the characteristic of a sensor with one channel.

use std::path::Path;

use files::Error;
use trace::Characteristic;

use super::mapping::ReadingColumn;
use crate::own::rest::check_known_contacts;
use crate::own::units::{Reading, Unit};

/// Key of the mapping that states the characteristic.
const KEY: &str = "reading.characteristic";

/// Degree of a fitted characteristic if the mapping states none.
const DEGREE: usize = 3;

/// Known contacts of the calibration.
pub(super) struct Known {
    /// Number of recordings with the role `calibration`.
    pub(super) recordings: usize,
    /// Number of contacts.
    pub(super) contacts: usize,
    /// Moment by the elastica (N m) and reading relative to rest, of the contacts within reach of the whisker.
    pub(super) pairs: Vec<(f64, f64)>,
}

/// Conversion from readings relative to rest to moments.
#[derive(Clone, Debug)]
pub(super) struct Conversion {
    pub(super) characteristic: Characteristic,
    pub(super) residual: f64,
}

impl Conversion {
    /// Conversion by the unit or by the stated characteristic. `None` if it must be fitted. `largest` is the largest
    /// reading relative to rest.
    ///
    /// # Errors
    /// [`Error::Value`] if the stated characteristic is not invertible.
    pub(super) fn stated(path: &Path, mapped: &ReadingColumn, largest: f64) -> Result<Option<Self>, Error> {
        let coefficients = match (mapped.unit, mapped.characteristic) {
            (Reading::Counts, None) => return Ok(None),
            (Reading::Counts, Some(stated)) => stated.map(|coefficient| mapped.sign * coefficient),
            (unit, _) => [mapped.sign / unit.si(), 0.0, 0.0],
        };
        // The range over which a polynomial is monotone is not stated: the largest that the readings may need.
        let first = (largest / coefficients[0]).abs();
        let ranges = (0..).map(|halvings| first * 2.0_f64.powi(1 - halvings)).take(40);
        let within = |most_n_m: f64| Characteristic::new(coefficients.to_vec(), [-most_n_m, most_n_m]);
        let characteristic = ranges.filter(|most_n_m| most_n_m.is_finite()).find_map(within).ok_or_else(|| {
            let found = format!("{coefficients:?}");
            Error::value(path, KEY, found, "a nonzero first coefficient, counts per N m")
        })?;
        Ok(Some(Self { characteristic, residual: 0.0 }))
    }

    /// Conversion fitted to the known contacts of the calibration. `touch` is the distance from rest beyond which the whisker
    /// touches.
    ///
    /// # Errors
    /// [`Error::Value`] if the contacts do not determine it.
    pub(super) fn fitted(path: &Path, mapped: &ReadingColumn, known: &Known, touch: f64) -> Result<Self, Error> {
        let degree = mapped.degree.unwrap_or(DEGREE);
        let Known { recordings, contacts, pairs } = known;
        let missing = |found: String, expected: String| Error::value(path, KEY, found, expected);
        check_known_contacts(path, KEY, *recordings, *contacts, touch)?;
        let mut characteristic = Characteristic::fit(degree, pairs).ok_or_else(|| {
            let found = format!(
                "none, and {} of {contacts} contacts of the calibration within reach of the whisker",
                pairs.len()
            );
            let advice = if 2 * pairs.len() < *contacts {
                "compare units, `base`, `contact` and `face` of the mapping"
            } else {
                "compare `contact`, `base`, `face`, `whisker`, `rest_s` and `touch` of the mapping with the recordings and \
                look for saturated or delayed readings"
            };
            let expected = format!(
                "contacts that determine a monotone characteristic of degree {degree}; {advice}; otherwise state a smaller \
                `degree` or the characteristic"
            );
            missing(found, expected)
        })?;
        let squares: f64 =
            pairs.iter().map(|(moment_n_m, reading)| (reading - characteristic.counts(*moment_n_m)).powi(2)).sum();
        characteristic.coefficients.resize(DEGREE, 0.0);
        Ok(Self { characteristic, residual: (squares / pairs.len() as f64).sqrt() })
    }

    /// Coefficients as stored in a sidecar.
    pub(super) fn coefficients(&self) -> [f64; 3] {
        std::array::from_fn(|power| self.characteristic.coefficients[power])
    }
}
