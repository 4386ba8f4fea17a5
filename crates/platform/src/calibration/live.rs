//! Live inference: radial distances from a stream of samples.

use super::{Calibration, Error, Estimate, Event, Press, Presses};
use crate::Sample;

/// Event that a sample completes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detection {
    /// A press, and the estimate of its distance. `None` outside the calibrated domain.
    Pressed(Press, Option<Estimate>),
    /// The release, at this time (s).
    Released(f64),
}

/// Live inference on one stream, by the same code as the fit, bit for bit.
#[derive(Debug)]
pub struct Live<'a> {
    calibration: &'a Calibration,
    presses: Presses,
}

impl<'a> Live<'a> {
    /// Inference at the start of a stream. `None` if the calibration was fitted to a table of presses and has no chain.
    ///
    /// # Errors
    /// If the edge of the calibration's low-pass is not below half its rate.
    pub fn new(calibration: &'a Calibration) -> Result<Option<Self>, Error> {
        let Some(chain) = calibration.chain() else { return Ok(None) };
        Ok(Some(Self { calibration, presses: Presses::new(chain)? }))
    }

    /// Processes the next sample.
    pub fn step(&mut self, sample: &Sample) -> Option<Detection> {
        Some(match self.presses.step(sample)? {
            Event::Pressed(press) => Detection::Pressed(press, self.calibration.estimate(&press.features)),
            Event::Released(t_s) => Detection::Released(t_s),
        })
    }
}
