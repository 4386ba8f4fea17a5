//! External process with line-based communication and a timeout for every wait.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};
use std::{env, iter, thread};

use strict_json::one_line;

#[cfg(target_os = "linux")]
use super::descendants::{Mark, wait_if_ending};

/// Longest accepted line in bytes.
const LONGEST_LINE: u64 = 1 << 16;

/// Number of bytes at the end of stderr that are searched for the last line.
const STDERR_TAIL: u64 = 1 << 12;

/// Polling interval for the end of the process.
const PAUSE: Duration = Duration::from_millis(2);

/// Python environment of the project, relative to the repository's root.
const ENVIRONMENT: &str = ".venv/bin";

/// Reason why no line was received.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum NoLine {
    /// No line within the timeout.
    TimedOut,
    /// The program closed its stdout.
    Closed,
}

/// Running process. It is killed with its process group when dropped, on Linux with every process that it started, so
/// that none outlives the trial.
///
/// Separate threads write stdin and read stdout, so that a process that does not read or does not answer cannot block.
pub(super) struct Process {
    child: Child,
    /// `None` after the input has been closed.
    input: Option<Sender<String>>,
    output: Receiver<io::Result<String>>,
    stderr: File,
    #[cfg(target_os = "linux")]
    mark: Mark,
}

/// Search path with the project's Python environment first, if it exists, so that `python` has the libraries of the
/// examples.
fn path_with_environment() -> Option<OsString> {
    let environment = std::path::absolute(ENVIRONMENT).ok().filter(|folder| folder.is_dir())?;
    let path = env::var_os("PATH").unwrap_or_default();
    env::join_paths(iter::once(environment).chain(env::split_paths(&path))).ok()
}

impl Process {
    /// Starts a program with its arguments in the current directory.
    ///
    /// # Errors
    /// If the program does not start.
    pub(super) fn start(command: &[String]) -> io::Result<Self> {
        let stderr = tempfile::tempfile()?;
        let (program, arguments) = command.split_first().ok_or(io::ErrorKind::InvalidInput)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(stderr.try_clone()?);
        if let Some(path) = path_with_environment() {
            command.env("PATH", path);
        }
        // A separate process group, so that its children can be killed with it.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        #[cfg(target_os = "linux")]
        let mark = Mark::on(&mut command);
        let mut child = command.spawn()?;
        let (input, lines) = channel();
        let (answers, output) = sync_channel(1);
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        thread::spawn(move || stdin.map(|stdin| write_lines(stdin, &lines)));
        thread::spawn(move || stdout.map(|stdout| forward_lines(stdout, &answers)));
        Ok(Self {
            child,
            input: Some(input),
            output,
            stderr,
            #[cfg(target_os = "linux")]
            mark,
        })
    }

    /// Queues a line for stdin without waiting.
    pub(super) fn send(&self, line: String) {
        // If the process has ended, the line is dropped; the next receive reports the end.
        _ = self.input.as_ref().map(|input| input.send(line));
    }

    /// Waits for the next line of stdout.
    pub(super) fn receive(&self, at_most: Duration) -> Result<io::Result<String>, NoLine> {
        self.output.recv_timeout(at_most).map_err(|error| match error {
            RecvTimeoutError::Timeout => NoLine::TimedOut,
            RecvTimeoutError::Disconnected => NoLine::Closed,
        })
    }

    /// Closes stdin.
    pub(super) fn close_input(&mut self) {
        self.input = None;
    }

    /// Exit status. `None` if the process is still running after the timeout.
    pub(super) fn end(&mut self, at_most: Duration) -> io::Result<Option<ExitStatus>> {
        let deadline = Instant::now() + at_most;
        loop {
            let status = self.child.try_wait()?;
            if status.is_some() || Instant::now() >= deadline {
                return Ok(status);
            }
            thread::sleep(PAUSE);
        }
    }

    /// Last non-empty line of stderr.
    pub(super) fn last_stderr_line(&mut self) -> Option<String> {
        let length = self.stderr.metadata().ok()?.len();
        self.stderr.seek(SeekFrom::Start(length.saturating_sub(STDERR_TAIL))).ok()?;
        let mut bytes = Vec::new();
        (&self.stderr).take(STDERR_TAIL).read_to_end(&mut bytes).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(one_line)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        #[cfg(unix)]
        {
            use rustix::process::{Pid, Signal, kill_process_group};
            // Fails if all processes of the group have ended, which is acceptable.
            _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        }
        _ = self.child.kill();
        _ = self.child.wait();
        #[cfg(target_os = "linux")]
        {
            self.mark.kill_all();
            // Otherwise the end of the program would be recorded as its failure.
            wait_if_ending();
        }
    }
}

/// Writes lines to stdin. Returns, and thereby closes stdin, when the channel is closed or the process stops reading.
fn write_lines(mut stdin: ChildStdin, lines: &Receiver<String>) {
    for line in lines {
        if stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush()).is_err() {
            return;
        }
    }
}

/// Forwards the lines of stdout until its end or until the receiver is dropped.
fn forward_lines(stdout: ChildStdout, answers: &SyncSender<io::Result<String>>) {
    let mut reader = BufReader::new(stdout);
    loop {
        let mut line = String::new();
        let mut read = reader.by_ref().take(LONGEST_LINE).read_line(&mut line);
        if matches!(read, Ok(bytes) if bytes as u64 == LONGEST_LINE) && !line.ends_with('\n') {
            // A truncated line must not be parsed as an answer.
            read = Err(io::Error::other(format!("a line of more than {LONGEST_LINE} bytes")));
        }
        let is_over = !matches!(read, Ok(bytes) if bytes > 0);
        if matches!(read, Ok(0)) || answers.send(read.map(|_| line)).is_err() || is_over {
            return;
        }
    }
}
