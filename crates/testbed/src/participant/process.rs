//! A program that is talked to line by line, with a limit to every wait.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};
use std::{env, iter, thread};

use strict_json::one_line;

/// Longest line that is taken.
const LONGEST_LINE: u64 = 1 << 16;

/// How much of the end of stderr is looked at for its last words.
const LAST_WORDS: u64 = 1 << 12;

/// Pause between two looks at whether the program has ended.
const PAUSE: Duration = Duration::from_millis(2);

/// The project's Python environment, seen from the repository's root.
const ENVIRONMENT: &str = ".venv/bin";

/// Why no line came.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Silence {
    /// None came in time.
    TimedOut,
    /// The program closed its stdout.
    Closed,
}

/// A running program. Dropped, it is killed with all that it started, so that nothing outlives the trial.
///
/// Threads of their own feed its stdin and read its stdout: a program that does not read, or does not answer, blocks neither.
pub(super) struct Process {
    child: Child,
    /// Nothing when its input has ended.
    input: Option<Sender<String>>,
    output: Receiver<io::Result<String>>,
    stderr: File,
}

/// The search path with the project's Python environment first, where that is there: `python` then is the one that has the libraries of the examples.
fn path_with_environment() -> Option<OsString> {
    let environment = std::path::absolute(ENVIRONMENT).ok().filter(|folder| folder.is_dir())?;
    let path = env::var_os("PATH").unwrap_or_default();
    env::join_paths(iter::once(environment).chain(env::split_paths(&path))).ok()
}

impl Process {
    /// Starts the program with its arguments in this process's folder.
    ///
    /// # Errors
    /// If it does not start.
    pub(super) fn start(command: &[String]) -> io::Result<Self> {
        let stderr = tempfile::tempfile()?;
        let (program, arguments) = command.split_first().ok_or(io::ErrorKind::InvalidInput)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(stderr.try_clone()?);
        if let Some(path) = path_with_environment() {
            command.env("PATH", path);
        }
        // A group of its own, so that what it starts can be ended with it.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (input, lines) = channel();
        let (answers, output) = sync_channel(1);
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        thread::spawn(move || stdin.map(|stdin| feed(stdin, &lines)));
        thread::spawn(move || stdout.map(|stdout| listen(stdout, &answers)));
        Ok(Self { child, input: Some(input), output, stderr })
    }

    /// Gives it a line, without waiting for its being read.
    pub(super) fn tell(&self, line: String) {
        // A program that has ended takes nothing; its silence will say so.
        _ = self.input.as_ref().map(|input| input.send(line));
    }

    /// Waits for its next line.
    pub(super) fn hear(&self, at_most: Duration) -> Result<io::Result<String>, Silence> {
        self.output.recv_timeout(at_most).map_err(|error| match error {
            RecvTimeoutError::Timeout => Silence::TimedOut,
            RecvTimeoutError::Disconnected => Silence::Closed,
        })
    }

    /// Ends its input.
    pub(super) fn hang_up(&mut self) {
        self.input = None;
    }

    /// How it ended; nothing where it still runs after that time.
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

    /// The last line that it wrote to stderr.
    pub(super) fn last_words(&mut self) -> Option<String> {
        let length = self.stderr.metadata().ok()?.len();
        self.stderr.seek(SeekFrom::Start(length.saturating_sub(LAST_WORDS))).ok()?;
        let mut bytes = Vec::new();
        (&self.stderr).take(LAST_WORDS).read_to_end(&mut bytes).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(one_line)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        #[cfg(unix)]
        {
            use rustix::process::{Pid, Signal, kill_process_group};
            // Fails where all of the group have ended, which is as well.
            _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        }
        _ = self.child.kill();
        _ = self.child.wait();
    }
}

/// Writes lines as they come. Ends, and with it the program's input, when no more come or none is taken.
fn feed(mut stdin: ChildStdin, lines: &Receiver<String>) {
    for line in lines {
        if stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush()).is_err() {
            return;
        }
    }
}

/// Hands on lines as they come, until there are no more or nobody wants them.
fn listen(stdout: ChildStdout, answers: &SyncSender<io::Result<String>>) {
    let mut reader = BufReader::new(stdout);
    loop {
        let mut line = String::new();
        let mut read = reader.by_ref().take(LONGEST_LINE).read_line(&mut line);
        if matches!(read, Ok(bytes) if bytes as u64 == LONGEST_LINE) && !line.ends_with('\n') {
            // What it begins with may be an answer; nobody knows what it ends with.
            read = Err(io::Error::other(format!("a line of more than {LONGEST_LINE} bytes")));
        }
        let is_over = !matches!(read, Ok(bytes) if bytes > 0);
        if matches!(read, Ok(0)) || answers.send(read.map(|_| line)).is_err() || is_over {
            return;
        }
    }
}
