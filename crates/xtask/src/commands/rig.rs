//! `cargo xtask rig`: the calibration platform on the emulated rig, from the first session to live inference, against
//! its bounds. `--runs N` repeats it with other seeds and writes the distribution of its errors, the source of the
//! figures in `docs/PLATFORM.md`.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use crate::failure::{Failure, Outcome};
use crate::parts::step;
use crate::repository::root;
use crate::repository::words;
use crate::tools::{build_whisker, built_whisker, cargo, run as run_command};

/// Folder of all files, with a folder for each run.
const FOLDER: &str = "target/rig";
/// Table of the runs.
const TABLE: &str = "results/reference/platform_rig.csv";
/// Number of runs at a time: devices and driver run in real time and mostly wait.
const AT_A_TIME: u32 = 4;
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
    let Asked { runs, soak_s } = asked(arguments)?;
    let folder = root().join(FOLDER);
    // A session does not overwrite a recording.
    let _ = fs::remove_dir_all(&folder);
    step("the command whisker", || build_whisker().map_or(Ok(()), run_command))?;
    let bars = match runs {
        1 => one_run()?,
        runs => several_runs(runs)?,
    };
    println!();
    bars.iter().filter(|bar| runs == 1 || !bar.is_met()).for_each(|bar| println!("{bar}"));
    if let Some(soak_s) = soak_s {
        step(&format!("{soak_s} s of 800 readings per second into a recording"), || soak(soak_s))?;
    }
    let missed = bars.iter().filter(|bar| !bar.is_met()).count();
    if missed > 0 { Err(Failure::new(format!("{missed} of {} bars missed", bars.len()))) } else { Ok(()) }
}

/// One run, step by step, with the way through a recording.
fn one_run() -> Result<Vec<Bar>, Failure> {
    let (run, mut bars) = (Run::new(1)?, Vec::new());
    step("a session at the documented places, recorded as a log and as messages", || {
        run.first(&["--bag", &run.file("bag")], &mut bars)
    })?;
    step("the messages, read back", || run.messages(&mut bars))?;
    step("the fit", || run.fit("imported"))?;
    step("a session at other places, estimated live", || run.second(&mut bars).map(drop))?;
    Ok(bars)
}

/// Many runs with different seeds, some at a time, and the table of their errors.
fn several_runs(runs: u32) -> Result<Vec<Bar>, Failure> {
    let (mut bars, mut errors) = (Vec::new(), Vec::new());
    let numbers: Vec<u32> = (1..=runs).collect();
    for some in numbers.chunks(AT_A_TIME as usize) {
        step(&format!("runs {} to {} of {runs}", some[0], some[some.len() - 1]), || {
            let ended: Vec<_> = thread::scope(|scope| {
                let started: Vec<_> = some.iter().map(|&number| scope.spawn(move || whole_run(number))).collect();
                started.into_iter().map(|run| run.join().expect("a run does not panic")).collect()
            });
            for run in ended {
                let (of_run, errors_of_run) = run?;
                errors.push(errors_of_run);
                bars.extend(of_run);
            }
            Ok(())
        })?;
    }
    let path = root().join(TABLE);
    let rows: String = errors.iter().map(Errors::row).collect();
    fs::write(&path, format!("{}{rows}", Errors::HEADER)).map_err(|error| failed(&path, &error))?;
    let of = |quantity: fn(&Errors) -> f64| distribution(errors.iter().map(quantity).collect());
    let [places, inside] = [|errors: &Errors| errors.places, |errors: &Errors| errors.inside_interval]
        .map(|count| errors.iter().map(count).sum::<usize>());
    println!("\n{runs} runs: median, 5th to 95th percentile, largest (mm)");
    println!("RMSE over all places            {}", of(|errors| errors.rmse_mm));
    println!("largest error over all places   {}", of(|errors| errors.worst_mm));
    println!("largest error in the outer 70 mm {}", of(|errors| errors.outer_worst_mm));
    println!("{inside} of {places} distances inside their interval; {TABLE}");
    Ok(bars)
}

/// Median, 5th and 95th percentile and maximum.
fn distribution(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    format!("{:.2}, {:.2} to {:.2}, {:.2}", at(0.5), at(0.05), at(0.95), at(1.0))
}

