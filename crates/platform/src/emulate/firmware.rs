//! Emulated firmware of a printer: the part of Marlin that the rig uses.
//!
//! Lines are checked when they arrive and executed in order. Each is acknowledged by `ok` when it is done: a move when
//! it is planned, `M400` and `G28` when the head stands still; meanwhile the firmware reports that it is busy. `M112`
//! is executed when it arrives.

use std::collections::VecDeque;

use super::motion::Motion;
use crate::printer::gcode::checksum;
use crate::rig::Bed;

/// Speed before the first `F` (mm/s).
const START_MM_S: f64 = 2000.0 / 60.0;
/// Speed of homing (mm/s).
const HOMING_MM_S: f64 = 50.0;
/// Capacity of the planner in moves.
const PLANNED: usize = 16;
/// Interval between two busy reports (s).
const BUSY_S: f64 = 2.0;

/// Firmware of a printer.
#[derive(Debug)]
pub(super) struct Firmware {
    bed: Bed,
    /// Queue of accepted commands.
    commands: VecDeque<String>,
    /// Condition that ends the current command.
    pending: Option<Pending>,
    words: String,
    /// Number of the last accepted line.
    last_line: i64,
    is_relative: bool,
    is_homed: bool,
    is_halted: bool,
    speed_mm_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Pending {
    until: Until,
    /// Time of the next busy report (s).
    busy_s: f64,
}

#[derive(Clone, Copy, Debug)]
enum Until {
    /// The head stands still.
    Still,
    /// The planner has room for another move.
    Room,
    /// This time (s).
    Time(f64),
}

/// Progress of a command.
#[derive(Clone, Copy, Debug)]
enum Begun {
    /// Done.
    Done,
    /// Done, and acknowledged within the answer.
    Answered,
    /// In progress.
    Waits(Until),
}

impl Firmware {
    /// Firmware after a start, of a printer with this bed.
    pub(super) fn new(bed: Bed) -> Self {
        Self {
            bed,
            commands: VecDeque::new(),
            pending: None,
            words: String::new(),
            last_line: 0,
            is_relative: false,
            is_homed: false,
            is_halted: false,
            speed_mm_s: START_MM_S,
        }
    }

    /// Receives a line without its end.
    pub(super) fn receive(&mut self, line: &str, now_s: f64, motion: &mut Motion) {
        let line = line.split(';').next().unwrap_or("").trim();
        if self.is_halted || line.is_empty() {
            return;
        }
        if line.split(['*', ' ']).any(|word| word == "M112") {
            motion.stop(now_s);
            self.commands.clear();
            self.pending = None;
            self.is_halted = true;
            self.say("Error:Printer halted. kill() called!");
            return;
        }
        match self.checked(line) {
            Ok(command) => self.commands.push_back(command.into()),
            Err(wrong) => {
                self.say(&format!("Error:{wrong}, Last Line: {}", self.last_line));
                self.say(&format!("Resend: {}", self.next_line()));
                self.say("ok");
            }
        }
    }

    /// Number of the next line; saturated at the largest number.
    fn next_line(&self) -> i64 {
        self.last_line.saturating_add(1)
    }

    /// Command of a line, after a check of its number and checksum, if it has them.
    fn checked<'a>(&mut self, line: &'a str) -> Result<&'a str, &'static str> {
        let (body, sum) = match line.rsplit_once('*') {
            Some((body, sum)) => (body, Some(sum)),
            None => (line, None),
        };
        let Some(numbered) = body.strip_prefix('N') else {
            return if sum.is_some() { Err("No Line Number with checksum") } else { Ok(body) };
        };
        let sum = sum.ok_or("No Checksum with line number")?;
        if sum.trim().parse() != Ok(checksum(body.as_bytes())) {
            return Err("checksum mismatch");
        }
        let end = numbered.find(|c: char| !c.is_ascii_digit() && c != '-').unwrap_or(numbered.len());
        let (number, command) = numbered.split_at(end);
        let (number, command) = (number.parse().map_err(|_| "checksum mismatch")?, command.trim());
        if number != self.next_line() && !command.starts_with("M110") {
            return Err("Line Number is not Last Line Number+1");
        }
        self.last_line = number;
        Ok(command)
    }

