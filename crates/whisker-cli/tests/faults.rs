//! Machine faults and untrusted files: an existing file stays unchanged or is replaced as a whole, no file outside the
//! folder is written, and the error is one line.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use files::{sha256, write_atomically};
use tempfile::TempDir;
use trace::{Role, Trace};

/// Times at which a running command is killed, as fractions of its duration.
const MOMENTS: [f64; 4] = [0.1, 0.4, 0.7, 0.95];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Working folder with golden traces as trial and calibration, a clone of the recordings, and the files written by the commands.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        // Readable by every user: some of the commands run as another user.
        fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).unwrap();
        let bench = Self { folder };
        let golden = root().join("datasets/golden");
        for (of, name, role) in
            [("pin", "pin", Role::Trial), ("pin", "grid_0", Role::Calibration), ("circle", "grid_1", Role::Calibration)]
        {
            let mut trace = Trace::read(&golden.join(format!("golden_{of}.csv"))).unwrap();
            (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
            trace.sidecar.csv_sha256 = sha256(trace.to_csv());
            trace.write(&bench.path("traces")).unwrap();
        }
        let clone = fs::read(root().join("fuzz/corpus/import/clone.txt")).unwrap();
        const CUT: &[u8] = b"\n%%%\n";
        let mut rest = clone.as_slice();
        for file in [
            "all_datasets/calibration/sensor1_tip_calib_May_04.csv",
            "all_datasets/test/tip_test_05_04/tip_test_cylinder_30mm_May_04_trial1.csv",
            "3d_data/ConeFixture.stl",
        ] {
            let cut = rest.windows(CUT.len()).position(|window| window == CUT).unwrap_or(rest.len());
            write_atomically(&bench.path("clone/data").join(file), &rest[..cut]).unwrap();
            rest = rest.get(cut + CUT.len()..).unwrap_or_default();
        }
        bench
    }

    /// Copy in another folder.
    fn copy(&self) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let files = self.folder.path().join(".");
        assert!(Command::new("cp").arg("-r").arg(files).arg(folder.path()).status().unwrap().success());
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Command with these arguments, separated by spaces, with paths relative to the folder.
    fn command(&self, command_line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whisker"));
        command.args(command_line.split(' ')).current_dir(self.folder.path());
        command
    }

    fn run(&self, command_line: &str) -> Output {
        self.command(command_line).output().unwrap()
    }

    fn good(&self, command_line: &str) {
        let output = self.run(command_line);
        assert!(output.status.success(), "{command_line}: {}", String::from_utf8_lossy(&output.stderr));
    }

    /// Contents of every finished file by its path in the folder, without hidden (unfinished) files and files with
    /// wall-clock times.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut folders = vec![self.folder.path().to_path_buf()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.file_name().unwrap().to_string_lossy().starts_with('.') {
                    continue;
                }
                if path.is_dir() {
                    folders.push(path);
                } else if path.file_name().unwrap() != "summary.csv" && path.extension().is_none_or(|it| it != "html") {
                    files.insert(path.strip_prefix(self.folder.path()).unwrap().into(), fs::read(&path).unwrap());
                }
            }
        }
        files
    }
}

const FIT: &str = "fit traces --model elastica";
const EVALUATE: &str = "evaluate traces --estimators ekf --seeds 2 --results results --name run";
const REPORT: &str = "report results/run";

const IMPORT: &str = "import stanford-whisker clone --out imported";

/// Commands that write files, in the order of the pipeline.
const COMMANDS: [&str; 4] = [IMPORT, FIT, EVALUATE, REPORT];

/// Asserts that a command failed with a single error line that contains every one of `words`.
fn refused(output: &Output, words: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.starts_with("error: ") && text.trim_end().lines().count() == 1 && !text.contains("panicked"),
        "{text}"
    );
    for word in words {
        assert!(text.contains(word), "does not contain `{word}`: {text}");
    }
}

