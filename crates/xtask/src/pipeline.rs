//! Steps from scenes to report. Each step reuses results that are up to date.

use std::thread;
use std::time::Instant;

use crate::failure::Outcome;
use crate::parts::step;
use crate::python::{self, Requirements};
use crate::tools::{build_whisker, python, run, start, whisker};

/// Installs the Python packages and builds `whisker`, unless the variable `WHISKER` names a program.
pub(crate) fn prepare() -> Outcome {
    prepare_with(|| Ok(()))
}

/// Installs the Python packages and then runs `simulation`, which needs nothing else, while cargo builds `whisker`.
pub(crate) fn prepare_with(simulation: impl FnOnce() -> Outcome) -> Outcome {
    let started = Instant::now();
    let beside = || {
        step("Python packages", || python::install(Requirements::Runtime))?;
        simulation()
    };
    let Some(build) = build_whisker() else { return beside() };
    eprintln!("\n== build: the command whisker, in parallel with the next steps");
    let build = start(build)?;
    if let Err(failure) = beside() {
        build.abandon();
        return Err(failure);
    }
    build.finish()?;
    eprintln!("\n== build: {:.1} s, counted from the start", started.elapsed().as_secs_f64());
    Ok(())
}

/// Scenes to traces: `scenes/suites/<suite>.json` to `datasets/<suite>/`.
pub(crate) fn simulate(suite: &str) -> Outcome {
    step("simulate", || generate(suite, &[]))
}

/// Scenes to traces, and one sweep of each group and whisker to an animation: `datasets/<suite>/`, `datasets/<suite>/animations/`.
pub(crate) fn simulate_with_animations(suite: &str) -> Outcome {
    let animations = animations(suite);
    step("simulate", || generate(suite, &["--animations", &animations]))
}

/// Calibration traces to sensor models: `datasets/<suite>/calibrations/`.
pub(crate) fn fit(suite: &str) -> Outcome {
    step("fit", || run(whisker(&["fit", &suite_file(suite)])))
}

/// Calibration traces through a front end to sensor models: `datasets/<suite>/calibrations/<front end>/`.
pub(crate) fn fit_through(front_end: &str, suite: &str) -> Outcome {
    step("fit", || run(whisker(&["fit", &suite_file(suite), "--front-end", front_end])))
}

/// Evaluations of suites. A finished run with other settings is replaced only on request.
#[derive(Clone, Copy)]
pub(crate) struct Evaluations {
    force: bool,
}

/// Deviations from the calibration, one at a time.
const MISCALIBRATIONS: &[&str] = &[
    r#"{"gain": 0.01}"#,
    r#"{"gain": 0.05}"#,
    r#"{"mount_rad": 0.0087}"#,
    r#"{"mount_y_m": 0.0003}"#,
    r#"{"stiffness": 0.05}"#,
];

/// Deviations of gain and mounting together: half of the combinations of two values of opposite signs of each, so that no two of
/// them are correlated. The values are the root mean squares of those that the random suites draw, as are the priors of the bound.
const INSTALLATIONS: &[&str] = &[
    r#"{"gain": 0.021, "mount_rad": 0.004, "mount_x_m": 0.00014, "mount_y_m": 0.00014}"#,
    r#"{"gain": 0.021, "mount_rad": 0.004, "mount_x_m": -0.00014, "mount_y_m": -0.00014}"#,
    r#"{"gain": 0.021, "mount_rad": -0.004, "mount_x_m": 0.00014, "mount_y_m": -0.00014}"#,
    r#"{"gain": 0.021, "mount_rad": -0.004, "mount_x_m": -0.00014, "mount_y_m": 0.00014}"#,
    r#"{"gain": -0.021, "mount_rad": 0.004, "mount_x_m": 0.00014, "mount_y_m": -0.00014}"#,
    r#"{"gain": -0.021, "mount_rad": 0.004, "mount_x_m": -0.00014, "mount_y_m": 0.00014}"#,
    r#"{"gain": -0.021, "mount_rad": -0.004, "mount_x_m": 0.00014, "mount_y_m": 0.00014}"#,
    r#"{"gain": -0.021, "mount_rad": -0.004, "mount_x_m": -0.00014, "mount_y_m": -0.00014}"#,
];

