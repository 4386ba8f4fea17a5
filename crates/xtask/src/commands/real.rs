//! Recordings of real sensors evaluated: the values of `docs/REAL.md`.

use std::fs;

use super::docs;
use crate::failure::{Failure, Outcome};
use crate::kept;
use crate::parts::step;
use crate::pipeline::{self, Evaluations, FORCE};
use crate::repository::root;
use crate::tools::{run as run_command, whisker};

/// Importer of the recordings, names of the runs on their traces in the plane and in space, and name of the run of
/// `whisker recordings`, which uses no traces.
const FORMAT: &str = "stanford-whisker";
const RUN: &str = "stanford";
const RUN_IN_SPACE: &str = "stanford-space";
const IN_SPACE: &str = "recordings";

/// Prefix of the names of the trials with pins 20 days after the calibration of their sensor, the calibration, and the name of the
/// run on all of them but the first, from which the mounting is learnt.
const LATER: &str = "05_24_23-";
const LATER_CALIBRATION: &str = "stanford-sensor1_tip_May_04.json";
const RUN_MOUNTED: &str = "stanford-space-mounted";

/// Estimators in space whose scores the documentation shows.
const SHOWN: &str = "point,point-fit,line,recommended";

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let (arguments, is_forced) = match arguments {
        [rest @ .., last] if last == FORCE => (rest, true),
        all => (all, false),
    };
    let folder = folder(arguments)?;
    pipeline::prepare()?;
    measure(Evaluations::new(is_forced), &folder)?;
    pipeline::page(RUN)?;
    step("documentation", docs::run)
}

/// Imports, fits and evaluates the recordings in a folder, and keeps their tables.
pub(super) fn measure(evaluations: Evaluations, folder: &str) -> Outcome {
    evaluations.of_recordings(FORMAT, folder, RUN)?;
    let out = format!("results/{IN_SPACE}");
    step("evaluate recordings in space", || run_command(whisker(&["recordings", folder, "--out", &out])))?;
    kept::keep(RUN, &["run.json", "contour_trials.csv", "summary.csv"])?;
    evaluations.of_recordings_in_space(FORMAT, folder, RUN_IN_SPACE, SHOWN)?;
    kept::keep(RUN_IN_SPACE, &["space_summary.csv"])?;
    mount(evaluations)?;
    kept::keep(RUN_MOUNTED, &["space_summary.csv"])?;
    kept::keep(IN_SPACE, &["space_maps.csv", "space_pins_summary.csv", "space_settings.json"])?;
    kept::keep(IN_SPACE, &["space_sweeps.csv", "space_sweeps_paper.csv", "space_faces.csv"])
}

/// Learns the mounting of the sensor from the first of the later trials, and evaluates the others with it.
fn mount(evaluations: Evaluations) -> Outcome {
    let imported = root().join("datasets").join(RUN_IN_SPACE);
    let failed = |error| Failure::new(format!("{}: {error}", imported.display()));
    let entries = fs::read_dir(&imported).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let names = entries.into_iter().filter_map(|entry| entry.file_name().into_string().ok());
    let mut trials: Vec<String> = names.filter(|name| name.starts_with(LATER) && name.ends_with(".csv")).collect();
    trials.sort();
    let Some((first, others)) = trials.split_first() else {
        return Err(Failure::new(format!(
            "{}: found no trial {LATER}*, expected those of `{FORMAT}`",
            imported.display()
        )));
    };
    let traces = root().join("datasets").join(RUN_MOUNTED);
    if traces.exists() {
        fs::remove_dir_all(&traces).map_err(failed)?;
    }
    fs::create_dir_all(traces.join("calibrations")).map_err(failed)?;
    for name in others {
        for name in [name.clone(), name.replace(".csv", ".json")] {
            fs::copy(imported.join(&name), traces.join(&name)).map_err(failed)?;
        }
    }
    let place = |run: &str| format!("datasets/{run}/calibrations/{LATER_CALIBRATION}");
    let (touch, calibration, out) =
        (format!("datasets/{RUN_IN_SPACE}/{first}"), place(RUN_IN_SPACE), place(RUN_MOUNTED));
    step("learn the mounting from the first later trial", || {
        run_command(whisker(&["mount", &touch, "--calibration", &calibration, "--out", &out]))
    })?;
    evaluations.of_traces_in_space(RUN_MOUNTED, SHOWN)
}

/// Folder of the recordings, as a path that does not depend on the working directory.
fn folder(arguments: &[String]) -> Result<String, Failure> {
    let [option, folder] = arguments else {
        return Err(Failure::new(format!("real: found {} arguments, expected --recordings FOLDER", arguments.len())));
    };
    if option != "--recordings" {
        return Err(Failure::new(format!("real: found `{option}`, expected --recordings FOLDER")));
    }
    let found = fs::canonicalize(folder);
    let found =
        found.map_err(|error| Failure::new(format!("real: {folder}: {error}; see docs/REAL.md for the source")))?;
    Ok(found.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(arguments: &[&str]) -> Option<String> {
        let arguments: Vec<String> = arguments.iter().map(|&argument| argument.to_owned()).collect();
        folder(&arguments).err().map(|failure| failure.to_string())
    }

    #[test]
    fn robust_missing_recordings_are_named() {
        assert_eq!(error(&[]).as_deref(), Some("real: found 0 arguments, expected --recordings FOLDER"));
        assert_eq!(error(&["--from", "x"]).as_deref(), Some("real: found `--from`, expected --recordings FOLDER"));
        let missing = error(&["--recordings", "no-such-folder"]).expect("an error");
        assert!(missing.starts_with("real: no-such-folder: ") && missing.ends_with("see docs/REAL.md for the source"));
        assert_eq!(error(&["--recordings", "."]), None);
    }
}
