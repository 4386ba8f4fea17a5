//! `cargo xtask live`: latency, losses and memory of `whisker live` with six whiskers at 250 readings per second, as JSON
//! lines, in the plane or, with `--space`, in space. The values are rows of `results/reference/measured.csv`.

use std::fs;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use crate::failure::{Failure, Outcome};
use crate::kept;
use crate::parts::step;
use crate::pipeline;
use crate::repository::root;
use crate::tools::built_whisker;

/// Number of whiskers.
const WHISKERS: usize = 6;

/// Whiskers and messages of a measurement. The columns of a pose are also its keys in the messages.
struct Setting {
    suite: &'static str,
    /// Traces that the whiskers replay, forward and backward in turn, and their calibrations.
    whiskers: [(&'static str, &'static str); WHISKERS],
    protocol: u32,
    pose: &'static [&'static str],
    /// Columns of the readings, and their keys.
    readings: &'static [(&'static str, &'static str)],
    /// Time between the first lines and the first readings, in which the calibrations are read and, in space, tabulated.
    start: Duration,
    /// Beginning of the identifiers of the results, and their description.
    rows: &'static str,
    about: &'static str,
    /// Arguments of `cargo xtask live` that select this setting.
    arguments: &'static str,
}

const IN_PLANE: Setting = Setting {
    suite: "standard",
    whiskers: [
        ("pin_straight_00", "straight"),
        ("pin_curved_00", "curved"),
        ("circle_15_straight", "straight"),
        ("circle_15_curved", "curved"),
        ("octagon_straight", "straight"),
        ("octagon_curved", "curved"),
    ],
    protocol: 1,
    pose: &["base_x_m", "base_y_m", "base_yaw_rad"],
    readings: &[("moment_z_n_m", "reading_n_m")],
    start: Duration::from_secs(1),
    rows: "live_",
    about: "six whiskers",
    arguments: "",
};

const IN_SPACE: Setting = Setting {
    suite: "spatial",
    whiskers: [
        ("pin_00_straight", "straight"),
        ("pin_00_curved", "curved"),
        ("sphere_20_straight", "straight"),
        ("sphere_20_curved", "curved"),
        ("box_straight", "straight"),
        ("box_curved", "curved"),
    ],
    protocol: 2,
    pose: &["base_x_m", "base_y_m", "base_z_m", "base_qw", "base_qx", "base_qy", "base_qz"],
    readings: &[("moment_y_n_m", "moment_y_n_m"), ("moment_z_n_m", "moment_z_n_m")],
    start: Duration::from_secs(10),
    rows: "space_live_",
    about: "six whiskers in space",
    arguments: " --space",
};

const RATE_HZ: f64 = 250.0;
/// Measurement noise relative to the largest reading of a trace.
const NOISE: f64 = 0.01;
/// Default duration (s).
const DURATION_S: u64 = 600;
/// Share of the duration after which the memory must not grow any more: by then every whisker has touched.
const WARM: f64 = 0.5;
/// Bounds: 99th percentile of the latency (ms), and growth of the memory (MB).
const LATENCY_MS: f64 = 5.0;
const GROWTH_MB: f64 = 1.0;
/// Number of instants whose times of sending are kept: more than can be in transit.
const IN_TRANSIT: usize = 1 << 14;
/// Resolution and range of the histogram of latencies.
const BIN_US: f64 = 10.0;
const BINS: usize = 100_000;

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let (setting, duration_s) = asked(arguments)?;
    pipeline::prepare()?;
    pipeline::simulate(setting.suite)?;
    pipeline::fit(setting.suite)?;
    let mut measured = None;
    step(&format!("{} at {RATE_HZ} readings per second for {duration_s} s", setting.about), || {
        measured = Some(measure(setting, duration_s)?);
        Ok(())
    })?;
    let measured = measured.expect("the step succeeded");
    println!("{measured}");
    write_rows(setting, &measured)?;
    if measured.latency_ms[1] > LATENCY_MS || measured.lost > 0 || measured.growth_mb > GROWTH_MB {
        return Err(Failure::new(format!(
            "expected at most {LATENCY_MS} ms (99 %), no lost reading and at most {GROWTH_MB} MB of growth"
        )));
    }
    Ok(())
}

