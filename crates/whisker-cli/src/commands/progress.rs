//! Progress of long commands, on stderr.

use std::io::{IsTerminal, stderr};
use std::ops::Deref;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::diagnose;

/// Interval of the lines if stderr is not a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Shows the progress of a command and an estimate of the time left until it is dropped: as a bar on a terminal, otherwise as a
/// line every ten seconds.
pub(super) struct Progress {
    bar: ProgressBar,
    lines: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    /// Progress of an activity, such as "evaluating".
    pub(super) fn of(activity: &'static str) -> Self {
        if stderr().is_terminal() {
            let style = ProgressStyle::with_template("{msg} [{bar:30}] {pos}/{len}, {eta} left")
                .expect("the template is valid")
                .progress_chars("=> ");
            let bar = ProgressBar::no_length().with_style(style).with_message(activity);
            bar.enable_steady_tick(Duration::from_millis(200));
            return Self { bar, lines: None };
        }
        let bar = ProgressBar::hidden();
        let (end, ended) = mpsc::channel();
        let shown = bar.clone();
        let lines = thread::spawn(move || {
            while ended.recv_timeout(LINE_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let (done, all) = (shown.position(), shown.length().unwrap_or(0));
                diagnose(&format!("{activity}: {done} of {all}{}", left(done, all, shown.elapsed())));
            }
        });
        Self { bar, lines: Some((end, lines)) }
    }
}

impl Deref for Progress {
    type Target = ProgressBar;

    fn deref(&self) -> &ProgressBar {
        &self.bar
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((end, lines)) = self.lines.take() {
            drop(end);
            // The thread ends as its channel closes; it cannot fail but by a closed stderr.
            let _ = lines.join();
        }
    }
}

/// Time left if the rest takes as long as the part that is done, in words. Empty before the first part is done.
fn left(done: u64, all: u64, elapsed: Duration) -> String {
    if done == 0 || done > all {
        return String::new();
    }
    let left_s = elapsed.as_secs_f64() * (all - done) as f64 / done as f64;
    if left_s < 90.0 { format!(", about {left_s:.0} s left") } else { format!(", about {:.0} min left", left_s / 60.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_time_left_is_in_proportion_to_the_work_left() {
        let elapsed = Duration::from_secs(20);
        assert_eq!(left(0, 10, elapsed), "");
        assert_eq!(left(5, 10, elapsed), ", about 20 s left");
        assert_eq!(left(1, 20, elapsed), ", about 6 min left");
        assert_eq!(left(10, 10, elapsed), ", about 0 s left");
    }
}
