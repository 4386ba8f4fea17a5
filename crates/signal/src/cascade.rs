//! Digital filters as cascades of second-order sections, evaluated sample by sample.

/// One second-order section, `H(z) = (b0 + b1 / z + b2 / z^2) / (1 + a1 / z + a2 / z^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Numerator `b0, b1, b2`.
    pub b: [f64; 3],
    /// Denominator without its leading one: `a1, a2`.
    pub a: [f64; 2],
}

/// A cascade of sections with their states (direct form II transposed), initially zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Cascade {
    sections: Vec<Section>,
    memory: Vec<[f64; 2]>,
}

impl Cascade {
    /// A cascade of sections; without any, the output equals the input.
    pub fn new(sections: Vec<Section>) -> Self {
        let memory = vec![[0.0; 2]; sections.len()];
        Self { sections, memory }
    }

    /// The sections.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Takes the next sample and returns the filtered one.
    pub fn step(&mut self, input: f64) -> f64 {
        let mut value = input;
        for (Section { b, a }, memory) in self.sections.iter().zip(&mut self.memory) {
            let output = b[0] * value + memory[0];
            memory[0] = b[1] * value - a[0] * output + memory[1];
            memory[1] = b[2] * value - a[1] * output;
            value = output;
        }
        value
    }

    /// Sets the states to those after a constant input `input`, so that the filter starts without a transient.
    pub fn settle(&mut self, input: f64) {
        let mut value = input;
        for (Section { b, a }, memory) in self.sections.iter().zip(&mut self.memory) {
            let output = value * b.iter().sum::<f64>() / (1.0 + a[0] + a[1]);
            *memory = [output - b[0] * value, b[2] * value - a[1] * output];
            value = output;
        }
    }

    /// Gain of white noise: the standard deviation of the output if the input is white noise of unit standard
    /// deviation, averaged over `mean_over` samples. It is the root of the sum of squares of the impulse response.
    pub fn noise_gain(&self, mean_over: usize) -> f64 {
        const MOST_SAMPLES: usize = 1_000_000;
        let mut filter = Self::new(self.sections.clone());
        let mut sum = 0.0;
        for sample in 0..MOST_SAMPLES {
            let pulse = if sample < mean_over { 1.0 / mean_over as f64 } else { 0.0 };
            sum += filter.step(pulse).powi(2);
            let left = filter.memory.iter().flatten().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            if sample >= mean_over && left < 1e-9 * sum.sqrt() {
                break;
            }
        }
        sum.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn low_pass() -> Cascade {
        Cascade::new(vec![
            Section { b: [0.2, 0.1, 0.05], a: [-0.9, 0.3] },
            Section { b: [1.0, -0.5, 0.2], a: [-0.4, 0.1] },
        ])
    }

    #[test]
    fn verif_a_settled_filter_multiplies_a_constant_by_its_gain() {
        let mut filter = low_pass();
        filter.settle(3.0);
        let gain = 0.35 / 0.4 * 0.7 / 0.7;
        for _ in 0..50 {
            assert!((filter.step(3.0) - 3.0 * gain).abs() < 1e-13);
        }
    }

    #[test]
    fn verif_noise_gain_of_a_first_order_smoother() {
        // y += g (x - y) has the noise gain sqrt(g / (2 - g)).
        let g = 0.1;
        let smoother = Cascade::new(vec![Section { b: [g, 0.0, 0.0], a: [g - 1.0, 0.0] }]);
        assert!((smoother.noise_gain(1) - (g / (2.0 - g)).sqrt()).abs() < 1e-9);
        assert!((Cascade::new(Vec::new()).noise_gain(4) - 0.5).abs() < 1e-12);
    }
}
