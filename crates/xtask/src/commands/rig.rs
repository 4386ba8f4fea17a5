//! `cargo xtask rig`: the calibration platform on the emulated rig, from the first session to live inference, against its bounds. Source of the figures in `docs/PLATFORM.md`.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::failure::{Failure, Outcome};
use crate::parts::step;
use crate::repository::root;
use crate::repository::words;
use crate::tools::{cargo, run as run_command};

/// Folder of all files.
const FOLDER: &str = "target/rig";
/// The documented call, {6, 100, 0, 15, 0}.
const FIRST: [&str; 10] = ["--x", "6", "--y", "100", "--increments-x", "0", "--increments-y", "15", "--pause", "0"];
/// Number of its places.
const FIRST_PLACES: f64 = 16.0;
/// A session at other places, except for the one nearest to the tip.
const SECOND: [&str; 6] = ["--x", "6", "--y", "97", "--increments-y", "13"];
const SECOND_PLACES: f64 = 14.0;
const CALIBRATION: &str = "calibration.json";
/// Distance at which the outer 70 mm of the whisker begin (mm).
const OUTER_MM: f64 = 80.0;
/// Largest number of readings in transit when a session closes the port: a tenth of a second.
const IN_TRANSIT: f64 = 80.0;
/// Maximum start-up time of the emulated devices.
const STARTUP_LIMIT: Duration = Duration::from_secs(10);

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let soak_s = soak_s(arguments)?;
    let folder = root().join(FOLDER);
    // A session does not overwrite a recording.
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).map_err(|error| failed(&folder, &error))?;
    step("the command whisker", || run_command(cargo(&["build", "--release", "--package", "whisker-cli"])))?;
    let mut bars = Vec::new();
    step("a session at the documented places, recorded as a log and as messages", || first(&mut bars))?;
    step("the messages, read back", || messages(&mut bars))?;
    step("the fit", fit)?;
    step("a session at other places, estimated live", || second(&mut bars))?;
    println!();
    bars.iter().for_each(|bar| println!("{bar}"));
    if let Some(soak_s) = soak_s {
        step(&format!("{soak_s} s of 800 readings per second into a recording"), || soak(soak_s))?;
    }
    let missed = bars.iter().filter(|bar| !bar.is_met()).count();
    if missed > 0 { Err(Failure::new(format!("{missed} of {} bars missed", bars.len()))) } else { Ok(()) }
}

fn first(bars: &mut Vec<Bar>) -> Outcome {
    let (_, lost) = session("1", "first", &[&FIRST[..], &["--bag", &in_folder("first_bag")]].concat())?;
    let places = read("first/log.json")?.matches("\"distance_m\"").count();
    bars.push(Bar::new("places visited in the first session", places as f64, At::Exactly(FIRST_PLACES), ""));
    bars.push(Bar::new("samples lost in the first session", lost, At::Exactly(0.0), ""));
    Ok(())
}

fn messages(bars: &mut Vec<Bar>) -> Outcome {
    print!("{}", whisker(&["bag", "info", &in_folder("first_bag")])?.stdout);
    whisker(&["bag", "import", &in_folder("first_bag"), "--out", &in_folder("imported")])?;
    let mut differ = 0;
    for file in ["log.csv", "log.json"] {
        differ += u32::from(read(&format!("first/{file}"))? != read(&format!("imported/{file}"))?);
    }
    bars.push(Bar::new("files that differ after import from the recording", differ.into(), At::Exactly(0.0), ""));
    Ok(())
}

fn fit() -> Outcome {
    let (log, calibration) = (in_folder("imported/log.csv"), in_folder(CALIBRATION));
    print!("{}", whisker(&["platform", "fit", &log, "--out", &calibration])?.stdout);
    Ok(())
}

fn second(bars: &mut Vec<Bar>) -> Outcome {
    let calibrated = ["--calibration", &in_folder(CALIBRATION), "--print", "csv"];
    let (output, lost) = session("2", "second", &[&SECOND[..], &calibrated].concat())?;
    let pushes = pushes(&output.stdout)?;
    let errors_mm = |from_mm: f64| -> Vec<f64> {
        pushes.iter().filter(|push| push.distance_mm >= from_mm).filter_map(|push| push.error_mm).collect()
    };
    let (all, outer) = (errors_mm(0.0), errors_mm(OUTER_MM));
    let late_ms = number(&output.stderr, "99 % ").ok_or_else(|| unknown("latency", &output.stderr))?;
    bars.extend([
        Bar::new("places visited in the second session", pushes.len() as f64, At::Exactly(SECOND_PLACES), ""),
        Bar::new("samples lost in the second session", lost, At::Exactly(0.0), ""),
        Bar::new("pushes not detected", (pushes.len() - all.len()) as f64, At::Exactly(0.0), ""),
        Bar::new("RMSE over all places", rms(&all), At::Most(2.0), "mm"),
        Bar::new("largest error over all places", worst(&all), At::Any, "mm"),
        Bar::new("RMSE in the outer 70 mm", rms(&outer), At::Any, "mm"),
        Bar::new("largest error in the outer 70 mm", worst(&outer), At::Most(2.0), "mm"),
        Bar::new("99th-percentile latency, arrival to report", late_ms, At::Most(5.0), "ms"),
    ]);
    Ok(())
}

