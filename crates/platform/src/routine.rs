//! The calibration routine: the ruler pushes the whisker at several places along it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::printer::{Head, Printer};
use crate::rig::{Limit, Rig};
use crate::{Error, range};

/// Upper bound of the stops of a push and of the steps between places.
const MOST_INCREMENTS: u32 = 1000;
/// Upper bound of the stops of a routine.
const MOST_STOPS: u64 = 10_000;
/// Longest pause at a stop.
const MOST_PAUSE: Duration = Duration::from_secs(60);

/// Rest before a push: the ringing of the last one decays, and the recording contains the rest level.
const REST: Duration = Duration::from_secs(1);

/// The routine `increments_beam_test` of the OpenWhisker platform. The documented call is `{6, 100, 0, 15, 0}`: 16
/// places from 5 to 105 mm from the tip, at each a push of 6 mm.
///
/// Errors of the published controller are corrected: with `increments_x` stops the last push is `total_x_m`, as
/// documented, not one step more; a push is measured from first contact of the ruler, not of the nozzle, 3 mm apart;
/// and each move has ended before the next begins.
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
            speed_m_s: 2.0 / 60.0,
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

/// Whether a push may exceed the [largest push](crate::rig::LargestPushes) of the whisker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overload {
    /// Such a routine is refused.
    Refused,
    /// Such a routine is allowed.
    Allowed,
}

/// A routine whose positions and speeds are allowed on a rig.
#[derive(Clone, Debug)]
pub struct Plan<'a> {
    routine: IncrementsBeamTest,
    rig: &'a Rig,
    distances_m: Vec<f64>,
    pushes_m: Vec<f64>,
}

impl IncrementsBeamTest {
    /// The routine on a rig, after a check of its positions, speeds and duration.
    ///
    /// # Errors
    /// [`Error::Range`] names the value out of range; [`Error::Overload`] the place with the smallest largest push.
    pub fn on<'a>(&self, rig: &'a Rig, overload: Overload) -> Result<Plan<'a>, Error> {
        for (what, increments) in [("increments_x", self.increments_x), ("increments_y", self.increments_y)] {
            if increments > MOST_INCREMENTS {
                return Err(Error::range(what, increments, format!("0 to {MOST_INCREMENTS}")));
            }
        }
        let stops = u64::from(self.increments_x + 1) * u64::from(self.increments_y + 1);
        if stops > MOST_STOPS {
            let expected = format!("at most {MOST_STOPS}: choose smaller increments_x or increments_y");
            return Err(Error::range("stops of the routine", stops, expected));
        }
        if self.pause > MOST_PAUSE {
            let (found, most) = (self.pause.as_secs_f64(), MOST_PAUSE.as_secs());
            return Err(Error::range("pause", format!("{found} s"), format!("0 to {most} s")));
        }
        let first_m = rig.first_distance_m();
        // The last place is neither behind the bed nor at the root, even if an overload is allowed.
        let most_y_m = (rig.bed.y_m[1] - rig.nozzle_y_m(first_m)).min(first_m - rig.least_distance_m());
        range::check_length("total_x_distance", self.total_x_m, [0.0, rig.bed.x_m[1] - rig.nozzle_x_m(0.0)])?;
        range::check_length("total_y_distance", self.total_y_m, [0.0, most_y_m])?;
        range::check_speed("speed", self.speed_m_s, rig.bed.speeds_m_s())?;
        let step_m = self.total_y_m / f64::from(self.increments_y.max(1));
        let distances_m: Vec<f64> = (0..=self.increments_y).map(|place| first_m - f64::from(place) * step_m).collect();
        if overload == Overload::Refused {
            check_load(rig, &distances_m, self.total_x_m)?;
        }
        let stops = self.increments_x + 1;
        let pushes_m = (1..=stops).map(|stop| self.total_x_m * f64::from(stop) / f64::from(stops)).collect();
        Ok(Plan { routine: *self, rig, distances_m, pushes_m })
    }
}

