//! Batch evaluation: every estimator over every trial, noise level and seed, scored against the truth.
//!
//! ```text
//! datasets, calibrations -> prepare -> items of work -> sense, replay, score, write -> merge -> results/<run>/
//! ```
//!
//! Inputs are read and checked first (`prepared`). The work is divided into items (`plan`), which run in parallel
//! (`work`); a trial of an item is sensed, replayed, scored and written (`trial`). The results of an item are kept in a
//! file of their own (`shards`), so that an interrupted evaluation resumes. At the end the items are merged in the
//! order of trials, noise levels and seeds (`merge`): the results depend neither on the number of threads nor on
//! interruptions. A trial that fails is recorded with its reason and does not affect the others.

mod array_members;
mod calibration;
mod contours;
mod job;
mod loaded_trial;
mod manifest;
mod map_score;
mod maps;
mod memory;
mod merge;
pub(crate) mod part_folder;
mod plan;
mod prepared;
pub(crate) mod previous;
mod probe;
mod quantities;
mod score;
mod sense;
mod settings;
mod shards;
mod starts;
mod tables;
mod trial;
mod work;
mod workload;
mod write;

use std::path::Path;

use anyhow::bail;
use files::write_json;
use indicatif::ProgressBar;
use testbed::dataset::Dataset;
use testbed::metrics::Unscored;
use testbed::results::files::{FAILURES, RUN, SUMMARY, TRIALS};
use testbed::results::{FailureRow, Run, SummaryRow, TrialHead, read_rows, read_scores};

use merge::{Merged, merge};
use part_folder::{PartFolder, restore, tidy};
pub use plan::Share;
use prepared::Prepared;
use previous::check_replaceable;
pub use settings::{EvaluateSettings, Evaluated, OmittedEstimator, run_folder};
use shards::Shards;
pub use starts::Starts;
use work::Batch;
pub use workload::Workload;

/// How an evaluation, of planar traces or of traces in space, names other calibrations.
pub(crate) const OTHERS: &str = "the folder of others by --calibrations";

/// Evaluates and writes `<results>/<name>/`, unless an up-to-date run is there. An evaluation that was interrupted
/// resumes if its inputs are the same. A finished run with the same settings is replaced, when its traces, its
/// calibrations or the code have changed; one with other settings only if the settings say so. A run in which an
/// external program failed, or a run of programs that is to be replaced in any case, is never up to date: what a program imports is
/// not known.
///
/// # Errors
/// If inputs cannot be read or contradict one another, a finished run has other settings, no trial can be scored, or
/// results cannot be written.
pub fn evaluate(
    datasets: &[Dataset],
    settings: &EvaluateSettings,
    progress: &ProgressBar,
) -> anyhow::Result<Evaluated> {
    restore(&settings.folder()?)?;
    let folder = settings.target()?;
    let prepared = Prepared::new(datasets, settings)?;
    let run = prepared.run(settings)?;
    let (unscored, omitted, gated) = (prepared.unscored(), prepared.omitted.clone(), prepared.gated.clone());
    let remarks = prepared.remarks.clone();
    if let Some((summary, failures)) = up_to_date(&prepared, settings, &folder, &run) {
        tidy(&folder)?;
        return Ok(Evaluated { folder, summary, is_new: false, failures, omitted, unscored, gated, remarks });
    }
    if !settings.force {
        check_replaceable(&folder, &run)?;
    }

    let part = PartFolder::open(&folder, &run.watermark.inputs_sha256)?;
    let (plan, shards) = (prepared.plan(settings), Shards::in_run(part.path()));
    // Shares that compute all items again have discarded the earlier ones.
    if settings.renews_items() && !shards.are_renewed() {
        Shards::remove(part.path())?;
    }
    Batch { prepared: &prepared, settings, plan: &plan, shards: &shards, folder: part.path() }
        .finish(None, progress)?;
    let Merged { summary, failures } = merge(&plan, &shards, part.path())?;
    if summary.is_empty() {
        part.discard()?;
        let reason = match failures.first() {
            Some(first) => format!("the first: {}: {}", first.trace, first.reason),
            None => Unscored::TruthUnknown.to_string(),
        };
        bail!("no trial could be scored; {reason}");
    }
    prepared.copy_for_report(part.path())?;
    write_json(&RUN.path(part.path()), &run)?;
    part.finish()?;
    Ok(Evaluated { folder, summary, is_new: true, failures, omitted, unscored, gated, remarks })
}

/// Runs a share of the work. [`evaluate`] with the same inputs then merges the shares, and runs those that are missing.
/// Several processes may run shares at the same time, on one machine or on several with a common file system. With
/// external programs, a share with `force` computes all its items again and keeps those of the other shares with `force`. The
/// same share without `force` resumes it, also beside a finished run.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_share(
    datasets: &[Dataset],
    settings: &EvaluateSettings,
    share: Share,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let folder = settings.target()?;
    let prepared = Prepared::new(datasets, settings)?;
    let run = prepared.run(settings)?;
    let shards = Shards::in_run(&PartFolder::place(&folder, &run.watermark.inputs_sha256));
    if !shards.are_renewed() && up_to_date(&prepared, settings, &folder, &run).is_some() {
        return Ok(());
    }
    if !settings.force && !shards.are_renewed() {
        check_replaceable(&folder, &run)?;
    }
    let part = PartFolder::open(&folder, &run.watermark.inputs_sha256)?;
    let plan = prepared.plan(settings);
    if settings.renews_items() {
        // Until such a share has marked the folder, all items are earlier ones.
        let is_stale = |item: &usize| share.has(*item) || !shards.are_renewed();
        (0..plan.items.len()).filter(is_stale).try_for_each(|item| shards.remove_item(item))?;
        shards.mark_renewed()?;
    }
    let batch = Batch { prepared: &prepared, settings, plan: &plan, shards: &shards, folder: part.path() };
    batch.finish(Some(share), progress)
}

/// Summary and failures of a finished run, if it is up to date. One with an unreadable table is not.
fn up_to_date(
    prepared: &Prepared,
    settings: &EvaluateSettings,
    folder: &Path,
    run: &Run,
) -> Option<(Vec<SummaryRow>, Vec<FailureRow>)> {
    if !prepared.is_up_to_date(folder, run) || settings.renews_items() {
        return None;
    }
    let (summary, failures) = tables(folder).ok()?;
    let is_program = |row: &FailureRow| row.estimator.is_some();
    (settings.programs.is_empty() || !failures.iter().any(is_program)).then_some((summary, failures))
}

/// Summary and failures of a run, whose scores of the trials can be read too.
fn tables(folder: &Path) -> anyhow::Result<(Vec<SummaryRow>, Vec<FailureRow>)> {
    read_scores::<TrialHead>(&TRIALS.path(folder))?;
    Ok((read_scores(&SUMMARY.path(folder))?, read_rows(&FAILURES.path(folder))?))
}