#[test]
fn robust_a_full_disk_leaves_existing_files_unchanged() {
    let bench = Bench::new();
    for command_line in COMMANDS {
        let before = bench.files();
        // A limit on the size of files emulates a full disk.
        let mut command = Command::new("sh");
        command.args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_whisker")]);
        let output = command.args(command_line.split(' ')).current_dir(bench.folder.path()).output().unwrap();
        refused(&output, &["File too large"]);
        for (path, bytes) in bench.files() {
            let whole = before.get(&path).is_none_or(|before| *before == bytes);
            assert!(whole, "{command_line}: {}", path.display());
        }
        assert!(before.keys().all(|path| bench.folder.path().join(path).is_file()), "{command_line}: a file is lost");
        bench.good(command_line);
    }
}

#[test]
fn robust_a_read_only_folder_is_an_error() {
    let bench = Bench::new();
    COMMANDS.iter().for_each(|command_line| bench.good(command_line));
    let before = bench.files();
    // File modes do not restrict root: the commands run as an unprivileged user.
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout == b"0\n");
    let program = Path::new(env!("CARGO_BIN_EXE_whisker"));
    let unprivileged = ["--reuid=65534", "--regid=65534", "--clear-groups"];
    let may_run = !is_root
        || Command::new("setpriv")
            .args(unprivileged)
            .arg(program)
            .arg("list")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success());
    if !may_run {
        eprintln!("skipped: run by root, and no other user can run {}", program.display());
        return;
    }
    for folder in ["traces/calibrations", "traces", "results/run", "results"] {
        let mode = if is_root { 0o755 } else { 0o555 };
        fs::set_permissions(bench.path(folder), Permissions::from_mode(mode)).unwrap();
    }
    let command_lines = [
        "fit traces --model spline",
        "evaluate traces --estimators ekf --seeds 3 --results results --name run --force",
        "evaluate traces --estimators ekf --seeds 3 --results results --name other",
        REPORT,
    ];
    for command_line in command_lines {
        let mut command = if is_root { Command::new("setpriv") } else { Command::new("env") };
        if is_root {
            command.args(unprivileged);
        }
        let output =
            command.arg(program).args(command_line.split(' ')).current_dir(bench.folder.path()).output().unwrap();
        refused(&output, &["Permission denied"]);
        assert!(bench.files() == before, "{command_line}: a file changed");
    }
    for folder in ["traces/calibrations", "traces", "results/run", "results"] {
        fs::set_permissions(bench.path(folder), Permissions::from_mode(0o755)).unwrap();
    }
}