/// Checks that the whisker withstands a push at every place.
fn check_load(rig: &Rig, distances_m: &[f64], push_m: f64) -> Result<(), Error> {
    let pushes = rig.shaft.largest_pushes();
    let bearable = distances_m.iter().map(|&distance_m| (distance_m, pushes.at(distance_m)));
    let weakest = bearable.min_by(|(_, a), (_, b)| a.push_m.total_cmp(&b.push_m));
    let Some((distance_m, most)) = weakest.filter(|(_, most)| push_m > most.push_m) else { return Ok(()) };
    let reason = match most.limit {
        Limit::Strain => {
            format!("where the whisker is strained by {} %", range::shown(100.0 * rig.shaft.largest_strain))
        }
        Limit::Angle => "where the whisker slips along the ruler".into(),
        Limit::Length => {
            format!("where the ruler slips off the whisker of {} mm", range::shown(1e3 * rig.shaft.length_m))
        }
    };
    Err(Error::Overload { push_m, most_m: most.push_m, distance_m, reason })
}

impl Plan<'_> {
    /// Distances of the places from the root, in their order (m).
    pub fn distances_m(&self) -> &[f64] {
        &self.distances_m
    }

    /// Depth at each stop of a push (m).
    pub fn pushes_m(&self) -> &[f64] {
        &self.pushes_m
    }

    /// Homes the printer and performs the routine. Times are counted from `origin`. If `ends` is set, the routine ends
    /// before the next push, without an error.
    ///
    /// # Errors
    /// If the printer fails.
    pub fn run(
        &self,
        printer: &mut Printer,
        origin: Instant,
        ends: &AtomicBool,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let Self { routine, rig, distances_m, pushes_m } = self;
        let clear_x_m = rig.nozzle_x_m(-rig.routine.clearance_m);
        // The path to the whisker's left side passes in front of the tip, free of obstacles.
        let front_y_m = rig.front_y_m();
        printer.show("Homing")?;
        printer.home()?;
        let mut at_m = [0.0_f64.clamp(rig.bed.x_m[0], rig.bed.x_m[1]), front_y_m];
        let go = |printer: &mut Printer, goal_m: [f64; 2], observer: &mut dyn Observer| {
            printer.move_to(goal_m, routine.speed_m_s, &mut |head| observer.head(head))
        };
        go(printer, at_m, observer)?;
        at_m[0] = clear_x_m;
        go(printer, at_m, observer)?;
        for (place, distance_m) in distances_m.iter().enumerate() {
            if ends.load(Ordering::Relaxed) {
                return Ok(());
            }
            printer.show(&format!("Place {} of {}", place + 1, distances_m.len()))?;
            let y_m = rig.nozzle_y_m(*distance_m);
            go(printer, [clear_x_m, y_m], observer)?;
            printer.rest(REST)?;
            let start_s = origin.elapsed().as_secs_f64();
            for &push_m in pushes_m {
                go(printer, [rig.nozzle_x_m(push_m), y_m], observer)?;
                printer.rest(routine.pause)?;
            }
            go(printer, [clear_x_m, y_m], observer)?;
            let end_s = origin.elapsed().as_secs_f64();
            observer.contact(Contact { start_s, end_s, distance_m: *distance_m, push_m: routine.total_x_m })?;
        }
        printer.rest(REST)?;
        go(printer, [clear_x_m, front_y_m], observer)?;
        printer.show("Done")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(test: &IncrementsBeamTest) -> String {
        test.on(&Rig::built_in(), Overload::Refused).expect_err("refused").to_string()
    }

    #[test]
    fn verif_the_documented_call_has_sixteen_places() {
        let rig = Rig::built_in();
        let plan = IncrementsBeamTest::default().on(&rig, Overload::Refused).expect("allowed");
        let distances_m = plan.distances_m();
        assert_eq!(distances_m.len(), 16);
        assert!((distances_m[0] - 0.145).abs() < 1e-12 && (distances_m[15] - 0.045).abs() < 1e-12);
        assert_eq!(plan.pushes_m(), [0.006]);
    }

    #[test]
    fn verif_stops_do_not_change_the_depth_of_a_push() {
        // As documented: 9 mm with two increments stops at 3, 6 and 9 mm.
        let (rig, test) =
            (Rig::built_in(), IncrementsBeamTest { total_x_m: 0.009, increments_x: 2, ..Default::default() });
        let plan = test.on(&rig, Overload::Refused).expect("allowed");
        let pushes_m = plan.pushes_m();
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
            (
                IncrementsBeamTest { increments_x: 999, increments_y: 10, ..Default::default() },
                "stops of the routine: found 11000, expected at most 10000",
            ),
            (
                IncrementsBeamTest { pause: Duration::from_secs(61), ..Default::default() },
                "pause: found 61 s, expected 0 to 60 s",
            ),
        ] {
            let error = refused(&test);
            assert!(error.starts_with(what), "{error}");
        }
    }

    #[test]
    fn robust_a_place_at_the_root_is_refused_even_if_an_overload_is_allowed() {
        let mut rig = Rig::built_in();
        // So deep that it does not limit the places.
        rig.bed.y_m[1] = 1.0;
        let to = |total_y_m: f64| IncrementsBeamTest { total_y_m, ..Default::default() };
        for overload in [Overload::Refused, Overload::Allowed] {
            for total_y_m in [0.144, 0.145] {
                let error = to(total_y_m).on(&rig, overload).expect_err("refused").to_string();
                let found = 1e3 * total_y_m;
                assert_eq!(error, format!("total_y_distance: found {found} mm, expected 0 to 143.5 mm"));
            }
        }
        let plan = to(0.1435).on(&rig, Overload::Allowed).expect("allowed");
        assert!((plan.distances_m()[15] - 0.0015).abs() < 1e-12);
    }

    #[test]
    fn robust_errors_of_an_overload_state_rounded_numbers() {
        let mut rig = Rig::built_in();
        (rig.shaft.largest_strain, rig.shaft.length_m) = (0.029, 0.1501);
        let deep = IncrementsBeamTest { total_x_m: 0.100, ..Default::default() };
        let refused = |test: &IncrementsBeamTest| test.on(&rig, Overload::Refused).expect_err("refused").to_string();
        assert!(refused(&deep).contains("is strained by 2.9 %;"), "{}", refused(&deep));
        let at_the_tip = refused(&IncrementsBeamTest { total_y_m: 0.0, ..deep });
        assert!(at_the_tip.contains("slips off the whisker of 150.1 mm;"), "{at_the_tip}");
    }

    #[test]
    fn robust_a_push_that_the_whisker_does_not_bear_is_refused_unless_it_is_allowed_by_name() {
        let deep = IncrementsBeamTest { total_x_m: 0.100, ..Default::default() };
        assert_eq!(
            refused(&deep),
            "total_x_distance: found 100.0 mm, expected at most 18.4 mm, the largest push at 45 mm from the root, \
            where the whisker is strained by 2.5 %; choose a smaller push, or allow the overload by name \
            (--allow-overload)"
        );
        let at_the_tip = refused(&IncrementsBeamTest { total_y_m: 0.0, ..deep });
        assert!(at_the_tip.contains("at most 26.5 mm, the largest push at 145 mm"), "{at_the_tip}");
        assert!(at_the_tip.contains("the ruler slips off the whisker of 150 mm"), "{at_the_tip}");
        deep.on(&Rig::built_in(), Overload::Allowed).expect("allowed by name");
        // The range of the bed is checked even if an overload is allowed.
        let far = IncrementsBeamTest { total_x_m: 0.104, ..deep };
        assert!(far.on(&Rig::built_in(), Overload::Allowed).is_err());
    }
}