/// Setting, and duration in seconds.
fn asked(arguments: &[String]) -> Result<(&'static Setting, u64), Failure> {
    let (setting, rest) = match arguments {
        [option, rest @ ..] if option == "--space" => (&IN_SPACE, rest),
        all => (&IN_PLANE, all),
    };
    match rest {
        [] => Ok((setting, DURATION_S)),
        [option, seconds] if option == "--seconds" => match seconds.parse() {
            Ok(duration_s) if duration_s >= 10 => Ok((setting, duration_s)),
            _ => Err(Failure::new(format!("--seconds: found `{seconds}`, expected 10 or more"))),
        },
        _ => Err(Failure::new(format!("found `{}`, expected [--space] [--seconds N]", arguments.join(" ")))),
    }
}

/// Results of a measurement.
struct Measured {
    duration_s: u64,
    sent: u64,
    lost: u64,
    /// Median, 99th percentile and largest latency.
    latency_ms: [f64; 3],
    memory_mb: f64,
    growth_mb: f64,
}

impl std::fmt::Display for Measured {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [median, most, worst] = self.latency_ms;
        write!(
            out,
            "{} readings in {} s, {} lost; latency: median {median:.2} ms, 99 % {most:.2} ms, worst {worst:.2} ms; \
             memory {:.1} MB, growth {:.2} MB",
            self.sent, self.duration_s, self.lost, self.memory_mb, self.growth_mb
        )
    }
}

/// Rows of a trace that a whisker replays.
struct Sweep {
    /// Pose of the base, and readings.
    rows: Vec<Vec<f64>>,
    noise_sd_n_m: f64,
}

impl Sweep {
    fn read(setting: &Setting, trace: &str) -> Result<Self, Failure> {
        let path = root().join(format!("datasets/{}/{trace}.csv", setting.suite));
        let failed = |reason: String| Failure::new(format!("{}: {reason}", path.display()));
        let text = fs::read_to_string(&path).map_err(|error| failed(error.to_string()))?;
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let column = |name: &str| {
            header.iter().position(|column| *column == name).ok_or_else(|| failed(format!("found no column {name}")))
        };
        let names = setting.pose.iter().copied().chain(setting.readings.iter().map(|(column, _)| *column));
        let columns: Vec<usize> = names.map(column).collect::<Result<_, _>>()?;
        let row = |line: &str| -> Option<Vec<f64>> {
            let cells: Vec<&str> = line.split(',').collect();
            columns.iter().map(|column| cells.get(*column)?.parse().ok()).collect()
        };
        let rows: Option<Vec<Vec<f64>>> = lines.map(row).collect();
        let rows = rows.filter(|rows| rows.len() > 1).ok_or_else(|| failed("found a cell that is no number".into()))?;
        let size =
            |row: &Vec<f64>| row[setting.pose.len()..].iter().map(|reading| reading * reading).sum::<f64>().sqrt();
        let largest_n_m = rows.iter().map(size).fold(0.0, f64::max);
        Ok(Self { rows, noise_sd_n_m: NOISE * largest_n_m })
    }

    /// Row at an instant: forward to the end, backward to the beginning, and so on.
    fn row(&self, instant: u64) -> &[f64] {
        let last = self.rows.len() as u64 - 1;
        let place = instant % (2 * last);
        &self.rows[place.min(2 * last - place) as usize]
    }
}

/// Approximately normal numbers: the sum of twelve uniform ones of a linear congruential generator (Knuth, MMIX).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let uniform = |state: &mut u64| {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform(&mut self.0)).sum::<f64>() - 6.0
    }
}