#[test]
fn robust_a_command_killed_at_any_time_loses_no_files() {
    let whole = Bench::new();
    for command_line in COMMANDS {
        let initial = whole.copy();
        let begin = Instant::now();
        whole.good(command_line);
        let duration = begin.elapsed();
        let (before, expected) = (initial.files(), whole.files());
        for share in MOMENTS {
            let bench = initial.copy();
            let mut child = bench.command(command_line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            sleep(duration.mul_f64(share).min(Duration::from_secs(30)));
            child.kill().unwrap();
            child.wait().unwrap();
            assert!(
                before.keys().all(|path| bench.folder.path().join(path).is_file()),
                "{command_line} killed at {share}: a file is lost"
            );
            // A rerun gives the files of an undisturbed command: partial files do not interfere.
            bench.good(command_line);
            let found = bench.files();
            assert!(found.keys().eq(expected.keys()), "{command_line} killed at {share}: other files");
            for (path, bytes) in &found {
                assert!(expected[path] == *bytes, "{command_line} killed at {share}: {} differs", path.display());
            }
        }
    }
}

#[test]
fn robust_links_to_folders_are_followed_and_links_to_files_replaced() {
    let bench = Bench::new();
    bench.good(FIT);
    fs::create_dir(bench.path("elsewhere")).unwrap();
    symlink(bench.path("elsewhere"), bench.path("results")).unwrap();
    bench.good(EVALUATE);
    assert!(bench.path("elsewhere/run/run.json").is_file(), "results are written to the folder to which a link points");
    let precious = bench.path("precious.txt");
    fs::write(&precious, "years of work").unwrap();
    let calibration = bench.path("traces/calibrations/straight.json");
    fs::remove_file(&calibration).unwrap();
    symlink(&precious, &calibration).unwrap();
    bench.good(FIT);
    assert!(!fs::symlink_metadata(&calibration).unwrap().is_symlink());
    assert_eq!(fs::read_to_string(&precious).unwrap(), "years of work");
    let page = bench.path("results/run/index.html");
    symlink(&precious, &page).unwrap();
    bench.good(REPORT);
    assert!(fs::read_to_string(&page).unwrap().contains("<html"));
    assert_eq!(fs::read_to_string(&precious).unwrap(), "years of work");
}

/// Replaces a text in a file.
fn change(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{}: no {from}", path.display());
    fs::write(path, text.replace(from, to)).unwrap();
}

#[test]
fn robust_names_do_not_lead_out_of_the_folder() {
    let bench = Bench::new();
    COMMANDS.iter().for_each(|command_line| bench.good(command_line));
    let before = bench.files();
    let group = serde_json::from_slice::<serde_json::Value>(&fs::read(bench.path("traces/pin.json")).unwrap()).unwrap()
        ["group"]
        .to_string();
    let wrong = [r#""x/../../../elsewhere""#, r#""/tmp/elsewhere""#, r#""..""#, r#""a\nb""#, r#""a\u0000b""#, r#""""#];
    for name in wrong {
        for (file, key, was, command_line) in [
            ("traces/pin.json", "group", format!("\"group\": {group}"), EVALUATE),
            ("traces/pin.json", "name", "\"name\": \"pin\"".to_owned(), EVALUATE),
            ("traces/calibrations/straight.json", "name", "\"name\": \"straight\"".to_owned(), EVALUATE),
            ("results/run/run.json", "group", format!("\"group\": {group}"), REPORT),
        ] {
            let path = bench.path(file);
            change(&path, &was, &format!("\"{key}\": {name}"));
            refused(&bench.run(command_line), &[file.rsplit('/').next().unwrap(), key, "a plain file name"]);
            fs::write(&path, &before[Path::new(file)]).unwrap();
            assert!(bench.files() == before, "{file}: {name}: another file was written");
        }
    }
}

#[test]
fn robust_a_link_to_an_endless_file_is_refused() {
    let bench = Bench::new();
    let sidecar = bench.path("traces/pin.json");
    fs::remove_file(&sidecar).unwrap();
    symlink("/dev/zero", &sidecar).unwrap();
    refused(&bench.run("check traces/pin.csv"), &["pin.json", "size", "a smaller file"]);
}

#[test]
fn robust_names_on_the_page_are_escaped() {
    const MARKUP: &str = "<img src=x onerror=alert(1)>&amp;";
    let bench = Bench::new();
    bench.good(FIT);
    let group = serde_json::from_slice::<serde_json::Value>(&fs::read(bench.path("traces/pin.json")).unwrap()).unwrap()
        ["group"]
        .as_str()
        .unwrap()
        .to_owned();
    let path = bench.path("traces/pin.json");
    change(&path, &format!("\"group\": \"{group}\""), &format!("\"group\": \"{MARKUP}\""));
    COMMANDS.iter().for_each(|command_line| bench.good(command_line));
    let page = fs::read_to_string(bench.path("results/run/index.html")).unwrap();
    assert!(page.contains("&lt;img src=x"), "the name is shown");
    assert!(!page.contains("<img src=x"));
    for entry in fs::read_dir(bench.path("results/run/figures")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "svg") {
            assert!(!fs::read_to_string(&path).unwrap().contains("<img"), "{}", path.display());
        }
    }
}

/// Replays a golden trial with changed lines and a sidecar that agrees with them.
fn trial(bench: &Bench, change: impl FnOnce(&mut Vec<String>)) -> Output {
    let (csv, sidecar) = (bench.path("traces/pin.csv"), bench.path("traces/pin.json"));
    let text = fs::read_to_string(&csv).unwrap();
    let mut lines: Vec<String> = text.lines().map(Into::into).collect();
    change(&mut lines);
    let changed = lines.join("\n") + "\n";
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&sidecar).unwrap()).unwrap();
    value["rows"] = (lines.len() - 1).into();
    value["csv_sha256"] = sha256(&changed).into();
    value["certificate"] = serde_json::Value::Null;
    fs::write(&csv, changed).unwrap();
    fs::write(&sidecar, value.to_string()).unwrap();
    bench.run("replay traces/pin.csv --estimator ekf")
}