fn soak_s(arguments: &[String]) -> Result<Option<u32>, Failure> {
    let found = arguments.iter().map(String::as_str).collect::<Vec<_>>();
    match found[..] {
        [] => Ok(None),
        ["--soak", seconds] => match seconds.parse() {
            Ok(seconds) if seconds > 0 => Ok(Some(seconds)),
            _ => Err(Failure::new(format!("--soak: found `{seconds}`, expected seconds above zero"))),
        },
        _ => Err(Failure::new(format!("found `{}`, expected [--soak SECONDS]", found.join(" ")))),
    }
}

/// Runs the soak test, which has its own bounds.
fn soak(soak_s: u32) -> Outcome {
    let mut test =
        cargo(&["test", "--release", "--package", "platform", "--test", "soak", "--", "--ignored", "--nocapture"]);
    test.env("WHISKER_SOAK_S", soak_s.to_string());
    run_command(test)
}

/// Runs a session on a newly emulated rig with this seed. Returns its output and the number of lost samples.
fn session(seed: &str, name: &str, options: &[&str]) -> Result<(Output, f64), Failure> {
    let rig = Rig::start(seed)?;
    let [printer, sensor] = ["printer", "sensor"].map(in_folder);
    let out = in_folder(name);
    let ports = ["platform", "run", "--printer", &printer, "--sensor", &sensor, "--out", &out];
    let output = whisker(&[&ports, options].concat())?;
    eprint!("{}", output.stderr);
    let sent = rig.stop()?;
    let [readings, dropped] =
        ["readings ", "dropped "].map(|quantity| number(&sent, quantity).ok_or_else(|| unknown(quantity, &sent)));
    let rows = read(&format!("{name}/log.csv"))?.lines().count() - 1;
    // Printed readings that are not in the log, except for those in transit at the end.
    Ok((output, dropped? + (readings? - rows as f64 - IN_TRANSIT).max(0.0)))
}

/// The emulated devices.
struct Rig(Child);

impl Rig {
    fn start(seed: &str) -> Result<Self, Failure> {
        let links = ["printer", "sensor"].map(|port| root().join(in_folder(port)));
        for link in &links {
            // The link does not exist before the first session.
            let _ = fs::remove_file(link);
        }
        let [printer, sensor] = ["printer", "sensor"].map(in_folder);
        let mut command =
            program(&["platform", "emulate", "--printer-link", &printer, "--sensor-link", &sensor, "--seed", seed]);
        command.stdout(Stdio::piped());
        let child = command.spawn().map_err(|error| Failure::new(format!("`{}`: {error}", words(&command))))?;
        let (rig, begun) = (Self(child), Instant::now());
        while !links.iter().all(|link| link.exists()) {
            if begun.elapsed() > STARTUP_LIMIT {
                return Err(Failure::new(format!(
                    "the emulated ports did not appear within {} s",
                    STARTUP_LIMIT.as_secs()
                )));
            }
            sleep(Duration::from_millis(10));
        }
        Ok(rig)
    }