/// Options of an evaluation with the noise that each trace states.
const AS_STATED: [&str; 6] = ["--noise", "1", "--noise-unit", "stated", "--seeds", "1"];

/// Option by which finished runs with other settings are replaced.
pub(crate) const FORCE: &str = "--force";

impl Evaluations {
    /// Evaluations that replace finished runs with other settings if `force` is set.
    pub(crate) fn new(force: bool) -> Self {
        Self { force }
    }

    fn run(self, arguments: &[&str]) -> Outcome {
        let force: &[&str] = if self.force { &[FORCE] } else { &[] };
        run(whisker(&[&["evaluate"], arguments, force].concat()))
    }

    /// Estimators on every trial, scored: `results/<suite>/`. `None` runs every registered one.
    pub(crate) fn of(self, suite: &str, estimators: Option<&[&str]>) -> Outcome {
        let names = estimators.map(|names| names.join(","));
        let chosen: Vec<&str> = names.iter().flat_map(|names| ["--estimators", names]).collect();
        step("evaluate", || self.run(&[&[suite_file(suite).as_str()], &chosen[..]].concat()))
    }

    /// Every estimator on traces that were simulated for another suite, with the calibrations of a third, for a number
    /// of seeds of the measurement noise.
    pub(crate) fn on(self, suite: &str, traces: &str, calibrated: &str, seeds: u32) -> Outcome {
        let (traces, seeds) = (format!("datasets/{traces}"), seeds.to_string());
        let calibrations = format!("datasets/{calibrated}/calibrations");
        let options = ["--traces", &traces, "--calibrations", &calibrations, "--seeds", &seeds];
        step("evaluate", || self.run(&[&[suite_file(suite).as_str()], &options[..]].concat()))
    }

    /// Estimators on the traces of a suite through a front end at several noise levels, with the calibrations of another suite:
    /// `results/<name>/`.
    pub(crate) fn through(
        self,
        front_end: &str,
        suite: &str,
        calibrated: &str,
        name: &str,
        estimators: &str,
        noise: &str,
    ) -> Outcome {
        let traces = format!("datasets/{suite}");
        let calibrations = format!("datasets/{calibrated}/calibrations/{front_end}");
        let inputs = ["--traces", &traces, "--calibrations", &calibrations, "--front-end", front_end, "--name", name];
        let options = ["--estimators", estimators, "--noise", noise, "--seeds", "2"];
        step("evaluate", || self.run(&[&[suite_file(suite).as_str()], &inputs[..], &options[..]].concat()))
    }

    /// Estimators on a suite, for a number of seeds of the measurement noise: `results/<suite>/`.
    pub(crate) fn seeded(self, suite: &str, estimators: &str, seeds: u32) -> Outcome {
        let options = ["--estimators", estimators, "--seeds", &seeds.to_string()];
        step("evaluate", || self.run(&[&[suite_file(suite).as_str()], &options[..]].concat()))
    }

    /// Estimators on a random suite with the noise and the miscalibration that each trace states: `results/<suite>/`.
    pub(crate) fn as_stated(self, suite: &str, estimators: &str) -> Outcome {
        let file = suite_file(suite);
        step("evaluate", || self.run(&[&[file.as_str(), "--estimators", estimators], &AS_STATED[..]].concat()))
    }

    /// The recommended estimator on a suite, with the calibration off by one deviation at a time: `results/miscalibrated/`.
    pub(crate) fn miscalibrated(self, suite: &str) -> Outcome {
        let file = suite_file(suite);
        let mut arguments =
            vec![file.as_str(), "--name", "miscalibrated", "--estimators", "recommended", "--seeds", "2"];
        arguments.extend(MISCALIBRATIONS.iter().flat_map(|deviation| ["--miscalibrate", deviation]));
        step("evaluate with calibrations that are off", || self.run(&arguments))
    }

    /// The recommended estimator on a suite, with gain and mounting off together: `results/<suite>/`.
    pub(crate) fn installed(self, suite: &str) -> Outcome {
        let file = suite_file(suite);
        let mut arguments = vec![file.as_str(), "--estimators", "recommended", "--seeds", "1"];
        arguments.extend(INSTALLATIONS.iter().flat_map(|deviations| ["--miscalibrate", deviations]));
        step("evaluate with gain and mounting that are off", || self.run(&arguments))
    }

