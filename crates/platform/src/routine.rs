//! The ruler's way: at a number of places along the whisker, away from it, along it, against it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::printer::{Head, Printer};
use crate::{Error, range, rig};

/// Most stops on the way of a push, and most steps between places: far more than millimetres need.
const MOST_INCREMENTS: u32 = 1000;

/// Rest before a push: the whisker's ringing of the last one is over, and the recording shows what rest looks like.
const REST: Duration = Duration::from_secs(1);

/// The routine `increments_beam_test` of the OpenWhisker platform. The documented call is `{6, 100, 0, 15, 0}`: 16 places from 5 to 105 mm from the
/// tip, at each a push of 6 mm.
///
/// It differs from the published controller where that errs: with `increments_x` stops on the way the last push is `total_x_m`, as documented,
/// not a step more; a push counts from where the ruler meets the whisker, not from where the nozzle does, 3 mm apart; and each move is
/// known to have ended before the next begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncrementsBeamTest {
    /// How far the whisker is pushed.
    pub total_x_m: f64,
    /// How far the places reach along the whisker, from the first one on towards the root.
    pub total_y_m: f64,
    /// Stops on the way of a push before its end.
    pub increments_x: u32,
    /// Steps between the first place and the last.
    pub increments_y: u32,
    /// How long the ruler rests at each stop.
    pub pause: Duration,
    /// Speed of the head.
    pub speed_m_s: f64,
}

impl Default for IncrementsBeamTest {
    fn default() -> Self {
        Self {
            total_x_m: 0.006,
            total_y_m: 0.100,
            increments_x: 0,
            increments_y: 15,
            pause: Duration::ZERO,
            speed_m_s: rig::SPEED_M_S,
        }
    }
}

/// A push against the whisker, as far as the printer knows. The whisker was touched within these times, and not outside.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// When the ruler began to move towards the whisker.
    pub start_s: f64,
    /// When it was back.
    pub end_s: f64,
    /// Where it pushed, from the whisker's root along the undeflected whisker.
    pub distance_m: f64,
    /// How far.
    pub push_m: f64,
}

/// Who is told what happens.
pub trait Observer {
    /// Where the head was.
    ///
    /// # Errors
    /// What it cannot bear ends the routine.
    fn head(&mut self, head: Head) -> Result<(), Error>;

    /// A push is over.
    ///
    /// # Errors
    /// What it cannot bear ends the routine.
    fn contact(&mut self, contact: Contact) -> Result<(), Error>;
}

impl IncrementsBeamTest {
    /// Distances from the root at which it pushes, in their order.
    pub fn distances_m(&self) -> Vec<f64> {
        let step_m = self.total_y_m / f64::from(self.increments_y.max(1));
        let first_m = rig::WHISKER_LENGTH_M - rig::FIRST_TOUCH_M;
        (0..=self.increments_y).map(|place| first_m - f64::from(place) * step_m).collect()
    }

    /// How far the ruler goes at each place, stop by stop.
    pub fn pushes_m(&self) -> Vec<f64> {
        let stops = self.increments_x + 1;
        (1..=stops).map(|stop| self.total_x_m * f64::from(stop) / f64::from(stops)).collect()
    }

    /// Checks that the ruler may go this way.
    ///
    /// # Errors
    /// [`Error::Range`] names what is out of its range.
    pub fn check(&self) -> Result<(), Error> {
        for (what, increments) in [("increments_x", self.increments_x), ("increments_y", self.increments_y)] {
            if increments > MOST_INCREMENTS {
                let (found, expected) = (increments.to_string(), format!("0 to {MOST_INCREMENTS}"));
                return Err(Error::Range { what: what.into(), found, expected });
            }
        }
        let first_y_m = rig::nozzle_y_m(rig::WHISKER_LENGTH_M - rig::FIRST_TOUCH_M);
        range::check_length("total_x_distance", self.total_x_m, [0.0, rig::BED_X_M[1] - rig::nozzle_x_m(0.0)])?;
        range::check_length("total_y_distance", self.total_y_m, [0.0, rig::BED_Y_M[1] - first_y_m])?;
        range::check_speed("speed", self.speed_m_s, rig::SPEEDS_M_S)
    }

