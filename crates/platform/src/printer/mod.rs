//! Driver of the 3D printer that moves the ruler (Marlin dialect).
//!
//! The printer is not moved before homing, out of its bed, or at a speed outside the range of its rig.

mod answer;
pub(crate) mod gcode;
mod link;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

pub use answer::{Answer, Position};
use gcode::millimetres;
use link::{Link, PROMPT};

use crate::rig::Bed;
use crate::{Error, range};

/// Baud rate of the printer's port.
pub const BAUD: u32 = 115_200;
/// Timeout of a busy printer, which reports every two seconds.
const BUSY: Duration = Duration::from_secs(20);
/// Largest difference between target and reported position (m): one unit of the last digit, which is in mm.
const TOLERANCE_M: f64 = 0.01e-3;
/// Interval between two queries of the moving head's position.
const POLL: Duration = Duration::from_millis(50);

/// Position of the head at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Time since the beginning of the recording (s): the middle between query and answer.
    pub t_s: f64,
    /// x in the printer's frame (m).
    pub x_m: f64,
    /// y in the printer's frame (m).
    pub y_m: f64,
    /// z in the printer's frame (m).
    pub z_m: f64,
}

/// Callback with the position of the moving head.
pub type Watch<'a> = dyn FnMut(Head) -> Result<(), Error> + 'a;

/// A printer on a port.
pub struct Printer {
    link: Link,
    bed: Bed,
    origin: Instant,
    is_homed: bool,
    /// Motor counts per metre of each axis, known after a move: printers report steps or millimetres.
    counts_per_m: [Option<f64>; 2],
}

impl Printer {
    /// Opens a port and waits for the printer to answer, which takes some seconds if opening restarts it. The head does
    /// not leave `bed`. Times are counted from `origin`. Once `stop` is set, the printer is stopped at once, and every
    /// call returns [`Error::Interrupted`].
    ///
    /// # Errors
    /// If the port cannot be opened, or no printer answers.
    pub fn open(port: &str, bed: Bed, origin: Instant, stop: Arc<AtomicBool>) -> Result<Self, Error> {
        let link = Link::open(port, BAUD, stop)?;
        Ok(Self { link, bed, origin, is_homed: false, counts_per_m: [None; 2] })
    }

    /// Selects millimetres and absolute positions, and homes both axes.
    ///
    /// # Errors
    /// If the printer fails.
    pub fn home(&mut self) -> Result<(), Error> {
        self.is_homed = false;
        self.link.send("G21", PROMPT)?;
        self.link.send("G90", PROMPT)?;
        self.link.send("G28 X Y", BUSY)?;
        self.link.send("M400", BUSY)?;
        self.is_homed = true;
        Ok(())
    }

    /// Moves the head in a straight line and waits for the end of the move. `watch` receives positions meanwhile.
    ///
    /// # Errors
    /// If the printer was not homed, the target is out of its bed, the speed is out of range, or the head does not end
    /// at the target.
    pub fn move_to(&mut self, goal_m: [f64; 2], speed_m_s: f64, watch: &mut Watch<'_>) -> Result<(), Error> {
        range::check_length("x of the head", goal_m[0], self.bed.x_m)?;
        range::check_length("y of the head", goal_m[1], self.bed.y_m)?;
        range::check_speed("speed of the head", speed_m_s, self.bed.speeds_m_s())?;
        let [x, y] = goal_m.map(millimetres);
        let command = format!("G1 X{x} Y{y} F{:.0}", 60e3 * speed_m_s);
        if !self.is_homed {
            return Err(Error::NotHomed { port: self.link.name.clone(), command });
        }
        // The firmware may have lost a line that it had requested again; a repeated absolute move is harmless.
        self.go(&command, watch)?;
        if self.is_there(goal_m)?.is_err() {
            self.go(&command, watch)?;
        }
        let head = self.is_there(goal_m)??;
        watch(head)
    }

    /// Sends a move and waits until the head stands still.
    fn go(&mut self, command: &str, watch: &mut Watch<'_>) -> Result<(), Error> {
        self.link.send(command, BUSY)?;
        self.watch_until_still(watch)?;
        self.link.send("M400", BUSY).map(drop)
    }

    /// Shows a message on the printer's display.
    ///
    /// # Errors
    /// If the printer does not accept it.
    pub fn show(&mut self, message: &str) -> Result<(), Error> {
        self.link.send(&format!("M117 {message}"), PROMPT).map(drop)
    }

    /// Emergency stop: motors and heaters off. The printer must be reset before it moves again.
    pub fn stop_at_once(&mut self) {
        self.is_homed = false;
        self.link.stop_at_once();
    }

    /// Waits for this time.
    ///
    /// # Errors
    /// If it is interrupted, or the port vanished.
    pub fn rest(&mut self, time: Duration) -> Result<(), Error> {
        self.link.idle(time)
    }

    /// Reports the position by the motors until they stand still. A printer that does not report motor positions is not queried.
    fn watch_until_still(&mut self, watch: &mut Watch<'_>) -> Result<(), Error> {
        let mut last = None;
        loop {
            let asked = Instant::now();
            let Position { goal, count: Some(count) } = self.position()? else { return Ok(()) };
            if let [Some(x), Some(y)] = self.counts_per_m {
                let t_s = self.middle_s(asked);
                watch(Head { t_s, x_m: count[0] / x, y_m: count[1] / y, z_m: 1e-3 * goal[2] })?;
            }
            if last == Some(count) {
                return Ok(());
            }
            last = Some(count);
            self.rest(POLL)?;
        }
    }

    /// Final position of the head, which must be the target. The motor counts there determine their unit.
    fn is_there(&mut self, goal_m: [f64; 2]) -> Result<Result<Head, Error>, Error> {
        let asked = Instant::now();
        let position = self.position()?;
        let [x_m, y_m, z_m] = position.goal.map(|millimetres| 1e-3 * millimetres);
        if (x_m - goal_m[0]).abs() > TOLERANCE_M || (y_m - goal_m[1]).abs() > TOLERANCE_M {
            let pair = |x_m, y_m| format!("({}, {})", millimetres(x_m), millimetres(y_m));
            let (found, expected) = (pair(x_m, y_m), pair(goal_m[0], goal_m[1]));
            return Ok(Err(Error::Astray { port: self.link.name.clone(), found, expected }));
        }
        for (axis, value_m) in [x_m, y_m].into_iter().enumerate() {
            // Near the end stop the counts are too small to determine it.
            let known = position.count.filter(|count| value_m > 0.01 && count[axis] > 0.0);
            self.counts_per_m[axis] = known.map(|count| count[axis] / value_m).or(self.counts_per_m[axis]);
        }
        Ok(Ok(Head { t_s: self.middle_s(asked), x_m, y_m, z_m }))
    }

    /// Position of the head as reported by the printer. The query is repeated if the answer was damaged.
    fn position(&mut self) -> Result<Position, Error> {
        const COMMAND: &str = "M114";
        for _ in 0..3 {
            if let Some(position) = self.link.send(COMMAND, PROMPT)? {
                return Ok(position);
            }
        }
        let (port, answer) = (self.link.name.clone(), "ok without a position".into());
        Err(Error::Refused { port, command: COMMAND.into(), answer })
    }

    /// Time halfway between `then` and now (s).
    fn middle_s(&self, asked: Instant) -> f64 {
        (asked + asked.elapsed() / 2).duration_since(self.origin).as_secs_f64()
    }
}
