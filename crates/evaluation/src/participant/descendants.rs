//! Processes that an external program started and left behind.
//!
//! A process that calls `setsid` leaves the process group of its program. Every process inherits the environment of its
//! program, which is marked, and an orphan becomes a child of this process, its subreaper (`prctl(2)`): the descendants
//! of this process with the mark are those of the program.

use std::collections::BTreeSet;
use std::fs;
use std::process::Command;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::sleep;
use std::time::Duration;

use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitOptions, getpid, kill_process, set_child_subreaper, waitpid};

/// Environment variable with the mark.
const VARIABLE: &str = "WHISKER_TRIAL";

/// Maximum number of rounds: a killed process may have started others in the meantime.
const MOST_ROUNDS: usize = 1000;

/// Time between two rounds.
const PAUSE: Duration = Duration::from_millis(1);

/// Set when the programs of all trials are being ended.
static ENDING: AtomicBool = AtomicBool::new(false);

/// Kills the programs of all trials with every process that they started. Trials with a program do not return any more.
pub(super) fn end_all() {
    ENDING.store(true, Ordering::Relaxed);
    let of_this = format!("{VARIABLE}={}.", getpid());
    kill_where(|variable| variable.starts_with(of_this.as_bytes()));
}

/// Does not return if the programs of all trials are being ended.
pub(super) fn wait_if_ending() {
    while ENDING.load(Ordering::Relaxed) {
        sleep(PAUSE);
    }
}

/// Mark of a program and of every process that it starts.
pub(super) struct Mark(String);

impl Mark {
    /// Marks a program that is about to be started.
    pub(super) fn on(command: &mut Command) -> Self {
        static SUBREAPER: Once = Once::new();
        static NEXT: AtomicU64 = AtomicU64::new(0);
        wait_if_ending();
        // Without it, on a kernel before 3.4, orphans cannot be found.
        SUBREAPER.call_once(|| _ = set_child_subreaper(Some(getpid())));
        let value = format!("{}.{}", getpid(), NEXT.fetch_add(1, Ordering::Relaxed));
        command.env(VARIABLE, &value);
        Self(format!("{VARIABLE}={value}"))
    }

    /// Kills the marked processes and waits for their end. The program itself has ended and was waited for.
    pub(super) fn kill_all(&self) {
        kill_where(|variable| variable == self.0.as_bytes());
    }
}

/// Kills the descendants with a variable of this kind in their environment, and waits for their end.
fn kill_where(is_marked: impl Fn(&[u8]) -> bool) {
    let is_on = |pid: &Pid| {
        let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        environment.split(|byte| *byte == 0).any(&is_marked)
    };
    let mut dying = BTreeSet::new();
    for _ in 0..MOST_ROUNDS {
        let marked: Vec<Pid> = descendants().into_iter().filter(is_on).collect();
        for pid in &marked {
            // Fails if the process has just ended.
            _ = kill_process(*pid, Signal::KILL);
            dying.insert(pid.as_raw_nonzero());
        }
        dying.retain(|raw| is_running(Pid::from_raw(raw.get()).expect("not zero")));
        if marked.is_empty() && dying.is_empty() {
            return;
        }
        sleep(PAUSE);
    }
}

/// Whether a process has not ended yet. An ended child of this process is waited for.
fn is_running(pid: Pid) -> bool {
    match waitpid(Some(pid), WaitOptions::NOHANG) {
        Ok(ended) => ended.is_none(),
        // It becomes a child of this process when its parent has ended.
        Err(Errno::CHILD) => fs::exists(format!("/proc/{pid}")).unwrap_or(false),
        Err(_) => false,
    }
}

/// Children of this process, their children and so on.
fn descendants() -> Vec<Pid> {
    let mut found = vec![getpid()];
    let mut next = 0;
    while let Some(pid) = found.get(next) {
        let threads = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
        let children: Vec<Pid> = threads
            .filter_map(|thread| fs::read_to_string(thread.path().join("children")).ok())
            .flat_map(|pids| {
                pids.split_whitespace().filter_map(|pid| Pid::from_raw(pid.parse().ok()?)).collect::<Vec<_>>()
            })
            .filter(|child| !found.contains(child))
            .collect();
        found.extend(children);
        next += 1;
    }
    found.split_off(1)
}