    /// The recommended estimator on a suite, configured for a calibration that is known to be exact: `results/trusted/`.
    pub(crate) fn trusted(self, suite: &str) -> Outcome {
        let file = suite_file(suite);
        let inputs = [file.as_str(), "--name", "trusted", "--config", "examples/trusted-calibration.json"];
        let options = ["--estimators", "recommended"];
        step("evaluate with a trusted calibration", || self.run(&[&inputs[..], &options[..]].concat()))
    }

    /// The recommended estimator on a suite with noise in proportion to the calibrated range: `results/range/`.
    pub(crate) fn of_range(self, suite: &str) -> Outcome {
        let file = suite_file(suite);
        let inputs = [file.as_str(), "--name", "range", "--estimators", "recommended"];
        let options = ["--noise", "0.01", "--noise-unit", "range"];
        step("evaluate with noise of the calibrated range", || self.run(&[&inputs[..], &options[..]].concat()))
    }

    /// The recommended estimator on a suite with an arm whose joint encoders are noisy, at several levels, with a page:
    /// `results/<suite>_encoders/`.
    pub(crate) fn with_encoders(self, suite: &str, noise_rad: &[&str]) -> Outcome {
        let name = format!("{suite}_encoders");
        let levels: Vec<String> = noise_rad.iter().map(|noise_rad| format!("{{\"noise_rad\": {noise_rad}}}")).collect();
        let file = suite_file(suite);
        let mut arguments = vec![file.as_str(), "--name", &name, "--estimators", "recommended", "--seeds", "2"];
        arguments.extend(levels.iter().flat_map(|level| ["--encoders", level.as_str()]));
        step("evaluate with noisy encoders", || self.run(&arguments))?;
        page(&name)
    }

    /// Recordings of other groups to traces, sensor models and scores, with right and wrong priors of the first contact:
    /// `datasets/<name>/`, `results/<name>/`.
    pub(crate) fn of_recordings(self, format: &str, from: &str, name: &str) -> Outcome {
        let traces = format!("datasets/{name}");
        step("import recordings", || run(whisker(&["import", format, from, "--out", &traces])))?;
        step("fit recordings", || run(whisker(&["fit", &traces])))?;
        step("evaluate recordings", || self.run(&[&traces, "--starts", "wrong"]))
    }

    /// Recordings of other groups in space to traces, sensor models and scores of some estimators: `datasets/<name>/`,
    /// `results/<name>/`.
    pub(crate) fn of_recordings_in_space(self, format: &str, from: &str, name: &str, estimators: &str) -> Outcome {
        let traces = format!("datasets/{name}");
        step("import recordings in space", || run(whisker(&["import", format, from, "--space", "--out", &traces])))?;
        step("fit recordings in space", || run(whisker(&["fit", &traces])))?;
        self.of_traces_in_space(name, estimators)
    }

    /// Scores of some estimators on the traces in space in `datasets/<name>/`: `results/<name>/`.
    pub(crate) fn of_traces_in_space(self, name: &str, estimators: &str) -> Outcome {
        let traces = format!("datasets/{name}");
        step("evaluate traces in space", || self.run(&[&traces, "--estimators", estimators]))
    }
}

/// Scores to figures and a page with links to the animations: `results/<suite>/`.
pub(crate) fn report(suite: &str) -> Outcome {
    step("report", || run(whisker(&["report", &format!("results/{suite}"), "--animations", &animations(suite)])))
}

/// Scores to figures and a page without animations: `results/<name>/`.
pub(crate) fn page(name: &str) -> Outcome {
    step("report", || run(whisker(&["report", &format!("results/{name}")])))
}

/// Simulates a suite into `datasets/<suite>/`, with further options.
fn generate(suite: &str, options: &[&str]) -> Outcome {
    let jobs = thread::available_parallelism().map_or(1, usize::from).to_string();
    let (file, out) = (suite_file(suite), format!("datasets/{suite}"));
    let arguments = ["-m", "whisker_sim", "simulate", &file, "--out", &out, "--jobs", &jobs];
    run(python(&[&arguments, options].concat()))
}

fn animations(suite: &str) -> String {
    format!("datasets/{suite}/animations")
}

fn suite_file(suite: &str) -> String {
    format!("scenes/suites/{suite}.json")
}