fn whole_run(number: u32) -> Result<(Vec<Bar>, Errors), Failure> {
    let (run, mut bars) = (Run::new(number)?, Vec::new());
    run.first(&[], &mut bars)?;
    run.fit("first")?;
    let errors = run.second(&mut bars)?;
    Ok((bars, errors))
}

/// A run: a session, its fit, and a second session with live estimates.
struct Run {
    number: u32,
}

/// Errors of a run at the places of its second session.
struct Errors {
    number: u32,
    places: usize,
    not_detected: usize,
    inside_interval: usize,
    lost_samples: f64,
    rmse_mm: f64,
    worst_mm: f64,
    outer_rmse_mm: f64,
    outer_worst_mm: f64,
}

impl Errors {
    const HEADER: &str = "run,seed_first,seed_second,places,not_detected,inside_interval,lost_samples,rmse_mm,worst_mm,outer_rmse_mm,outer_worst_mm\n";

    fn row(&self) -> String {
        let Self { number, places, not_detected, inside_interval, lost_samples, .. } = self;
        let [first, second] = seeds(*number);
        let errors = [self.rmse_mm, self.worst_mm, self.outer_rmse_mm, self.outer_worst_mm];
        let errors: Vec<String> = errors.iter().map(|error_mm| format!("{error_mm:.4}")).collect();
        let errors = errors.join(",");
        format!("{number},{first},{second},{places},{not_detected},{inside_interval},{lost_samples:.0},{errors}\n")
    }
}

/// Seeds of the noise in the two sessions of a run.
fn seeds(number: u32) -> [u32; 2] {
    [2 * number - 1, 2 * number]
}

impl Run {
    fn new(number: u32) -> Result<Self, Failure> {
        let run = Self { number };
        let folder = root().join(run.file(""));
        fs::create_dir_all(&folder).map_err(|error| failed(&folder, &error))?;
        Ok(run)
    }

    /// Path of a file of the run, relative to the repository.
    fn file(&self, name: &str) -> String {
        format!("{FOLDER}/{}/{name}", self.number)
    }

    fn read(&self, name: &str) -> Result<String, Failure> {
        let path = root().join(self.file(name));
        fs::read_to_string(&path).map_err(|error| failed(&path, &error))
    }

    fn first(&self, options: &[&str], bars: &mut Vec<Bar>) -> Outcome {
        let (_, lost) = self.session(seeds(self.number)[0], "first", &[&FIRST[..], options].concat())?;
        let places = self.read("first/log.json")?.matches("\"distance_m\"").count();
        bars.push(Bar::new("places visited in the first session", places as f64, At::Exactly(FIRST_PLACES), ""));
        bars.push(Bar::new("samples lost in the first session", lost, At::Exactly(0.0), ""));
        Ok(())
    }

    fn messages(&self, bars: &mut Vec<Bar>) -> Outcome {
        print!("{}", whisker(&["bag", "info", &self.file("bag")])?.stdout);
        whisker(&["bag", "import", &self.file("bag"), "--out", &self.file("imported")])?;
        let mut differ = 0;
        for file in ["log.csv", "log.json"] {
            differ += u32::from(self.read(&format!("first/{file}"))? != self.read(&format!("imported/{file}"))?);
        }
        bars.push(Bar::new("files that differ after import from the recording", differ.into(), At::Exactly(0.0), ""));
        Ok(())
    }

    fn fit(&self, log: &str) -> Outcome {
        let (log, calibration) = (self.file(&format!("{log}/log.csv")), self.file(CALIBRATION));
        print!("{}", whisker(&["platform", "fit", &log, "--out", &calibration])?.stdout);
        Ok(())
    }

