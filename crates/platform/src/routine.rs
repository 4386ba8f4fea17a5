//! The calibration routine: the ruler pushes the whisker at several places along it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::printer::{Head, Printer};
use crate::{Error, range, rig};

/// Upper bound of the stops of a push and of the steps between places.
const MOST_INCREMENTS: u32 = 1000;

/// Rest before a push: the ringing of the last one decays, and the recording contains the rest level.
const REST: Duration = Duration::from_secs(1);

/// The routine `increments_beam_test` of the OpenWhisker platform. The documented call is `{6, 100, 0, 15, 0}`: 16 places from 5 to 105 mm from the
/// tip, at each a push of 6 mm.
///
/// Errors of the published controller are corrected: with `increments_x` stops the last push is `total_x_m`, as documented, not one step more; a push is measured
/// from first contact of the ruler, not of the nozzle, 3 mm apart; and each move has ended before the next begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncrementsBeamTest {
    /// Depth of a push (m).
    pub total_x_m: f64,
    /// Distance from the first place to the last, towards the root (m).
    pub total_y_m: f64,
    /// Number of stops of a push before its end.
    pub increments_x: u32,
    /// Number of steps from the first place to the last.
    pub increments_y: u32,
    /// Rest at each stop.
    pub pause: Duration,
    /// Speed of the head (m/s).
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

/// A push against the whisker, by the printer's positions. The whisker was in contact only between these times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Start of the move towards the whisker (s).
    pub start_s: f64,
    /// End of the move back (s).
    pub end_s: f64,
    /// Distance from the whisker's root along the undeflected whisker (m).
    pub distance_m: f64,
    /// Depth of the push (m).
    pub push_m: f64,
}

/// Observer of a routine.
pub trait Observer {
    /// Position of the head at a time.
    ///
    /// # Errors
    /// An error ends the routine.
    fn head(&mut self, head: Head) -> Result<(), Error>;

    /// End of a push.
    ///
    /// # Errors
    /// An error ends the routine.
    fn contact(&mut self, contact: Contact) -> Result<(), Error>;
}

impl IncrementsBeamTest {
    /// Distances of the places from the root, in their order (m).
    pub fn distances_m(&self) -> Vec<f64> {
        let step_m = self.total_y_m / f64::from(self.increments_y.max(1));
        let first_m = rig::WHISKER_LENGTH_M - rig::FIRST_TOUCH_M;
        (0..=self.increments_y).map(|place| first_m - f64::from(place) * step_m).collect()
    }

    /// Depth at each stop of a push (m).
    pub fn pushes_m(&self) -> Vec<f64> {
        let stops = self.increments_x + 1;
        (1..=stops).map(|stop| self.total_x_m * f64::from(stop) / f64::from(stops)).collect()
    }

    /// Checks that all positions and speeds are allowed.
    ///
    /// # Errors
    /// [`Error::Range`] names the value out of range.
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

    /// Homes the printer and performs the routine. Times are counted from `origin`. If `ends` is set, the routine ends before the next push, without an error.
    ///
    /// # Errors
    /// If a position or speed is not allowed, or the printer fails.
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
        // The path to the whisker's left side passes in front of the tip, free of obstacles.
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
    fn verif_stops_do_not_change_the_depth_of_a_push() {
        // As documented: 9 mm with two increments stops at 3, 6 and 9 mm.
        let test = IncrementsBeamTest { total_x_m: 0.009, increments_x: 2, ..Default::default() };
        let pushes_m = test.pushes_m();
        assert_eq!(pushes_m.len(), 3);
        assert!(pushes_m.iter().zip([0.003, 0.006, 0.009]).all(|(found, expected)| (found - expected).abs() < 1e-12));
    }

    #[test]
    fn robust_positions_outside_the_bed_are_refused() {
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
