//! Commands that are disturbed, and the folder in which they run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::files::{self, Files, failed};
use super::signal::send;
use crate::failure::{Failure, Outcome};
use crate::repository::{interpreter, root};
use crate::tools::built_whisker;

/// A command that is disturbed.
pub(super) struct Case {
    pub(super) name: &'static str,
    /// Arguments of `whisker`, separated by spaces, with paths relative to the workspace.
    arguments: &'static str,
    /// Whether it needs the emulated rig.
    needs_rig: bool,
    /// Repeats the disturbed command and checks the files.
    pub(super) again: fn(&mut Workspace, &Case, &Workspace) -> Outcome,
}

/// The commands, in the order in which the later ones need the files of the earlier ones.
pub(super) const CASES: &[Case] = &[
    Case::new("simulate", "simulate scenes/suites/smoke.json --out datasets/smoke --jobs 2"),
    Case::new("fit", "fit scenes/suites/smoke.json --traces datasets/smoke"),
    Case::new(
        "evaluate",
        "evaluate scenes/suites/smoke.json --traces datasets/smoke --estimators ekf,recommended --seeds 3",
    ),
    Case::new("report", "report results/smoke"),
    Case::new("bag export", "bag export datasets/smoke/smoke_pin.csv --out bags/pin"),
    Case::new("import", "import stanford-whisker clone --out datasets/stanford"),
    Case {
        name: "platform run",
        arguments: "platform run --printer ../ports/printer --sensor ../ports/sensor --x 3 --y 10 --increments-y 1 --out session",
        needs_rig: true,
        again: record_again,
    },
];

/// Folder of the ports of the emulated rig, beside the workspaces.
const PORTS: &str = "ports";

/// Folder of the session in a workspace.
const SESSION: &str = "session";

/// Time within which the emulated ports appear.
const STARTUP_LIMIT: Duration = Duration::from_secs(20);

/// Files of a small clone of recordings, in the order of their parts in the fuzz corpus.
const CLONE: [&str; 3] = [
    "all_datasets/calibration/sensor1_tip_calib_May_04.csv",
    "all_datasets/test/tip_test_05_04/tip_test_cylinder_30mm_May_04_trial1.csv",
    "3d_data/ConeFixture.stl",
];

/// Space that a file system in memory needs for itself, in bytes.
const RESERVE: u64 = 1 << 16;

/// Separator of the parts.
const CUT: &[u8] = b"\n%%%\n";

impl Case {
    const fn new(name: &'static str, arguments: &'static str) -> Self {
        Self { name, arguments, needs_rig: false, again: repeat }
    }
}

/// Repeats the command. The files must be those of the undisturbed command, without temporary ones.
fn repeat(state: &mut Workspace, case: &Case, after: &Workspace) -> Outcome {
    state.run(case)?;
    match files::difference(&files::read(&state.folder)?, &files::read(&after.folder)?) {
        Some(difference) => Err(Failure::new(difference)),
        None => Ok(()),
    }
}

/// A session cannot be repeated: its recording must be kept. Another session, beside it, must succeed.
fn record_again(state: &mut Workspace, case: &Case, _: &Workspace) -> Outcome {
    let session = state.folder.join(SESSION);
    let recorded = if session.exists() { files::read(&session)? } else { Files::new() };
    let tables = recorded.iter().filter(|(path, _)| path.to_string_lossy().starts_with("log."));
    if tables.clone().next().is_some() {
        if state.run(case).is_ok() || files::read(&session)? != recorded {
            return Err(Failure::new("a session was recorded over another"));
        }
        let kept = session.with_file_name("kept");
        fs::rename(&session, &kept).map_err(|error| failed(&session, &error))?;
    }
    state.run(case)?;
    let log = files::read(&session)?;
    let presses =
        log.get(Path::new("log.json")).map(|json| String::from_utf8_lossy(json).matches("\"distance_m\"").count());
    if presses != Some(2) || !log.contains_key(Path::new("log.csv")) {
        return Err(Failure::new(format!("log.json: found {presses:?} presses, expected 2, and log.csv")));
    }
    Ok(())
}

