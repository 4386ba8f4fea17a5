//! Counts of 16 bits that wrap around.

/// Counts of one axis, made continuous: each sample is taken for the value nearest to the last one among those that its 16 bits can mean.
///
/// That is right as long as no two successive samples lie 32768 counts or more apart. A single wild sample leaves no trace: the next one is
/// as near to it as it was to the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unwrapped {
    last: Option<i64>,
}

impl Unwrapped {
    /// Takes the next sample and gives its continuous value.
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
    fn robust_a_single_wild_sample_leaves_no_trace() {
        for wild in [0, 20_000, 27_233, 40_000, 65_535] {
            let mut unwrapped = Unwrapped::default();
            assert_eq!(unwrapped.step(60_000), 60_000);
            unwrapped.step(wild);
            assert_eq!(unwrapped.step(60_000), 60_000, "after {wild}");
        }
    }
}
