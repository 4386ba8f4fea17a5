//! Disturbances of a command: signals and a full disk.

use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::cases::{Case, Workspace};
use super::signal::send;
use crate::failure::Failure;

/// Time within which a command ends after a signal.
const LIMIT: Duration = Duration::from_secs(120);

/// Unit of `ulimit -f` in bytes.
const BLOCK: u64 = 512;

/// A disturbance of a running command.
#[derive(Clone, Copy)]
pub(super) enum Disturbance {
    /// A signal, by its name.
    Signal(&'static str),
    /// A file system without space: a small one in memory or, where mounting is not permitted, a limit on the size of files.
    FullDisk,
}

/// All disturbances.
pub(super) const DISTURBANCES: [Disturbance; 4] =
    [Disturbance::Signal("KILL"), Disturbance::Signal("TERM"), Disturbance::Signal("HUP"), Disturbance::FullDisk];

impl Disturbance {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Signal("KILL") => "SIGKILL",
            Self::Signal("TERM") => "SIGTERM",
            Self::Signal(_) => "SIGHUP",
            Self::FullDisk => "full disk",
        }
    }

    /// Runs the command of a case and disturbs it: by a signal after `moment`, or by a disk that has space for `share`
    /// of the files. Returns whether the command was disturbed before its end.
    ///
    /// # Errors
    /// If the command does not start, or does not end after the signal.
    pub(super) fn apply(
        self,
        state: &mut Workspace,
        case: &Case,
        moment: Duration,
        share: f64,
        before: &Workspace,
        after: &Workspace,
    ) -> Result<bool, Failure> {
        match self {
            Self::Signal(name) => {
                let mut running = state.start(case, state.command(case, &[]))?;
                sleep(moment);
                let was_in_time = !has_ended(&mut running)?;
                if was_in_time {
                    send(name, running.id())?;
                }
                end(&mut running, name)?;
                state.stop_helpers();
                Ok(was_in_time)
            }
            Self::FullDisk => {
                let (used, whole) = (before.size()?, after.size()?);
                let space = used + ((whole - used) as f64 * share) as u64;
                let ended = match state.on_small_disk(space)? {
                    true => state.start(case, state.command(case, &[]))?,
                    false => {
                        let limit = ((after.largest_new(before)? as f64 * share) as u64 / BLOCK).to_string();
                        let shell = ["sh", "-c", "trap '' XFSZ; ulimit -f $0; exec \"$@\"", limit.as_str()];
                        state.start(case, state.command(case, &shell))?
                    }
                };
                let mut running = ended;
                let success = end(&mut running, "a full disk")?;
                state.stop_helpers();
                state.enlarge_disk()?;
                Ok(!success)
            }
        }
    }
}

fn has_ended(running: &mut Child) -> Result<bool, Failure> {
    Ok(running.try_wait().map_err(|error| Failure::new(error.to_string()))?.is_some())
}

/// Waits for the end of a command; returns whether it succeeded.
fn end(running: &mut Child, disturbance: &str) -> Result<bool, Failure> {
    let begun = Instant::now();
    loop {
        match running.try_wait().map_err(|error| Failure::new(error.to_string()))? {
            Some(status) => return Ok(status.success()),
            None if begun.elapsed() > LIMIT => {
                let _ = running.kill();
                return Err(Failure::new(format!("still running {} s after {disturbance}", LIMIT.as_secs())));
            }
            None => sleep(Duration::from_millis(10)),
        }
    }
}

/// Pseudo-random numbers (SplitMix64, Steele et al. 2014).
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number from 0 to 1.
    pub(super) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 53) as f64
    }
}