/// Runs the command on readings and poses in real time.
fn measure(setting: &Setting, duration_s: u64) -> Result<Measured, Failure> {
    let traces = setting.whiskers.iter();
    let sweeps: Vec<Sweep> = traces.map(|(trace, _)| Sweep::read(setting, trace)).collect::<Result<_, _>>()?;
    let mut child = start(setting)?;
    let pipes = child.stdin.take().zip(child.stdout.take());
    let (stdin, stdout) = pipes.ok_or_else(|| Failure::new("whisker live: has no pipes"))?;
    let sent: Vec<AtomicU64> = (0..WHISKERS * IN_TRANSIT).map(|_| AtomicU64::new(0)).collect();
    let (origin, over, id) = (Instant::now(), AtomicBool::new(false), child.id());
    let (ended, memory) = thread::scope(|scope| {
        let answers = scope.spawn(|| listen(setting, stdout, &sent, origin));
        let memory = scope.spawn(|| watch(id, setting.start + Duration::from_secs(duration_s).mul_f64(WARM), &over));
        let written = send(setting, stdin, &sweeps, &sent, origin, duration_s);
        over.store(true, Ordering::Relaxed);
        let answers = answers.join().expect("the listener does not panic");
        let memory = memory.join().expect("the watch does not panic");
        (written.map(|()| answers), memory)
    });
    let Answers { bins, used, worst_us } = ended?;
    let status = child.wait().map_err(|error| Failure::new(format!("whisker live: {error}")))?;
    if !status.success() {
        return Err(Failure::new(format!("whisker live: {status}")));
    }
    let readings = duration_s * RATE_HZ as u64 * WHISKERS as u64;
    let quantile_ms = |share: f64| {
        let rank = (share * used as f64).ceil() as u64;
        let mut below = 0;
        let bin = bins.iter().position(|count| {
            below += count;
            below >= rank
        });
        1e-3 * BIN_US * (bin.unwrap_or(BINS) + 1) as f64
    };
    let (warm_mb, memory_mb) = memory;
    Ok(Measured {
        duration_s,
        sent: readings,
        lost: readings - used,
        latency_ms: [quantile_ms(0.5), quantile_ms(0.99), 1e-3 * worst_us as f64],
        memory_mb,
        growth_mb: memory_mb - warm_mb,
    })
}

/// The command with a calibration for each whisker.
fn start(setting: &Setting) -> Result<Child, Failure> {
    let mut command = Command::new(built_whisker());
    command.arg("live").current_dir(root()).stdin(Stdio::piped()).stdout(Stdio::piped());
    for (name, whisker) in setting.whiskers {
        let calibration = format!("{name}=datasets/{}/calibrations/{whisker}.json", setting.suite);
        command.arg("--calibration").arg(calibration);
    }
    command.spawn().map_err(|error| Failure::new(format!("{}: {error}", built_whisker().display())))
}