/// Folder with the inputs of the commands and the files that they wrote.
pub(super) struct Workspace {
    folder: PathBuf,
    rig: Option<Child>,
    is_mounted: bool,
}

impl Workspace {
    /// Creates a folder with the inputs: the scenes of the smoke suite and a clone of recordings.
    ///
    /// # Errors
    /// If a file cannot be copied.
    pub(super) fn create(folder: PathBuf) -> Result<Self, Failure> {
        let mut inputs = Files::new();
        for file in ["suites/smoke.json", "smoke_calibration.json", "smoke_pin.json", "smoke_circle.json"] {
            let path = Path::new("scenes").join(file);
            let from = root().join(&path);
            inputs.insert(path, fs::read(&from).map_err(|error| failed(&from, &error))?);
        }
        let corpus = root().join("fuzz/corpus/import/clone.txt");
        let bytes = fs::read(&corpus).map_err(|error| failed(&corpus, &error))?;
        let mut rest = bytes.as_slice();
        for file in CLONE {
            let end = rest.windows(CUT.len()).position(|window| window == CUT).unwrap_or(rest.len());
            inputs.insert(Path::new("clone/data").join(file), rest[..end].to_vec());
            rest = rest.get(end + CUT.len()..).unwrap_or_default();
        }
        files::write(&inputs, &folder)?;
        Ok(Self::at(folder))
    }

    fn at(folder: PathBuf) -> Self {
        Self { folder, rig: None, is_mounted: false }
    }

    /// Copies the files into another folder, whose contents are replaced.
    ///
    /// # Errors
    /// If a file cannot be copied.
    pub(super) fn copy_to(&self, folder: PathBuf) -> Result<Self, Failure> {
        let copy = Self::at(folder);
        copy.clear()?;
        files::write(&files::read(&self.folder)?, &copy.folder)?;
        Ok(copy)
    }

    fn clear(&self) -> Outcome {
        match fs::remove_dir_all(&self.folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(failed(&self.folder, &error)),
            _ => Ok(()),
        }
    }

    /// Unmounts the file system that an interrupted run left at a folder, if there is one.
    pub(super) fn release(folder: &Path) {
        // Without such a file system the command fails, which is expected.
        let _ = Command::new("umount").arg(folder).stderr(Stdio::null()).status();
    }

    /// Removes the folder.
    ///
    /// # Errors
    /// If it cannot be removed.
    pub(super) fn remove(mut self) -> Outcome {
        self.unmount()?;
        self.clear()
    }

    /// Runs the command of a case to its end.
    ///
    /// # Errors
    /// If it fails.
    pub(super) fn run(&mut self, case: &Case) -> Outcome {
        let mut command = self.command(case, &[]);
        command.stderr(Stdio::piped());
        let output = self.start(case, command)?.wait_with_output().map_err(|error| Failure::new(error.to_string()))?;
        self.stop_helpers();
        if output.status.success() {
            return Ok(());
        }
        let words = String::from_utf8_lossy(&output.stderr);
        Err(Failure::new(format!("{} ended with {}: {}", case.name, output.status, words.trim())))
    }