    /// Homes the printer and goes the way. Times are counted from `origin`. Between two pushes it ends early, without an error, once `ends` is set.
    ///
    /// # Errors
    /// If the way is not allowed, or the printer fails.
    pub fn run(
        &self,
        printer: &mut Printer,
        origin: Instant,
        ends: &AtomicBool,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        self.check()?;
        let clear_x_m = rig::nozzle_x_m(-rig::PADDING_M);
        let distances_m = self.distances_m();
        // In front of the tip there is nothing to hit on the way to the whisker's left.
        let front_y_m = rig::nozzle_y_m(rig::WHISKER_LENGTH_M) - rig::PADDING_M;
        printer.show("Homing")?;
        printer.home()?;
        let mut at_m = [0.0, front_y_m];
        let go = |printer: &mut Printer, goal_m: [f64; 2], observer: &mut dyn Observer| {
            printer.move_to(goal_m, self.speed_m_s, &mut |head| observer.head(head))
        };
        go(printer, at_m, observer)?;
        at_m[0] = clear_x_m;
        go(printer, at_m, observer)?;
        for (place, distance_m) in distances_m.iter().enumerate() {
            if ends.load(Ordering::Relaxed) {
                return Ok(());
            }
            printer.show(&format!("Place {} of {}", place + 1, distances_m.len()))?;
            let y_m = rig::nozzle_y_m(*distance_m);
            go(printer, [clear_x_m, y_m], observer)?;
            printer.rest(REST)?;
            let start_s = origin.elapsed().as_secs_f64();
            for push_m in self.pushes_m() {
                go(printer, [rig::nozzle_x_m(push_m), y_m], observer)?;
                printer.rest(self.pause)?;
            }
            go(printer, [clear_x_m, y_m], observer)?;
            let end_s = origin.elapsed().as_secs_f64();
            observer.contact(Contact { start_s, end_s, distance_m: *distance_m, push_m: self.total_x_m })?;
        }
        printer.rest(REST)?;
        go(printer, [clear_x_m, front_y_m], observer)?;
        printer.show("Done")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_documented_call_has_sixteen_places() {
        let test = IncrementsBeamTest::default();
        let distances_m = test.distances_m();
        assert_eq!(distances_m.len(), 16);
        assert!((distances_m[0] - 0.145).abs() < 1e-12 && (distances_m[15] - 0.045).abs() < 1e-12);
        assert_eq!(test.pushes_m(), [0.006]);
        test.check().expect("allowed");
    }

    #[test]
    fn verif_stops_on_the_way_do_not_add_to_it() {
        // As documented: 9 mm with two increments stops at 3, 6 and 9 mm.
        let test = IncrementsBeamTest { total_x_m: 0.009, increments_x: 2, ..Default::default() };
        let pushes_m = test.pushes_m();
        assert_eq!(pushes_m.len(), 3);
        assert!(pushes_m.iter().zip([0.003, 0.006, 0.009]).all(|(found, expected)| (found - expected).abs() < 1e-12));
    }

    #[test]
    fn robust_ways_out_of_the_bed_are_refused() {
        for (test, what) in [
            (IncrementsBeamTest { total_y_m: 0.114, ..Default::default() }, "total_y_distance"),
            (IncrementsBeamTest { total_x_m: f64::NAN, ..Default::default() }, "total_x_distance"),
            (IncrementsBeamTest { total_x_m: -0.001, ..Default::default() }, "total_x_distance"),
            (IncrementsBeamTest { speed_m_s: 0.0, ..Default::default() }, "speed"),
            (IncrementsBeamTest { increments_x: u32::MAX, ..Default::default() }, "increments_x: found 4294967295"),
            (
                IncrementsBeamTest { increments_y: 1001, ..Default::default() },
                "increments_y: found 1001, expected 0 to 1000",
            ),
        ] {
            assert!(test.check().expect_err("refused").to_string().starts_with(what));
        }
    }
}
