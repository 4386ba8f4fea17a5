//! Conversion of readings to moments: the characteristic of a sensor with one channel.

use std::path::Path;

use files::Error;
use trace::Characteristic;

use super::mapping::ReadingColumn;
use crate::own::rest::check_known_contacts;
use crate::own::units::{Reading, Unit};
use crate::own::{Agreement, Remark};

/// Key of the mapping that states the characteristic.
const KEY: &str = "reading.characteristic";

/// Degree of a fitted characteristic if the mapping states none.
const DEGREE: usize = 3;

/// Share of the moment at which a characteristic turns up to which it is inverted.
const INSIDE: f64 = 0.999;

/// Known contacts of the calibration.
pub(super) struct Known {
    /// Number of recordings with the role `calibration`.
    pub(super) recordings: usize,
    /// Number of contacts.
    pub(super) contacts: usize,
    /// Moment by the elastica (N m) and reading relative to rest, of the contacts within reach of the whisker.
    pub(super) pairs: Vec<(f64, f64)>,
}

impl Known {
    /// Remark about the agreement of the calibration with the elastica. `residual` is the RMS of the residuals over that of the
    /// readings.
    fn remark(&self, residual: f64) -> Remark {
        let unreached = self.contacts - self.pairs.len();
        let agreement = Agreement { residual, contacts: self.contacts, unreached, weak: 0 };
        agreement.remark(
            "the elastica",
            "",
            "compare `whisker`, `base`, `contact` and `face` of the mapping with the recordings, and look for saturated, drifting or \
             delayed readings",
        )
    }
}

/// Conversion from readings relative to rest to moments.
#[derive(Clone, Debug)]
pub(super) struct Conversion {
    pub(super) characteristic: Characteristic,
    pub(super) residual: f64,
    /// Agreement of the calibration with the mechanics of the whisker. `None` if the characteristic was not fitted.
    pub(super) remark: Option<Remark>,
}

impl Conversion {
    /// Conversion by the unit or by the stated characteristic. `None` if it must be fitted. `largest` is the largest
    /// reading relative to rest, `extremes` are the smallest and the largest one.
    ///
    /// # Errors
    /// [`Error::Value`] if the stated characteristic is not invertible over the readings.
    pub(super) fn stated(
        path: &Path,
        mapped: &ReadingColumn,
        largest: f64,
        extremes: [f64; 2],
    ) -> Result<Option<Self>, Error> {
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
        let characteristic = extended(path, characteristic, extremes)?;
        Ok(Some(Self { characteristic, residual: 0.0, remark: None }))
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
        let rms = |squares: f64| (squares / pairs.len() as f64).sqrt();
        let share = rms(squares) / rms(pairs.iter().map(|(_, reading)| reading.powi(2)).sum());
        Ok(Self { characteristic, residual: rms(squares), remark: Some(known.remark(share)) })
    }

    /// Coefficients as stored in a sidecar.
    pub(super) fn coefficients(&self) -> [f64; 3] {
        std::array::from_fn(|power| self.characteristic.coefficients[power])
    }
}