    /// Executes commands up to this time and appends the answers.
    pub(super) fn work(&mut self, now_s: f64, motion: &mut Motion, words: &mut Vec<u8>) {
        loop {
            if let Some(Pending { until, busy_s }) = &mut self.pending {
                let is_over = match *until {
                    Until::Still => motion.end_s() <= now_s,
                    Until::Room => motion.waiting(now_s) < PLANNED,
                    Until::Time(end_s) => end_s <= now_s,
                };
                if !is_over {
                    if now_s >= *busy_s {
                        *busy_s = now_s + BUSY_S;
                        self.say("echo:busy: processing");
                    }
                    break;
                }
                self.pending = None;
                self.say("ok");
            }
            let Some(command) = self.commands.pop_front() else { break };
            match self.begin(&command, now_s, motion) {
                Begun::Done => self.say("ok"),
                Begun::Answered => {}
                Begun::Waits(until) => self.pending = Some(Pending { until, busy_s: now_s + BUSY_S }),
            }
        }
        words.extend(std::mem::take(&mut self.words).into_bytes());
    }

    fn begin(&mut self, command: &str, now_s: f64, motion: &mut Motion) -> Begun {
        let (code, rest) = command.split_once(' ').unwrap_or((command, ""));
        match code {
            "G0" | "G1" => {
                if let Some(speed) = value(rest, 'F').filter(|speed| *speed > 0.0) {
                    self.speed_mm_s = speed / 60.0;
                }
                motion.go(now_s, self.goal_mm(rest, motion), self.speed_mm_s);
                return Begun::Waits(Until::Room);
            }
            "G4" => {
                let wait_s = value(rest, 'S').or(value(rest, 'P').map(|ms| 1e-3 * ms)).unwrap_or(0.0);
                return Begun::Waits(Until::Time(motion.end_s().max(now_s) + wait_s));
            }
            "G28" => {
                let named = |axis| rest.is_empty() || rest.contains(axis);
                let mut goal_mm = motion.goal_mm();
                for (axis, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
                    if named(letter) {
                        goal_mm[axis] = 0.0;
                        motion.go(now_s, goal_mm, HOMING_MM_S);
                    }
                }
                self.is_homed = true;
                return Begun::Waits(Until::Still);
            }
            "M400" => return Begun::Waits(Until::Still),
            "G90" => self.is_relative = false,
            "G91" => self.is_relative = true,
            "M105" => {
                self.say("ok T:21.0 /0.0 B:21.0 /0.0 @:0 B@:0");
                return Begun::Answered;
            }
            "M110" => self.last_line = value(rest, 'N').map_or(self.last_line, |number| number as i64),
            "M114" => {
                let ([gx, gy, gz], [x, y, z]) = (motion.goal_mm(), motion.position_mm(now_s));
                self.say(&format!("X:{gx:.2} Y:{gy:.2} Z:{gz:.2} E:0.00 Count X:{x:.2} Y:{y:.2} Z:{z:.2}"));
            }
            "M115" => self.say(
                "FIRMWARE_NAME:Marlin (emulated whisker rig) PROTOCOL_VERSION:1.0 MACHINE_TYPE:i3 EXTRUDER_COUNT:0",
            ),
            // Millimetres, display message, motors off, fans off: no effect on the emulation.
            "G21" | "M117" | "M84" | "M107" => {}
            _ => self.say(&format!("echo:Unknown command: \"{command}\"")),
        }
        Begun::Done
    }

    fn goal_mm(&self, parameters: &str, motion: &Motion) -> [f64; 3] {
        let mut goal_mm = motion.goal_mm();
        for (axis, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
            if let Some(value) = value(parameters, letter) {
                goal_mm[axis] = if self.is_relative { goal_mm[axis] + value } else { value };
            }
        }
        // After homing, targets are clamped to the bed.
        if self.is_homed {
            for (axis, [least_m, most_m]) in [self.bed.x_m, self.bed.y_m].into_iter().enumerate() {
                goal_mm[axis] = goal_mm[axis].clamp(1e3 * least_m, 1e3 * most_m);
            }
        }
        goal_mm
    }