#[test]
fn robust_gaps_are_accepted_and_damaged_rows_are_reported_with_their_line() {
    let fitted = Bench::new();
    fitted.good(FIT);
    let bench = fitted.copy();
    // A repeated row, rows out of order, and numbers that are not finite or too large.
    refused(&trial(&bench, |lines| lines.insert(40, lines[39].clone())), &["pin.csv:41", "t_s", "order of time"]);
    let bench = fitted.copy();
    refused(&trial(&bench, |lines| lines.swap(50, 51)), &["pin.csv:52", "t_s", "order of time"]);
    for wrong in ["NaN", "inf", "-Infinity", "1e999", "0x1p3", "1_0", "\"1\"5"] {
        let bench = fitted.copy();
        let damage = |lines: &mut Vec<String>| {
            let mut cells: Vec<&str> = lines[60].split(',').collect();
            cells[7] = wrong;
            lines[60] = cells.join(",");
        };
        refused(&trial(&bench, damage), &["pin.csv:61", "moment_z_n_m", wrong, "a finite number"]);
    }
    for (column, wrong, name, most) in
        [(7, "1e300", "moment_z_n_m", "1000"), (1, "-1e9", "base_x_m", "1000"), (3, "1e7", "base_yaw_rad", "1000000")]
    {
        let bench = fitted.copy();
        let damage = |lines: &mut Vec<String>| {
            let mut cells: Vec<&str> = lines[60].split(',').collect();
            cells[column] = wrong;
            lines[60] = cells.join(",");
        };
        refused(&trial(&bench, damage), &["pin.csv:61", name, wrong, &format!("a number of at most {most}")]);
    }
    let bench = fitted.copy();
    // Twenty consecutive rows and a single row are missing.
    let gap = trial(&bench, |lines| {
        lines.drain(200..220);
        lines.remove(120);
    });
    assert!(gap.status.success(), "{}", String::from_utf8_lossy(&gap.stderr));
}

#[test]
fn robust_no_memory_is_allocated_for_a_claimed_size() {
    let bench = Bench::new();
    bench.good(FIT);
    // A sparse file of 1 TiB, and a sidecar that states 10^15 rows.
    let (csv, sidecar) = (bench.path("traces/pin.csv"), bench.path("traces/pin.json"));
    fs::OpenOptions::new().append(true).open(&csv).unwrap().set_len(1 << 40).unwrap();
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&sidecar).unwrap()).unwrap();
    value["rows"] = 1_000_000_000_000_000_u64.into();
    fs::write(&sidecar, value.to_string()).unwrap();
    refused(&bench.run("evaluate traces --estimators ekf"), &["pin.csv", "more than", "bytes"]);
}

#[test]
fn robust_permissions_of_results_follow_the_umask() {
    for (mask, mode) in [("077", 0o600), ("002", 0o664)] {
        let bench = Bench::new();
        let mut command = Command::new("sh");
        command.args(["-c", &format!("umask {mask}; exec \"$0\" {FIT}"), env!("CARGO_BIN_EXE_whisker")]);
        assert!(command.current_dir(bench.folder.path()).output().unwrap().status.success());
        let calibration = fs::read_dir(bench.path("traces/calibrations")).unwrap().next().unwrap().unwrap();
        assert_eq!(calibration.metadata().unwrap().permissions().mode() & 0o777, mode, "{mask}");
    }
}
