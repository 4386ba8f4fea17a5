//! `whisker import`: foreign recordings to traces.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::slice;

use anyhow::{Context, bail};
use files::{Error, check_replaces_own, read_json, write_atomically};
use importers::{IMPORTERS, importer};
use serde_json::Value;
use testbed::plausibility::Subject;
use trace::{Outline, Role, Trace, is_trace_table};

use super::output::reserve_folder;
use super::progress::Progress;
use super::{FINISHED_WITH_FAILURES, print, table};

/// Convert recordings of real sensors into traces
///
/// `csv` and `bag` read the recordings of any laboratory by a mapping file, which names columns, units and frames
/// (docs/own-data.md).
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Format of the recordings (--list)
    #[arg(required_unless_present = "list")]
    format: Option<String>,
    /// Mapping file, or folder with the recordings of a published format
    #[arg(required_unless_present = "list")]
    path: Option<PathBuf>,
    /// Folder for the traces [default: datasets/<format>]
    #[arg(long)]
    out: Option<PathBuf>,
    /// List the formats
    #[arg(long, exclusive = true)]
    list: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (Some(format), Some(path)) = (&arguments.format, &arguments.path) else {
        let rows: String = IMPORTERS.iter().map(|row| format!("{:<28} {}\n", row.name, row.about)).collect();
        print(&rows)?;
        return Ok(ExitCode::SUCCESS);
    };
    let row = importer(format).with_context(|| {
        let known: Vec<_> = IMPORTERS.iter().map(|row| row.name).collect();
        format!("unknown format `{format}`, expected one of: {}", known.join(", "))
    })?;
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from("datasets").join(row.name));
    let _lock = reserve_folder(&out, slice::from_ref(path))?;
    let progress = Progress::of("importing");
    let imported = (row.import)(path, &|done, all| {
        progress.set_length(all);
        progress.set_position(done);
    })?;
    drop(progress);
    if imported.traces.is_empty() {
        print_failures(&imported.failures);
        bail!("{}: found no recordings that can be imported", path.display());
    }
    for trace in &imported.traces {
        check_replaces_imported(&out.join(format!("{}.csv", trace.sidecar.name)), trace)?;
    }
    for (file, _) in &imported.outlines {
        check_replaces_own(&out.join(file), "an outline", |path| Outline::read(path).is_ok())?;
    }
    // Outlines first: the sidecars of the traces name them.
    for (file, outline) in &imported.outlines {
        write_atomically(&out.join(file), outline.to_csv().as_bytes())?;
    }
    for trace in &imported.traces {
        trace.write(&out)?;
    }
    print(&format!("{}{}\n", contents(&imported.traces), out.display()))?;
    for note in &imported.notes {
        eprintln!("note: {note}");
    }
    for trace in &imported.traces {
        for finding in Subject::new(trace, None).findings() {
            eprintln!("warning: {}: {finding}", trace.sidecar.name);
        }
    }
    print_failures(&imported.failures);
    Ok(if imported.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}

/// Checks that a trace replaces nothing but a trace of the same importer.
///
/// # Errors
/// If one of its two files is there and is none of this importer.
fn check_replaces_imported(path: &Path, trace: &Trace) -> Result<(), Error> {
    check_replaces_own(path, "a trace", |path| is_trace_table(path).unwrap_or(false))?;
    let generator = &trace.sidecar.generator.name;
    let kind = format!("the sidecar of a trace that `whisker import {generator}` wrote");
    check_replaces_own(&path.with_extension("json"), &kind, |path| {
        read_json::<Value>(path).is_ok_and(|file| file["kind"] == "trace" && file["generator"]["name"] == **generator)
    })
}

fn print_failures(failures: &[Error]) {
    for failure in failures {
        eprintln!("error: {failure}");
    }
}

/// Table of the imported traces, one row per whisker and group.
fn contents(traces: &[Trace]) -> String {
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut of_group: BTreeMap<(&str, Role, &str), Vec<&Trace>> = BTreeMap::new();
    for trace in traces {
        let sidecar = &trace.sidecar;
        of_group.entry((&sidecar.whisker.name, sidecar.role, &sidecar.group)).or_default().push(trace);
    }
    for ((whisker, role, group), members) in of_group {
        let instants: usize = members.iter().map(|trace| trace.sidecar.rows).sum();
        let known = members.iter().flat_map(|trace| &trace.truth.instants).filter(|truth| truth.contact.is_some());
        rows.push(vec![
            whisker.into(),
            group.into(),
            role.name().into(),
            members.len().to_string(),
            instants.to_string(),
            known.count().to_string(),
        ]);
    }
    table::render(&["whisker", "group", "role", "traces", "rows", "known contacts"], &rows, 3)
}