    fn say(&mut self, line: &str) {
        self.words.push_str(line);
        self.words.push('\n');
    }
}

/// The number behind a letter.
fn value(parameters: &str, letter: char) -> Option<f64> {
    let (_, rest) = parameters.split_once(letter)?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && !matches!(c, '.' | '-' | '+')).unwrap_or(rest.len());
    rest[..end].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::gcode::numbered;
    use crate::rig::Rig;

    struct Bench {
        firmware: Firmware,
        motion: Motion,
    }

    impl Bench {
        fn new() -> Self {
            Self { firmware: Firmware::new(Rig::built_in().bed), motion: Motion::default() }
        }

        /// Answers up to this time.
        fn at(&mut self, now_s: f64, line: &str) -> String {
            self.firmware.receive(line, now_s, &mut self.motion);
            let mut words = Vec::new();
            self.firmware.work(now_s, &mut self.motion, &mut words);
            String::from_utf8(words).expect("text")
        }
    }

    #[test]
    fn verif_damaged_lines_are_requested_again() {
        let mut bench = Bench::new();
        assert_eq!(bench.at(0.0, numbered(1, "G21").trim()), "ok\n");
        let again = "Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n";
        assert_eq!(bench.at(0.0, &numbered(2, "G1 X1").trim().replace("X1", "X9")), again);
        let again = "Error:Line Number is not Last Line Number+1, Last Line: 1\nResend: 2\nok\n";
        assert_eq!(bench.at(0.0, numbered(5, "G21").trim()), again);
        assert_eq!(bench.at(0.0, "N2 G21"), "Error:No Checksum with line number, Last Line: 1\nResend: 2\nok\n");
        assert_eq!(bench.at(0.0, numbered(5, "M110 N7").trim()), "ok\n");
        assert_eq!(bench.at(0.0, numbered(8, "G21").trim()), "ok\n");
    }

    #[test]
    fn verif_a_move_is_planned_at_once_and_waited_for() {
        let mut bench = Bench::new();
        assert_eq!(bench.at(0.0, "G28 XY"), "ok\n");
        assert_eq!(bench.at(0.0, "G1 X100 Y300 F6000 ; towards the back"), "ok\n");
        assert_eq!(bench.at(0.0, "M400"), "");
        assert_eq!(bench.at(2.1, ""), "echo:busy: processing\n");
        assert_eq!(bench.at(3.0, ""), "ok\n");
        // The bed ends at 210 mm.
        assert_eq!(bench.at(3.0, "M114"), "X:100.00 Y:210.00 Z:0.00 E:0.00 Count X:100.00 Y:210.00 Z:0.00\nok\n");
    }

    #[test]
    fn verif_an_emergency_stop_precedes_queued_commands() {
        let mut bench = Bench::new();
        bench.at(0.0, "G1 X100 F600");
        bench.at(0.0, "M400");
        assert_eq!(bench.at(1.0, "M112"), "Error:Printer halted. kill() called!\n");
        assert!((bench.motion.position_mm(9.0)[0] - 9.95).abs() < 0.1);
        assert_eq!(bench.at(2.0, "M114"), "");
    }

    #[test]
    fn robust_unknown_commands_are_reported() {
        let mut bench = Bench::new();
        assert_eq!(bench.at(0.0, "M999 S1"), "echo:Unknown command: \"M999 S1\"\nok\n");
        assert_eq!(bench.at(0.0, "M999 \u{10a}"), "echo:Unknown command: \"M999 \u{10a}\"\nok\n");
        assert_eq!(bench.at(0.0, "M110 N9223372036854775807"), "ok\n");
        assert!(bench.at(0.0, numbered(1, "G21").trim()).ends_with("Resend: 9223372036854775807\nok\n"));
        assert_eq!(bench.at(0.0, "M105"), "ok T:21.0 /0.0 B:21.0 /0.0 @:0 B@:0\n");
    }
}