    fn second(&self, bars: &mut Vec<Bar>) -> Result<Errors, Failure> {
        let calibrated = ["--calibration", &self.file(CALIBRATION), "--print", "csv"];
        let options = [&SECOND[..], &calibrated].concat();
        let (output, lost_samples) = self.session(seeds(self.number)[1], "second", &options)?;
        let pushes = pushes(&output.stdout)?;
        let errors_mm = |from_mm: f64| -> Vec<f64> {
            pushes.iter().filter(|push| push.distance_mm >= from_mm).filter_map(|push| push.error_mm).collect()
        };
        let (all, outer) = (errors_mm(0.0), errors_mm(OUTER_MM));
        let late_ms = number(&output.stderr, "99 % ").ok_or_else(|| unknown("latency", &output.stderr))?;
        let errors = Errors {
            number: self.number,
            places: pushes.len(),
            not_detected: pushes.len() - all.len(),
            inside_interval: pushes.iter().filter(|push| push.is_inside).count(),
            lost_samples,
            rmse_mm: rms(&all),
            worst_mm: worst(&all),
            outer_rmse_mm: rms(&outer),
            outer_worst_mm: worst(&outer),
        };
        bars.extend([
            Bar::new("places visited in the second session", errors.places as f64, At::Exactly(SECOND_PLACES), ""),
            Bar::new("samples lost in the second session", lost_samples, At::Exactly(0.0), ""),
            Bar::new("pushes not detected", errors.not_detected as f64, At::Exactly(0.0), ""),
            Bar::new("RMSE over all places", errors.rmse_mm, At::Most(2.0), "mm"),
            Bar::new("largest error over all places", errors.worst_mm, At::Any, "mm"),
            Bar::new("RMSE in the outer 70 mm", errors.outer_rmse_mm, At::Any, "mm"),
            Bar::new("largest error in the outer 70 mm", errors.outer_worst_mm, At::Most(2.0), "mm"),
            Bar::new("99th-percentile latency, arrival to report", late_ms, At::Most(5.0), "ms"),
        ]);
        Ok(errors)
    }

    /// Runs a session on a newly emulated rig with this seed. Returns its output and the number of lost samples.
    fn session(&self, seed: u32, name: &str, options: &[&str]) -> Result<(Output, f64), Failure> {
        let rig = Rig::start(&seed.to_string(), ["printer", "sensor"].map(|port| self.file(port)))?;
        let [printer, sensor] = &rig.ports;
        let out = self.file(name);
        let ports = ["platform", "run", "--printer", printer, "--sensor", sensor, "--out", &out];
        let output = whisker(&[&ports, options].concat())?;
        eprint!("{}", output.stderr);
        let sent = rig.stop()?;
        let [readings, dropped] =
            ["readings ", "dropped "].map(|quantity| number(&sent, quantity).ok_or_else(|| unknown(quantity, &sent)));
        let rows = self.read(&format!("{name}/log.csv"))?.lines().count() - 1;
        // Printed readings that are not in the log, except for those in transit at the end.
        Ok((output, dropped? + (readings? - rows as f64 - IN_TRANSIT).max(0.0)))
    }
}

/// Arguments of the command.
#[derive(Debug, PartialEq)]
struct Asked {
    runs: u32,
    soak_s: Option<u32>,
}

fn asked(arguments: &[String]) -> Result<Asked, Failure> {
    let mut asked = Asked { runs: 1, soak_s: None };
    for pair in arguments.chunks(2) {
        let wrong = || Failure::new(format!("found `{}`, expected [--runs N] [--soak SECONDS]", pair.join(" ")));
        let [name, value] = pair else { return Err(wrong()) };
        let value = value.parse().ok().filter(|value: &u32| *value > 0).ok_or_else(wrong)?;
        match name.as_str() {
            "--runs" => asked.runs = value,
            "--soak" => asked.soak_s = Some(value),
            _ => return Err(wrong()),
        }
    }
    Ok(asked)
}

/// Runs the soak test, which has its own bounds.
fn soak(soak_s: u32) -> Outcome {
    let mut test =
        cargo(&["test", "--release", "--package", "platform", "--test", "soak", "--", "--ignored", "--nocapture"]);
    test.env("WHISKER_SOAK_S", soak_s.to_string());
    run_command(test)
}

/// The emulated devices.
struct Rig {
    child: Child,
    /// Links to the ports of printer and sensor, relative to the repository.
    ports: [String; 2],
}

