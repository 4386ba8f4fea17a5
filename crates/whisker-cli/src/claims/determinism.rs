//! Determinism: equal inputs give equal bytes on one thread and on two.

use std::path::Path;

use anyhow::Context as _;
use evaluation::evaluate::{EvaluateSettings, evaluate};
use indicatif::ProgressBar;
use testbed::results::{SummaryRow, read_scores, score_bytes};

use super::{Claim, Context};

pub(super) fn claims() -> Vec<Claim> {
    let claim =
        "trials.csv and summary.csv (without its timing column) of one run on one thread and on two: files that differ";
    vec![Claim::at_most("determinism".into(), claim.into(), 0.0, "files", |context| {
        let folder = tempfile::tempdir()?;
        let one = tables(context, folder.path(), 1)?;
        let two = tables(context, folder.path(), 2)?;
        Ok(Some(one.iter().zip(&two).filter(|(one, two)| one != two).count() as f64))
    })]
}

/// Bytes of `trials.csv`, and of `summary.csv` without timing, computed on this number of threads.
fn tables(context: &Context, results: &Path, threads: usize) -> anyhow::Result<[Vec<u8>; 2]> {
    let run = &context.standard().run;
    let settings = EvaluateSettings {
        name: format!("threads-{threads}"),
        estimators: Some(run.estimators.iter().map(|estimator| estimator.name.clone()).collect()),
        touch: run.touch,
        noise: run.noise.clone(),
        seeds: run.seeds.iter().take(1).copied().collect(),
        results: results.into(),
        ..Default::default()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let evaluated =
        pool.install(|| evaluate(std::slice::from_ref(context.dataset()), &settings, &ProgressBar::hidden()))?;
    let trials = evaluated.folder.join("trials.csv");
    let mut summary: Vec<SummaryRow> = read_scores(&evaluated.folder.join("summary.csv"))?;
    for row in &mut summary {
        row.head.step_ns = 0.0;
    }
    Ok([std::fs::read(&trials).with_context(|| trials.display().to_string())?, score_bytes(&summary)?])
}
