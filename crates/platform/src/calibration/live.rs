//! Live inference: distances while samples stream in.

use super::{Calibration, Error, Estimate, Event, Press, Presses};
use crate::Sample;

/// What a sample tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detection {
    /// The whisker was pressed, there; no estimate where the press is unlike those of the calibration.
    Pressed(Press, Option<Estimate>),
    /// It was let go at this time.
    Released(f64),
}

/// A calibration at work on one stream. It is the pipeline that the calibration was fitted with, bit for bit.
#[derive(Debug)]
pub struct Live<'a> {
    calibration: &'a Calibration,
    presses: Presses,
}

impl<'a> Live<'a> {
    /// A stream that has not begun; none where the calibration came from a table and does not know what a press looks like in samples.
    ///
    /// # Errors
    /// Where the calibration's low-pass does not fit its rate.
    pub fn new(calibration: &'a Calibration) -> Result<Option<Self>, Error> {
        let Some(chain) = calibration.chain() else { return Ok(None) };
        Ok(Some(Self { calibration, presses: Presses::new(chain)? }))
    }

    /// Takes the next sample.
    pub fn step(&mut self, sample: &Sample) -> Option<Detection> {
        Some(match self.presses.step(sample)? {
            Event::Pressed(press) => Detection::Pressed(press, self.calibration.estimate(&press.features)),
            Event::Released(t_s) => Detection::Released(t_s),
        })
    }
}