/// Characteristic whose range contains the moments of the smallest and the largest reading relative to rest. The range is that of
/// the given one where it suffices.
///
/// # Errors
/// [`Error::Value`] if the characteristic turns before a reading is reached.
fn extended(path: &Path, characteristic: Characteristic, extremes: [f64; 2]) -> Result<Characteristic, Error> {
    let mut range_n_m = characteristic.range_n_m;
    let first = characteristic.coefficients[0];
    for reading in extremes {
        let sign = (reading / first).signum();
        let end_n_m = &mut range_n_m[usize::from(sign > 0.0)];
        let is_reached = |moment_n_m: f64| characteristic.counts(moment_n_m) / reading >= 1.0;
        if reading == 0.0 || is_reached(*end_n_m) {
            continue;
        }
        let turn_n_m = sign * turn_n_m(&characteristic, sign);
        if turn_n_m.is_finite() && !is_reached(turn_n_m) {
            let most = characteristic.counts(turn_n_m);
            let [(found, than), (extreme, of)] = match reading > 0.0 {
                true => [("maximum", "at least"), ("largest", "above")],
                false => [("minimum", "at most"), ("smallest", "below")],
            };
            let expected = format!("{than} the {extreme} reading, {reading:.0} ({of} rest)");
            return Err(Error::value(path, KEY, format!("a {found} of {most:.0} counts"), expected));
        }
        let (mut low_n_m, mut high_n_m) = (*end_n_m, turn_n_m);
        if !high_n_m.is_finite() {
            high_n_m = *end_n_m;
            while !is_reached(high_n_m) {
                high_n_m *= 2.0;
            }
        }
        for _ in 0..60 {
            let middle_n_m = 0.5 * (low_n_m + high_n_m);
            if is_reached(middle_n_m) { high_n_m = middle_n_m } else { low_n_m = middle_n_m }
        }
        *end_n_m = if turn_n_m.is_finite() { sign * high_n_m.abs().min(INSIDE * turn_n_m.abs()) } else { high_n_m };
    }
    Ok(Characteristic::new(characteristic.coefficients.clone(), range_n_m).unwrap_or(characteristic))
}

/// Magnitude of the moment of this sign at which the slope `c1 + 2 c2 M + 3 c3 M^2` vanishes first. Infinite if there is none.
fn turn_n_m(characteristic: &Characteristic, sign: f64) -> f64 {
    let [c1, c2, c3] = std::array::from_fn(|power| characteristic.coefficients[power]);
    let (square, half, constant) = (3.0 * c3, sign * c2, c1);
    // The stable solutions of `square M^2 + 2 half M + constant = 0`; without a square, the second one is that of the line.
    let discriminant = half * half - square * constant;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    let sum = -(half + discriminant.sqrt().copysign(half));
    [sum / square, constant / sum]
        .into_iter()
        .filter(|root| root.is_finite() && *root > 0.0)
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Characteristic over the range that a reading of this size would have if it were linear.
    fn over(coefficients: [f64; 3], most_n_m: f64) -> Characteristic {
        Characteristic::new(coefficients.to_vec(), [-most_n_m, most_n_m]).unwrap()
    }

    #[test]
    fn verif_a_stated_characteristic_is_inverted_over_all_readings() {
        let path = Path::new("import.json");
        // Monotone above -0.5 N m.
        let bent = || over([1000.0, 1000.0, 0.0], 0.4);
        let found = extended(path, bent(), [-200.0, 6000.0]).unwrap();
        assert_eq!(found.range_n_m[0], -0.4);
        for moment_n_m in [-0.25, 0.3, 1.0, 1.9] {
            assert!((found.moment_n_m(found.counts(moment_n_m)) - moment_n_m).abs() < 1e-12, "{moment_n_m}");
        }
        assert_eq!(extended(path, bent(), [-200.0, 500.0]).unwrap(), bent());
        // A cubic has two turns.
        let cubic = over([-900.0, 0.0, 300.0], 0.5);
        let found = extended(path, cubic.clone(), [-590.0, 590.0]).unwrap();
        let error_n_m = found.moment_n_m(found.counts(0.85)) - 0.85;
        assert!(error_n_m.abs() < 1e-12 && found.range_n_m[1] < 1.0, "{found:?}");
        let error = extended(path, cubic, [-100.0, 1480.0]).unwrap_err().to_string();
        let words = "reading.characteristic: found a maximum of 600 counts, expected at least the largest reading, 1480 (above rest)";
        assert_eq!(error, format!("import.json: {words}"));
        let error = extended(path, bent(), [-251.0, 10.0]).unwrap_err().to_string();
        assert!(
            error.ends_with("a minimum of -250 counts, expected at most the smallest reading, -251 (below rest)"),
            "{error}"
        );
    }
}