    /// The command of a case, run by other words if there are any.
    pub(super) fn command(&self, case: &Case, by: &[&str]) -> Command {
        let whisker = built_whisker();
        let mut command = match by {
            [program, rest @ ..] => {
                let mut command = Command::new(program);
                command.args(rest).arg(whisker);
                command
            }
            [] => Command::new(whisker),
        };
        command
            .args(case.arguments.split(' '))
            .current_dir(&self.folder)
            .env("WHISKER_PYTHON", interpreter())
            .env("PYTHONPATH", root().join("sim"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command
    }

    /// Starts a command of a case, and the emulated rig before it if the case needs it.
    ///
    /// # Errors
    /// If a program does not start.
    pub(super) fn start(&mut self, case: &Case, mut command: Command) -> Result<Child, Failure> {
        if case.needs_rig {
            self.start_rig()?;
        }
        command.spawn().map_err(|error| Failure::new(format!("{} does not start: {error}", case.name)))
    }

    fn start_rig(&mut self) -> Outcome {
        let ports = self.folder.with_file_name(PORTS);
        fs::create_dir_all(&ports).map_err(|error| failed(&ports, &error))?;
        let links = ["printer", "sensor"].map(|port| ports.join(port));
        for link in &links {
            // The links do not exist before the first session.
            let _ = fs::remove_file(link);
        }
        let mut command = Command::new(built_whisker());
        command.args(["platform", "emulate", "--printer-link"]).arg(&links[0]).arg("--sensor-link").arg(&links[1]);
        let rig = command.stdout(Stdio::null()).spawn();
        self.rig = Some(rig.map_err(|error| Failure::new(format!("the emulated rig does not start: {error}")))?);
        let begun = Instant::now();
        while !links.iter().all(|link| link.exists()) {
            if begun.elapsed() > STARTUP_LIMIT {
                return Err(Failure::new("the emulated ports did not appear"));
            }
            sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// Ends the emulated rig, if it runs.
    pub(super) fn stop_helpers(&mut self) {
        if let Some(mut rig) = self.rig.take() {
            // The rig may have ended by itself.
            let _ = send("TERM", rig.id());
            let _ = rig.wait();
        }
    }

    /// Checks that every file that was there before a command still is, unchanged or as the command would have left it.
    ///
    /// # Errors
    /// If a file is missing or changed; the failure names it.
    pub(super) fn check_nothing_is_lost(&self, case: &Case, before: &Self, after: &Self) -> Outcome {
        let (found, old, new) = (files::read(&self.folder)?, files::read(&before.folder)?, files::read(&after.folder)?);
        for (path, bytes) in &old {
            let is_kept = found.get(path).is_some_and(|found| found == bytes || new.get(path) == Some(found));
            if !is_kept {
                return Err(Failure::new(format!("{}: lost by the disturbed {}", path.display(), case.name)));
            }
        }
        Ok(())
    }

    /// Space that the files take, in bytes.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn size(&self) -> Result<u64, Failure> {
        Ok(files::size(&files::read(&self.folder)?))
    }

    /// Size of the largest file that `before` does not have, in bytes.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn largest_new(&self, before: &Self) -> Result<u64, Failure> {
        let old = files::read(&before.folder)?;
        let new = files::read(&self.folder)?;
        let sizes = new.iter().filter(|(path, _)| !old.contains_key(*path)).map(|(_, bytes)| bytes.len() as u64);
        Ok(sizes.max().unwrap_or_default())
    }

    /// Moves the files to a file system in memory of this size. Returns `false` if mounting is not permitted.
    ///
    /// # Errors
    /// If the files do not fit or cannot be copied.
    pub(super) fn on_small_disk(&mut self, bytes: u64) -> Result<bool, Failure> {
        let kept = files::read(&self.folder)?;
        self.is_mounted = self.mount(&["-t", "tmpfs", "-o", &format!("size={}", bytes + RESERVE), "tmpfs"]);
        if self.is_mounted {
            files::write(&kept, &self.folder)?;
        }
        Ok(self.is_mounted)
    }

    /// Gives the file system in memory, if there is one, enough space.
    ///
    /// # Errors
    /// If that fails.
    pub(super) fn enlarge_disk(&self) -> Outcome {
        if self.is_mounted && !self.mount(&["-o", "remount,size=1g"]) {
            return Err(Failure::new(format!("{}: cannot be mounted with more space", self.folder.display())));
        }
        Ok(())
    }

    fn mount(&self, arguments: &[&str]) -> bool {
        let mut command = Command::new("mount");
        command.args(arguments).arg(&self.folder).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    }

    fn unmount(&mut self) -> Outcome {
        if self.is_mounted {
            let status = Command::new("umount").arg(&self.folder).status();
            if !status.is_ok_and(|status| status.success()) {
                return Err(Failure::new(format!("{}: cannot be unmounted", self.folder.display())));
            }
            self.is_mounted = false;
        }
        Ok(())
    }
}

impl Drop for Workspace {
    fn drop(&mut self) {
        self.stop_helpers();
        // A failure before is reported; the file system remains then.
        let _ = self.unmount();
    }
}
