//! Correlation length of the errors of a sensor model along the path of a contact.

use super::error::{Residual, exponential};

/// Smallest and largest correlation length (m), and the number of lengths that are compared, evenly spaced in their logarithms.
const RANGE_M: [f64; 2] = [0.2e-3, 20e-3];
const COMPARED: usize = 60;

/// Correlation length (m) if the calibration does not determine it.
const DEFAULT_M: f64 = 5e-3;

/// Correlation of the errors at two contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correlation {
    /// Distance of the contacts (m).
    pub distance_m: f64,
    /// Correlation of the errors of both readings together, between -1 and 1.
    pub value: f64,
}

/// Correlations of all pairs of errors of one line: `2 a.b / (a.a + b.b)`, which is bounded, so that single large errors do not
/// dominate.
pub(super) fn of_residuals(lines: &[Vec<Residual>]) -> Vec<Correlation> {
    let pairs = lines.iter().flat_map(|line| {
        line.iter().enumerate().flat_map(|(i, one)| line[i + 1..].iter().map(move |other| (one, other)))
    });
    pairs
        .filter_map(|(one, other)| {
            let size = 0.5 * (one.error_n_m.norm_squared() + other.error_n_m.norm_squared());
            let value = one.error_n_m.dot(&other.error_n_m) / size;
            (size > 0.0).then(|| Correlation { distance_m: one.contact.distance(&other.contact), value })
        })
        .collect()
}

/// Correlation length (m) of the exponential covariance function that is the least-squares fit to these correlations.
/// [`DEFAULT_M`] if there are none.
pub(super) fn length_m(pairs: &[Correlation]) -> f64 {
    let misfit = |length_m: f64| -> f64 {
        pairs.iter().map(|pair| (exponential(pair.distance_m, length_m) - pair.value).powi(2)).sum()
    };
    let [least_m, most_m] = RANGE_M;
    let lengths = (0..COMPARED).map(|i| least_m * (most_m / least_m).powf(i as f64 / (COMPARED - 1) as f64));
    let scored = lengths.map(|length_m| (length_m, misfit(length_m)));
    if pairs.is_empty() {
        return DEFAULT_M;
    }
    scored.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(DEFAULT_M, |(length_m, _)| length_m)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::space::frames::Point;
    use crate::space::sensor::Around;

    fn residual(along_m: f64, error_n_m: Vector2<f64>) -> Residual {
        Residual {
            contact: Point::new(along_m, 0.0, 0.0),
            at: Around::new(along_m, 0.0, 0.0),
            error_n_m,
            sd_n_m: Vector2::zeros(),
            noise_n2_m2: 0.0,
        }
    }

    /// Waves whose lengths and phases differ from line to line, with errors that grow along each line.
    #[test]
    fn verif_the_length_scales_with_the_errors() {
        let lines = |scale: f64| -> Vec<Vec<_>> {
            let line = |i: i32| {
                let (phase, rate) = (2.4 * f64::from(i), 0.6 + 0.8 * (0.618 * f64::from(i)).fract());
                let sample = |step: i32| {
                    let along_m = 0.5e-3 * f64::from(step);
                    let angle = phase + rate * along_m / (scale * 1e-3);
                    let error = Vector2::new(angle.sin(), (1.7 * angle).cos()) * (1.0 + 100.0 * along_m);
                    residual(along_m, error)
                };
                (0..30).map(sample).collect()
            };
            (0..80).map(line).collect()
        };
        let [short_m, long_m] = [1.0, 2.0].map(|scale| length_m(&of_residuals(&lines(scale))));
        assert!((0.3e-3..3e-3).contains(&short_m), "{short_m}");
        assert!((1.6..2.5).contains(&(long_m / short_m)), "{long_m} {short_m}");
    }

    #[test]
    fn robust_single_contacts_have_the_default_length() {
        let line = || vec![residual(0.03, Vector2::new(1.0, 0.0))];
        assert_eq!(length_m(&of_residuals(&[line(), line()])), DEFAULT_M);
        assert_eq!(length_m(&[]), DEFAULT_M);
    }
}
