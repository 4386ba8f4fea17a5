//! Unwrapping of 16-bit counts.

/// Unwrapped counts of one axis: of the values that are congruent modulo 2^16, each sample is the one nearest to its predecessor.
///
/// This is correct if successive samples differ by less than 32768 counts. A single outlier does not affect later samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unwrapped {
    last: Option<i64>,
}

impl Unwrapped {
    /// Unwrapped value of the next sample.
    pub fn step(&mut self, counts: u16) -> i64 {
        let next = match self.last {
            None => i64::from(counts),
            // The difference modulo 2^16, from -2^15 to 2^15 - 1.
            Some(last) => last + i64::from(counts.wrapping_sub(last as u16) as i16),
        };
        self.last = Some(next);
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_ramp_over_the_border_and_back_is_continuous() {
        let ramp = (0..200_000).step_by(321).chain((-200_000..200_000).step_by(777).map(|value: i64| -value));
        let mut unwrapped = Unwrapped::default();
        let mut jump = None;
        for value in ramp {
            let found = unwrapped.step(value as u16);
            let offset = *jump.get_or_insert(found - value);
            assert_eq!(found - value, offset, "at {value}");
        }
    }

    #[test]
    fn robust_an_outlier_does_not_affect_later_samples() {
        for wild in [0, 20_000, 27_233, 40_000, 65_535] {
            let mut unwrapped = Unwrapped::default();
            assert_eq!(unwrapped.step(60_000), 60_000);
            unwrapped.step(wild);
            assert_eq!(unwrapped.step(60_000), 60_000, "after {wild}");
        }
    }
}