/// Sends pose and reading of each whisker at each instant, until the duration is over.
fn send(
    setting: &Setting,
    stdin: ChildStdin,
    sweeps: &[Sweep],
    sent: &[AtomicU64],
    origin: Instant,
    duration_s: u64,
) -> Outcome {
    let failed = |error: std::io::Error| Failure::new(format!("whisker live: {error}"));
    let mut stdin = BufWriter::new(stdin);
    for ((name, _), sweep) in setting.whiskers.iter().zip(sweeps) {
        let (protocol, noise) = (setting.protocol, sweep.noise_sd_n_m);
        let about = format!(r#""name":"{name}","rate_hz":{RATE_HZ},"noise_sd_n_m":{noise:e}"#);
        writeln!(stdin, r#"{{"protocol":{protocol},{about}}}"#).map_err(failed)?;
    }
    stdin.flush().map_err(failed)?;
    sleep(setting.start);
    let mut noise = Noise(1);
    let first = Instant::now();
    for instant in 0..duration_s * RATE_HZ as u64 {
        let t_s = instant as f64 / RATE_HZ;
        sleep((first + Duration::from_secs_f64(t_s)).saturating_duration_since(Instant::now()));
        for (whisker, ((name, _), sweep)) in setting.whiskers.iter().zip(sweeps).enumerate() {
            let (pose, readings) = sweep.row(instant).split_at(setting.pose.len());
            let pose = setting.pose.iter().zip(pose).map(|(key, value)| format!(r#","{key}":{value}"#));
            let noisy = |((_, key), value): (&(&str, &str), &f64)| {
                let reading_n_m = value + sweep.noise_sd_n_m * noise.next();
                format!(r#","{key}":{reading_n_m:e}"#)
            };
            let readings = setting.readings.iter().zip(readings).map(noisy);
            for keys in [pose.collect::<String>(), readings.collect()] {
                writeln!(stdin, r#"{{"name":"{name}","t_s":{t_s}{keys}}}"#).map_err(failed)?;
            }
            let now_us = origin.elapsed().as_micros() as u64;
            sent[whisker * IN_TRANSIT + instant as usize % IN_TRANSIT].store(now_us, Ordering::Release);
            stdin.flush().map_err(failed)?;
        }
    }
    Ok(())
}

/// Latencies of the answers.
struct Answers {
    bins: Vec<u64>,
    used: u64,
    worst_us: u64,
}

/// Reads the answers until their end.
fn listen(setting: &Setting, stdout: ChildStdout, sent: &[AtomicU64], origin: Instant) -> Answers {
    let mut answers = Answers { bins: vec![0; BINS], used: 0, worst_us: 0 };
    for line in BufReader::new(stdout).lines().map_while(Result::ok) {
        let now_us = origin.elapsed().as_micros() as u64;
        let of = |key: &str| Some(line.split_once(key)?.1.split([',', '"', '}']).next().unwrap_or_default());
        let whisker = of(r#""name":""#).and_then(|name| setting.whiskers.iter().position(|(known, _)| *known == name));
        let t_s = of(r#""t_s":"#).and_then(|t_s| t_s.parse::<f64>().ok());
        let Some((whisker, t_s)) = whisker.zip(t_s).filter(|_| of(r#""status":""#) == Some("used")) else { continue };
        let instant = (t_s * RATE_HZ).round() as usize;
        let latency_us =
            now_us.saturating_sub(sent[whisker * IN_TRANSIT + instant % IN_TRANSIT].load(Ordering::Acquire));
        answers.bins[((latency_us as f64 / BIN_US) as usize).min(BINS - 1)] += 1;
        answers.used += 1;
        answers.worst_us = answers.worst_us.max(latency_us);
    }
    answers
}

/// Largest resident memory of a process up to a time since the start, and in all (MB).
fn watch(id: u32, warm: Duration, over: &AtomicBool) -> (f64, f64) {
    let begun = Instant::now();
    let (mut warm_mb, mut all_mb) = (0.0_f64, 0.0_f64);
    while !over.load(Ordering::Relaxed) {
        let status = fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
        let kb =
            status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix("kB")?.trim().parse().ok());
        let mb = kb.map_or(0.0, |kb: f64| 1e-3 * kb);
        all_mb = all_mb.max(mb);
        if begun.elapsed() < warm {
            warm_mb = all_mb;
        }
        sleep(Duration::from_millis(200));
    }
    (warm_mb, all_mb)
}

/// Replaces the rows of this measurement in the table.
fn write_rows(setting: &Setting, measured: &Measured) -> Outcome {
    let Setting { rows: prefix, about: whiskers, arguments, .. } = setting;
    let seconds = measured.duration_s;
    let [median, most, worst] = measured.latency_ms;
    let values = [
        ("readings", "readings sent", measured.sent as f64, "readings"),
        ("lost", "readings without an answer", measured.lost as f64, "readings"),
        ("latency_median", "median latency from the sent reading to the received contact", median, "ms"),
        ("latency_p99", "99th percentile of that latency", most, "ms"),
        ("latency_worst", "largest latency", worst, "ms"),
        ("memory", "largest resident memory", measured.memory_mb, "MB"),
        ("memory_growth", "growth of the largest resident memory in the second half", measured.growth_mb, "MB"),
    ];
    let rows = values.map(|(id, about, value, unit)| {
        let about = format!("whisker live, recommended, {whiskers} at 250 Hz, two cores, {seconds} s: {about}");
        kept::Measured::new(id, about, value, unit)
    });
    kept::write_measured(prefix, &format!("cargo xtask live{arguments} --seconds {seconds}"), &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_sweep_is_replayed_forward_and_backward() {
        let sweep = Sweep { rows: (0..3).map(|i| vec![f64::from(i); 4]).collect(), noise_sd_n_m: 0.0 };
        let rows: Vec<f64> = (0..9).map(|instant| sweep.row(instant)[0]).collect();
        assert_eq!(rows, [0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0]);
    }

    #[test]
    fn verif_noise_has_unit_variance() {
        let mut noise = Noise(1);
        let values: Vec<f64> = (0..100_000).map(|_| noise.next()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
    }
}