impl Rig {
    fn start(seed: &str, ports: [String; 2]) -> Result<Self, Failure> {
        let links = ports.each_ref().map(|port| root().join(port));
        for link in &links {
            // The link does not exist before the first session.
            let _ = fs::remove_file(link);
        }
        let [printer, sensor] = &ports;
        let mut command =
            program(&["platform", "emulate", "--printer-link", printer, "--sensor-link", sensor, "--seed", seed]);
        command.stdout(Stdio::piped());
        let child = command.spawn().map_err(|error| Failure::new(format!("`{}`: {error}", words(&command))))?;
        let (rig, begun) = (Self { child, ports }, Instant::now());
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
        kill.arg(self.child.id().to_string());
        run_command(kill)?;
        let mut text = String::new();
        let mut output = self.child.stdout.take().ok_or_else(|| Failure::new("the emulation has no output"))?;
        std::io::Read::read_to_string(&mut output, &mut text).map_err(|error| Failure::new(error.to_string()))?;
        Ok(text)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
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
    let mut command = Command::new(built_whisker());
    command.args(arguments).current_dir(root());
    command
}

/// A push of the printer, and the error of the last press with its onset in the push.
struct Push {
    distance_mm: f64,
    error_mm: Option<f64>,
    /// Whether the prediction interval of the press contains the distance.
    is_inside: bool,
}

/// Pushes in a table of events.
fn pushes(events: &str) -> Result<Vec<Push>, Failure> {
    let (mut pushes, mut last) = (Vec::new(), None);
    for line in events.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells.get(column).and_then(|cell| cell.parse::<f64>().ok());
        match (cells.get(1), number(0), number(2), number(3)) {
            (Some(&"pressed"), Some(_), Some(onset_s), distance_m) => {
                last = Some((onset_s, distance_m, number(4).zip(number(5))));
            }
            (Some(&"released"), ..) => {}
            (Some(&"pushed"), Some(end_s), Some(start_s), Some(distance_m)) => {
                let found = last.filter(|(onset_s, ..)| (start_s..end_s).contains(onset_s));
                let error_mm = found.and_then(|(_, found_m, _)| found_m).map(|found_m| 1e3 * (found_m - distance_m));
                let interval_m = found.and_then(|(_, _, interval_m)| interval_m);
                let is_inside = interval_m.is_some_and(|(low_m, high_m)| (low_m..=high_m).contains(&distance_m));
                pushes.push(Push { distance_mm: 1e3 * distance_m, error_mm, is_inside });
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
    fn verif_a_push_has_the_error_of_the_press_before_it() {
        let events = "t_s,event,onset_s,distance_m,low_m,high_m,slope_counts_per_s\n\
            1.5,pressed,1.2,0.1441,0.1440,0.1460,9.0\n1.6,released,,,,,\n2.0,pushed,1.0,0.145,,,\n\
            4.0,pushed,3.0,0.1,,,\n5.5,pressed,5.2,,,,1.0\n6.0,pushed,5.0,0.05,,,\n";
        let found = pushes(events).expect("a table");
        let errors: Vec<_> = found.iter().map(|push| push.error_mm.map(|mm| (1e3 * mm).round())).collect();
        assert_eq!(errors, [Some(-900.0), None, None]);
        assert_eq!(found.iter().map(|push| push.is_inside).collect::<Vec<_>>(), [true, false, false]);
        assert!(pushes("header\nnonsense\n").is_err());
    }

    #[test]
    fn verif_a_bar_is_missed_by_a_figure_beyond_it_and_by_no_figure() {
        assert!(!Bar::new("RMSE", rms(&[]), At::Most(2.0), "mm").is_met());
        assert!(!Bar::new("worst", worst(&[]), At::Most(2.0), "mm").is_met());
        assert_eq!(
            Bar::new("worst", worst(&[1.0, -3.0]), At::Most(2.0), "mm").to_string().split_whitespace().last(),
            Some("MISSED")
        );
    }

    #[test]
    fn verif_arguments_choose_runs_and_soak() {
        let chosen = |words: &[&str]| asked(&words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
        assert_eq!(chosen(&[]).unwrap(), Asked { runs: 1, soak_s: None });
        assert_eq!(chosen(&["--soak", "600", "--runs", "20"]).unwrap(), Asked { runs: 20, soak_s: Some(600) });
        assert!(
            ["--soak", "--soak 0", "fast", "--runs -1"]
                .iter()
                .all(|words| chosen(&words.split(' ').collect::<Vec<_>>()).is_err())
        );
    }
}