    /// Ends the devices and returns their output.
    fn stop(mut self) -> Result<String, Failure> {
        let mut kill = Command::new("kill");
        kill.arg(self.0.id().to_string());
        run_command(kill)?;
        let mut text = String::new();
        let mut output = self.0.stdout.take().ok_or_else(|| Failure::new("the emulation has no output"))?;
        std::io::Read::read_to_string(&mut output, &mut text).map_err(|error| Failure::new(error.to_string()))?;
        Ok(text)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Output of a command.
struct Output {
    stdout: String,
    stderr: String,
}

/// Runs a command of the built `whisker` to its end.
fn whisker(arguments: &[&str]) -> Result<Output, Failure> {
    let mut command = program(arguments);
    let output = command.output().map_err(|error| Failure::new(format!("`{}`: {error}", words(&command))))?;
    let [stdout, stderr] = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    if output.status.success() {
        return Ok(Output { stdout, stderr });
    }
    Err(Failure::new(format!("`{}` ended with {}: {}", words(&command), output.status, stderr.trim())))
}

fn program(arguments: &[&str]) -> Command {
    let mut command = Command::new(root().join("target/release/whisker"));
    command.args(arguments).current_dir(root());
    command
}

/// A push of the printer, and the error of the last press with its onset in the push.
struct Push {
    distance_mm: f64,
    error_mm: Option<f64>,
}

/// Pushes in a table of events.
fn pushes(events: &str) -> Result<Vec<Push>, Failure> {
    let (mut pushes, mut last) = (Vec::new(), None);
    for line in events.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells.get(column).and_then(|cell| cell.parse::<f64>().ok());
        match (cells.get(1), number(0), number(2), number(3)) {
            (Some(&"pressed"), Some(_), Some(onset_s), distance_m) => last = Some((onset_s, distance_m)),
            (Some(&"released"), ..) => {}
            (Some(&"pushed"), Some(end_s), Some(start_s), Some(distance_m)) => {
                let found = last.filter(|(onset_s, _)| (start_s..end_s).contains(onset_s));
                let error_mm = found.and_then(|(_, found_m)| found_m).map(|found_m| 1e3 * (found_m - distance_m));
                pushes.push(Push { distance_mm: 1e3 * distance_m, error_mm });
            }
            _ => return Err(unknown("event", line)),
        }
    }
    Ok(pushes)
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn worst(values: &[f64]) -> f64 {
    values.iter().fold(f64::NAN, |worst, value| worst.max(value.abs()))
}

/// Number after these words.
fn number(text: &str, words: &str) -> Option<f64> {
    text.split_once(words)?.1.split_whitespace().next()?.parse().ok()
}

/// Bound of a figure.
enum At {
    Most(f64),
    Exactly(f64),
    Any,
}

/// A figure and its bound.
struct Bar {
    name: &'static str,
    found: f64,
    bar: At,
    unit: &'static str,
}

impl Bar {
    fn new(name: &'static str, found: f64, bar: At, unit: &'static str) -> Self {
        Self { name, found, bar, unit }
    }

    fn is_met(&self) -> bool {
        match self.bar {
            At::Most(most) => self.found <= most,
            At::Exactly(expected) => self.found == expected,
            At::Any => true,
        }
    }
}

impl std::fmt::Display for Bar {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, found, unit, .. } = self;
        let decimals = if unit.is_empty() { 0 } else { 3 };
        write!(out, "{name:44} {found:8.decimals$} {unit:2}")?;
        match self.bar {
            At::Most(most) => write!(out, "  at most {most} {unit}")?,
            At::Exactly(expected) => write!(out, "  {expected} {unit}")?,
            At::Any => return Ok(()),
        }
        if self.is_met() { Ok(()) } else { write!(out, "  MISSED") }
    }
}

fn in_folder(name: &str) -> String {
    format!("{FOLDER}/{name}")
}

fn read(name: &str) -> Result<String, Failure> {
    let path = root().join(in_folder(name));
    fs::read_to_string(&path).map_err(|error| failed(&path, &error))
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(format!("{}: {error}", path.display()))
}

fn unknown(quantity: &str, found: &str) -> Failure {
    Failure::new(format!("no {} in `{}`", quantity.trim(), found.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_push_has_the_error_of_the_press_before_it() {
        let events = "t_s,event,onset_s,distance_m,low_m,high_m,slope_counts_per_s\n\
            1.5,pressed,1.2,0.1441,,,9.0\n1.6,released,,,,,\n2.0,pushed,1.0,0.145,,,\n\
            4.0,pushed,3.0,0.1,,,\n5.5,pressed,5.2,,,,1.0\n6.0,pushed,5.0,0.05,,,\n";
        let found = pushes(events).expect("a table");
        let errors: Vec<_> = found.iter().map(|push| push.error_mm.map(|mm| (1e3 * mm).round())).collect();
        assert_eq!(errors, [Some(-900.0), None, None]);
        assert!(pushes("header\nnonsense\n").is_err());
    }

    #[test]
    fn a_bar_is_missed_by_a_figure_beyond_it_and_by_no_figure() {
        assert!(!Bar::new("RMSE", rms(&[]), At::Most(2.0), "mm").is_met());
        assert!(!Bar::new("worst", worst(&[]), At::Most(2.0), "mm").is_met());
        assert_eq!(
            Bar::new("worst", worst(&[1.0, -3.0]), At::Most(2.0), "mm").to_string().split_whitespace().last(),
            Some("MISSED")
        );
    }

    #[test]
    fn arguments_choose_the_soak() {
        let chosen = |words: &[&str]| soak_s(&words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
        assert_eq!(chosen(&[]).unwrap(), None);
        assert_eq!(chosen(&["--soak", "600"]).unwrap(), Some(600));
        assert!(chosen(&["--soak"]).is_err() && chosen(&["--soak", "0"]).is_err() && chosen(&["fast"]).is_err());
    }
}
